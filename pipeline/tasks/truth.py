"""Task `truth`: correspondences of all targets for one camera in one frame."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.exr import Part, read_exr
from pipeline.files.tables import read_table, write_table
from pipeline.frames import apply
from pipeline.records import from_plain
from pipeline.target.checkerboard import Checkerboard
from pipeline.tasks.cameras import Inputs
from pipeline.tasks.rays import MOMENTS
from pipeline.truth.correspond import Correspondences, correspond
from pipeline.truth.grid import RayGrid
from pipeline.truth.position_image import on_target
from pipeline.truth.second_order import corrected
from pipeline.truth.settings import TruthSettings


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: frame, camera, targets (list of {name, target, vision_from_target}), truth, labels."""
    settings = from_plain(TruthSettings, params["truth"])
    grid = read_grid(inputs)
    positions = read_exr(inputs["positions"]["positions.exr"]) if "positions" in inputs else {}
    columns: dict[str, list[Any]] = {}
    notes = []
    for entry in sorted(params["targets"], key=lambda entry: entry["name"]):
        board = from_plain(Checkerboard, entry["target"])
        pose = np.array(entry["vision_from_target"])
        if pose[:3, 2] @ pose[:3, 3] >= 0:
            notes.append(f"{entry['name']}: no rows, because the camera sees its back")
            continue
        image = _position_image(settings.method, grid, pose, positions.get(entry["name"]))
        found = correspond(image, board.points_mm(), grid, pose, settings)
        notes.append(f"{entry['name']}: " + ", ".join(f"{name} {count}" for name, count in found.counts.items()))
        for name, column in _columns(params, entry["name"], board, pose, grid, found, settings).items():
            columns.setdefault(name, []).extend(column)
    if not columns:
        columns = {name: [] for name in COLUMNS}
    write_table(out / "correspondences.csv", [*_header(params, settings, grid), *notes], columns)


def _position_image(method: str, grid: RayGrid, pose: np.ndarray, traced: Part | None) -> np.ndarray:
    """J of a target in its own frame, by the method that the stage asks for."""
    if traced is not None:
        return _planes(traced, "X", "Y")
    image = on_target(grid.near, grid.far, grid.near_mm, grid.far_mm, pose)
    return corrected(image, grid, pose) if method == "moments" else image


def read_grid(inputs: Inputs) -> RayGrid:
    """The rays of a camera, from rays.exr and, for a plenoptic one, micro_images.csv."""
    parts = read_exr(inputs["rays"]["rays.exr"])
    near, far = parts["near"], parts["far"]
    cell = np.zeros(near.shape, np.int64)
    microlenses, centres = np.zeros((1, 3), np.int64), None
    if "micro_images" in inputs:
        table = read_table(inputs["micro_images"]["micro_images.csv"])
        names = ("microlens_k", "microlens_l", "microlens_type")
        microlenses = np.stack([table.numbers(name) for name in names], axis=1).astype(np.int64)
        centres = np.stack([table.numbers("centre_x_px"), table.numbers("centre_y_px")], axis=1)
        cell = _rows_of(_planes(parts["microlens"], "k", "l").astype(np.int64), microlenses)
    return RayGrid(
        supersampling=int(near.attributes["supersampling"]),
        near_mm=float(near.attributes["plane_z_mm"]),
        far_mm=float(far.attributes["plane_z_mm"]),
        near=_planes(near, "X", "Y"),
        far=_planes(far, "X", "Y"),
        covariance=_planes(parts["moments"], *MOMENTS),
        hit_fraction=_planes(parts["hit_fraction"], "Y")[..., 0],
        error_px=_planes(parts["error"], "X", "Y"),
        cell=cell,
        microlenses=microlenses,
        centres_px=centres,
    )


def _planes(part: Part, *channels: str) -> np.ndarray:
    return np.stack([part.channels[name] for name in channels], axis=-1).astype(np.float64)


def _rows_of(axial: np.ndarray, microlenses: np.ndarray) -> np.ndarray:
    """Row in the table of microlenses for every (k, l) of an image, (h, w)."""
    low = microlenses[:, :2].min(axis=0)
    size = microlenses[:, :2].max(axis=0) - low + 1
    rows = np.full(size, -1)
    rows[tuple((microlenses[:, :2] - low).T)] = np.arange(len(microlenses))
    return rows[tuple(np.moveaxis(axial - low, -1, 0))]


COLUMNS = (
    "frame",
    "camera",
    "target",
    "point_id",
    "microlens_k",
    "microlens_l",
    "microlens_type",
    "x_px",
    "y_px",
    "sigma_x_px",
    "sigma_y_px",
    "target_x_mm",
    "target_y_mm",
    "target_z_mm",
    "camera_x_mm",
    "camera_y_mm",
    "camera_z_mm",
    "hit_fraction",
    "visibility",
    "blur_xx_px2",
    "blur_xy_px2",
    "blur_yy_px2",
    "rho_px",
    "method",
)


def _columns(
    params: dict[str, Any],
    target: str,
    board: Checkerboard,
    pose: np.ndarray,
    grid: RayGrid,
    truth: Correspondences,
    settings: TruthSettings,
) -> dict[str, Any]:
    """Columns of one target, in the order of COLUMNS."""
    found = truth.found
    rows = len(found.point)
    microlens = [[None] * rows] * 3 if grid.centres_px is None else list(grid.microlenses[found.cell].T)
    point = board.points_mm()[found.point]
    blur = truth.blur_px2
    values = (
        [params["frame"]] * rows,
        [params["camera"]] * rows,
        [target] * rows,
        found.point,
        *microlens,
        found.x_px,
        found.y_px,
        *truth.sigma_px.T,
        *point.T,
        *apply(pose, point).T,
        truth.hit_fraction,
        [None] * rows,
        blur[:, 0, 0],
        blur[:, 0, 1],
        blur[:, 1, 1],
        truth.rho_px,
        [settings.method] * rows,
    )
    return dict(zip(COLUMNS, values, strict=True))


def _header(params: dict[str, Any], settings: TruthSettings, grid: RayGrid) -> list[str]:
    labels = params["labels"]
    filtered = f"{settings.filter}, lambda_d {settings.lambda_d}, lambda_alpha {settings.lambda_alpha_deg} deg"
    search = (
        f"quad, filter {filtered}"
        if settings.search == "quad"
        else f"nearest, threshold {settings.nearest_threshold_mm} mm"
    )
    empty = ["visibility (occlusion is not computed yet)"]
    if grid.centres_px is None:
        empty.append("microlens_k, microlens_l, microlens_type (a conventional camera)")
    return [
        f"exact image positions of target points: camera {params['camera']}, frame {params['frame']}",
        "pixel convention: (0, 0) is the centre of the top-left pixel, x right, y down",
        "units: px in the image, mm in space; target frame x right, y up, z to the viewer;"
        " camera = vision frame x right, y down, z forward, origin at the aperture stop",
        f"method: {settings.method}; search: {search}; smallest hit fraction {settings.min_hit_fraction}",
        f"weight: {labels['weight']}; wavelengths: {labels['wavelength_nm']} nm; indices: {labels['index_source']};"
        f" stop: circular, diameter {labels['stop_diameter_mm']} mm; footprint: {labels['footprint']}",
        f"K: {grid.supersampling}; samples: {labels['samples']}; seed: {labels['seed']}",
        f"empty: {'; '.join(empty)}; single empty cells of blur and rho: no bundle of the micro-image at the pixel",
    ]
