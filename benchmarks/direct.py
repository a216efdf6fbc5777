"""What does ground truth at 0.001 px cost? Rays of method `direct` against a position image of all pixels.

    python benchmarks/direct.py [--small]

The paper's rig with the 800 x 600 pixels of example 02, 28 corners, one pose. For method `image` the error at several K
and samples is measured on tiles: at a sample of the rows of `direct`, J is rendered on the fine positions around them
and searched as the method does. J of all pixels at those K and samples would cost width * height * K^2 * samples
rays; the tiles alone, 16 positions for each row, are quoted beside it.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
from kept import keeping

import pipeline
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes, target_plane
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.grid import quad_search
from pipeline.truth.grid.ray_grid import fine_from_image, image_from_fine
from pipeline.truth.planes import tangent_planes

STAGE = Path(__file__).resolve().parent.parent / "examples/02_plenoptic/dataset.usda"
GRIDS = ((1, 1024), (2, 1024), (2, 4096), (4, 1024), (4, 4096), (4, 16_384), (8, 4096))
_GOAL_PX = 1e-3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="few rows: does it run at all?")
    options = parser.parse_args()
    entry = pipeline.open_dataset(STAGE).cameras[0]
    tracer = Tracer(entry.camera)
    rig, board, pose = (
        Rig.of(tracer),
        Checkerboard(columns=7, rows=4, square_mm=2.0),
        facing(420.0, 20.0),
    )
    planes, start = tangent_planes(pose, board.points_mm()), time.perf_counter()
    guess, fans = guesses(rig, planes)
    found = solve(rig, guess, planes, _GOAL_PX, 0.05)
    rays, rows = found.counts["rays"] + fans, len(found.found.point)
    seconds = time.perf_counter() - start
    pixels = entry.camera.sensor.width_px * entry.camera.sensor.height_px
    print(f"image:  {entry.camera.sensor.width_px} x {entry.camera.sensor.height_px} pixels")
    print(f"direct: {rows} rows of {len(planes)} corners, {rays:.3e} rays, {rays / rows:.0f} per row, {seconds:.1f} s,")
    print(f"        largest sigma {np.hypot(*found.sigma_px.T).max():.1e} px, {found.counts['inaccurate']} inaccurate")
    drawn = np.random.default_rng(1).permutation(rows)[: 16 if options.small else 300]
    print(
        "   K  samples  accepted      rms px      max px   rays, all pixels   over direct   rays, tiles   over direct"
    )
    for k, samples in GRIDS[:2] if options.small else GRIDS:
        error, accepted = tile_errors(rig, found, planes, pose, drawn, k, samples)
        full, tiles = pixels * k**2 * samples, 16 * rows * samples
        print(
            f"  {k:2d}  {samples:7d}  {accepted:8.1%}  {np.sqrt(np.mean(error**2)):10.5f}  {error.max():10.5f}"
            f"  {full:17.2e}  {full / rays:12.0f}  {tiles:11.2e}  {tiles / rays:11.2f}"
        )


def facing(distance_mm: float, tilt_deg: float) -> np.ndarray:
    """A board that looks at the camera, turned about the vertical axis."""
    c, s = np.cos(math.radians(tilt_deg)), np.sin(math.radians(tilt_deg))
    pose = np.eye(4)
    pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ np.diag([1.0, -1.0, -1.0])
    pose[2, 3] = distance_mm
    return pose


def tile_errors(
    rig: Rig, found, planes: np.ndarray, pose: np.ndarray, drawn: np.ndarray, k: int, samples: int
) -> tuple[np.ndarray, float]:
    """Errors of the quad search on 4 x 4 tiles around rows [px], and the share of rows that it accepts."""
    tracer, rows = rig.tracer, found.found.only(drawn)
    exact = np.stack([rows.x_px, rows.y_px], axis=1)
    corner = np.floor(fine_from_image(exact, k)).astype(int) - 1
    offsets = np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1)
    fine = (corner[:, None, None] + offsets).reshape(-1, 2)
    x = image_from_fine(fine.astype(float), k)
    lens = np.repeat(rig.microlens(rows.cell), 16)
    own = rig.in_cell(x, lens)
    two = np.stack([target_plane(pose), parallel_planes(1.0, 2.0)[0]])
    image = tracer.moments(tracer.positions_mm(*x.T), lens, two, samples, fine)[:, :2].reshape(-1, 4, 4, 2)
    points = (planes[rows.point, 0] - pose[:3, 3]) @ pose[:3, :2]
    errors = []
    for tile, label, point, first, truth in zip(image, own.reshape(-1, 4, 4), points, corner, exact, strict=True):
        quads, status, solution = np.array([[0, 1, 1]]), np.zeros(1, np.int64), np.full((1, 9), np.nan)
        cell, limits = np.where(label, 0, -1), quad_search.Filter(True, 0.15, math.radians(10))
        quad_search.solve_quads(tile, cell, point[None], quads, limits, status, solution)
        if status[0] == quad_search.ACCEPTED:
            errors.append(np.hypot(*(image_from_fine(solution[0, :2] + first, k) - truth)))
    return np.array(errors), len(errors) / len(drawn)


if __name__ == "__main__":
    with keeping("direct"):
        main()
