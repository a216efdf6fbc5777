"""Pencils: all rays through one point of a microlens aperture, by where on the sensor they start.

Kernels only; vision frame, mm. The sensor positions whose ray through a point passes the camera fill a region: the exit
pupil, as that pinhole throws it. `camera` is the tuple of optics, table, lenses and mosaic of `Tracer.arrays`, `lens`
the row of a microlens, `kind` its type; points of apertures (types, k, 3) count in the frame of their microlens.
"""

import math

import numpy as np

from pipeline.camera.integrating.edge_kernels import PASSES, what_blocks
from pipeline.camera.tracing.acceptance import HALF_ANGLE, accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, MODEL, PLAIN, aim_for
from pipeline.camera.tracing.packets import send_packet
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

_WIDENINGS = 12
_BLOCKED = 0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
_CONE_NODES, _CONE_WEIGHTS = np.polynomial.legendre.leggauss(16)
"""Along the radius: the weight of a ray is smooth unless pixels take light from a cone."""


@kernel
def edges(camera, lens, kind, points, which, bases, directions, low, high, steps, blocker):
    """Bisect, along directions on the sensor, how far from a base light passes a point of the aperture.

    Parameters
    ----------
    lens, kind : (n,) int64
    which : (n, d) int64
        Of the points of the type, that which the light of each direction passes.
    bases, directions : (n, d, 2) float64
        Where directions count from, and unit vectors.
    low, high : (n, d) float64
        Bounds, narrowed; outer ones that are lit move outwards first.
    steps : int
        Bisections. 0: only say which rays from the outer bounds pass.
    blocker : (n, d) int64
        Written: what blocks the ray from the outer bound, see `probes.what_blocks`. After 0 steps PASSES or another.
    """
    optics, table, lenses, mosaic = camera
    packet, found = new_packet(), np.empty(PACKET, np.int64)
    far, start_x, start_y = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    rows = far, start_x, start_y
    for n in range(lens.shape[0]):
        for first in range(0, which.shape[1], PACKET):
            size, step, widenings = min(PACKET, which.shape[1] - first), 0, _WIDENINGS
            here = slice(first, first + size)
            inner, outer, passing = low[n, here], high[n, here], packet[6]
            while True:
                for i in range(size):
                    far[i] = outer[i] if step == 0 else 0.5 * (inner[i] + outer[i])
                _start(
                    camera, lens[n], points[kind[n]], which[n, here], bases[n, here], directions[n, here], rows, packet
                )
                send_packet(table, optics, lenses, mosaic, lens[n], start_x, start_y, size, packet)
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
                blocker[n, first + i] = PASSES if passing[i] > 0.0 else _BLOCKED
            if steps > 0:
                for i in range(size):
                    far[i] = outer[i]
                _start(
                    camera, lens[n], points[kind[n]], which[n, here], bases[n, here], directions[n, here], rows, packet
                )
                what_blocks(table, optics, lenses, mosaic, lens[n], start_x, start_y, size, packet, found)
                for i in range(size):
                    blocker[n, first + i] = found[i]


@inline
def _start(camera, lens, points, which, bases, directions, rows, packet):
    """Set where rays start, and their aim points."""
    optics, _, lenses, mosaic = camera
    far, start_x, start_y = rows
    x, y = packet[0], packet[1]
    for i in range(which.shape[0]):
        start_x[i] = bases[i, 0] + far[i] * directions[i, 0]
        start_y[i] = bases[i, 1] + far[i] * directions[i, 1]
        px, py, pz = points[which[i]]
        if mosaic[0][MODEL] == PLAIN:
            x[i], y[i] = lenses[lens, 0] + px, lenses[lens, 1] + py
        else:
            x[i], y[i] = aim_for(optics[0], lenses, mosaic, lens, start_x[i], start_y[i], px, py, pz)


@inline
def _density(camera, lens, near, sx, sy):
    """Weight of a ray per area of the sensor and of the aperture, as its own frame counts it [sr / mm^2].

    `near` holds the point of the aperture and its neighbours along +x, -x, +y and -y.
    """
    optics, _, lenses, mosaic = camera
    detail, stretch = mosaic[0], 1.0
    if detail[MODEL] == PLAIN:
        h = optics[1] - optics[0]
        qx, qy = lenses[lens, 0] + near[0, 0], lenses[lens, 1] + near[0, 1]
    else:
        h, z = lenses[lens, AIM], optics[0]
        qx, qy = aim_for(z, lenses, mosaic, lens, sx, sy, near[0, 0], near[0, 1], near[0, 2])
        ax, ay = aim_for(z, lenses, mosaic, lens, sx, sy, near[1, 0], near[1, 1], near[1, 2])
        bx, by = aim_for(z, lenses, mosaic, lens, sx, sy, near[2, 0], near[2, 1], near[2, 2])
        cx, cy = aim_for(z, lenses, mosaic, lens, sx, sy, near[3, 0], near[3, 1], near[3, 2])
        dx, dy = aim_for(z, lenses, mosaic, lens, sx, sy, near[4, 0], near[4, 1], near[4, 2])
        stretch = abs((ax - bx) * (cy - dy) - (ay - by) * (cx - dx))
        stretch /= (near[1, 0] - near[2, 0]) * (near[3, 1] - near[4, 1])
    u, v = (qx - sx) / h, (qy - sy) / h
    squared = 1.0 + u * u + v * v
    share = accepted_share(detail, 1.0 / math.sqrt(squared)) if is_limited(detail) else 1.0
    return share * stretch / (h * h * squared * squared)


@kernel
def add_light(camera, lens, kind, points, shares, middle, owner, which, bases, directions, radius, angle, sums):
    """Integrate light over the regions of pencils whose edges are known.

    Parameters
    ----------
    points : (types, m, 5, 3) float64
        Nodes of a quadrature over the aperture, each with its neighbours: see `_density`.
    shares : (m,) float64
        Weights of the nodes.
    middle : (n, 2) float64
        What moments count from.
    owner, which : (f,) int64
        Of each direction: its microlens among the n, and its node among the m.
    bases, directions, radius, angle : (f, 2), (f, 2), (f,), (f,) float64
        As in `edges`: base, unit vector, how far light reaches, and the angle that the direction stands for.
    sums : (n, 4) float64
        Added to: light [sr], its moments along x and y [sr mm], and the area that light through node 0 fills [mm^2].
    """
    is_cone = camera[3][0][HALF_ANGLE] > 0.0
    for f in range(owner.shape[0]):
        n, m = owner[f], which[f]
        if m == 0:
            sums[n, 3] += 0.5 * radius[f] * radius[f] * angle[f]
        for k in range(len(_CONE_NODES) if is_cone else len(_NODES)):
            node, weight = (_CONE_NODES[k], _CONE_WEIGHTS[k]) if is_cone else (_NODES[k], _WEIGHTS[k])
            r = 0.5 * (1.0 + node) * radius[f]
            x, y = bases[f, 0] + r * directions[f, 0], bases[f, 1] + r * directions[f, 1]
            light = shares[m] * 0.5 * weight * radius[f] * r * angle[f]
            light *= _density(camera, lens[n], points[kind[n], m], x, y)
            sums[n, 0] += light
            sums[n, 1] += light * (x - middle[n, 0])
            sums[n, 2] += light * (y - middle[n, 1])
