"""What would images gain from rays in single precision, and what do they lose where a device traces them?

    python benchmarks/single.py [--small]

The same packets through the lens of example 01 in float64 and in float32, in turns, and an image of example 01: if only
its trace became faster, by the ratio of both, the image would gain what is printed last. Processor time, the least of
all turns. Then rows of white images of examples 01 and 02 in both precisions, from the same random numbers.
"""

import argparse
import functools
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from kept import keeping
from lenses import EXAMPLES, Race, table_of, tronnier
from single_rays import single_leaving

import pipeline
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.bundle_kernels import image_rays
from pipeline.camera.tracing.records import Leaving, Samples, Squares
from pipeline.camera.tracing.sampling_bounds import SKIP
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.jit.binding import Single, bound_anew
from pipeline.jit.decorators import _numba, fma, inline
from pipeline.jit.work import work
from pipeline.optics.kernels import PACKET, Packet, trace_packet
from pipeline.render.imaging import irradiance_and_crosstalk
from pipeline.render.pixel_rays import Band

FIELD_DEG = 10.0
ROWS = {"01_conventional": (190, 200), "02_plenoptic": (190, 200)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="no race, and one row of each image")
    small = parser.parse_args().small
    if not small:
        race()
    for name, rows in ROWS.items():
        off = moved(name, (rows[0], rows[0] + 1) if small else rows)
        print(f"{name} in float32: of {off.rays} rays {off.lost} pass in one precision only; in focus")
        print(f"  rays move by {rms(off.rays_px):.1e} px rms, {off.rays_px.max():.1e} px at most,")
        print(f"  the mean of a pixel by {rms(off.means_px):.1e} px rms, {off.means_px.max():.1e} px at most,")
        print(f"  and its light by {off.light:.1e} of it at most")


def race() -> None:
    """Print what single precision gains, alone and in an image."""
    double_s, single_s = raced(tronnier(), 2000, 15)
    ratio = double_s / single_s
    print(f"trace alone: float64 {1e9 * double_s:.1f} ns a ray, float32 {1e9 * single_s:.1f} ns, ratio {ratio:.2f}")
    whole_s, kernel_s = of_image((190, 290), 5)
    print(f"image: {1e9 * whole_s:.1f} ns a ray, {1e9 * kernel_s:.1f} of it in the kernel that starts and traces rays")
    print(f"so an image would gain at most {whole_s / (whole_s - double_s + single_s):.2f}")


def raced(lens: Race, packets: int, turns: int) -> tuple[float, float]:
    """Seconds a ray in double and single precision."""
    position, direction = lens.rays(1000 * PACKET, FIELD_DEG)
    start = position - [0.0, 0.0, lens.prescription.vertices_mm[lens.prescription.stop_index]]
    rays = np.hstack([start, direction, np.ones((len(start), 1))])[::1000].T
    table, least = table_of(lens), []
    for traced, kind in ((_in_double, np.float64), (_in_single, np.float32)):
        repeat, given = _repeating(traced), rays.astype(kind)
        packet = Packet(*given.copy(), np.empty((7, PACKET), kind), np.empty(PACKET, kind))
        repeat(table.astype(kind), given, packet, 1)
        again = functools.partial(repeat, table.astype(kind), given, packet, packets)
        least.append(least_s(again, turns) / (packets * PACKET))
    return least[0], least[1]


def of_image(rows: tuple[int, int], turns: int) -> tuple[float, float]:
    """Seconds a ray of some rows of a white image of example 01: of all, and of the kernel of its rays."""
    rig, samples = rig_of("01_conventional")

    def image() -> None:
        irradiance_and_crosstalk(rig, samples, None, rows)

    image()
    done = work().kernels["image_rays"]
    before, kernel_s = done.rays, math.inf
    image()
    rays = done.rays - before
    for _ in range(turns):
        already_s = done.seconds
        image()
        kernel_s = min(kernel_s, done.seconds - already_s)
    return least_s(image, turns) / rays, kernel_s / rays


def rig_of(name: str) -> tuple[Rig, int]:
    """The camera of an example, and the samples of its images."""
    entry = pipeline.open_dataset(EXAMPLES / name / "dataset.usda").cameras[0]
    return Rig.of(Tracer(focused(entry.camera), entry.sampling.seed)), entry.image_samples


@dataclass(frozen=True, slots=True, kw_only=True)
class Moved:
    """How far float32 moves rays of an image.

    Attributes
    ----------
    rays, lost : int
        Rays that pass in float64, and rays that pass in one precision only.
    rays_px, means_px : (n,) float64
        Distances of rays, and of means of the rays of a pixel, where the camera is in focus; of pixels that no other
        rays reach in float32.
    light : float
        Largest difference of the light of these pixels, over this light.
    """

    rays: int
    lost: int
    rays_px: np.ndarray
    means_px: np.ndarray
    light: float


def moved(name: str, rows: tuple[int, int]) -> Moved:
    """Rows of an example in both precisions; of each pixel the light through the microlens of its cell."""
    rig, samples = rig_of(name)
    camera, squares = rig.tracer.camera, _squares(Band.of(rig, rows), samples)
    random = Samples(sobol_bits(samples), rig.tracer.seed, camera.sensor.pitch_mm)
    leaving = Leaving.empty(int(squares.counts.sum()))
    double = leaving.first(image_rays(rig.tracer.arrays, random, squares, rig.diffraction, leaving))
    both = double, single_leaving(rig.tracer.arrays, random, squares, rig.diffraction)
    passed = [np.bincount(one.owner, minlength=squares.counts.size) for one in both]
    kept = passed[0] == passed[1]  # owners whose rays are the same ones
    pixel = both[0].owner[kept[both[0].owner]]
    places = [crossing(one, camera)[kept[one.owner]] for one in both]
    means = [mean_of(pixel, place, squares.counts.size) for place in places]
    light = [np.bincount(pixel, one.share[kept[one.owner]], squares.counts.size)[pixel] for one in both]
    beside = np.hypot(*np.diff(means[0], axis=0).T)[np.diff(squares.strata[:, 0]) == 0]
    px_mm = float(np.nanmedian(beside))  # from one pixel to the next
    return Moved(
        rays=len(both[0].owner),
        lost=int(np.abs(passed[0] - passed[1]).sum()),
        rays_px=np.hypot(*(places[1] - places[0]).T) / px_mm,
        means_px=np.hypot(*(means[1] - means[0])[np.unique(pixel)].T) / px_mm,
        light=float(np.abs(light[1] / light[0] - 1).max()),
    )


def _squares(band: Band, samples: int) -> Squares:
    strata = np.ascontiguousarray(band.strata[:, :1])
    counts = np.where(strata == SKIP, 0, samples)
    y_px, x_px = np.divmod(np.arange(len(strata)), band.shape[1])
    return Squares(np.stack([x_px, y_px + band.rows[0]], axis=1), band.positions_mm, strata, counts, 0 * counts)


def crossing(rays: Leaving, camera: Camera) -> np.ndarray:
    """Where rays meet the plane in the middle of the depth of field, (n, 2) [mm]."""
    assert camera.near_mm is not None
    assert camera.far_mm is not None
    z_mm = 2 / (1 / camera.near_mm + 1 / camera.far_mm)
    path = (z_mm - rays.origin[:, 2]) / rays.direction[:, 2]
    return (rays.origin + path[:, None] * rays.direction)[:, :2]  # type: ignore[no-any-return]


def mean_of(group: np.ndarray, places: np.ndarray, count: int) -> np.ndarray:
    """Means of the places of each group, (count, 2); nan of empty ones."""
    with np.errstate(invalid="ignore"):
        sums = np.stack([np.bincount(group, part, count) for part in places.T], axis=1)
        return sums / np.bincount(group, minlength=count)[:, None]  # type: ignore[no-any-return]


def least_s(work_: Callable[[], Any], turns: int) -> float:
    """The least processor time of some turns [s]."""
    spent = []
    for _ in range(turns):
        start = time.process_time()
        work_()
        spent.append(time.process_time() - start)
    return min(spent)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


_trace_single = Single(trace_packet)


@inline
def _in_double(table: Any, packet: Any, count: Any) -> None:
    trace_packet(table, packet, count)


@inline
def _in_single(table: Any, packet: Any, count: Any) -> None:
    _trace_single(table, packet, count)


def _repeating(traced: Any) -> Any:
    """Trace packets of the same rays, again and again."""
    compiled = _numba().njit(nogil=True, error_model="numpy")
    trace = compiled(bound_anew(traced.function, compiled, fma=fma))

    @compiled
    def repeat(table: Any, given: Any, packet: Any, times: Any) -> None:
        for _ in range(times):
            for i in range(PACKET):
                packet.x[i], packet.y[i], packet.z[i], packet.dx[i] = given[0, i], given[1, i], given[2, i], given[3, i]
                packet.dy[i], packet.dz[i], packet.alive[i] = given[4, i], given[5, i], given[6, i]
            trace(table, packet, PACKET)

    return repeat


if __name__ == "__main__":
    with keeping("single"):
        main()
