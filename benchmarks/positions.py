"""What would a position image cost without random rays? J of example cameras at equal error, by three ways.

    python benchmarks/positions.py [--small]

J where the board of the first frame is, at random positions of the image: random rays as `rays_tile` traces them;
quadrature over the traced edge of each bundle; and, for a camera without microlenses, Chebyshev polynomials through
4 x 4 positions by quadrature on squares of 16 x 16 positions, which share the cost. Errors are rms of the differences
from quadrature with 24 x 256 nodes, in px of the image; processor time is that of one position, in µs. `equal` is the
number of random rays that err as much, by the line through the logarithms of the table, and `ratio` what these would
cost more.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from beside import ROOT
from kept import keep

import pipeline
from pipeline.camera.integrating.quadrature import ROUGH, edges
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes

EXAMPLES = ("01_conventional", "02_plenoptic")
SAMPLES = (64, 256, 1024, 4096, 16384)
LEVELS = ((3, 8), (4, 8), (6, 16), (8, 32))
REFERENCE = (24, 256)
SQUARE, NODES = 16, 4
Row = dict[str, float | str]


class Field:
    """J of a camera on a plane across its axis at the distance of the board.

    Parameters
    ----------
    name : str
        Of the example.
    count : int
        Positions.
    """

    def __init__(self, name: str, count: int) -> None:
        dataset = pipeline.open_dataset(ROOT / "examples" / name / "dataset.usda", allow_roots=[ROOT])
        entry, away_mm = dataset.cameras[0], -dataset.frames[0].world_from_target["Board"][2][3]
        self.tracer = Tracer(entry.camera, 1)
        self.rig = Rig.of(self.tracer)
        sensor, random = entry.camera.sensor, np.random.default_rng(5)
        self.x_px = random.uniform(0, [sensor.width_px - SQUARE, sensor.height_px - SQUARE], (count, 2))
        self.planes = parallel_planes(away_mm, away_mm + 1.0)
        self.lens = self.lens_of(self.x_px)
        self.truth = self.quadrature(self.x_px, REFERENCE)
        step = [self.quadrature(self.x_px + sign * np.array([0.25, 0.0]), REFERENCE, self.lens) for sign in (-1, 1)]
        self.mm_per_px = np.hypot(*((step[1] - step[0]) / 0.5).T)

    def lens_of(self, x_px: np.ndarray) -> np.ndarray:
        """Microlens behind each position, -1 for none there."""
        return self.rig.microlens_at(self.tracer.positions_mm(*x_px.T))

    def quadrature(
        self,
        x_px: np.ndarray,
        nodes: tuple[int, int],
        lens: np.ndarray | None = None,
        count: Callable[[int], None] = id,
    ) -> np.ndarray:
        """J (n, 2) [mm]; `count` gets the number of rays."""
        lens = self.lens_of(x_px) if lens is None else lens
        effort = {} if nodes == REFERENCE else {"effort": ROUGH}
        found = edges(self.tracer.arrays, self.tracer.positions_mm(*x_px.T), lens, **effort)
        moments, _, rays = found.moments(np.repeat(self.planes[None], len(x_px), axis=0), nodes)
        count(found.rays + rays)
        return moments[:, :2]

    def random(self, samples: int) -> np.ndarray:
        """The same at the field's positions by random rays."""
        positions, pixels = self.tracer.positions_mm(*self.x_px.T), np.rint(self.x_px).astype(np.int64)
        return self.tracer.moments(positions, self.lens, self.planes, samples, pixels)[:, :2]

    def squares(self, count: Callable[[int], None]) -> np.ndarray:
        """The same by Chebyshev polynomials on squares that the positions lie in."""
        roots = np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)
        low = np.floor(self.x_px / SQUARE) * SQUARE
        grid = np.stack(np.meshgrid(roots, roots, indexing="ij"), axis=-1).reshape(-1, 2)
        nodes = (low[:, None] + (grid + 1) / 2 * SQUARE).reshape(-1, 2)
        values = self.quadrature(nodes, LEVELS[0], count=count).reshape(len(low), NODES, NODES, 2)
        weights = np.linalg.inv(np.polynomial.chebyshev.chebvander(roots, NODES - 1))
        at = np.polynomial.chebyshev.chebvander((self.x_px - low) / SQUARE * 2 - 1, NODES - 1) @ weights
        return np.einsum("ni,nj,nijc->nc", at[:, 0], at[:, 1], values)

    def row(self, way: str, j: np.ndarray, rays: float, seconds: float) -> Row:
        """A line of the table."""
        off = np.hypot(*(j - self.truth).T) / self.mm_per_px
        off = off[np.isfinite(off)]
        return {"way": way, "rays": rays, "us": seconds * 1e6, "rms_px": float(np.sqrt(np.mean(off**2)))}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="a few positions: does it run at all?")
    options = parser.parse_args()
    found = {}
    for name in EXAMPLES:
        found[name] = measure(Field(name, 20 if options.small else 400))
        tell(name, found[name])
    if not options.small:
        keep("positions", {"cameras": found})


def measure(field: Field) -> list[Row]:
    """All ways, random ones first."""
    n, rows, rays = len(field.x_px), list[Row](), list[int]()
    for samples in SAMPLES:
        seconds, j = timed(lambda samples=samples: field.random(samples))
        rows.append(field.row(f"{samples} random rays", j, samples, seconds / n))
    for nodes in LEVELS:
        seconds, j = timed(lambda nodes=nodes: field.quadrature(field.x_px, nodes, field.lens, rays.append))
        rows.append(field.row(f"{nodes[0]} x {nodes[1]} nodes", j, rays[-1] / n, seconds / n))
    if field.rig.images is None:
        seconds, j = timed(lambda: field.squares(rays.append))
        each = n * SQUARE**2
        rows.append(field.row(f"squares of {SQUARE} x {SQUARE}", j, rays[-1] / each, seconds / each))
    errors, costs = (np.log([row[key] for row in rows[: len(SAMPLES)]]) for key in ("rms_px", "us"))
    slope, start = np.polyfit(errors, np.log(SAMPLES), 1)
    for row in rows[len(SAMPLES) :]:
        equal = slope * np.log(row["rms_px"]) + start
        row["equal"] = float(np.exp(equal))
        row["ratio"] = float(np.exp(costs[-1] + equal - np.log(SAMPLES[-1])) / row["us"])
    return rows


def timed(work: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Processor time of the second of two calls [s], and what it gives: the first one may load kernels."""
    work()
    start = time.process_time()
    found = work()
    return time.process_time() - start, found


def tell(name: str, rows: list[Row]) -> None:
    """Print the table of a camera."""
    print(f"{name:22s}{'rays':>9s}{'µs':>9s}{'rms px':>10s}{'equal':>10s}{'ratio':>8s}")
    for row in rows:
        more = f"{row['equal']:10.2g}{row['ratio']:8.2g}" if "equal" in row else ""
        print(f"  {row['way']:20s}{row['rays']:9.4g}{row['us']:9.3g}{row['rms_px']:10.1e}{more}")


if __name__ == "__main__":
    main()
