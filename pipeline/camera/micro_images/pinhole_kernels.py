"""Pencils: all rays through one point of a microlens aperture, by where on the sensor they start.

Kernels only; vision frame, mm. The sensor positions whose ray through a point passes the camera fill a region: the exit
pupil, as that pinhole throws it. `camera` is a `camera.tracing.records.CameraArrays`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.edge_kernels import probe
from pipeline.camera.tracing.acceptance import accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, PLAIN, aim_for, aims_for
from pipeline.camera.tracing.records import CameraArrays
from pipeline.jit.decorators import inline, kernel

LIGHT, BY_X, BY_Y, FILLED, SUMS = range(5)
"""Columns of the sums of `add_light`; the last is their number."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Nodes along the radius on [-1, 1], and their weights: exact to the ninth degree."""
_CONE_NODES, _CONE_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""The same where pixels take light from a cone: with its roll-off the weight of a ray has kinks."""


class Pencils(NamedTuple):
    """Microlenses and points of their apertures."""

    # (n,) int64, rows and types
    microlens: np.ndarray
    kind: np.ndarray
    # (types, k, 3) or (types, k, 5, 3) float64, points in the frame of the microlens; for `add_light` each with its
    # neighbours, see `_density`
    points: np.ndarray


class Rays(NamedTuple):
    """Rays from the sensor through points of microlens apertures."""

    owner: np.ndarray  # (m,) int64, the row of pencils that each belongs to, ascending
    which: np.ndarray  # (m,) int64, the point of its type that it passes
    starts: np.ndarray  # (m, 2) float64, sensor positions


class Sectors(NamedTuple):
    """Thin sectors of the regions of pencils."""

    # (f,) int64, the microlens, one of n, and the point of its aperture
    owner: np.ndarray
    which: np.ndarray
    # (f, 2) float64, the tip, and a unit vector
    bases: np.ndarray
    directions: np.ndarray
    # (f,) float64, distance to which light reaches, and the angle that the direction stands for
    radius: np.ndarray
    angle: np.ndarray


def look(camera: CameraArrays, pencils: Pencils, rays: Rays, is_named: bool = False) -> np.ndarray:
    """Labels of rays, (m,): `PASSES` or another, which names what blocks the ray if names are asked for."""
    starts, microlens, count = np.ascontiguousarray(rays.starts), pencils.microlens[rays.owner], len(rays.owner)
    points, aims = pencils.points[pencils.kind[rays.owner], rays.which], np.empty((count, 2))
    aims_for(camera, microlens, starts, points, aims)
    label = np.empty(count, np.int64)
    probe(camera, starts, microlens, np.arange(count), aims, is_named, label)
    probe.count(count, len(camera.table))
    return label


@inline
def _density(camera, microlens, near, sx, sy):
    """Weight of a ray per area of the sensor and of the aperture, as its own frame counts it [sr / mm^2].

    `near` holds the point of the aperture and its neighbours along +x, -x, +y and -y.
    """
    acceptance, h, stretch = camera.acceptance, camera.microlenses[microlens, AIM], 1.0
    qx, qy = aim_for(camera, microlens, sx, sy, near[0, 0], near[0, 1], near[0, 2])
    if camera.elements.model != PLAIN:
        ax, ay = aim_for(camera, microlens, sx, sy, near[1, 0], near[1, 1], near[1, 2])
        bx, by = aim_for(camera, microlens, sx, sy, near[2, 0], near[2, 1], near[2, 2])
        cx, cy = aim_for(camera, microlens, sx, sy, near[3, 0], near[3, 1], near[3, 2])
        dx, dy = aim_for(camera, microlens, sx, sy, near[4, 0], near[4, 1], near[4, 2])
        stretch = abs((ax - bx) * (cy - dy) - (ay - by) * (cx - dx))
        stretch /= (near[1, 0] - near[2, 0]) * (near[3, 1] - near[4, 1])
    u, v = (qx - sx) / h, (qy - sy) / h
    squared = 1.0 + u * u + v * v
    share = accepted_share(acceptance, 1.0 / math.sqrt(squared)) if is_limited(acceptance) else 1.0
    return share * stretch / (h * h * squared * squared)


@kernel
def add_light(camera, pencils, shares, middle, sectors, sums):
    """Integrate light over the regions of pencils whose edges are known.

    `pencils`: their points are nodes of a quadrature over the aperture.
    `shares`: (k,) float64, weights of the nodes.
    `middle`: (n, 2) float64, origin of the moments.
    `sums`: (n, 4) float64, added to: light [sr], its moments along x and y [sr mm], and the area that light through
        node 0 fills [mm^2].
    """
    owner, which, bases, directions, radius, angle = sectors
    microlens, kind, points = pencils
    is_cone = camera.acceptance.half_angle > 0.0
    for f in range(owner.shape[0]):
        n, m = owner[f], which[f]
        near = points[kind[n], m]
        if m == 0:
            sums[n, FILLED] += 0.5 * radius[f] * radius[f] * angle[f]
        for k in range(len(_CONE_NODES) if is_cone else len(_NODES)):
            node, weight = (_CONE_NODES[k], _CONE_WEIGHTS[k]) if is_cone else (_NODES[k], _WEIGHTS[k])
            r = 0.5 * (1.0 + node) * radius[f]
            x, y = bases[f, 0] + r * directions[f, 0], bases[f, 1] + r * directions[f, 1]
            light = shares[m] * 0.5 * weight * radius[f] * r * angle[f]
            light *= _density(camera, microlens[n], near, x, y)
            sums[n, LIGHT] += light
            sums[n, BY_X] += light * (x - middle[n, 0])
            sums[n, BY_Y] += light * (y - middle[n, 1])
