"""Guides of cameras for USD viewers: the shapes of the 3-D view as meshes and curves."""

import hashlib
import math
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.lattice import cell
from pipeline.camera.tracer import Tracer
from pipeline.files.png import write_png
from pipeline.frames import apply
from pipeline.report.page.records import SurfaceShape
from pipeline.report.page.shapes import ray_fans, surface_shapes
from pipeline.scene.dataset import TargetEntry
from pipeline.scene.write.guides import CameraGuides, GuideMesh, GuideRays, Sheet
from pipeline.targets.preview import preview_faces, preview_picture
from pipeline.targets.target import Target

_AROUND = 48
"""Corners of a circle: smooth to the eye."""
_MOST_MICROLENSES = 20_000
"""Microlenses that are shown one by one; of more only the outline of the array is."""
_NAME = 12
"""Digits of a digest in the name of a picture, which stands for its pixels."""
_SHEET_PX = 1024
"""Edge of the picture of a flat board [px]: its squares stay sharp on a whole screen."""
_GLASS, _DARK, _FILM, _ARRAY = (0.43, 0.7, 0.9), (0.08, 0.09, 0.1), (0.5, 0.35, 0.8), (0.75, 0.6, 0.85)
"""Colours of glass, stop, sensor and microlenses, as in the 3-D view."""
_FANS = {"centre": (0.9, 0.25, 0.2), "top left": (0.15, 0.6, 0.35), "bottom right": (0.2, 0.5, 0.88)}
"""Colours of the fans by their places: those of the drawing of the lens."""


def camera_guides(prim_path: str, camera: Camera) -> CameraGuides:
    """Lens elements, stop, sensor, microlenses and rays of a camera."""
    shapes = surface_shapes(camera.prescription)
    meshes = [
        _element(f"Element{i + 1}", front, behind)
        for i, (front, behind) in enumerate(pairwise(shapes))
        if front.has_glass_behind
    ]
    meshes += [_stop(shapes), _sensor(camera)]
    tracer = Tracer(camera)
    if tracer.lattice is not None and len(tracer.vertices_mm) <= _MOST_MICROLENSES:
        meshes.append(_microlenses(tracer))
    rays = tuple(
        GuideRays(name=f"Rays{i + 1}", paths_mm=tuple(map(np.array, fan.rays)), colour=_FANS[fan.place])
        for i, fan in enumerate(ray_fans(camera))
        if fan.rays
    )
    return CameraGuides(prim_path=prim_path, meshes=tuple(meshes), rays=rays)


def board_sheet(target: TargetEntry, report: Path) -> Sheet | None:
    """The picture of a target, written into the report; None of a mesh."""
    if not isinstance(target.target, Target):
        return None
    grey = np.rint(255 * np.clip(preview_picture(target.target, _SHEET_PX), 0, 1)).astype(np.uint8)
    picture = f"images/{target.name}.{hashlib.sha256(grey).hexdigest()[:_NAME]}.png"
    if not (report / picture).is_file():
        write_png(report / picture, grey)
    return Sheet(prim_path=target.prim_path, picture=picture, places=preview_faces(target.target).sheet)


def _element(name: str, front: SurfaceShape, behind: SurfaceShape) -> GuideMesh:
    """A solid of glass: two poles on the axis, and rings from the one to the other over the rims."""
    profiles = [np.column_stack([one.height_mm, one.z_mm]) for one in (front, behind)]
    rings = np.concatenate([profiles[0][1:], profiles[1][:0:-1]])
    angle = np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    around = [np.column_stack([height * circle, np.full(_AROUND, z)]) for height, z in rings.tolist()]
    poles = [np.array([[0.0, 0.0, one[0, 1]]]) for one in profiles]
    half = (len(profiles[0]) - 1) * _AROUND
    points = [*poles, *around]
    moved = [np.array(one.moved) for one in (front, behind)]
    placed = np.concatenate(points)
    placed[0], placed[1] = apply(moved[0], placed[:1])[0], apply(moved[1], placed[1:2])[0]
    placed[2 : 2 + half] = apply(moved[0], placed[2 : 2 + half])
    placed[2 + half :] = apply(moved[1], placed[2 + half :])
    faces: list[tuple[int, ...]] = []
    for step in range(_AROUND):
        after = (step + 1) % _AROUND
        faces.append((0, 2 + step, 2 + after))
        for ring in range(len(rings) - 1):
            low, high = 2 + ring * _AROUND, 2 + (ring + 1) * _AROUND
            faces.append((low + step, high + step, high + after, low + after))
        last = 2 + (len(rings) - 1) * _AROUND
        faces.append((1, last + after, last + step))
    return _mesh(name, placed, faces, _GLASS, 0.35)


def _stop(shapes: tuple[SurfaceShape, ...]) -> GuideMesh:
    """A dark ring around the opening."""
    stop = next(one for one in shapes if one.is_stop)
    widest = 1.05 * max(one.height_mm[-1] for one in shapes)
    angle = np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_AROUND)])
    opening, rim = stop.height_mm[-1] * circle, max(widest, 1.3 * stop.height_mm[-1]) * circle
    points = np.concatenate([opening, rim])
    points[:, 2] = stop.z_mm[0]
    steps = [(step, (step + 1) % _AROUND) for step in range(_AROUND)]
    faces: list[tuple[int, ...]] = [(step, _AROUND + step, _AROUND + after, after) for step, after in steps]
    return _mesh("Stop", apply(np.array(stop.moved), points), faces, _DARK, 1.0)


def _sensor(camera: Camera) -> GuideMesh:
    sensor = camera.sensor
    half = np.array(sensor.size_mm) / 2
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = signs * half + np.array([sensor.offset_x_mm, sensor.offset_y_mm])
    points = np.column_stack([corners, np.full(4, -camera.sensor_distance_mm)])
    return _mesh("Sensor", points, [(0, 1, 2, 3)], _FILM, 1.0)


def _microlenses(tracer: Tracer) -> GuideMesh:
    """A polygon per cell."""
    array = tracer.camera.microlenses
    assert array is not None
    corners = -cell(array)
    points = (tracer.vertices_mm[:, None] + corners).reshape(-1, 2)
    each = len(corners)
    faces = [tuple(range(first, first + each)) for first in range(0, len(points), each)]
    return _mesh("Microlenses", tracer.on_film(points), faces, _ARRAY, 0.6)


def _mesh(
    name: str, points: np.ndarray, faces: list[tuple[int, ...]], colour: tuple[float, float, float], opacity: float
) -> GuideMesh:
    return GuideMesh(
        name=name,
        points_mm=points,
        counts=tuple(map(len, faces)),
        corners=tuple(corner for face in faces for corner in face),
        colour=colour,
        opacity=opacity,
    )
