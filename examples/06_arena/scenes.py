"""What contestants get: builds of the conditions, images with the noise of a sensor, and correspondences with noise."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from conditions import ACROSS, Condition, write_stage
from contestants.exchange import write_pgm
from judge import ExactRays
from rows import Rows, board_from_opencv, joined, opencv_points, seen

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.files.exr import read_exr
from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import SensorResponse
from stages import HERE

TRUTHS = {"J": "", "saddle": "saddle_", "chief": "chief_"}
"""Names of the truths, and the beginnings of their columns."""
_WHITE_DN, _BLACK_DN = 210.0, 10.0
"""Digital numbers of white and of no light [DN]: what noise adds stays within 8 bits."""
_READ_NOISE_E = 4.0
"""Dark noise [e-]: of an ordinary industrial sensor."""
_QUERY = 17, 13
"""Columns and rows of the positions at which calibrations are judged, the corners of the image among them."""
_RAYS_PX = 1e-4
"""Error of the true rays [px]: far below that of any calibration."""
BOARD_COLUMNS, BOARD_ROWS, SQUARE_MM = 9, 8, 16.0
"""Inner corners and squares of board.usda."""
BASELINE_MM = 60.0
"""Distance of the second camera, for those who calibrate pairs only."""
BOARD = opencv_points(BOARD_COLUMNS, BOARD_ROWS, SQUARE_MM)


@dataclass(frozen=True, slots=True)
class View:
    """A view of a board: where its points are by each of TRUTHS (n, 2), and its noise-free image (h, w)."""

    truth_px: dict[str, np.ndarray]
    blur_px: float
    image: np.ndarray


def built(stage: Path, folder: Path) -> "pipeline.results.output.Output":
    """Build a stage into a folder."""
    result = pipeline.build(stage, folder / "out" / stage.stem, jobs=1, allow_roots=(HERE,))
    if result.failed:
        raise SystemExit(f"{stage}: {result.failed} tasks failed")
    return pipeline.open_output(result.out)


def views(condition: Condition, board: str, folder: Path) -> list[View]:
    """Views of a board under a condition, in the order of its frames; points under the white card are left out."""
    stage = folder / f"{condition.like or condition.place}_{board}.usda"
    folder.mkdir(parents=True, exist_ok=True)
    write_stage(condition, board, stage)
    return [view_of(view, board == "checkerboard") for view in built(stage, folder).camera.views]


def view_of(view: "pipeline.results.records.BuiltView", has_card: bool) -> View:
    """The view of a build."""
    rows = view.correspondences
    rows = rows[rows.point_id % (ACROSS + 1) != ACROSS] if has_card else rows
    truth = {name: np.stack([rows[f"{start}x_px"], rows[f"{start}y_px"]], axis=1) for name, start in TRUTHS.items()
             if f"{start}x_px" in rows.dtype.names}  # fmt: skip
    (channel,) = read_exr(view.image_path)["image"].channels.values()
    blur = float(np.sqrt(np.nanmean(rows.blur_xx_px2 + rows.blur_yy_px2)))
    return View(truth, blur, np.asarray(channel, np.float64))


def exposed(image: np.ndarray, electrons: float, name: str, repeat: int) -> np.ndarray:
    """Raw image of 8 bits by the pipeline's own sensor, which collects so many electrons of a white pixel."""
    gain = (_WHITE_DN - _BLACK_DN) / electrons
    response = SensorResponse(
        quantum_efficiency=(1.0,),
        full_well_e=2 * electrons,
        gain_dn_per_e=gain,
        bit_depth=8,
        black_level_dn=_BLACK_DN,
        dark_noise_e=_READ_NOISE_E,
    )
    shot = Shot(seed=6, camera=name, frame=repeat, exposure_time_s=1.0)
    return digital_numbers(response, {"mono": image * electrons}, shot).astype(np.uint8)


def write_images(seen: list[View], condition: Condition, board: str, folder: Path, repeats: int) -> None:
    """Write board.json and the images VIEW_REPEAT.pgm of a condition."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {"kind": board, "columns": ACROSS, "rows": ACROSS, "square_mm": 1.0, "marker_mm": 0.75}
    (folder / "board.json").write_text(json.dumps(about), encoding="utf-8")
    for number, view in enumerate(seen):
        for repeat in range(repeats):
            name = f"{condition.name}/{board}/{number}"
            write_pgm(folder / f"{number}_{repeat:02d}.pgm", exposed(view.image, condition.electrons, name, repeat))


@dataclass(frozen=True, slots=True)
class Boards:
    """Boards before a camera of the calibrations: exact positions of points, poses, and true rays of the camera.

    `poses` (v, 4, 4) take the board as OpenCV has it to the vision frame. `second` is the same boards as a camera of
    the same kind sees them, `BASELINE_MM` to the right.
    """

    first: Rows
    second: Rows
    poses: np.ndarray
    exact: ExactRays
    pupil_mm: np.ndarray
    focal_px: float

    def case(self, first: Rows, second: Rows) -> dict[str, np.ndarray]:
        """What a calibrator gets: rows of both cameras, which may be fewer or noisier than those here."""
        return {
            "view": first.view,
            "point": first.point,
            "object_mm": first.points_mm,
            "image_px": first.image_px,
            "second_view": second.view,
            "second_point": second.point,
            "second_image_px": second.image_px,
            "size_px": np.array([640, 480]),
            "columns": np.array(BOARD_COLUMNS),
            "rows": np.array(BOARD_ROWS),
            "square_mm": np.array(SQUARE_MM),
            "focal_guess_px": np.array(round(self.focal_px, -1)),
            "distance_mm": np.array(self.exact.distances_mm[1]),
            "query_px": self.exact.query_px.reshape(-1, 2),
        }


def boards(stage: Path, fitted_mm: tuple[float, ...], distances_mm: tuple[float, ...]) -> Boards:
    """The boards of a stage of calibrations, by the solver of the truth; nothing is rendered."""
    dataset, ready = pipeline.open_dataset(stage), pipeline.ready(stage)
    turn = board_from_opencv(BOARD_COLUMNS, BOARD_ROWS, SQUARE_MM)
    poses = np.array([frame.vision_from_target(ready.name, "Board") @ turn for frame in dataset.frames])
    aside = np.zeros((4, 4))
    aside[0, 3] = BASELINE_MM
    stands_for = pinhole(ready.camera)
    assert stands_for is not None
    first, second = (
        joined([seen(ready, BOARD, pose, view, normals=-pose[:3, 2]) for view, pose in enumerate(places)])
        for places in (poses, poses - aside)
    )
    rays, focal_px = exact_rays(ready, fitted_mm, distances_mm), stands_for.distorted.principal_distance_px
    return Boards(first, second, poses, rays, np.array(stands_for.centre_mm), focal_px)


def exact_rays(
    ready: "pipeline.results.ready_camera.ReadyCamera", fitted_mm: tuple[float, ...], distances_mm: tuple[float, ...]
) -> ExactRays:
    """True rays of a grid of positions over the image."""
    columns, rows = _QUERY
    grid = np.stack(np.meshgrid(np.linspace(-0.5, 639.5, columns), np.linspace(-0.5, 479.5, rows)), axis=-1)
    rays = ready.rays(*grid.reshape(-1, 2).T, accuracy_px=_RAYS_PX)
    shape = (rows, columns, 3)
    return ExactRays(
        query_px=grid,
        origin_mm=rays.origin_mm.reshape(shape),
        direction=rays.direction.reshape(shape),
        fitted_mm=fitted_mm,
        distances_mm=distances_mm,
    )
