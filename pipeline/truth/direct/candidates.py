"""Candidates: microlenses that may see a target point, and rough image positions, by tracing the point forward
through the pupil.

Points are in the vision frame. The forward trace uses the lens frame with its origin at the stop: (x, -y, -z) of the
vision frame.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.micro_images.centres import NOBODY, MicroImages, Nearby
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import SEMI_DIAMETER_SQUARED, towards_sensor
from pipeline.records.shapes import Float64, Int64

_FLIP = np.array([1.0, -1.0, -1.0])
"""Signs of x, y and z that convert between the vision frame and the lens frame."""
_FAN, _WIDE_FAN = 16, 96
"""Rays along the diameter of a fan: towards the entrance pupil, and, if none of them passes, towards the whole front
surface, of which the pupil may be a small part.
"""
_PUPIL_SLACK = 1.3
"""Radius of the fan over that of the paraxial entrance pupil [1]: off the axis the real pupil moves and grows."""
_REACH_PX, _BLUR_SHARE = 4.0, 0.25
"""Search radius around a guess [px], and its part that grows with the width of the blur [1]: observed errors of
guesses were up to 1.5 px behind microlenses, and a tenth of the blur's width without them.
"""
_CELL_SLACK = 0.3
"""A guess may be this many pitches farther from the centre of its own micro-image than from the nearest one."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Pairs of a point and a microlens, or of a point and NO_MICROLENS.

    Attributes
    ----------
    point, microlens : (n,) int64
    x_px : (n, 2) float64
        Approximate image position of the point.
    reach_px : (n,) float64
        Radius around it in which the image position may lie.
    rays : int
        Number of rays traced to find the candidates.
    """

    point: Int64[np.ndarray, "n"]
    microlens: Int64[np.ndarray, "n"]
    x_px: Float64[np.ndarray, "n 2"]
    reach_px: Float64[np.ndarray, "n"]
    rays: int


def candidates(rig: Rig, points_mm: Float64[np.ndarray, "n 3"]) -> Candidates:
    """All candidates of points (p, 3); a point whose light does not pass the lens has none."""
    tracer, images = rig.tracer, rig.images
    point, microlens, guess, reach, rays = [], [], [], [], 0
    vertices = None if images is None else Nearby(tracer.vertices_mm)
    table, fans = towards_sensor(tracer.camera.prescription), _fans(tracer)
    for number, p in enumerate(points_mm):
        crossing, slope, traced = _footprint(tracer, table, fans, p)
        rays += traced
        if not len(crossing):
            continue
        if images is None or vertices is None:
            seen, x = np.array([NO_MICROLENS]), crossing.mean(axis=0, keepdims=True)
            blur_px = np.ptp(crossing, axis=0).max() / tracer.camera.sensor.pitch_mm
        else:
            blur_px = 0.0
            seen, x = _through_microlenses(tracer, images, vertices, crossing, slope)
        point.append(np.full(len(seen), number))
        microlens.append(seen)
        guess.append(tracer.pixels_at(x))
        reach.append(np.full(len(seen), _REACH_PX + _BLUR_SHARE * blur_px))
    if not point:
        return Candidates(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), rays)
    behind, x_px, reach_px = (np.concatenate(parts) for parts in (microlens, guess, reach))
    return Candidates(np.concatenate(point), behind, x_px, reach_px, rays)


def _fans(tracer: Tracer) -> list[np.ndarray]:
    """Points at which rays are aimed, (n, 3) each: on the paraxial entrance pupil, then on the whole front surface."""
    table, pupil = towards_sensor(tracer.camera.prescription), first_order(tracer.camera.prescription).entrance_pupil
    fans = []
    for z, reach, count in (
        (-pupil.z_mm, _PUPIL_SLACK * pupil.diameter_mm / 2, _FAN),
        (table[0, 0], np.sqrt(table[0, SEMI_DIAMETER_SQUARED]), _WIDE_FAN),
    ):
        u = np.linspace(-reach, reach, count)
        aim = np.stack([*(axis.ravel() for axis in np.meshgrid(u, u)), np.full(count * count, z)], axis=1)
        fans.append(aim[np.hypot(aim[:, 0], aim[:, 1]) <= reach])
    return fans


def _footprint(
    tracer: Tracer, table: np.ndarray, fans: list[np.ndarray], point_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray, int]:
    """Crossings of a point's rays with the plane of the sensor or array, and slopes there; vision x and y, (n, 2)
    each.

    Rays of the first fan of which any ray passes.
    """
    rays = 0
    for aim in fans:
        position = np.repeat((point_mm * _FLIP)[None], len(aim), axis=0)
        direction = aim - position
        direction *= np.sign(direction[:, 2:]) / np.linalg.norm(direction, axis=1, keepdims=True)
        alive = np.ones(len(aim))
        trace_rays(table, position, direction, alive)
        rays += len(aim)
        passed = alive > 0
        if passed.any():
            slope = direction[passed, :2] / direction[passed, 2:]
            crossing = position[passed, :2] + (-tracer.film_z_mm - position[passed, 2:]) * slope
            return crossing * _FLIP[:2], slope * _FLIP[:2], rays
    return np.zeros((0, 2)), np.zeros((0, 2)), rays


def _through_microlenses(
    tracer: Tracer, images: MicroImages, vertices: Nearby, crossing: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Microlenses lit by a footprint, and positions where the rays through their vertices meet the sensor."""
    array = tracer.camera.microlenses
    assert array is not None
    spacing = np.ptp(crossing, axis=0).max() / (_FAN / 2)
    reached = vertices.within(crossing, array.pitch_mm + spacing)[1]
    seen = np.unique(reached[reached != NOBODY])
    # Slopes are nearly linear in the crossing; if all rays meet in a point, their mean is used.
    q, s = crossing - crossing.mean(axis=0), slope - slope.mean(axis=0)
    soft = np.eye(2) * len(q) * (0.1 * array.pitch_mm) ** 2
    along = np.linalg.solve(q.T @ q + soft, q.T @ s)
    vertex = tracer.vertices_mm[seen]
    x = vertex + array.distance_mm * (slope.mean(axis=0) + (vertex - crossing.mean(axis=0)) @ along)
    farther = np.hypot(*(x - images.centre_mm[seen]).T) - images.nearby.nearest(x)[0][:, 0]
    near = farther <= _CELL_SLACK * array.pitch_mm
    return seen[near], x[near]
