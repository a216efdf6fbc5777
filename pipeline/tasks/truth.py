"""Tasks `truth` and `truth_tile`: correspondences of all targets for one camera in one frame.

A tile holds the rows of some points, by method `direct`, which solves each row alone.
"""

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.files.exr_bands import ExrWindows
from pipeline.files.jsonfile import read_json, write_json
from pipeline.files.tables import read_table, write_table
from pipeline.records.plain import from_plain, to_plain
from pipeline.tasks.artefacts.cameras import Inputs, focused_camera, rig_of
from pipeline.tasks.artefacts.ray_grid import RayFile, rows_of
from pipeline.tasks.artefacts.surroundings import placed_target, surroundings_of
from pipeline.tasks.artefacts.truth_table import PosedPoints, TargetNote, column_order, columns_of, header_of
from pipeline.tasks.params.placed import PlacedView
from pipeline.tasks.params.truth import Truth, TruthTable, TruthTile
from pipeline.truth.direct.direct_rows import guesses, polished, solve, with_own_bundles
from pipeline.truth.grid.per_plane import ImageOf, correspond_points, largest_sag_mm
from pipeline.truth.grid.position_image import corrected, on_target
from pipeline.truth.grid.ray_grid import AnyRayGrid, RayGrid
from pipeline.truth.planes import faces_camera, plane_name
from pipeline.truth.positions.column_sets import column_names, column_set
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings
from pipeline.truth.visibility import seen

ROWS, NOTES = "rows.csv", "notes.json"
"""Files that tiles write."""
Traced = Callable[[int, slice, slice], np.ndarray]
"""Function of the index of a tangent plane and of rows and columns of the fine grid that returns the traced position
image there.
"""


def truth(params: Truth, inputs: Inputs, out: Path) -> None:
    """All rows of a camera in a frame: correspondences.csv."""
    table = params.table
    if params.view is None:
        notes, columns = joined(inputs, params.tiles)
    else:
        rig = rig_of(inputs, table.labels.seed, params.square_px)
        notes, columns = target_rows(table, params.view, rig, inputs)
    k = RayFile(inputs).supersampling if table.settings.searches else None
    head = header_of(table, k, focused_camera(inputs))
    write_table(out / "correspondences.csv", [*head, *(note.text for note in notes)], columns)


def target_rows(
    table: TruthTable, view: PlacedView, rig: Rig, inputs: Inputs, some_points: dict[str, tuple[int, int]] | None = None
) -> tuple[list[TargetNote], dict[str, list[Any]]]:
    """Notes about the targets, and the columns of the rows of all of them.

    `some_points` has the first and end index of the points of each target, by name; by default all.
    """
    settings = table.settings
    rays = RayFile(inputs) if settings.searches else None
    positions = ExrWindows(inputs["positions"]["positions.exr"]) if "positions" in inputs else None
    columns: dict[str, list[Any]] = {name: [] for name in column_order(table)}
    notes = []
    entries = sorted(view.targets, key=lambda entry: entry.name)
    surroundings = surroundings_of(entries, view.occluders)
    for number, entry in enumerate(entries):
        name = entry.name
        if some_points is not None and name not in some_points:
            continue
        target, pose = placed_target(entry)
        posed = PosedPoints(name, target.points(), pose)
        points = posed.points
        some = slice(*some_points[name]) if some_points is not None else slice(0, len(points.kinds))
        traced = functools.partial(_traced, positions, name, len(points.frames)) if positions else None
        truth = correspondences(rig, rays, settings, posed, traced, some)
        if truth is None:
            notes.append(TargetNote(target=name, counts=None))
            continue
        planes, sets = posed.planes, []
        truth, visibility = seen(rig, surroundings, number, truth, planes)
        rows = columns_of(table, posed, rig, truth, visibility)
        for extra in settings.column_sets:
            positions_of = column_set(extra, rig, target, pose, planes, truth.solutions)
            rows |= dict(zip(column_names(extra), positions_of.x_px.T, strict=True))
            sets.append(positions_of.note)
        for column, values in rows.items():
            columns[column].extend(values)
        away, sag = int(np.sum(~faces_camera(planes[some]))), largest_sag_mm(truth, points)
        notes.append(TargetNote(target=name, counts=truth.counts, away=away, sag_mm=sag, sets=tuple(sets)))
    return notes, columns


def joined(inputs: Inputs, tiles: int) -> tuple[list[TargetNote], dict[str, list[Any]]]:
    """Notes and columns of all tiles, in the order of targets and points."""
    notes: dict[str, TargetNote] = {}
    columns: dict[str, list[Any]] = {}
    for number in range(tiles):
        files = inputs[f"tile{number}"]
        for note in (from_plain(TargetNote, plain) for plain in read_json(files[NOTES])["targets"]):
            notes[note.target] = notes[note.target].joined(note) if note.target in notes else note
        for name, cells in read_table(files[ROWS]).columns.items():
            columns.setdefault(name, []).extend(cells)
    return sorted(notes.values(), key=lambda note: note.target), columns


def correspondences(
    rig: Rig,
    rays: AnyRayGrid | None,
    settings: TruthSettings,
    posed: PosedPoints,
    traced: Traced | None,
    some: slice = slice(None),
) -> Correspondences | None:
    """All rows of one target, None if all of its points face away; `rays` is None for method `direct`.

    Method `direct` can solve some points only; the rows are the same.
    """
    planes = posed.planes
    if not faces_camera(planes).any():
        return None
    if rays is None:
        asked = np.zeros_like(planes)
        # The others face neither to the camera nor away: they get no rows
        asked[:, 0], asked[some] = planes[:, 0], planes[some]
        return solved(rig, settings, asked)
    images = _position_images(settings.method, traced)
    rows = correspond_points(posed.points, rays, posed.vision_from_target, unfiltered(settings), images)
    return None if rows is None else finished(rig, rows, planes, settings)


def solved(rig: Rig, settings: TruthSettings, planes: np.ndarray) -> Correspondences:
    """All rows by method `direct`."""
    assert settings.claim_px is not None
    guess, rays = guesses(rig, planes)
    truth = solve(rig, guess, planes, settings.claim_px, settings.min_hit_fraction)
    return dataclasses.replace(truth, counts={**truth.counts, "rays": truth.counts["rays"] + rays})


def unfiltered(settings: TruthSettings) -> TruthSettings:
    """Settings without a least hit fraction: a row's own bundle decides whether it has enough light, not its
    neighbour.
    """
    return dataclasses.replace(settings, min_hit_fraction=0.0)


def finished(rig: Rig, rows: Correspondences, planes: np.ndarray, settings: TruthSettings) -> Correspondences:
    """Rows of a search in position images, solved directly if the method requires it, with light and blur of their
    own bundles.
    """
    if settings.method == "moments" and settings.search == "quad":
        rows = polished(rig, rows, planes, settings)
    return with_own_bundles(rig, rows, planes, settings.min_hit_fraction)


def _traced(positions: ExrWindows, target: str, planes: int, number: int, rows: slice, columns: slice) -> np.ndarray:
    """Rows and columns of the fine grid from the position image that task `positions` traced for a tangent plane."""
    return rows_of(positions, plane_name(target, number, planes), rows, columns, "X", "Y")


def _position_images(method: str, traced: Traced | None) -> ImageOf:
    """J on the planes of a target, each in its own frame, by the method of the stage."""

    def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
        if traced is not None:
            k, (width, height), (left, above) = rays.supersampling, rays.size_px, rays.first_px
            return traced(number, slice(above * k, (above + height) * k), slice(left * k, (left + width) * k))
        image = on_target(rays.near, rays.far, rays.near_mm, rays.far_mm, pose)
        return corrected(image, rays, pose) if method == "moments" else image

    return image_of


def truth_tile(params: TruthTile, inputs: Inputs, out: Path) -> None:
    """The rows of some points, and the notes about their targets."""
    rig = rig_of(inputs, params.table.labels.seed, params.square_px)
    notes, columns = target_rows(params.table, params.view, rig, inputs, params.points)
    write_table(out / ROWS, [], columns)
    write_json(out / NOTES, {"targets": to_plain(notes)})
