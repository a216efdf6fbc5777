"""Optional columns of a table of correspondences: other image positions of the same points, see CONVENTIONS.md.

x_px, y_px are those of J. Detectors of corners and dots look for other positions, and a lens with coma separates all
of them.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.rig import Rig
from pipeline.records.shapes import Float64
from pipeline.targets.corners import corners_of
from pipeline.targets.target import AnyTarget
from pipeline.truth.direct.candidates import chief_points
from pipeline.truth.positions.centroid import centroid
from pipeline.truth.positions.saddle import corner_plane, saddle
from pipeline.truth.rows import Solutions

SETS = {
    "chief": "chief: where the ray through the centre of the stop sees the point; behind a microlens, that through its"
    " vertex",
    "saddle": "saddle: where the noise-free image of an infinite corner, with the point's edges in its tangent plane,"
    " integrated over a pixel, is stationary",
    "centroid": "centroid: of the noise-free image of the disc about the point in its tangent plane",
}
"""The sets in the order of their columns, with a description of each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SetNote:
    """Rows of a set with a position and, by reason, without; largest estimated error, None if unknown."""

    name: str
    rows: int
    empty: dict[str, int]
    error_px: float | None

    @property
    def text(self) -> str:
        """Text for the header of a table."""
        empty = [f"{why} {count}" for why, count in self.empty.items() if count]
        note = f"{self.name} {self.rows}" + (f" (empty: {', '.join(empty)})" if empty else "")
        return note if self.error_px is None else f"{note}, its largest error {self.error_px:.1g} px"

    def joined(self, other: "SetNote") -> "SetNote":
        """The counts of the rows of both."""
        errors = [note.error_px for note in (self, other) if note.error_px is not None]
        return SetNote(
            name=self.name,
            rows=self.rows + other.rows,
            empty={why: count + other.empty[why] for why, count in self.empty.items()},
            error_px=max(errors, default=None),
        )


@dataclass(frozen=True, slots=True)
class ColumnSet:
    """One position per row of a target; NaN for none."""

    x_px: Float64[np.ndarray, "n 2"]
    note: SetNote


def column_names(name: str) -> tuple[str, str]:
    """Names of the columns of a set."""
    return f"{name}_x_px", f"{name}_y_px"


def column_set(
    name: str,
    rig: Rig,
    target: AnyTarget,
    pose: Float64[np.ndarray, "4 4"],
    planes: Float64[np.ndarray, "p 4 3"],
    rows: Solutions,
) -> ColumnSet:
    """The positions of one set for the rows of a target at `pose` vision_from_target, with `planes` at its points."""
    make = {"chief": _chief, "saddle": _saddles, "centroid": _centroids}[name]
    return make(rig, target, pose, planes[rows.point], rows)


def _chief(rig: Rig, target: AnyTarget, pose: np.ndarray, planes: np.ndarray, rows: Solutions) -> ColumnSet:
    x = chief_points(rig.tracer, rig.microlens(rows.cell), rows.xy_px, planes)
    return _noted("chief", x, {"no such ray": np.isnan(x[:, 0])}, None)


def _saddles(rig: Rig, target: AnyTarget, pose: np.ndarray, planes: np.ndarray, rows: Solutions) -> ColumnSet:
    around, microlens, start = corners_of(target), rig.microlens(rows.cell), rows.xy_px
    edges = around.edges[rows.point] @ pose[:3, :3].T
    is_corner = np.isfinite(edges).all(axis=(1, 2))
    x, error = np.full(start.shape, np.nan), np.full(len(start), np.nan)
    for i in np.flatnonzero(is_corner):
        plane, ratio = corner_plane(planes[i], edges[i]), float(around.mean_over_contrast[rows.point[i]])
        solution = saddle(rig.tracer, int(microlens[i]), start[i], plane, ratio)
        x[i], error[i] = solution.x_px, solution.error_px
    lost = is_corner & np.isnan(x[:, 0])
    return _noted("saddle", x, {"not a corner of four sectors": ~is_corner, "none in the own micro-image": lost}, error)


def _centroids(rig: Rig, target: AnyTarget, pose: np.ndarray, planes: np.ndarray, rows: Solutions) -> ColumnSet:
    radius, start = target.points().radius_mm[rows.point], rows.xy_px
    x, error = np.full(start.shape, np.nan), np.full(len(start), np.nan)
    for i in np.flatnonzero(~np.isnan(radius)):
        solution = centroid(rig, int(rows.cell[i]), start[i], planes[i], float(radius[i]))
        x[i], error[i] = solution.x_px, solution.error_px
    lost = ~np.isnan(radius) & np.isnan(x[:, 0])
    return _noted("centroid", x, {"not a disc": np.isnan(radius), "disc not whole in image or cell": lost}, error)


def _noted(name: str, x_px: np.ndarray, reasons: dict[str, np.ndarray], error_px: np.ndarray | None) -> ColumnSet:
    is_known = ~np.isnan(x_px[:, 0])
    largest = float(error_px[is_known].max()) if error_px is not None and is_known.any() else None
    empty = {why: int(here.sum()) for why, here in reasons.items()}
    return ColumnSet(x_px, SetNote(name=name, rows=int(is_known.sum()), empty=empty, error_px=largest))
