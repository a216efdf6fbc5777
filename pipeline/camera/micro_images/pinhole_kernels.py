"""Pencils: all rays through one point of a microlens aperture, by where on the sensor they start.

Kernels only; vision frame, mm. The sensor positions whose ray through a point passes the camera fill a region: the exit
pupil, as that pinhole throws it. `camera` is a `camera.tracing.records.CameraArrays`.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.camera.integrating.edge_kernels import PASSES, what_blocks
from pipeline.camera.tracing.acceptance import HALF_ANGLE, accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, MODEL, PLAIN, X, Y, aim_for
from pipeline.camera.tracing.packets import send_packet
from pipeline.camera.tracing.records import SensorPoints
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

LIGHT, BY_X, BY_Y, FILLED, SUMS = range(5)
"""Columns of the sums of `add_light`; the last is their number."""
_WIDENINGS = 12
"""Times that the reach of a search grows by half while light passes at its end: up to 86-fold."""
_BLOCKED = 0
"""Label of a blocked ray where nobody asks what blocks it: any but `PASSES`."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
"""Nodes along the radius on [-1, 1], and their weights: exact to the ninth degree."""
_CONE_NODES, _CONE_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""The same where pixels take light from a cone: with its roll-off the weight of a ray has kinks."""


class Pencils(NamedTuple):
    """Microlenses and points of their apertures.

    Attributes
    ----------
    microlens, kind : (n,) int64
        Rows and types.
    points : (types, k, 3) or (types, k, 5, 3) float64
        In the frame of the microlens; for `add_light` each with its neighbours, see `_density`.
    """

    microlens: np.ndarray
    kind: np.ndarray
    points: np.ndarray


class Bisections(NamedTuple):
    """Ways on the sensor along which the edges of pencils are bisected.

    Attributes
    ----------
    which : (n, d) int64
        Of the points of the type, that which the light of each way passes.
    bases, directions : (n, d, 2) float64
        Where ways begin, and unit vectors.
    low, high : (n, d) float64
        Bounds, narrowed; outer ones that are lit move outwards first.
    blocker : (n, d) int64
        Written: what blocks the ray from the outer bound, see `probes.what_blocks`. After 0 steps PASSES or another.
    """

    which: np.ndarray
    bases: np.ndarray
    directions: np.ndarray
    low: np.ndarray
    high: np.ndarray
    blocker: np.ndarray


class Sectors(NamedTuple):
    """Thin sectors of the regions of pencils.

    Attributes
    ----------
    owner, which : (f,) int64
        The microlens, one of n, and the point of its aperture.
    bases, directions : (f, 2) float64
        The tip, and a unit vector.
    radius, angle : (f,) float64
        How far light reaches, and the angle that the direction stands for.
    """

    owner: np.ndarray
    which: np.ndarray
    bases: np.ndarray
    directions: np.ndarray
    radius: np.ndarray
    angle: np.ndarray


@kernel
def edges(camera, pencils, ways, steps):
    """Bisect, along ways on the sensor, how far from their beginning light passes a point of the aperture.

    Parameters
    ----------
    pencils : Pencils
    ways : Bisections
    steps : int
        Bisections. 0: only say which rays from the outer bounds pass.
    """
    packet, found, far = new_packet(), np.empty(PACKET, np.int64), np.empty(PACKET)
    start, passing = SensorPoints(np.empty(PACKET), np.empty(PACKET)), packet.alive
    which, bases, directions, low, high, blockers = ways
    for n in range(pencils.microlens.shape[0]):
        microlens, points = pencils.microlens[n], pencils.points[pencils.kind[n]]
        for first in range(0, which.shape[1], PACKET):
            size, step, widenings = min(PACKET, which.shape[1] - first), 0, _WIDENINGS
            here = slice(first, first + size)
            inner, outer, blocker = low[n, here], high[n, here], blockers[n, here]
            part = Bisections(which[n, here], bases[n, here], directions[n, here], inner, outer, blocker)
            while True:
                for i in range(size):
                    far[i] = outer[i] if step == 0 else 0.5 * (inner[i] + outer[i])
                _start(camera, microlens, points, part, far, start, packet)
                send_packet(camera, microlens, start, size, packet)
                if step > 0:
                    for i in range(size):
                        inner[i] = far[i] if passing[i] > 0.0 else inner[i]
                        outer[i] = outer[i] if passing[i] > 0.0 else far[i]
                    step += 1
                elif steps > 0:
                    widenings, step = widenings - 1, 1
                    for i in range(size):
                        if passing[i] > 0.0 and widenings > 0:
                            inner[i], outer[i], step = far[i], 1.5 * far[i], 0
                if step > steps or steps == 0:
                    break
            for i in range(size):
                blocker[i] = PASSES if passing[i] > 0.0 else _BLOCKED
            if steps > 0:
                for i in range(size):
                    far[i] = outer[i]
                _start(camera, microlens, points, part, far, start, packet)
                what_blocks(camera, microlens, start, size, packet, found)
                for i in range(size):
                    blocker[i] = found[i]


@inline
def _start(camera, microlens, points, ways, far, start, packet):
    """Set where the rays of some ways of one microlens start, so far along each, and their aim points."""
    lenses, x, y = camera.lenses, packet.x, packet.y
    for i in range(ways.which.shape[0]):
        start.x[i] = ways.bases[i, 0] + far[i] * ways.directions[i, 0]
        start.y[i] = ways.bases[i, 1] + far[i] * ways.directions[i, 1]
        px, py, pz = points[ways.which[i]]
        if camera.mosaic.detail[MODEL] == PLAIN:
            x[i], y[i] = lenses[microlens, X] + px, lenses[microlens, Y] + py
        else:
            x[i], y[i] = aim_for(camera, microlens, start.x[i], start.y[i], px, py, pz)


@inline
def _density(camera, microlens, near, sx, sy):
    """Weight of a ray per area of the sensor and of the aperture, as its own frame counts it [sr / mm^2].

    `near` holds the point of the aperture and its neighbours along +x, -x, +y and -y.
    """
    detail, optics, row, stretch = camera.mosaic.detail, camera.optics, camera.lenses[microlens], 1.0
    if detail[MODEL] == PLAIN:
        h = optics.sampling_z_mm - optics.sensor_z_mm
        qx, qy = row[X] + near[0, 0], row[Y] + near[0, 1]
    else:
        h = row[AIM]
        qx, qy = aim_for(camera, microlens, sx, sy, near[0, 0], near[0, 1], near[0, 2])
        ax, ay = aim_for(camera, microlens, sx, sy, near[1, 0], near[1, 1], near[1, 2])
        bx, by = aim_for(camera, microlens, sx, sy, near[2, 0], near[2, 1], near[2, 2])
        cx, cy = aim_for(camera, microlens, sx, sy, near[3, 0], near[3, 1], near[3, 2])
        dx, dy = aim_for(camera, microlens, sx, sy, near[4, 0], near[4, 1], near[4, 2])
        stretch = abs((ax - bx) * (cy - dy) - (ay - by) * (cx - dx))
        stretch /= (near[1, 0] - near[2, 0]) * (near[3, 1] - near[4, 1])
    u, v = (qx - sx) / h, (qy - sy) / h
    squared = 1.0 + u * u + v * v
    share = accepted_share(detail, 1.0 / math.sqrt(squared)) if is_limited(detail) else 1.0
    return share * stretch / (h * h * squared * squared)


@kernel
def add_light(camera, pencils, shares, middle, sectors, sums):
    """Integrate light over the regions of pencils whose edges are known.

    Parameters
    ----------
    pencils : Pencils
        Their points are nodes of a quadrature over the aperture.
    shares : (k,) float64
        Weights of the nodes.
    middle : (n, 2) float64
        What moments count from.
    sectors : Sectors
    sums : (n, 4) float64
        Added to: light [sr], its moments along x and y [sr mm], and the area that light through node 0 fills [mm^2].
    """
    owner, which, bases, directions, radius, angle = sectors
    microlens, kind, points = pencils
    is_cone = camera.mosaic.detail[HALF_ANGLE] > 0.0
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
