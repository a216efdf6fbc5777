"""Packets of rays that start on the sensor: random points on a region, aim, weight. Kernels only; vision frame, mm."""

import math
from typing import NamedTuple

from pipeline.camera.parts.polygon import point_in_fan
from pipeline.camera.tracing.acceptance import BY_AREA, accepted_share, is_limited
from pipeline.camera.tracing.microlens_kernels import AIM, DISC, MODEL, PLAIN, through_microlens
from pipeline.camera.tracing.sobol import scrambled
from pipeline.jit.decorators import inline, unit
from pipeline.optics.crossing import Ray, put, ray_of
from pipeline.optics.kernels import Packet, trace_packet


class Plain(NamedTuple):
    """A plain microlens: its vertex [mm] and its power [1/mm], 0 for none."""

    x: float
    y: float
    power: float


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
    if lens >= 0 and mosaic[0][MODEL] != PLAIN:
        _through(optics, lenses, mosaic, lens, start_x, start_y, size, packet)
    else:
        _set_lens(lenses, lens, 0, size, packet.scratch)
        _aim(optics, mosaic[0], lens >= 0, start_x, start_y, size, packet)
    trace_packet(table, packet, size)


@unit
def send_mixed(table, optics, lenses, mosaic, lens, owner, start_x, start_y, size, packet):
    """The same for rays of several sensor positions: `lens` is that of each position, `owner` the position of each ray.

    A packet that is not full costs nearly as much as a full one, and a position may have two rays.
    """
    aim_mixed(optics, lenses, mosaic, lens, owner, start_x, start_y, size, packet)
    trace_packet(table, packet, size)


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
            part = Packet(x[here], y[here], z[here], dx[here], dy[here], dz[here], alive[here], scratch, weight[here])
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
    plain = plain_lens(lenses, lens)
    for i in range(first, end):
        scratch[0, i], scratch[1, i], scratch[2, i] = plain


@inline
def plain_lens(lenses, lens):
    """A plain microlens; none bends nothing."""
    if lens < 0:
        return Plain(0.0, 0.0, 0.0)
    return Plain(lenses[lens, 0], lenses[lens, 1], 1.0 / lenses[lens, 2])


@inline
def _aim(optics, detail, has_lens, start_x, start_y, size, packet):
    """Directions behind plain microlenses, if any, and weights of rays from the sensor through points of the plane."""
    scratch = packet.scratch
    h, plane = optics[1] - optics[0], optics[1]
    per_h, disc = 1.0 / h, detail[DISC]
    for i in range(size):
        lens = Plain(scratch[0, i], scratch[1, i], scratch[2, i])
        ray, packet.weight[i] = aimed(lens, per_h, plane, start_x[i], start_y[i], packet.x[i], packet.y[i])
        put(packet, i, ray)
    if has_lens and disc > 0.0:
        for i in range(size):
            packet.alive[i] = within_disc(disc, scratch[0, i], scratch[1, i], ray_of(packet, i))
    _weigh(detail, h, packet.weight, packet.alive, size)


@inline
def aimed(lens, per_h, plane, start_x, start_y, x, y):
    """The ray from a sensor position through a point (x, y) of the plane behind a plain microlens, and its weight.

    A sample at distance d from the sensor position, on a plane at distance h from the sensor, weighs
    cos(theta) d omega = h^2 / d^4 dA: irradiance.
    """
    sx, sy = (x - start_x) * per_h, (y - start_y) * per_h
    ax, ay = x - lens.x, y - lens.y
    share = per_h / (1.0 + sx * sx + sy * sy)
    # An ideal thin lens changes slopes by offset / focal length.
    sx, sy = sx - ax * lens.power, sy - ay * lens.power
    w = 1.0 / math.sqrt(1.0 + sx * sx + sy * sy)
    return Ray(x, y, plane, sx * w, sy * w, w, 1.0), share * share


@inline
def within_disc(disc, vx, vy, ray):
    """Whether a ray passes the disc about a vertex: 1 or 0."""
    ax, ay = ray.x - vx, ray.y - vy
    return 1.0 if ax * ax + ay * ay <= disc * disc else 0.0


@inline
def _weigh(detail, h, weight, alive, size):
    """Acceptance and the kind of weight, from weights cos^4 / h^2."""
    if is_limited(detail) or detail[BY_AREA] > 0.0:
        for i in range(size):
            weight[i], alive[i] = weighed(detail, h, weight[i], alive[i])


@inline
def weighed(detail, h, weight, alive):
    """Weight and flag of a ray by acceptance and the kind of weight, from a weight cos^4 / h^2."""
    share = accepted_share(detail, math.sqrt(h * math.sqrt(weight))) if is_limited(detail) else 1.0
    return share if detail[BY_AREA] > 0.0 else weight * share, alive if share > 0.0 else 0.0
