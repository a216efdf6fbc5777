"""How fast does a device trace bundles, against one core of the processor, in one run? And do both agree?

    python benchmarks/gpu.py [--small]

Where no CUDA device can be used it says so and measures nothing.
"""

import argparse
import dataclasses
import statistics
import time

import numpy as np
from lenses import EXAMPLES

import pipeline
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.errors import EnvironmentFault
from pipeline.jit.device import device_name, is_simulated

AGREEMENT_MM = 1e-9
_TURNS = 5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few bundles: does it run at all?")
    small = parser.parse_args().small
    try:
        device = device_name()
    except EnvironmentFault as error:
        print(f"nothing is measured: {error}")
        return
    if is_simulated():
        print("nothing is measured: the simulator says what a device computes, not how fast")
        return
    print(
        f"moments of bundles in float64 on {device}: clock of the device's calls, copies included; processor: one core"
    )
    for name in ("01_conventional", "02_plenoptic"):
        race(name, device, 2_000 if small else 200_000)


def race(name: str, device: str, count: int) -> None:
    """Bundles spread over the sensor of an example, on both in turns; SystemExit if they differ."""
    entry = pipeline.open_dataset(EXAMPLES / name / "dataset.usda").cameras[0]
    tracer, sensor, samples = Tracer(entry.camera, entry.sampling.seed), entry.camera.sensor, entry.sampling.samples
    i = np.arange(count)
    x, y = (i + 0.5) / count * sensor.width_px - 0.5, i * 0.6180339887498949 % 1.0 * sensor.height_px - 0.5
    positions = tracer.positions_mm(x, y)
    lens = Rig.of(tracer).microlens_at(positions)
    pixels = np.stack([np.rint(x), np.rint(y)], axis=1)
    assert entry.camera.near_mm is not None and entry.camera.far_mm is not None
    planes = parallel_planes(entry.camera.near_mm, entry.camera.far_mm)
    places = {"processor": tracer, device: dataclasses.replace(tracer, device=device)}
    results, seconds = {}, {place: [] for place in places}  # type: ignore[var-annotated]
    for turn in range(_TURNS + 1):
        for place, chosen in places.items():
            start = time.perf_counter()
            results[place] = chosen.moments(positions, lens, planes, samples, pixels)
            seconds[place] += [time.perf_counter() - start] if turn else []  # the first turn compiles
    apart = float(np.nanmax(np.abs(results["processor"][:, :4] - results[device][:, :4])))
    if not apart < AGREEMENT_MM:
        raise SystemExit(f"{name}: device and processor differ by {apart:.1e} mm")
    for place, spent in seconds.items():
        best, middle = (count * samples / choose(spent) for choose in (min, statistics.median))
        print(f"  {name}, {samples} samples, {place}: {middle:.3g} rays/s (best {best:.3g})")
    print(f"    means within {apart:.1e} mm; bits equal: {np.array_equal(*results.values(), equal_nan=True)}")


if __name__ == "__main__":
    main()
