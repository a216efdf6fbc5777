"""States of cameras whose lens or sensor changes, from frame to frame and while a shutter is open."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from pxr import Usd

from pipeline.camera.focusing.focus_request import FocusRequest, solved
from pipeline.camera.in_time import PIECES, AskedInTime, state_times
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.channel_names import name_in_state
from pipeline.errors import PipelineError
from pipeline.motion import Shutter
from pipeline.scene.camera import read_camera, read_camera_entry
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.shutters import check_shutter, codes_per_second, pieces_s, read_shutter
from pipeline.scene.usd.curves import bends
from pipeline.scene.usd.poses import frame_numbers
from pipeline.scene.usd.problems import Problem, of_reader, problem
from pipeline.scene.usd.values import at_code, code_now, read, read_once, target, target_paths
from pipeline.scene.windows import standing_windows, windows_in_frame

_NOT_IN_TIME, _DERIVATIVES = ("plen:image:noise", "plen:truth:columns"), "plen:truth:derivatives"
"""Wishes that a camera cannot fulfil which changes while its shutter is open."""


def read_camera_entries(stage: Usd.Stage) -> tuple[CameraEntry, ...]:
    """Every camera with PlenCameraAPI on a stage that passed the checks, in stage order, named relative to its root;
    windows of the world are before it as in the first frame.
    """
    root = stage.GetDefaultPrim() or stage.GetPseudoRoot()
    seed, number = read(root, "plen:seed") or 0, next(iter(frame_numbers(root)), 0)
    cameras = filter(is_camera, stage.Traverse())
    return tuple(_with_windows(read_camera_entry(prim, root, seed), prim, number) for prim in cameras)


def is_camera(prim: Usd.Prim) -> bool:
    """Whether a prim is a camera of ours."""
    return bool(prim.IsA("Camera") and prim.HasAPI("PlenCameraAPI"))


def read_states(
    prim: Usd.Prim, root: Usd.Prim, seed: int, numbers: Sequence[int]
) -> list[tuple[CameraEntry, list[int]]]:
    """A camera in each state of its lens and sensor, and the frames that have it; most cameras are in one state."""
    states = list[tuple[CameraEntry, list[int]]]()
    for number in numbers if changes(prim) or standing_windows(prim) else numbers[:1]:
        with at_code(number):
            entry = _with_windows(read_camera_entry(prim, root, seed), prim, number)
            entry = replace(entry, in_time=read_in_time(prim, entry.asked, entry.shutter))
        frames = next((frames for state, frames in states if state == entry), None)
        if frames is None:
            states.append((entry, [number]))
        else:
            frames.append(number)
    if len(states) < 2:
        return [(entry, list(numbers)) for entry, _ in states]
    return [(replace(entry, name=name_in_state(entry.name, frames[0])), frames) for entry, frames in states]


def read_in_time(camera: Usd.Prim, asked: Camera | FocusRequest, shutter: Shutter | None) -> AskedInTime | None:
    """The states of a camera while its shutter is open; None if it is then as asked at the time code."""
    varying = [each for each in _varying(camera) if not each.GetName().startswith("plen:shutter:")]
    if shutter is None or not varying:
        return None
    number, codes_per_s = code_now(), codes_per_second(camera)
    window_s = shutter.motion_s(asked.sensor.size_px)
    first, last = (number + time * codes_per_s for time in window_s)
    bends_s = {(time - number) / codes_per_s for time in bends(varying, first, last)}
    edges_s = pieces_s(window_s, {*bends_s, *np.linspace(*window_s, PIECES + 1)})
    states = []
    for time_s in state_times(edges_s).ravel().tolist():
        with at_code(number + time_s * codes_per_s):
            states.append(read_camera(camera))
    if all(state == asked for state in states):
        return None
    return AskedInTime(edges_s=tuple(edges_s.tolist()), states=tuple(states))


def _with_windows(entry: CameraEntry, prim: Usd.Prim, number: int) -> CameraEntry:
    """A camera before which the windows of the world stand as in a frame, for all wavelengths of its records."""
    nodes = (node for channel in entry.channels for node in (channel.middle, *channel.nodes))
    wavelengths_nm = dict.fromkeys([entry.wavelength_nm, *(node.wavelength_nm for node in nodes)])
    return replace(entry, windows=windows_in_frame(prim, number, list(wavelengths_nm)))


@read_once
def changes(camera: Usd.Prim) -> bool:
    """Whether anything of a camera has time samples, of itself, of its lens, of its sensor or of its microlenses."""
    return bool(_varying(camera))


def _varying(camera: Usd.Prim) -> list[Usd.Attribute]:
    links = (("lens", "PlenLens"), ("sensor", "PlenSensor"), ("microlenses", "PlenMicrolensArray"))
    parts = [target(camera, f"plen:camera:{name}", kind) for name, kind in links]
    prims = [camera, *(prim for part in parts if part for prim in Usd.PrimRange(part))]
    return [
        attribute
        for prim in prims
        for attribute in prim.GetAuthoredAttributes()
        if attribute.GetName().startswith("plen:") and attribute.ValueMightBeTimeVarying()
    ]


def check_in_time(camera: Usd.Prim) -> Iterator[Problem]:
    """A camera that cannot be what it is asked for while its shutter is open, or wishes that it cannot fulfil then."""
    parts = target(camera, "plen:camera:lens", "PlenLens"), target(camera, "plen:camera:sensor", "PlenSensor")
    if not all(parts) or not changes(camera) or any(check_shutter(camera)):
        return
    try:
        in_time = read_in_time(camera, read_camera(camera), read_shutter(camera))
        for state in in_time.states if in_time else ():
            solved(state)
    except CameraError as error:
        message = f"while the shutter is open {error.what}"
        yield problem(camera.GetAttribute("plen:camera:focusDistance"), "out-of-reach", message, hint=error.hint)
        return
    except (PipelineError, ArithmeticError) as error:
        yield of_reader(camera, error)
        return
    if in_time is None:
        return
    wishes = [name for name in _NOT_IN_TIME if read(camera, name)]
    wishes += [_DERIVATIVES] if target_paths(camera.GetRelationship(_DERIVATIVES)) else []
    wishes += ["plen:image:labels"] if "flow" in (read(camera, "plen:image:labels") or ()) else []
    for name in wishes:
        what = '"flow" among the labels' if name.endswith("labels") else f'"{name}"'
        message = f"{what} is not supported for a lens or a sensor that changes while the shutter is open"
        yield problem(
            camera.GetProperty(name), "not-yet-supported", message, hint="leave it out, or let them stand still"
        )
