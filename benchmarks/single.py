"""Would rays in single precision make images faster? Packets in both precisions, and what of an image is the trace.

    python benchmarks/single.py [--small]

The same rays through the lens of example 01 by `trace_packet` and by its formulas in float32, in turns; then an image
of example 01. If only the trace of an image became faster, by the ratio of both, an image would gain what is printed
last. Processor time, the least of all turns.
"""

import argparse
import functools
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from kept import keeping
from lenses import EXAMPLES, Race, table_of, tronnier

import pipeline
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.jit.work import work
from pipeline.optics.kernels import PACKET, new_packet, trace_packet
from pipeline.optics.table import CURVATURE, INDEX_RATIO, SEMI_DIAMETER_SQUARED, VERTEX
from pipeline.render.imaging import irradiance_and_crosstalk

FIELD_DEG = 10.0
_ZERO, _ONE, _TWO = np.float32(0.0), np.float32(1.0), np.float32(2.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few rays: does it run at all?")
    small = parser.parse_args().small
    double_s, single_s, apart_mm, lost = raced(tronnier(), 10 if small else 2000, 2 if small else 15)
    ratio, most_mm = double_s / single_s, np.abs(apart_mm).max()
    print(f"trace alone: float64 {1e9 * double_s:.1f} ns a ray, float32 {1e9 * single_s:.1f} ns, ratio {ratio:.2f}")
    print(f"at the image plane float32 is off by {rms(apart_mm):.1e} mm rms, {most_mm:.1e} mm at most")
    print(f"rays of {PACKET} that pass in one precision only: {lost}")
    whole_s, kernel_s = of_image((0, 2) if small else (190, 290), 2 if small else 5)
    print(f"image: {1e9 * whole_s:.1f} ns a ray, {1e9 * kernel_s:.1f} of it in the kernel that starts and traces rays")
    print(f"so an image would gain at most {whole_s / (whole_s - double_s + single_s):.2f}")


def raced(race: Race, packets: int, turns: int) -> tuple[float, float, np.ndarray, int]:
    """Seconds a ray in double and single precision, differences where rays meet the image plane (n, 2) [mm], and the
    number of rays that pass in one of them only."""
    position, direction = race.rays(1000 * PACKET, FIELD_DEG)
    start = position - [0.0, 0.0, race.prescription.vertices_mm[race.prescription.stop_index]]
    rays = np.hstack([start, direction, np.ones((len(start), 1))])[::1000].T
    table, ends, least = table_of(race), [], []
    for repeat, kind in ((_double(), np.float64), (_single(), np.float32)):
        given, end = (tuple(row.astype(kind) for row in rays) for _ in range(2))
        repeat(table.astype(kind), given, end, 1)
        ends.append(np.array(end, float))
        again = functools.partial(repeat, table.astype(kind), given, end, packets)
        least.append(least_s(again, turns) / (packets * PACKET))
    passes = [end[-1] > 0 for end in ends]
    both = passes[0] & passes[1]
    apart = (ends[1] - ends[0])[:2, both]
    return *least, apart.T, int(np.sum(passes[0] != passes[1]))


def of_image(rows: tuple[int, int], turns: int) -> tuple[float, float]:
    """Seconds a ray of some rows of a white image of example 01: of all, and of the kernel of its rays."""
    entry = pipeline.open_dataset(EXAMPLES / "01_conventional" / "dataset.usda").cameras[0]
    rig = Rig.of(Tracer(focused(entry.camera), entry.sampling.seed))

    def image() -> None:
        irradiance_and_crosstalk(rig, entry.image_samples, None, rows)

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


def _double() -> Any:
    """Packets of the same rays through `trace_packet`, again and again."""
    make, trace = new_packet.compiled, trace_packet.compiled
    import numba  # after our own kernels, which set how it compiles

    @numba.njit(nogil=True, error_model="numpy")
    def repeat(table: Any, rays: Any, end: Any, times: Any) -> None:
        packet = make()
        for _ in range(times):
            for i in range(PACKET):
                packet.x[i], packet.y[i], packet.z[i], packet.dx[i] = rays[0][i], rays[1][i], rays[2][i], rays[3][i]
                packet.dy[i], packet.dz[i], packet.alive[i] = rays[4][i], rays[5][i], rays[6][i]
            trace(table, packet, PACKET)
        for i in range(PACKET):
            end[0][i], end[1][i], end[6][i] = packet.x[i], packet.y[i], packet.alive[i]

    return repeat


def _single() -> Any:
    """The same in float32, for spheres and planes alone."""
    import numba

    through, to_plane = _sphere(), _plane()

    @numba.njit(nogil=True, error_model="numpy")
    def repeat(table: Any, rays: Any, end: Any, times: Any) -> None:
        for _ in range(times):
            for j in range(7):
                for i in range(PACKET):
                    end[j][i] = rays[j][i]
            for k in range(table.shape[0]):
                if table[k, CURVATURE] == _ZERO:
                    to_plane(table[k], end)
                else:
                    through(table[k], end)

    return repeat


def _sphere() -> Any:
    """`optics.crossing.through_sphere` in float32."""
    import numba
    from numba.extending import intrinsic

    @intrinsic
    def fma(context: Any, a: Any, b: Any, c: Any) -> Any:
        single = numba.float32
        return single(single, single, single), lambda context, builder, signature, given: builder.fma(*given)

    @numba.njit(nogil=True, error_model="numpy")
    def through(row: Any, rays: Any) -> None:
        vertex, c, mu, limit = row[VERTEX], row[CURVATURE], row[INDEX_RATIO], row[SEMI_DIAMETER_SQUARED]
        x, y, z, dx, dy, dz, alive = rays
        for i in range(PACKET):
            ox, oy, oz = dx[i], dy[i], dz[i]
            px, py, pz = x[i], y[i], z[i] - vertex
            back = fma(px, ox, fma(py, oy, pz * oz))
            px, py, pz = fma(-back, ox, px), fma(-back, oy, py), fma(-back, oz, pz)
            f = fma(c, fma(px, px, fma(py, py, pz * pz)), -_TWO * pz)
            discriminant = fma(oz, oz, -c * f)
            root = math.sqrt(max(discriminant, _ZERO))
            t = f / (oz + root)
            px, py, pz = fma(t, ox, px), fma(t, oy, py), fma(t, oz, pz)
            squared = fma(mu * mu, max(discriminant, _ZERO), _ONE - mu * mu)
            step = fma(-mu, root, math.sqrt(max(squared, _ZERO)))
            passes = (discriminant >= _ZERO) & (fma(px, px, py * py) <= limit) & (squared >= _ZERO)
            bend = -step * c
            x[i], y[i], z[i] = px, py, pz + vertex
            dx[i], dy[i] = fma(bend, px, mu * ox), fma(bend, py, mu * oy)
            dz[i] = fma(bend, pz, fma(mu, oz, step))
            alive[i] = alive[i] if passes else _ZERO

    return through


def _plane() -> Any:
    """`optics.crossing.to_plane` in float32; the planes of this lens bend nothing."""
    import numba

    @numba.njit(nogil=True, error_model="numpy")
    def to_plane(row: Any, rays: Any) -> None:
        vertex, limit = row[VERTEX], row[SEMI_DIAMETER_SQUARED]
        x, y, z, dx, dy, dz, alive = rays
        for i in range(PACKET):
            t = (vertex - z[i]) / dz[i]
            px, py = x[i] + t * dx[i], y[i] + t * dy[i]
            x[i], y[i], z[i] = px, py, vertex
            alive[i] = alive[i] if px * px + py * py <= limit else _ZERO

    return to_plane


if __name__ == "__main__":
    with keeping("single"):
        main()
