"""Warnings that need rays: cameras that are implausible, mostly by a wrong unit, and frames in which a camera sees
little or nothing of a target (`camera.figures.outlook`).
"""

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from pxr import Usd

from pipeline.camera.figures.doubts import doubts, pixel_doubts
from pipeline.camera.figures.outlook import (
    Fate,
    Outlook,
    behind_microlenses_px,
    covered_mm,
    outlook,
    pupil_points_mm,
    widest_blur_px,
)
from pipeline.camera.focusing.depth_of_field import focused, middle_focus, view_of
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.from_stop import depths_mm, is_steep
from pipeline.errors import PipelineError
from pipeline.frames import apply
from pipeline.motion import Motion
from pipeline.scene.dataset import CameraEntry, Dataset, Frame
from pipeline.scene.lens import ordered_surfaces
from pipeline.scene.losses import check_angles
from pipeline.scene.microlenses import attribute_per_type
from pipeline.scene.sensor import read_sensor
from pipeline.scene.shutters import moved_ops
from pipeline.scene.usd.problems import Problem, of_reader, problem, warning
from pipeline.scene.usd.values import read, target
from pipeline.scene.windows import WINDOWS
from pipeline.spelling import frames_in_words

if TYPE_CHECKING:
    from pipeline.render.surroundings import Surroundings

_POINTS = 8_000
"""Most points of a target that are examined in all frames together; a larger number is sampled."""
_HIDING = 500
"""Most frames that are examined for occluders of a target; a larger number is sampled."""
HIDDEN, MERGED = len(Fate), len(Fate) + 1
"""Fates in addition to those of `Fate`. HIDDEN: something blocks the light. MERGED: all points of the target blur into
one grey.
"""
_LEAST_PX, _WIDEST_BLUR = 1.0, 1.72
"""Points nearer than this in the image [px] count as one; if the blur exceeds their distance by this factor, no
points can be distinguished: a disc as wide as that takes all contrast from the fundamental wave of a checkerboard, and
a wider one leaves an eighth of it at most, with black for white (2 J1(x) / x at x = pi 1.72 / sqrt(2)).
"""
_ORIGIN = np.zeros((1, 3))
"""The point of shapes and lamps whose motion is checked [mm]."""
_INSTANTS = 33
"""Instants of a frame at which a motion is checked [1]."""
_WIDEST_IN_VIEW = 0.65
"""The factor `_WIDEST_BLUR` of a view, in which programs interpolate between pixels: to a third of the contrast, sinc^6
of half of it, with one factor along each axis for the pixel's part of the pupil and two for the interpolation.
"""
_NEIGHBOURS = 64
"""Number of points for the median distance of neighbouring points."""

NOT_SEEN = ("blank", "few-points")
"""Codes of these warnings, which a build repeats before its first task."""
_FEW = 0.25
"""Share of the points that face a camera below which a frame is named [1]: calibrations gain little by such frames, and
boards that reach over the edge of the image on purpose show more."""
_REASONS = {
    Fate.AWAY: "it shows its back",
    Fate.NO_LIGHT: "out of view",
    Fate.BLURRED: "out of focus",
    Fate.OUTSIDE: "out of view",
    HIDDEN: "hidden",
    MERGED: "too far away or too blurred to tell its points apart",
}


def check_doubts(stage: Usd.Stage, cameras: tuple[CameraEntry, ...]) -> Iterator[Problem]:
    """Warnings about each camera, at the attribute most likely to blame; an error if no ray can be traced."""
    sensors = [prim for prim in stage.Traverse() if prim.IsA("PlenSensor")] if not cameras else []
    for prim in sensors:
        for doubt in pixel_doubts(read_sensor(prim)):
            pitch = prim.GetAttribute("plen:pixelPitch")
            yield warning(pitch, doubt.code, doubt.message, hint=doubt.hint)
    for entry in cameras:
        prim = stage.GetPrimAtPath(entry.prim_path)
        try:
            camera = focused(entry.camera)
        except (PipelineError, ArithmeticError) as error:
            yield of_reader(prim, error)
            continue
        try:
            for doubt in doubts(camera):
                at = _stating(prim, camera, doubt.part)
                yield warning(at, doubt.code, doubt.message, hint=doubt.hint)
        except CameraError as error:
            yield problem(_stating(prim, camera, "sensor"), "no-chief-ray", error.message, hint=error.hint)
        except ArithmeticError:
            continue  # a pupil on the sensor or at infinity: no figure tells whether that was intended
        yield from check_angles(prim, camera)


def _stating(prim: Usd.Prim, camera: Camera, part: str) -> Usd.Prim | Usd.Property:
    """The prim or the attribute that states a part of a camera; the camera itself where none does.

    `part`: as in `Doubt.part`.
    """
    lens, sensor, array = (
        target(prim, f"plen:camera:{name}", kind)
        for name, kind in (("lens", "PlenLens"), ("sensor", "PlenSensor"), ("microlenses", "PlenMicrolensArray"))
    )
    # A stop that is matched to the microlenses is computed: no attribute states it.
    if part == "stop" and read(prim, "plen:camera:stopMatch") != "microlenses":
        return ordered_surfaces(lens)[camera.prescription.stop_index].GetAttribute("plen:semiDiameter")
    if part == "sensor":
        # An override of the stage itself is more likely to be wrong than a file of the library.
        attributes = [sensor.GetAttribute("plen:pixelPitch"), sensor.GetAttribute("plen:resolution")]
        root = prim.GetStage().GetRootLayer()
        of_this_stage = (attribute for attribute in attributes if attribute.GetPropertyStack()[0].layer == root)
        return next(of_this_stage, attributes[0])
    if part == "focal_lengths":
        return array.GetAttribute(attribute_per_type(array))
    return {"image": sensor, "microlenses": array, "windows": prim.GetRelationship(WINDOWS)}.get(part, prim)


@dataclass(frozen=True, slots=True)
class _View:
    """Visibility of a target before a camera, by frame: visible points over those that face the camera, the most common
    fate of the rest (None: all are visible), positions and normals in the vision frame, (frames, n, 3), and the
    distance of neighbouring points, of the kind where it is largest.
    """

    numbers: tuple[int, ...]
    share: np.ndarray
    fates: list[int | None]
    points_mm: np.ndarray
    front: np.ndarray
    spacing_px: np.ndarray
    outlook: Outlook


def _view_on_target(dataset: Dataset, entry: CameraEntry, camera: Camera, number: int) -> _View:
    """The view of a camera of a dataset on the target of an index."""
    frames = dataset.frames_of(entry)
    target = dataset.targets[number]
    view = view_of(camera)
    widest = _WIDEST_BLUR if view is camera else _WIDEST_IN_VIEW
    # Take a sample of the points, and pose it in all frames.
    points = target.target.points()
    count = min(len(points.kinds), max(1, _POINTS // max(1, len(frames))))
    sample = np.unique(np.linspace(0, len(points.kinds) - 1, count).astype(int))
    kinds = np.array(points.kinds)[sample]
    poses = np.array([frame.vision_from_target(entry.name, target.name) for frame in frames])
    positions = np.einsum("fij,nj->fni", poses[:, :3, :3], points.position_mm[sample]) + poses[:, None, :3, 3]
    fronts = np.einsum("fij,nj->fni", poses[:, :3, :3], points.plane_axes[sample][:, :, 2])
    # Find the points in view and in focus, but for those that something hides.
    outlooks = outlook(view, positions, fronts)
    fate = outlooks.fate
    if len(dataset.targets) + len(dataset.occluders) > 1:
        for index in range(0, len(frames), 1 + len(frames) // _HIDING):
            visible = np.flatnonzero(fate[index] == Fate.SEEN)
            if not len(visible):
                continue
            before = pupil_points_mm(camera), positions[index, visible]
            obstacles = surroundings(dataset, frames[index], entry.name, before=before)
            hidden = _hidden(obstacles, camera, number, positions[index, visible], fronts[index, visible])
            fate[index, visible[hidden]] = HIDDEN
    # Find the frames in which points of one kind blur into each other.
    spacing = np.full(len(frames), np.inf)
    for index in range(len(frames)):
        visible = fate[index] == Fate.SEEN
        if visible.any():
            by_kind = (positions[index, visible & (kinds == kind)] for kind in set(kinds[visible]))
            spacing[index] = max(_spacing_px(view, points_mm) for points_mm in by_kind)
            if spacing[index] < max(_LEAST_PX, np.median(outlooks.blur_px[index, visible]) / widest):
                fate[index, visible] = MERGED
    # Take the share of visible points, and the most common fate of the rest.
    share = (fate == Fate.SEEN).sum(axis=1) / np.maximum(1, (fate != Fate.AWAY).sum(axis=1))
    missed = [row[(row != Fate.SEEN) & ((row != Fate.AWAY) | (row != Fate.SEEN).all())] for row in fate]
    fates = [Counter(row.tolist()).most_common(1)[0][0] if len(row) else None for row in missed]
    return _View(tuple(frame.number for frame in frames), share, fates, positions, fronts, spacing, outlooks)


def _spacing_px(camera: Camera, points_mm: np.ndarray) -> float:
    """Paraxial distance of neighbouring points [px] in the image, or in a micro-image; infinite for fewer than two."""
    if len(points_mm) < 2:
        return float("inf")
    sample = np.linspace(0, len(points_mm) - 1, min(_NEIGHBOURS, len(points_mm))).astype(int)
    axes = slice(3 if is_steep(camera.prescription, points_mm).any() else 2)  # beside the lens, z is no depth
    distance_mm = np.linalg.norm(points_mm[sample, None, axes] - points_mm[None, :, axes], axis=2)
    distance_mm[np.arange(len(sample)), sample] = np.inf
    spacing_mm = float(np.median(distance_mm.min(axis=1)))
    z_mm = np.mean(depths_mm(camera.prescription, points_mm))
    if camera.microlenses:
        return spacing_mm * float(behind_microlenses_px(camera, camera.microlenses, z_mm[None])[1][0])
    return spacing_mm * camera.sensor.width_px / covered_mm(camera, float(z_mm))[0]


def surroundings(
    dataset: Dataset, frame: Frame, name: str, only: str | None = None, before: Sequence[np.ndarray] = ()
) -> "Surroundings":
    """All targets and occluders of a frame, or the target of a name alone, in the vision frame of a camera.

    `before`: points of the pupil and of targets, (n, 3), if occluders count only where they may be between these.
    """
    from pipeline.render.surroundings import Surroundings  # loads Embree, which few datasets need

    entries = [entry for entry in dataset.targets if only in (None, entry.name)]
    targets = [(entry.target, frame.vision_from_target(name, entry.name)) for entry in entries]
    if only is not None:
        return Surroundings(targets)
    vision = np.array(frame.camera_from_world[name])
    occluders = [
        (entry.occluder, vision @ np.array(frame.world_from_occluder[entry.prim_path]))
        for entry in dataset.occluders_in(frame)
    ]
    if before:
        # All light between the points is in a capsule about the line between their means.
        ends = np.array([points.mean(axis=0) for points in before])
        radius = max(np.linalg.norm(points - end, axis=1).max() for points, end in zip(before, ends, strict=True))
        occluders = [(shape, pose) for shape, pose in occluders if shape.may_reach(pose[None], ends, radius)[0]]
    return Surroundings(targets, occluders)


def _hidden(
    surroundings: "Surroundings", camera: Camera, number: int, points_mm: np.ndarray, front: np.ndarray
) -> np.ndarray:
    """Whether points of a target are hidden from every sampled point of the entrance pupil, (n,) bool."""
    hidden = surroundings.may_hide(points_mm, front)
    front_mm = -camera.prescription.vertices_from_stop_mm[0]
    hidden &= ~is_steep(camera.prescription, points_mm)  # only a build decides about points beside the lens
    for pupil in pupil_points_mm(camera) if hidden.any() else ():
        direction = points_mm - pupil
        direction *= np.sign(direction[:, 2:]) / np.linalg.norm(direction, axis=1, keepdims=True)
        start = points_mm + ((front_mm - points_mm[:, 2]) / direction[:, 2])[:, None] * direction
        hidden &= surroundings.hides(number, points_mm, front, start, direction)
    return hidden


def check_visible(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """Warnings for each camera and target if few or no points of the target are visible in some frames."""
    for entry in dataset.cameras:
        camera = focused(entry.camera)  # `check_doubts` has focused it, too
        for number, board in enumerate(dataset.targets):
            if not board.target.points().kinds:
                continue
            view = _view_on_target(dataset, entry, camera, number)
            prim = stage.GetPrimAtPath(board.prim_path)
            fates = {frame: fate for frame, fate in zip(view.numbers, view.fates, strict=True) if fate is not None}
            is_few = (view.share > 0) & (view.share < _FEW)
            cases = ("no point", view.share == 0), ("less than a quarter of the points", is_few)
            for code, (amount, is_case) in zip(NOT_SEEN, cases, strict=True):
                missed = {frame: fates[frame] for frame in np.array(view.numbers)[is_case].tolist()}
                if missed:
                    message = (
                        f'"{entry.name}" sees {amount} of "{prim.GetName()}" in {len(missed)} of {len(view.numbers)}'
                        f" frames: {_listed(missed)}"
                    )
                    yield warning(prim, code, message, hint=_hint(camera, view, missed))


def check_speeds(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """Warnings of motion while a shutter is open by prims that have no more than a pose per frame."""
    numbers = {frame.number for frame in dataset.frames}
    reported = set[tuple[str, str]]()
    for entry, frame in itertools.product(dataset.cameras, dataset.frames):
        motions = frame.motions.get(entry.name)
        if motions is None or entry.shutter is None:
            continue
        posed = {board.prim_path: motions.targets.get(board.name) for board in dataset.targets} | motions.things
        for path, motion in posed.items():
            prims = map(stage.GetPrimAtPath, (path, entry.prim_path))
            moving = next((prim for prim in prims if _is_posed_at_frames(prim, numbers)), None)
            if motion is None or moving is None or (entry.name, moving.GetName()) in reported:
                continue
            reported.add((entry.name, moving.GetName()))
            points = next(
                (board.target.points().position_mm for board in dataset.targets if board.prim_path == path), _ORIGIN
            )
            yield _moves_between_frames(moving, entry, frame.number, motion, points)


def _is_posed_at_frames(prim: Usd.Prim, numbers: set[int]) -> bool:
    """Whether a prim has poses at frames alone, and neither a spline nor samples between frames."""
    ops = moved_ops(prim)
    return bool(ops) and not any(op.HasSpline() or set(op.GetTimeSamples()) - numbers for op in ops)


def _moves_between_frames(
    prim: Usd.Prim, entry: CameraEntry, number: int, motion: Motion, points_mm: np.ndarray
) -> Problem:
    """The warning of a prim that moves from pose to pose while a shutter is open, with the path of its points."""
    assert entry.shutter is not None
    camera = focused(entry.camera)
    first_s, end_s = entry.shutter.window_s(camera.sensor.size_px)
    times_s = np.linspace(first_s, end_s, _INSTANTS)
    positions = np.array([apply(pose, points_mm) for pose in motion.at(times_s)])
    path_mm = np.linalg.norm(positions - positions[0], axis=2).max()
    # Project the points onto the plane at their mean depth, for the path in the image.
    z_mm = float(positions[0, :, 2].mean())
    on_plane_mm = positions[:, :, :2] * (z_mm / positions[:, :, 2:])
    in_plane_mm = np.linalg.norm(on_plane_mm - on_plane_mm[0], axis=2).max()
    path_px = in_plane_mm * camera.sensor.width_px / covered_mm(camera, z_mm)[0]
    pixels = f", {path_px:.2g} px in the image," if z_mm > 0 else ""
    message = (
        f"<{prim.GetPath()}> moves {path_mm:.3g} mm{pixels} while the shutter of {entry.name} is open in frame"
        f" {number}: {path_mm / (end_s - first_s):.3g} mm/s on the straight way to the pose of another frame"
    )
    hint = "to hold a pose, write it when the shutter opens and when it closes; a sample beyond the frames means motion"
    return warning(prim, "flying", message, hint=hint)


def _picture(camera: Camera) -> str:
    """The picture whose pixels count for blur, in words, where it is not the image."""
    if not camera.microlenses:
        return ""
    return " in a micro-image" if view_of(camera) is camera else " in a view of a pixel per microlens"


def _listed(missed: dict[int, int]) -> str:
    """Frames by the reason why points are missing there, as text."""
    frames = dict[str, list[int]]()
    for number, fate in missed.items():
        frames.setdefault(_REASONS[fate], []).append(number)
    return "; ".join(f"{frames_in_words(numbers)} ({reason})" for reason, numbers in frames.items())


def _hint(camera: Camera, view: _View, missed: dict[int, int]) -> str:
    """A hint to mend the first frame."""
    number, fate = next(iter(missed.items()))
    index = view.numbers.index(number)
    points_mm = view.points_mm[index]
    x, y, z = points_mm.mean(axis=0)
    if fate == Fate.AWAY:
        cosine = -np.median(np.sum(points_mm * view.front[index], axis=1) / np.linalg.norm(points_mm, axis=1))
        angle = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return f"in frame {number} its front, +Z, looks {angle:.0f} degrees past the camera: turn it about its X or Y"
    if fate == HIDDEN:
        return "move it, or the object in front of it"
    if fate == MERGED:
        blur = np.median(view.outlook.blur_px[index])
        spacing = f"{view.spacing_px[index]:.2g} px apart{_picture(camera)}"
        return f"in frame {number}, {z:.4g} mm before the stop, points are {spacing} and blur to {blur:.3g} px"
    if fate == Fate.BLURRED:
        blur = np.median(view.outlook.blur_px[index])
        picture = _picture(camera).removeprefix(" in ") or "the image"
        return (
            f"in frame {number} it is {z:.4g} mm before the stop, and the focus at {middle_focus(camera):.4g} mm: its"
            f" points blur to {blur:.3g} px, and {picture} is {widest_blur_px(view_of(camera)):.3g} px wide"
        )
    width, height = covered_mm(camera, float(z))
    side = "left" if x < 0 else "right"
    level = "above" if y < 0 else "below"
    return (
        f"in frame {number} it is {abs(x):.1f} mm to the {side} of the axis and {abs(y):.1f} mm {level} it;"
        f" {z:.4g} mm before the stop the image covers about {width:.3g} x {height:.3g} mm"
    )
