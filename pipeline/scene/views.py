"""Views: the visible part of a target in every frame of a camera, found with a few rays per point
(`camera.figures.outlook`).
"""

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pipeline.camera.figures.outlook import Fate, Outlook, behind_microlenses_px, covered_mm, outlook, pupil_points_mm
from pipeline.camera.parts.camera import Camera
from pipeline.scene.dataset import Dataset, Frame, TargetEntry

if TYPE_CHECKING:
    from pipeline.render.surroundings import Surroundings

_POINTS = 8_000
"""Most points of a target that are examined in all frames together; of more, some in each frame."""
_HIDING = 500
"""Most frames that are examined for something in front of a target; of more, some of them."""
HIDDEN, MERGED = len(Fate), len(Fate) + 1
"""Fates in addition to those of `Fate`. HIDDEN: the light would reach the image but something stands in its way.
MERGED: it does reach the image, but all points of the target blur into one grey.
"""
_LEAST_PX, _WIDEST_BLUR = 1.0, 1.72
"""Points nearer than this in the image [px] count as one; if the blur exceeds their distance by this factor, no
points can be distinguished: a disc as wide as that takes all contrast from the fundamental wave of a checkerboard, and
a wider one leaves an eighth of it at most, with black for white (2 J1(x) / x at x = pi 1.72 / sqrt(2)).
"""
_NEIGHBOURS = 64
"""Number of points whose median gives the distance of neighbouring points."""


@dataclass(frozen=True, slots=True)
class View:
    """The part of a target that a camera sees.

    Attributes
    ----------
    numbers : tuple of int
        The frames.
    share : (frames,) float64
        Points that are seen over those that face the camera.
    fates : list of int or None
        Per frame the fate of most points that are not seen, among those that face the camera if any is seen; None if
        all are seen.
    points_mm, front : (frames, n, 3) float64
        Positions and normals, vision frame.
    spacing_px : (frames,) float64
        Distance of neighbouring points of one kind that are seen, of the kind where it is largest.
    outlook : Outlook
        Outlook of all frames and points.
    """

    numbers: tuple[int, ...]
    share: np.ndarray
    fates: list[int | None]
    points_mm: np.ndarray
    front: np.ndarray
    spacing_px: np.ndarray
    outlook: Outlook


def look(dataset: Dataset, name: str, camera: Camera, number: int) -> View:
    """The view of a camera of a dataset on the target with this index."""
    frames, target = dataset.frames, dataset.targets[number]
    points, front, kinds = _points_of(target, len(frames))
    poses = np.array([_pose(frame, name, target.name) for frame in frames])
    places = np.einsum("fij,nj->fni", poses[:, :3, :3], points) + poses[:, None, :3, 3]
    fronts = np.einsum("fij,nj->fni", poses[:, :3, :3], front)
    found = outlook(camera, places, fronts)
    fate = found.fate
    if len(dataset.targets) + len(dataset.occluders) > 1:
        for index in range(0, len(frames), 1 + len(frames) // _HIDING):
            seen = np.flatnonzero(fate[index] == Fate.SEEN)
            around = surroundings(dataset, frames[index], name)
            hidden = _hidden(around, camera, number, places[index, seen], fronts[index, seen])
            fate[index, seen[hidden]] = HIDDEN
    spacing = np.full(len(frames), np.inf)
    for index in range(len(frames)):
        seen = fate[index] == Fate.SEEN
        if seen.any():
            alike = (places[index, seen & (kinds == kind)] for kind in set(kinds[seen]))
            spacing[index] = max(_spacing_px(camera, points) for points in alike)
            if spacing[index] < max(_LEAST_PX, np.median(found.blur_px[index, seen]) / _WIDEST_BLUR):
                fate[index, seen] = MERGED
    share = (fate == Fate.SEEN).sum(axis=1) / np.maximum(1, (fate != Fate.AWAY).sum(axis=1))
    fates = [_missed(row) for row in fate]
    return View(tuple(frame.number for frame in frames), share, fates, places, fronts, spacing, found)


def _missed(fate: np.ndarray) -> int | None:
    missed = fate[fate != Fate.SEEN]
    if len(missed) < len(fate):
        missed = missed[missed != Fate.AWAY]
    return Counter(missed.tolist()).most_common(1)[0][0] if len(missed) else None


def _spacing_px(camera: Camera, points_mm: np.ndarray) -> float:
    """Paraxial distance of neighbouring points [px] in the image, or in a micro-image; infinite for fewer than two."""
    if len(points_mm) < 2:
        return float("inf")
    some = np.linspace(0, len(points_mm) - 1, min(_NEIGHBOURS, len(points_mm))).astype(int)
    apart = np.linalg.norm(points_mm[some, None, :2] - points_mm[None, :, :2], axis=2)
    apart[np.arange(len(some)), some] = np.inf
    spacing_mm, z_mm = float(np.median(apart.min(axis=1))), np.mean(points_mm[:, 2])
    if camera.microlenses:
        return spacing_mm * float(behind_microlenses_px(camera, camera.microlenses, z_mm[None])[1][0])
    return spacing_mm * camera.sensor.width_px / covered_mm(camera, float(z_mm))[0]


def _points_of(entry: TargetEntry, frames: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of a target and their normals, (n, 3) each, target frame, and kinds (n,); of very many a selection."""
    points = entry.target.points()
    count = min(len(points.kinds), max(1, _POINTS // max(1, frames)))
    kept = np.unique(np.linspace(0, len(points.kinds) - 1, count).astype(int))
    return points.position_mm[kept], points.plane_axes[kept][:, :, 2], np.array(points.kinds)[kept]


def _pose(frame: Frame, camera: str, target: str) -> np.ndarray:
    """vision_from_target, (4, 4)."""
    return np.array(frame.camera_from_world[camera]) @ np.array(frame.world_from_target[target])


def surroundings(dataset: Dataset, frame: Frame, name: str) -> "Surroundings":
    """All targets and occluders of a frame, in the vision frame of a camera."""
    from pipeline.render.surroundings import Surroundings  # loads Embree, which few datasets need

    targets = [(entry.target, _pose(frame, name, entry.name)) for entry in dataset.targets]
    vision = np.array(frame.camera_from_world[name])
    occluders = [
        (entry.occluder, vision @ np.array(frame.world_from_occluder[entry.prim_path]))
        for entry in dataset.occluders
        if entry.prim_path in frame.world_from_occluder
    ]
    return Surroundings(targets, occluders)


def _hidden(
    surroundings: "Surroundings", camera: Camera, number: int, points_mm: np.ndarray, front: np.ndarray
) -> np.ndarray:
    """Points of a target that something hides from every tried place of the entrance pupil, (n,) bool."""
    hidden = surroundings.may_hide(points_mm, front)
    front_mm = -camera.prescription.vertices_from_stop_mm[0]
    for pupil in pupil_points_mm(camera) if hidden.any() else ():
        way = points_mm - pupil
        way *= np.sign(way[:, 2:]) / np.linalg.norm(way, axis=1, keepdims=True)
        start = points_mm + ((front_mm - points_mm[:, 2]) / way[:, 2])[:, None] * way
        hidden &= surroundings.hides(number, points_mm, front, start, way)
    return hidden
