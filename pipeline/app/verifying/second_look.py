"""A second derivation of all rows of some target points, drawn from a camera's tables, by the method of the stage."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.app.verifying.handed_in import JudgedCamera, Scene
from pipeline.app.verifying.table_rules import Rows
from pipeline.camera.rig import Rig
from pipeline.targets.points import TargetPoints
from pipeline.targets.target import target_from_plain
from pipeline.tasks.artefacts.ray_window import rows_near, window_around
from pipeline.tasks.artefacts.surroundings import placed_target, surroundings_of
from pipeline.tasks.truth import finished, solved, unfiltered
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.judging import judged
from pipeline.truth.judging.certificate import NO_CLAIM_PX, edge_distance_px
from pipeline.truth.planes import tangent_planes
from pipeline.truth.positions.column_sets import column_names, column_set
from pipeline.truth.rows import Correspondences
from pipeline.truth.visibility import seen

ROWS = 64
"""Number of rows that the drawn points of a camera have together, approximately."""
_FEWEST_POINTS = 4
"""Least number of drawn points. It counts if single points have very many rows, because every microlens may see them.
"""
_SAME_PX = 1e-6
"""Tolerance of positions from the same random rays [px]: they differ by rounding."""
_SAME_SIGMA = 1e-3
"""Relative tolerance of standard errors from the same random rays: second moments nearly cancel in single precision."""
_SAME_SHARE = 1e-3
"""Tolerance of hit fractions: two levels of quadrature differ by 3e-5 at the rim of a micro-image."""
_SAME_BLUR = 0.02
"""Tolerance of a blur as a share of its trace. The blur is as exact as the derivative of J, which depends on the last
steps of the solution.
"""
_SAME_BLUR_PX2 = 1e-5
"""Least tolerance of a blur [px^2], (0.003 px)^2: for points in focus, whose trace is nearly 0."""
_SAME_OTHERS_PX = 2e-3
"""Tolerance of the positions of column sets [px]: their error is a few 1e-4 px."""
_EDGE_PX, _EDGE_SHARE = 1e-3, 1e-3
"""Distance from the edge of a cell [px] and from the least hit fraction within which a row may exist or not."""


@dataclass(frozen=True, slots=True)
class SecondLook:
    """Findings of the second derivation.

    Attributes
    ----------
    points, of : int
        Number of drawn target points, and number of points of all targets in all frames.
    rows : int
        Number of rows that the tables have of these points.
    problems : list of str
    """

    points: int
    of: int
    rows: int
    problems: list[str]


def second_look(camera: JudgedCamera, rig: Rig, scenes: list[tuple[Scene, Rows]], seed: int) -> SecondLook:
    """Derive all rows of the drawn points again and compare every column.

    Parameters
    ----------
    rig : Rig
        The camera ready to trace, with the random numbers of the build.
    """
    groups = [(scene, rows, number) for scene, rows in scenes for number in range(len(scene.view.targets))]
    sizes = [len(_target(scene, number).points().kinds) for scene, _, number in groups]
    of, stated = sum(sizes), sum(len(rows.point) for _, rows in scenes)
    wanted = min(of, max(_FEWEST_POINTS, ROWS * of // max(stated, 1)), ROWS)
    drawn = np.sort(np.random.default_rng(seed).choice(of, wanted, replace=False)) if of else np.zeros(0, int)
    problems, looked, first = [], 0, 0
    for (scene, rows, number), size in zip(groups, sizes, strict=True):
        points = drawn[(drawn >= first) & (drawn < first + size)] - first
        first += size
        if len(points):
            here = np.flatnonzero((rows.target == number) & np.isin(rows.point, points))
            looked += len(here)
            group = _Group(camera, rig, scene, number, points, rows, here)
            problems += [f"{scene.file}: {wrong}" for wrong in group.problems()]
    return SecondLook(wanted, of, looked, problems)


def _target(scene: Scene, number: int) -> Any:
    return target_from_plain(scene.view.targets[number].target)


@dataclass(frozen=True, slots=True)
class _Group:
    """Drawn points of one target in one frame, and their rows in the table (`here`)."""

    camera: JudgedCamera
    rig: Rig
    scene: Scene
    number: int
    points: np.ndarray
    rows: Rows
    here: np.ndarray

    def problems(self) -> Iterator[str]:
        name = self.scene.view.targets[self.number].name
        again, others = self._again()
        mine = list(zip(again.found.point.tolist(), again.found.cell.tolist(), strict=True))
        stated = {(int(self.rows.point[row]), int(self.rows.cell[row])): int(row) for row in self.here}
        lost = [i for i, pair in enumerate(mine) if pair not in stated and not self._is_doubtful(again, i)]
        new = [row for pair, row in stated.items() if pair not in set(mine) and not self._may_go(row)]
        if lost:
            yield f"{len(lost)} rows of {name} are missing, the first of point {mine[lost[0]][0]}"
        if new:
            yield f"{len(new)} rows of {name} should not be there, the first of point {self.rows.point[new[0]]}"
        both = np.array([i for i, pair in enumerate(mine) if pair in stated], np.int64)
        theirs = np.array([stated[mine[i]] for i in both], np.int64)
        extra = {column: values[both] for column, values in others.items()}
        yield from self._columns(name, again.only(both), extra, theirs)

    def _again(self) -> tuple[Correspondences, dict[str, np.ndarray]]:
        """All rows of the points, and their other positions."""
        camera, rig, settings = self.camera, self.rig, self.camera.settings
        entry = self.scene.view.targets[self.number]
        target, pose = placed_target(entry)
        points = target.points()
        planes = tangent_planes(pose, points.position_mm, points.plane_axes)
        asked = planes.copy()
        # these points face neither to the camera nor away: no rows
        asked[np.setdiff1d(np.arange(len(planes)), self.points), 3] = 0.0
        if camera.sampling is None:
            found = solved(rig, settings, asked)
        else:
            found = finished(rig, self._searched(points, pose, asked), asked, settings)
        surroundings = surroundings_of(self.scene.view.targets, self.scene.view.occluders)
        found, _ = seen(rig, surroundings, self.number, found, planes)
        others: dict[str, np.ndarray] = {}
        for name in settings.column_sets:
            positions = column_set(name, rig, target, pose, planes, found.found).x_px
            others |= dict(zip(column_names(name), positions.T, strict=True))
        return found, others

    def _searched(self, points: TargetPoints, pose: np.ndarray, planes: np.ndarray) -> Correspondences:
        """Rows that the search finds in position images, around the stated rows and wherever else rows may be."""
        camera, rig = self.camera, self.rig
        assert camera.sampling is not None
        whatever = unfiltered(camera.settings)
        x_px = self.rows.x_px
        places = {(int(self.rows.point[row]), int(self.rows.cell[row])): x_px[row] for row in self.here}
        everywhere, _ = guesses(rig, planes)
        pairs = zip(everywhere.point.tolist(), everywhere.cell.tolist(), strict=True)
        lacking = everywhere.only(np.array([pair not in places for pair in pairs], bool))
        other = solve(rig, lacking, planes, camera.settings.claim_px or NO_CLAIM_PX, 0.0)
        at = np.stack([other.found.x_px, other.found.y_px], axis=1)
        places |= dict(zip(zip(other.found.point.tolist(), other.found.cell.tolist(), strict=True), at, strict=True))
        found, tangent = other.only(np.zeros(0, np.int64)), points.planes()
        for (point, cell), x in sorted(places.items(), key=lambda item: item[0]):
            plane = tangent[points.plane[point]]
            on = pose @ plane.target_from_plane
            if on[:3, 2] @ on[:3, 3] >= 0:
                continue
            place = plane.points_mm[plane.members == point][0]
            rows = rows_near(rig, window_around(rig, x, camera.sampling), place, on, whatever, camera.sampling)
            rows = rows.only(rows.found.cell == cell)
            found = found.joined(dataclasses.replace(rows, found=_of_point(rows, point)))
        return found.sorted_by(rig.axial)

    def _columns(
        self,
        name: str,
        again: Correspondences,
        others: dict[str, np.ndarray],
        theirs: np.ndarray,
    ) -> Iterator[str]:
        """Descriptions of the columns that differ by more than their tolerance."""
        stated = {column: values[theirs] for column, values in self.rows.values.items()}
        expected = self._expected(again)
        expected |= {column: (values, _SAME_OTHERS_PX) for column, values in others.items()}
        for column, (mine, most) in expected.items():
            apart = np.abs(stated[column] - mine)
            wrong = ~((apart <= most) | (np.isnan(stated[column]) & np.isnan(mine)))
            if wrong.any():
                i = int(np.flatnonzero(wrong)[0])
                values = f"{stated[column][i]:.6g} in place of {mine[i]:.6g}"
                yield f"{int(wrong.sum())} of {len(wrong)} rows of {name} state another {column}, {values}"
        wrong = self.rows.method[theirs] != again.method
        if wrong.any():
            yield f"{int(wrong.sum())} of {len(wrong)} rows of {name} state another method"

    def _expected(self, again: Correspondences) -> dict[str, tuple[np.ndarray, Any]]:
        """The derived columns, each with its tolerance."""
        settings, is_direct = self.camera.settings, again.method == "direct"
        claim = settings.claim_px or NO_CLAIM_PX
        # A row of a search that was solved by `direct` began where the search ended, so it agrees to the claim only.
        moved = np.where(is_direct, claim + 3 * np.hypot(*again.sigma_px.T), _SAME_PX)
        blur, trace = again.blur_px2, np.trace(again.blur_px2, axis1=1, axis2=2)
        blurred = _SAME_BLUR * trace + _SAME_BLUR_PX2
        expected: dict[str, tuple[np.ndarray, Any]] = {
            "x_px": (again.found.x_px, moved),
            "y_px": (again.found.y_px, moved),
            "hit_fraction": (again.hit_fraction, _SAME_SHARE),
            "blur_xx_px2": (blur[:, 0, 0], blurred),
            "blur_xy_px2": (blur[:, 0, 1], blurred),
            "blur_yy_px2": (blur[:, 1, 1], blurred),
            "rho_px": (again.rho_px, 2 * blurred / np.maximum(np.abs(again.rho_px), np.sqrt(blurred))),
        }
        for axis, sigma in zip("xy", again.sigma_px.T, strict=True):
            expected[f"sigma_{axis}_px"] = sigma, np.where(is_direct, np.maximum(claim, sigma), _SAME_SIGMA * sigma)
        return expected

    def _is_doubtful(self, again: Correspondences, row: int) -> bool:
        """Whether a derived row is so near a limit that the table may lack it."""
        one = again.only(np.array([row]))
        x = np.stack([one.found.x_px, one.found.y_px], axis=1)
        return self._at_an_edge(one.found.cell, x, float(one.hit_fraction[0]))

    def _may_go(self, row: int) -> bool:
        """Whether a row of the table is so near a limit that it need not be found again."""
        at = np.array([row])
        return self._at_an_edge(self.rows.cell[at], self.rows.x_px[at], float(self.rows.values["hit_fraction"][row]))

    def _at_an_edge(self, cell: np.ndarray, x_px: np.ndarray, hit_fraction: float) -> bool:
        rows = judged.Rows(np.zeros((1, 4, 3)), cell, x_px, np.zeros(1, bool))
        near = abs(float(edge_distance_px(self.rig, rows)[0])) < _EDGE_PX
        return near or abs(hit_fraction - self.camera.settings.min_hit_fraction) < _EDGE_SHARE


def _of_point(rows: Correspondences, point: int) -> Any:
    return dataclasses.replace(rows.found, point=np.full(len(rows.found.point), point, np.int64))
