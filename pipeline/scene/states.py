"""States of cameras whose lens or sensor changes from frame to frame; each holds while a shutter is open."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pxr import Usd

from pipeline.channel_names import name_in_state
from pipeline.motion import NODES, node_times
from pipeline.scene.camera import read_camera_entry
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.shutters import check_shutter, codes_per_second, pieces_s, read_shutter
from pipeline.scene.usd.curves import bends
from pipeline.scene.usd.overrides import at_code, varying
from pipeline.scene.usd.poses import frame_numbers
from pipeline.scene.usd.problems import Problem, of_reader, problem
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, numbers, read, target
from pipeline.scene.windows import standing_windows, windows_in_frame
from pipeline.spelling import frames_in_words

_MARGIN = 1e-6
"""Time at both ends of an exposure in which a state may already change [time codes]: more than the rounding of seconds
to codes, and a millionth of the change from one frame to the next."""
_HELD = 1e-9
"""Relative change of a number that holds [1]: between equal samples USD rounds."""


def read_camera_entries(stage: Usd.Stage) -> tuple[CameraEntry, ...]:
    """Every camera with PlenCameraAPI on a stage that passed the checks, in stage order, named relative to its root;
    behind the world-space windows of the first frame.
    """
    root = stage.GetDefaultPrim() or stage.GetPseudoRoot()
    seed = read(root, "plen:seed") or 0
    number = next(iter(frame_numbers(root)), 0)
    cameras = filter(is_camera, stage.Traverse())
    return tuple(_with_windows(read_camera_entry(prim, root, seed), prim, number) for prim in cameras)


def is_camera(prim: Usd.Prim) -> bool:
    """Whether a prim is a Camera with PlenCameraAPI."""
    return bool(prim.IsA("Camera") and prim.HasAPI("PlenCameraAPI"))


def read_states(
    prim: Usd.Prim, root: Usd.Prim, seed: int, numbers: Sequence[int]
) -> list[tuple[CameraEntry, list[int]]]:
    """A camera in each state of its lens and sensor, and the frames that have it; most cameras are in one state."""
    states = list[tuple[CameraEntry, list[int]]]()
    for number in numbers if changes(prim) or standing_windows(prim) else numbers[:1]:
        camera = at_code(prim, number)
        entry = _with_windows(read_camera_entry(camera, root, seed), camera, number)
        frames = next((frames for state, frames in states if state == entry), None)
        if frames is None:
            states.append((entry, [number]))
        else:
            frames.append(number)
    if len(states) < 2:
        return [(entry, list(numbers)) for entry, _ in states]
    return [(replace(entry, name=name_in_state(entry.name, frames[0])), frames) for entry, frames in states]


def _with_windows(entry: CameraEntry, prim: Usd.Prim, number: int) -> CameraEntry:
    """A camera behind the world-space windows of a frame, for all wavelengths of its records."""
    nodes = (node for channel in entry.channels for node in (channel.middle, *channel.nodes))
    wavelengths_nm = dict.fromkeys([entry.wavelength_nm, *(node.wavelength_nm for node in nodes)])
    return replace(entry, windows=windows_in_frame(prim, number, list(wavelengths_nm)))


@read_once
def changes(camera: Usd.Prim) -> bool:
    """Whether any attribute of a camera, its lens, sensor or microlenses varies in time."""
    return bool(_varying(camera))


def _varying(camera: Usd.Prim) -> list[Usd.Attribute]:
    """Attributes of a camera, its lens, sensor and microlenses that have several values in time."""
    links = (("lens", "PlenLens"), ("sensor", "PlenSensor"), ("microlenses", "PlenMicrolensArray"))
    parts = [target(camera, f"plen:camera:{name}", kind) for name, kind in links]
    prims = [camera, *(prim for part in parts if part for prim in Usd.PrimRange(part))]
    return [attribute for prim in prims for attribute in varying(prim)]


def check_steady_while_open(camera: Usd.Prim, codes: Sequence[float]) -> Iterator[Problem]:
    """Problems of numbers of a lens, a sensor or a focus that change while the shutter is open, one for all frames."""
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    size_px: Any = read(sensor, "plen:resolution") if sensor else None
    varying = [attribute for attribute in _varying(camera) if not attribute.GetName().startswith("plen:shutter:")]
    # Collect the changes of each attribute, frame by frame.
    changed = dict[Usd.Attribute, list[tuple[int, str]]]()
    for code in codes if size_px and varying else ():
        camera_then = at_code(camera, code)
        if any(check_shutter(camera_then)) or (shutter := read_shutter(camera_then)) is None:
            continue
        opens, closes = (code + time_s * codes_per_second(camera) for time_s in shutter.window_s(size_px))
        for attribute in varying:
            try:
                change = _change(attribute, code, opens, closes)
            except UnreadableValue as error:
                yield of_reader(camera, error)
                return
            if change:
                changed.setdefault(attribute, []).append((int(code), change))
    for attribute, changes_in_frames in changed.items():
        frames = frames_in_words([number for number, _ in changes_in_frames])
        number, change = changes_in_frames[0]
        message = (
            f'"{attribute.GetName()}" does not hold while the shutter of <{camera.GetPath()}> is open in {frames}:'
            f" {change}{f' in frame {number}' if len(changes_in_frames) > 1 else ''}"
        )
        hint = "lens, sensor and focus have a state per frame: hold each by two equal samples, or by a held spline"
        yield problem(attribute, "changes-while-open", message, hint=hint)


def _change(attribute: Usd.Attribute, code: float, opens: float, closes: float) -> str | None:
    """The value of an attribute at a time code, and that farthest from it while a shutter is open, in words; None if it
    holds. Both sides of each bend count, and what curves do between.
    """
    margin = min(_MARGIN, (closes - opens) / 4)
    first, last = opens + margin, closes - margin
    edges = pieces_s((first, last), bends([attribute], first, last))
    times = [*map(Usd.TimeCode, node_times(edges, NODES).ravel().tolist())]
    times += map(Usd.TimeCode.PreTime, edges[1:-1].tolist())
    stated = numbers(attribute.Get(code))
    values = [numbers(attribute.Get(time)) for time in times]
    deviations = [float(np.abs(value - stated).max(initial=0.0)) for value in values]
    farthest = values[int(np.argmax(deviations))]
    if max(deviations) <= _HELD * max(np.abs(stated).max(initial=0.0), np.abs(farthest).max(initial=0.0)):
        return None
    return f"{_in_words(stated)} at the time code, and {_in_words(farthest)} while it is open"


def _in_words(value: np.ndarray) -> str:
    """A number, or several in brackets."""
    text = ", ".join(f"{number:.5g}" for number in value.tolist())
    return text if len(value) == 1 else f"({text})"
