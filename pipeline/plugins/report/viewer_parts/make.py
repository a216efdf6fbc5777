"""Task `parts`: lens elements, stop, sensor, microlenses and rays of a camera as a layer for USD viewers.

They are the shapes of the 3-D view, as meshes and curves. It stands alone because no other task needs USD.
"""

import math
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.lattice import cell
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.camera.tracer import Tracer
from pipeline.frames import apply
from pipeline.plugins.report.shapes import SurfaceShape, ray_fans, sensor_corners_mm, surface_shapes
from pipeline.plugins.report.viewer_parts.params import PARTS, Parts
from pipeline.products.cameras import Inputs, focused_camera
from pipeline.scene.write.parts import Part, PartCopies, PartMesh, PartRays, parts_text

_AROUND = 48
"""Corners of a circle: smooth to the eye."""
_GLASS, _DARK, _FILM, _ARRAY = (0.43, 0.7, 0.9), (0.08, 0.09, 0.1), (0.5, 0.35, 0.8), (0.75, 0.6, 0.85)
"""Colours of glass, stop, sensor and microlenses, as in the 3-D view."""
_FANS = {"centre": (0.9, 0.25, 0.2), "top left": (0.15, 0.6, 0.35), "bottom right": (0.2, 0.5, 0.88)}
"""Colours of the fans by their places: those of the drawing of the lens."""


def parts(params: Parts, inputs: Inputs, out: Path) -> None:
    """Write parts.usda."""
    text = parts_text(camera_parts(focused_camera(inputs)), params.meters_per_unit, params.up_axis)
    (out / PARTS).write_text(text, encoding="utf-8", newline="\n")


def camera_parts(camera: Camera) -> Iterator[Part]:
    """Lens elements, stop, sensor and microlenses of a camera, and fans of rays from the centre and two corners."""
    shapes = surface_shapes(camera.prescription)
    for i, (front, behind) in enumerate(pairwise(shapes)):
        if front.has_glass_behind:
            yield _element(f"Element{i + 1}", front, behind)
    yield _stop(shapes)
    yield _mesh("Sensor", sensor_corners_mm(camera), [(0, 1, 2, 3)], _FILM, 1.0)
    if camera.microlenses is not None:
        yield _microlenses(Tracer(camera), camera.microlenses)
    for i, fan in enumerate(ray_fans(camera)):
        if fan.rays:
            yield PartRays(name=f"Rays{i + 1}", paths_mm=tuple(map(np.array, fan.rays)), colour=_FANS[fan.place])


def _element(name: str, front: SurfaceShape, behind: SurfaceShape) -> PartMesh:
    """A solid of glass: two poles on the axis, and rings from the one to the other over the rims."""
    profiles = [np.column_stack([shape.height_mm, shape.z_mm]) for shape in (front, behind)]
    rings = np.concatenate([profiles[0][1:], profiles[1][:0:-1]])
    angle = np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    around = [np.column_stack([height * circle, np.full(_AROUND, z)]) for height, z in rings.tolist()]
    poles = [np.array([[0.0, 0.0, profile[0, 1]]]) for profile in profiles]
    half = (len(profiles[0]) - 1) * _AROUND
    points = [*poles, *around]
    moved = [np.array(shape.moved) for shape in (front, behind)]
    placed = np.concatenate(points)
    placed[0] = apply(moved[0], placed[:1])[0]
    placed[1] = apply(moved[1], placed[1:2])[0]
    placed[2 : 2 + half] = apply(moved[0], placed[2 : 2 + half])
    placed[2 + half :] = apply(moved[1], placed[2 + half :])
    # Triangles from the front pole to the first ring, quadrilaterals from ring to ring, triangles to the rear pole
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


def _stop(shapes: tuple[SurfaceShape, ...]) -> PartMesh:
    """A flat ring around the opening, somewhat wider than the lens."""
    stop = next(shape for shape in shapes if shape.is_stop)
    widest = 1.05 * max(shape.height_mm[-1] for shape in shapes)
    angle = np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(_AROUND)])
    opening, rim = stop.height_mm[-1] * circle, max(widest, 1.3 * stop.height_mm[-1]) * circle
    points = np.concatenate([opening, rim])
    points[:, 2] = stop.z_mm[0]
    steps = [(step, (step + 1) % _AROUND) for step in range(_AROUND)]
    faces: list[tuple[int, ...]] = [(step, _AROUND + step, _AROUND + after, after) for step, after in steps]
    return _mesh("Stop", apply(np.array(stop.moved), points), faces, _DARK, 1.0)


def _microlenses(tracer: Tracer, array: MicrolensArray) -> PartCopies:
    corners = np.pad(-cell(array), ((0, 0), (0, 1)))
    shape = _mesh("Cell", corners, [tuple(range(len(corners)))], _ARRAY, 0.6)
    return PartCopies(
        name="Microlenses", mesh=shape, origins_mm=tracer.camera.in_vision(tracer.on_film(tracer.vertices_mm))
    )


def _mesh(
    name: str, points: np.ndarray, faces: list[tuple[int, ...]], colour: tuple[float, float, float], opacity: float
) -> PartMesh:
    return PartMesh(
        name=name,
        points_mm=points,
        counts=tuple(map(len, faces)),
        corners=tuple(corner for face in faces for corner in face),
        colour=colour,
        opacity=opacity,
    )
