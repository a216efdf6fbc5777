"""Packets of rays that start on the sensor: random points on a region, aim, weight. Kernels only; vision frame, mm."""

import math

from pipeline.camera.acceptance import BY_AREA, accepted_share, is_limited
from pipeline.camera.elements import AIM, DISC, MODEL, PLAIN, through_microlens
from pipeline.camera.polygon import point_in_fan
from pipeline.camera.sobol import scrambled
from pipeline.jit import inline, unit
from pipeline.optics.kernels import trace_packet


@unit
def draw(bits, first, size, seed, values):
    """Scrambled coordinates of samples first ... first + size of one dimension."""
    for i in range(size):
        values[i] = scrambled(bits[first + i], seed)


@unit
def aim_into(region, fan_of, drift, centre_x, centre_y, start_x, start_y, x, y):
    """Turn two random numbers of each ray, in x and y, into a point of a region.

    Parameters
    ----------
    region, fan_of : tuple
        From `regions.new_region` and `regions.bound`.
    drift : float
        How far the region moves along with the sensor position: `region_drift`.
    centre_x, centre_y : float
        The sensor position that the region was bound for.
    start_x, start_y : (n,) float64
        Where on the sensor each ray starts.
    """
    count, cx, cy, _ = fan_of
    for i in range(x.shape[0]):
        px, py = point_in_fan(region[0], count, region[3], cx, cy, x[i], y[i])
        x[i], y[i] = px + drift * (start_x[i] - centre_x), py + drift * (start_y[i] - centre_y)


@inline
def region_drift(optics, lens):
    """Without a microlens a region moves along with the sensor position, by the drift of the outlines."""
    return optics[4] if lens < 0 else 0.0


@unit
def send_packet(table, optics, lenses, mosaic, lens, start_x, start_y, size, packet):
    """Send rays from sensor positions through given points of the sampling plane and trace them into the scene.

    A ray weighs what it stands for per area of that plane: cos^4 / h^2 of irradiance, or 1, times its acceptance.
    `packet`: x and y hold the points on entry; the rays behind the front vertex and their weights on exit.
    """
    x, y, z, dx, dy, dz, alive, scratch, _ = packet
    if lens >= 0 and mosaic[0][MODEL] != PLAIN:
        _through(optics, lenses, mosaic, lens, start_x, start_y, size, packet)
    else:
        _set_lens(lenses, lens, 0, size, scratch)
        _aim(optics, mosaic[0], lens >= 0, start_x, start_y, size, packet)
    trace_packet(table, x, y, z, dx, dy, dz, alive, scratch, size)


@unit
def send_mixed(table, optics, lenses, mosaic, lens, owner, start_x, start_y, size, packet):
    """The same for rays of several sensor positions: `lens` is that of each position, `owner` the position of each ray.

    A packet that is not full costs nearly as much as a full one, and a position may have two rays.
    """
    x, y, z, dx, dy, dz, alive, scratch, _ = packet
    aim_mixed(optics, lenses, mosaic, lens, owner, start_x, start_y, size, packet)
    trace_packet(table, x, y, z, dx, dy, dz, alive, scratch, size)


@unit
def aim_mixed(optics, lenses, mosaic, lens, owner, start_x, start_y, size, packet):
    """Send such rays as far as the main lens."""
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    plain, first = lens[owner[0]] < 0 or mosaic[0][MODEL] == PLAIN, 0
    while first < size:
        end, n = first + 1, lens[owner[first]]
        while end < size and owner[end] == owner[first]:
            end += 1
        if plain:
            _set_lens(lenses, n, first, end, scratch)
        else:
            here = slice(first, end)
            part = x[here], y[here], z[here], dx[here], dy[here], dz[here], alive[here], scratch, weight[here]
            _through(optics, lenses, mosaic, n, start_x[here], start_y[here], end - first, part)
        first = end
    if plain:
        _aim(optics, mosaic[0], lens[owner[0]] >= 0, start_x, start_y, size, packet)


@inline
def _through(optics, lenses, mosaic, lens, start_x, start_y, size, packet):
    """Aim rays through a microlens that is not plain."""
    through_microlens(optics, lenses, mosaic, lens, start_x, start_y, size, packet)
    _weigh(mosaic[0], lenses[lens, AIM], packet[8], packet[6], size)


@inline
def _set_lens(lenses, lens, first, end, scratch):
    """Keep the vertex and the power of a plain microlens for some rays of a packet; without one they go straight on.

    Nothing else needs the scratch arrays before the trace.
    """
    vx, vy, power = 0.0, 0.0, 0.0
    if lens >= 0:
        vx, vy, power = lenses[lens, 0], lenses[lens, 1], 1.0 / lenses[lens, 2]
    for i in range(first, end):
        scratch[0, i], scratch[1, i], scratch[2, i] = vx, vy, power


@inline
def _aim(optics, detail, has_lens, start_x, start_y, size, packet):
    """Directions behind plain microlenses, if any, and weights of rays from the sensor through points of the plane.

    A sample at distance d from the sensor position, on a plane at distance h from the sensor, weighs
    cos(theta) d omega = h^2 / d^4 dA: irradiance.
    """
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    h, plane = optics[1] - optics[0], optics[1]
    per_h, disc = 1.0 / h, detail[DISC]
    for i in range(size):
        sx, sy = (x[i] - start_x[i]) * per_h, (y[i] - start_y[i]) * per_h
        ax, ay = x[i] - scratch[0, i], y[i] - scratch[1, i]
        share = per_h / (1.0 + sx * sx + sy * sy)
        # An ideal thin lens changes slopes by offset / focal length.
        sx, sy = sx - ax * scratch[2, i], sy - ay * scratch[2, i]
        w = 1.0 / math.sqrt(1.0 + sx * sx + sy * sy)
        dx[i], dy[i], dz[i] = sx * w, sy * w, w
        weight[i] = share * share
        z[i] = plane
        alive[i] = 1.0
    if has_lens and disc > 0.0:
        for i in range(size):
            ax, ay = x[i] - scratch[0, i], y[i] - scratch[1, i]
            alive[i] = 1.0 if ax * ax + ay * ay <= disc * disc else 0.0
    _weigh(detail, h, weight, alive, size)


@inline
def _weigh(detail, h, weight, alive, size):
    """Acceptance and the kind of weight, from weights cos^4 / h^2."""
    limited, by_area = is_limited(detail), detail[BY_AREA] > 0.0
    if limited or by_area:
        for i in range(size):
            share = accepted_share(detail, math.sqrt(h * math.sqrt(weight[i]))) if limited else 1.0
            weight[i] = share if by_area else weight[i] * share
            alive[i] = alive[i] if share > 0.0 else 0.0
