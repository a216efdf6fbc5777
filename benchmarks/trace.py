"""How fast are rays traced? Packets through two lenses against batoid, then whole bundles with their moments.

    python benchmarks/trace.py [--small]

One thread. Competitors take turns in one run, because only ratios mean something on a machine that does other work.
"""

import argparse
import dataclasses
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from lenses import EXAMPLES, Race, codev_double_gauss, tronnier

import pipeline
from pipeline.camera.focus import focused
from pipeline.camera.micro_images import micro_images, owners
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.optics.kernels import trace_rays
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor
from pipeline.scene.dataset import CameraEntry

# After pipeline.jit, which asks OpenMP for one thread; batoid reads that while it is imported.
import peer  # isort: skip

FIELD_DEG = 10.0
AGREEMENT_MM = 1e-9
_STACK = 12
TINY = EXAMPLES.parent / "tests" / "data"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few rays, few turns: does it run at all?")
    small = parser.parse_args().small
    count, turns = (10_000, 2) if small else (1_000_000, 9)
    if peer.version():
        peer.use_one_thread()
    else:
        print("batoid is not installed, so only our own figures follow (`make bench` installs it)")
    print(f"single rays: {count} over the entrance pupil, {FIELD_DEG:g} deg field, float64, one thread, {turns} turns")
    for race in (codev_double_gauss(), tronnier()):
        run_race(race, count, turns)
    run_shapes(count, turns)
    print("whole bundles: sampling, trace, moments on two planes; rays started, samples as the example has them")
    folder = TINY if small else EXAMPLES
    for name in ("tiny_conventional", "tiny_plenoptic") if small else ("01_conventional", "02_plenoptic"):
        run_bundles(name, folder / name / "dataset.usda", 200 if small else 20_000, turns)


def run_race(race: Race, count: int, turns: int) -> None:
    """Trace the same rays by both programs in turns; print rates, ratio and agreement."""
    position, direction = race.rays(count, FIELD_DEG)
    ours, theirs, results = [], [], {}
    optic = peer.optic(race) if peer.version() else None
    for turn in range(turns + 1):
        seconds, results["ours"] = _timed(*_our_trace(race, position, direction))
        ours += [count / seconds] if turn else []  # the first turn compiles
        if optic:
            bundle = peer.rays(position, direction)
            seconds, traced = _timed(optic.trace, bundle)
            theirs += [count / seconds] if turn else []
            results["batoid"] = peer.landed(traced)
    passed = results["ours"][1]
    print(f"  {race.name}, {race.surface_count} surfaces, {passed.mean():.4%} pass")
    print(f"    packets  {_rates(ours)}, {np.median(ours) * race.surface_count:.3g} ray-surfaces/s")
    if theirs:
        ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
        print(f"    batoid   {_rates(theirs)} (version {peer.version()})")
        print(f"    ratio    median {statistics.median(ratios):.1f}, from {min(ratios):.1f} to {max(ratios):.1f}")
        print(f"    {agreement(results['ours'], results['batoid'])}")


def _our_trace(race: Race, position: np.ndarray, direction: np.ndarray) -> tuple[Callable[..., Any], ...]:
    """The kernel and its arguments for one turn; rays are traced in place, so they are copied before."""
    prescription = race.prescription
    image = prescription.vertices_from_stop_mm[-1] + race.image_mm
    table = towards_sensor(prescription)
    plane = np.zeros((1, table.shape[1]))
    plane[0, :4] = image, 0.0, 1.0, np.inf
    table = np.vstack([table, plane])
    start = position - [0.0, 0.0, prescription.vertices_mm[prescription.stop_index]]
    heading, alive = direction.copy(), np.ones(len(start))

    def trace() -> tuple[np.ndarray, np.ndarray]:
        trace_rays(table, start, heading, alive)
        return start[:, :2], alive > 0

    return (trace,)


def agreement(ours: tuple[np.ndarray, np.ndarray], theirs: tuple[np.ndarray, np.ndarray]) -> str:
    """One line on how far both agree; SystemExit if they do not, because then the race is void."""
    other = int(np.sum(ours[1] != theirs[1]))
    both = ours[1] & theirs[1]
    apart = float(np.abs(ours[0] - theirs[0])[both].max())
    if other or not apart < AGREEMENT_MM:
        raise SystemExit(f"ours and batoid differ: {other} rays pass in one only, the others by up to {apart} mm")
    return f"agree    the same rays pass, positions within {apart:.1e} mm"


def run_shapes(count: int, turns: int) -> None:
    """What a conic or an asphere costs against a sphere: surfaces of one shape, in turns; print medians of ratios."""
    shapes: dict[str, dict[str, Any]] = {
        "sphere": {},
        "conic": {"conic": -0.8},
        "even asphere, a4 to a10": {"conic": -0.8, "even_coefficients": (0.0, 2e-6, -3e-9, 1e-12, 1e-15)},
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
            position, direction, alive = start.copy(), heading.copy(), np.ones(count)
            seconds, _ = _timed(trace_rays, table, position, direction, alive)
            times[name] += [seconds] if turn else []
            passed[name] = alive.mean()
    print(f"shapes: {_STACK} refracting surfaces of one shape")
    for name, seconds in times.items():
        ratio = statistics.median(a / b for a, b in zip(seconds, times["sphere"], strict=True))
        rate = count * _STACK / statistics.median(seconds)
        print(f"  {name:24s} {rate:.3g} ray-surfaces/s, costs {ratio:.2f} spheres, passing: {passed[name]:.2%}")


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
    tracer, sensor = Tracer(focused(entry.camera), entry.sampling.seed), entry.camera.sensor
    images = micro_images(tracer) if entry.camera.microlenses else None
    # A rank-1 lattice (golden ratio) covers the sensor without a period of the microlenses.
    i = np.arange(count)
    x, y = (i + 0.5) / count * sensor.width_px - 0.5, i * 0.6180339887498949 % 1.0 * sensor.height_px - 0.5
    positions = tracer.positions_mm(x, y)
    return tracer, positions, owners(images, positions), np.stack([np.rint(x), np.rint(y)], axis=1)


def _timed(work: Callable[..., Any], *arguments: Any) -> tuple[float, Any]:
    start = time.perf_counter()
    result = work(*arguments)
    return time.perf_counter() - start, result


def _rates(rates: list[float]) -> str:
    return f"{statistics.median(rates):.3g} rays/s (best {max(rates):.3g})"


if __name__ == "__main__":
    main()
