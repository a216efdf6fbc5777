"""Content of an export: cameras, targets, and what each camera observed of each target in each frame.

`gathering` makes it of a build, in our conventions and mm; `conversion` brings it into those of a format.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.exports.micro_images import GridMesh, MicroImages
from pipeline.exports.ray_patches import rows_of_rays
from pipeline.fits.thin_lens import ThinLens, thin_lens
from pipeline.formats import Convention, ExportError
from pipeline.frames import apply, inverse
from pipeline.results.answers import SeenScene
from pipeline.results.records import BuiltCamera, BuiltPinhole, BuiltView

if TYPE_CHECKING:
    from pipeline.results.ready_camera import ReadyCamera  # loads the tracer, which few formats need

_SHUTTER_TYPES = {
    "none": "GLOBAL",
    "topToBottom": "ROLLING_TOP_TO_BOTTOM",
    "bottomToTop": "ROLLING_BOTTOM_TO_TOP",
    "leftToRight": "ROLLING_LEFT_TO_RIGHT",
    "rightToLeft": "ROLLING_RIGHT_TO_LEFT",
}
"""Types of shutters, by `plen:shutter:scanOrder`."""
_SAME = 1e-9
"""Deviation of poses that are the same, in rotation and over the distance of cameras from the origin of the world [1]:
matrices of stages are written with as many digits, and products of them round."""


@dataclass(frozen=True, kw_only=True)
class CameraRays:
    """A camera made ready when its rays are asked for, and its positions as a format counts them."""

    built: BuiltCamera = field(repr=False)
    ready: Callable[[], "ReadyCamera"] = field(repr=False)
    convention: Convention

    @cached_property
    def sight(self) -> "ReadyCamera":
        """The camera made ready, in our conventions."""
        return self.ready()

    def band(self, first: int, end: int) -> tuple[np.ndarray, np.ndarray | None]:
        """Rays (rows, w, 6) of the pixels of some rows, and the microlenses (rows, w, 2) of a plenoptic camera.

        Origin [mm] and direction, vision frame, the top-left pixel first; NaN where no light leaves. Rays are traced
        behind microlenses, else by patches.
        """
        width, _ = self.built.size_px
        if not self.built.is_plenoptic:
            near_mm, far_mm = map(float, self.built.record["near_far_mm"])
            return np.concatenate(rows_of_rays(self.sight, width, (first, end), (near_mm, far_mm)), axis=-1), None
        y, x = np.mgrid[first:end, 0:width].reshape(2, -1).astype(float)
        rays = self.sight.rays(x, y)
        assert rays.microlens is not None
        lines = np.concatenate([rays.origin_mm, rays.direction], axis=1)
        return lines.reshape(end - first, width, 6), rays.microlens.reshape(end - first, width, 2)

    @property
    def ends(self) -> np.ndarray:
        """Positions of the centres of the first and of the last pixel, (2, 2)."""
        return self.positions(np.array([[0.0, 0.0], np.array(self.built.size_px) - 1.0]))

    def positions(self, ours_px: np.ndarray) -> np.ndarray:
        """Image positions (..., 2) of ours as the format counts them."""
        return self.convention.positions(ours_px, self.built.size_px)


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedPose:
    """A pose as a format states it: in its direction, its form of rotation and its unit."""

    rotation: np.ndarray  # (3,), (4,) or (3, 3), as the convention says
    translation: np.ndarray  # (3,)

    @property
    def numbers(self) -> list[float]:
        """Rotation, row by row, then translation."""
        return [*self.rotation.ravel().tolist(), *self.translation.tolist()]

    @property
    def matrix(self) -> list[list[float]]:
        """Rows of a pose whose rotation is a matrix, (4, 4)."""
        return [*np.column_stack([self.rotation, self.translation]).tolist(), [0.0, 0.0, 0.0, 1.0]]


@dataclass(frozen=True, slots=True, kw_only=True)
class CentralModel:
    """A projection through one centre that stands for the whole image of a camera; `central` makes it."""

    name: str  # brown or a model with fx, fy, cx, cy, as `pipeline fit` has them
    centre_mm: np.ndarray  # (3,), centre of projection, vision frame
    focal_px: np.ndarray  # (2,), fx and fy
    principal_point_px: np.ndarray  # (2,)
    coefficients: np.ndarray  # in the order of `pipeline fit`
    # Residual of the rays of the image
    rms_px: float
    max_px: float
    widest_deg: float | None = None  # largest angle of these rays with the axis; None of a pinhole


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportCamera:
    """A built camera in the convention of a format, with what formats describe it by."""

    name: str
    size_px: tuple[int, int]
    pitch_mm: float
    # The equivalent pinhole with distortion; after the conversion that of the rows, if the format asks for it
    pinhole: BuiltPinhole | None
    axis: np.ndarray  # (2,), image position of the optical axis
    micro_images: MicroImages | None = field(repr=False)  # None for a conventional camera
    rays: CameraRays = field(repr=False)
    built: BuiltCamera = field(repr=False)  # everything else that the build says, in our conventions
    plain_pinhole: BuiltPinhole | None = None  # that without distortion, and its centre the same
    # Finds that of the rows, of formats that ask for it, or the reason why these determine none
    row_pinhole: Callable[[], BuiltPinhole | str] = field(default=lambda: "", repr=False)
    mesh: GridMesh | None = None  # the regular mesh through micro-images; None before the conversion
    pose: StatedPose | None = None  # from another camera, for formats that state one; None before the conversion
    central: CentralModel | None = None  # of formats that state one; None before the conversion

    @property
    def shutter_type(self) -> str:
        """Type of its shutter, by the name that NCore, gsplat and 3DGUT have for it."""
        return _SHUTTER_TYPES[self.built.shutter.scan_order if self.built.shutter else "none"]

    @property
    def model(self) -> BuiltPinhole:
        """The pinhole, of formats that cannot do without one; ExportError if none fits."""
        if self.pinhole is None:
            raise ExportError(
                f"no pinhole fits {self.name}, and this format describes a camera by one",
                hint="none fits a telecentric lens, too wide a field or too little light; `rays` holds any camera",
            )
        return self.pinhole

    @property
    def brown(self) -> list[float]:
        """k1, k2, p1, p2, k3 of `model`, of formats that know no more; ExportError: the sensor is tilted."""
        if self.model.tilt_rad.any():
            raise ExportError(
                f"the sensor of {self.name} is tilted, and the pinhole of this format is not",
                hint="formats that hold a tilt: opencv, opencv-multiview, lensboy, vision-calibration, rays",
            )
        return list(self.model.distortion.tolist())

    @property
    def opencv(self) -> list[float]:
        """fx, fy, cx, cy of `model`, and `brown`."""
        f = self.model.principal_distance_px
        return [f, f, *self.model.principal_point_px.tolist(), *self.brown]

    @property
    def image_model(self) -> CentralModel:
        """The central model, of formats that state one."""
        assert self.central is not None
        return self.central

    @property
    def array(self) -> tuple[MicroImages, GridMesh]:
        """Micro-images and the mesh through them, of formats for plenoptic cameras."""
        assert self.micro_images is not None and self.mesh is not None
        return self.micro_images, self.mesh

    @property
    def thin_lens(self) -> ThinLens:
        """The thin-lens camera; focal lengths in the order of its types. ExportError: there is none like it."""
        lens = self.built.record["lens"]
        if "sensor_tilt_deg" in self.built.record or not lens["f_number"] or "index_in_front" in lens:
            reasons = "its sensor is tilted, its lens telecentric, or no air before it"
            raise ExportError(f"no thin lens is like {self.name}: {reasons}", hint="rays and tables hold any camera")
        return thin_lens(self.built.record, self.array[0].focal_lengths_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Points of a target that form a regular grid: id = row * columns + column, row 0 at the top."""

    columns: int
    rows: int
    column_step: float  # in the unit of the material, like `row_step`
    row_step: float
    step_mm: float | None  # side of its cells, whatever the unit; None where they are no squares

    @property
    def square_mm(self) -> float:
        """Side of its cells, of formats that know squares alone; ExportError if they are no squares."""
        if self.step_mm is None:
            raise ExportError("this format knows boards with square cells, and columns and rows differ here")
        return self.step_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportTarget:
    """A target with its points, in the frame and unit of the material."""

    name: str
    kind: str
    parameters: dict[str, Any]
    points: np.ndarray  # (n, 3), the row is the id
    nominal: np.ndarray  # (n, 3)
    grid: Grid | None  # the regular grid whose points the ids count from the top; None where they do not
    is_flat: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """Image positions of target points in one view, a row each, sorted by point and microlens."""

    rows: np.ndarray  # (n,) int64, rows in the table of the view
    ids: np.ndarray  # (n,) int64, ids of the points
    positions: np.ndarray  # (n, 2)
    microlenses: np.ndarray | None  # (n, 2) int64; None for a conventional camera
    rho_px: np.ndarray  # (n,), signed blur radius, positive: the target lies beyond best focus

    def only(self, rows: np.ndarray) -> "Observations":
        columns = {name: values for name in self.__dataclass_fields__ if (values := getattr(self, name)) is not None}
        return replace(self, **{name: values[rows] for name, values in columns.items()})


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportView:
    """Everything that one camera sees of one target in one frame."""

    camera: str
    target: str
    frame: int
    image: str  # path of the preview below the output folder
    built: BuiltView = field(repr=False)
    # (4, 4), to the centre of projection, in the unit of the material; None where no pinhole fits
    camera_from_target: np.ndarray | None
    camera_from_world: np.ndarray | None
    observations: Observations
    pose: StatedPose | None = None  # of the target, as the format states it; None if not, and before the conversion
    # The same when the first line of a camera with a shutter is exposed, and the last; else none
    at_lines: tuple[StatedPose, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """A build as formats write it."""

    stage: str
    remarks: tuple[str, ...]  # for every file that allows comments: what the numbers mean, and that noise was added
    cameras: tuple[ExportCamera, ...]
    targets: tuple[ExportTarget, ...]
    views: tuple[ExportView, ...]  # sorted by camera, frame and target; one without observations is kept
    frames: Mapping[str, tuple[int, ...]]  # of each camera, by name
    scene: Callable[[], SeenScene] = field(repr=False)  # made when it is asked for

    def write_text(self, path: Path, lines: Iterable[str]) -> None:
        """Write lines below the remarks, which begin with `# `."""
        path.write_text("\n".join([*(f"# {line}" for line in self.remarks), *lines, ""]), encoding="utf-8")

    def of(self, camera: ExportCamera) -> tuple[ExportView, ...]:
        return tuple(view for view in self.views if view.camera == camera.name)

    def together(self, first: ExportCamera, second: ExportCamera) -> list[tuple[ExportView, ExportView]]:
        """Views of two cameras in the same frame, of the same target."""
        views_of_second = {(view.frame, view.target): view for view in self.of(second)}
        return [
            (view, views_of_second[key])
            for view in self.of(first)
            if (key := (view.frame, view.target)) in views_of_second
        ]

    def target(self, name: str) -> ExportTarget:
        return next(target for target in self.targets if target.name == name)

    def residuals_px(self, view: ExportView) -> np.ndarray:
        """Distances of observations from where the pinhole of the camera projects their points, (n,)."""
        camera = next(camera for camera in self.cameras if camera.name == view.camera)
        points = self.target(view.target).points[view.observations.ids]
        pose = view.camera_from_target
        assert pose is not None
        return np.hypot(*(camera.model.projected(apply(pose, points)) - view.observations.positions).T)

    @property
    def only_target(self) -> ExportTarget:
        """The target, of formats that know one; ExportError if there are several."""
        if len(self.targets) != 1:
            names = ", ".join(target.name for target in self.targets)
            raise ExportError(
                f"this format knows one target, and the build has {len(self.targets)}: {names}",
                hint="choose one with --only",
            )
        return self.targets[0]

    @property
    def board(self) -> Grid:
        """Grid of the only target; ExportError if there are several, or its points form no regular grid."""
        target = self.only_target
        if target.grid is None:
            raise ExportError(
                f"this format knows boards whose points form a grid, and {target.name} is a {target.kind}",
                hint="checkerboards, ChArUco boards and symmetric circle grids have one",
            )
        return target.grid

    def second_from_first(self, first: ExportCamera, second: ExportCamera) -> np.ndarray:
        """The pose of the first camera in the frame of the second, (4, 4), in the unit of the material.

        Raises ExportError: the pose is not the same in all frames, or unknown.
        """
        if first.name == second.name:
            return np.eye(4)
        views = self.together(first, second)
        if not views:
            raise ExportError(
                f"no frame has both {first.name} and {second.name}, so the pose between them is unknown",
                hint="a camera whose lens changes is one camera in each state: export them one by one with --only",
            )
        pairs = [
            (of_first.camera_from_world, of_second.camera_from_world)
            for of_first, of_second in views
            if of_first.camera_from_world is not None and of_second.camera_from_world is not None
        ]
        if not pairs:
            raise ExportError(f"no pinhole fits {first.name} or {second.name}, so the pose between them is unknown")
        poses = [second_from_world @ inverse(first_from_world) for first_from_world, second_from_world in pairs]
        distance = max(float(np.linalg.norm(from_world[:3, 3])) for pair in pairs for from_world in pair)
        if any((np.abs(pose - poses[0]) > _SAME * np.array([1.0, 1.0, 1.0, distance])).any() for pose in poses):
            raise ExportError(
                f"{second.name} moves against {first.name}, and this format knows rigid rigs alone",
                hint="export them one by one with --only",
            )
        return poses[0]
