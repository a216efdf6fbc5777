"""Position images by two kinds of rays: ours, and plain independent ones as a renderer starts them.

Both start anywhere on the square of a fine pixel (or at its centre), pass one microlens, if there are any, and weigh
their share of the irradiance. `ours` aims scrambled Sobol points at where light gets through the main lens: the rays of
a build. `independent` draws pseudo-random numbers and aims at the whole aperture of the microlens, whose blocked rays
are lost; without microlenses at the same outline as ours. Vision frame, mm.
"""

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.parts.polygon import fan
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.microlens_kernels import X, Y
from pipeline.camera.tracing.moments import cross
from pipeline.camera.tracing.packets import Aims, Anchor, aim_into, draw, region_drift, send_packet
from pipeline.camera.tracing.records import Samples, SensorPoints, Starts
from pipeline.camera.tracing.sampling_bounds import SKIP, Fan, bound, new_region
from pipeline.camera.tracing.sobol import hash32, sobol_bits
from pipeline.jit.decorators import inline, kernel
from pipeline.optics.kernels import PACKET, new_packet

SAMPLINGS = ("independent", "ours")
PRECISIONS = ("double", "single")
"""Of the sums: exact enough, or running sums in float32 of texture coordinates, as a renderer keeps them."""
_CIRCUMRADIUS = 0.7072
_PER_UINT32 = 2.3283064365386963e-10


def means(
    tracer: Tracer,
    sampling: str,
    positions_mm: np.ndarray,
    lens: np.ndarray,
    fine: np.ndarray,
    planes: np.ndarray,
    spans_mm: np.ndarray,
    samples: tuple[int, ...],
    width_mm: float,
    seed: int | None = None,
) -> np.ndarray:
    """Mean crossings of bundles with several planes after so many and so many samples; the rays are the same, and more.

    Parameters
    ----------
    sampling : str
        One of SAMPLINGS.
    positions_mm, lens : (n, 2) float64, (n,) int64
        On the sensor, and the microlens of each, NO_MICROLENS or SKIP.
    fine : (n, 2) int64
        What random numbers depend on: column and row of the fine grid.
    planes : (p, 4, 3) float64
        Rows origin, first axis, second axis, normal.
    spans_mm : (p, 2, 2) float64
        By plane and axis: where texture coordinates are 0, and the length on which they grow by 1.
    samples : tuple of int
        Ascending multiples of 1024.
    width_mm : float
        Of a fine pixel; 0: all rays start at its centre.
    seed : int, optional
        Other random numbers than those of the dataset.

    Returns
    -------
    (len(PRECISIONS), n, len(samples), p, 2) float64
        In the planes' own axes [mm]; NaN where nothing passes.
    """
    if tracer.camera.microlenses is not None and not tracer.camera.microlenses.is_plain:
        raise ValueError("sampled are plain microlenses: thin, untilted")
    stops = np.array(samples) // REPLICAS
    if (stops % PACKET).any() or (np.diff(stops) <= 0).any():
        raise ValueError(f"samples must ascend in multiples of {REPLICAS * PACKET}, not {samples}")
    result = np.full((len(PRECISIONS), len(positions_mm), len(samples), len(planes), 2), np.nan)
    seed = tracer.seed if seed is None else seed
    samples = Samples(sobol_bits(int(stops[-1])), seed & 0xFFFFFFFF ^ seed >> 32 & 0xFFFFFFFF, width_mm)
    positions = np.ascontiguousarray(positions_mm, float)
    starts = Starts(np.ascontiguousarray(fine, np.int64), positions, positions, np.ascontiguousarray(lens, np.int64))
    planes, spans_mm = np.ascontiguousarray(planes), np.ascontiguousarray(spans_mm)
    _means(tracer.arrays, (planes, spans_mm), samples, starts, sampling == "independent", stops, result)
    return result


@kernel
def _means(camera, textures, samples, starts, independent, stops, result):
    (planes, spans), (bits, seed, width) = textures, samples
    fine, _, positions, microlens = starts
    region, packet = new_region(), new_packet()
    x, y = packet.x, packet.y
    start_x, start_y = np.empty(PACKET), np.empty(PACKET)
    start = SensorPoints(start_x, start_y)
    pivot, sums = np.zeros((planes.shape[0], 2)), np.zeros((planes.shape[0], 3))
    single = np.zeros((planes.shape[0], 3), np.float32)
    for n in range(positions.shape[0]):
        if microlens[n] == SKIP:
            continue
        sx, sy = positions[n]
        if independent and microlens[n] >= 0:
            fan_of = _whole_aperture(camera, microlens[n], region)
        else:
            fan_of = bound(camera, microlens[n], sx, sy, _CIRCUMRADIUS * width, region)
        if not fan_of.area > 0.0:
            continue
        base = hash32(hash32(seed, fine[n, 0]), fine[n, 1])
        started, stop = False, 0
        sums[:], single[:] = 0.0, np.float32(0.0)
        for block in range(REPLICAS * (stops[-1] // PACKET)):
            r, first = block % REPLICAS, block // REPLICAS * PACKET
            for d, values in enumerate((x, y, start_x, start_y)):
                # Streams as in a build: aim 0, 1 of each replica, then the place on the pixel.
                stream = 2 * r + d if d < 2 else 2 * REPLICAS + 2 * r + d - 2
                if independent:
                    _pseudo_random(hash32(base, 64 + d), block * PACKET, values)
                else:
                    draw(bits[d], first, PACKET, hash32(base, stream), values)
            for i in range(PACKET):
                start_x[i] = sx + width * (start_x[i] - 0.5)
                start_y[i] = sy + width * (start_y[i] - 0.5)
            anchor = Anchor(sx, sy, region_drift(camera, microlens[n]))
            aim_into(region, fan_of, anchor, Aims(x, y, start_x, start_y, packet.scratch))
            send_packet(camera, microlens[n], start, PACKET, packet)
            for p in range(planes.shape[0]):
                started_here = _add(planes[p], packet, started, pivot[p], sums[p])
                _add_single(spans[p], packet, single[p])
            started = started_here
            if block + 1 == REPLICAS * (stops[stop] // PACKET):
                if started:
                    for p in range(planes.shape[0]):
                        for axis in range(2):
                            result[0, n, stop, p, axis] = pivot[p, axis] + sums[p, 1 + axis] / sums[p, 0]
                            share = single[p, 1 + axis] / single[p, 0]
                            result[1, n, stop, p, axis] = spans[p, axis, 0] + spans[p, axis, 1] * share
                stop += 1


@inline
def _add(plane, packet, started, pivot, sums):
    """Add the weight and the crossings of a packet about a pivot, the first crossing; whether there was a ray yet."""
    x, y, z, dx, dy, dz, alive, scratch, weight = packet
    for i in range(PACKET):
        scratch[0, i], scratch[1, i] = cross(plane, x[i], y[i], z[i], dx[i], dy[i], dz[i])
    if not started:
        for i in range(PACKET):
            if alive[i] > 0.0:
                pivot[0], pivot[1] = scratch[0, i], scratch[1, i]
                started = True
                break
    total, first, second = 0.0, 0.0, 0.0
    if started:
        for i in range(PACKET):
            # Nothing is added for a blocked ray; its crossing may be NaN.
            if alive[i] > 0.0:
                total += weight[i]
                first += weight[i] * (scratch[0, i] - pivot[0])
                second += weight[i] * (scratch[1, i] - pivot[1])
    sums[0] += total
    sums[1] += first
    sums[2] += second
    return started


@inline
def _add_single(span, packet, sums):
    """Add to running sums in float32 as a renderer does to its image; crossings are those that `_add` left."""
    total, first, second = sums[0], sums[1], sums[2]
    for i in range(PACKET):
        if packet.alive[i] > 0.0:
            light = np.float32(packet.weight[i])
            total += light
            first += light * np.float32((packet.scratch[0, i] - span[0, 0]) / span[0, 1])
            second += light * np.float32((packet.scratch[1, i] - span[1, 0]) / span[1, 1])
    sums[0], sums[1], sums[2] = total, first, second


@inline
def _whole_aperture(camera, microlens, region):
    """The aperture of a microlens as a fan, as `regions.bound` returns it."""
    aperture, polygon, count = camera.aperture, region.polygon, camera.aperture.shape[0]
    x, y = camera.microlenses[microlens, X], camera.microlenses[microlens, Y]
    for i in range(count):
        polygon[i, 0], polygon[i, 1] = aperture[i, 0] + x, aperture[i, 1] + y
    cx, cy, area = fan(polygon, count, region.cumulative)
    return Fan(count, cx, cy, area)


@inline
def _pseudo_random(stream, first, values):
    """Numbers first, first + 1, ... of a stream, hashed twice, in [0, 1)."""
    for i in range(values.shape[0]):
        values[i] = hash32(hash32(stream, first + i), 0) * _PER_UINT32
