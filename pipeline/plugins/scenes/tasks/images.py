"""Tasks of lit images: those of the core, with a lit scene before the camera."""

import pickle
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from pipeline.files.npy import read_npy
from pipeline.plugins.scenes.lighting.lit_scene import LitView
from pipeline.plugins.scenes.tasks.params import PICTURE, LitImage, LitPaintedView
from pipeline.products.cameras import Inputs
from pipeline.products.images import make as images
from pipeline.products.surroundings import placed_occluder, placed_target, view_at
from pipeline.products.views import PaintedView
from pipeline.render.imaging import SceneView

_LAST: dict[bytes, LitView] = {}
"""The last lit view of this process, by what its triangles depend on: tasks of channels and of tiles share them."""


def image_tile(params: Sequence[LitImage], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The same rows of the images of frames: pixels.npy."""
    images.image_tile(params, inputs, outs, scenes_at)


def image_first(params: LitImage, inputs: Inputs, out: Path) -> None:
    """The first pass over some rows of an image."""
    images.image_first(params, inputs, out, scenes_at)


def image_strip(params: LitImage, inputs: Inputs, out: Path) -> None:
    """All passes over some rows of an image that they need."""
    images.image_strip(params, inputs, out, scenes_at)


def image(params: Sequence[LitImage], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The image of a camera in a frame: image.exr and image.png."""
    images.image(params, inputs, outs, scenes_at)


def scenes_at(view: PaintedView | None, times_s: list[float], inputs: Inputs) -> list[SceneView]:
    """A lit view at instants after the time code of its frame."""
    assert isinstance(view, LitPaintedView)  # as `LitImage` says; images of tiles and strips have none
    return [lit_view(lit_at(view, time_s), inputs) for time_s in times_s]


def lit_at(view: LitPaintedView, time_s: float) -> LitPaintedView:
    """The view at a time after the time code of its frame, without motions."""
    still = view_at(view, time_s)
    if still.lighting is None:
        return still
    lamps = tuple(
        lamp
        if lamp.motion is None
        else replace(lamp, vision_from_lamp=lamp.motion.at(np.array([time_s]))[0].tolist(), motion=None)
        for lamp in still.lighting.lamps
    )
    return replace(still, lighting=replace(still.lighting, lamps=lamps))


def lit_view(view: LitPaintedView, inputs: Inputs) -> LitView:
    """The view as the path tracer takes it; it has a lighting."""
    assert view.lighting is not None  # only labels have a view without
    files_of = {role: files[PICTURE] for role, files in inputs.items() if PICTURE in files}
    key = sha256(pickle.dumps((view.targets, view.occluders, view.lighting, files_of))).digest()
    if (last := _LAST.get(key)) is None:
        targets = list(map(placed_target, view.targets))
        occluders = list(map(placed_occluder, view.occluders))
        pictures = {role: read_npy(file) for role, file in files_of.items()}
        _LAST.clear()
        _LAST[key] = last = LitView(targets, occluders, view.lighting, pictures, 0.0, ())
    return replace(last, background=view.background, lights=view.lights, colours=view.colours, like=last)
