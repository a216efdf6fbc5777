"""Candidates: microlenses that may see a target point, and approximate image positions, by tracing the point forward
through the pupil.

Points are in the vision frame. The forward trace uses the lens frame with its origin at the stop: (x, -y, -z) of the
vision frame. From points beside the lens rays aim at the stop as seen from there: `camera.pupil.from_stop`.

Chief points are image positions by a single ray; the mean of the bundle may differ. Without microlenses it is the ray
through the centre of the stop, the chief ray. Behind a microlens, whose bundle is thin, it is the ray through the
vertex of the microlens, or of the face that is its aperture. Apertures do not block it.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.camera.frozen_pupils import by_x
from pipeline.camera.integrating.polar_hits import single_hits
from pipeline.camera.micro_images.centres import NOBODY, MicroImages, Nearby, vertex_aims
from pipeline.camera.pupil.chief_ray import chief_crossings
from pipeline.camera.pupil.from_stop import is_steep, pupil_fan
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.frames import apply
from pipeline.frames import inverse as inverse_transform
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace
from pipeline.optics.rays import Traced, traced
from pipeline.optics.table import SEMI_DIAMETER_SQUARED, enclosing, motion_of, towards_sensor, unbounded
from pipeline.records.shapes import Float64, Int64

_FLIP = np.array([1.0, -1.0, -1.0])
"""Signs of x, y and z that convert between the vision frame and the lens frame."""
_FAN, _WIDE_FAN = 16, 96
"""Rays along the diameter of a fan: towards the entrance pupil, and, if none of them passes, towards the front surface,
of which the pupil may be a small part."""
_PUPIL_SLACK = 1.3
"""Radius of the fan over that of the paraxial entrance pupil [1]: off the axis the real pupil moves and grows."""
_RIM, _ENOUGH, _FOLLOWED = 2 / 15, 12, 8
"""Width of a fan's outermost ring of rays, over its radius [1]; rays that suffice for the outline of a pupil; most fans
that follow a fan. A pupil that a tilted window before another medium moves by its own width is found by the second."""
_REACH_PX, _BLUR_SHARE = 4.0, 0.25
"""Search radius around a guess [px], and its growth with the width of the blur [1]: observed errors of guesses were up
to 1.5 px behind microlenses, and a tenth of the blur's width without them."""
_CELL_SLACK = 0.3
"""Excess distance of a guess from the centre of its own micro-image over the nearest one, in pitches; or the blur of
the point by its microlens, if that is wider."""
_STEPS = 20
"""Most steps: the Jacobian is kept, so each step reduces the error by a constant large factor."""
_DONE_PX, _ACCEPTED_PX = 1e-10, 1e-7
"""Largest last step that ends the search of all points, and largest last step of an accepted point [px]: rounding may
keep a point from the former; the latter is a ten-thousandth of the default claim."""
_AIM_STEP_MM = 1e-3
"""Step of finite differences towards the stop."""
_AT_CENTRE = 0.1
"""Distance from the centre of the stop, over its semi-diameter, within which a ray is a chief ray for aims around
it."""
_DIFFERENCE_PX = 0.05
"""Half the step of finite differences [px]: chief rays bend little over it, and rounding costs few digits."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Pairs of a point and a microlens, or of a point and NO_MICROLENS."""

    point: Int64[np.ndarray, "n"]
    microlens: Int64[np.ndarray, "n"]
    # approximate image position of the point, and the radius around it in which the position may lie
    x_px: Float64[np.ndarray, "n 2"]
    reach_px: Float64[np.ndarray, "n"]
    rays: int  # number of rays traced to find the candidates


def candidates(rig: Rig, points_mm: Float64[np.ndarray, "n 3"]) -> Candidates:
    """All candidates of points; a point whose light does not pass the lens has none."""
    tracer, images = rig.tracer, rig.images
    prescription = tracer.camera.prescription
    vertices = None if images is None else Nearby(tracer.vertices_mm)
    # Blades and obstructions may leave slivers between the rays of a fan: apertures are replaced by their circles.
    table = enclosing(towards_sensor(prescription))
    fans = _fans(tracer)
    steep = is_steep(prescription, points_mm)
    pupil = pupil_fan(prescription)
    rays = 0
    # Columns of the result, begun with arrays of no rows.
    points = [np.zeros(0, np.int64)]
    microlenses = [np.zeros(0, np.int64)]
    guesses_px = [np.zeros((0, 2))]
    reaches_px = [np.zeros(0)]
    for number, point_mm in enumerate(points_mm):
        # Trace the point's light to the sensor, or to the array.
        aims = [pupil.aims(point_mm) * _FLIP] if steep[number] else fans
        crossing, slope, traced_rays = _footprint(tracer, table, aims, point_mm, is_steep=steep[number])
        rays += traced_rays
        if not len(crossing):
            continue
        # Without an array the guess is the middle of its light; with one, each lit microlens has its own.
        if images is None or vertices is None:
            lit = np.array([NO_MICROLENS])
            x_mm = crossing.mean(axis=0, keepdims=True)
            blur_px = np.ptp(crossing, axis=0).max() / tracer.camera.sensor.pitch_mm
        else:
            lit, x_mm = _through_microlenses(tracer, images, vertices, crossing, slope)
            blur_px = 0.0
        points.append(np.full(len(lit), number))
        microlenses.append(lit)
        guesses_px.append(tracer.pixels_at(x_mm))
        reaches_px.append(np.full(len(lit), _REACH_PX + _BLUR_SHARE * blur_px))
    return Candidates(
        np.concatenate(points),
        np.concatenate(microlenses),
        np.concatenate(guesses_px),
        np.concatenate(reaches_px),
        rays,
    )


def _fans(tracer: Tracer) -> list[np.ndarray]:
    """Aim points of rays, (n, 3) each: on the paraxial entrance pupil, then on the front surface."""
    table = towards_sensor(tracer.camera.prescription)
    pupil = first_order(tracer.camera.prescription).entrance_pupil
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
    tracer: Tracer, table: np.ndarray, fans: list[np.ndarray], point_mm: np.ndarray, *, is_steep: bool
) -> tuple[np.ndarray, np.ndarray, int]:
    """Intersections with the plane of the sensor or array, slopes there, film frame, (n, 2) each, and rays traced.

    From the first fan of which any ray passes, or, if none does, from one towards the stop as seen from the point.
    Further fans count where they find light. A fan that passes at its rim, or hardly, is followed by others.
    """
    rays = 0
    further = () if is_steep else _fans_at_stop(tracer, table, fans[0], point_mm)
    for number, fan in enumerate(itertools.chain(fans, further)):
        traced_fan = _trace_fan(table, point_mm, fan, is_steep=is_steep)
        rays += len(fan) if number < len(fans) or traced_fan.passes.any() else 0
        if not traced_fan.passes.any():
            continue
        # Follow the light while it reaches the rim of a fan, or fills little of it.
        for _ in range(_FOLLOWED):
            next_fan = _next_fan(fan, traced_fan.passes)
            if next_fan is None:
                break
            traced_next = _trace_fan(table, point_mm, next_fan, is_steep=is_steep)
            rays += len(next_fan)
            if not traced_next.passes.any():
                break
            fan, traced_fan = next_fan, traced_next
        position = traced_fan.position[traced_fan.passes] * _FLIP
        direction = traced_fan.direction[traced_fan.passes] * _FLIP
        return *tracer.arrivals(position, direction), rays
    return np.zeros((0, 2)), np.zeros((0, 2)), rays


def _trace_fan(table: np.ndarray, point_mm: np.ndarray, aim: np.ndarray, *, is_steep: bool) -> Traced:
    """Rays from a point towards aims, (n, 3), behind the lens, lens frame.

    They leave the point forwards, or towards their aims if the point is steep.
    """
    position = np.repeat((point_mm * _FLIP)[None], len(aim), axis=0)
    direction = aim - position
    forwards = 1.0 if is_steep else np.sign(direction[:, 2:])
    direction *= forwards / np.linalg.norm(direction, axis=1, keepdims=True)
    return trace(table, position, direction)


def _next_fan(aim: np.ndarray, passes: np.ndarray) -> np.ndarray | None:
    """A fan of equal shape about the rays of another that pass; None: its rim is dark, and enough rays pass."""
    offset = aim - aim.mean(axis=0)
    lit = np.flatnonzero(passes)
    # Measure distances over the radius of the fan, a disc or an ellipse: over a disc of radius 1 the variance along any
    # axis is 1/4.
    per_radius = np.linalg.pinv(offset.T @ offset / len(aim)) / 4
    middle = aim[lit].mean(axis=0)
    from_centre, from_middle = (
        np.sqrt(np.einsum("ni,ij,nj->n", part, per_radius, part)).max() for part in (offset[lit], aim[lit] - middle)
    )
    if from_centre < 1 - _RIM and len(lit) >= _ENOUGH:
        return None
    return np.asarray(middle + (_PUPIL_SLACK * from_middle + _RIM) * offset)


def _fans_at_stop(tracer: Tracer, table: np.ndarray, fan: np.ndarray, point_mm: np.ndarray) -> Iterator[np.ndarray]:
    """Points over the entrance pupil as seen from a point, (n, 3), in two guesses.

    First as the pupil moves off the axis; then as windows displace it, by Newton's method without apertures, unless no
    real ray reaches the centre of the stop.
    """
    yield pupil_fan(tracer.camera.prescription).aims(point_mm) * _FLIP
    front = unbounded(table[: tracer.camera.prescription.stop_index + 1])
    stop = tracer.camera.prescription.stop
    start = point_mm * _FLIP
    aim = fan[len(fan) // 2] * (0.0, 0.0, 1.0)
    steps = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for _ in range(_STEPS):
        # Trace three rays to the stop: towards the aim, and towards a small step from it along x and along y.
        aims = aim + _AIM_STEP_MM * steps
        direction = aims - start
        direction *= np.sign(direction[:, 2:]) / np.linalg.norm(direction, axis=1, keepdims=True)
        crossing, _, passes = traced(front, np.repeat(start[None], 3, axis=0), direction)
        local = apply(inverse_transform(motion_of(front[-1])), crossing)[:, :2]
        jacobian = (local[1:] - local[0]).T / _AIM_STEP_MM
        if not passes.all() or not abs(np.linalg.det(jacobian)) > 0:
            return
        # Take the Newton step towards the centre of the stop.
        aim_from_stop = np.linalg.inv(jacobian)
        aim = aim - np.append(aim_from_stop @ local[0], 0.0)
        # Near the centre map the disc of the stop back to aims.
        if np.hypot(*local[0]) < _AT_CENTRE * stop.semi_diameter_mm:
            offset = fan[:, :2] - fan[:, :2].mean(axis=0)
            disc = offset / np.abs(offset).max()
            yield aim + np.pad(stop.semi_diameter_mm * disc @ aim_from_stop.T, ((0, 0), (0, 1)))
            return


def _through_microlenses(
    tracer: Tracer, images: MicroImages, vertices: Nearby, crossing: np.ndarray, slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Microlenses lit by a footprint, and the positions where rays through their vertices meet the sensor."""
    array = tracer.camera.microlenses
    assert array is not None and tracer.lattice is not None
    # Take the microlenses within a pitch of the footprint's rays, and within the gaps between these.
    gap_mm = np.ptp(crossing, axis=0).max() / (_FAN / 2)
    reached = vertices.within(crossing, array.pitch_mm + gap_mm)[1]
    lit = np.unique(reached[reached != NOBODY])
    # Fit slopes, which are nearly linear in the crossing, by regularised least squares (Tikhonov): if all rays meet in
    # a point, their mean remains.
    crossing_change = crossing - crossing.mean(axis=0)
    slope_change = slope - slope.mean(axis=0)
    regular = np.eye(2) * len(crossing) * (0.1 * array.pitch_mm) ** 2
    slope_by_mm = np.linalg.solve(crossing_change.T @ crossing_change + regular, crossing_change.T @ slope_change)
    # Follow the ray through each vertex to the sensor.
    vertex = tracer.vertices_mm[lit]
    x = vertex - array.distance_mm * (slope.mean(axis=0) + (vertex - crossing.mean(axis=0)) @ slope_by_mm)
    # Keep positions in their own cell or little outside. Out of focus, where a rim cuts the bundle, all light may come
    # through the microlens at its own rim, as far away as the point is blurred.
    farther_mm = np.hypot(*(x - images.centre_mm[lit]).T) - images.nearby.nearest(x)[0][:, 0]
    focal_mm = np.array(array.focal_lengths_mm)[tracer.lattice.type[lit], None, None]
    spread = np.eye(2) * (1 - array.distance_mm / focal_mm) - array.distance_mm * slope_by_mm
    blur_mm = np.hypot(*tracer.arrays.aperture.T).max() * np.linalg.norm(spread, ord=2, axis=(1, 2))
    near = farther_mm <= np.maximum(_CELL_SLACK * array.pitch_mm, blur_mm)
    return lit[near], x[near]


def chief_points(
    tracer: Tracer,
    microlens: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Positions whose chief ray meets the origin of a plane, (n, 2) [px], near start positions; NaN: there is none."""
    x = x_px.copy()
    miss = _chief_hits(tracer, microlens, x, planes)
    px_per_mm = inverse(chief_jacobian(tracer, microlens, x, planes))
    step = np.full(x.shape, np.nan)
    for _ in range(_STEPS):
        # The Jacobian hardly changes between two positions of one point.
        step = -np.einsum("nij,nj->ni", px_per_mm, miss)
        x = x + step
        if not (np.abs(step) > _DONE_PX).any():
            break
        miss = _chief_hits(tracer, microlens, x, planes)
    return np.where((np.abs(step) < _ACCEPTED_PX).all(axis=1)[:, None], x, np.nan)


def chief_jacobian(
    tracer: Tracer,
    microlens: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> np.ndarray:
    """Jacobian of the hits of chief rays by image position, (n, 2, 2) [mm per px]; NaN without a chief ray."""
    return by_x(lambda x: _chief_hits(tracer, microlens, x, planes), x_px, _DIFFERENCE_PX)


def _chief_hits(tracer: Tracer, microlens: np.ndarray, x_px: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """Hits of the chief rays of image positions on their planes, (n, 2) [mm]."""
    hits = np.full(x_px.shape, np.nan)
    traceable = np.flatnonzero(np.isfinite(x_px).all(axis=1))
    positions = tracer.positions_mm(*x_px[traceable].T)
    if tracer.lattice is None:
        aims = chief_crossings(tracer.table, tracer.stop_row, tracer.on_film(positions))
    else:
        aims = vertex_aims(tracer, microlens[traceable], positions)
    aimed = np.isfinite(aims).all(axis=1)
    traceable, positions, aims = traceable[aimed], positions[aimed], aims[aimed]
    arrays = tracer.arrays._replace(table=unbounded(tracer.arrays.table))
    if len(traceable):
        hits[traceable] = single_hits(arrays, positions, microlens[traceable], aims, planes[traceable])
    return hits


def inverse(jacobian: Float64[np.ndarray, "n 2 2"]) -> np.ndarray:
    """Inverse matrices, (n, 2, 2); NaN if singular."""
    with np.errstate(invalid="ignore"):
        regular = np.abs(np.linalg.det(jacobian)) > 0
    return np.linalg.inv(np.where(regular[:, None, None], jacobian, np.nan))
