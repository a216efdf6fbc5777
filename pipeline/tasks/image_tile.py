"""Task `image_tile`: some rows of an image, for the task `image`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.files.npy import read_npy, write_npy
from pipeline.render.glow.inks import GlowingView
from pipeline.render.glow.light import TargetLight
from pipeline.render.in_lights import pictures_in_lights
from pipeline.render.lighting.lit_scene import LitView
from pipeline.tasks.artefacts.cameras import Inputs, imaged_rig
from pipeline.tasks.artefacts.surroundings import placed_occluder, placed_target
from pipeline.tasks.params.images import Exposure
from pipeline.tasks.params.images import ImageTile as Params
from pipeline.tasks.params.placed import PICTURE, PaintedView
from pipeline.tasks.white_tile import FOREIGN, WHITE

PIXELS = "pixels.npy"


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write pixels.npy."""
    run_together([params], inputs, [out])


def run_together(params: Sequence[Params], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The same rows of several frames, which share their rays."""
    views = [one.view for one in params]
    for pixels, out in zip(image_rows(params[0].exposure, views, inputs, params[0].rows), outs, strict=True):
        write_npy(out / PIXELS, pixels)


def image_rows(
    exposure: Exposure, views: Sequence[PaintedView], inputs: Inputs, rows: tuple[int, int] | None = None
) -> np.ndarray:
    """Rows from the first to an end, by default all, of the images of several views, (views, h, w) float64."""
    rig = imaged_rig(inputs, exposure)
    white = np.array([read_npy(inputs["white"][name]) for name in (WHITE, FOREIGN)])
    scenes = [scene_of(view, inputs) for view in views]
    return pictures_in_lights(rig, exposure.samples, scenes, white, rows)


def scene_of(view: PaintedView, inputs: Inputs) -> TargetLight | GlowingView | LitView:
    """The view as the rooms of light take it."""
    targets, occluders = list(map(placed_target, view.targets)), list(map(placed_occluder, view.occluders))
    if view.lighting is None:
        if not any(view.colours):
            return TargetLight(targets, view.background, occluders)
        return GlowingView(targets, view.background, occluders, view.colours)
    pictures = {role: read_npy(files[PICTURE]) for role, files in inputs.items() if PICTURE in files}
    return LitView(targets, occluders, view.lighting, pictures, view.background, view.lights, view.colours)
