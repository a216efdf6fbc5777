"""Tasks of images and white images: whole, in tiles of rows, or in passes until their noise is low enough.

The verdict of `noise_check` is all that the next pass reads of the noise that was asked for: passes that two requests
have in common are the same tasks, so that a finer request goes on from the samples of a coarser one.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import read_json, write_json
from pipeline.files.npy import read_npy, write_npy
from pipeline.files.png import write_png
from pipeline.jit.work import work
from pipeline.render import in_lights
from pipeline.render.glow.light import GlowingView, TargetLight
from pipeline.render.lighting.lit_scene import LitView
from pipeline.render.passes import Batch
from pipeline.render.spectral.preview import srgb_preview
from pipeline.tasks.artefacts import passes
from pipeline.tasks.artefacts.cameras import Inputs, imaged_rig, stacked, tracer_alone
from pipeline.tasks.artefacts.surroundings import placed_occluder, placed_target
from pipeline.tasks.params.cameras import Nothing
from pipeline.tasks.params.images import (
    BEFORE,
    STRIP,
    Exposure,
    Image,
    ImagePass,
    ImageTile,
    NoiseCheck,
    White,
    WhitePass,
    WhiteTile,
)
from pipeline.tasks.params.placed import PICTURE, PaintedView

WHITE, FOREIGN = "white.npy", "foreign.npy"


def white_tile(params: WhiteTile, inputs: Inputs, out: Path) -> None:
    """Some rows of the image of a white scene, which `white` joins and images read: two arrays."""
    white_rows(params, inputs, out, params.rows)


def white_rows(
    params: White | WhiteTile, inputs: Inputs, out: Path, rows: tuple[int, int] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Rows from the first to an end, by default all, (h, w, wavelengths) float64 each, written for images: the white
    image, and its part through other microlenses than that of the pixel's cell."""
    rig = imaged_rig(inputs, params.exposure)
    known = in_lights.known_white_parts(rig, rows) if params.is_smooth else None
    white, foreign = in_lights.white_parts(rig, params.exposure.samples, rows) if known is None else known
    for name, pixels in ((WHITE, white), (FOREIGN, foreign)):
        write_npy(out / name, np.ascontiguousarray(pixels))
    return white, foreign


def white_pass(params: WhitePass, inputs: Inputs, out: Path) -> None:
    """Write the white images of all replicas, (replicas, 2, h, w, wavelengths) as of `white_parts`, and facts."""
    if passes.is_over(params.number, inputs):
        passes.hand_on(inputs, out)
        return
    rig = imaged_rig(inputs, params.exposure)
    known = in_lights.known_white_parts(rig, params.rows) if params.is_smooth else None

    def parts(batch: Batch) -> np.ndarray:
        return in_lights.white_parts(rig, batch, params.rows) if known is None else known

    means = passes.means_of(params.number, params.exposure.samples, inputs, parts)
    seen = in_lights.in_all(rig.tracer, means[:, 0])
    passes.write_pass(out, means, seen, params.number + 1, float(seen.mean(axis=0).sum()))


def white(params: White, inputs: Inputs, out: Path) -> None:
    """The image of a white scene, i.e. vignetting and, behind microlenses, micro-images: white.exr and white.png."""
    tracer, parts, labels = tracer_alone(inputs, params.exposure.seed), [], {}
    if params.noise is not None:
        means = [read_npy(inputs[f"{STRIP}{strip}"][passes.MEANS]) for strip in range(params.tiles)]
        whole = passes.ended(inputs, params.noise, lambda strip: in_lights.in_all(tracer, means[strip][:, 0]))
        parts, labels = [whole.part], whole.labels
        white, foreign = np.concatenate(means, axis=2).mean(axis=0)
    elif params.tiles:
        white, foreign = (stacked(inputs, params.tiles, name) for name in (WHITE, FOREIGN))
    else:
        white, foreign = white_rows(params, inputs, out)
    white, foreign = in_lights.in_all(tracer, white), in_lights.in_all(tracer, foreign)
    if tracer.camera.microlenses is not None:
        parts = [_crosstalk(white, foreign), *parts]
    write_image(out, "white", Rendered(white, tuple(parts), labels), params.exposure, tracer)


def _crosstalk(white: np.ndarray, foreign: np.ndarray) -> BandedPart:
    """The share of foreign light in each pixel."""
    total = float(foreign.sum() / white.sum()) if white.any() else math.nan
    share = np.divide(foreign, white, out=np.full_like(white, np.nan), where=white > 0)
    content = "share of the light that came through another microlens than that of the pixel's cell"
    return passes.part_of("crosstalk", share, {"content": content, "of_all_light": total})


PIXELS = "pixels.npy"


def image_tile(params: ImageTile, inputs: Inputs, out: Path) -> None:
    """Some rows of an image, for the task `image`: pixels.npy."""
    image_tile_together([params], inputs, [out])


def image_tile_together(params: Sequence[ImageTile], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The same rows of several frames, which share their rays."""
    views = [tile.view for tile in params]
    for pixels, out in zip(image_rows(params[0].exposure, views, inputs, params[0].rows), outs, strict=True):
        write_npy(out / PIXELS, pixels)


def image_rows(
    exposure: Exposure, views: Sequence[PaintedView], inputs: Inputs, rows: tuple[int, int] | None = None
) -> np.ndarray:
    """Rows from the first to an end, by default all, of the images of several views, (views, h, w) float64."""
    rig = imaged_rig(inputs, exposure)
    white = np.array([read_npy(inputs["white"][name]) for name in (WHITE, FOREIGN)])
    scenes = [scene_of(view, inputs) for view in views]
    return in_lights.pictures_in_lights(rig, exposure.samples, scenes, white, rows)


def scene_of(view: PaintedView, inputs: Inputs) -> TargetLight | GlowingView | LitView:
    """The view as the rooms of light take it."""
    targets, occluders = list(map(placed_target, view.targets)), list(map(placed_occluder, view.occluders))
    if view.lighting is None:
        if not any(view.colours):
            return TargetLight(targets, view.background, occluders)
        return GlowingView(targets, view.background, occluders, view.colours)
    pictures = {role: read_npy(files[PICTURE]) for role, files in inputs.items() if PICTURE in files}
    return LitView(targets, occluders, view.lighting, pictures, view.background, view.lights, view.colours)


def image_pass(params: ImagePass, inputs: Inputs, out: Path) -> None:
    """Write what is sampled of the image in all replicas, (replicas, h, w), and facts; the first pass writes the
    colours of the rest, (2, h, w, wavelengths) as of `colours_in_lights`.
    """
    if passes.is_over(params.number, inputs):
        passes.hand_on(inputs, out)
        return
    exposure, rows, first = params.exposure, params.rows, params.number == 0
    rig, scene = imaged_rig(inputs, exposure), scene_of(params.view, inputs)
    white = read_npy(inputs["white"][passes.MEANS]).mean(axis=0)
    colour = in_lights.colours_in_lights(rig, scene, rows) if first else read_npy(inputs["first"][passes.COLOURS])
    means = passes.means_of(
        params.number,
        exposure.samples,
        inputs,
        lambda batch: in_lights.sampled_in_lights(rig, batch, scene, white, colour, rows),
    )
    if first:
        write_npy(out / passes.COLOURS, colour)
    known = in_lights.known_in_lights(rig.tracer, white, colour)
    passes.write_pass(out, means, means, params.number + 1, float(np.sum(means.mean(axis=0) + known)))


_PREVIEW_ROWS = 512
"""Rows of a preview that are converted at once: the formula takes some hundred bytes per pixel."""


class Rendered(NamedTuple):
    """An image, (h, w) float64 relative irradiance, with further parts of its file and attributes of the first part."""

    pixels: np.ndarray
    parts: tuple[BandedPart, ...] = ()
    labels: Mapping[str, str | float | int] | None = None


def image(params: Image, inputs: Inputs, out: Path) -> None:
    """The image of a camera in a frame, linear and as a preview, from tiles or passes: image.exr and image.png."""
    if params.noise is not None:
        _write(out, _from_passes(params.noise, params.exposure, inputs), params, inputs)
    elif params.tiles:
        _write(out, Rendered(stacked(inputs, params.tiles, PIXELS)), params, inputs)
    else:
        image_together([params], inputs, [out])


def image_together(params: Sequence[Image], inputs: Inputs, outs: Sequence[Path]) -> None:
    """Images without tiles of several frames, which share their rays."""
    views = [image.view for image in params if image.view]
    for pixels, image, out in zip(image_rows(params[0].exposure, views, inputs), params, outs, strict=True):
        _write(out, Rendered(pixels), image, inputs)


def _write(out: Path, image: Rendered, params: Image, inputs: Inputs) -> None:
    write_image(out, "image", image, params.exposure, tracer_alone(inputs, params.exposure.seed))


def _from_passes(noise: float, exposure: Exposure, inputs: Inputs) -> Rendered:
    """The image after the last passes over it and over the white image; each replica takes the same one of both."""
    tracer = tracer_alone(inputs, exposure.seed)

    def replicas(strip: int) -> np.ndarray:
        colour = read_npy(inputs[f"first{strip}"][passes.COLOURS])
        known = [
            in_lights.known_in_lights(tracer, white, colour)
            for white in read_npy(inputs[f"white{strip}"][passes.MEANS])
        ]
        return read_npy(inputs[f"{STRIP}{strip}"][passes.MEANS]) + np.array(known)  # type: ignore[no-any-return]

    image = passes.ended(inputs, noise, replicas)
    return Rendered(image.pixels, (image.part,), image.labels)


def write_image(out: Path, name: str, image: Rendered, exposure: Exposure, tracer: Tracer) -> None:
    """Write `name`.exr, relative irradiance with its reference in the header, and `name`.png, an 8-bit preview."""
    by_area, pixels = tracer.camera.weight == "area", image.pixels
    measure = "dA in the sampling plane" if by_area else "cos(theta) d omega"
    attributes = {
        "content": f"relative irradiance: integral of L {measure} over W_ref",
        "W_ref_mm2" if by_area else "W_ref_sr": tracer.reference_weight_sr,
        **labels_of(exposure),
        **(image.labels or {}),
    }
    write_bands(out / f"{name}.exr", [passes.part_of(name, pixels, attributes), *image.parts])
    bands = range(0, len(pixels), _PREVIEW_ROWS)
    preview = [srgb_preview(pixels[first : first + _PREVIEW_ROWS], 1.0) for first in bands]
    write_png(out / f"{name}.png", np.concatenate(preview))


def labels_of(exposure: Exposure) -> dict[str, str | float | int]:
    """Attributes in the header of an image that describe its rays."""
    labels = dataclasses.asdict(dataclasses.replace(exposure, channel=None))
    del labels["channel"]
    if device := labels.pop("device"):
        labels["rays"] = f"float32, {device}"
    if labels.pop("diffraction"):
        labels["diffraction"] = "of the stop, or of each microlens"
    return labels if exposure.channel is None else {**labels, "light": exposure.channel.text}


def noise_level(params: Nothing, inputs: Inputs, out: Path) -> None:
    """The mean of an image after the first pass, to which its noise is relative: level.json."""
    parts = [passes.facts_of(inputs, role) for role in sorted(inputs)]
    level = math.fsum(part.light for part in parts) / sum(part.pixels for part in parts)
    write_json(out / passes.LEVEL, {"mean": level})


def noise_check(params: NoiseCheck, inputs: Inputs, out: Path) -> None:
    """Whether some rows of an image need another pass: verdict.json; tells the noise to whoever watches the build."""
    facts, level = passes.facts_of(inputs, BEFORE), read_json(inputs["level"][passes.LEVEL])["mean"]
    goes_on = facts.noise > params.noise * level
    write_json(out / passes.VERDICT, {"goes_on": goes_on})
    if level > 0:
        work().news = f"noise {facts.noise / level:.2g}, asked {params.noise:g}"
