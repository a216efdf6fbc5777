"""Plan of white images, and of the image of each frame."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from pipeline.limits import MOST_SAMPLES
from pipeline.products.draft import (
    Draft,
    Stop,
    exposure_of,
    lights_of,
    shutter_in,
)
from pipeline.products.images.params import FIRST, OWN, Image, White
from pipeline.products.tiles import image_bands, strips
from pipeline.products.views import PaintedView
from pipeline.records.plain import Shared, to_plain
from pipeline.render.spectral.prints import Colours
from pipeline.scene.dataset import CameraEntry, Frame


def plan_white_images(draft: Draft) -> None:
    """Add the white images of all cameras, at each stop that is asked for."""
    for entry in draft.entries:
        for stop in draft.stops(entry):
            white = _white(draft, entry, stop)
            draft.files.update({f"{stop.white}.{ending}": (white, f"white.{ending}") for ending in ("exr", "png")})


def plan_images(draft: Draft) -> None:
    """Add the images of all cameras in their frames."""
    for entry in draft.entries:
        # The colours of targets in its light
        colours = tuple(target.printed.colours(target.target, lights_of(entry)) for target in draft.dataset.targets)
        for frame in draft.dataset.frames_of(entry):
            image = _image(draft, entry, frame, colours)
            folder = f"frames/{frame.number:04d}/{entry.folder}"
            draft.files.update({f"{folder}/image.{ending}": (image, f"image.{ending}") for ending in ("exr", "png")})


def _white(draft: Draft, entry: CameraEntry, stop: Stop) -> str:
    """Add the tasks of a white image; name of the last one."""
    exposure = exposure_of(entry)
    noise = entry.image_noise
    sensor = entry.asked.sensor
    reads = {"camera": stop.camera}
    is_smooth = entry.asked.microlenses is None and not exposure.diffraction
    bands = strips(sensor) if noise is not None else image_bands(sensor, entry.image_samples)
    parts = [White(exposure=exposure, rows=rows, is_smooth=is_smooth) for rows in bands]
    if noise is not None:
        tiles = _strips(draft, f"white/{stop.name}", parts, reads, noise)
        count = len(parts)
    else:
        tiles = draft.add_tiles(f"white_tile/{stop.name}", parts, reads)
        count = len(tiles)
    params = White(exposure=exposure, tiles=count, is_smooth=is_smooth, noise=noise)
    return draft.add(f"white/{stop.name}", params, {**reads, **tiles})


def _image(draft: Draft, entry: CameraEntry, frame: Frame, colours: tuple[Colours, ...]) -> str:
    """Add the tasks of the image of a camera in a frame; name of the last one."""
    things = draft.painted
    camera = entry.full_name
    name = f"{camera}/{frame.number:04d}"
    exposure = exposure_of(entry)
    noise = entry.image_noise
    shutter = shutter_in(entry, frame)
    view = cast(PaintedView, Shared(to_plain(things.view(frame, entry, colours))))  # of many tiles
    sensor = entry.asked.sensor
    of_camera = {"camera": draft.camera(entry)}
    bands = strips(sensor) if noise is not None else image_bands(sensor, entry.image_samples)
    parts = [things.IMAGE(exposure=exposure, view=view, rows=rows, shutter=shutter) for rows in bands]
    reads = {**of_camera, **things.reads(draft)}
    if noise is not None:
        of_strips = _strips(draft, f"image/{name}", parts, {**reads, "white": f"white_first/{camera}/"}, noise)
        whites = {f"white{strip}": f"white_strip/{camera}/{strip:04d}" for strip in range(len(parts))}
        params = things.IMAGE(exposure=exposure, tiles=len(parts), view=None, noise=noise)
        return draft.add(f"image/{name}", params, {**of_camera, **whites, **of_strips})
    # The rays that leave the camera are the same in every frame: frames share them.
    together = f"image/{camera}"
    tiles = draft.add_tiles(f"image_tile/{name}", parts, {**reads, "white": f"white_tile/{camera}/"}, together)
    if tiles:
        joined = things.IMAGE(exposure=exposure, tiles=len(tiles), view=None)
        return draft.add(f"image/{name}", joined, {**of_camera, **tiles})
    alone = things.IMAGE(exposure=exposure, view=view, shutter=shutter)
    return draft.add(f"image/{name}", alone, {**reads, "white": f"white/{camera}"}, together)


def _strips(
    draft: Draft, name: str, parts: Sequence[White | Image], reads: dict[str, str], noise: float
) -> dict[str, str]:
    """Add the tasks of an image that is sampled to a stated noise; role and name of what the image reads of them.

    First passes over all `parts` give the mean of the image, to which the stated noise is relative; then each strip
    takes as many passes as it needs.
    """
    kind, _, subject = name.partition("/")
    first = draft.add_tiles(f"{kind}_first/{subject}", parts, reads, least=1)
    firsts = {f"{FIRST}{number}": task for number, task in enumerate(first.values())}
    inputs = {**reads, **firsts, OWN: f"{kind}_first/{subject}/"}
    passes = 1 + max(0, (MOST_SAMPLES // parts[0].exposure.samples).bit_length() - 1)
    limited = [replace(part, noise=noise, passes=passes) for part in parts]
    return {**draft.add_tiles(f"{kind}_strip/{subject}", limited, inputs, least=1), **firsts}
