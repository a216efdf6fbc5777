"""Ports, panes and the medium before a camera.

Windows below the camera belong to its prescription. Windows in the world are inserted in each frame, at their pose
there; nothing else of the camera depends on them.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from pxr import Usd

from pipeline.errors import PipelineError
from pipeline.optics.glass import row
from pipeline.optics.glass.fluids import AIR, FLUIDS, WATER, fluid
from pipeline.optics.glass.medium import D_UM, GlassError, Medium
from pipeline.optics.prescription import Group, Prescription, PrescriptionError, Surface
from pipeline.optics.windows import MARK, Indices, Windows
from pipeline.scene.lens import (
    check_surfaces,
    media_behind,
    medium_behind,
    ordered_surfaces,
    read_prescription,
    read_surface,
)
from pipeline.scene.usd.poses import ancestry, inverse, moving_op, product, stage_mm_per_unit, world_from
from pipeline.scene.usd.problems import Problem, problem, warning
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, need, read, target, targets
from pipeline.spelling import did_you_mean

WINDOWS = "plen:camera:windows"
_ORDER_HINT = "windows are listed from the lens outwards; light goes through them towards their +Z, into the camera"
_DIGITS = 10
"""Decimals of the pose of a world-space window before its camera [mm, and 1 for its axes]."""
_EDGE_ON = 1e-9
"""Least cosine between the axes of a window and its camera [1]."""
_ANY_TIME_CODE = 0.0
"""Time code for windows fixed to their camera: they stand before it alike in every frame."""
_CONDITIONS = (("temperature", (AIR, WATER)), ("pressure", (AIR,)), ("salinity", (WATER,)))
"""Conditions of a medium, and the media whose index depends on them."""


def prescription_of(camera: Usd.Prim) -> Prescription:
    """The prescription of the lens of a camera, at its wavelength, behind the windows that are fixed to it."""
    light_nm = read(camera, "plen:camera:wavelength")
    return behind_fixed(camera, read_prescription(target(camera, "plen:camera:lens", "PlenLens"), light_nm))


def behind_fixed(camera: Usd.Prim, lens: Prescription) -> Prescription:
    """The prescription behind the windows that are fixed to a camera, and the medium before them."""
    light_nm = need(camera, "plen:camera:wavelength")
    fixed = _read_windows(camera, fixed_windows(camera), _ANY_TIME_CODE, (light_nm,))
    return fixed.before(lens, light_nm)


def windows_in_frame(camera: Usd.Prim, time_code: float, wavelengths_nm: Sequence[float]) -> Windows | None:
    """The windows that stand in the world before a camera in a frame; None: there is none."""
    standing = standing_windows(camera)
    return _read_windows(camera, standing, time_code, wavelengths_nm) if standing else None


def surfaces_before_sensor(camera: Usd.Prim) -> list[tuple[Usd.Prim, Usd.Prim]]:
    """Every PlenSurface of the windows and the lens of a camera as light meets them, each with its window or lens."""
    lens = target(camera, "plen:camera:lens", "PlenLens")
    parts = [*reversed(_windows(camera)), *([lens] if lens else [])]
    return [(surface, part) for part in parts for surface in ordered_surfaces(part)]


def is_fixed(camera: Usd.Prim, window: Usd.Prim) -> bool:
    """Whether a window moves with a camera, because it stands below it."""
    return camera in ancestry(window)


def fixed_windows(camera: Usd.Prim) -> tuple[Usd.Prim, ...]:
    """Windows that move with a camera, from the lens outwards."""
    return tuple(prim for prim in _windows(camera) if is_fixed(camera, prim))


def standing_windows(camera: Usd.Prim) -> tuple[Usd.Prim, ...]:
    """Windows of a camera that stand in the world, from the lens outwards."""
    return tuple(prim for prim in _windows(camera) if not is_fixed(camera, prim))


def _below(camera: Usd.Prim, window: Usd.Prim) -> list[Usd.Prim]:
    """A fixed window and its ancestors below its camera; none for a world-space window."""
    prims = list(ancestry(window))
    return prims[: prims.index(camera)] if camera in prims else []


@read_once
def _windows(camera: Usd.Prim) -> list[Usd.Prim]:
    """All windows of a camera, from the lens outwards."""
    return targets(camera, WINDOWS, "PlenWindow")


def indices_before(camera: Usd.Prim, wavelength_nm: float) -> Indices:
    """The media before the lens of a camera at a wavelength: of the windows fixed to it, and before them."""
    return _indices(camera, fixed_windows(camera), wavelength_nm)


@read_once
def _indices(camera: Usd.Prim, prims: tuple[Usd.Prim, ...], wavelength_nm: float) -> Indices:
    """Indices of some windows of a camera, given from the lens outwards, and of the medium before them."""
    media = [medium_behind(surface, prim) for prim in reversed(prims) for surface in ordered_surfaces(prim)]
    standing = standing_windows(camera)
    outside = scene_medium(camera.GetStage())
    if standing and prims != standing:  # inside of the innermost one that stands in the world
        if not (panes := ordered_surfaces(standing[0])):
            raise UnreadableValue(f"<{standing[0].GetPath()}> has no surface", standing[0])
        outside = medium_behind(panes[-1], standing[0])
    return Indices(
        wavelength_nm=wavelength_nm,
        index_in_front=outside.index(wavelength_nm) + 0.0,
        behind=tuple(medium.index(wavelength_nm) + 0.0 for medium in media),
    )


@read_once
def scene_medium(stage: Usd.Stage) -> Medium:
    """Medium of the scene of a stage: `plen:medium` of its dataset, or air; GlassError."""
    root = stage.GetDefaultPrim()
    if not root or not root.IsA("PlenDataset"):
        return fluid(AIR)
    name = need(root, "plen:medium")
    if name not in FLUIDS:
        return row.medium(glass=name, index=None, abbe=None, wavelength_nm=1e3 * D_UM)
    conditions = (need(root, f"plen:medium:{condition}") for condition in ("temperature", "pressure", "salinity"))
    return fluid(name, *conditions)


def _read_windows(
    camera: Usd.Prim, prims: Sequence[Usd.Prim], time_code: float, wavelengths_nm: Sequence[float]
) -> Windows:
    """Windows, given from the lens outwards, as they stand in a frame; UnreadableValue, GlassError."""
    surfaces = list[Surface]()
    groups = list[Group]()
    first_mm = end_mm = 0.0  # first vertex of the outermost window, and last one of the window before
    for prim in reversed(prims):
        pose = camera_from_window(camera, prim, time_code)
        panes = list(map(read_surface, ordered_surfaces(prim)))
        x_mm, y_mm, z_mm = pose[:3, 3].tolist()
        # The gap to the window before is the thickness of its last surface.
        if surfaces:
            surfaces[-1] = replace(surfaces[-1], thickness_mm=z_mm - end_mm)
        else:
            first_mm = z_mm
        end_mm = z_mm + sum(surface.thickness_mm for surface in panes[:-1])
        # Make the window a group with its pose.
        tilt_x, tilt_y, roll = _angles_deg(pose[:3, :3])
        groups.append(
            Group(
                name=f"{MARK}{prim.GetName()}",
                first=len(surfaces),
                count=len(panes),
                decentre_mm=(x_mm, y_mm),
                tilt_deg=(tilt_x, tilt_y),
                roll_deg=roll,
            )
        )
        surfaces += panes
    light = tuple(_indices(camera, tuple(prims), nm) for nm in wavelengths_nm)
    return Windows(surfaces=tuple(surfaces), groups=tuple(groups), first_mm=first_mm, light=light)


def camera_from_window(camera: Usd.Prim, window: Usd.Prim, time_code: float) -> np.ndarray:
    """Transform from a window to the frame of a Camera, whose axes are those of its lens, in a frame, (4, 4) [mm]."""
    scale_mm = stage_mm_per_unit(camera)
    if is_fixed(camera, window):
        return world_from(window, [time_code], scale_mm, camera)[0]
    world_from_camera, world_from_window = (world_from(prim, [time_code], scale_mm)[0] for prim in (camera, window))
    # Rounded, so that a camera and a pane that move together stay one camera.
    return np.round(product(inverse(world_from_camera), world_from_window), _DIGITS) + 0.0


def _angles_deg(rotation: np.ndarray) -> tuple[float, float, float]:
    """Angles of a rotation, (3, 3): about x, then about the turned y, then about the turned z."""
    x = math.atan2(-rotation[1, 2], rotation[2, 2])
    y = math.atan2(rotation[0, 2], math.hypot(rotation[1, 2], rotation[2, 2]))
    z = math.atan2(-rotation[0, 1], rotation[0, 0])
    return math.degrees(x) + 0.0, math.degrees(y) + 0.0, math.degrees(z) + 0.0


def check_window(window: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenWindow alone."""
    yield from check_surfaces(window)
    for surface in ordered_surfaces(window):
        if read(surface, "plen:isStop"):
            message = "a window has no aperture stop: that is in the lens"
            yield problem(surface.GetAttribute("plen:isStop"), "several-stops", message)
    yield from media_behind(window, ordered_surfaces(window))[1]
    panes = ordered_surfaces(window)
    root = window.GetStage().GetDefaultPrim()
    has_glass = (read(pane, "plen:glass") or pane.GetAttribute("plen:index").HasAuthoredValue() for pane in panes)
    if panes and not any(has_glass) and (not root or read(root, "plen:medium") in (None, AIR)):
        hint = "write plen:glass on each surface behind which there is glass, as light meets them"
        yield warning(window, "unused-window", f"<{window.GetPath()}> is air in air: it bends no light", hint=hint)


def check_medium(root: Usd.Prim) -> Iterator[Problem]:
    """Problems of the medium of a PlenDataset: an unknown one, and conditions without effect."""
    try:
        scene_medium(root.GetStage())
    except GlassError as error:
        name = need(root, "plen:medium")
        hint = error.hint if name in FLUIDS else did_you_mean(name, FLUIDS) or error.hint
        yield problem(root.GetAttribute("plen:medium"), error.code, error.message, hint=hint)
        return
    except UnreadableValue:
        return  # reported where the value is checked
    name = need(root, "plen:medium")
    for condition, media in _CONDITIONS:
        attribute = root.GetAttribute(f"plen:medium:{condition}")
        if attribute.HasAuthoredValue() and name not in media:
            message = f'"{attribute.GetName()}" has no effect with "plen:medium" = "{name}"'
            yield warning(attribute, "unused-value", message, hint="remove it")


def check_windows(camera: Usd.Prim) -> Iterator[Problem]:
    """Problems of the windows of a camera, and of the medium before them.

    In turn: order of the list, motion, settings that world-space windows exclude, overlap on the axis, prescription.
    Stops at the first that makes the rest meaningless.
    """
    if misordered := list(_check_order_of_list(camera)):
        yield from misordered
        return
    yield from _check_motion(camera)
    if standing_windows(camera):
        yield from _check_settings_with_standing(camera)
    panes_of_windows = map(ordered_surfaces, _windows(camera))
    if any(not panes or any(read(pane, "plen:isStop") for pane in panes) for panes in panes_of_windows):
        return  # reported where the window is checked
    lens = target(camera, "plen:camera:lens", "PlenLens")
    wavelength_nm = read(camera, "plen:camera:wavelength")
    if not lens or wavelength_nm is None:
        return  # reported where the camera is checked
    try:
        front_mm = read_prescription(lens, wavelength_nm).vertices_from_stop_mm[0]
        disorder = _disorder(camera, fixed_windows(camera), front_mm=front_mm, time_code=_ANY_TIME_CODE)
    except PipelineError:
        return  # reported where the lens or the window is checked
    if disorder:
        yield problem(camera.GetRelationship(WINDOWS), "window-order", disorder, hint=_ORDER_HINT)
        return
    yield from _check_prescription(camera)


def _check_order_of_list(camera: Usd.Prim) -> Iterator[Problem]:
    """A window that is fixed to its camera, but listed behind one that stands in the world."""
    fixed_behind_standing = (
        outer for inner, outer in pairwise(_windows(camera)) if is_fixed(camera, outer) and not is_fixed(camera, inner)
    )
    if window := next(fixed_behind_standing, None):
        message = f"<{window.GetPath()}> moves with the camera, and is listed behind a window that does not"
        hint = "windows are listed from the lens outwards"
        yield problem(camera.GetRelationship(WINDOWS), "window-order", message, hint=hint)


def _check_motion(camera: Usd.Prim) -> Iterator[Problem]:
    """A window below a camera that moves against it."""
    prims_below_camera = (prim for window in _windows(camera) for prim in _below(camera, window))
    if op := next(filter(None, map(moving_op, prims_below_camera)), None):
        hint = "a window that moves before its camera stands elsewhere in the scene, not below the camera"
        yield problem(op, "moving-window", "a window below a camera is fixed to it, and this one moves", hint=hint)


def _check_settings_with_standing(camera: Usd.Prim) -> Iterator[Problem]:
    """Settings of a camera that windows in the world exclude, or change the meaning of."""
    # Position images, and the bundles of plen:truth:rays with them, are made once for a camera and serve all frames.
    for name, value in ("plen:truth:method", "direct"), ("plen:truth:rays", False):
        if read(camera, name) != value:
            message = "position images hold for a camera, and not for what stands before it in a frame"
            hint = f"write {name} = {json.dumps(value)}, or move the windows below the camera"
            yield problem(camera.GetAttribute(name), "not-yet-supported", message, hint=hint)
    if read(camera, "plen:shutter:scanOrder") not in (None, "none"):
        message = "a camera that moves while its shutter is open looks through windows that move along with it"
        hint = "in each frame they stand before it as at its time code"
        yield warning(camera.GetRelationship(WINDOWS), "still-window", message, hint=hint)


def _check_prescription(camera: Usd.Prim) -> Iterator[Problem]:
    """Whatever the prescription of a camera refuses behind its fixed windows, or in the medium of the scene."""
    windows = _windows(camera)
    try:
        is_scene_in_a_medium = scene_medium(camera.GetStage()) != fluid(AIR)
        if windows or is_scene_in_a_medium:  # otherwise it is the lens's own, which is checked there
            prescription_of(camera)
    except PrescriptionError as error:
        hint = error.hint or "a window with air behind it comes between"
        at = camera.GetRelationship(WINDOWS) if windows else camera
        yield problem(at, error.code or "window", error.message, hint=hint)
    except PipelineError:
        return  # reported where the window or the medium is checked


def check_unnamed_windows(prims: Sequence[Usd.Prim], cameras: Sequence[Usd.Prim]) -> Iterator[Problem]:
    """One warning per window that no camera of a stage looks through; none in a stage without cameras."""
    named = {prim for camera in cameras for prim in _windows(camera)}
    for prim in prims if cameras else ():
        if prim.IsA("PlenWindow") and prim not in named:
            message = f"no camera looks through <{prim.GetPath()}>: it bends no light"
            hint = f"name it in rel {WINDOWS} of each camera that it stands before"
            yield warning(prim, "unused-window", message, hint=hint)


def _disorder(camera: Usd.Prim, windows: Sequence[Usd.Prim], front_mm: float, time_code: float) -> str | None:
    """Fault of the first window, from the lens outwards, that overlaps the part behind it or faces away, in words.

    `front_mm`: z of the front of the lens. Windows are where planes through their vertices cross its axis.
    """
    part_behind = "what follows it"
    begins_mm = front_mm
    for window in windows:
        pose = camera_from_window(camera, window, time_code)
        normal, vertex_mm = pose[:3, 2], pose[:3, 3]
        if normal[2] < _EDGE_ON:
            return f"<{window.GetPath()}> turns its back, or its edge, to the camera"
        # Cross the planes through its first and last vertex with the axis.
        first_mm = float(normal @ vertex_mm / normal[2])
        glass_mm = sum(need(pane, "plen:thickness") for pane in ordered_surfaces(window)[:-1])
        last_mm = first_mm + glass_mm / float(normal[2])
        if last_mm >= begins_mm:
            return f"<{window.GetPath()}> ends {_from_stop(last_mm)}, and {part_behind} begins {_from_stop(begins_mm)}"
        part_behind = f"<{window.GetPath()}>"
        begins_mm = first_mm
    return None


def _from_stop(z_mm: float) -> str:
    """A position on the axis, in words."""
    return f"{abs(z_mm):.6g} mm {'before' if z_mm <= 0 else 'behind'} the stop"


def check_standing(
    camera: Usd.Prim, boards: Sequence[Usd.Prim], shapes: Sequence[np.ndarray], frames: Sequence[int]
) -> Iterator[Problem]:
    """Problems of windows in the world that do not face their camera, or do not stand before a target, whose triangles
    are (m, 3, 3).
    """
    if not standing_windows(camera):
        return
    scale_mm = stage_mm_per_unit(camera)
    try:
        front_mm = prescription_of(camera).vertices_from_stop_mm[0]
    except PipelineError:
        return  # reported where the camera is checked
    for time_code in frames:
        if message := _disorder(camera, standing_windows(camera), front_mm=front_mm, time_code=time_code):
            at = f"at time code {time_code} {message}"
            yield problem(camera.GetRelationship(WINDOWS), "window-order", at, hint=_ORDER_HINT)
            return
        for window in standing_windows(camera):
            window_from_world = inverse(world_from(window, [time_code], scale_mm)[0])
            for board, corners in zip(boards, shapes, strict=True):
                window_from_board = product(window_from_world, world_from(board, [time_code], scale_mm)[0])
                if (corners @ window_from_board[2, :3] + window_from_board[2, 3]).max() >= 0:
                    message = f'"{board.GetName()}" is not wholly before <{window.GetPath()}> at time code {time_code}'
                    hint = f"<{camera.GetPath()}> sees what stands beyond its windows alone, on their -Z side"
                    yield problem(board, "behind-window", message, hint=hint)
                    return
