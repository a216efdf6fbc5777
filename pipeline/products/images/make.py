"""Tasks of images and white images: whole, in tiles of rows, or in strips that take passes until their noise is low.

A pass renders a strip in `REPLICAS` independent replicas, whose spread gives the standard error of their mean. Noise is
relative to the mean of the image, known from the first passes over all strips. Afterwards each strip goes on alone.

Pixels whose light comes from one colour are not sampled: they are the white image times that colour (`imaging`).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.rig import Rig
from pipeline.files.exr_bands import BandedPart
from pipeline.files.jsonfile import read_json, write_json
from pipeline.files.npy import read_npy, write_npy
from pipeline.jit.work import work
from pipeline.motion import Shutter
from pipeline.products.cameras import Inputs, imaged_rig, stacked, tracer_alone
from pipeline.products.images.files import Rendered, part_of, write_image
from pipeline.products.images.params import FIRST, OWN, STRIP, Image, Rendering, White
from pipeline.products.light import Exposure
from pipeline.products.surroundings import placed_occluder, placed_target, view_at
from pipeline.products.views import PaintedView
from pipeline.render import imaging
from pipeline.render.glow import GlowingView, TargetLight
from pipeline.render.imaging import SceneView
from pipeline.render.pixel_rays import Band, Batch, Rows, joined, noise_of, standard_error

WHITE, FOREIGN, PIXELS = "white.npy", "foreign.npy", "pixels.npy"
MEANS, COLOURS, FACTS = "means.npy", "colours.npy", "facts.json"
ScenesAt = Callable[[PaintedView | None, list[float], Inputs], list[SceneView]]
"""Reader of the view of an image, of the type that the params of its task have, at instants [s] after the time code of
its frame."""


class FirstFacts(NamedTuple):
    """Facts about the rows of a strip after the first pass: the sum of all pixels, and their number."""

    light: float
    pixels: int


class LastFacts(NamedTuple):
    """Facts about the rows of a strip: the passes, and the root mean square of the standard errors of pixels that have
    any.
    """

    passes: int
    noise: float


def mean_of_first_passes(inputs: Inputs) -> float:
    """The mean of an image after the first passes over all strips."""
    firsts = [FirstFacts(**read_json(files[FACTS])) for role, files in inputs.items() if role.startswith(FIRST)]
    return math.fsum(first.light for first in firsts) / sum(first.pixels for first in firsts)


def replicas_of(number: int, samples: int, render: Callable[[Batch], np.ndarray]) -> np.ndarray:
    """Each replica of a pass, (replicas, ...); `samples` are those of the first pass in all replicas."""
    first = max(1, samples // REPLICAS)
    return np.stack([render(Batch(first, number, replica)) for replica in range(REPLICAS)])


def write_first(out: Path, means: np.ndarray, image: np.ndarray) -> None:
    """Write the replicas of a first pass, and facts about the image (h, w) that is their mean."""
    write_npy(out / MEANS, means)
    write_json(out / FACTS, FirstFacts(float(image.sum()), image.size)._asdict())


def write_strip(
    out: Path,
    params: Rendering,
    inputs: Inputs,
    replicas: Callable[[int], np.ndarray],
    image: Callable[[np.ndarray], np.ndarray] = lambda means: means,
) -> None:
    """Take passes over a strip until its noise is low enough, or there are as many as there may be; write the means of
    the replicas over all passes, and facts.

    `replicas` renders those of a further pass. `image` makes of means the images (replicas, h, w) whose noise counts.
    """
    assert params.noise is not None  # strips have one
    level = mean_of_first_passes(inputs)
    means = read_npy(inputs[OWN][MEANS])
    passes = 1
    while (noise := noise_of(standard_error(image(means)))) > params.noise * level and passes < params.passes:
        means = joined(means, replicas(passes))
        passes += 1
    write_npy(out / MEANS, means)
    write_json(out / FACTS, LastFacts(passes, noise)._asdict())
    if level > 0:
        work().news = f"noise {noise / level:.2g} after pass {passes}, asked {params.noise:g}"


def image_of_strips(inputs: Inputs, stated_noise: float, replicas: Callable[[int], np.ndarray]) -> Rendered:
    """An image of strips, the roles `tile0`, `tile1`, …; the mean over its replicas.

    `stated_noise` is relative to the mean of the image; `replicas` returns the images (replicas, h, w) of a strip.
    """
    strips = range(sum(role.startswith(STRIP) for role in inputs))
    images = (replicas(strip) for strip in strips)
    pixels, errors = zip(*((image.mean(axis=0), standard_error(image)) for image in images), strict=True)
    facts = [LastFacts(**read_json(inputs[f"{STRIP}{strip}"][FACTS])) for strip in strips]
    level = mean_of_first_passes(inputs)
    labels = {
        "noise_asked": stated_noise,
        "noise": max(strip_facts.noise for strip_facts in facts) / level if level > 0 else 0.0,
        "passes_least": min(strip_facts.passes for strip_facts in facts),
        "passes_most": max(strip_facts.passes for strip_facts in facts),
    }
    if labels["noise"] > stated_noise:
        work().news = f"noise {labels['noise']:.2g} with the most samples there may be, asked {stated_noise:g}"
    content = f"standard error of each pixel of the image, from {REPLICAS} independent replicas"
    error = part_of("standard_error", np.concatenate(errors), {"content": content})
    return Rendered(np.concatenate(pixels), (error,), labels)


def white_tile(params: White, inputs: Inputs, out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Some rows of the image of a white scene, (h, w, wavelengths) float64, and of its part through other microlenses
    than that of the pixel's cell: two arrays, which `white` joins and images read.
    """
    rig = imaged_rig(inputs, params.exposure)
    smooth = imaging.known_white_parts(rig, params.rows) if params.is_smooth else None
    parts = imaging.white_parts(rig, params.exposure.samples, params.rows) if smooth is None else smooth
    light, through_others = parts
    for name, pixels in ((WHITE, light), (FOREIGN, through_others)):
        write_npy(out / name, np.ascontiguousarray(pixels))
    return light, through_others


def white_first(params: White, inputs: Inputs, out: Path) -> None:
    """Write the white images of all replicas, (replicas, 2, h, w, wavelengths) as of `white_parts`, and facts."""
    rig = imaged_rig(inputs, params.exposure)
    means = _white_replicas(params, rig, 0)
    write_first(out, means, imaging.over_wavelengths(rig.tracer, means[:, 0]).mean(axis=0))


def white_strip(params: White, inputs: Inputs, out: Path) -> None:
    """Write the same after all passes that a strip needs."""
    rig = imaged_rig(inputs, params.exposure)
    write_strip(
        out,
        params,
        inputs,
        lambda number: _white_replicas(params, rig, number),
        lambda means: imaging.over_wavelengths(rig.tracer, means[:, 0]),
    )


def _white_replicas(params: White, rig: Rig, number: int) -> np.ndarray:
    """Replicas of pass `number` over a strip of a white image; if quadrature knows its rows, they are all the same."""
    smooth = imaging.known_white_parts(rig, params.rows) if params.is_smooth else None

    def parts(batch: Batch) -> np.ndarray:
        return imaging.white_parts(rig, batch, params.rows) if smooth is None else smooth

    return replicas_of(number, params.exposure.samples, parts)


def white(params: White, inputs: Inputs, out: Path) -> None:
    """The image of a white scene, i.e. vignetting and, behind microlenses, micro-images: white.exr and white.png."""
    tracer = tracer_alone(inputs, params.exposure.seed)
    strips = None
    # Behind each branch: all light, and the part through other microlenses, (h, w, wavelengths) each.
    if params.noise is not None:  # in strips, each by its own number of passes
        # Of each strip (replicas, 2, h, w, wavelengths): both arrays in every replica
        means = [read_npy(inputs[f"{STRIP}{strip}"][MEANS]) for strip in range(params.tiles)]
        strips = image_of_strips(
            inputs, params.noise, lambda strip: imaging.over_wavelengths(tracer, means[strip][:, 0])
        )
        light, through_others = np.concatenate(means, axis=2).mean(axis=0)
    elif params.tiles:  # in tiles of rows
        light, through_others = (stacked(inputs, params.tiles, name) for name in (WHITE, FOREIGN))
    else:  # in one piece
        light, through_others = white_tile(params, inputs, out)
    pixels = imaging.over_wavelengths(tracer, light)
    pixels_through_others = imaging.over_wavelengths(tracer, through_others)
    parts: tuple[BandedPart, ...] = ()
    if tracer.camera.microlenses is not None:
        parts += (_crosstalk(pixels, pixels_through_others),)
    if strips is not None:
        parts += strips.parts
    labels = strips.labels if strips else None
    write_image(out, "white", Rendered(pixels, parts, labels), params.exposure, tracer)


def _crosstalk(pixels: np.ndarray, through_others: np.ndarray) -> BandedPart:
    """The part of white.exr with the share of light through other microlenses in each pixel; NaN where there is none of
    any.
    """
    total = float(through_others.sum() / pixels.sum()) if pixels.any() else math.nan
    share = np.divide(through_others, pixels, out=np.full_like(pixels, np.nan), where=pixels > 0)
    content = "share of the light that came through another microlens than that of the pixel's cell"
    return part_of("crosstalk", share, {"content": content, "of_all_light": total})


def scenes_at(view: PaintedView | None, times_s: list[float], inputs: Inputs) -> list[SceneView]:
    """Targets and occluders that glow, at each instant [s]."""
    assert view is not None  # tiles, passes and images without them have one
    return [_glowing(view_at(view, time_s)) for time_s in times_s]


def _glowing(view: PaintedView) -> SceneView:
    targets = list(map(placed_target, view.targets))
    occluders = list(map(placed_occluder, view.occluders))
    if not any(view.colours):
        return TargetLight(targets, view.background, occluders)
    return GlowingView(targets, view.background, occluders, view.colours)


def image_tile(params: Sequence[Image], inputs: Inputs, outs: Sequence[Path], scenes_at: ScenesAt = scenes_at) -> None:
    """The same rows of the images of frames, which share their rays, for the task `image`: pixels.npy."""
    for pixels, out in zip(image_rows(params, inputs, scenes_at), outs, strict=True):
        write_npy(out / PIXELS, pixels)


def image_rows(images: Sequence[Image], inputs: Inputs, scenes_at: ScenesAt) -> np.ndarray:
    """The same rows of several frames, (frames, h, w) float64.

    All stills share their rays; each frame with a shutter has its own instants, and is their mean.
    """
    exposure = images[0].exposure
    white = np.array([read_npy(inputs["white"][name]) for name in (WHITE, FOREIGN)])
    rig = imaged_rig(inputs, exposure)
    width_px, height_px = rig.tracer.camera.sensor.size_px
    first_row, end_row = images[0].rows or (0, height_px)

    def rendered(scenes: list[SceneView], lines: Rows, columns: Rows) -> np.ndarray:
        first, end = with_neighbours(rig, columns)
        their_white = white[:, lines[0] - first_row : lines[1] - first_row, first:end]
        light = imaging.pictures_in_lights(rig, exposure.samples, scenes, their_white, lines, (first, end))
        return light[..., columns[0] - first : columns[1] - first]

    result = np.empty((len(images), end_row - first_row, width_px))
    stills = [number for number, image in enumerate(images) if image.shutter is None]
    moving = [[number] for number, image in enumerate(images) if image.shutter is not None]
    for numbers in filter(None, [stills, *moving]):
        shutter = images[numbers[0]].shutter
        for times_s, lines, columns in exposures(shutter, (first_row, end_row), (width_px, height_px)):
            scenes = [scene for number in numbers for scene in scenes_at(images[number].view, times_s, inputs)]
            light = rendered(scenes, lines, columns)
            at_instants = light.reshape(len(numbers), len(times_s), *light.shape[1:])
            their_rows = slice(lines[0] - first_row, lines[1] - first_row)
            result[numbers, their_rows, slice(*columns)] = at_instants.mean(axis=1)
    return result


def with_neighbours(rig: Rig, columns: Rows) -> Rows:
    """Columns whose light contributes to that of some: of a conventional camera the adjacent ones, too."""
    if rig.images is not None:
        return columns
    return max(0, columns[0] - 1), min(columns[1] + 1, rig.tracer.camera.sensor.width_px)


def exposures(
    shutter: Shutter | None, rows: Rows, size_px: tuple[int, int]
) -> Iterator[tuple[list[float], Rows, Rows]]:
    """Parts of some rows of an image that are exposed together: instants [s] of which their pixels are the mean, their
    rows and their columns. A still is one part with one instant.
    """
    if shutter is None:
        yield [0.0], rows, (0, size_px[0])
        return
    count = shutter.instants if shutter.exposure_s else 1
    after_opening_s = shutter.exposure_s * (np.arange(count) + 0.5) / count
    for opens_s, lines, columns in shutter.lines(rows, size_px):
        yield (opens_s + after_opening_s).tolist(), lines, columns


def image_first(params: Image, inputs: Inputs, out: Path, scenes_at: ScenesAt = scenes_at) -> None:
    """Write the sampled light of all replicas, (replicas, h, w), facts, and the colours of pixels that are not sampled,
    (2, h, w, wavelengths) as of `colours_in_lights`: with a shutter their mean over the instants, 0 where there are
    none.
    """
    sampled, colour = _image_replicas(params, inputs, 0, None, scenes_at)
    unsampled = imaging.known_in_lights(tracer_alone(inputs, params.exposure.seed), _first_white(inputs), colour)
    write_npy(out / COLOURS, colour)
    write_first(out, sampled, sampled.mean(axis=0) + unsampled)


def image_strip(params: Image, inputs: Inputs, out: Path, scenes_at: ScenesAt = scenes_at) -> None:
    """Write the sampled light of all passes that a strip needs."""
    colours = None if params.shutter else read_npy(inputs[OWN][COLOURS])[None]
    write_strip(out, params, inputs, lambda number: _image_replicas(params, inputs, number, colours, scenes_at)[0])


def _first_white(inputs: Inputs) -> np.ndarray:
    """The white image after its first pass, (2, h, w, wavelengths)."""
    return read_npy(inputs["white"][MEANS]).mean(axis=0)  # type: ignore[no-any-return]


def _image_replicas(
    params: Image, inputs: Inputs, number: int, known_colours: np.ndarray | None, scenes_at: ScenesAt
) -> tuple[np.ndarray, np.ndarray]:
    """Sampled light of pass `number`, and colours of all other pixels, as in `image_first`; those known from an earlier
    pass are not computed again.
    """
    rows = params.rows
    shutter = params.shutter
    assert rows is not None  # passes are over strips
    rig = imaged_rig(inputs, params.exposure)
    white = _first_white(inputs)
    parts = []
    for times_s, lines, columns in exposures(shutter, rows, rig.tracer.camera.sensor.size_px):
        scenes = scenes_at(params.view, times_s, inputs)
        first, end = with_neighbours(rig, columns)
        bands = imaging.bands_in_lights(rig, lines, (first, end))
        their_white = white[:, lines[0] - rows[0] : lines[1] - rows[0], first:end]
        colours = imaging.colours_in_lights(bands, scenes) if known_colours is None else known_colours
        render = partial(_sampled, rig, bands, scenes, their_white, colours)
        light = replicas_of(number, params.exposure.samples, render)
        unsampled = np.nan_to_num(colours).mean(axis=0) if shutter else colours[0]
        own = slice(columns[0] - first, columns[1] - first)
        parts.append((light[..., own], unsampled[..., own, :]))
    # Parts of a shutter lie along its axis; those of a still follow each other from the top.
    axis = 2 - shutter.axis if shutter else 1
    sampled, unsampled = (np.concatenate(part, axis=axis) for part in zip(*parts, strict=True))
    return sampled, unsampled


def _sampled(
    rig: Rig, bands: list[Band], scenes: list[SceneView], white: np.ndarray, colour: np.ndarray, batch: Batch
) -> np.ndarray:
    """Sampled light of a batch of rays, the mean over instants, (h, w)."""
    return imaging.sampled_in_lights(rig, bands, batch, scenes, white, colour).mean(axis=0)


def image(params: Sequence[Image], inputs: Inputs, outs: Sequence[Path], scenes_at: ScenesAt = scenes_at) -> None:
    """The image of a camera in a frame, linear and as a preview: image.exr and image.png.

    It is that of tiles or strips; without these, several frames share their rays.
    """
    first = params[0]
    exposure = first.exposure
    if first.noise is not None:
        images = [_from_strips(first.noise, exposure, inputs)]
    elif first.tiles:
        images = [Rendered(stacked(inputs, first.tiles, PIXELS))]
    else:
        images = list(map(Rendered, image_rows(params, inputs, scenes_at)))
    for rendered, out in zip(images, outs, strict=True):
        write_image(out, "image", rendered, exposure, tracer_alone(inputs, exposure.seed))


def _from_strips(noise: float, exposure: Exposure, inputs: Inputs) -> Rendered:
    """The image of strips of it and of the white image; each replica takes the same one of both."""
    tracer = tracer_alone(inputs, exposure.seed)

    def replicas(strip: int) -> np.ndarray:
        colour = read_npy(inputs[f"{FIRST}{strip}"][COLOURS])
        unsampled = [
            imaging.known_in_lights(tracer, white, colour) for white in read_npy(inputs[f"white{strip}"][MEANS])
        ]
        return read_npy(inputs[f"{STRIP}{strip}"][MEANS]) + np.array(unsampled)  # type: ignore[no-any-return]

    return image_of_strips(inputs, noise, replicas)
