"""What does it cost to fit a stage to a real camera? Processor time of both kinds of cameras.

    python benchmarks/calibrate.py [--small]

A conventional camera: 20 boards of 88 corners, 12 free numbers with tolerances. A plenoptic one: 10 boards of 28
corners behind microlenses, 8 free numbers. Positions are those of the camera with every number half its tolerance off,
with noise of 0.05 px; kernels are compiled before.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from kept import keeping
from scipy.spatial.transform import Rotation

from pipeline.files.tables import write_table
from pipeline.plugins.fits.calibration import calibrate
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Stated
from pipeline.plugins.fits.predicted_rows import points_of
from pipeline.plugins.fits.twin import document
from pipeline.plugins.fits.twin_page import page
from pipeline.results.opening import ready
from pipeline.results.ready_camera import ReadyCamera

NOISE_PX = 0.05
CONVENTIONAL = {
    "Lens/S1.plen:radius": 0.05,
    "Lens/S3.plen:radius": 0.05,
    "Lens/S5.plen:radius": 0.05,
    "Lens/S3.plen:thickness": 0.02,
    "Lens/S5.plen:thickness": 0.02,
    "Sensor.plen:pixelPitch": 1e-5,
    "Sensor.plen:offset": 0.03,
    "Sensor.plen:tilt": 0.05,
    "Camera.plen:camera:sensorDistance": 0.05,
    "Lens/S1.plen:indexOffset": 5e-4,
}
"""Spreads of twelve numbers, by property below the rig."""
PLENOPTIC = {
    "Microlenses.plen:focalLengths": 0.01,
    "Microlenses.plen:offset": 0.003,
    "Microlenses.plen:rotation": 0.02,
    "Microlenses.plen:pitch": 2e-5,
    "Camera.plen:camera:microlensDistance": 0.005,
}
"""Spreads of eight numbers."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="three boards of a few corners: does it run at all?")
    is_small = parser.parse_args().small
    rigs = (
        ("conventional_100mm", CONVENTIONAL, (11, 8, 0.55), 20),
        ("plenoptic_michels_2019", PLENOPTIC, (7, 4, 1.5), 10),
    )
    with tempfile.TemporaryDirectory() as folder:
        for rig, spreads, board, count in rigs[: 1 if is_small else 2]:
            asked = ((4, 3, 1.5), 3) if is_small else (board, count)
            path = Path(folder) / f"{rig}.usda"
            path.write_text(stage_text(rig, spreads, *asked), encoding="utf-8")
            fit(path, Path(folder) / f"{rig}.csv")


def fit(path: Path, file: Path) -> None:
    stage = FreeStage(path, ["Made"])
    off = np.array([number.deviation / 2 for number in stage.numbers])
    rows = observe(stage, off, file)
    began = time.process_time()
    twin = calibrate(stage, [file], Stated())
    spent_s = time.process_time() - began
    pulls = np.abs(twin.solution.correction - off) / twin.solution.deviation
    print(f"{path.stem}: {rows} positions, {len(twin.views.keys)} boards, {len(off)} numbers: {spent_s:.1f} CPU s")
    print(f"  errors are {np.sqrt((pulls**2).mean()):.2f} deviations rms, {pulls.max():.2f} at most")
    print(*(f"  {line}" for line in page(document(twin))), sep="\n")


def stage_text(rig: str, spreads: dict[str, float], board: tuple[int, int, float], count: int) -> str:
    """A dataset with tolerances, before a board in poses all over the field."""
    rng, turns, places = np.random.default_rng(8), [], []
    for frame in range(1, count + 1):
        *imaginary, real = Rotation.from_euler("xyz", rng.uniform(-35, 35, 3) * (1, 1, 0.5), degrees=True).as_quat()
        turns.append(f"{frame}: ({real}, {', '.join(map(str, imaginary))})")
        places.append(f"{frame}: ({rng.uniform(-3, 3)}, {rng.uniform(-2, 2)}, {-432 + rng.uniform(-8, 8)})")
    made = "".join(
        f'def PlenTolerance "T{i}"\n{{\nrel plen:tolerance:of = </Fit/Rig/{name}>\n'
        f"uniform double plen:tolerance:spread = {spread}\n}}\n"
        for i, (name, spread) in enumerate(spreads.items())
    )
    columns, rows, square = board
    return f"""#usda 1.0
(
    defaultPrim = "Fit"
    endTimeCode = {count}
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)
def PlenDataset "Fit"
{{
rel plen:cameras = </Fit/Rig/Camera>
rel plen:targets = </Fit/Board>
def "Rig" (prepend references = @rigs/{rig}.usda@)
{{
}}
def Scope "Made"
{{
{made}}}
def PlenCheckerboard "Board"
{{
uniform int plen:columns = {columns}
uniform int plen:rows = {rows}
uniform double plen:squareSize = {square}
quatd xformOp:orient.timeSamples = {{{", ".join(turns)}}}
double3 xformOp:translate.timeSamples = {{{", ".join(places)}}}
uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]
}}
}}
"""


def observe(stage: FreeStage, off: np.ndarray, file: Path) -> int:
    """Write what the camera sees whose numbers are off, with noise; the number of positions."""
    dataset, rng = stage.at(off), np.random.default_rng(1)
    (entry,), (points,) = dataset.cameras, points_of(dataset).values()
    camera = ReadyCamera(name="", rig=ready(entry.camera).rig, min_hit_fraction=0.3, accuracy_px=1e-5)
    columns: dict[str, list] = {name: [] for name in ("frame", "point_id", "microlens_k", "microlens_l")}
    found = []
    for frame in dataset.frames:
        pose = frame.vision_from_target(entry.name, dataset.targets[0].name)
        normals = points.plane_axes[:, :, 2] @ pose[:3, :3].T
        rows = camera.project(points.position_mm @ pose[:3, :3].T + pose[:3, 3], normals)
        columns["frame"] += [frame.number] * len(rows.point)
        columns["point_id"] += rows.point.tolist()
        for axis, name in enumerate(("microlens_k", "microlens_l") if rows.microlens is not None else ()):
            columns[name] += rows.microlens[:, axis].tolist()
        found.append(np.stack([rows.x_px, rows.y_px], axis=1))
    x_px = np.concatenate(found)
    x_px += rng.normal(scale=NOISE_PX, size=x_px.shape)
    table = {name: column for name, column in columns.items() if column}
    table |= {"x_px": x_px[:, 0], "y_px": x_px[:, 1], "sigma_px": np.full(len(x_px), NOISE_PX)}
    write_table(file, ["pixel_origin: 0", "position: exact"], table)
    return len(x_px)


if __name__ == "__main__":
    with keeping("calibrate"):
        main()
