"""Sequential trace of rays through a table of surfaces, in packets. Lengths in mm.

For each surface a ray is moved to the intersection and refracted by Snell's law, D' = mu D + (cos' - mu cos) n; the
equations of the surfaces are in `optics.crossing`, `optics.aspheres` and `optics.reliefs`.

A packet keeps its rays in small arrays that stay in the cache. The outer loop runs over the surfaces, the inner ones
over the rays. No inner loop has a branch, so the compiler turns them into SIMD code. Loops are short on purpose: a
processor overlaps the divisions and roots of several rays only within its window of instructions. The kind of a surface
is decided once per packet.
"""

import math
import time
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel, opaque, unit
from pipeline.optics import table as column
from pipeline.optics.aspheres import cross_asphere, shape_of, through_cylinder
from pipeline.optics.brown import turned_with_distortion
from pipeline.optics.crossing import (
    bent_at_plane,
    cap_of,
    entered,
    left,
    motion_of_row,
    put,
    put_point,
    ray_of,
    through_sphere,
    to_plane,
    to_vertex_plane,
    turned_ideally,
)
from pipeline.optics.rays import Traced
from pipeline.optics.reliefs import through_relief
from pipeline.records.shapes import Float64

PACKET = 256
"""Rays per packet: eight arrays of 256 doubles fill 16 kB, half of a first-level cache."""
SCRATCH = 7
"""Scratch arrays of a packet, for aspheres."""
_TURNS = 4000
"""Iterations of a timed run: with a packet of values some milliseconds, long beside a reading of the clock."""
_RUNS = 5
"""Timed runs, of which the fastest counts: interruptions can only slow them."""


class Packet(NamedTuple):
    """Rays side by side: the fields of `Ray` (PACKET,), scratch arrays (SCRATCH, PACKET), a weight for the caller."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    dz: np.ndarray
    alive: np.ndarray
    scratch: np.ndarray
    weight: np.ndarray


@unit
def new_packet():
    """A packet of uninitialised arrays."""
    return Packet(
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty(PACKET),
        np.empty((SCRATCH, PACKET)),
        np.empty(PACKET),
    )


@opaque
def trace_packet(table, packet, count):
    """Trace the first `count` rays of a packet through all surfaces of a table, in place; z ends on the last one."""
    for k in range(table.shape[0]):
        row = table[k]
        is_displaced = table[k, column.POSE] > 0.0
        # Enter the frame of a displaced surface's centred position.
        if is_displaced:
            motion = motion_of_row(row, column.ENTRY)
            for i in range(count):
                put(packet, i, entered(motion, ray_of(packet, i)))
        # Move to the surface and refract, by its kind; spheres are most of all.
        if row[column.TERMS] != 0.0 or row[column.CONIC] != 0.0 or row[column.FORM] != 0.0:
            _through_rest(row, packet, count)
        elif row[column.CURVATURE] == 0.0:
            _through_plane(row, packet, count)
        else:
            cap = cap_of(row)
            for i in range(count):
                put(packet, i, through_sphere(cap, ray_of(packet, i)))
        if row[column.INNER_SQUARED] > 0.0 or row[column.EDGES] > 0.0:
            _clip(row, packet, count)
        if is_displaced:
            motion = motion_of_row(row, column.POSE)
            for i in range(count):
                put(packet, i, left(motion, ray_of(packet, i)))


@inline
def _through_plane(row, packet, count):
    """Move rays to a plane and refract."""
    cap = cap_of(row)
    mu = row[column.INDEX_RATIO]
    for i in range(count):
        put_point(packet, i, to_plane(cap, ray_of(packet, i)))
    if mu != 1.0:
        for i in range(count):
            put(packet, i, bent_at_plane(mu, ray_of(packet, i)))


@inline
def _through_rest(row, packet, count):
    """Move rays to an ideal thin lens, a conic, an asphere, a cylinder or a relief and bend them."""
    vertex = row[column.VERTEX]
    for i in range(count):
        put_point(packet, i, to_vertex_plane(vertex, ray_of(packet, i)))
    if row[column.FORM] == column.RELIEF:
        _through_relief(row, packet, count)
    elif row[column.FORM] == column.CYLINDER:
        _through_cylinder(row, packet, count)
    elif row[column.TERMS] < column.IDEAL:
        _turn_with_distortion(row, packet, count)
    elif row[column.TERMS] < 0.0:
        power, limit = row[column.COEFFICIENTS], row[column.SEMI_DIAMETER_SQUARED]
        for i in range(count):
            put(packet, i, turned_ideally(vertex, power, limit, ray_of(packet, i)))
    else:
        cross_asphere(row, packet, count)


@opaque
def _through_relief(row, packet, count):
    for i in range(count):
        put(packet, i, through_relief(row, row[column.INDEX_RATIO], ray_of(packet, i)))


@opaque
def _through_cylinder(row, packet, count):
    shape = shape_of(row)
    mu = row[column.INDEX_RATIO]
    for i in range(count):
        put(packet, i, through_cylinder(shape, mu, ray_of(packet, i)))


@opaque
def _turn_with_distortion(row, packet, count):
    for i in range(count):
        put(packet, i, turned_with_distortion(row, ray_of(packet, i)))


@opaque
def _clip(row, packet, count):
    """Block rays outside an aperture with straight edges or inside its obstruction, at the surface itself."""
    inner = row[column.INNER_SQUARED]
    if inner > 0.0:
        for i in range(count):
            x, y = packet.x[i], packet.y[i]
            packet.alive[i] = packet.alive[i] if x * x + y * y >= inner else 0.0
    for j in range(int(row[column.EDGES])):
        first = int(row[column.FIRST_EDGE]) + 3 * j
        nx, ny, distance = row[first], row[first + 1], row[first + 2]
        for i in range(count):
            packet.alive[i] = packet.alive[i] if nx * packet.x[i] + ny * packet.y[i] <= distance else 0.0


@kernel
def trace_rays(table, position, direction, alive):
    """Trace rays in place through a table (surfaces, columns): (n, 3) points [mm] and unit directions.

    `alive`, (n,) float64: 1.0, or 0.0 once blocked; points and directions of blocked rays mean nothing.
    """
    packet = new_packet()
    for start in range(0, position.shape[0], PACKET):
        count = min(PACKET, position.shape[0] - start)
        for i in range(count):
            j = start + i
            packet.x[i], packet.y[i], packet.z[i] = position[j, 0], position[j, 1], position[j, 2]
            packet.dx[i], packet.dy[i], packet.dz[i] = direction[j, 0], direction[j, 1], direction[j, 2]
            packet.alive[i] = alive[j]
        trace_packet(table, packet, count)
        for i in range(count):
            j = start + i
            position[j, 0], position[j, 1], position[j, 2] = packet.x[i], packet.y[i], packet.z[i]
            direction[j, 0], direction[j, 1], direction[j, 2] = packet.dx[i], packet.dy[i], packet.dz[i]
            alive[j] = packet.alive[i]


def trace(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
) -> Traced:
    """The rays behind the last surface; `optics.rays.traced` is the same without a compiler."""
    rays = np.array(position_mm, np.float64, order="C"), np.array(direction, np.float64, order="C")
    alive = np.ones(len(position_mm))
    trace_rays(table, *rays, alive)
    return Traced(*rays, alive > 0)


def trace_path(
    table: Float64[np.ndarray, "surfaces columns"],
    position_mm: Float64[np.ndarray, "n 3"],
    direction: Float64[np.ndarray, "n 3"],
) -> tuple[Float64[np.ndarray, "points n 3"], Traced]:
    """Points of rays, the start and those on each surface, and the rays behind the last surface."""
    rays = Traced(position_mm, direction, np.ones(len(position_mm), bool))
    points = [position_mm]
    for number in range(len(table)):
        behind = trace(table[number : number + 1], rays.position, rays.direction)
        rays = behind._replace(passes=rays.passes & behind.passes)
        points.append(rays.position)
    return np.stack(points), rays


@kernel
def divide_and_root(values, turns):
    """One division and two roots per value and iteration, in place; values (n,) float64 stay between 1 and 2."""
    for _ in range(turns):
        for i in range(values.shape[0]):
            values[i] = 1.0 + math.sqrt(values[i]) / (1.0 + math.sqrt(1.0 + values[i]))


def crossings_per_second() -> float:
    """Upper bound of rays times spheres per second on one core: the best of a few runs, some milliseconds."""
    values = np.linspace(1.0, 2.0, PACKET)
    divide_and_root(values, 1)
    spent = []
    for _ in range(_RUNS):
        start = time.thread_time()
        divide_and_root(values, _TURNS)
        spent.append(time.thread_time() - start)
    return _TURNS * PACKET / min(spent)
