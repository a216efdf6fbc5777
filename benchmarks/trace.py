"""How fast are rays traced? Packets through two lenses against peers, then whole bundles with their moments.

    python benchmarks/trace.py [--small]

Competitors take turns in one run, because only ratios mean something on a machine that does other work. One thread,
but for one race at the end with all of them.
"""

import argparse
import dataclasses
import os
import statistics
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from kept import keeping
from lenses import EXAMPLES, Race, codev_double_gauss, table_of, tronnier

import pipeline
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.optics.kernels import PACKET, crossings_per_second, new_packet, trace_packet, trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import CURVATURE, towards_sensor
from pipeline.scene.dataset import CameraEntry

# After pipeline.jit.decorators, which asks OpenMP for one thread; batoid reads that while it is imported.
import peer  # isort: skip
import peer_optiland  # isort: skip

OURS = "packets"
FIELD_DEG = 10.0
AGREEMENT_MM = 1e-9
_STACK = 12
_IN_CACHE = 10_000
"""Rays of a bundle whose numbers, half a megabyte, fit a second-level cache."""
TINY = EXAMPLES.parent / "tests" / "data"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few rays, few turns: does it run at all?")
    small = parser.parse_args().small
    count, turns = (10_000, 2) if small else (1_000_000, 7)
    if not peer.version():
        print("batoid is not installed, so it is not raced (`make bench` installs it)")
    for mode in ("numpy", "torch"):
        if mode not in peer_optiland.modes():
            hint = " (`make bench` installs it)" if mode == "numpy" else ""
            print(f"optiland with {mode} is not installed, so it is not raced{hint}")
    print(f"single rays: {count} over the entrance pupil, {FIELD_DEG:g} deg field, float64, {turns} turns")
    for race in (codev_double_gauss(), tronnier()):
        run_race(race, count, turns, 1)
    print(f"the same in bundles of {_IN_CACHE}, which fit a cache")
    for race in (codev_double_gauss(), tronnier()):
        run_race(race, _IN_CACHE, turns, 1, max(1, count // _IN_CACHE))
    run_race(codev_double_gauss(), count, turns, os.cpu_count() or 1)
    print(
        "packets of 256 rays alone, against one division and two roots per sphere in the same run; planes count nothing"
    )
    for race in (codev_double_gauss(), tronnier()):
        run_share(race, 100 if small else 2000, turns)
    run_shapes(count, turns)
    print("whole bundles: sampling, trace, moments on two planes; rays started, samples as the example has them")
    folder = TINY if small else EXAMPLES
    for name in ("tiny_conventional", "tiny_plenoptic") if small else ("01_conventional", "02_plenoptic"):
        run_bundles(name, folder / name / "dataset.usda", 200 if small else 20_000, turns)


def run_race(race: Race, count: int, turns: int, threads: int, bundles: int = 1) -> None:
    """Trace the same rays by all programs in turns; print rates, ratios and agreement.

    One thread is timed by the CPU seconds of the process, which other jobs on the machine hardly touch; several threads
    can only be timed by the clock. Of several bundles each is made and traced before the next one.
    """
    position, direction = race.rays(count, FIELD_DEG)
    clock = time.process_time if threads == 1 else time.perf_counter
    programs = {
        OURS: lambda: _our_trace(race, position, direction, threads),
        **_peers(race, position, direction, threads),
    }
    rates: dict[str, list[float]] = {name: [] for name in programs}
    results = {}
    for turn in range(turns + 1):
        for name, prepare in programs.items():
            seconds = 0.0
            for _ in range(bundles):
                trace, landed = prepare()
                start = clock()
                traced = trace()
                seconds += max(clock() - start, 1e-9)
            results[name] = landed(traced)
            rates[name] += [count * bundles / seconds] if turn else []  # the first turn compiles
    print(f"  {race.name}, {race.surface_count} surfaces, threads: {threads}, {results[OURS][1].mean():.4%} pass")
    print(f"    {OURS:28s} {_rates(rates[OURS])}, {np.median(rates[OURS]) * race.surface_count:.3g} ray-surfaces/s")
    for name in list(programs)[1:]:
        ratios = [a / b for a, b in zip(rates[OURS], rates[name], strict=True)]
        print(f"    {name:28s} {_rates(rates[name])}")
        print(f"      ratio of turns: median {statistics.median(ratios):.1f}, {min(ratios):.1f} to {max(ratios):.1f}")
        print(f"      {agreement(results[OURS], results[name])}")


def run_share(race: Race, packets: int, turns: int) -> None:
    """Rate of `trace_packet`, and its share of what roots and divisions of this processor allow."""
    import numba

    make, trace = new_packet.compiled, trace_packet

    @numba.njit(nogil=True, error_model="numpy")
    def repeat(table: Any, rays: Any, times: Any) -> Any:
        packet = make()
        for _ in range(times):
            for i in range(PACKET):
                packet.x[i], packet.y[i], packet.z[i], packet.dx[i] = rays[0, i], rays[1, i], rays[2, i], rays[3, i]
                packet.dy[i], packet.dz[i], packet.alive[i] = rays[4, i], rays[5, i], 1.0
            trace(table, packet, PACKET)
        return packet.x[0]

    position, direction = race.rays(1000 * PACKET, FIELD_DEG)
    table, start = table_of(race), position - [0.0, 0.0, race.prescription.vertices_mm[race.prescription.stop_index]]
    rays = np.ascontiguousarray(np.hstack([start, direction])[::1000].T)
    repeat(table, rays, 1)
    shares, rates = [], []
    for _ in range(turns):
        rates.append(packets * PACKET / _timed(repeat, table, rays, packets)[0])
        shares.append(rates[-1] * np.count_nonzero(table[:, CURVATURE]) / crossings_per_second())
    print(f"  {race.name}: {_rates(rates)}, share median {np.median(shares):.1%} (best {max(shares):.1%})")


def _our_trace(race: Race, position: np.ndarray, direction: np.ndarray, threads: int) -> tuple[Callable[..., Any], ...]:
    """One turn and how to read its result; rays are traced where they are, so they are copied before."""
    prescription, table = race.prescription, table_of(race)
    position, direction, alive = position.copy(), direction.copy(), np.ones(len(position))
    position[:, 2] -= prescription.vertices_mm[prescription.stop_index]
    parts = list(zip(*(np.array_split(rays, threads) for rays in (position, direction, alive)), strict=True))

    def trace() -> None:
        if threads == 1:
            trace_rays(table, *parts[0])
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(lambda part: trace_rays(table, *part), parts))

    return trace, lambda _: (position[:, :2], alive > 0)


def _peers(race: Race, position: np.ndarray, direction: np.ndarray, threads: int) -> dict[str, Callable[[], Any]]:
    """Per installed peer what prepares one turn: copies the rays in the peer's own layout."""
    peers: dict[str, Callable[[], Any]] = {}
    if peer.version():
        optic = peer.optic(race)

        def batoid() -> tuple[Callable[..., Any], ...]:
            peer.use_threads(threads)
            bundle = peer.rays(position, direction)
            return lambda: optic.trace(bundle), peer.landed

        peers[f"batoid {peer.version()}"] = batoid
    for mode in peer_optiland.modes():

        def optiland(mode: str = mode) -> tuple[Callable[..., Any], ...]:
            peer_optiland.use(mode, threads)
            lens, bundle = peer_optiland.optic(race), peer_optiland.rays(position, direction)
            return lambda: peer_optiland.trace(lens, bundle), peer_optiland.landed

        peers[f"optiland {peer_optiland.version(mode)}"] = optiland
    return peers


def agreement(ours: tuple[np.ndarray, np.ndarray], theirs: tuple[np.ndarray, np.ndarray]) -> str:
    """One line on how far both agree; SystemExit if they do not, because then the race is void."""
    other = int(np.sum(ours[1] != theirs[1]))
    both = ours[1] & theirs[1]
    apart = float(np.abs(ours[0] - theirs[0])[both].max())
    if other or not apart < AGREEMENT_MM:
        raise SystemExit(f"ours and the peer differ: {other} rays pass in one only, the others by up to {apart} mm")
    return f"agree    the same rays pass, positions within {apart:.1e} mm"


def run_shapes(count: int, turns: int) -> None:
    """What a conic or an asphere costs against a sphere: surfaces of one shape, in turns; print medians of ratios."""
    shapes: dict[str, dict[str, Any]] = {
        "sphere": {},
        "conic": {"conic": -0.8},
        "even asphere, a4 to a10": {"conic": -0.8, "even_coefficients": (0.0, 2e-6, -3e-9, 1e-12, 1e-15)},
        "even asphere, a4 to a16": {
            "conic": -0.8,
            "even_coefficients": (0.0, 2e-6, -3e-9, 1e-12, 1e-15, 1e-18, 1e-21, 1e-24),
        },
        "strong asphere, a4 to a10": {"conic": -0.8, "even_coefficients": (0.0, 1e-4, -1e-6, 1e-9, 1e-12)},
        "odd asphere, a3 to a8": {
            "conic": -0.8,
            "even_coefficients": (0.0, 2e-6, -3e-9, 1e-12),
            "odd_coefficients": (1e-6, 1e-8),
        },
    }
    tables = {name: towards_sensor(_stack(shape)) for name, shape in shapes.items()}
    rng = np.random.default_rng(1)
    start = np.column_stack([rng.uniform(-7, 7, (count, 2)), np.full(count, -5.0)])
    heading = np.column_stack([np.zeros(count), np.full(count, 0.05), np.full(count, np.sqrt(1 - 0.05**2))])
    times: dict[str, list[float]] = {name: [] for name in tables}
    passed = {}
    for turn in range(turns + 1):
        for name, table in tables.items():
            alive = np.ones(count)
            seconds, _ = _timed(trace_rays, table, start.copy(), heading.copy(), alive)
            times[name] += [seconds] if turn else []
            passed[name] = alive.mean()
    print(f"shapes: {_STACK} refracting surfaces of one shape")
    for name, seconds in times.items():
        ratio = statistics.median(a / b for a, b in zip(seconds, times["sphere"], strict=True))
        rate = count * _STACK / statistics.median(seconds)
        print(f"  {name:26s} {rate:.3g} ray-surfaces/s, costs {ratio:.2f} spheres, passing: {passed[name]:.2%}")


def _stack(shape: dict[str, Any]) -> Prescription:
    """Alternately into glass and back into air, every surface bent alike, so that a beam stays together."""
    surfaces = [
        Surface(radius_mm=60.0, thickness_mm=2.0, index=1.5 if i % 2 == 0 else 1.0, semi_diameter_mm=14.0, **shape)
        for i in range(_STACK)
    ]
    return Prescription(surfaces=(*surfaces[:-1], dataclasses.replace(surfaces[-1], is_stop=True)))


def run_bundles(name: str, stage: Path, count: int, turns: int) -> None:
    """Rate of `Tracer.moments` on positions spread evenly over the sensor."""
    entry = pipeline.open_dataset(stage).cameras[0]
    tracer, positions, lens, pixels = _positions(entry, count)
    assert tracer.camera.near_mm is not None and tracer.camera.far_mm is not None
    planes, samples = parallel_planes(tracer.camera.near_mm, tracer.camera.far_mm), entry.sampling.samples
    tracer.moments(positions[:1], lens[:1], planes, samples, pixels[:1])
    rates = []
    for _ in range(turns):
        seconds, _ = _timed(tracer.moments, positions, lens, planes, samples, pixels)
        rates.append(count * samples / seconds)
    print(f"  {name}, {samples} samples  {_rates(rates)}")


def _positions(entry: CameraEntry, count: int) -> tuple[Tracer, np.ndarray, np.ndarray, np.ndarray]:
    tracer, sensor = Tracer(entry.camera, entry.sampling.seed), entry.camera.sensor
    # A rank-1 lattice (golden ratio) covers the sensor without a period of the microlenses.
    i = np.arange(count)
    x, y = (i + 0.5) / count * sensor.width_px - 0.5, i * 0.6180339887498949 % 1.0 * sensor.height_px - 0.5
    positions = tracer.positions_mm(x, y)
    return tracer, positions, Rig.of(tracer).microlens_at(positions), np.stack([np.rint(x), np.rint(y)], axis=1)


def _timed(work: Callable[..., Any], *arguments: Any) -> tuple[float, Any]:
    """CPU seconds of the process, which has one thread, and the result."""
    start = time.process_time()
    result = work(*arguments)
    return max(time.process_time() - start, 1e-9), result


def _rates(rates: list[float]) -> str:
    return f"{statistics.median(rates):.3g} rays/s (best {max(rates):.3g})"


if __name__ == "__main__":
    with keeping("trace", compared=True):
        main()
