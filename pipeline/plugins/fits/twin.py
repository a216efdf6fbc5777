"""A stage fitted to what a real camera sees: `pipeline calibrate`."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.app.stages import existing, require_free, sound, write_new
from pipeline.errors import UsageError
from pipeline.files.jsonfile import json_bytes
from pipeline.formats import EXACT
from pipeline.plugins.fits.first_poses import first_poses
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.linear_rows import Asked
from pipeline.plugins.fits.observations import Observations, Stated, joined, read_observations
from pipeline.plugins.fits.placement import placed
from pipeline.plugins.fits.predicted_rows import Predictor, Slopes, Views, entries_of
from pipeline.plugins.fits.real_images import Images
from pipeline.plugins.fits.solver import Solution, solve, unnoticed
from pipeline.records.plain import Json

MADE_BY = "pipeline calibrate"
"""Word of a document by which its files are known."""
MISTAKES = ("shift_x_px", "shift_y_px", "board", "centres_x_px", "centres_y_px")
"""Shift of all positions of points, size of the boards over what the stage states, less 1, and shift of all centres."""
_ROWS, _COLUMNS = ("top", "middle", "bottom"), ("left", "centre", "right")
"""Regions of an image: thirds of its height and width."""
_DOUBT = 5.0
"""Deviations above which a group of rows, a row, or the estimate of a mistake is doubted [1]: of a million without
fault one is that far off."""
_TURNS, _SAME = 6, 0.01
"""Most turns in which other positions than those of J are found where the camera is then, and the change of these over
sigma that ends them [1]."""
_MORE_THAN_NOISE = 1.1
"""Chi squared over what is expected that is not doubted however many rows there are [1]: 5 % in sigma."""
_SHOWN = 6
"""Most frames that a note names."""
_HALF_TOLD_PX = 0.1
"""Deviation of a common shift above which rows do not tell half a pixel [px]."""
_SIZE_TOLD = 1e-2
"""Deviation of the size of the boards, over itself, above which rows do not tell it [1]."""


class _Rows:
    """The rows of a stage at numbers and poses: what the solver asks.

    `offset_px`: from the position of J to that which the detector looks for, (n, 2); it hardly changes with a camera.
    """

    def __init__(self, stage: FreeStage, predictor: Predictor, offset_px: np.ndarray | float) -> None:
        self._stage, self._predictor, self._observed_px = stage, predictor, predictor.observations.x_px
        self._sought_px = self._observed_px - offset_px  # of J, of a camera that explains all

    def residual(self, by: np.ndarray, poses: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
        """Predicted minus observed positions, (n, 2) [px]; NaN of rows that the stage does not have."""
        start_px = self._sought_px if near is None else self._sought_px + near
        start_px = np.where(np.isfinite(start_px), start_px, self._observed_px)
        return self._predictor.positions(self._stage.at(by), poses, start_px) - self._sought_px

    def slopes(self, by: np.ndarray, poses: np.ndarray, residual: np.ndarray) -> Slopes:
        """Derivatives there."""
        steps = [number.step for number in self._stage.numbers]
        solved_px = self._sought_px + residual
        return self._predictor.slopes(self._stage.at(by), self._stage.around(by), steps, poses, solved_px)


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Chi squared of some rows, and what is expected of it where noise alone is left."""

    name: str
    rows: int
    chi2: float
    expected: float

    @property
    def is_doubted(self) -> bool:
        """Whether no noise of the stated sigma leaves that much."""
        beyond = self.chi2 - self.expected
        return beyond > _DOUBT * np.sqrt(2 * self.expected) and self.chi2 > _MORE_THAN_NOISE * self.expected


def region_of(x_px: np.ndarray, size_px: np.ndarray) -> np.ndarray:
    """Column and row, (n, 2), of the thirds of images in which positions lie."""
    return np.clip(((x_px + 0.5) / size_px * 3).astype(int), 0, 2)


@dataclass(frozen=True, kw_only=True)
class Twin:
    """A stage fitted to observations."""

    stage: FreeStage
    observations: Observations
    views: Views
    solution: Solution

    @property
    def chi2(self) -> np.ndarray:
        """Chi squared of each row as it counts, (n,); 0 of rows that the stage does not have."""
        return self._weight * self._size2

    @property
    def missing(self) -> np.ndarray:
        """Rows that the stage does not have."""
        return np.flatnonzero(~np.isfinite(self.solution.residual_px[:, 0]))

    def group(self, name: str, rows: np.ndarray) -> Group:
        """Some of the rows."""
        there = rows & (self._weight > 0)
        chi2, expected = self.chi2[there].sum(), self.solution.expected[there].sum()
        return Group(name=name, rows=int(there.sum()), chi2=float(chi2), expected=float(expected))

    @cached_property
    def sizes_px(self) -> dict[str, tuple[int, int]]:
        """Widths and heights of the images, by camera."""
        return {name: entry.camera.sensor.size_px for name, entry in entries_of(self.stage.nominal).items()}

    @cached_property
    def groups(self) -> dict[str, list[Group]]:
        """Chi squared by camera, frame and region of the image."""
        seen = self.observations
        column, row = region_of(seen.x_px, np.array([self.sizes_px[name] for name in seen.camera.tolist()])).T
        frame = np.where(seen.is_centre, "white", seen.frame.astype(str))
        regions = [(r, c, f"{down} {across}") for r, down in enumerate(_ROWS) for c, across in enumerate(_COLUMNS)]
        return {
            "camera": [self.group(name, seen.camera == name) for name in np.unique(seen.camera).tolist()],
            "frame": [self.group(name, frame == name) for name in dict.fromkeys(frame.tolist())],
            "region": [self.group(name, (row == r) & (column == c)) for r, c, name in regions],
        }

    @cached_property
    def mistakes(self) -> tuple[np.ndarray, np.ndarray]:
        """Estimates and deviations of `MISTAKES`: what a wrong pixel origin or a wrong board would look like."""
        is_centre, slopes = self.observations.is_centre, self.solution.linear.slopes
        extra = np.zeros((len(is_centre), 2, len(MISTAKES)))
        extra[~is_centre, :, :2] = extra[is_centre, :, 3:] = -np.eye(2)
        extra[:, :, 2] = np.einsum("nij,nj->ni", slopes.by_pose[:, :, 3:], slopes.arm_mm)
        return unnoticed(self.solution, extra)

    @cached_property
    def doubts(self) -> list[str]:
        """Sentences about what noise does not explain, and about what may be wrong then."""
        said, solution = [], self.solution
        if not solution.converged:
            said.append(f"the fit did not converge: {solution.ending}")
        if len(self.missing):
            named = self._names(self.missing)
            said.append(f"{len(self.missing)} of {len(self.observations)} positions the stage does not have: {named}")
        far = np.flatnonzero(np.sqrt(self._size2) > _DOUBT)
        far = far[np.argsort(-self._size2[far])]
        if len(far):
            said.append(f"{len(far)} positions are more than {_DOUBT:g} sigma off: {self._names(far)}")
        for kind, groups in self.groups.items():
            wrong = [group for group in groups if group.is_doubted]
            if wrong and len(groups) > len(wrong):
                listed = ", ".join(f"{group.name} ({group.chi2 / group.expected:.3g} times)" for group in wrong)
                said.append(f"chi squared is more than noise leaves in {kind} {listed}")
        everything = self.group("all", np.ones(len(self.observations), bool))
        if everything.is_doubted:
            times = everything.chi2 / everything.expected
            why = "the stage could not have made these rows, or sigma is too small"
            said.append(f"chi squared is {times:.3g} times what sigma leaves: {why}")
        estimate, deviation = self.mistakes
        if everything.is_doubted or len(far):
            for what, of in (("positions of points", slice(2)), ("centres", slice(3, 5))):
                x, y = estimate[of].tolist()
                if (np.abs(estimate[of]) > _DOUBT * deviation[of]).any():
                    said.append(
                        f"{what} that are ({x:+.3f}, {y:+.3f}) px off would fit better: is the pixel origin right?"
                    )
            if deviation[2] < _SIZE_TOLD and abs(estimate[2]) > _DOUBT * deviation[2]:
                said.append(f"a board {1 + estimate[2]:.5g} times as large would fit better: is its size right?")
        return said

    @property
    def _size2(self) -> np.ndarray:
        return np.nan_to_num((self.solution.residual_px**2).sum(axis=1) / self.observations.sigma_px**2)

    @property
    def _weight(self) -> np.ndarray:
        return self.solution.linear.weight

    def _names(self, rows: np.ndarray) -> str:
        return ", ".join(map(self.observations.name, rows[:3])) + (" …" if len(rows) > 3 else "")

    @property
    def untold(self) -> list[str]:
        """Sentences about mistakes that these rows would not show."""
        _, deviation = self.mistakes
        said = []
        if deviation[:2].max() > _HALF_TOLD_PX:
            said.append("these rows do not tell the pixel origin: half a pixel would go into numbers and poses unseen")
        if deviation[2] > _SIZE_TOLD and len(self.views.keys):
            said.append("these rows do not tell the size of the board: it would go into its distance unseen")
        for target, frames in self.unobserved.items():
            if frames:
                shown = ", ".join(map(str, frames[:_SHOWN])) + (" …" if len(frames) > _SHOWN else "")
                kept = f"it has the pose of {self.stage.path.name} there"
                said.append(f"no position shows {target} in frame {shown}: {kept}")
        return said

    @cached_property
    def unobserved(self) -> dict[str, list[int]]:
        """Frames in which no position shows a board of fitted poses, by target: there it has that of the stage."""
        if not self.solution.linear.asked.has_free_poses:
            return {}
        frames = [frame.number for frame in self.stage.nominal.frames]
        targets = dict.fromkeys(target for _, target in self.views.keys)
        return {target: [frame for frame in frames if (frame, target) not in self.views.keys] for target in targets}

    @property
    def _poses(self) -> dict[str, dict[int, np.ndarray]]:
        """Poses world_from_target (4, 4) [mm] of fitted boards in all frames, by prim path."""
        fitted = dict(zip(self.views.keys, self.solution.poses, strict=True))
        stated = {frame.number: frame.world_from_target for frame in self.stage.nominal.frames}
        return {
            entry.prim_path: {
                frame: fitted.get((frame, entry.name), np.array(poses[entry.name])) for frame, poses in stated.items()
            }
            for entry in self.stage.nominal.targets
            if entry.name in self.unobserved
        }

    def write(self, out: Path, images: Images | None = None) -> tuple[Path, Path]:
        """Write the layer, and beside it the covariance and all that the page says; returns both.

        `images`: those of the real camera, as `found_images` has them for this layer.
        """
        beside = require_new(out)
        about = "Numbers and poses fitted to observed positions by pipeline calibrate."
        layer = self.stage.layer(out, self.solution.by, self._poses, about)
        digest = hashlib.sha256(layer.encode()).hexdigest()
        more = {"layer_sha256": digest, "images": images or {}}
        write_new(layer, out)
        try:
            sound(out, self.stage.roots)
            write_new(json_bytes(document(self) | more).decode(), beside)
        except BaseException:
            out.unlink(missing_ok=True)
            raise
        return out, beside


def require_new(out: Path) -> Path:
    """The file beside a layer that is not there yet; UsageError: one of them is, or cannot be written."""
    require_free(out)
    if (beside := out.with_suffix(".json")).exists():
        raise existing(beside)
    return beside


def calibrate(
    stage: FreeStage,
    files: Sequence[Path],
    stated: Stated,
    *,
    loss_scale: float | None = None,
    known_poses: bool = False,
    tell: Callable[[str], None] = lambda _: None,
) -> Twin:
    """Fit the free numbers of a dataset, and the poses of its boards unless they are known, to observed positions.

    Raises UsageError: a file cannot be read, does not belong to the dataset, or no pose of a board fits.
    """
    found = joined([placed(read_observations(file, stated), stage.nominal) for file in files])
    views = Views.of(found)
    if known_poses:
        poses = views.poses(stage.nominal)
    else:
        _require_poses_once(stage)
        poses = first_poses(found, views, stage.nominal)
    count, unknowns = 2 * len(found), len(stage.numbers) + (0 if known_poses else 6 * len(views.keys))
    if count < unknowns:
        hint = "free less, or give more images"
        raise UsageError(f"{count} coordinates do not tell {unknowns} unknowns", hint=hint)
    asked = Asked(
        sigma_px=found.sigma_px,
        view=views.of_rows,
        deviation=np.array([number.deviation for number in stage.numbers]),
        reach=np.array([number.reach for number in stage.numbers]),
        has_free_poses=not known_poses,
        loss_scale=loss_scale,
    )
    solution = _solved(stage, Predictor(found, views), asked, poses, tell)
    return Twin(stage=stage, observations=found, views=views, solution=solution)


def _solved(
    stage: FreeStage, predictor: Predictor, asked: Asked, poses: np.ndarray, tell: Callable[[str], None]
) -> Solution:
    """The solution by the positions that the detector looks for, which are found again where the camera is then."""
    found, by = predictor.observations, np.zeros(len(stage.numbers))
    if ((found.position == EXACT) | (found.position == "chief") & found.is_centre).all():
        return solve(_Rows(stage, predictor, 0.0), asked, by, poses, tell)
    offset_px = np.full((len(found), 2), np.inf)
    solution: Solution | None = None
    for _ in range(_TURNS):
        tell(f"looking for positions: {found.kinds}")
        there_px = predictor.offsets(stage.at(by), poses, found.x_px)
        if np.isnan(there_px).all():
            hint = "corners of squares have a saddle, discs a centroid, and all points exact"
            raise UsageError(f"no point of the boards has this position: {found.kinds}", hint=hint)
        is_other = np.abs(there_px - offset_px) >= _SAME * found.sigma_px[:, None]
        if solution is not None and not is_other.any():
            return solution
        solution, offset_px = solve(_Rows(stage, predictor, there_px), asked, by, poses, tell), there_px
        by, poses = solution.by, solution.poses
    assert solution is not None
    ending = "the positions that the detector looks for did not settle"
    return replace(solution, converged=False, ending=ending)


def _require_poses_once(stage: FreeStage) -> None:
    """UsageError: a number is part of the pose of a board, which is free in each frame anyway."""
    boards = {entry.prim_path for entry in stage.nominal.targets}
    for number in stage.numbers:
        attribute, _ = number.places[0]
        if str(attribute.GetPrim().GetPath()) in boards and attribute.GetName().startswith("xformOp:"):
            what = f"{number.name} is part of the pose of a board, and these are free in each frame"
            raise UsageError(what, hint="leave it out, or say --poses known")


def document(twin: Twin) -> Json:
    """All that is known of a fit as plain data; what is not known is null."""
    solution, seen = twin.solution, twin.observations
    numbers = []
    for i, number in enumerate(twin.stage.numbers):
        finite = {"deviation": solution.deviation[i], "prior": number.deviation, "reach": number.reach}
        numbers.append(
            {
                "name": number.name,
                "unit": number.unit,
                "before": number.before,
                "after": number.before + float(solution.by[i]),
                **{name: float(value) if np.isfinite(value) else None for name, value in finite.items()},
                "told": float(solution.told[i]),
                "at_bound": bool(solution.at_bound[i]),
            }
        )
    names = [number.name for number in twin.stage.numbers]
    estimate, deviation = twin.mistakes
    mistakes = zip(MISTAKES, estimate.tolist(), deviation.tolist(), strict=True)
    return {
        "made_by": MADE_BY,
        "stage": twin.stage.path.name,
        "position": seen.kinds,
        "views": len(twin.views.keys),
        "sizes_px": {name: list(size) for name, size in twin.sizes_px.items()},
        "converged": solution.converged,
        "ending": solution.ending,
        "steps": solution.steps,
        "numbers": numbers,
        "fixed": list(twin.stage.fixed),
        "covariance": solution.covariance.tolist(),
        "open": [dict(zip(names, each, strict=True)) for each in solution.open_directions.tolist()],
        "open_are_held": solution.are_held,
        "chi2": {kind: [asdict(each) for each in groups] for kind, groups in twin.groups.items()},
        "mistakes": {
            name: {"estimate": value, "deviation": off if np.isfinite(off) else None} for name, value, off in mistakes
        },
        "doubts": list(twin.doubts),
        "untold": list(twin.untold),
        "rows": {
            "camera": seen.camera.tolist(),
            "frame": [None if centre else n for n, centre in zip(seen.frame.tolist(), seen.is_centre, strict=True)],
            "target": seen.target.tolist(),
            "point_id": seen.point_id.tolist(),
            "microlens": None if seen.microlens is None else seen.microlens.tolist(),
            "x_px": seen.x_px.tolist(),
            "sigma_px": seen.sigma_px.tolist(),
            "residual_px": [[v if np.isfinite(v) else None for v in row] for row in solution.residual_px.tolist()],
            "chi2": twin.chi2.tolist(),
            "expected": solution.expected.tolist(),
        },
    }
