"""Readers and checks of shutters, and of motions during an exposure."""

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel

from pipeline.motion import NODES, Motion, Shutter
from pipeline.scene.dataset import Motions
from pipeline.scene.usd.curves import bends, extent
from pipeline.scene.usd.meshes import is_animated
from pipeline.scene.usd.overrides import at_code
from pipeline.scene.usd.poses import (
    Times,
    ancestry,
    camera_from_world,
    frame_numbers,
    inverse,
    product,
    stage_mm_per_unit,
    world_from,
    xform_ops,
)
from pipeline.scene.usd.problems import Problem, not_drawn, problem, warning
from pipeline.scene.usd.readers import note_read
from pipeline.scene.usd.values import UnreadableValue, need, read, target
from pipeline.spelling import frames_in_words

_ORDER, _OPENS = "plen:shutter:scanOrder", "plen:shutter:opens"
_LINE, _EXPOSURE, _INSTANTS = "plen:shutter:lineOffset", "plen:shutter:exposure", "plen:shutter:instants"
_DURATIONS = (_OPENS, _LINE, _EXPOSURE)
"""Attributes that are fractions of a second."""
_SAME_S = 1e-9
"""Relative difference of two statements of one exposure time [1]."""
_VELOCITIES = ("velocities", "angularVelocities")
"""Attributes by which a point instancer says that its instances move."""
_STILL = 1e-9
"""Change of an entry of a pose [1, mm] that holds: between equal samples USD rounds to 1e-13."""
_MOST_TURN_DEG = 45.0
"""Turn from one Chebyshev node of a piece to the next [degree]: nearly a whole turn a piece, which is right to 1e-7."""
_RIGID = 1e-9
"""Largest entry of R^T R - 1 of a rotation [1]: rounding leaves 1e-15."""


def read_shutter(camera: Usd.Prim) -> Shutter | None:
    """The shutter of a camera; None where a frame is the instant of its time code."""
    shutter = Shutter(
        scan_order=need(camera, _ORDER),
        opens_s=_seconds(camera, _OPENS),
        line_s=_seconds(camera, _LINE),
        exposure_s=_seconds(camera, _EXPOSURE),
        instants=need(camera, _INSTANTS),
    )
    is_instant = shutter.scan_order == "none" and not (shutter.opens_s or shutter.exposure_s)
    return None if is_instant else shutter


def _is_readable(camera: Usd.Prim) -> bool:
    """Whether all attributes of a shutter have usable values."""
    values = [read(camera, name) for name in (_ORDER, _INSTANTS, *_DURATIONS)]
    return None not in values and all(denominator > 0 for _, denominator in values[2:])


def _seconds(camera: Usd.Prim, name: str) -> float:
    """A duration that is written as a fraction [s]."""
    numerator, denominator = need(camera, name)
    return float(numerator / denominator)


def check_shutter(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of a shutter: durations that are no fractions, and settings that contradict each other."""
    for name in _DURATIONS:
        if (value := read(camera, name)) and not value[1] > 0:
            message = f'"{name}" = ({value[0]:g}, {value[1]:g}) is no duration: its second number must be above 0'
            hint = "seconds as a fraction: (1, 1000) is a millisecond"
            yield problem(camera.GetAttribute(name), "duration", message, hint=hint)
            return
    if not _is_readable(camera):
        return  # reported with the values
    shutter = read_shutter(camera)
    scans = need(camera, _ORDER) != "none"
    if scans != bool(_seconds(camera, _LINE)):
        message = f'"{_ORDER}" = "{need(camera, _ORDER)}" does not go with "{_LINE}" = {_seconds(camera, _LINE):g} s'
        hint = f"a rolling shutter needs both, a global one neither; (1, 50000) for {_LINE} is 20 microseconds"
        yield problem(camera.GetAttribute(_LINE), "shutter", message, hint=hint)
    if shutter is None:
        return
    time_s = read(camera, "plen:image:exposureTime")
    if time_s is not None and abs(time_s - shutter.exposure_s) > _SAME_S * max(time_s, shutter.exposure_s):
        message = (
            f'"plen:image:exposureTime" = {time_s:g} s, but the shutter exposes lines for {shutter.exposure_s:g} s'
        )
        yield problem(camera.GetAttribute("plen:image:exposureTime"), "shutter", message, hint=f"or change {_EXPOSURE}")
    if read(camera, name := "plen:truth:method") != "direct":
        message = f'"{name}" is not supported together with a shutter that is open for longer than an instant'
        yield problem(camera.GetAttribute(name), "not-yet-supported", message, hint='write "direct"')


WorldFrom = Callable[[Usd.Prim, Times, float], np.ndarray]
"""Reader of transforms from a prim to the world at times, (n, 4, 4) [mm]."""


def motions_before(
    camera: Usd.Prim,
    shutter: Shutter,
    boards: Sequence[Usd.Prim],
    things: Mapping[Usd.Prim, WorldFrom],
    number: int,
    unit_mm: float,
) -> Motions:
    """Motions before a camera in a frame: of boards by name, of things, which are shapes and lamps, by path."""

    def motion_of(prim: Usd.Prim, reader: WorldFrom) -> Motion | None:
        """The motion of a prim in the vision frame; None if it stands still before the camera."""

        def vision_from_prim(times: Times) -> np.ndarray:
            """Poses of the prim before the camera at time codes, (n, 4, 4) [mm]."""
            return product(camera_from_world(camera, times, unit_mm), reader(prim, times, unit_mm))

        return _motion(camera, shutter, [camera, prim], vision_from_prim, number)

    def world_from_vision(times: Times) -> np.ndarray:
        """Poses of the camera in the world at time codes, (n, 4, 4) [mm]."""
        return inverse(camera_from_world(camera, times, unit_mm))

    board_motions = {prim.GetName(): motion_of(prim, world_from) for prim in boards}
    thing_motions = {str(prim.GetPath()): motion_of(prim, reader) for prim, reader in things.items()}
    return Motions(
        targets={name: motion for name, motion in board_motions.items() if motion is not None},
        things={path: motion for path, motion in thing_motions.items() if motion is not None},
        camera=_motion(camera, shutter, [camera], world_from_vision, number),
    )


def _motion(
    camera: Usd.Prim,
    shutter: Shutter,
    prims: Sequence[Usd.Prim],
    poses_at: Callable[[Times], np.ndarray],
    number: int,
) -> Motion | None:
    """The motion by poses at time codes while the shutter is open; None if the pose holds.

    `prims`: those whose transforms the pose depends on.
    """
    if not (moving := [each for prim in prims for each in moved_ops(prim)]):
        return None
    edges, codes = _nodes(camera, shutter, moving, number)
    poses = poses_at([float(number), *(code for piece in codes for code in piece)]) + 0.0
    if np.abs(poses - poses[0]).max() < _STILL:
        return None
    pieces = poses[1:].reshape(len(codes), -1, 4, 4).tolist()
    return Motion(edges_s=tuple(edges.tolist()), poses=tuple(pieces))


def _nodes(
    camera: Usd.Prim, shutter: Shutter, moving: Sequence[Usd.Attribute], number: int
) -> tuple[np.ndarray, list[list[Any]]]:
    """Edges [s] of the pieces of a motion in a frame, and time codes of the poses of each."""
    codes_per_s = codes_per_second(camera)
    window_s = _window_s(camera, shutter)
    first, last = (number + time * codes_per_s for time in window_s)
    # Cut the window at the bends, whose time codes must not be rounded by a conversion to seconds and back.
    code_of_bend = {(code - number) / codes_per_s: code for code in bends(moving, first, last)}
    edges = pieces_s(window_s, code_of_bend)
    codes = (number + Motion.times_s(edges) * codes_per_s).tolist()
    for piece, start, end in zip(codes, edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        # A pose may jump at a bend: a piece ends before it, and the next one begins after.
        piece[0] = code_of_bend.get(start, piece[0])
        piece[-1] = Usd.TimeCode.PreTime(code_of_bend.get(end, piece[-1]))
    return edges, codes


def _window_s(camera: Usd.Prim, shutter: Shutter) -> tuple[float, float]:
    """Time that a motion covers."""
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    width_px, height_px = need(sensor, "plen:resolution")
    return shutter.motion_s((width_px, height_px))


def pieces_s(window_s: tuple[float, float], bends_s: Iterable[float]) -> np.ndarray:
    """Edges of the pieces of a window of time within which motion is smooth, (m,) [s]."""
    first, end = window_s
    return np.array([first, *sorted(time for time in bends_s if first < time < end), end])


def codes_per_second(prim: Usd.Prim) -> float:
    """Time codes in a second, by the stage of a prim."""
    note_read(prim.GetStage().GetPseudoRoot())  # metadata of the layer
    return float(prim.GetStage().GetTimeCodesPerSecond())


def moved_ops(prim: Usd.Prim) -> list[Usd.Attribute]:
    """Animated operations of the transforms of a prim and of its ancestors."""
    return [op.GetAttr() for link in ancestry(prim) for op in xform_ops(link) if op.MightBeTimeVarying()]


def check_motions(
    root: Usd.Prim, cameras: Sequence[Usd.Prim], boards: Sequence[Usd.Prim], things: Sequence[Usd.Prim]
) -> Iterator[Problem]:
    """Problems of boards and cameras that are not rigid between samples, and warnings of prims that stand still, or
    keep their shapes, while a shutter is open.

    `things` are shapes and lamps.
    """
    unit_mm = stage_mm_per_unit(root)
    # Collect the frames of each shutter of each camera.
    shutters = dict[tuple[Usd.Prim, Shutter], list[int]]()
    for camera, number in itertools.product(cameras, frame_numbers(root)):
        camera_then = at_code(camera, number)
        if _is_readable(camera_then) and (shutter := read_shutter(camera_then)):
            shutters.setdefault((camera, shutter), []).append(number)
    for (camera, shutter), numbers in shutters.items():
        # Rigid at the middle of each exposure?
        first_s, end_s = _window_s(camera, shutter)
        codes_per_s = codes_per_second(camera)
        middles = [number + (first_s + end_s) / 2 * codes_per_s for number in numbers]
        for prim in (camera, *boards):
            if not moved_ops(prim):
                continue
            with np.errstate(all="ignore"):  # of what is not finite, which is reported with the values
                rotation = np.array(world_from(prim, middles, unit_mm))[:, :3, :3]
                gram = np.swapaxes(rotation, 1, 2) @ rotation
                is_distorted = np.abs(gram - np.eye(3)).max(axis=(1, 2)) > _RIGID
            if is_distorted.any():
                in_frames = _frames(numbers, is_distorted)
                message = f"<{prim.GetPath()}> is not rigid while the shutter is open in {in_frames}"
                hint = "between samples USD interpolates each entry of a matrix: write translate and orient instead"
                yield problem(prim, "not-rigid", message, hint=hint)
            elif fast := [n for n in numbers if _turns_fast(prim, camera, shutter, n, unit_mm)]:
                message = f"<{prim.GetPath()}> turns too fast for the shutter in {frames_in_words(fast)}"
                hint = f"by less than {_MOST_TURN_DEG:g} degrees from one of {NODES} instants to the next is followed"
                yield problem(prim, "turns-too-fast", message, hint=hint)
        # Animated from the opening of the shutter to its end?
        opens = np.array(numbers) + shutter.opens_s * codes_per_s
        ends = np.array(numbers) + end_s * codes_per_s
        for link in dict.fromkeys(link for prim in (camera, *boards, *things) for link in ancestry(prim)):
            if spans := list(filter(None, (extent(op.GetAttr()) for op in xform_ops(link)))):
                starts, stops = zip(*spans, strict=True)
                yield from _check_covered(link, min(starts), max(stops), (numbers, opens, ends))
        # Shapes, instances and skeletons that stay as at the time code.
        for prim in things:
            if prim.IsA(UsdGeom.Gprim) and is_animated(prim):
                message = (
                    f"<{prim.GetPath()}> changes its shape, and keeps that of the time code while a shutter is open"
                )
                yield not_drawn(prim, message, hint="its transform may move meanwhile")
        for prim in filter(_is_placed_at_frames, root.GetStage().Traverse()):
            message = (
                f"what <{prim.GetPath()}> moves is placed at time codes of frames alone, and a shutter is open longer"
            )
            yield not_drawn(prim, message, hint="prims that move by their own xformOps move meanwhile")


def _turns_fast(prim: Usd.Prim, camera: Usd.Prim, shutter: Shutter, frame: int, unit_mm: float) -> bool:
    """Whether a rigid prim turns by more than `_MOST_TURN_DEG` between two neighbouring time codes at which its pose
    is read while the shutter of a frame is open: interpolation cannot follow it.
    """
    try:
        _, codes_of_pieces = _nodes(camera, shutter, moved_ops(prim), frame)
    except UnreadableValue:  # reported where the motion is read
        return False
    codes = [code for codes_of_piece in codes_of_pieces for code in codes_of_piece]
    with np.errstate(all="ignore"):  # of what is not finite, which is reported with the values
        rotations = np.array(world_from(prim, codes, unit_mm))[:, :3, :3]
        rotations = rotations.reshape(len(codes_of_pieces), -1, 3, 3)  # by piece and node
        # The trace of the rotation from one instant to the next is 1 + 2 cos of its angle.
        cosine = (np.einsum("pnij,pnij->pn", rotations[:, 1:], rotations[:, :-1]) - 1) / 2
    return bool((cosine < np.cos(np.radians(_MOST_TURN_DEG))).any())


def _is_placed_at_frames(prim: Usd.Prim) -> bool:
    """Whether a prim is an animation of a skeleton, or a point instancer whose instances move."""
    if not (prim.IsA(UsdGeom.PointInstancer) or prim.IsA(UsdSkel.Animation)):
        return False
    own = [attribute for attribute in prim.GetAuthoredAttributes() if not attribute.GetName().startswith("xform")]
    return any(attribute.ValueMightBeTimeVarying() or attribute.GetName() in _VELOCITIES for attribute in own)


def _check_covered(
    link: Usd.Prim, first: float, last: float, frames: tuple[Sequence[int], np.ndarray, np.ndarray]
) -> Iterator[Problem]:
    """Warnings of a prim whose samples begin after the shutter opens, or end before it closes.

    `first`, `last`: of the samples. `frames`: numbers of frames, and when the shutter opens and closes in each. All are
    time codes.
    """
    numbers, opens, ends = frames
    before = (np.array(numbers) > first - 1) & (opens < first)
    after = (np.array(numbers) < last + 1) & (ends > last)
    for is_missed, word, sample, direction in ((before, "before", first, "earlier"), (after, "after", last, "later")):
        if is_missed.any():
            message = f"<{link.GetPath()}> has no sample {word} {sample:g}, and the shutter is open {direction}"
            hint = f"it stands still then, in {_frames(numbers, is_missed)}: write one more sample"
            yield warning(link, "motion-ends", message, hint=hint)


def _frames(numbers: Sequence[int], is_chosen: np.ndarray) -> str:
    """Words for the chosen frames."""
    return frames_in_words(np.array(numbers)[is_chosen].tolist())
