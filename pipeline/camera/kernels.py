"""Bundles: from a sensor position through one microlens, or none, and the main lens to rays in the scene.

Vision frame, mm. A conventional camera samples the rear vertex plane, a plenoptic one the plane of its microlenses; all
else is the same code. `lens` is the row of a microlens, `NO_MICROLENS`, or `SKIP`.

A sample at distance d from the sensor position, on a plane at distance h from the sensor, weighs
cos(theta) d omega = h^2 / d^4 dA: irradiance.
"""

import math

import numpy as np

from pipeline.camera.polygon import MAX_VERTICES, clip, fan, point_in_fan, projected_solid_angle
from pipeline.camera.sobol import hash32, scrambled
from pipeline.jit import inline, kernel
from pipeline.optics.kernels import PACKET, trace_packet

NO_MICROLENS, SKIP = -1, -2
REPLICAS = 4
MEAN, COVARIANCE, WEIGHT, FREE_WEIGHT, VARIANCE, COLUMNS = 0, 4, 14, 15, 16, 20
"""Columns of a bundle's moments: mean (4), covariance (10, upper triangle), weight that leaves, free weight, and the
squared standard error of the mean (4); the last is their number."""
_IMAGE_STREAM = 1 << 16


@inline
def outline_at(step, outlines, x, y, polygon):
    """The outline on the rear vertex plane for a point (x, y), interpolated in height and turned to its azimuth."""
    height = math.sqrt(x * x + y * y)
    position = min(height / step, outlines.shape[0] - 1.0)
    i = min(int(position), outlines.shape[0] - 2)
    f = position - i
    c, s = (x / height, y / height) if height > 0.0 else (1.0, 0.0)
    for j in range(outlines.shape[1]):
        px = (1.0 - f) * outlines[i, j, 0] + f * outlines[i + 1, j, 0]
        py = (1.0 - f) * outlines[i, j, 1] + f * outlines[i + 1, j, 1]
        polygon[j, 0], polygon[j, 1] = c * px - s * py, s * px + c * py
    return outlines.shape[1]


@inline
def microlens_region(optics, outlines, lenses, aperture, lens, x, y, slack, polygon, outline, scratch):
    """The part of a microlens aperture whose rays can pass the main lens, for a sensor position; its vertex count.

    With L the distance from array to rear vertex, B from sensor to array and a the offset from the vertex v, the ray
    meets the rear vertex plane at r = v + L (v - s) / B + a (1 + L / B - L / f): the outline clips a, mapped back.
    """
    sensor_z, plane_z, rear_z, step = optics[0], optics[1], optics[2], optics[3]
    vx, vy, focal = lenses[lens, 0], lenses[lens, 1], lenses[lens, 2]
    behind, ahead = plane_z - sensor_z, rear_z - plane_z
    scale = 1.0 + ahead / behind - ahead / focal
    bx, by = vx + ahead * (vx - x) / behind, vy + ahead * (vy - y) / behind
    count = aperture.shape[0]
    for i in range(count):
        polygon[i, 0], polygon[i, 1] = aperture[i, 0], aperture[i, 1]
    size = outline_at(step, outlines, vx, vy, outline)
    reach = slack * ahead / behind / abs(scale)
    for j in range(size):
        k = j + 1 if j + 1 < size else 0
        ex, ey = outline[k, 0] - outline[j, 0], outline[k, 1] - outline[j, 1]
        length = math.sqrt(ex * ex + ey * ey)
        if length == 0.0:
            return 0
        # Outward normal of a counter-clockwise edge; a negative scale mirrors the region through its centre.
        nx, ny = ey / length, -ex / length
        limit = nx * (outline[j, 0] - bx) + ny * (outline[j, 1] - by)
        sign = 1.0 if scale > 0.0 else -1.0
        count = clip(polygon, count, sign * nx, sign * ny, limit / abs(scale) + reach, scratch)
        if count < 3:
            return 0
    for i in range(count):
        polygon[i, 0] += vx
        polygon[i, 1] += vy
    return count


@inline
def region(optics, outlines, lenses, aperture, lens, x, y, slack, polygon, outline, scratch):
    """Sampling region of a sensor position as a polygon on the sampling plane; returns its vertex count."""
    if lens == NO_MICROLENS:
        return outline_at(optics[3], outlines, x, y, polygon)
    return microlens_region(optics, outlines, lenses, aperture, lens, x, y, slack, polygon, outline, scratch)


@inline
def start_ray(optics, lenses, lens, x, y, qx, qy):
    """Direction behind the microlens, if any, and weight of the ray from the sensor at (x, y) to (qx, qy)."""
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


@inline
def cross(plane, px, py, pz, dx, dy, dz):
    """Coordinates of a ray's crossing with a plane given by rows origin, first axis, second axis, normal."""
    along = plane[3, 0] * dx + plane[3, 1] * dy + plane[3, 2] * dz
    rx, ry, rz = plane[0, 0] - px, plane[0, 1] - py, plane[0, 2] - pz
    t = (plane[3, 0] * rx + plane[3, 1] * ry + plane[3, 2] * rz) / along
    hx, hy, hz = t * dx - rx, t * dy - ry, t * dz - rz
    return (
        plane[1, 0] * hx + plane[1, 1] * hy + plane[1, 2] * hz,
        plane[2, 0] * hx + plane[2, 1] * hy + plane[2, 2] * hz,
    )


@kernel
def bundle_moments(optics, table, outlines, lenses, aperture, planes, bits, seed, pixels, positions, lens, moments):
    """Moments of the bundles of many sensor positions on two planes.

    Parameters
    ----------
    optics : (4,) float64
        z of sensor, sampling plane and rear vertex plane; height step of the outlines.
    table : (s, 4) float64
        Surfaces, from `optics.table.towards_scene`.
    outlines : (h, d, 2) float64
        From `camera.pupil`.
    lenses : (m, 3) float64
        Vertex x, y and focal length of every microlens.
    aperture : (c, 2) float64
        Outline of a microlens aperture around its vertex, counter-clockwise.
    planes : (2, 4, 3) float64
        Two planes as rows origin, first axis, second axis, normal.
    bits : (samples / REPLICAS, DIMENSIONS) uint32
        From `camera.sobol`.
    pixels : (n, 2) int64
        What random numbers depend on besides the seed.
    positions : (n, 2) float64
        On the sensor.
    lens : (n,) int64
        Microlens of each position.
    moments : (n, COLUMNS) float64
        Written; NaN where the bundle is empty.
    """
    polygon, outline = np.empty((MAX_VERTICES, 2)), np.empty((MAX_VERTICES, 2))
    scratch, cumulative = np.empty((MAX_VERTICES, 2)), np.empty(MAX_VERTICES)
    x, y, z = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    dx, dy, dz = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    alive, cosine, weight = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    sums, total, pivot = np.zeros((REPLICAS, 5)), np.zeros(10), np.zeros(4)
    crossing = np.empty((4, PACKET))
    first_bits, second_bits = np.ascontiguousarray(bits[:, 0]), np.ascontiguousarray(bits[:, 1])
    near, far, samples = planes[0], planes[1], bits.shape[0]
    for n in range(positions.shape[0]):
        moments[n, :] = np.nan
        moments[n, WEIGHT], moments[n, FREE_WEIGHT] = 0.0, 0.0
        if lens[n] == SKIP:
            continue
        sx, sy = positions[n]
        if lens[n] >= 0:
            moments[n, FREE_WEIGHT] = projected_solid_angle(
                aperture, aperture.shape[0], sx - lenses[lens[n], 0], sy - lenses[lens[n], 1], optics[1] - optics[0]
            )
        count = region(optics, outlines, lenses, aperture, lens[n], sx, sy, 0.0, polygon, outline, scratch)
        if count < 3:
            continue
        cx, cy, area = fan(polygon, count, cumulative)
        if not area > 0.0:
            continue
        base = hash32(hash32(seed, pixels[n, 0]), pixels[n, 1])
        sums[:] = 0.0
        total[:] = 0.0
        started = False
        for packet in range(REPLICAS * ((samples + PACKET - 1) // PACKET)):
            r, first = packet % REPLICAS, packet // REPLICAS * PACKET
            size = min(PACKET, samples - first)
            u_seed, v_seed = hash32(base, 2 * r), hash32(base, 2 * r + 1)
            for i in range(size):
                x[i] = scrambled(first_bits[first + i], u_seed)
            for i in range(size):
                y[i] = scrambled(second_bits[first + i], v_seed)
            for i in range(size):
                x[i], y[i] = point_in_fan(polygon, count, cumulative, cx, cy, x[i], y[i])
            for i in range(size):
                dx[i], dy[i], dz[i], weight[i] = start_ray(optics, lenses, lens[n], sx, sy, x[i], y[i])
                z[i] = optics[1]
                alive[i] = 1.0
            trace_packet(table, x, y, z, dx, dy, dz, alive, cosine, size)
            for i in range(size):
                crossing[0, i], crossing[1, i] = cross(near, x[i], y[i], z[i], dx[i], dy[i], dz[i])
                crossing[2, i], crossing[3, i] = cross(far, x[i], y[i], z[i], dx[i], dy[i], dz[i])
            if not started:
                for i in range(size):
                    if alive[i] > 0.0:
                        # Sums run about the first crossing: spreads are a millionth of the squared positions.
                        pivot[:] = crossing[:, i]
                        started = True
                        break
            if started:
                _accumulate(crossing, weight, alive, size, pivot, sums[r], total)
        if started:
            _finish(sums, total, pivot, area / (samples * REPLICAS), moments[n])


@inline
def _accumulate(crossing, weight, alive, size, pivot, sums, total):
    """Add a packet's weights, first and second moments about the pivot; sums stay in registers."""
    p0, p1, p2, p3 = pivot[0], pivot[1], pivot[2], pivot[3]
    w0 = m0 = m1 = m2 = m3 = 0.0
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = c7 = c8 = c9 = 0.0
    for i in range(size):
        if alive[i] == 0.0:
            continue
        w = weight[i]
        a, b, c, d = crossing[0, i] - p0, crossing[1, i] - p1, crossing[2, i] - p2, crossing[3, i] - p3
        wa, wb, wc, wd = w * a, w * b, w * c, w * d
        w0 += w
        m0, m1, m2, m3 = m0 + wa, m1 + wb, m2 + wc, m3 + wd
        c0, c1, c2, c3 = c0 + wa * a, c1 + wa * b, c2 + wa * c, c3 + wa * d
        c4, c5, c6 = c4 + wb * b, c5 + wb * c, c6 + wb * d
        c7, c8, c9 = c7 + wc * c, c8 + wc * d, c9 + wd * d
    for k, value in enumerate((w0, m0, m1, m2, m3)):
        sums[k] += value
    for k, value in enumerate((c0, c1, c2, c3, c4, c5, c6, c7, c8, c9)):
        total[k] += value


@inline
def _finish(sums, total, pivot, sample_area, row):
    weight = 0.0
    for r in range(REPLICAS):
        weight += sums[r, 0]
    row[WEIGHT] = weight * sample_area
    for a in range(4):
        mean = 0.0
        for r in range(REPLICAS):
            mean += sums[r, 1 + a]
        row[MEAN + a] = mean / weight
    k = 0
    for a in range(4):
        for b in range(a, 4):
            row[COVARIANCE + k] = total[k] / weight - row[MEAN + a] * row[MEAN + b]
            k += 1
    for a in range(4):
        # Standard error of the mean from the spread of the replicas' own means; NaN where one of them is empty.
        spread = 0.0
        for r in range(REPLICAS):
            spread += (sums[r, 1 + a] / sums[r, 0] - row[MEAN + a]) ** 2
        row[VARIANCE + a] = spread / (REPLICAS - 1) / REPLICAS
        row[MEAN + a] += pivot[a]


@kernel
def image_rays(
    optics,
    table,
    outlines,
    lenses,
    aperture,
    bits,
    seed,
    pitch,
    pixels,
    positions,
    strata,
    origin,
    direction,
    weight,
    owner,
):
    """Rays that leave the camera from the squares of many pixels, compacted.

    Parameters
    ----------
    pitch : float
        Edge of a pixel; rays start anywhere on it.
    strata : (n, s) int64
        Microlenses that light of a pixel may pass, or `NO_MICROLENS`; `SKIP` fills up.
    origin, direction : (n * s * samples, 3) float64
        Written: a point behind the front vertex and the unit direction, vision frame.
    weight : (n * s * samples,) float64
        Written: share of the pixel's integral of cos(theta) d omega [sr].
    owner : (n * s * samples,) int64
        Written: row of the pixel.

    Returns
    -------
    int
        Number of rays written. The other parameters are those of `bundle_moments`.
    """
    polygon, outline = np.empty((MAX_VERTICES, 2)), np.empty((MAX_VERTICES, 2))
    scratch, cumulative = np.empty((MAX_VERTICES, 2)), np.empty(MAX_VERTICES)
    x, y, z = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    dx, dy, dz = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    alive, cosine, share = np.empty(PACKET), np.empty(PACKET), np.empty(PACKET)
    samples, written = bits.shape[0], 0
    digits = np.ascontiguousarray(bits.T)
    for n in range(positions.shape[0]):
        base = hash32(hash32(seed, pixels[n, 0]), pixels[n, 1])
        for j in range(strata.shape[1]):
            lens = strata[n, j]
            if lens == SKIP:
                continue
            sx, sy = positions[n]
            slack = 0.7072 * pitch
            count = region(optics, outlines, lenses, aperture, lens, sx, sy, slack, polygon, outline, scratch)
            if count < 3:
                continue
            cx, cy, area = fan(polygon, count, cumulative)
            if not area > 0.0:
                continue
            stream = _IMAGE_STREAM + 4 * j
            s0, s1 = hash32(base, stream), hash32(base, stream + 1)
            s2, s3 = hash32(base, stream + 2), hash32(base, stream + 3)
            for first in range(0, samples, PACKET):
                size = min(PACKET, samples - first)
                for i in range(size):
                    x[i], y[i] = scrambled(digits[2, first + i], s2), scrambled(digits[3, first + i], s3)
                for i in range(size):
                    # Where on the pixel the ray starts, kept in the arrays of its direction.
                    dx[i] = sx + pitch * (scrambled(digits[0, first + i], s0) - 0.5)
                    dy[i] = sy + pitch * (scrambled(digits[1, first + i], s1) - 0.5)
                for i in range(size):
                    x[i], y[i] = point_in_fan(polygon, count, cumulative, cx, cy, x[i], y[i])
                for i in range(size):
                    dx[i], dy[i], dz[i], share[i] = start_ray(optics, lenses, lens, dx[i], dy[i], x[i], y[i])
                    z[i] = optics[1]
                    alive[i] = 1.0
                trace_packet(table, x, y, z, dx, dy, dz, alive, cosine, size)
                for i in range(size):
                    if alive[i] > 0.0:
                        origin[written] = x[i], y[i], z[i]
                        direction[written] = dx[i], dy[i], dz[i]
                        weight[written] = share[i] * area / samples
                        owner[written] = n
                        written += 1
    return written
