"""Observations in a dataset: the camera and its state, the board and the microlens that each is of, and what tells that
they are of others.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.channel_names import without_state
from pipeline.errors import UsageError
from pipeline.plugins.fits.observations import Observations
from pipeline.plugins.fits.predicted_rows import chief_px, points_of, rig_of
from pipeline.records.shapes import Float64, Int64
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.spelling import did_you_mean

_SAME_SIZE = 1e-4
"""Difference of distances on a board above which it is another one, over the largest distance [1]."""
_FEWEST = 6
"""Fewest centres that tell a numbering: an affine map of the image has six numbers."""
_TURNED = 0.1
"""Part by which an array is scaled or turned above which it is numbered otherwise [1]: six degrees."""
_HALF = 0.5
"""Distance from its own centre at which another one is as near [MLA pitch]."""


def placed(observations: Observations, dataset: Dataset) -> Observations:
    """Observations with cameras, targets and microlenses that a dataset has.

    UsageError: it has no such camera, target, frame, point or microlens, or something moves while a shutter is open.
    """
    entries = {entry.full_name: entry for camera in dataset.cameras for entry in camera.in_channels}
    is_point = ~observations.is_centre
    names = tuple(dict.fromkeys(map(without_state, entries)))
    named = _named("camera", observations.camera, names, (*names, *entries))
    target = observations.target.astype(object)
    names = tuple(entry.name for entry in dataset.targets)
    target[is_point] = _named("target", target[is_point], names, names)
    numbers = {frame.number for frame in dataset.frames}
    if missing := sorted(set(observations.frame[is_point].tolist()) - numbers):
        hint = "give it a time code for each image: endTimeCode, or plen:frames"
        raise UsageError(f"the dataset has no frame {missing[0]}", hint=hint)
    camera = named.astype(object)
    for name, frame, is_centre in {
        *zip(named.tolist(), observations.frame.tolist(), (~is_point).tolist(), strict=True)
    }:
        rows = (named == name) & (observations.frame == frame) & (is_point != is_centre)
        camera[rows] = _in_state(dataset, entries, name, None if is_centre else frame).full_name
    for name in np.unique(target[is_point].astype(str)).tolist():
        ids, count = observations.point_id[target == name], len(points_of(dataset)[name].position_mm)
        if ids.min() < 0 or ids.max() >= count:
            wrong = int(ids.min() if ids.min() < 0 else ids.max())
            raise UsageError(f"{name} has no point {wrong}", hint=f"its points are 0 to {count - 1}")
    found = replace(observations, camera=camera.astype(str), target=target.astype(str))
    _require_stills(found, dataset, entries)
    return _behind_microlenses(found, dataset, entries)


def _in_state(dataset: Dataset, entries: Mapping[str, CameraEntry], name: str, frame: int | None) -> CameraEntry:
    """The camera of a name, in the state that it has in a frame; of a name with its state this one alone."""
    states = [entry for full_name, entry in entries.items() if name in (full_name, without_state(full_name))]
    if frame is not None:
        states = [entry for entry in states if frame in {each.number for each in dataset.frames_of(entry)}]
        if not states:
            raise UsageError(
                f"{name} is in another state of lens and sensor in frame {frame}", hint=without_state(name)
            )
    if len(states) > 1:
        named = ", ".join(entry.full_name for entry in states)
        raise UsageError(f"lens or sensor of {name} change from frame to frame: which centres are these?", hint=named)
    return states[0]


def _require_stills(found: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> None:
    """UsageError: a camera or a board moves while the shutter is open, which a fit takes for still."""
    motions = {frame.number: frame.motions for frame in dataset.frames}
    for name, frame, target in {*zip(found.camera.tolist(), found.frame.tolist(), found.target.tolist(), strict=True)}:
        moving = motions.get(frame, {}).get(entries[name].name)
        if moving is not None and (moving.camera is not None or target in moving.targets):
            what = f"{target} moves before {name} while its shutter is open in frame {frame}"
            hint = "a fit takes boards for still: hold its pose until the shutter closes, or leave out the shutter"
            raise UsageError(what, hint=hint)


def _named(kind: str, given: np.ndarray, known: tuple[str, ...], allowed: tuple[str, ...]) -> np.ndarray:
    """Names of cameras or targets, of those that are allowed, and the only known one where the file names none."""
    if (given == "").any() and len(known) > 1:
        raise UsageError(f"the dataset has {len(known)} {kind}s, and the file names none", hint=", ".join(known))
    names = np.where(given == "", known[0], given)
    for name in sorted(set(names.tolist()) - {*allowed}):
        raise UsageError(f"the dataset has no {kind} {name!r}", hint=did_you_mean(name, known) or ", ".join(known))
    return names


def _behind_microlenses(found: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> Observations:
    """Observations with the microlens of each: the one that is named, or that in whose micro-image the position is."""
    microlens = np.zeros((len(found), 2), np.int64) if found.microlens is None else found.microlens.copy()
    for name in np.unique(found.camera).tolist():
        rows = np.flatnonzero(found.camera == name)
        centres = rows[found.is_centre[rows]]
        rig = rig_of(dataset, entries[name])
        outside = rows[~rig.in_image(found.x_px[rows])]
        if len(outside):
            x, y = found.x_px[outside[0]].tolist()
            width, height = entries[name].camera.sensor.size_px
            raise UsageError(f"({x:g}, {y:g}) px lies outside of the image of {name}, {width} x {height} px")
        if (lattice := rig.tracer.lattice) is None:
            if len(centres):
                raise UsageError(f"{name} has no microlenses, so no centres of micro-images")
            continue
        if found.microlens is None:
            microlens[rows] = rig.axial[rig.microlens_at(rig.tracer.positions_mm(*found.x_px[rows].T))]
        elif len(unknown := rows[lattice.rows(microlens[rows, 0], microlens[rows, 1], -1) < 0]):
            raise UsageError(f"the array of {name} has no microlens {tuple(microlens[unknown[0]].tolist())}")
        if len(centres):
            _require_numbering(rig, microlens[centres], found.x_px[centres], name)
    return replace(found, microlens=microlens)


def _require_numbering(
    rig: Rig, microlens: Int64[np.ndarray, "n 2"], x_px: Float64[np.ndarray, "n 2"], name: str
) -> None:
    """UsageError: observed centres are those of other microlenses of the camera `name` than they say."""
    array = rig.tracer.camera.microlenses
    assert array is not None
    pitch_px, there = array.pitch_mm / rig.tracer.camera.sensor.pitch_mm, chief_px(rig, microlens)
    off = x_px - there
    terms = np.column_stack([np.ones(len(off)), there - there.mean(axis=0)])
    map_ = np.zeros((3, 2))
    if len(off) >= _FEWEST:
        map_ = np.linalg.lstsq(terms, off, rcond=None)[0]
    hint = "CONVENTIONS.md, Microlens lattice: (0, 0) is in the middle, k and l are axial indices; correct the file"
    if np.abs(map_[1:]).max() > _TURNED:
        raise UsageError(f"micro-images of {name} are numbered otherwise: mirrored, turned or transposed", hint=hint)
    if np.hypot(*map_[0]) > _HALF * pitch_px:
        x, y = map_[0].tolist()
        what = f"all centres of {name} are ({x:+.1f}, {y:+.1f}) px off: their numbers begin at another microlens"
        raise UsageError(what, hint=hint)
    far = np.hypot(*(off - terms @ map_).T)
    if (worst := far.argmax()) >= 0 and far[worst] > _HALF * pitch_px:
        k, l = microlens[worst].tolist()
        what = f"the centre of micro-image ({k}, {l}) of {name} is {far[worst]:.1f} px from where others say that it is"
        raise UsageError(what, hint=hint)


def require_board(found: Observations, dataset: Dataset, path: Path) -> None:
    """UsageError: the points of a file are not as far from each other as those of its target are."""
    if found.board_mm is None:
        return
    points_mm = points_of(dataset)[str(found.target[0])].position_mm
    ids = np.flatnonzero(np.isfinite(found.board_mm[: len(points_mm), 0]))
    theirs, ours = (
        np.linalg.norm(points[ids, None] - points[None, ids], axis=2) for points in (found.board_mm, points_mm)
    )
    if np.abs(theirs - ours).max() > _SAME_SIZE * ours.max():
        least = tuple(float(np.min(each[each > 0], initial=np.inf)) for each in (theirs, ours))
        what = f"the board of {path} has points {least[0]:.6g} mm apart, that of the stage {least[1]:.6g} mm"
        raise UsageError(what, hint="mend plen:squareSize, or the order of ids: row by row, from the top left")
