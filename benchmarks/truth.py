"""How exact is the ground truth? Correspondences as users get them against fresh reference solutions.

    python benchmarks/truth.py [--small] [--rays N] [--methods M ...] [--] [STAGE ...]

Builds each stage (both examples by default) with all methods, at the K and samples that it authors, and compares
correspondences.csv with solutions of J(x) = p that know no grid and no filter. Nothing of the build is reused: neither
its random numbers nor its position images.

Columns, lengths in px: rows that exist, of these found, their share; mean, rms and max of the differences; rms of
what may explain them: the standard error that the tables claim (sigma), the local linear solve without noise (grid),
the two-plane method without noise (bias, of that method alone); and the reference's own standard error (ref). Then the
share of rows within 1e-3 px of method `direct`, and what each method traced: full position images, or single bundles.
"""

import argparse
import re
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from kept import keeping
from overlay import write_overlay
from reference import Reference, Solver

import pipeline
from pipeline.camera.tracer import Tracer
from pipeline.files.tables import read_table
from pipeline.frames import inverse
from pipeline.scene.dataset import CameraEntry, Dataset

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = [ROOT / "examples" / name / "dataset.usda" for name in ("01_conventional", "02_plenoptic")]
TINY = [ROOT / "tests" / "data" / name / "dataset.usda" for name in ("tiny_conventional", "tiny_plenoptic")]
METHODS = ("two-plane", "image", "direct")
_OTHER_SEED = 0x5EED0000
_PARTS = ("grid_px", "bias_px", "sigma_px")
Key = tuple[int, str, int, int, int]
"""Frame, target, point, k, l."""


@dataclass(frozen=True, slots=True)
class Solution:
    """Columns that the reference knows of a correspondence; `type` is 0 in a conventional camera."""

    position_px: np.ndarray
    sigma_px: np.ndarray
    bias_px: np.ndarray
    grid_px: np.ndarray
    type: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("stages", nargs="*", type=Path, metavar="STAGE", help="datasets; default: both examples")
    parser.add_argument("--small", action="store_true", help="tiny stages, few rays: does it run at all?")
    parser.add_argument("--rays", type=int, help="of the reference, per evaluation")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=METHODS)
    options = parser.parse_args()
    rays = options.rays or 1 << (12 if options.small else 16)
    for stage in options.stages or (TINY if options.small else EXAMPLES):
        with tempfile.TemporaryDirectory() as folder:
            measure(stage, Path(folder), rays, options.methods)


def measure(stage: Path, folder: Path, rays: int, methods: Sequence[str]) -> None:
    """Print everything about one stage."""
    dataset = pipeline.open_dataset(stage, allow_roots=[ROOT])
    built = {method: build(stage, folder, dataset, method) for method in methods}
    for entry in dataset.cameras:
        sampling, sensor = entry.sampling, entry.camera.sensor
        print(f"{dataset.stage_name}, camera {entry.name}: {sensor.width_px} x {sensor.height_px} px,", end=" ")
        print(f"K {sampling.supersampling}, {sampling.samples} samples, {len(dataset.frames)} frames")
        start = time.perf_counter()
        solutions, last_step = solve_all(dataset, entry, rays)
        print(f"  reference: {rays} rays per evaluation, {len(solutions)} rows exist,", end=" ")
        print(f"last Newton step at most {last_step:.1e} px, {time.perf_counter() - start:.0f} s")
        print_counts({method: [read_table(file) for file in tables(out, entry)] for method, out in built.items()})
        found = {method: read_rows(tables(out, entry)) for method, out in built.items()}
        print_differences(found, solutions, entry)
        print_against_direct(found)
        print_rays(found, built, dataset, entry)
        print()


def build(stage: Path, folder: Path, dataset: Dataset, method: str) -> Path:
    """Build a stage with another truth method, and with next to no rays for pictures; returns its output folder."""
    paths = [entry.prim_path for entry in dataset.cameras]
    (folder / method).mkdir()
    values = {"plen:truth:method": method, "plen:image:samples": 4}
    layer = write_overlay(stage, folder / method / "dataset.usda", paths, values)
    result = pipeline.build(layer, out=folder / method / "out", allow_roots=[ROOT])
    if result.exit_code:
        reasons = "; ".join(f"{task.name}: {task.error}" for task in result.failures)
        raise SystemExit(f"the build of {stage.parent.name} with method {method} failed: {reasons or result.error}")
    return result.out


def tables(out: Path, entry: CameraEntry) -> list[Path]:
    """The tables of a camera, frame by frame."""
    return sorted(out.glob(f"frames/*/{entry.name}/correspondences.csv"))


def read_rows(files: list[Path]) -> dict[Key, tuple[np.ndarray, np.ndarray]]:
    """Position and claimed standard error, each (2,) [px], of every row."""
    rows = {}
    for table in map(read_table, files):
        numbers = np.stack(
            [table.numbers(name) for name in ("frame", "point_id", "microlens_k", "microlens_l", "x_px", "y_px")]
        ).T
        sigma = np.stack([table.numbers("sigma_x_px"), table.numbers("sigma_y_px")]).T
        for target, row, error in zip(table.columns["target"], numbers, sigma, strict=True):
            frame, point, k, l = np.nan_to_num(row[:4]).astype(int).tolist()
            rows[frame, target, point, k, l] = row[4:], error
    return rows


def solve_all(dataset: Dataset, entry: CameraEntry, rays: int) -> tuple[dict[Key, Solution], float]:
    """Reference solutions of all frames and targets, and the largest last Newton step [px]."""
    tracer = Tracer(entry.camera, entry.sampling.seed ^ _OTHER_SEED)
    solver = Solver(tracer, rays, entry.truth.min_hit_fraction, entry.sampling.supersampling)
    solutions: dict[Key, Solution] = {}
    last_step = 0.0
    for frame in dataset.frames:
        for number, target in enumerate(dataset.targets):
            pose = frame.vision_from_target(entry.name, target.name)
            if inverse(pose)[2, 3] <= 0:
                continue  # the camera sees its back
            stream = frame.number * len(dataset.targets) + number
            found = solver.solve(pose, target.target.points().position_mm, stream)
            last_step = max(last_step, found.last_step_px)
            solutions |= {(frame.number, target.name, *key): solution for key, solution in _solutions(tracer, found)}
    return solutions, last_step


def _solutions(tracer: Tracer, found: Reference) -> list[tuple[tuple[int, int, int], Solution]]:
    grid = tracer.lattice
    rows = []
    for i, (point, cell) in enumerate(zip(found.point.tolist(), found.cell.tolist(), strict=True)):
        k, l, kind = (int(grid.k[cell]), int(grid.l[cell]), int(grid.type[cell])) if grid else (0, 0, 0)
        values = found.position_px[i], found.sigma_px[i], found.bias_px[i], found.grid_px[i]
        rows.append(((point, k, l), Solution(*values, kind)))
    return rows


def print_counts(tables_of: dict[str, list]) -> None:
    """What the searches found, rejected and dropped, summed over frames: the notes in the tables' headers."""
    for method, found in tables_of.items():
        counts: dict[str, int] = {}
        for comment in (line for table in found for line in table.comments if "quads" in line):
            for name, number in re.findall(r"(\w+) (\d+)", comment.split(":", 1)[1]):
                counts[name] = counts.get(name, 0) + int(number)
        print(f"  search, {method:9s}: " + ", ".join(f"{name} {number}" for name, number in counts.items()))


def print_differences(
    found: dict[str, dict[Key, tuple[np.ndarray, np.ndarray]]], solutions: dict[Key, Solution], entry: CameraEntry
) -> None:
    """One line per method and microlens type."""
    array = entry.camera.microlenses
    focal = array.focal_lengths_mm if array else ()
    groups = {"all": set(solutions)}
    for kind in range(len(focal) if len(focal) > 1 else 0):
        groups[f"f {focal[kind]:g}"] = {key for key, solution in solutions.items() if solution.type == kind}
    print("  method     type    exist  found  share   mean     rms      max      sigma    grid     bias     ref")
    for method, rows in found.items():
        for name, keys in groups.items():
            print(f"  {method:10s} {name:6s} {_line(method, keys, rows, solutions)}")
        extra = rows.keys() - solutions.keys()
        if extra:
            print(f"  {method:10s} found {len(extra)} rows that the reference does not know")


def print_against_direct(found: dict[str, dict[Key, tuple[np.ndarray, np.ndarray]]]) -> None:
    """How many rows lie within a thousandth of a pixel of method `direct`."""
    exact = found.get("direct", {})
    for method, rows in found.items():
        both = sorted(rows.keys() & exact.keys())
        if method != "direct" and both:
            apart = np.array([np.hypot(*(rows[key][0] - exact[key][0])) for key in both])
            share = f"{len(both)} of {len(exact)} rows of direct, {np.mean(apart < 1e-3):.1%} of them within 1e-3 px"
            print(f"  {method:10s} has {share}, the farthest {apart.max():.5f} px")


def print_rays(found: dict, built: dict[str, Path], dataset: Dataset, entry: CameraEntry) -> None:
    """Rays that each method traced for all frames."""
    sensor, sampling = entry.camera.sensor, entry.sampling
    image = sensor.width_px * sensor.height_px * sampling.supersampling**2 * sampling.samples
    frames = len(dataset.frames)
    comments = {
        method: [line for file in tables(built[method], entry) for line in read_table(file).comments]
        for method in found
    }
    single = {
        method: sum(int(number) for line in lines for number in re.findall(r"rays (\d+)", line))
        for method, lines in comments.items()
    }
    for method, images in {"two-plane": 1, "image": frames + 1, "direct": 0}.items():
        if method not in found:
            continue
        rays = image * images + single[method]
        rows = max(1, len(found[method]))
        print(f"  {method:10s} traced {rays:.2e} rays for {rows} rows, {single[method] / rows:.0f} singly per row")
    if "direct" in found:
        print(f"  rays of image per frame over those of direct: {image * frames / max(1, single['direct']):.0f}")


def _line(
    method: str, keys: set[Key], rows: dict[Key, tuple[np.ndarray, np.ndarray]], solutions: dict[Key, Solution]
) -> str:
    both = sorted(keys & rows.keys())
    if not both:
        return f"{len(keys):6d} {0:6d}"
    apart = np.array([rows[key][0] - solutions[key].position_px for key in both])
    length = np.hypot(*apart.T)
    grid, bias, own = (_rms(np.array([getattr(solutions[key], name) for key in both])) for name in _PARTS)
    sigma = _rms(np.array([rows[key][1] for key in both]))
    figures = [length.mean(), _rms(apart), length.max(), sigma, grid, bias if method == "two-plane" else 0.0, own]
    head = f"{len(keys):6d} {len(both):6d} {len(both) / len(keys):6.1%}  "
    return head + "  ".join(f"{figure:7.5f}" for figure in figures)


def _rms(vectors: np.ndarray) -> float:
    """Root mean square length of (n, 2) vectors; unknown ones are left out."""
    return float(np.sqrt(np.nanmean(np.sum(vectors**2, axis=1))))


if __name__ == "__main__":
    with keeping("truth"):
        main()
