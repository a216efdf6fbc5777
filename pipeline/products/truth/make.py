"""Tasks `truth` and `truth_tile`: correspondences of all targets for one camera in one frame.

A tile holds the rows of some points, by method `direct`, which solves each row alone.
"""

import dataclasses
import functools
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.files.jsonfile import read_json, write_json
from pipeline.files.npy import StackedRows, read_npy
from pipeline.files.tables import read_table, write_table
from pipeline.jit.work import work
from pipeline.products.cameras import Inputs, focused_camera, rig_of
from pipeline.products.positions.make import traced_files
from pipeline.products.rays.make import AXIAL, ERROR, FAR, GRID, HIT_FRACTION, NEAR, bundles_of
from pipeline.products.surroundings import placed_target, surroundings_at, visibility_then
from pipeline.products.truth.params import Truth
from pipeline.products.truth.table import PosedPoints, TargetNote, column_order, columns_of, header_of, time_columns
from pipeline.records.plain import from_plain, to_plain
from pipeline.truth.direct.direct_rows import with_own_bundles
from pipeline.truth.grid.correspond import ImageOf, correspond_points, largest_sag_mm
from pipeline.truth.grid.position_image import on_target
from pipeline.truth.grid.ray_grid import AnyRayGrid, RayGrid
from pipeline.truth.moving import solve_points
from pipeline.truth.planes import faces_camera, plane_name
from pipeline.truth.positions.column_sets import column_names, column_set
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings
from pipeline.truth.visibility import visible_rows

ROWS, NOTES = "rows.csv", "notes.json"
"""Files that tiles write."""


class RayTiles(AnyRayGrid):
    """The rays of a camera in the arrays of tiles and, of a plenoptic one, micro_images.csv; read by rows."""

    def __init__(self, inputs: Inputs) -> None:
        grid = read_json(inputs["rays"][GRID])
        self._bundles, self._cells, self._covariance = bundles_of(inputs, grid["tiles"])
        self._error = StackedRows([inputs["rays"][ERROR]])
        self.supersampling = grid["supersampling"]
        self._planes_mm = grid["planes_mm"]
        self._square_steps = 1.0 if grid["footprint"] == "pixel" else 0.0
        self.microlenses: np.ndarray = np.zeros((1, 3), np.int64)
        self.centres_px: np.ndarray | None = None
        if "micro_images" in inputs:
            table = read_table(inputs["micro_images"]["micro_images.csv"])
            names = ("microlens_k", "microlens_l", "microlens_type")
            self.microlenses = np.stack([table.numbers(name) for name in names], axis=1).astype(np.int64)
            self.centres_px = np.stack([table.numbers("centre_x_px"), table.numbers("centre_y_px")], axis=1)
            self._axial = read_npy(inputs["rays"][AXIAL])

    @property
    def size_px(self) -> tuple[int, int]:
        height, width, _ = self._covariance.shape
        return width, height

    def window(self, rows: slice, columns: slice) -> RayGrid:
        """The rays of some pixels, with those of the fine grid between them."""
        k = self.supersampling
        first, end = rows.start * k, rows.stop * k
        across = slice(columns.start * k, columns.stop * k)
        bundles = self._bundles.rows(first, end)[:, across]
        cell = np.zeros(bundles.shape[:2], np.int64)
        if self.centres_px is not None:
            cell = _rows_of(self._axial[self._cells.rows(first, end)[:, across]], self.microlenses)
        return RayGrid(
            supersampling=k,
            near_mm=self._planes_mm[0],
            far_mm=self._planes_mm[1],
            near=bundles[..., NEAR].astype(np.float64),
            far=bundles[..., FAR].astype(np.float64),
            covariance=self._covariance.rows(rows.start, rows.stop)[:, columns].astype(np.float64),
            hit_fraction=bundles[..., HIT_FRACTION].astype(np.float64),
            error_px=self._error.rows(first, end)[:, across].astype(np.float64),
            cell=cell,
            microlenses=self.microlenses,
            centres_px=self.centres_px,
            square_steps=self._square_steps,
            first_px=(columns.start, rows.start),
        )


def _rows_of(axial: np.ndarray, microlenses: np.ndarray) -> np.ndarray:
    """Index in the table of microlenses for every (k, l) of an image, (h, w)."""
    low = microlenses[:, :2].min(axis=0)
    size = microlenses[:, :2].max(axis=0) - low + 1
    rows = np.full(size, -1)
    rows[tuple((microlenses[:, :2] - low).T)] = np.arange(len(microlenses))
    return rows[tuple(np.moveaxis(axial - low, -1, 0))]


def truth(params: Truth, inputs: Inputs, out: Path) -> None:
    """All rows of a camera in a frame: correspondences.csv."""
    table = params.table
    if params.tiles:
        notes, columns = joined(inputs, params.tiles)
    else:
        notes, columns = target_rows(params, inputs)
    k = read_json(inputs["rays"][GRID])["supersampling"] if table.settings.searches else None
    head = header_of(table, k, focused_camera(inputs))
    write_table(out / "correspondences.csv", [*head, *(note.text for note in notes)], columns)
    if names := [f"{note.target} {name}" for note in notes for name in note.names]:
        first = ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
        work().warning = f"rows may be missing, {len(names)} unsolved ({first}): see the header of correspondences.csv"


def target_rows(params: Truth, inputs: Inputs) -> tuple[list[TargetNote], dict[str, list[Any]]]:
    """Notes about the targets, and the columns of the rows of all of them, or of the points of a tile."""
    table = params.table
    settings = table.settings
    view = params.view
    assert view is not None
    rig = rig_of(inputs, table.seed, params.square_px)
    rays = RayTiles(inputs) if settings.searches else None
    columns: dict[str, list[Any]] = {name: [] for name in column_order(table)}
    notes = []
    ordered = dataclasses.replace(view, targets=tuple(sorted(view.targets, key=lambda entry: entry.name)))
    around = surroundings_at(ordered, table.shutter, rig.tracer.camera.sensor.size_px)
    for number, entry in enumerate(ordered.targets):
        name = entry.name
        if params.points is not None and name not in params.points:
            continue
        target, pose = placed_target(entry)
        posed = PosedPoints(name, target.points(), pose)
        points = posed.points
        in_tile = slice(0, len(points.kinds)) if params.points is None else slice(*params.points[name])
        image_of: ImageOf = by_two_planes
        if "positions" in inputs:
            image_of = functools.partial(_traced, inputs["positions"], name, len(points.frames))
        planes = posed.before(rig, table.shutter, entry.motion)
        if rays is None:
            truth = solve_points(rig, planes, in_tile, settings.aim_px, settings.min_hit_fraction)
        else:
            truth = correspondences(rig, rays, settings, posed, image_of)
        if truth is None:
            notes.append(TargetNote(target=name, counts=None))
            continue
        sets = []
        truth, share = visible_rows(truth, visibility_then(rig, around, number, planes, truth.solutions))
        rows = columns_of(table, posed, rig, truth, share)
        if table.shutter is not None:
            rows |= time_columns(rig, truth.solutions, planes)
        for extra in settings.column_sets:
            positions_of = column_set(extra, rig, target, pose, planes, truth.solutions)
            rows |= dict(zip(column_names(extra), positions_of.x_px.T, strict=True))
            sets.append(positions_of.note)
        for column, values in rows.items():
            columns[column].extend(values)
        note = TargetNote(
            target=name,
            counts=truth.counts,
            away=int(np.sum(~faces_camera(posed.planes[in_tile]))),
            sag_mm=largest_sag_mm(truth, points),
            sets=tuple(sets),
            unsolved=_names_of(truth.unsolved, rig),
        )
        notes.append(note)
    return notes, columns


def _names_of(unsolved: np.ndarray, rig: Rig) -> tuple[tuple[int, ...], ...]:
    """Point of each unsolved row and, behind microlenses, k and l; `unsolved` are pairs of point and cell, (n, 2)."""
    axial = rig.axial[unsolved[:, 1], : 2 if rig.images else 0]
    return tuple(map(tuple, np.column_stack([unsolved[:, 0], axial]).tolist()))


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
    rig: Rig, rays: AnyRayGrid, settings: TruthSettings, posed: PosedPoints, image_of: ImageOf
) -> Correspondences | None:
    """All rows of one target by a search in position images; None if all of its points face away."""
    planes = posed.planes
    if not faces_camera(planes).any():
        return None
    # A row's own bundle decides about its light, not its neighbour.
    unfiltered = dataclasses.replace(settings, min_hit_fraction=0.0)
    rows = correspond_points(posed.points, rays, posed.vision_from_target, unfiltered, image_of)
    return None if rows is None else with_own_bundles(rig, rows, planes, settings.min_hit_fraction)


def _traced(
    files: dict[str, Path], target: str, planes: int, number: int, pose: np.ndarray, rays: RayGrid
) -> np.ndarray:
    """J on a tangent plane as task `positions` traced it, for rows as wide as the image; NaN elsewhere."""
    rows, columns = rays.fine
    index_file, traced_file = (file.name for file in traced_files(plane_name(target, number, planes)))
    width = columns.stop - columns.start
    image = np.full(((rows.stop - rows.start) * width, 2), np.nan)
    if index_file in files:  # else nothing of it is in the image
        index, traced = (np.load(files[output], mmap_mode="r") for output in (index_file, traced_file))
        low, high = np.searchsorted(index, (rows.start * width, rows.stop * width))
        image[index[low:high] - rows.start * width] = traced[low:high]
    return image.reshape(-1, width, 2)


def by_two_planes(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
    """J on a plane by method `two-plane`."""
    return on_target(rays.near, rays.far, rays.near_mm, rays.far_mm, pose)


def truth_tile(params: Truth, inputs: Inputs, out: Path) -> None:
    """The rows of some points, and the notes about their targets."""
    notes, columns = target_rows(params, inputs)
    write_table(out / ROWS, [], columns)
    write_json(out / NOTES, {"targets": to_plain(notes)})
