"""Packets of rays that start on the sensor: random points on a region, aim, weight. Kernels only; vision frame, mm."""

import math

from pipeline.camera.acceptance import BY_AREA, accepted_share, is_limited
from pipeline.camera.elements import AIM, DISC, MODEL, PLAIN, through_microlens
from pipeline.camera.polygon import point_in_fan
from pipeline.camera.sobol import scrambled
from pipeline.jit import inline
from pipeline.optics.kernels import trace_packet


@inline
def draw(bits, first, size, seed, values):
    """Scrambled coordinates of samples first ... first + size of one dimension."""
    for i in range(size):
        values[i] = scrambled(bits[first + i], seed)


@inline
def start_packet(
    table, optics, lenses, mosaic, lens, centre_x, centre_y, start_x, start_y, region, fan_of, size, packet
):
    """Send rays from sensor positions through random points of a region and trace them into the scene.

    Parameters
    ----------
    centre_x, centre_y : float
        The sensor position that the region was bound for.
    start_x, start_y : (PACKET,) float64
        Where on the sensor each ray starts.
    region, fan_of : tuple
        From `regions.new_region` and `regions.bound`.
    packet : tuple
        From `optics.kernels.new_packet`; x and y hold two random numbers per ray on entry, the rays behind the front
        vertex on exit.
    """
    x, y = packet[0], packet[1]
    polygon, _, _, cumulative = region
    count, cx, cy, _ = fan_of
    # Without a microlens the region moves along with the sensor position, by the drift of the outlines.
    drift = optics[4] if lens < 0 else 0.0
    for i in range(size):
        px, py = point_in_fan(polygon, count, cumulative, cx, cy, x[i], y[i])
        x[i], y[i] = px + drift * (start_x[i] - centre_x), py + drift * (start_y[i] - centre_y)
    send_packet(table, optics, lenses, mosaic, lens, start_x, start_y, size, packet)


@inline
def send_packet(table, optics, lenses, mosaic, lens, start_x, start_y, size, packet):
    """Send rays from sensor positions through given points of the sampling plane and trace them into the scene.

    A ray weighs what it stands for per area of that plane: cos^4 / h^2 of irradiance, or 1, times its acceptance.
    `packet`: x and y hold the points on entry; the rays behind the front vertex and their weights on exit.
    """
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    detail = mosaic[0]
    if lens >= 0 and detail[MODEL] != PLAIN:
        through_microlens(optics, lenses, mosaic, lens, start_x, start_y, size, packet)
    else:
        for i in range(size):
            dx[i], dy[i], dz[i], weight[i] = aim(optics, lenses, lens, start_x[i], start_y[i], x[i], y[i])
            z[i] = optics[1]
            alive[i] = 1.0
        if lens >= 0 and detail[DISC] > 0.0:
            for i in range(size):
                ax, ay = x[i] - lenses[lens, 0], y[i] - lenses[lens, 1]
                alive[i] = 1.0 if ax * ax + ay * ay <= detail[DISC] * detail[DISC] else 0.0
    if is_limited(detail) or detail[BY_AREA] > 0.0:
        h = optics[1] - optics[0]
        if lens >= 0 and detail[MODEL] != PLAIN:
            h = lenses[lens, AIM]
        _weigh(detail, h, weight, alive, size)
    trace_packet(table, x, y, z, dx, dy, dz, alive, scratch, size)


@inline
def _weigh(detail, h, weight, alive, size):
    """Acceptance and the kind of weight, from weights cos^4 / h^2."""
    limited, by_area = is_limited(detail), detail[BY_AREA] > 0.0
    for i in range(size):
        share = accepted_share(detail, math.sqrt(h * math.sqrt(weight[i]))) if limited else 1.0
        weight[i] = share if by_area else weight[i] * share
        alive[i] = alive[i] if share > 0.0 else 0.0


@inline
def aim(optics, lenses, lens, x, y, qx, qy):
    """Direction behind the microlens, if any, and weight of the ray from the sensor at (x, y) to (qx, qy).

    A sample at distance d from the sensor position, on a plane at distance h from the sensor, weighs
    cos(theta) d omega = h^2 / d^4 dA: irradiance.
    """
    h = optics[1] - optics[0]
    sx, sy = (qx - x) / h, (qy - y) / h
    squared = 1.0 + sx * sx + sy * sy
    weight = 1.0 / (h * h * squared * squared)
    if lens >= 0:
        # An ideal thin lens changes slopes by offset / focal length.
        sx -= (qx - lenses[lens, 0]) / lenses[lens, 2]
        sy -= (qy - lenses[lens, 1]) / lenses[lens, 2]
    w = 1.0 / math.sqrt(1.0 + sx * sx + sy * sy)
    return sx * w, sy * w, w, weight
