"""How fast does a device trace rays, against one core of the processor, in one run? And do both agree?

    python benchmarks/gpu.py [--small]

Rays through the lens of example 01 alone, in float64 and float32; moments of bundles, in float64; rays of images, in
float32. Times are by the clock around each call. Where no CUDA device can be used it says so and measures nothing.
"""

import argparse
import dataclasses
import statistics
import time
from collections.abc import Callable

import numpy as np
from kept import keeping
from lenses import EXAMPLES, table_of, tronnier

import pipeline
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.errors import EnvironmentFault
from pipeline.jit.binding import Single
from pipeline.jit.decorators import inline
from pipeline.jit.device import DeviceKernel, cuda, device_name, fetched, is_simulated, resident
from pipeline.optics.kernels import SCRATCH, Packet, trace_packet, trace_rays
from pipeline.render.imaging import irradiance

AGREEMENT_MM = 1e-9
"""Differences of means of bundles: both are float64."""
SINGLE, FEW = 1e-5, 1e-3
"""Differences of the light of pixels, relative to white, and the share of pixels that may differ by more: at the edge
of an aperture a ray may pass in one precision only. `benchmarks/single.py` says more."""
SINGLE_MM = 1e-3
"""Differences of rays behind a lens in float32."""
_TURNS, _THREADS, _FIELD_DEG = 5, 256, 10.0
Timed = dict[str, Callable[[], np.ndarray]]
trace_single = Single(trace_packet, STILL_MM=1e-3, RESIDUAL_MM=1e-4)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few rays: does it run at all?")
    small = parser.parse_args().small
    try:
        device = device_name()
    except EnvironmentFault as error:
        print(f"nothing is measured: {error}")
        return
    if is_simulated():
        print("nothing is measured: the simulator says what a device computes, not how fast")
        return
    with keeping("gpu"):
        print(f"{device}; processor: one core")
        lens_alone(device, 1 << (16 if small else 24))
        for name in ("01_conventional", "02_plenoptic"):
            bundles(name, device, 2_000 if small else 200_000)
            images(name, device, (190, 191 if small else 290))


@DeviceKernel
def lens_in_double(table, rays):  # type: ignore[no-untyped-def]
    """Trace one ray per thread where it lies, (7, n)."""
    scratch, i = cuda.local.array((SCRATCH, 1), np.float64), cuda.grid(1)
    if i < rays.shape[1]:
        trace_packet(table, packet_at(rays, i, scratch), 1)


@DeviceKernel
def lens_in_single(table, rays):  # type: ignore[no-untyped-def]
    """The same in float32."""
    scratch, i = cuda.local.array((SCRATCH, 1), np.float32), cuda.grid(1)
    if i < rays.shape[1]:
        trace_single(table, packet_at(rays, i, scratch), 1)


@inline
def packet_at(rays, i, scratch):  # type: ignore[no-untyped-def]
    """One ray of many as a packet."""
    x, y, z, dx, dy, dz, alive = (
        rays[0, i:],
        rays[1, i:],
        rays[2, i:],
        rays[3, i:],
        rays[4, i:],
        rays[5, i:],
        rays[6, i:],
    )
    return Packet(x, y, z, dx, dy, dz, alive, scratch, x)


def lens_alone(device: str, count: int) -> None:
    """Rays through a lens, which are on the device before and after; the processor traces a hundredth of them."""
    race = tronnier()
    position, direction = race.rays(1 << 16, _FIELD_DEG)
    start = position - [0.0, 0.0, race.prescription.vertices_mm[race.prescription.stop_index]]
    rays = np.tile(np.vstack([start.T, direction.T, np.ones(len(start))]), max(1, count >> 16))
    table = table_of(race)
    ends = _in_rows_of_three(rays[:, : 1 << 16])
    trace_rays(table, *ends)
    for kernel, kind in ((lens_in_double, np.float64), (lens_in_single, np.float32)):
        device_table, seconds = resident(table.astype(kind)), []
        for _ in range(_TURNS + 1):
            device_rays = resident(rays.astype(kind))
            begin = time.perf_counter()
            kernel(-(-rays.shape[1] // _THREADS), _THREADS, device_table, device_rays)
            fetched(device_rays[0, :1])  # waits for the kernel
            seconds.append(time.perf_counter() - begin)
        traced = fetched(device_rays)[:, : 1 << 16]
        told(f"lens alone, {np.dtype(kind).name}, {device}", rays.shape[1], seconds[1:])
        agree("lens alone", ends[0][:, :2].T, traced[:2], AGREEMENT_MM if kind is np.float64 else SINGLE_MM, "mm")
    fewer, seconds = rays[:, : max(1 << 16, count // 100)], []
    for _ in range(_TURNS):
        ends = _in_rows_of_three(fewer)
        begin = time.perf_counter()
        trace_rays(table, *ends)
        seconds.append(time.perf_counter() - begin)
    told("lens alone, float64, processor", fewer.shape[1], seconds)


def _in_rows_of_three(rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions and directions (n, 3), and flags (n,), of rays (7, n) as the device has them."""
    return np.ascontiguousarray(rays[:3].T), np.ascontiguousarray(rays[3:6].T), rays[6].copy()


def bundles(name: str, device: str, count: int) -> None:
    """Bundles spread over the sensor of an example, copies included."""
    entry = pipeline.open_dataset(EXAMPLES / name / "dataset.usda").cameras[0]
    tracer, sensor, samples = Tracer(entry.camera, entry.sampling.seed), entry.camera.sensor, entry.sampling.samples
    i = np.arange(count)
    x, y = (i + 0.5) / count * sensor.width_px - 0.5, i * 0.6180339887498949 % 1.0 * sensor.height_px - 0.5
    positions = tracer.positions_mm(x, y)
    lens = Rig.of(tracer).microlens_at(positions)
    pixels = np.stack([np.rint(x), np.rint(y)], axis=1)
    assert entry.camera.near_mm is not None
    assert entry.camera.far_mm is not None
    planes = parallel_planes(entry.camera.near_mm, entry.camera.far_mm)

    def moments(tracer: Tracer) -> np.ndarray:
        return tracer.moments(positions, lens, planes, samples, pixels)[:, :4]

    on_device = dataclasses.replace(tracer, device=device)
    machines: Timed = {"processor": lambda: moments(tracer), device: lambda: moments(on_device)}
    agree(name, *race(f"{name}, bundles of {samples}, float64", machines, count * samples), AGREEMENT_MM, "mm")


def images(name: str, device: str, rows: tuple[int, int]) -> None:
    """Rows of the white image of an example, copies and the sums of pixels included."""
    entry = pipeline.open_dataset(EXAMPLES / name / "dataset.usda").cameras[0]
    rig, samples = Rig.of(Tracer(focused(entry.camera), entry.sampling.seed)), entry.image_samples
    on_device = dataclasses.replace(rig, device=device)
    machines: Timed = {
        "processor, float64": lambda: irradiance(rig, samples, None, rows),
        f"{device}, float32": lambda: irradiance(on_device, samples, None, rows),
    }
    count = (rows[1] - rows[0]) * entry.camera.sensor.width_px * samples
    one, other = race(f"{name}, white image, {samples} samples", machines, count)
    odd = np.abs(one - other) > SINGLE
    print(f"    {odd.sum()} of {odd.size} pixels have other rays")
    if not odd.mean() < FEW:
        raise SystemExit(f"{name}: {odd.sum()} pixels differ by more than {SINGLE:g} of white")
    agree(name, one[~odd], other[~odd], SINGLE, "of white")


def race(title: str, machines: Timed, rays: int) -> list[np.ndarray]:
    """Time both in turns; what both computed. The first turn compiles."""
    results: dict[str, np.ndarray] = {}
    seconds: dict[str, list[float]] = {machine: [] for machine in machines}
    for turn in range(_TURNS + 1):
        for machine, compute in machines.items():
            begin = time.perf_counter()
            results[machine] = compute()
            seconds[machine] += [time.perf_counter() - begin] if turn else []
    for machine, spent in seconds.items():
        told(f"{title}, {machine}", rays, spent)
    return list(results.values())


def told(title: str, rays: int, seconds: list[float]) -> None:
    """Print rays per second."""
    print(f"  {title}: {rays / statistics.median(seconds):.3g} rays/s (best {rays / min(seconds):.3g})")


def agree(title: str, one: np.ndarray, other: np.ndarray, tolerance: float, unit: str) -> None:
    """Print differences; SystemExit if their rms is too large."""
    apart = np.abs(one - other)
    rms = float(np.sqrt(np.nanmean(apart**2)))
    same = np.array_equal(one, other, equal_nan=True)
    print(f"    apart by {rms:.1e} {unit} rms, {np.nanmax(apart):.1e} {unit} at most; bits equal: {same}")
    if not rms < tolerance:
        raise SystemExit(f"{title}: device and processor differ by {rms:.1e} {unit}")


if __name__ == "__main__":
    main()
