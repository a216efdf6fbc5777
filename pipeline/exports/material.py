"""Content of an export: cameras, targets, and what each camera observed of each target in each frame.

`gathering` makes it of a build, in our conventions; `conversion` brings it into those of a format.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from pipeline.exports.cameras import ExportCamera, StatedPose
from pipeline.exports.errors import ExportError
from pipeline.frames import apply, inverse
from pipeline.results.records import BuiltView

_SAME_MM = 1e-9
"""Deviation of poses that are the same [mm]: rounding of products of matrices."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Points of a target that form a regular grid: id = row * columns + column, row 0 at the top.

    Attributes
    ----------
    columns, rows : int
    column_step, row_step : float
        Steps in the unit of the material.
    step_mm : float or None
        Side of its cells, whatever the unit; None where they are no squares.
    """

    columns: int
    rows: int
    column_step: float
    row_step: float
    step_mm: float | None

    @property
    def square_mm(self) -> float:
        """Side of its cells, of formats that know squares alone.

        Raises
        ------
        ExportError
            They are no squares.
        """
        if self.step_mm is None:
            raise ExportError("this format knows boards with square cells, and columns and rows differ here")
        return self.step_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportTarget:
    """A target.

    Attributes
    ----------
    points, nominal : (n, 3) float64
        The row is the id.
    grid : Grid or None
        The regular grid whose points the ids count from the top; None where they do not.
    """

    name: str
    kind: str
    parameters: dict[str, Any]
    points: np.ndarray
    nominal: np.ndarray
    grid: Grid | None
    is_flat: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """Image positions of target points in one view, a row each, sorted by point and microlens.

    Attributes
    ----------
    rows : (n,) int64
        Rows in the table of the view.
    ids : (n,) int64
        Ids of the points.
    positions : (n, 2) float64
        Image positions.
    microlenses : (n, 2) int64 or None
        None for a conventional camera.
    types : (n,) int64 or None
    rho_px : (n,) float64
        Signed blur radius, positive: the target lies beyond best focus.
    """

    rows: np.ndarray
    ids: np.ndarray
    positions: np.ndarray
    microlenses: np.ndarray | None
    types: np.ndarray | None
    rho_px: np.ndarray

    def only(self, rows: np.ndarray) -> "Observations":
        """Some of the rows."""
        return Observations(
            rows=self.rows[rows],
            ids=self.ids[rows],
            positions=self.positions[rows],
            microlenses=None if self.microlenses is None else self.microlenses[rows],
            types=None if self.types is None else self.types[rows],
            rho_px=self.rho_px[rows],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportView:
    """Everything that one camera sees of one target in one frame.

    Attributes
    ----------
    camera, target : str
    frame : int
    image : str
        Path of the preview below the output folder.
    built : BuiltView
    camera_from_target : (4, 4) float64 or None
        Transform to the centre of projection, in the unit of the material; None where no pinhole fits.
    camera_from_world : (4, 4) float64 or None
    pose : StatedPose or None
        Pose of the target as the format states it; None if it does not, and before the conversion.
    """

    camera: str
    target: str
    frame: int
    image: str
    built: BuiltView = field(repr=False)
    camera_from_target: np.ndarray | None
    camera_from_world: np.ndarray | None
    observations: Observations
    pose: StatedPose | None = None


class Scene(Protocol):
    """Targets and other things before cameras, as `results.answers.SeenScene` is."""

    def distance_mm(self, frame: int, camera: str, origin_mm: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Way along rays to the first surface, NaN: there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """All that is exported at once.

    Attributes
    ----------
    stage : str
        The stage that was built.
    remarks : tuple of str
        Lines that every file says which allows comments: what the numbers mean, and that noise was added.
    views : tuple of ExportView
        Sorted by camera, frame and target; one without observations is kept.
    frames : tuple of int
    scene : callable or None
        Gives what stands before the cameras.
    """

    stage: str
    remarks: tuple[str, ...]
    cameras: tuple[ExportCamera, ...]
    targets: tuple[ExportTarget, ...]
    views: tuple[ExportView, ...]
    frames: tuple[int, ...] = ()
    scene: Callable[[], Scene] | None = field(default=None, repr=False)

    def of(self, camera: ExportCamera) -> tuple[ExportView, ...]:
        """Views of a camera."""
        return tuple(view for view in self.views if view.camera == camera.name)

    def target(self, name: str) -> ExportTarget:
        """Target of a name."""
        return next(target for target in self.targets if target.name == name)

    def residuals_px(self, view: ExportView) -> np.ndarray:
        """Distances of observations from where the pinhole of the camera projects their points, (n,)."""
        (camera,) = (one for one in self.cameras if one.name == view.camera)
        points, pose = self.target(view.target).points[view.observations.ids], view.camera_from_target
        assert pose is not None
        return np.hypot(*(camera.model.projected(apply(pose, points)) - view.observations.positions).T)

    @property
    def only_target(self) -> ExportTarget:
        """The target, of formats that know one.

        Raises
        ------
        ExportError
            There are several.
        """
        if len(self.targets) != 1:
            names = ", ".join(target.name for target in self.targets)
            raise ExportError(
                f"this format knows one target, and the build has {len(self.targets)}: {names}",
                hint="choose one with --only",
            )
        return self.targets[0]

    @property
    def board(self) -> Grid:
        """Grid of the only target.

        Raises
        ------
        ExportError
            There are several, or its points form no regular grid.
        """
        target = self.only_target
        if target.grid is None:
            raise ExportError(
                f"this format knows boards whose points form a grid, and {target.name} is a {target.kind}",
                hint="checkerboards, ChArUco boards and symmetric circle grids have one",
            )
        return target.grid

    def between(self, first: ExportCamera, second: ExportCamera) -> np.ndarray:
        """The pose second_from_first, (4, 4).

        Raises
        ------
        ExportError
            It is not the same in all frames, or unknown.
        """
        if first.name == second.name:
            return np.eye(4)
        pairs = zip(self.of(first), self.of(second), strict=True)
        poses = [
            b.camera_from_world @ inverse(a.camera_from_world)
            for a, b in pairs
            if a.camera_from_world is not None and b.camera_from_world is not None
        ]
        if not poses:
            raise ExportError(f"no pinhole fits {first.name} or {second.name}, so the pose between them is unknown")
        if any(not np.allclose(pose, poses[0], rtol=0, atol=_SAME_MM) for pose in poses):
            raise ExportError(
                f"{second.name} moves against {first.name}, and this format knows rigid rigs alone",
                hint="export them one by one with --only",
            )
        return poses[0]
