"""Warnings about lamps that light nothing and targets that no lamp reaches: images would be black, or nearly so.

This check works on records, after all other checks. It asks where lamps shine; what stands in between is not asked.
"""

import math
from collections.abc import Iterator

import numpy as np
from pxr import Usd

from pipeline.frames import apply
from pipeline.records.shapes import Float64
from pipeline.render.lighting.records import Lamp
from pipeline.scene.dataset import Dataset, Frame, TargetEntry
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.spelling import frames_in_words

_POINTS = 64
"""Most points of a target that are asked."""
_DIRECTED = "rects, disks and distant lamps shine along their -Z; the front of a target is its +Z"


def check_shone(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """A warning for each lamp without light, each lamp around a camera, and each target that no lamp shines on."""
    for entry in dataset.lamps:
        prim = stage.GetPrimAtPath(entry.prim_path)
        if not any(entry.lamp.radiance):
            hint = "raise inputs:intensity, lighten inputs:color, or take the lamp out"
            message = f'"{prim.GetName()}" is a lamp without light: its radiance is 0'
            yield problem(prim, "dark-lamp", message, hint=hint, severity="warning")
        for camera in _inside(dataset, entry.prim_path, entry.lamp):
            message = f'"{camera}" stands inside of this lamp: its images show the lamp and nothing else'
            yield problem(
                prim, "lamp-around-camera", message, hint="move the lamp, or make it smaller", severity="warning"
            )
    bright = {entry.prim_path: entry.lamp for entry in dataset.lamps if any(entry.lamp.radiance)}
    for target in dataset.targets if bright else ():
        dark = [frame.number for frame in dataset.frames if not _is_reached(target, frame, bright)]
        if dark:
            prim = stage.GetPrimAtPath(target.prim_path)
            message = (
                f'no lamp shines on the front of "{prim.GetName()}" in {len(dark)} of {len(dataset.frames)} frames: '
                f"{frames_in_words(dark)}"
            )
            yield problem(
                prim, "unlit", message, hint=f"turn a lamp, or add a DomeLight: {_DIRECTED}", severity="warning"
            )


def _inside(dataset: Dataset, path: str, lamp: Lamp) -> list[str]:
    """Cameras whose aperture stop, the origin of their frame, lies in a lamp in any frame."""
    if lamp.kind not in ("sphere", "cylinder"):
        return []
    found = dict[str, None]()
    for frame in dataset.frames:
        for name, pose in frame.camera_from_world.items() if path in frame.world_from_lamp else ():
            x, y, z = (np.linalg.inv(np.array(pose) @ np.array(frame.world_from_lamp[path])))[:3, 3]
            a, b = lamp.size
            if math.hypot(x, y, z) < a if lamp.kind == "sphere" else abs(x) < a and math.hypot(y, z) < b:
                found[name] = None
    return list(found)


def _is_reached(target: TargetEntry, frame: Frame, lamps: dict[str, Lamp]) -> bool:
    """Whether light of any lamp that is visible in a frame falls on the front of any point of a target."""
    points = target.target.points()
    some = np.unique(np.linspace(0, len(points.kinds) - 1, min(_POINTS, len(points.kinds))).astype(int))
    if not len(some):
        return True
    pose = np.array(frame.world_from_target[target.name])
    places, fronts = apply(pose, points.position_mm[some]), points.plane_axes[some][:, :, 2] @ pose[:3, :3].T
    return any(
        _shines(lamps[path], np.array(matrix), places, fronts)
        for path, matrix in frame.world_from_lamp.items()
        if path in lamps
    )


def _shines(
    lamp: Lamp,
    world_from_lamp: Float64[np.ndarray, "4 4"],
    places_mm: Float64[np.ndarray, "n 3"],
    fronts: Float64[np.ndarray, "n 3"],
) -> bool:
    """Whether light of a lamp falls on the front of any of some places, if nothing is in between."""
    z, (a, b) = world_from_lamp[:3, 2], lamp.size
    if lamp.kind == "dome":
        return True
    if lamp.kind == "distant":
        return bool((fronts @ z > -math.sin(min(a, math.pi / 2))).any())
    faces = (places_mm - world_from_lamp[:3, 3]) @ z < 0 if lamp.kind in ("rect", "disk") else True
    reach = math.hypot(a, b)  # the sphere around the lamp: which parts of it a place sees is not asked
    return bool((faces & (np.sum((world_from_lamp[:3, 3] - places_mm) * fronts, axis=1) > -reach)).any())
