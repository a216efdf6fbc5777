"""Task `truth`: correspondences of all targets for one camera in one frame."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.exr import Part, read_exr
from pipeline.files.tables import write_table
from pipeline.records import from_plain
from pipeline.target.points import TargetPoints
from pipeline.target.target import target_from_plain
from pipeline.tasks.cameras import Inputs, tracer_of
from pipeline.tasks.ray_grid import channels_of, read_grid
from pipeline.tasks.surroundings import surroundings_of
from pipeline.tasks.truth_table import column_order, columns_of, header_of, note_of
from pipeline.truth.column_sets import column_names, column_set
from pipeline.truth.correspond import Correspondences
from pipeline.truth.grid import RayGrid
from pipeline.truth.on_points import ImageOf, correspond_points, plane_name
from pipeline.truth.own_bundle import with_own_bundles
from pipeline.truth.polish import polished
from pipeline.truth.position_image import on_target
from pipeline.truth.second_order import corrected
from pipeline.truth.settings import TruthSettings
from pipeline.truth.solve import Rig, faces_camera, guesses, solve, tangent_planes
from pipeline.truth.visibility import seen


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: frame, camera, targets (list of {name, target, vision_from_target}), occluders, truth, square_px and
    labels."""
    settings = from_plain(TruthSettings, params["truth"])
    rig = Rig(*tracer_of(inputs, params["labels"]["seed"]), params["square_px"])
    grid = read_grid(inputs) if settings.searches else None
    positions = read_exr(inputs["positions"]["positions.exr"]) if "positions" in inputs else {}
    columns: dict[str, list[Any]] = {name: [] for name in column_order(settings)}
    notes = []
    entries = sorted(params["targets"], key=lambda entry: entry["name"])
    surroundings = surroundings_of(entries, params["occluders"])
    for number, entry in enumerate(entries):
        target, pose = target_from_plain(entry["target"]), np.array(entry["vision_from_target"])
        points = target.points()
        traced = _traced(positions, entry["name"], len(points.frames))
        found, more = correspondences(rig, grid, settings, points, pose, traced), []
        if found is not None:
            planes = tangent_planes(pose, points.position_mm, points.plane_axes)
            found, visibility = seen(rig, surroundings, number, found, planes)
            rows = columns_of(params, entry["name"], points, pose, rig, found, visibility)
            for name in settings.column_sets:
                extra = column_set(name, rig, target, pose, planes, found.found)
                rows |= dict(zip(column_names(name), extra.x_px.T, strict=True))
                more.append(extra.note)
            for name, column in rows.items():
                columns[name].extend(column)
        notes.append("; ".join([f"{entry['name']}: {note_of(found, points, pose)}", *more]))
    k = grid.supersampling if grid else None
    head = header_of(params, settings, k, is_plenoptic=rig.images is not None)
    write_table(out / "correspondences.csv", [*head, *notes], columns)


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
        return solved(rig, settings, planes)
    rows = correspond_points(points, grid, pose, unfiltered(settings), _position_images(settings.method, traced))
    return None if rows is None else finished(rig, rows, planes, settings)


def solved(rig: Rig, settings: TruthSettings, planes: np.ndarray) -> Correspondences:
    """All rows of the method without images."""
    assert settings.claim_px is not None
    guess, rays = guesses(rig, planes)
    found = solve(rig, guess, planes, settings.claim_px, settings.min_hit_fraction)
    return dataclasses.replace(found, counts={**found.counts, "rays": found.counts["rays"] + rays})


def unfiltered(settings: TruthSettings) -> TruthSettings:
    """Settings without a least hit fraction: its own bundle says whether a row has light enough, not its neighbour."""
    return dataclasses.replace(settings, min_hit_fraction=0.0)


def finished(rig: Rig, rows: Correspondences, planes: np.ndarray, settings: TruthSettings) -> Correspondences:
    """Rows of a search in position images, polished where the method does that, with light and blur of their own."""
    if settings.method == "moments" and settings.search == "quad":
        rows = polished(rig, rows, planes, settings)
    return with_own_bundles(rig, rows, planes, settings.min_hit_fraction)


def _traced(positions: dict[str, Part], target: str, planes: int) -> list[Part] | None:
    """The position images that task `positions` traced, one per tangent plane."""
    return [positions[plane_name(target, number, planes)] for number in range(planes)] if positions else None


def _position_images(method: str, traced: list[Part] | None) -> ImageOf:
    """J on the planes of a target, each in its own frame, by the method that the stage asks for."""

    def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
        if traced is not None:
            return channels_of(traced[number], "X", "Y")
        image = on_target(rays.near, rays.far, rays.near_mm, rays.far_mm, pose)
        return corrected(image, rays, pose) if method == "moments" else image

    return image_of
