"""Colours of a sensor with red, green and blue channels: for other programs, and for pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.channel_names import colour_of
from pipeline.records.shapes import Num
from pipeline.render.sensor.response import SensorResponse

if TYPE_CHECKING:
    from pipeline.render.spectral.nodes import Table

PRIMARIES = ("red", "green", "blue")
"""Channels that make a colour picture."""
DAYLIGHT = "D65"
"""Illuminant in which raw converters expect a camera to be calibrated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Colorimetry:
    """A sensor compared with the standard observer."""

    illuminant: str  # light of the scene, by its name in `spectra.illuminant`
    # CIE 1931 X, Y and Z of relative irradiances of red, green and blue; white has Y = 1, and 1 in each channel
    xyz_from_rgb: tuple[tuple[float, ...], ...]
    # what red, green and blue count of white, in a unit that is the same for all lights of a sensor
    counted: tuple[float, ...]

    @property
    def chromaticities(self) -> tuple[float, ...]:
        """Chromaticities x, y of red, green, blue and white: the same matrix in OpenEXR's form."""
        xyz = np.array([*zip(*self.xyz_from_rgb, strict=True), np.sum(self.xyz_from_rgb, axis=1)])
        return tuple((xyz[:, :2] / xyz.sum(axis=1, keepdims=True)).ravel().tolist())


def colorimetry(responses: Sequence[tuple["Table", bool]], illuminant: str) -> Colorimetry | None:
    """Colour matrix of the red, green and blue responses: exact for white and, in least squares, best for a
    ColorChecker. None if the channels do not span three colours of the observer.

    `responses`: tables over wavelengths, each with a flag whether it counts photons, or energy.
    """
    from pipeline.render.spectral import spectra

    nm = np.arange(spectra.VISIBLE_NM[0], spectra.VISIBLE_NM[1] + 1.0)
    power = np.interp(nm, *spectra.illuminant(illuminant), left=0.0, right=0.0)
    counted = power * [
        np.interp(nm, *table, left=0.0, right=0.0) * (nm if counts_photons else 1.0)
        for table, counts_photons in responses
    ]
    patches, observer = spectra.patches_and_observer(nm)
    response = observer * power
    if not (counted.any(axis=1).all() and response.any()):
        return None
    xyz = patches @ response.T / response[1].sum()
    white = response.sum(axis=1) / response[1].sum()
    red, green, blue = ((patches @ curve / curve.sum())[:, None] for curve in counted)
    # White fixes the sum of the columns: red and blue count by how they differ from green.
    (by_red, by_blue), *_ = np.linalg.lstsq(np.hstack([red, blue]) - green, xyz - green * white, rcond=None)
    matrix = np.column_stack([by_red, white - by_red - by_blue, by_blue]).round(9)
    if abs(np.linalg.det(matrix)) < 1e-6:  # two channels have the same response
        return None
    white_counts = tuple((counted.sum(axis=1) / response[1].sum()).tolist())
    return Colorimetry(illuminant=illuminant, xyz_from_rgb=tuple(map(tuple, matrix.tolist())), counted=white_counts)


def in_colour(
    numbers: Num[np.ndarray, "h w"],
    response: SensorResponse,
    first_row: int = 0,
    photons: Mapping[str, float] | None = None,
) -> np.ndarray:
    """Demosaicked red, green and blue of some rows of a mosaic, 1 at the white level, (h, w, 3). Not for measurement.

    Missing values are means over the same channel less than a period away, by a triangle of distances (bilinear
    interpolation for a Bayer pattern). Channels are divided by their quantum efficiencies, relative to the best, so
    that a white scene is grey.

    `numbers`: digital numbers.
    `first_row`: index in the image of the first of these rows, which decides where the mosaic begins.
    `photons`: photons of white in each channel, if they differ.
    """
    period = response.period_px
    height, width = numbers.shape
    light = (numbers - response.black_level_dn) / max(response.white_dn - response.black_level_dn, 1.0)
    pattern = np.roll(np.array(response.filters).reshape(period, period), -first_row, axis=0)
    filter_at = np.tile(pattern, (height // period + 1, width // period + 1))[:height, :width]
    efficiency = dict(zip(response.channels, response.quantum_efficiency, strict=True))
    if photons:
        efficiency = {name: share * photons[name] for name, share in efficiency.items()}
    name_of = {colour_of(name): name for name in response.channels}
    names = [name_of[colour] for colour in PRIMARIES]
    best = max(efficiency[name] for name in names)
    channels = [_interpolated(light, filter_at == name, period) * best / efficiency[name] for name in names]
    return np.stack(channels, axis=-1)


def has_colours(response: SensorResponse) -> bool:
    """Whether a mosaic has the channels of a picture."""
    return set(PRIMARIES) <= set(map(colour_of, response.channels))


def _interpolated(values: np.ndarray, is_sampled: np.ndarray, period: int) -> np.ndarray:
    """Values of all pixels: means of the sampled ones, weighted by a triangle of twice the period along each axis."""
    from scipy.ndimage import convolve1d

    weight = np.convolve(np.ones(period), np.ones(period)) / period
    total = np.where(is_sampled, values, 0.0)
    count = is_sampled.astype(float)
    for axis in (0, 1):  # nothing lies beyond the border
        total, count = (convolve1d(sums, weight, axis, mode="constant") for sums in (total, count))
    return np.where(is_sampled, values, total / np.maximum(count, 1e-12))
