"""Tasks `labels` and `labels_tile`: what each pixel of a camera sees in a frame."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pipeline.files.cryptomatte import attributes_of, id_of
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import write_json
from pipeline.files.npy import StackedRows, write_npy
from pipeline.files.png import write_png
from pipeline.render.labels.pixels import Asked
from pipeline.render.labels.pixels import labels as labelled
from pipeline.render.labels.preview import preview
from pipeline.render.labels.things import Later, Things
from pipeline.render.pixel_rays import Band
from pipeline.tasks.artefacts.cameras import Inputs, imaged_rig
from pipeline.tasks.artefacts.surroundings import placed_occluder, placed_target
from pipeline.tasks.images import labels_of
from pipeline.tasks.params.labels import BOXES, LABELS, PREVIEW, Labels

_ROWS = "rows.npy"
_HALF = 0.5
"""Least share of a target in the light of a pixel of its box [1]."""


def labels_tile(params: Labels, inputs: Inputs, out: Path) -> None:
    """Some rows of the labels, for the task `labels`."""
    labels_tile_together([params], inputs, [out])


def labels_tile_together(params: Sequence[Labels], inputs: Inputs, outs: Sequence[Path]) -> None:
    """The same rows of several frames, which share their rays."""
    band = Band.of(imaged_rig(inputs, params[0].exposure), params[0].rows)
    scenes = [(_things_of(each), _asked_of(each)) for each in params]
    for rows, out in zip(labelled(band, params[0].exposure.samples, scenes), outs, strict=True):
        write_npy(out / _ROWS, rows)


def labels(params: Labels, inputs: Inputs, out: Path) -> None:
    """The labels of a frame: labels.exr, labels.png and, with shares of targets, boxes.json."""
    labels_together([params], inputs, [out])


def labels_together(params: Sequence[Labels], inputs: Inputs, outs: Sequence[Path]) -> None:
    """Labels of several frames, which share their rays if they are not joined from tiles."""
    if not params[0].tiles:
        labels_tile_together(params, inputs, outs)
    for each, out in zip(params, outs, strict=True):
        paths = [inputs[f"tile{number}"][_ROWS] for number in range(each.tiles)] or [out / _ROWS]
        _write(each, StackedRows(paths), out)
        if not each.tiles:
            paths[0].unlink()


def _things_of(params: Labels) -> Things:
    assert params.view is not None  # tiles, and labels without them, have one
    later = None
    if params.later is not None:
        occluders = [None if then is None else placed_occluder(then) for then in params.later.occluders]
        later = Later([np.array(pose) for pose in params.later.targets], occluders)
    targets, others = map(placed_target, params.view.targets), map(placed_occluder, params.view.occluders)
    return Things(list(targets), list(others), later)


def _asked_of(params: Labels) -> Asked:
    ids = {matte: np.array([id_of(name) for name in names], np.float32) for matte, names in params.names.mattes.items()}
    world_from_vision = np.eye(4) if params.world_from_vision is None else np.array(params.world_from_vision)
    return Asked(params.tokens, world_from_vision, params.names.targets, ids)


def _write(params: Labels, stacked: StackedRows, out: Path) -> None:
    channels = _asked_of(params).channels

    def rows(first: int, end: int) -> dict[str, np.ndarray]:
        return dict(zip(channels, np.moveaxis(stacked.rows(first, end), 2, 0), strict=True))

    attributes: dict[str, str | float | int] = {
        "content": "labels of pixels by the light that they receive; mm, frame of the world, px",
        **labels_of(params.exposure),
    }
    for matte, names in params.names.mattes.items():
        attributes |= attributes_of(matte, list(names))
    height, width, _ = stacked.shape
    part = BandedPart(name="labels", shape=(height, width), channels=tuple(channels), rows=rows, attributes=attributes)
    write_bands(out / LABELS, [part])
    write_png(out / PREVIEW, preview(rows(0, height)))
    if "targets" in params.tokens:
        boxes = {name: _box(rows, f"targets.{name}", height) for name in params.names.targets}
        write_json(out / BOXES, {"box_px": "left, top, right, bottom", "targets": boxes})


def _box(rows: Callable[[int, int], dict[str, np.ndarray]], channel: str, height: int) -> dict[str, object]:
    """The box of a target, image positions of its edges, and its area, the sum of its shares."""
    share = rows(0, height)[channel]
    y, x = np.nonzero(share >= _HALF)
    box = [float(x.min()) - 0.5, float(y.min()) - 0.5, x.max() + 0.5, y.max() + 0.5] if len(x) else None
    return {"box_px": box, "area_px2": float(np.nansum(share, dtype=float))}
