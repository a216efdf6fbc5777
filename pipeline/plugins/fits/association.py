"""Association of observations with a dataset: the camera and its state, the board and the microlens that each is of,
and what tells that they are of others.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.channel_names import without_state
from pipeline.plugins.fits.observations import Observations, group_numbers
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


def associated(observations: Observations, dataset: Dataset) -> Observations:
    """Observations of a file with cameras, targets and microlenses that a dataset has.

    UsageError: it has no such camera, target, frame, point or microlens, the board is another one, or something moves
    while a shutter is open.
    """
    entries, points = entries_of(dataset), np.flatnonzero(~observations.is_centre)
    bodies, boards = dict.fromkeys(map(without_state, entries)), [entry.name for entry in dataset.targets]
    body = _names_of("camera", observations, np.arange(len(observations)), [*bodies], [*bodies, *entries])
    target = np.full(len(observations), "", object)
    target[points] = _names_of("target", observations, points, boards, boards)
    frames = [frame.number for frame in dataset.frames]
    if len(wrong := points[~np.isin(observations.frame[points], frames)]):
        hint = "give it a time code for each image: endTimeCode, or plen:frames"
        raise observations.error_at(wrong[0], f"the dataset has no frame {observations.frame[wrong[0]]}", hint)
    image = group_numbers(body, observations.frame, observations.is_centre)
    _, first_rows = np.unique(image, return_index=True)
    states = [_in_state(observations, row, str(body[row]), dataset, entries) for row in first_rows]
    observations = replace(observations, camera=np.array(states)[image], target=target.astype(str))
    _require_points(observations, dataset)
    _require_board(observations, dataset)
    _require_stills(observations, dataset, entries)
    return _behind_microlenses(observations, dataset, entries)


def _names_of(
    kind: str, observations: Observations, rows: np.ndarray, stated: list[str], allowed: list[str]
) -> np.ndarray:
    """Names of cameras or targets of rows, of those that are allowed; where the file has none, the only one that the
    dataset states.
    """
    names = getattr(observations, kind)[rows]
    if len(nameless := np.flatnonzero(names == "")) and len(stated) > 1:
        message = f"the dataset has {len(stated)} {kind}s, and the file names none"
        raise observations.error_at(rows[nameless[0]], message, ", ".join(stated))
    names = np.where(names == "", stated[0], names)
    if len(wrong := np.flatnonzero(~np.isin(names, allowed))):
        name = str(names[wrong[0]])
        hint = did_you_mean(name, stated) or ", ".join(stated)
        raise observations.error_at(rows[wrong[0]], f"the dataset has no {kind} {name!r}", hint)
    return names


def _in_state(
    observations: Observations, row: int, name: str, dataset: Dataset, entries: Mapping[str, CameraEntry]
) -> str:
    """Full name of the camera of a name, in the state that it has in the frame of a row; of a name with its state this
    one alone.
    """
    states = [entry for full_name, entry in entries.items() if name in (full_name, without_state(full_name))]
    if not observations.is_centre[row]:
        frame = int(observations.frame[row])
        states = [entry for entry in states if frame in {state.number for state in dataset.frames_of(entry)}]
        if not states:
            hint = f"say {without_state(name)}: the frame says its state"
            raise observations.error_at(row, f"{name} is in another state of lens and sensor in frame {frame}", hint)
    if len(states) > 1:
        message = f"lens or sensor of {name} change from frame to frame: which centres are these?"
        raise observations.error_at(row, message, ", ".join(entry.full_name for entry in states))
    return states[0].full_name


def _require_points(observations: Observations, dataset: Dataset) -> None:
    """UsageError: a target has no such point."""
    for name, points in points_of(dataset).items():
        ids, count = observations.point_id, len(points.position_mm)
        if len(wrong := np.flatnonzero((observations.target == name) & ((ids < 0) | (ids >= count)))):
            hint = f"its points are 0 to {count - 1}, row by row from the top left"
            raise observations.error_at(wrong[0], f"{name} has no point {ids[wrong[0]]}", hint)


def _require_board(observations: Observations, dataset: Dataset) -> None:
    """UsageError: the points of a file are not as far from each other as those of their targets are."""
    if observations.board_mm is None:
        return
    for name in np.unique(observations.target).tolist():
        rows = np.flatnonzero(observations.target == name)
        ids = observations.point_id[rows]
        first_ids, first_rows = np.unique(ids, return_index=True)
        apart_mm, stage_apart_mm = (
            np.linalg.norm(points_mm[:, None] - points_mm[first_rows], axis=2)
            for points_mm in (observations.board_mm[rows], points_of(dataset)[name].position_mm[ids])
        )
        is_wrong = np.abs(apart_mm - stage_apart_mm) > _SAME_SIZE * stage_apart_mm.max()
        for row, other in np.argwhere(is_wrong)[:1]:
            file_mm, stage_mm = apart_mm[row, other], stage_apart_mm[row, other]
            message = f"its board has points {file_mm:.6g} mm apart, that of the stage {stage_mm:.6g} mm"
            hint = f"they are {first_ids[other]} and {ids[row]}: mend plen:squareSize, or the order of ids, row by row"
            raise observations.error_at(rows[row], message, f"{hint} from the top left; give each board a file")


def _require_stills(observations: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]) -> None:
    """UsageError: a camera or a board moves while the shutter is open, which a fit takes for still."""
    motions = {frame.number: frame.motions for frame in dataset.frames}
    columns = (observations.camera, observations.frame, observations.target)
    _, first_rows = np.unique(group_numbers(*columns), return_index=True)
    for row in first_rows:
        name, frame, target = (str(column[row]) for column in columns)
        moving = motions.get(int(frame), {}).get(entries[name].name)
        if moving is not None and (moving.camera is not None or target in moving.targets):
            message = f"{target} moves before {name} while its shutter is open in frame {frame}"
            hint = "a fit takes boards for still: hold its pose until the shutter closes, or leave out the shutter"
            raise observations.error_at(row, message, hint)


def _behind_microlenses(
    observations: Observations, dataset: Dataset, entries: Mapping[str, CameraEntry]
) -> Observations:
    """Observations with the microlens of each: the one that is named, or that in whose micro-image the position is."""
    stated = observations.microlens
    microlens = np.zeros((len(observations), 2), np.int64) if stated is None else stated.copy()
    for name in np.unique(observations.camera).tolist():
        rows = np.flatnonzero(observations.camera == name)
        centres = rows[observations.is_centre[rows]]
        rig = rig_of(dataset, entries[name])
        if len(outside := rows[~rig.in_image(observations.x_px[rows])]):
            x, y = observations.x_px[outside[0]].tolist()
            width, height = entries[name].camera.sensor.size_px
            message = f"({x:g}, {y:g}) px lies outside of the image of {name}, {width} x {height} px"
            hint = "are x_px and y_px in their columns, and is the sensor of the stage that of the images?"
            raise observations.error_at(outside[0], message, hint)
        if (lattice := rig.tracer.lattice) is None:
            if len(centres):
                raise observations.error_at(centres[0], f"{name} has no microlenses, so no centres of micro-images")
            continue
        if stated is None:
            microlens[rows] = rig.axial[rig.microlens_at(rig.tracer.positions_mm(*observations.x_px[rows].T))]
        elif len(wrong := rows[lattice.rows(microlens[rows, 0], microlens[rows, 1], -1) < 0]):
            message = f"the array of {name} has no microlens {tuple(microlens[wrong[0]].tolist())}"
            raise observations.error_at(wrong[0], message)
        if len(centres):
            _require_numbering(rig, observations, centres, microlens[centres])
    return replace(observations, microlens=microlens)


def _require_numbering(rig: Rig, observations: Observations, centres: np.ndarray, microlens: np.ndarray) -> None:
    """UsageError: observed centres are those of other microlenses than they say.

    An affine map is fitted to what parts observed centres from those of the stage. Another numbering turns or scales
    it, another first microlens shifts it by a pitch, and one wrong centre is off it.
    """
    array, name = rig.tracer.camera.microlenses, observations.camera[centres[0]]
    assert array is not None
    pitch_px, stage_px = array.pitch_mm / rig.tracer.camera.sensor.pitch_mm, chief_px(rig, microlens)
    offset_px = observations.x_px[centres] - stage_px
    terms = np.column_stack([np.ones(len(offset_px)), stage_px - stage_px.mean(axis=0)])
    affine = np.zeros((3, 2))
    if len(offset_px) >= _FEWEST:
        affine = np.linalg.lstsq(terms, offset_px, rcond=None)[0]
    residual_px = np.hypot(*(offset_px - terms @ affine).T)
    worst, message = int(residual_px.argmax()), ""
    if np.abs(affine[1:]).max() > _TURNED:
        message = f"micro-images of {name} are numbered otherwise: mirrored, turned or transposed"
    elif np.hypot(*affine[0]) > _HALF * pitch_px:
        x, y = affine[0].tolist()
        message = f"all centres of {name} are ({x:+.1f}, {y:+.1f}) px off: their numbers begin at another microlens"
    elif residual_px[worst] > _HALF * pitch_px:
        k, l = microlens[worst].tolist()
        message = (
            f"the centre of micro-image ({k}, {l}) of {name} is {residual_px[worst]:.1f} px from where others put it"
        )
    if message:
        hint = "CONVENTIONS.md, Microlens lattice: (0, 0) is in the middle, k and l are axial indices; correct the file"
        if observations.microlens is None:
            hint = "the file does not number its centres, so each is that of the nearest micro-image of the stage: mend"
            hint += " the array to half a micro-image all over the image. pipeline show prints their pitch"
        raise observations.error_at(centres[worst], message, hint)
