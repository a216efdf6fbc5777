"""Beams: a few rays that bound and sample the light of each of many blocks of the sensor.

A block is the micro-image of one microlens, or a tile of a sensor without microlenses. Its rays start at the nodes of a
grid; between nodes they vary so smoothly that a cubic interpolates those of any pixel of the block. Apertures of the
main lens do not block them: the rays only bound where light may go.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.tracing.microlens_kernels import X, Y
from pipeline.camera.tracing.packets import aim_mixed
from pipeline.camera.tracing.records import CameraArrays, SensorPoints
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS, new_region, outline_at
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet, trace_packet
from pipeline.optics.table import unbounded

NODES = 4
"""Nodes along an axis of a block: a cubic has four coefficients."""
_RIM, _RING = 16, 7
"""Rays of a node around the polygon that bounds its rays, and on a ring about halfway in."""
RAYS = _RIM + _RING + 1
"""Rays of a node, with the one in the middle: three times eight, which suits SIMD."""
_HALFWAY = 0.55
"""Radius of the ring of inner rays over that of the polygon [1]."""
_AT_ONCE = 2
"""Rows of nodes that are traced together: 192 rays."""


class Blocks(NamedTuple):
    """Blocks of the sensor, each with a square grid of nodes."""

    microlens: np.ndarray  # (b,) int64, microlens of each block, or `NO_MICROLENS`
    centre_mm: np.ndarray  # (b, 2) float64, vision frame
    step_mm: np.ndarray  # (b,) float64, distance of the nodes, which lie around the centre


class Beams(NamedTuple):
    """Rays of blocks in front of the lens."""

    # (b, NODES^2, RAYS, 3) float64, vision frame [mm]
    origin: np.ndarray
    direction: np.ndarray
    is_complete: np.ndarray  # (b,) bool, whether all rays of the block leave the lens


def beams_of(camera: CameraArrays, blocks: Blocks) -> Beams:
    """Trace the rays of all nodes of blocks, which no aperture of the main lens blocks."""
    shape = len(blocks.microlens), NODES * NODES, RAYS, 3
    beams = Beams(np.empty(shape), np.empty(shape), np.zeros(shape[0], bool))
    _trace(camera._replace(table=unbounded(camera.table)), blocks, beams)
    _trace.count(len(blocks.microlens) * NODES * NODES * RAYS, len(camera.table))
    return beams


@kernel
def _trace(camera, blocks, beams):
    """Write the rays of blocks, with a camera whose table has no apertures."""
    region = new_region()
    packet = new_packet()
    start_x, start_y = np.empty(PACKET), np.empty(PACKET)
    start = SensorPoints(start_x, start_y)
    owner = np.empty(PACKET, np.int64)
    aperture, outlines = camera.aperture, camera.outlines
    x, y, z, dx, dy, dz, alive, _, _ = packet
    polygon = region.polygon
    size = _AT_ONCE * NODES * RAYS
    for b in range(blocks.microlens.shape[0]):
        microlens = blocks.microlens[b]
        beams.is_complete[b] = True
        for first in range(0, NODES * NODES, _AT_ONCE * NODES):
            # Lay out the rays of some rows of nodes: their starts, and points of the polygon that bounds them.
            for i in range(_AT_ONCE * NODES):
                up, across = (first + i) // NODES, (first + i) % NODES
                sx = blocks.centre_mm[b, 0] + (across - 0.5 * (NODES - 1)) * blocks.step_mm[b]
                sy = blocks.centre_mm[b, 1] + (up - 0.5 * (NODES - 1)) * blocks.step_mm[b]
                if microlens == NO_MICROLENS:
                    count = outline_at(camera.optics.step_mm, outlines, sx, sy, polygon)
                    if polygon[0, 0] == polygon[count // 2, 0] and polygon[0, 1] == polygon[count // 2, 1]:  # dark
                        beams.is_complete[b] = False
                else:
                    count = aperture.shape[0]
                    for k in range(count):
                        polygon[k, 0] = camera.microlenses[microlens, X] + aperture[k, 0]
                        polygon[k, 1] = camera.microlenses[microlens, Y] + aperture[k, 1]
                of_node = slice(i * RAYS, (i + 1) * RAYS)
                _spread(polygon, count, x[of_node], y[of_node])
                start_x[of_node], start_y[of_node], owner[of_node] = sx, sy, b
            # Trace them, also those that miss the disc of their microlens.
            aim_mixed(camera, blocks.microlens, owner, start, size, packet)
            for i in range(size):
                alive[i] = 1.0
            trace_packet(camera.table, packet, size)
            # Write them, and whether all leave the lens.
            for i in range(size):
                node, k = first + i // RAYS, i % RAYS
                beams.origin[b, node, k, 0], beams.origin[b, node, k, 1], beams.origin[b, node, k, 2] = x[i], y[i], z[i]
                beams.direction[b, node, k, 0] = dx[i]
                beams.direction[b, node, k, 1] = dy[i]
                beams.direction[b, node, k, 2] = dz[i]
                if not (alive[i] > 0.0 and dz[i] > 0.0):
                    beams.is_complete[b] = False


@inline
def _spread(polygon, count, x, y):
    """Write points of a polygon into x and y (RAYS,): some of its corners, points halfway to them, and the middle."""
    cx, cy = 0.0, 0.0
    for k in range(count):
        cx += polygon[k, 0] / count
        cy += polygon[k, 1] / count
    for k in range(_RIM):
        corner = k * count // _RIM
        x[k], y[k] = polygon[corner, 0], polygon[corner, 1]
    for k in range(_RING):
        corner = k * count // _RING
        x[_RIM + k] = cx + _HALFWAY * (polygon[corner, 0] - cx)
        y[_RIM + k] = cy + _HALFWAY * (polygon[corner, 1] - cy)
    x[RAYS - 1], y[RAYS - 1] = cx, cy
