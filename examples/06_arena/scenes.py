"""What contestants get: builds of the conditions, images with the noise of a sensor, and correspondences with noise."""

import hashlib
import json
import pickle
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from conditions import ACROSS, CALIBRATION_CAMERAS, HERE, Condition, calibration_text, stage_text
from contestants.exchange import write_pgm
from judge import ExactRays

import pipeline
from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.files.exr import read_exr
from pipeline.render.sensor.read_out import Shot, digital_numbers
from pipeline.render.sensor.response import SensorResponse

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
_X = np.array([1.0, 0.0, 0.0, 0.0])
_FROM_OPENCV = np.diag([1.0, -1.0, -1.0, 1.0])
_FROM_OPENCV[:2, 3] = -(BOARD_COLUMNS - 1) / 2 * SQUARE_MM, (BOARD_ROWS - 1) / 2 * SQUARE_MM
"""Our target frame (middle of the board, x right, y up, z to the viewer) from OpenCV's."""


@dataclass(frozen=True, slots=True)
class View:
    """A view of a board: where its points are by each of TRUTHS (n, 2), and its noise-free image (h, w)."""

    truth_px: dict[str, np.ndarray]
    blur_px: float
    image: np.ndarray


def built(stage: Path, text: str) -> "pipeline.results.output.Output":
    """Write a stage, and build it."""
    stage.parent.mkdir(parents=True, exist_ok=True)
    stage.write_text(text, encoding="utf-8")
    result = pipeline.build(stage, stage.parent / "out" / stage.stem, jobs=1, allow_roots=(HERE,))
    if result.failed:
        raise SystemExit(f"{stage}: {result.failed} tasks failed")
    return pipeline.open_output(result.out)


def views(condition: Condition, board: str, folder: Path) -> list[View]:
    """Views of a board under a condition, in the order of its frames; points under the white card are left out."""
    stage = folder / f"{(condition.like or condition.name).replace(' ', '_')}_{board}.usda"
    output = built(stage, stage_text(condition, board))
    return [view_of(view, board == "checkerboard") for view in output.camera.views]


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
class Rows:
    """Seen points: numbers of views and points (n,), positions (n, 2)."""

    view: np.ndarray
    point: np.ndarray
    image_px: np.ndarray

    def only(self, rows: np.ndarray) -> "Rows":
        """Some of them."""
        return Rows(self.view[rows], self.point[rows], self.image_px[rows])

    def noisy(self, sigma_px: float, random: np.random.Generator) -> "Rows":
        """With Gaussian noise on each axis."""
        return Rows(self.view, self.point, self.image_px + random.normal(0, sigma_px, self.image_px.shape))


@dataclass(frozen=True, slots=True)
class Boards:
    """Boards before a camera of the calibrations: exact positions of their points, poses, and the camera's true rays.

    `poses` (v, 4, 4) take the board as OpenCV has it (from its first point, x right, y down, z away from the viewer) to
    the vision frame. `second` is the same boards as a camera of the same kind sees them, `BASELINE_MM` to the right.
    """

    first: "Rows"
    second: "Rows"
    poses: np.ndarray
    exact: ExactRays
    pupil_mm: np.ndarray
    focal_px: float

    def case(self, first: "Rows", second: "Rows") -> dict[str, np.ndarray]:
        """What a calibrator gets: rows of both cameras, which may be fewer or noisier than those here."""
        return {
            "view": first.view,
            "point": first.point,
            "object_mm": object_mm()[first.point],
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


def object_mm() -> np.ndarray:
    """Points of the board as OpenCV has it, (72, 3)."""
    rows, columns = np.divmod(np.arange(BOARD_ROWS * BOARD_COLUMNS), BOARD_COLUMNS)
    return np.stack([columns, rows, np.zeros(len(rows))], axis=1) * SQUARE_MM


def boards(camera: str, folder: Path, fitted_mm: tuple[float, ...], distances_mm: tuple[float, ...]) -> Boards:
    """The boards of calibration.usda before one of the cameras, by the solver of the truth; nothing is rendered."""
    stage = folder / f"calibration_{camera}.usda"
    stage.parent.mkdir(parents=True, exist_ok=True)
    stage.write_text(calibration_text(camera), encoding="utf-8")
    read = [
        calibration_text(camera),
        *((HERE / name).read_text() for name in ("calibration.usda", "rig.usda", "board.usda")),
    ]
    digest = hashlib.sha256(repr((read, fitted_mm, distances_mm, _QUERY, _RAYS_PX)).encode()).hexdigest()[:16]
    kept = folder / f"boards_{digest}.pickle"
    if not kept.exists():
        kept.write_bytes(pickle.dumps(_boards(stage, fitted_mm, distances_mm)))
    return pickle.loads(kept.read_bytes())


def _boards(stage: Path, fitted_mm: tuple[float, ...], distances_mm: tuple[float, ...]) -> Boards:
    dataset = pipeline.open_dataset(stage, allow_roots=(HERE,))
    ready = pipeline.ready(stage, allow_roots=(HERE,))
    poses = np.array([frame.vision_from_target(ready.name, "Board") @ _FROM_OPENCV for frame in dataset.frames])
    stands_for = pinhole(ready.camera)
    assert stands_for is not None
    return Boards(
        _seen(ready, poses),
        _seen(ready, poses - BASELINE_MM * np.outer(_X, [0, 0, 0, 1])),
        poses,
        exact_rays(ready, fitted_mm, distances_mm),
        np.array(stands_for.centre_mm),
        stands_for.distorted.principal_distance_px,
    )


def _seen(ready: "pipeline.results.ready_camera.ReadyCamera", poses: np.ndarray) -> Rows:
    parts = []
    for number, pose in enumerate(poses):
        found = ready.project(object_mm() @ pose[:3, :3].T + pose[:3, 3], normals=-pose[:3, 2])
        order = np.argsort(found.point)
        place = np.stack([found.x_px, found.y_px], axis=1)[order]
        parts.append(Rows(np.full(len(order), number), found.point[order], place))
    return Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("view", "point", "image_px")))


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


def cameras() -> Iterator[str]:
    """Names of the cameras of the calibrations."""
    yield from CALIBRATION_CAMERAS
