"""Moments of a bundle's crossings with two planes: sums over packets, then means, covariances and errors.

A crossing q = (a, b, c, d) holds coordinates on the first and on the second plane. With weights w, the mean is m = sum
w q / sum w and the covariance C_ij = sum w q_i q_j / sum w - m_i m_j. Sums are taken about a first crossing, the pivot,
because spreads are a millionth of the squared positions.
"""

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.jit.decorators import inline, opaque, unit
from pipeline.records.shapes import Float64

MEAN, COVARIANCE, WEIGHT, FREE_WEIGHT, VARIANCE, COLUMNS = 0, 4, 14, 15, 16, 20
"""Columns of a bundle's moments: mean (4), covariance (10, upper triangle), weight that leaves, free weight, and the
squared standard error of the mean (4); the last is their number."""
ORIGIN, FIRST, SECOND, NORMAL = range(4)
"""Rows of a plane: a point of it, its two axes, its normal."""


@inline
def cross(plane, px, py, pz, dx, dy, dz):
    """Coordinates of a ray's intersection with a plane along its axes, from its origin [mm]."""
    normal_component = plane[NORMAL, 0] * dx + plane[NORMAL, 1] * dy + plane[NORMAL, 2] * dz
    rx, ry, rz = plane[ORIGIN, 0] - px, plane[ORIGIN, 1] - py, plane[ORIGIN, 2] - pz
    t = (plane[NORMAL, 0] * rx + plane[NORMAL, 1] * ry + plane[NORMAL, 2] * rz) / normal_component
    hx, hy, hz = t * dx - rx, t * dy - ry, t * dz - rz
    return (
        plane[FIRST, 0] * hx + plane[FIRST, 1] * hy + plane[FIRST, 2] * hz,
        plane[SECOND, 0] * hx + plane[SECOND, 1] * hy + plane[SECOND, 2] * hz,
    )


@unit
def cross_packet(near, far, packet, first, end, crossing):
    """Intersections of some rays of a packet with both planes, (4, PACKET) [mm]."""
    x, y, z, dx, dy, dz = packet.x, packet.y, packet.z, packet.dx, packet.dy, packet.dz
    for i in range(first, end):
        crossing[0, i], crossing[1, i] = cross(near, x[i], y[i], z[i], dx[i], dy[i], dz[i])
        crossing[2, i], crossing[3, i] = cross(far, x[i], y[i], z[i], dx[i], dy[i], dz[i])


@inline
def set_pivot(crossing, alive, first, end, pivot):
    """Set the pivot to the crossing of the first ray that passes; returns whether there is one."""
    for i in range(first, end):
        if alive[i] > 0.0:
            for k in range(4):
                pivot[k] = crossing[k, i]
            return True
    return False


@inline
def clear(sums, total):
    """Reset the sums."""
    for r in range(sums.shape[0]):
        for k in range(sums.shape[1]):
            sums[r, k] = 0.0
    for k in range(total.shape[0]):
        total[k] = 0.0


@unit
def accumulate(crossing, weight, alive, first, end, pivot, sums, total):
    """Add weights, first and second moments about the pivot for some rays of a packet; the sums stay in registers."""
    p0, p1, p2, p3 = pivot[0], pivot[1], pivot[2], pivot[3]
    w0 = m0 = m1 = m2 = m3 = 0.0
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = c7 = c8 = c9 = 0.0
    for i in range(first, end):
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


@opaque
def finish(sums, total, pivot, sample_area, row):
    """Turn sums into the columns of a bundle's moments.

    `sums`, `total`: weight and first moments of each replica (REPLICAS, 5), second moments of all (10,).
    `sample_area`: area of the sampling region per sample [mm^2].
    """
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
        # From the spread of the replicas' own means; NaN where one of them is empty.
        spread = 0.0
        for r in range(REPLICAS):
            spread += (sums[r, 1 + a] / sums[r, 0] - row[MEAN + a]) ** 2
        row[VARIANCE + a] = spread / (REPLICAS - 1) / REPLICAS
        row[MEAN + a] += pivot[a]


def mixed(moments: Float64[np.ndarray, "n m COLUMNS"], share: Float64[np.ndarray, "m"]) -> np.ndarray:
    """Moments of mixtures of bundles, such as points of a square or wavelengths, (n, COLUMNS).

    Errors of the parts are independent; NaN, with weight 0, where nothing passes.
    `share`: weight of each part in the mixture if all pass alike; negative: the part is subtracted.
    """
    weight = moments[..., WEIGHT] * share
    result = np.zeros((len(moments), COLUMNS))
    result[:, WEIGHT] = weight.sum(axis=1)
    result[:, FREE_WEIGHT] = moments[..., FREE_WEIGHT] @ share
    with np.errstate(invalid="ignore", divide="ignore"):  # dark mixtures
        fraction = weight / result[:, WEIGHT, None]
    # Parts without weight have NaN for moments, and count for nothing.
    lit = np.where(weight[..., None] != 0, moments, 0.0)
    mean = np.einsum("nm,nma->na", fraction, lit[..., MEAN:COVARIANCE])
    # The covariance of a mixture is the mean of those of its parts, and of the squares of their means' deviations.
    deviation = lit[..., MEAN:COVARIANCE] - mean[:, None]
    rows, columns = np.triu_indices(4)
    products = lit[..., COVARIANCE:WEIGHT] + deviation[..., rows] * deviation[..., columns]
    result[:, MEAN:COVARIANCE] = mean
    result[:, COVARIANCE:WEIGHT] = np.einsum("nm,nma->na", fraction, products)
    result[:, VARIANCE:] = np.einsum("nm,nma->na", fraction**2, lit[..., VARIANCE:])
    return result
