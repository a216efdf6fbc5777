"""Pencils: all rays through one point of a microlens aperture, by where on the sensor they start.

Kernels only; vision frame, mm. The sensor positions whose ray through a point passes the camera fill a region: the exit
pupil, as that pinhole throws it. `camera` is a `camera.tracing.records.CameraArrays`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.label_kernels import PASSES, Labels, label_packet
from pipeline.camera.tracing.acceptance import accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, PLAIN, aim_for
from pipeline.camera.tracing.packets import send_mixed
from pipeline.camera.tracing.records import CameraArrays, SensorPoints
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

LIGHT, BY_X, BY_Y, FILLED, SUMS = range(5)
"""Columns of the sums of `add_light`; the last is their number."""
_BLOCKED = 0
"""Label of a blocked ray where nobody asks what blocks it: any but `PASSES`."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Nodes along the radius on [-1, 1], and their weights: exact to the ninth degree."""
_CONE_NODES, _CONE_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""The same where pixels take light from a cone: with its roll-off the weight of a ray has kinks."""


class Pencils(NamedTuple):
    """Microlenses and points of their apertures.

    `microlens`, `kind`: (n,) int64, rows and types.
    `points`: (types, k, 3) or (types, k, 5, 3) float64, points in the frame of the microlens; for `add_light` each with
        its neighbours, see `_density`.
    """

    microlens: np.ndarray
    kind: np.ndarray
    points: np.ndarray


class Rays(NamedTuple):
    """Rays from the sensor through points of microlens apertures.

    `owner`: (m,) int64, the row of pencils that each belongs to, ascending.
    `which`: (m,) int64, the point of its type that it passes.
    `starts`: (m, 2) float64, sensor positions.
    """

    owner: np.ndarray
    which: np.ndarray
    starts: np.ndarray


class Sectors(NamedTuple):
    """Thin sectors of the regions of pencils.

    `owner`, `which`: (f,) int64, the microlens, one of n, and the point of its aperture.
    `bases`, `directions`: (f, 2) float64, the tip, and a unit vector.
    `radius`, `angle`: (f,) float64, distance to which light reaches, and the angle that the direction stands for.
    """

    owner: np.ndarray
    which: np.ndarray
    bases: np.ndarray
    directions: np.ndarray
    radius: np.ndarray
    angle: np.ndarray


def look(camera: CameraArrays, pencils: Pencils, rays: Rays, is_named: bool = False) -> np.ndarray:
    """Labels of rays, (m,): `PASSES` or another, which names what blocks the ray if names are asked for."""
    label = np.empty(len(rays.owner), np.int64)
    # Contiguous and writable, so that Numba has one specialisation.
    even = Rays(*(np.require(values, requirements=("C", "W")) for values in rays))
    label_rays(camera, pencils, even, is_named, label)
    label_rays.count(len(label), len(camera.table))
    return label


@kernel
def label_rays(camera, pencils, rays, is_named, label):
    """Trace rays and say which pass, or what blocks them.

    `is_named`: whether labels of blocked rays name what blocks them, as `label_kernels.label_packet` does, which costs
        more. Else they are all the same.
    `label`: (m,) int64, written: PASSES or another.
    """
    packet, start = new_packet(), SensorPoints(np.empty(PACKET), np.empty(PACKET))
    points, named = np.empty((PACKET, 2)), Labels(np.empty(PACKET, np.int64), np.empty(PACKET))
    for first in range(0, rays.owner.shape[0], PACKET):
        size = min(PACKET, rays.owner.shape[0] - first)
        owner = rays.owner[first : first + size]
        for i in range(size):
            x, y = rays.starts[first + i]
            start.x[i], start.y[i] = x, y
            packet.x[i], packet.y[i] = _aim(camera, pencils, owner[i], rays.which[first + i], x, y)
            points[i, 0], points[i, 1] = packet.x[i], packet.y[i]
        if is_named:
            label_packet(camera, pencils.microlens, owner, points, start, size, packet, named)
        else:
            send_mixed(camera, pencils.microlens, owner, start, size, packet)
        for i in range(size):
            seen = PASSES if packet.alive[i] > 0.0 else _BLOCKED
            label[first + i] = named.label[i] if is_named else seen


@inline
def _aim(camera, pencils, owner, which, start_x, start_y):
    """The point of the sampling plane that a ray from the sensor through a point of an aperture passes."""
    microlens = pencils.microlens[owner]
    px, py, pz = pencils.points[pencils.kind[owner], which]
    return aim_for(camera, microlens, start_x, start_y, px, py, pz)


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
