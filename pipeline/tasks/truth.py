"""Task `truth`: correspondences of all targets for one camera in one frame."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.exr import Part, read_exr
from pipeline.files.tables import read_table, write_table
from pipeline.frames import apply
from pipeline.records import from_plain
from pipeline.target.points import TargetPoints
from pipeline.target.target import target_from_plain
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.rays import MOMENTS
from pipeline.truth.correspond import Correspondences
from pipeline.truth.grid import RayGrid
from pipeline.truth.on_points import ImageOf, correspond_points, largest_sag_mm, plane_name
from pipeline.truth.polish import polished
from pipeline.truth.position_image import on_target
from pipeline.truth.second_order import corrected
from pipeline.truth.settings import TruthSettings
from pipeline.truth.solve import Rig, faces_camera, guesses, solve, tangent_planes


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: frame, camera, targets (list of {name, target, vision_from_target}), truth, square_px, labels."""
    settings = from_plain(TruthSettings, params["truth"])
    rig = Rig(*tracer_of(inputs, params["labels"]["seed"]), params["square_px"])
    grid = None if settings.method == "direct" else read_grid(inputs)
    positions = read_exr(inputs["positions"]["positions.exr"]) if "positions" in inputs else {}
    columns: dict[str, list[Any]] = {}
    notes = []
    for entry in sorted(params["targets"], key=lambda entry: entry["name"]):
        points, pose = target_from_plain(entry["target"]).points(), np.array(entry["vision_from_target"])
        traced = _traced(positions, entry["name"], len(points.frames))
        found = correspondences(rig, grid, settings, points, pose, traced)
        notes.append(f"{entry['name']}: {_note(found, points, pose)}")
        if found is None:
            continue
        for name, column in _columns(params, entry["name"], points, pose, rig, found).items():
            columns.setdefault(name, []).extend(column)
    if not columns:
        columns = {name: [] for name in COLUMNS}
    write_table(out / "correspondences.csv", [*_header(params, settings, grid, rig), *notes], columns)


def correspondences(
    rig: Rig,
    grid: RayGrid | None,
    settings: TruthSettings,
    points: TargetPoints,
    pose: np.ndarray,
    traced: list[Part] | None,
) -> Correspondences | None:
    """All rows of one target, None if all of its points face away; `grid` is None for the method without images."""
    planes = tangent_planes(pose, points.position_mm, points.plane_axes)
    if not faces_camera(planes).any():
        return None
    if grid is None:
        assert settings.claim_px is not None
        guess, rays = guesses(rig, planes)
        found = solve(rig, guess, planes, settings.claim_px, settings.min_hit_fraction)
        return dataclasses.replace(found, counts={**found.counts, "rays": found.counts["rays"] + rays})
    rows = correspond_points(points, grid, pose, settings, _position_images(settings.method, traced))
    if rows is None or settings.method != "moments" or settings.search != "quad":
        return rows
    return polished(rig, rows, planes, settings)


def _traced(positions: dict[str, Part], target: str, planes: int) -> list[Part] | None:
    """The position images that task `positions` traced, one per tangent plane."""
    return [positions[plane_name(target, number, planes)] for number in range(planes)] if positions else None


def _position_images(method: str, traced: list[Part] | None) -> ImageOf:
    """J on the planes of a target, each in its own frame, by the method that the stage asks for."""

    def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
        if traced is not None:
            return _planes(traced[number], "X", "Y")
        image = on_target(rays.near, rays.far, rays.near_mm, rays.far_mm, pose)
        return corrected(image, rays, pose) if method == "moments" else image

    return image_of


def _note(found: Correspondences | None, points: TargetPoints, pose: np.ndarray) -> str:
    """What became of a target: counts by reason."""
    if found is None:
        return "no rows, because the camera sees its back"
    said = [f"{name} {count}" for name, count in found.counts.items()]
    away = int(np.sum(~faces_camera(tangent_planes(pose, points.position_mm, points.plane_axes))))
    if away:
        said.append(f"points_facing_away {away}")
    sag_mm = largest_sag_mm(found, points)
    if sag_mm:
        said.append(f"largest sag of the surface from its tangent plane over the blur {sag_mm:.2g} mm")
    return ", ".join(said)


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
        square_steps=1.0 if near.attributes["footprint"] == "pixel" else 0.0,
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
    points: TargetPoints,
    pose: np.ndarray,
    rig: Rig,
    truth: Correspondences,
) -> dict[str, Any]:
    """Columns of one target, in the order of COLUMNS."""
    found, lattice = truth.found, rig.tracer.lattice
    rows = len(found.point)
    microlens = [[None] * rows] * 3
    if lattice is not None:
        microlens = [column[found.cell] for column in (lattice.k, lattice.l, lattice.type)]
    point = points.position_mm[found.point]
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
        truth.method.tolist(),
    )
    return dict(zip(COLUMNS, values, strict=True))


def _header(params: dict[str, Any], settings: TruthSettings, grid: RayGrid | None, rig: Rig) -> list[str]:
    labels = params["labels"]
    empty = ["visibility (occlusion is not computed yet; points that face away have no rows)"]
    if rig.images is None:
        empty.append("microlens_k, microlens_l, microlens_type (a conventional camera)")
    claim = "none" if settings.claim_px is None else f"{settings.claim_px} px"
    return [
        f"exact image positions of target points: camera {params['camera']}, frame {params['frame']}",
        "pixel convention: (0, 0) is the centre of the top-left pixel, x right, y down",
        "units: px in the image, mm in space; target frame x right, y up, z to the viewer;"
        " camera = vision frame x right, y down, z forward, origin at the aperture stop",
        f"method: {settings.method}; {_search(settings)}; smallest hit fraction {settings.min_hit_fraction};"
        f" claimed accuracy: {claim}; rows of method direct whose sigma is larger did not reach it",
        f"weight: {labels['weight']}; wavelengths: {labels['wavelength_nm']} nm; indices: {labels['index_source']};"
        f" stop: {labels['stop']}; footprint: {labels['footprint']}",
        f"seed: {labels['seed']}" + (f"; K: {grid.supersampling}; samples: {labels['samples']}" if grid else ""),
        f"empty: {'; '.join(empty)}; single empty cells of blur and rho: no bundle of the micro-image at the pixel",
    ]


def _search(settings: TruthSettings) -> str:
    if settings.method == "direct":
        return "J(x) = p solved at every point, no position image"
    if settings.search == "nearest":
        return f"search: nearest, threshold {settings.nearest_threshold_mm} mm"
    filtered = f"{settings.filter}, lambda_d {settings.lambda_d}, lambda_alpha {settings.lambda_alpha_deg} deg"
    surface = ", quadratic in 4 x 4 values, doubtful rows by direct" if settings.method == "moments" else ""
    return f"search: quad, filter {filtered}{surface}"
