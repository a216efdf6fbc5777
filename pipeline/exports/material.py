"""Content of an export: cameras, targets, and what each camera observed of each target in each frame.

`gathering` makes it of a build, in our conventions; `conversion` brings it into those of a format.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.built.records import BuiltCamera, BuiltView
from pipeline.errors import UsageError
from pipeline.frames import inverse

_SAME_MM = 1e-9
"""Deviation of poses that are the same [mm]: rounding of products of matrices."""


class ExportError(UsageError):
    """A build that a format cannot hold, or a wrong request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Points of a target that form a regular grid: id = row * columns + column, row 0 at the top.

    Attributes
    ----------
    columns, rows : int
    column_step, row_step : float
        In the unit of the material.
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
        None where ids do not count a regular grid from the top.
    """

    name: str
    kind: str
    parameters: dict[str, Any]
    points: np.ndarray
    nominal: np.ndarray
    grid: Grid | None
    is_flat: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedPose:
    """A pose as a format states it: in its direction, its form of rotation and its unit.

    Attributes
    ----------
    rotation : array
        (3,), (4,) or (3, 3), as the convention says.
    translation : (3,) float64
    """

    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportPinhole:
    """The equivalent pinhole with distortion.

    Attributes
    ----------
    principal_distance_px : float
    principal_point : (2,) float64
        An image position.
    distortion : (5,) float64
        k1, k2, p1, p2, k3 of OpenCV.
    """

    principal_distance_px: float
    principal_point: np.ndarray
    distortion: np.ndarray

    @property
    def matrix(self) -> np.ndarray:
        """Camera matrix, (3, 3)."""
        (x, y), f = self.principal_point, self.principal_distance_px
        return np.array([[f, 0.0, x], [0.0, f, y], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """Micro-images of a plenoptic camera, a row each.

    Attributes
    ----------
    microlenses : (n, 2) int64
    types : (n,) int64
    centres : (n, 2) float64
        Image positions: the real ray through the centre of the stop and the vertex.
    focal_lengths_mm : (types,) float64
    own_types : (types,) int64
        Our number of each type: where it stands in camera.json.
    """

    microlenses: np.ndarray
    types: np.ndarray
    centres: np.ndarray
    focal_lengths_mm: np.ndarray
    own_types: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayFit:
    """The regular array through the micro-images of an image.

    Attributes
    ----------
    layout : str
        As in camera.json.
    centre : (2,) float64
        Image position of the micro-image nearest to the middle of the image.
    pitch_px, cross_pitch_px : float
        Lengths of the basis vectors of CONVENTIONS.md, Microlens lattice.
    turn_rad : float
        Anticlockwise as seen, from an array that is not turned.
    type : int
        Of the micro-image at the centre.
    """

    layout: str
    centre: np.ndarray
    pitch_px: float
    cross_pitch_px: float
    turn_rad: float
    type: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GridMesh:
    """A regular mesh of micro-image centres: the node of column c and row r is origin + turned (x(c, r), y(c, r)).

    Attributes
    ----------
    layout : str
        `square`, `hexagonal` or `hexagonal-columns`.
    columns, rows : int
    pitch_px : tuple of float
        Along x and along y.
    angle_rad : float
        From +x towards +y.
    origin : (2,) float64
        An image position.
    """

    layout: str
    columns: int
    rows: int
    pitch_px: tuple[float, float]
    angle_rad: float
    origin: np.ndarray

    @property
    def step_px(self) -> tuple[float, float]:
        """Distance of columns and of rows: lines of a hexagonal mesh stand closer than its pitch."""
        closer = math.sqrt(3) / 2
        across = closer if self.layout == "hexagonal-columns" else 1
        down = closer if self.layout == "hexagonal" else 1
        return self.pitch_px[0] * across, self.pitch_px[1] * down


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportCamera:
    """A camera with its equivalent pinhole.

    Attributes
    ----------
    size_px : tuple of int
    pinhole : ExportPinhole or None
        None where no pinhole fits.
    axis : (2,) float64
        Image position of the optical axis.
    micro_images : MicroImages or None
        None of a conventional camera.
    array : ArrayFit or None
        Of a plenoptic camera; None before the conversion, too.
    mesh : GridMesh or None
        Of formats that count micro-images by column and row; None before the conversion, too.
    pose : StatedPose or None
        From another camera, in formats that state that; None before the conversion, too.
    built : BuiltCamera
        Everything else that the build says, in our conventions.
    """

    name: str
    size_px: tuple[int, int]
    pitch_mm: float
    pinhole: ExportPinhole | None
    axis: np.ndarray
    micro_images: MicroImages | None = field(repr=False)
    built: BuiltCamera = field(repr=False)
    array: ArrayFit | None = None
    mesh: GridMesh | None = None
    pose: StatedPose | None = None

    @property
    def model(self) -> ExportPinhole:
        """The pinhole, of formats that cannot do without one.

        Raises
        ------
        ExportError
            None fits.
        """
        if self.pinhole is None:
            raise ExportError(
                f"no pinhole fits {self.name}, and this format describes a camera by one",
                hint="camera.json says how much of the image has light; choose other cameras with --only",
            )
        return self.pinhole


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """Image positions of target points in one view, a row each, sorted by point and microlens.

    Attributes
    ----------
    rows : (n,) int64
        In the table of the view.
    ids : (n,) int64
        Of the point.
    positions : (n, 2) float64
        Image positions.
    microlenses : (n, 2) int64 or None
        None of a conventional camera.
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
        To the centre of projection, in the unit of the material; None where no pinhole fits.
    camera_from_world : (4, 4) float64 or None
    pose : StatedPose or None
        Of the target, as the format states it; None before the conversion, too.
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
    """

    stage: str
    remarks: tuple[str, ...]
    cameras: tuple[ExportCamera, ...]
    targets: tuple[ExportTarget, ...]
    views: tuple[ExportView, ...]

    def of(self, camera: ExportCamera) -> tuple[ExportView, ...]:
        """Views of a camera."""
        return tuple(view for view in self.views if view.camera == camera.name)

    def target(self, name: str) -> ExportTarget:
        """Target of a name."""
        return next(target for target in self.targets if target.name == name)

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
