"""Observations in a dataset: the camera and its state, the board and the microlens that each is of, and what tells that
they are of others.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.channel_names import without_state
from pipeline.plugins.fits.observations import Observations, numbered
from pipeline.plugins.fits.predicted_rows import chief_px, entries_of, points_of, rig_of
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


def placed(found: Observations, dataset: Dataset) -> Observations:
    """Observations of a file with cameras, targets and microlenses that a dataset has.

    UsageError: it has no such camera, target, frame, point or microlens, the board is another one, or something moves
    while a shutter is open.
    """
    entries, points = entries_of(dataset), np.flatnonzero(~found.is_centre)
    bodies, boards = dict.fromkeys(map(without_state, entries)), [entry.name for entry in dataset.targets]
    named = _named("camera", found, np.arange(len(found)), [*bodies], [*bodies, *entries])
    target = np.full(len(found), "", object)
    target[points] = _named("target", found, points, boards, boards)
    if len(wrong := points[~np.isin(found.frame[points], [frame.number for frame in dataset.frames])]):
        hint = "give it a time code for each image: endTimeCode, or plen:frames"
        raise found.error_at(wrong[0], f"the dataset has no frame {found.frame[wrong[0]]}", hint)
    image = numbered(named, found.frame, found.is_centre)
    _, firsts = np.unique(image, return_index=True)
    camera = np.array([_in_state(found, row, str(named[row]), dataset, entries) for row in firsts])[image]
    found = replace(found, camera=camera, target=target.astype(str))
    for name in np.unique(found.target[points]).tolist():
        ids, count = found.point_id, len(points_of(dataset)[name].position_mm)
        if len(wrong := np.flatnonzero((found.target == name) & ((ids < 0) | (ids >= count)))):
            hint = f"its points are 0 to {count - 1}, row by row from the top left"
            raise found.error_at(wrong[0], f"{name} has no point {ids[wrong[0]]}", hint)
    _require_board(found, dataset)
    _require_stills(found, dataset, entries)
    return _behind_microlenses(found, dataset, entries)


def _named(kind: str, found: Observations, rows: np.ndarray, known: list[str], allowed: list[str]) -> np.ndarray:
    """Names of cameras or targets of rows, of those that are allowed; the only known one where the file has none."""
    names = getattr(found, kind)[rows]
    if len(open_ := np.flatnonzero(names == "")) and len(known) > 1:
        message = f"the dataset has {len(known)} {kind}s, and the file names none"
        raise found.error_at(rows[open_[0]], message, ", ".join(known))
    names = np.where(names == "", known[0], names)
    if len(wrong := np.flatnonzero(~np.isin(names, allowed))):
        name = str(names[wrong[0]])
        hint = did_you_mean(name, known) or ", ".join(known)
        raise found.error_at(rows[wrong[0]], f"the dataset has no {kind} {name!r}", hint)
    return names


def _in_state(found: Observations, row: int, name: str, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> str:
    """Full name of the camera of a name, in the state that it has in the frame of a row; of a name with its state this
    one alone.
    """
    states = [entry for full_name, entry in entries.items() if name in (full_name, without_state(full_name))]
    if not found.is_centre[row]:
        frame = int(found.frame[row])
        states = [entry for entry in states if frame in {each.number for each in dataset.frames_of(entry)}]
        if not states:
            hint = f"say {without_state(name)}: the frame says its state"
            raise found.error_at(row, f"{name} is in another state of lens and sensor in frame {frame}", hint)
    if len(states) > 1:
        message = f"lens or sensor of {name} change from frame to frame: which centres are these?"
        raise found.error_at(row, message, ", ".join(entry.full_name for entry in states))
    return states[0].full_name


def _require_board(found: Observations, dataset: Dataset) -> None:
    """UsageError: the points of a file are not as far from each other as those of their targets are."""
    if found.board_mm is None:
        return
    for name in np.unique(found.target).tolist():
        rows = np.flatnonzero(found.target == name)
        ids, first, number = np.unique(found.point_id[rows], return_index=True, return_inverse=True)
        file_mm, stage_mm = found.board_mm[rows[first]], points_of(dataset)[name].position_mm[ids]
        if len(other := rows[(found.board_mm[rows] != file_mm[number]).any(axis=1)]):
            where = found.name(other[0])
            raise found.error_at(other[0], f"{where} is elsewhere on its board than before", "give each board a file")
        theirs, ours = (np.linalg.norm(points[:, None] - points[None], axis=2) for points in (file_mm, stage_mm))
        if np.abs(theirs - ours).max() > _SAME_SIZE * ours.max():
            least = tuple(float(np.min(each[each > 0], initial=np.inf)) for each in (theirs, ours))
            message = f"its board has points {least[0]:.6g} mm apart, that of the stage {least[1]:.6g} mm"
            hint = "mend plen:squareSize, or the order of ids: row by row, from the top left"
            raise found.error_at(rows[0], message, hint)


def _require_stills(found: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> None:
    """UsageError: a camera or a board moves while the shutter is open, which a fit takes for still."""
    motions = {frame.number: frame.motions for frame in dataset.frames}
    _, firsts = np.unique(numbered(found.camera, found.frame, found.target), return_index=True)
    for row in firsts:
        name, frame, target = (str(column[row]) for column in (found.camera, found.frame, found.target))
        moving = motions.get(int(frame), {}).get(entries[name].name)
        if moving is not None and (moving.camera is not None or target in moving.targets):
            message = f"{target} moves before {name} while its shutter is open in frame {frame}"
            hint = "a fit takes boards for still: hold its pose until the shutter closes, or leave out the shutter"
            raise found.error_at(row, message, hint)


def _behind_microlenses(found: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> Observations:
    """Observations with the microlens of each: the one that is named, or that in whose micro-image the position is."""
    microlens = np.zeros((len(found), 2), np.int64) if found.microlens is None else found.microlens.copy()
    for name in np.unique(found.camera).tolist():
        rows = np.flatnonzero(found.camera == name)
        centres = rows[found.is_centre[rows]]
        rig = rig_of(dataset, entries[name])
        if len(outside := rows[~rig.in_image(found.x_px[rows])]):
            x, y = found.x_px[outside[0]].tolist()
            width, height = entries[name].camera.sensor.size_px
            message = f"({x:g}, {y:g}) px lies outside of the image of {name}, {width} x {height} px"
            hint = "are x_px and y_px in their columns, and is the sensor of the stage that of the images?"
            raise found.error_at(outside[0], message, hint)
        if (lattice := rig.tracer.lattice) is None:
            if len(centres):
                raise found.error_at(centres[0], f"{name} has no microlenses, so no centres of micro-images")
            continue
        if found.microlens is None:
            microlens[rows] = rig.axial[rig.microlens_at(rig.tracer.positions_mm(*found.x_px[rows].T))]
        elif len(wrong := rows[lattice.rows(microlens[rows, 0], microlens[rows, 1], -1) < 0]):
            message = f"the array of {name} has no microlens {tuple(microlens[wrong[0]].tolist())}"
            raise found.error_at(wrong[0], message)
        if len(centres):
            _require_numbering(rig, found, centres, microlens[centres])
    return replace(found, microlens=microlens)


def _require_numbering(rig: Rig, found: Observations, centres: np.ndarray, microlens: np.ndarray) -> None:
    """UsageError: observed centres are those of other microlenses than they say."""
    array, name = rig.tracer.camera.microlenses, found.camera[centres[0]]
    assert array is not None
    pitch_px, there = array.pitch_mm / rig.tracer.camera.sensor.pitch_mm, chief_px(rig, microlens)
    off = found.x_px[centres] - there
    terms = np.column_stack([np.ones(len(off)), there - there.mean(axis=0)])
    map_ = np.zeros((3, 2))
    if len(off) >= _FEWEST:
        map_ = np.linalg.lstsq(terms, off, rcond=None)[0]
    far = np.hypot(*(off - terms @ map_).T)
    worst, message = int(far.argmax()), ""
    if np.abs(map_[1:]).max() > _TURNED:
        message = f"micro-images of {name} are numbered otherwise: mirrored, turned or transposed"
    elif np.hypot(*map_[0]) > _HALF * pitch_px:
        x, y = map_[0].tolist()
        message = f"all centres of {name} are ({x:+.1f}, {y:+.1f}) px off: their numbers begin at another microlens"
    elif far[worst] > _HALF * pitch_px:
        k, l = microlens[worst].tolist()
        message = f"the centre of micro-image ({k}, {l}) of {name} is {far[worst]:.1f} px from where others put it"
    if message:
        hint = "CONVENTIONS.md, Microlens lattice: (0, 0) is in the middle, k and l are axial indices; correct the file"
        raise found.error_at(centres[worst], message, hint)
