"""Tasks `expose`, `transmission` and `fixed_pattern`: raw images, and the truth behind them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.channel_names import colour_of
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import Json, read_json, write_json
from pipeline.files.png import write_png
from pipeline.files.tiff import Negative, mapped, write_dng, write_tiff
from pipeline.optics.first_order import first_order
from pipeline.products.cameras import Inputs, focused_camera, in_bands, light_file
from pipeline.products.raw.params import DNG, MAPS, PREVIEW, TIFF, TRANSMISSION, Expose, PatternMaps, Transmission
from pipeline.records.plain import from_plain, to_plain
from pipeline.render.radiometry import FieldTransmission, field_transmission, photon_rate
from pipeline.render.sensor import read_out
from pipeline.render.sensor.colours import PRIMARIES, has_colours, in_colour
from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import SensorResponse
from pipeline.render.spectral.preview import srgb_preview


def expose(params: Expose, inputs: Inputs, out: Path) -> None:
    """The raw image of a camera in a frame, from its linear image, or from that of each channel: three files."""
    response = params.response
    roles = {name: f"image_{name}" if f"image_{name}" in inputs else "image" for name in response.channels}
    images = {name: np.load(inputs[role][light_file("image")], mmap_mode="r") for name, role in roles.items()}
    shape = next(iter(images.values())).shape
    photons_at_one = _photons_at_one(params, inputs)
    transmissions = transmission_of(inputs)
    shot = Shot(
        seed=params.seed,
        camera=params.camera,
        frame=params.frame,
        exposure_time_s=params.irradiation.exposure_time_s,
    )

    def light(first: int, end: int) -> dict[str, np.ndarray]:
        pixels = {name: image[first:end].astype(float) for name, image in images.items()}
        for name in transmissions.keys() & pixels.keys():
            pixels[name] *= transmissions[name].relative_rows(first, end, shape[1])
        return pixels

    def rows(first: int, end: int) -> np.ndarray:
        padded = _with_margin(light, shape[0], (first, end), response.margin_px)
        photons = {name: photons_at_one[name] * padded[name] for name in response.channels}
        return digital_numbers(response, photons, shot, (first, 0))

    facts = _facts(params, photons_at_one)
    write_tiff(out / TIFF, shape, rows, facts)
    numbers = mapped(out / TIFF)
    negative = _negative(params, inputs, photons_at_one)
    write_dng(out / DNG, shape, lambda first, end: numbers[first:end], facts, negative)
    write_png(out / PREVIEW, _preview(numbers, response, photons_at_one if params.irradiation.channels else None))


def _photons_at_one(params: Expose, inputs: Inputs) -> dict[str, float]:
    """Mean number of photons in a pixel at relative irradiance 1, by channel."""
    irradiation = params.irradiation
    response = params.response
    if irradiation.channels:
        rates = {
            light.channel: photon_rate(focused_camera(inputs, f"camera_{light.channel}"), light)
            for light in irradiation.channels
        }
        return {name: irradiation.photons_at_one(response, rates[name]) for name in response.channels}
    radiance = irradiation.radiance
    rate = None if radiance is None else photon_rate(focused_camera(inputs), radiance)
    return dict.fromkeys(response.channels, irradiation.photons_at_one(response, rate))


def _negative(params: Expose, inputs: Inputs, photons_at_one: dict[str, float]) -> Negative:
    """Facts for raw converters. Only a mosaic of red, green and blue has colours: the matrix from XYZ to the camera's
    numbers for each illuminant, and the numbers of white.
    """
    response = params.response
    lens = first_order(focused_camera(inputs).prescription)
    negative = Negative(
        model=params.camera,
        black_dn=response.black_level_dn,
        white_dn=response.white_dn,
        filters=response.filters,
        exposure_time_s=params.irradiation.exposure_time_s,
        f_number=lens.f_number,
        focal_length_mm=lens.efl_mm,
    )
    efficiency = zip(response.channels, response.quantum_efficiency, strict=True)
    electrons = {colour_of(name): photons_at_one[name] * share for name, share in efficiency}
    if not params.colorimetry or electrons.keys() != set(PRIMARIES) or not all(electrons.values()):
        return negative
    # Electrons are those of the first illuminant; of another one, white has as many as its counts say.
    electrons_per_count = np.array([electrons[colour] for colour in PRIMARIES]) / params.colorimetry[0].counted
    from_xyz = {}
    for colours in params.colorimetry:
        white = electrons_per_count * colours.counted
        from_xyz[colours.illuminant] = (white[:, None] / white.max() * np.linalg.inv(colours.xyz_from_rgb)).tolist()
    neutral = tuple(electrons[colour] / max(electrons.values()) for colour in PRIMARIES)
    return replace(negative, neutral=neutral, from_xyz=from_xyz)


def _with_margin(
    light: Callable[[int, int], dict[str, np.ndarray]], height: int, rows: tuple[int, int], margin: int
) -> dict[str, np.ndarray]:
    """Channels of some rows and the pixels around them; beyond the border of the image its outermost pixels go on."""
    first, end = rows
    low = max(0, first - margin)
    high = min(height, end + margin)
    missing = (low - first + margin, end + margin - high), (margin, margin)
    return {name: np.pad(pixels, missing, "edge") for name, pixels in light(low, high).items()}


def _facts(params: Expose, photons_at_one: dict[str, float]) -> Json:
    """Facts about a raw image in its files."""
    response = params.response
    return {
        "content": "raw digital numbers: black level + gain x electrons, rounded",
        "camera": params.camera,
        "frame": params.frame,
        "seed": params.seed,
        "specimen": response.specimen,
        "bit_depth": response.bit_depth,
        "black_level_dn": response.black_level_dn,
        "white_level_dn": response.white_dn,
        "gain_dn_per_e": response.gain_dn_per_e,
        "filters": list(response.filters),
        "quantum_efficiency": list(response.quantum_efficiency),
        "exposure_time_s": params.irradiation.exposure_time_s,
        "photons_at_relative_irradiance_1": (
            photons_at_one if params.irradiation.channels else next(iter(photons_at_one.values()))
        ),
    }


def _preview(numbers: np.ndarray, response: SensorResponse, photons: dict[str, float] | None) -> np.ndarray:
    """The numbers from black to white as sRGB, (h, w, 3) uint8; a mosaic of red, green and blue in colour."""
    black = response.black_level_dn
    white = max(float(response.white_dn), black + 1.0)

    def picture(first: int, end: int) -> np.ndarray:
        if not has_colours(response):
            return srgb_preview(numbers[first:end] - black, white - black)
        # Colours are interpolated over a period of the mosaic.
        low = max(0, first - response.period_px)
        high = min(len(numbers), end + response.period_px)
        colours = in_colour(numbers[low:high], response, low, photons)[first - low : end - low]
        return np.stack([srgb_preview(channel, 1.0)[..., 0] for channel in np.moveaxis(colours, -1, 0)], axis=-1)

    return in_bands(len(numbers), picture)


_ALONE = "mono"
"""Name of the light of a camera without channels, as filters have it."""


def transmission(params: Transmission, inputs: Inputs, out: Path) -> None:
    """The share of light that the lens of a camera lets pass, over its image: transmission.json."""
    by_channel = {}
    for light in params.lights:
        camera = focused_camera(inputs, "camera" if light.channel is None else f"camera_{light.channel}")
        by_channel[light.channel or _ALONE] = field_transmission(camera, light.of_each)
    write_json(out / TRANSMISSION, {name: to_plain(field) for name, field in by_channel.items()})


def transmission_of(inputs: Inputs) -> dict[str, FieldTransmission]:
    """Transmission by channel, as the task wrote it; empty where it is no input."""
    if "transmission" not in inputs:
        return {}
    plain = read_json(inputs["transmission"][TRANSMISSION])
    return {name: from_plain(FieldTransmission, field) for name, field in plain.items() if field is not None}


_CHANNELS = ("dark_e", "hot_e_per_s", "response")


def fixed_pattern(params: PatternMaps, inputs: Inputs, out: Path) -> None:
    """Differences from pixel to pixel of the sensor of a camera: fixed_pattern.exr."""
    width = params.shape[1]

    def rows(first: int, end: int) -> np.ndarray:
        maps = read_out.fixed_pattern(params.spread, params.camera, (first, 0), (end - first, width))
        return np.stack([getattr(maps, name) for name in _CHANNELS], axis=-1)

    attributes: dict[str, str | float | int] = {
        "content": "DSNU dark_e [e-], PRNU response [1, 0: dead], further dark current hot_e_per_s [e-/s]",
        "specimen": params.spread.specimen,
    }
    part = BandedPart(name="fixed_pattern", shape=params.shape, channels=_CHANNELS, rows=rows, attributes=attributes)
    write_bands(out / MAPS, [part])
