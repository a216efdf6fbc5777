"""Sequential trace of one ray through a table of surfaces, for threads of a device; packets: `optics.kernels`.

The same functions in the same order, so that a ray has the same bits wherever both compilers round alike.
"""

from pipeline.jit.decorators import inline
from pipeline.optics.aspheres import through_conic_or_asphere
from pipeline.optics.brown import turned_with_distortion
from pipeline.optics.crossing import (
    Ray,
    behind_edge,
    bent_at_plane,
    cap_of,
    entered,
    left,
    motion_of_row,
    outside,
    through_sphere,
    to_plane,
    to_vertex_plane,
    turned_ideally,
)
from pipeline.optics.table import (
    COEFFICIENTS,
    CONIC,
    CURVATURE,
    EDGES,
    FIRST_EDGE,
    IDEAL,
    INDEX_RATIO,
    INNER_SQUARED,
    POSE,
    SEMI_DIAMETER_SQUARED,
    TERMS,
    VERTEX,
)


@inline
def trace_ray(table, ray):
    """The ray behind all surfaces, on the last one."""
    for k in range(table.shape[0]):
        row = table[k]
        if row[POSE] > 0.0:
            ray = left(motion_of_row(row), _through(row, entered(motion_of_row(row), ray)))
        else:
            ray = _through(row, ray)
    return ray


@inline
def _through(row, ray):
    """The ray moved to a surface in its place, bent there, and clipped."""
    if row[TERMS] != 0.0 or row[CONIC] != 0.0:
        ray = to_vertex_plane(row[VERTEX], ray)
        if row[TERMS] < IDEAL:
            ray = turned_with_distortion(row, ray)
        elif row[TERMS] < 0.0:
            ray = turned_ideally(row[VERTEX], row[COEFFICIENTS], row[SEMI_DIAMETER_SQUARED], ray)
        else:
            ray = through_conic_or_asphere(row, ray)
    elif row[CURVATURE] == 0.0:
        ray = to_plane(cap_of(row), ray)
        if row[INDEX_RATIO] != 1.0:
            ray = bent_at_plane(row[INDEX_RATIO], ray)
    else:
        ray = through_sphere(cap_of(row), ray)
    return _clipped(row, ray)


@inline
def _clipped(row, ray):
    """The ray blocked if it misses an aperture that is not just the circle."""
    alive = ray.alive
    if row[INNER_SQUARED] > 0.0:
        alive = min(alive, outside(row[INNER_SQUARED], ray))
    for j in range(int(row[EDGES])):
        first = int(row[FIRST_EDGE]) + 3 * j
        alive = min(alive, behind_edge(row[first], row[first + 1], row[first + 2], ray))
    return Ray(ray.x, ray.y, ray.z, ray.dx, ray.dy, ray.dz, alive)
