"""A stage fitted to what a real camera sees: misfit, doubts, and the files that hold it."""

import hashlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app.stages import existing, require_free, sound, write_new
from pipeline.files.jsonfile import json_bytes
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.plugins.fits.observations import Observations
from pipeline.plugins.fits.predicted_rows import Views, entries_of
from pipeline.plugins.fits.real_images import Images
from pipeline.plugins.fits.solver import CREPT, Solution, omitted_parameters
from pipeline.records.plain import Json

MADE_BY = "pipeline calibrate"
"""Word of a document by which its files are known."""
MISTAKES = ("shift_x_px", "shift_y_px", "board", "centres_x_px", "centres_y_px")
"""Shift of all positions of points, size of the boards over what the stage states, less 1, and shift of all centres."""
_REGIONS = [f"{down} {across}" for down in ("top", "middle", "bottom") for across in ("left", "centre", "right")]
"""Regions of an image: thirds of its height and width."""
_DOUBT = 5.0
"""Deviations above which a group of rows, a row, or the estimate of a mistake is doubted [1]: of a million without
fault one is that far off."""
_MORE_THAN_NOISE = 1.1
"""Chi squared over what is expected that is not doubted however many rows there are [1]: 5 % in sigma."""
_HALF_PIXEL_PX, _BOARD_SIZE = 0.1, 1e-2
"""Deviations above which rows do not tell half a pixel [px], and the size of the boards over itself [1]."""
_LISTED = 6
"""Most frames that a note names."""
_WEAK_COMPONENT = 0.3
"""Component of a number in the weakest direction from which it is named [1]: a tenth of that direction, squared."""


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
        beyond = self.chi2 - self.expected  # noise scatters it by the root of twice its mean
        return beyond > _DOUBT * np.sqrt(2 * self.expected) and self.chi2 > _MORE_THAN_NOISE * self.expected


def region_of(x_px: np.ndarray, size_px: np.ndarray) -> np.ndarray:
    """Numbers of the regions of images in which positions lie, (n,): three to a row, from the top left."""
    return np.clip(((x_px + 0.5) / size_px * 3).astype(int), 0, 2) @ [1, 3]


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
        return self._weight * self._squared_in_sigma

    @property
    def missing(self) -> np.ndarray:
        """Rows that the stage does not have."""
        return np.flatnonzero(~np.isfinite(self.solution.residual_px[:, 0]))

    def group(self, name: str, rows: np.ndarray) -> Group:
        """The rows of a mask, (n,)."""
        counted = rows & (self._weight > 0)
        chi2, expected = self.chi2[counted].sum(), self.solution.expected[counted].sum()
        return Group(name=name, rows=int(counted.sum()), chi2=float(chi2), expected=float(expected))

    @cached_property
    def sizes_px(self) -> dict[str, tuple[int, int]]:
        """Widths and heights of the images, by camera."""
        return {name: entry.camera.sensor.size_px for name, entry in entries_of(self.stage.nominal).items()}

    @cached_property
    def groups(self) -> dict[str, list[Group]]:
        """Chi squared by camera, frame and region of the image."""
        observations = self.observations
        sizes_px = np.array([self.sizes_px[name] for name in observations.camera.tolist()])
        region = region_of(observations.x_px, sizes_px)
        frame = np.where(observations.is_centre, "white", observations.frame.astype(str))
        cameras = np.unique(observations.camera).tolist()
        return {
            "camera": [self.group(name, observations.camera == name) for name in cameras],
            "frame": [self.group(name, frame == name) for name in dict.fromkeys(frame.tolist())],
            "region": [self.group(name, region == i) for i, name in enumerate(_REGIONS)],
        }

    @cached_property
    def mistakes(self) -> tuple[np.ndarray, np.ndarray]:
        """Estimates and deviations of `MISTAKES`: what a wrong pixel origin or a wrong board would look like."""
        is_centre, slopes = self.observations.is_centre, self.solution.linearisation.slopes
        derivatives = np.zeros((len(is_centre), 2, len(MISTAKES)))
        derivatives[~is_centre, :, :2] = derivatives[is_centre, :, 3:] = -np.eye(2)
        derivatives[:, :, 2] = np.einsum("nij,nj->ni", slopes.by_pose[:, :, 3:], slopes.arm_mm)
        return omitted_parameters(self.solution, derivatives)

    @cached_property
    def ending(self) -> str:
        """Sentence about why the fit ended; of one whose steps led out of reach with the reason why there is no camera,
        and of one whose steps crept with the numbers that rows hardly tell.
        """
        ending, component = self.solution.ending, np.abs(self.solution.weakest)
        if ending == CREPT:
            named = [self.stage.numbers[i].name for i in np.argsort(-component) if component[i] > _WEAK_COMPONENT]
            ending = "rows hardly tell the poses of boards: leave out those that face the camera"
            if named:
                advice = "hold these numbers, or give them tolerances; boards that face the camera tell least of all"
                ending = f"rows hardly tell {', '.join(named)}: {advice}"
        if self.solution.refusal:
            ending = f"steps led to a camera that cannot be: {self.solution.refusal}; {ending}"
        return ending

    @cached_property
    def doubts(self) -> list[str]:
        """Sentences about what noise does not explain, and about what may be wrong then."""
        return [*self._bad_ends(), *self._bad_groups(), *self._suspicions()]

    def _bad_ends(self) -> Iterator[str]:
        """Doubts about the fit itself, and about single rows."""
        if not self.solution.converged:
            yield f"the fit did not converge: {self.ending}"
        if len(self.missing):
            named = self._names(self.missing)
            yield f"{len(self.missing)} of {len(self.observations)} positions the stage does not have: {named}"
        if len(self._far):
            yield f"{len(self._far)} positions are more than {_DOUBT:g} sigma off: {self._names(self._far)}"

    def _bad_groups(self) -> Iterator[str]:
        """Doubts about cameras, frames and regions, unless all are alike, and about all rows."""
        for kind, groups in self.groups.items():
            doubted = [group for group in groups if group.is_doubted]
            if doubted and len(groups) > len(doubted):
                listed = ", ".join(f"{group.name} ({group.chi2 / group.expected:.3g} times)" for group in doubted)
                yield f"chi squared is more than noise leaves in {kind} {listed}"
        if self._all_rows.is_doubted:
            times = self._all_rows.chi2 / self._all_rows.expected
            why = "the stage could not have made these rows, or sigma is too small"
            yield f"chi squared is {times:.3g} times what sigma leaves: {why}"

    def _suspicions(self) -> Iterator[str]:
        """Mistakes that would explain what noise does not."""
        if not self._all_rows.is_doubted and not len(self._far):
            return
        estimate, deviation = self.mistakes
        is_likely = np.abs(estimate) > _DOUBT * deviation
        for name, axes in (("positions of points", slice(2)), ("centres", slice(3, 5))):
            if is_likely[axes].any():
                x, y = estimate[axes].tolist()
                yield f"{name} that are ({x:+.3f}, {y:+.3f}) px off would fit better: is the pixel origin right?"
        if is_likely[2] and deviation[2] < _BOARD_SIZE:
            yield f"a board {1 + estimate[2]:.5g} times as large would fit better: is its size right?"

    @property
    def notes(self) -> list[str]:
        """Sentences about mistakes that these rows would not show."""
        _, deviation = self.mistakes
        notes = []
        if deviation[:2].max() > _HALF_PIXEL_PX:
            notes.append("these rows do not tell the pixel origin: half a pixel would go into numbers and poses unseen")
        if deviation[2] > _BOARD_SIZE and len(self.views.keys):
            notes.append("these rows do not tell the size of the board: it would go into its distance unseen")
        for target, frames in self.unobserved.items():
            if frames:
                listed = ", ".join(map(str, frames[:_LISTED])) + (" …" if len(frames) > _LISTED else "")
                pose = f"it has the pose of {self.stage.path.name} there"
                notes.append(f"no position shows {target} in frame {listed}: {pose}")
        return notes

    @cached_property
    def unobserved(self) -> dict[str, list[int]]:
        """Frames in which no position shows a board of fitted poses, by target: there it has that of the stage."""
        if not self.solution.linearisation.assumptions.has_free_poses:
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

    @cached_property
    def _all_rows(self) -> Group:
        return self.group("all", np.ones(len(self.observations), bool))

    @cached_property
    def _far(self) -> np.ndarray:
        """Rows that are too many sigma off, the farthest first."""
        rows = np.flatnonzero(np.sqrt(self._squared_in_sigma) > _DOUBT)
        return rows[np.argsort(-self._squared_in_sigma[rows])]

    @property
    def _squared_in_sigma(self) -> np.ndarray:
        return np.nan_to_num((self.solution.residual_px**2).sum(axis=1) / self.observations.sigma_px**2)

    @property
    def _weight(self) -> np.ndarray:
        return self.solution.linearisation.weight

    def _names(self, rows: np.ndarray) -> str:
        return ", ".join(map(self.observations.name, rows[:3])) + (" …" if len(rows) > 3 else "")

    def write(self, out: Path, images: Images | None = None) -> tuple[Path, Path]:
        """Write the layer, and beside it the covariance and all that the page says; returns both.

        `images`: those of the real camera, as `found_images` has them for this layer.
        """
        beside = require_new(out)
        about = "Numbers and poses fitted to observed positions by pipeline calibrate."
        layer = self.stage.layer(out, self.solution.correction, self._poses, about)
        facts = {"layer_sha256": hashlib.sha256(layer.encode()).hexdigest(), "images": images or {}}
        write_new(layer, out)
        try:
            sound(out, self.stage.roots)
            write_new(json_bytes(document(self) | facts).decode(), beside)
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


def document(twin: Twin) -> Json:
    """All facts about a fit as plain data; what is infinite is null, as is what a row does not have.

    `open`: steps of numbers, each in its own unit, that together change no row; `component`: of a direction of length
    1, in steps over those that alone change the rows by one sigma.
    """
    solution, observations, numbers = twin.solution, twin.observations, twin.stage.numbers
    open_directions = zip(solution.open_directions, solution.open_components, strict=True)
    mistakes = zip(MISTAKES, *twin.mistakes, strict=True)
    frames = zip(observations.frame.tolist(), observations.is_centre, strict=True)
    facts = {
        "made_by": MADE_BY,
        "stage": twin.stage.path.name,
        "position": observations.kinds,
        "views": len(twin.views.keys),
        "sizes_px": twin.sizes_px,
        "converged": solution.converged,
        "ending": twin.ending,
        "steps": solution.steps,
        "numbers": [
            {
                "name": number.name,
                "unit": number.unit,
                "before": number.before,
                "after": number.before + solution.correction[i],
                "deviation": solution.deviation[i],
                "prior": number.deviation,
                "reach": number.reach,
                "information_share": solution.information_share[i],
                "at_bound": solution.at_bound[i],
            }
            for i, number in enumerate(numbers)
        ],
        "fixed": twin.stage.fixed,
        "covariance": solution.covariance,
        "open": [
            {number.name: {"step": steps[i], "component": components[i]} for i, number in enumerate(numbers)}
            for steps, components in open_directions
        ],
        "open_are_held": solution.are_held,
        "chi2": {kind: [asdict(group) for group in groups] for kind, groups in twin.groups.items()},
        "mistakes": {name: {"estimate": value, "deviation": sigma} for name, value, sigma in mistakes},
        "doubts": twin.doubts,
        "notes": twin.notes,
        "rows": {
            "camera": observations.camera,
            "frame": [None if is_centre else frame for frame, is_centre in frames],
            "target": observations.target,
            "point_id": observations.point_id,
            "microlens": observations.microlens,
            "x_px": observations.x_px,
            "sigma_px": observations.sigma_px,
            "residual_px": solution.residual_px,
            "chi2": twin.chi2,
            "expected": solution.expected,
        },
    }
    return {name: _plain(fact) for name, fact in facts.items()}


def _plain(value: Any) -> Any:
    """Plain data, in which null stands for what is not finite."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
