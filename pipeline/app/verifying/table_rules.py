"""Rules that every row of a table of correspondences must keep; no ray is traced to check them."""

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.app.verifying.handed_in import JudgedCamera, Scene
from pipeline.camera.rig import Rig
from pipeline.errors import PipelineError
from pipeline.frames import apply
from pipeline.targets.points import TargetPoints
from pipeline.targets.target import target_from_plain
from pipeline.tasks.artefacts.truth_table import CHANNEL, column_order, header_of
from pipeline.tasks.params.placed import PlacedTarget
from pipeline.truth.settings import TruthSettings

_TEXT = ("camera", CHANNEL, "target", "method")
_SAME_MM = 1e-6
"""Tolerance of points in a table against the stage [mm]: text keeps every digit, but matrix products may be rounded in
another order.
"""
_SAME_RHO = 1e-9
"""Relative tolerance of rho^2 against twice the trace of the blur: the same numbers, squared and rounded."""


class UnfitTable(PipelineError):
    """The table does not belong to a camera of the stage, so that nothing else can be checked."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a table as arrays of numbers.

    Attributes
    ----------
    target, point, cell : (n,) int64
        Index of the target in the scene, id of its point, index of the microlens (0 without microlenses).
    values : dict
        All other numeric columns, (n,) float64 each, NaN for an empty cell.
    method : (n,) str
    """

    target: np.ndarray
    point: np.ndarray
    cell: np.ndarray
    values: dict[str, np.ndarray]
    method: np.ndarray

    @property
    def x_px(self) -> np.ndarray:
        """Image positions, (n, 2)."""
        return np.stack([self.values["x_px"], self.values["y_px"]], axis=1)


def rows_of_scene(camera: JudgedCamera, rig: Rig, scene: Scene) -> Rows:
    """The rows of a table.

    Raises
    ------
    UnfitTable
        Columns are missing or not numeric, or rows name a target, point or microlens that the stage lacks.
    """
    columns, wanted = list(scene.table.columns), column_order(scene.truth)
    if columns != wanted:
        raise UnfitTable(f"{scene.file} has other columns than {', '.join(wanted)}")
    try:
        values = {name: scene.table.numbers(name) for name in wanted if name not in _TEXT}
    except ValueError as error:
        raise UnfitTable(f"{scene.file}: {error}") from None
    targets = {entry.name: number for number, entry in enumerate(scene.view.targets)}
    counts = np.array([len(_points(entry).kinds) for entry in scene.view.targets] + [0])
    target = np.array([targets.get(name, -1) for name in scene.table.columns["target"]], np.int64)
    point, cell = _whole(values["point_id"]), _cells(rig, values)
    unknown = (target < 0) | (point < 0) | (point >= counts[target]) | (cell < 0)
    unknown |= ~(np.isfinite(values["x_px"]) & np.isfinite(values["y_px"]))
    if unknown.any():
        raise UnfitTable(f"{scene.file}: {_some(unknown)} of no target point, microlens or place of the stage")
    return Rows(target, point, cell, values, np.array(scene.table.columns["method"], str))


def broken_rules(camera: JudgedCamera, rig: Rig, scene: Scene, rows: Rows) -> Iterator[str]:
    """Descriptions of the rules that a table breaks, by itself or against the stage."""
    for wrong, what in (
        *_labels(scene, rig, rows),
        *_places(scene, rig, rows),
        *_ranges(camera.settings, rows),
    ):
        if wrong.any():
            yield f"{scene.file}: {_some(wrong)} {what}"
    yield from _header(camera, scene, rows)


def wrong_counts(camera: str, stated: Any, scenes: list[tuple[Scene, Rows]]) -> Iterator[str]:
    """Differences between the counts under `points` in the manifest and the rows of the tables."""
    frames = stated.get(camera, {}).get("frames") if isinstance(stated, dict) and _is_dict(stated, camera) else None
    known = {row.get("frame"): row for row in frames if isinstance(row, dict)} if isinstance(frames, list) else {}
    for scene, rows in scenes:
        names = [entry.name for entry in scene.view.targets]
        pairs = np.unique(np.stack([rows.target, rows.point], axis=1), axis=0)
        seen = {name: int(np.sum(pairs[:, 0] == number)) for number, name in enumerate(names)}
        if known.get(scene.number) != {"frame": scene.number, "rows": len(rows.point), "seen": seen}:
            yield f"{scene.file}: the manifest counts other rows or points than its {len(rows.point)} rows"


def _is_dict(stated: dict[str, Any], name: str) -> bool:
    return isinstance(stated.get(name), dict)


_Rule = tuple[np.ndarray, str]
"""Rows that break a rule, (n,) bool, and a description of the fault."""


def _labels(scene: Scene, rig: Rig, rows: Rows) -> Iterator[_Rule]:
    yield rows.values["frame"] != scene.number, "of another frame"
    yield np.array(scene.table.columns["camera"], str) != scene.truth.camera, "of another camera"
    if channel := scene.truth.labels.channel:
        yield np.array(scene.table.columns[CHANNEL], str) != channel.name, "of another channel"
    lattice = rig.tracer.lattice
    kind = np.full(len(rows.cell), math.nan) if lattice is None else lattice.type[rows.cell].astype(float)
    yield ~_equal(rows.values["microlens_type"], kind), "with another microlens_type than the stage has there"
    order = np.lexsort((*rig.axial[rows.cell].T, rows.point, rows.target))
    yield order != np.arange(len(order)), "not in the order target, point, l, k"
    key = np.stack([rows.target, rows.point, rows.cell], axis=1)
    _, where, count = np.unique(key, axis=0, return_inverse=True, return_counts=True)
    yield count[where.reshape(-1)] > 1 if len(key) else np.zeros(0, bool), "there more than once"


def _places(scene: Scene, rig: Rig, rows: Rows) -> Iterator[_Rule]:
    here, there = (
        np.stack([rows.values[f"{frame}_{axis}_mm"] for axis in "xyz"], axis=1) for frame in ("target", "camera")
    )
    wrong = np.zeros((2, len(rows.point)), bool)
    for number, entry in enumerate(scene.view.targets):
        mine = rows.target == number
        points = _points(entry).position_mm[rows.point[mine]]
        where = apply(np.array(entry.vision_from_target), points)
        wrong[0, mine] = ~(np.abs(here[mine] - points) < _SAME_MM).all(axis=1)
        wrong[1, mine] = ~(np.abs(there[mine] - where) < _SAME_MM).all(axis=1)
    yield wrong[0], "whose target_x_mm, target_y_mm, target_z_mm are not those of the point"
    yield wrong[1], "whose points are not where they stand: camera_x_mm, camera_y_mm, camera_z_mm"
    inside = rig.in_image(rows.x_px)
    yield ~inside, "outside of the image"
    yield inside & ~rig.in_cell(rows.x_px, rows.cell), "outside of the cell of their micro-image"


def _ranges(settings: TruthSettings, rows: Rows) -> Iterator[_Rule]:
    values = rows.values
    xx, xy, yy, rho = (values[name] for name in ("blur_xx_px2", "blur_xy_px2", "blur_yy_px2", "rho_px"))
    unknown = np.isnan(xx) & np.isnan(xy) & np.isnan(yy)
    for name in ("sigma_x_px", "sigma_y_px"):
        # both columns need the derivatives of J
        is_unknown = np.isnan(values[name]) & unknown & (rows.method != "direct")
        is_error = (values[name] >= 0) & np.isfinite(values[name])
        yield ~(is_error | is_unknown), f"whose {name} is no standard error"
    light, visible = values["hit_fraction"], values["visibility"]
    enough = (light > 0) & (light >= settings.min_hit_fraction) & np.isfinite(light)
    yield ~enough, "with a hit_fraction below the smallest that rows may have"
    yield ~(((visible > 0) & (visible <= 1)) | np.isnan(visible)), "with a visibility that no row has"
    with np.errstate(invalid="ignore", over="ignore"):
        is_covariance = (xx >= 0) & (yy >= 0) & (xy**2 <= xx * yy * (1 + 1e-6)) & np.isfinite(xx + yy)
        is_radius = np.abs(rho**2 - 2 * (xx + yy)) <= _SAME_RHO * 2 * (xx + yy)
    yield ~(is_covariance | unknown), "whose blur is no covariance"
    yield ~(is_radius | (unknown & np.isnan(rho))), "whose rho_px is not the radius of their blur"
    methods = {settings.method, "direct"} if settings.method == "moments" else {settings.method}
    yield ~np.isin(rows.method, list(methods)), f"of another method than {' or '.join(sorted(methods))}"


def _header(camera: JudgedCamera, scene: Scene, rows: Rows) -> Iterator[str]:
    """Faults of the comment lines: differences from the stage, and wrong counts of rows."""
    k = camera.sampling.supersampling if camera.sampling else None
    is_plenoptic = camera.camera.microlenses is not None
    head = header_of(scene.truth, k, is_plenoptic=is_plenoptic)
    if [line.strip() for line in head] != list(scene.table.comments[: len(head)]):
        yield f"{scene.file}: its comments are not those of the stage"
    counts = Counter(rows.target.tolist())
    for number, entry in enumerate(scene.view.targets):
        said = [line for line in scene.table.comments[len(head) :] if line.startswith(f"{entry.name}: ")]
        stated = [int(count) for line in said for count in re.findall(r"\brows (\d{1,12})\b", line)]
        if len(said) != 1 or stated != [counts[number]] * len(stated) or (counts[number] and not stated):
            yield f"{scene.file}: its comments count other rows of {entry.name} than the {counts[number]} there"


def _points(entry: PlacedTarget) -> TargetPoints:
    points: TargetPoints = target_from_plain(entry.target).points()
    return points


def _cells(rig: Rig, values: dict[str, np.ndarray]) -> np.ndarray:
    """Index of the microlens of each row; 0 for a conventional camera, -1 if no such microlens exists."""
    k, l, lattice = values["microlens_k"], values["microlens_l"], rig.tracer.lattice
    if lattice is None:
        return np.where(np.isnan(k) & np.isnan(l), 0, -1)
    numbers = {pair: row for row, pair in enumerate(zip(lattice.k.tolist(), lattice.l.tolist(), strict=True))}
    return np.array([numbers.get(pair, -1) for pair in zip(k.tolist(), l.tolist(), strict=True)], np.int64)


def _whole(values: np.ndarray) -> np.ndarray:
    """Values as whole numbers; -1 for a value that is not whole or cannot be an id."""
    fits = (values >= 0) & (values < 2**31) & (values == np.floor(values))
    return np.where(fits, values, -1).astype(np.int64)


def _equal(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return (left == right) | (np.isnan(left) & np.isnan(right))


def _some(wrong: np.ndarray) -> str:
    """A count of rows for a message: "3 of 28 rows (first the 5th) are"."""
    first = int(np.flatnonzero(wrong)[0]) + 1
    return f"{int(wrong.sum())} of {len(wrong)} rows, the first is row {first}:"
