"""Tasks `labels_tile` and `labels`: labels of the pixels of a camera in a frame."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import Json, write_json
from pipeline.files.npy import StackedRows, write_npy
from pipeline.files.png import write_png
from pipeline.motion import Shutter
from pipeline.plugins.scenes.labels.cryptomatte import attributes_of, id_of
from pipeline.plugins.scenes.labels.pixels import PREVIEWED, Requested, labels_of, preview
from pipeline.plugins.scenes.labels.sight_lines import SightLines
from pipeline.plugins.scenes.labels.things import LabelledScene, Later
from pipeline.plugins.scenes.tasks.images import lit_at, lit_view
from pipeline.plugins.scenes.tasks.params import BOXES, LABELS, PREVIEW, Labels, LabelsTile
from pipeline.products.cameras import Inputs, imaged_rig
from pipeline.products.images import files as image_files
from pipeline.products.surroundings import placed_occluder, placed_target
from pipeline.render.pixel_rays import Band, Rows

_ROWS = "rows.npy"
_AT_ONCE = 512
"""Rows of which all channels are in memory."""
_HALF = 0.5
"""Least share of a target in the light of a pixel of its box [1]."""


def labels_tile(params: Sequence[LabelsTile], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The same rows of the labels of frames, which share their rays, for the task `labels`."""
    exposure = params[0].exposure
    rig = imaged_rig(inputs, exposure)
    lines = next_lines = SightLines(rig)
    if "next" in inputs:
        next_lines = SightLines(imaged_rig({"camera": inputs["next"]}, exposure))

    def labelled(params_of_scenes: Sequence[LabelsTile], rows: Rows, columns: Rows | None = None) -> list[np.ndarray]:
        """Labels of a band of pixels in several scenes, which share its rays."""
        band = Band.of(rig, rows, columns)
        scenes = [_scene(scene, inputs) for scene in params_of_scenes]
        return labels_of(band, exposure.samples, scenes, (lines, next_lines))

    still = [tile for tile in params if tile.shutter is None]
    labels_of_still = iter(labelled(still, params[0].rows) if still else ())
    size_px = rig.tracer.camera.sensor.size_px
    for tile, out in zip(params, outs, strict=True):
        labels = _line_by_line(tile, tile.shutter, size_px, labelled) if tile.shutter else next(labels_of_still)
        write_npy(out / _ROWS, labels)


def _line_by_line(
    params: LabelsTile,
    shutter: Shutter,
    size_px: tuple[int, int],
    labelled: Callable[[Sequence[LabelsTile], Rows, Rows], list[np.ndarray]],
) -> np.ndarray:
    """Labels of rows before a shutter: those of each line in the middle of its exposure."""
    parts = []
    for opens_s, rows, columns in shutter.lines(params.rows, size_px):
        time_s = opens_s + shutter.exposure_s / 2
        pose = params.world_from_vision
        if params.camera_motion:
            pose = params.camera_motion.at(np.array([time_s]))[0].tolist()
        exposed = replace(params, view=lit_at(params.view, time_s), world_from_vision=pose)
        parts += labelled([exposed], rows, columns)
    return np.concatenate(parts, axis=1 - shutter.axis)


def _scene(params: LabelsTile, inputs: Inputs) -> tuple[LabelledScene, Requested]:
    """The scene of a tile, with the next frame if flow is among its labels, and the labels that are requested."""
    channels = params.channels
    later = None
    if (next_frame := params.later) is not None:
        poses = [np.array(target.vision_from_target) for target in next_frame.targets]
        occluders = [None if occluder is None else placed_occluder(occluder) for occluder in next_frame.occluders]
        motions = [None if thing is None else thing.motion for thing in (*next_frame.targets, *next_frame.occluders)]
        later = Later(poses, occluders, next_frame.shutter, motions)
    targets = list(map(placed_target, params.view.targets))
    lit = lit_view(params.view, inputs).in_light(0) if params.view.lighting else None
    world_from_vision = np.eye(4) if params.world_from_vision is None else np.array(params.world_from_vision)
    ids = {matte: np.array([id_of(name) for name in names], np.float32) for matte, names in channels.mattes.items()}
    scene = LabelledScene(targets, list(map(placed_occluder, params.view.occluders)), later, lit)
    return scene, Requested(channels.tokens, channels.targets, ids, world_from_vision)


def labels(params: Labels, inputs: Inputs, out: Path) -> None:
    """The labels of a frame: labels.exr, labels.png and, with shares of targets, boxes.json."""
    request = params.channels
    stacked = StackedRows([inputs[f"tile{number}"][_ROWS] for number in range(params.tiles)])
    names = Requested(request.tokens, request.targets, dict.fromkeys(request.mattes, np.zeros(0))).channels

    def channels_of(channels: Sequence[str]) -> dict[str, np.ndarray]:
        """Whole channels by name, of those that the labels have."""
        columns = [(name, names.index(name)) for name in channels if name in names]
        bands = [stacked.rows(first, min(first + _AT_ONCE, height)) for first in range(0, height, _AT_ONCE)]
        return {name: np.concatenate([band[..., column] for band in bands]) for name, column in columns}

    attributes = {
        "content": "what pixels see, by their light: docs/labels.md",
        **image_files.labels_of(params.exposure),
    }
    for matte, things in request.mattes.items():
        attributes |= attributes_of(matte, list(things))
    height, width, _ = stacked.shape
    shape, rows = (height, width), stacked.rows
    part = BandedPart(name="labels", shape=shape, channels=tuple(names), rows=rows, attributes=attributes)
    write_bands(out / LABELS, [part])
    write_png(out / PREVIEW, preview(channels_of(PREVIEWED)))
    if request.targets:
        boxes = {name: _box(channels_of([f"targets.{name}"])[f"targets.{name}"]) for name in request.targets}
        write_json(out / BOXES, {"box_px": "left, top, right, bottom", "targets": boxes})


def _box(share: np.ndarray) -> Json:
    """The box of a target, image positions of its edges, and its area, the sum of its shares."""
    y, x = np.nonzero(share >= _HALF)
    box = [x.min() - 0.5, y.min() - 0.5, x.max() + 0.5, y.max() + 0.5] if len(x) else None
    return {"box_px": box, "area_px2": float(np.nansum(share, dtype=float))}
