"""Poses of a target that fill the field of view and the depth of field of cameras, by their real lenses.

For very wide lenses, targets stand around the lens and face it; depths then count along rays.

A Halton sequence draws the position of the target's middle in the image, its depth, and the angle and axis of its tilt,
so that even a few poses spread over all of them. With several cameras, they take turns: a pose is drawn in the image of
one, and all have to see it. A pose that shows too little of the target is moved towards the middle of the common field,
then tilted less, then moved away, until it shows enough.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from pipeline.camera.figures.outlook import covered_mm
from pipeline.camera.focusing.depth_of_field import foci, middle_focus, view_of
from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.pupil.from_stop import pupil_fan
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.errors import UsageError
from pipeline.fits.field import COLUMNS, ROWS, positions_px
from pipeline.frames import apply, inverse
from pipeline.optics.first_order import first_order
from pipeline.targets.target import AnyTarget
from pipeline.truth.direct.direct_rows import guesses, planes_of_rays, solve
from pipeline.truth.planes import axes_across, faces_camera, tangent_planes

CANDIDATES = 12
"""Candidate poses per selected pose: with twice as many the best are better by a few percent."""
_DEEPEST, _PLENOPTIC_DEEPEST = 2.0, 6.0
"""Farthest distance of a target over its nearest [1], without and with microlenses: a depth of field may reach to
infinity. Calibrations profit from a large image of the target, with microlenses from all depths.
"""
_FILLED = 0.9
"""Radius of a target over half the diagonal of the image, at its nearest [1]."""
_RETREATS = tuple(
    (pull, lean, away) for away in (0.0, 0.5, 1.0) for lean in (1.0, 0.5, 0.0) for pull in np.linspace(1.0, 0.0, 9)
)
"""Changes of a drawn pose that are tried in this order until it shows enough: fraction of the distance from the image
centre to the drawn position, fraction of the drawn tilt, and fraction of the distance from the drawn depth to the
farthest [1].
"""
_STEEP = 0.45
"""Axial extent of a tilted target over the depth of field [1], on either side: a tenth is left for its position."""
_BLUR_PX = 3.0
"""Default largest blur for a conventional camera [px]: detectors find corners well below it."""
SHARES, PLENOPTIC_SHARES = (0.7, 0.6, 0.5, 0.4, 0.3), (0.5, 0.4, 0.3)
"""Candidate radii of a fitted target over half the diagonal of the image in the middle of the depths [1], largest
first. A larger target shows more perspective even where its tilts are flatter; microlenses profit more from depth.
"""
_LEAST_APART_PX = 2.0
"""Least distance of neighbouring points at their farthest [px], in views of an unfocused camera, which are coarse."""
_ROUGH_PX = 0.05
"""Accuracy of image positions that only decide about visibility [px]."""
_LEAST_LIGHT = 0.2
"""Least share of the on-axis light with which a point counts as visible [1]: detectors fail in deep vignetting."""
_APART = 1.5
"""Distance of the second plane of rays over that of the first, which is at the nearest depth [1]: rays are straight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """Demands on poses; another `seed` gives other poses of the same kind.

    `most_tilt_deg` is between the target and the image plane, `least_seen` a share of its points. `blur_px` is a
    diameter by the paraxial depth of field: 3 by default, and behind microlenses the camera's circle of confusion,
    because in a micro-image or a view of a dozen pixels 3 would erase the pattern. `fit` says whether the target was
    scaled. Each pose is chosen from `of` candidates.
    """

    count: int
    seed: int = 1
    most_tilt_deg: float = 40.0
    least_seen: float = 1.0
    blur_px: float | None = None
    fit: bool = False
    of: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardPose:
    """A pose of a target in the vision frame of the first camera, with the depth of its middle there, its angle to the
    image plane of the camera in whose image it was drawn, or of a wide camera to the plane across its ray, and image
    positions of its points in all cameras, (cameras, n, 2); NaN: not visible.
    """

    vision_from_target: np.ndarray
    away_mm: float
    tilt_deg: float
    seen_px: np.ndarray

    @property
    def fewest_visible(self) -> int:
        """Number of points visible to the camera that sees fewest."""
        return int(np.isfinite(self.seen_px[:, :, 0]).sum(axis=1).min())


@dataclass(frozen=True, kw_only=True)
class CameraField:
    """A camera's main lens before a target: image positions of poses, and object points of image positions.

    Microlenses are left out: they move a point by less than a micro-image. `vision_from_first` leads from the vision
    frame of the first camera to that of this one.
    """

    camera: Camera
    target: AnyTarget
    wish: Wish
    vision_from_first: np.ndarray

    @cached_property
    def rig(self) -> Rig:
        """The main lens alone."""
        return Rig.of(Tracer(dataclasses.replace(self.camera, microlenses=None)))

    @cached_property
    def points_mm(self) -> np.ndarray:
        """Points of the target, (n, 3), target frame."""
        return self.target.points().position_mm

    @cached_property
    def radius_mm(self) -> float:
        """Distance of the farthest point from the middle of the target."""
        return float(np.linalg.norm(self.points_mm, axis=1).max())

    @property
    def middle_px(self) -> np.ndarray:
        return (np.array([self.camera.sensor.width_px, self.camera.sensor.height_px]) - 1) / 2

    @cached_property
    def pupil_mm(self) -> float:
        """Vision z of the entrance pupil, the centre of the paraxial pinhole."""
        return first_order(self.camera.prescription).entrance_pupil.z_mm

    @cached_property
    def is_wide(self) -> bool:
        """Whether targets stand on a sphere about the lens and not on planes, because its field is very wide."""
        return pupil_fan(self.camera.prescription).is_wide

    @cached_property
    def principal_distance_px(self) -> float:
        """Principal distance of the paraxial pinhole."""
        return self.camera.sensor.width_px / covered_mm(self.camera, self.pupil_mm + 1.0)[0]

    @property
    def blur_px(self) -> float:
        """Largest diameter of blur, on the sensor or in a micro-image."""
        return self.wish.blur_px or (self.camera.circle_of_confusion_px if self.camera.microlenses else _BLUR_PX)

    @cached_property
    def depth_mm(self) -> tuple[float, float]:
        """Nearest and farthest distance at which the target is sharp, fits into the image and has resolved points."""
        half_px = float(np.hypot(*(self.middle_px + 0.5)))
        # Nearer than this the required share of the target reaches beyond `_FILLED` of the half diagonal.
        fits_mm = self.radius_mm * self.wish.least_seen * self.principal_distance_px / (_FILLED * half_px)
        near, far = self.sharp_mm(self.pupil_mm + fits_mm)
        # Farther than this neighbouring points are less than `_LEAST_APART_PX` apart.
        view_px = self.principal_distance_px * self.camera.sensor.pitch_mm / view_of(self.camera).sensor.pitch_mm
        resolved_mm = self.nearest_mm * view_px / _LEAST_APART_PX
        return near, min(far, self.pupil_mm + resolved_mm)

    def sharp_mm(self, least_mm: float = 0.0) -> tuple[float, float]:
        """Depth of field from a distance on, at least 1 mm before the first surface; behind microlenses, the union over
        all types.
        """
        depths_mm = [
            focus.depth_of_field_mm
            for focus in foci(dataclasses.replace(self.camera, circle_of_confusion_px=self.blur_px))
        ]
        first_surface_mm = -self.camera.prescription.vertices_from_stop_mm[0]
        near = max(min(near for near, _ in depths_mm), first_surface_mm + 1.0, least_mm)
        deepest = _PLENOPTIC_DEEPEST if self.camera.microlenses else _DEEPEST
        return near, min(max(far for _, far in depths_mm), deepest * near)

    @property
    def steepest_deg(self) -> float:
        """Largest tilt at which the target stays sharp."""
        near, far = self.depth_mm
        return math.degrees(math.asin(min(1.0, _STEEP * max(0.0, far - near) / self.radius_mm)))

    def scale_to_fill(self, share: float) -> float:
        """Factor that scales the target to this radius over half the image diagonal, in the middle of the depths."""
        focus_mm = middle_focus(self.camera)
        middle_mm = float(np.mean(self.sharp_mm(focus_mm / 2 if math.isfinite(focus_mm) else 0.0)))
        half_mm = float(np.hypot(*covered_mm(self.camera, middle_mm))) / 2
        if self.is_wide:
            half_mm = min(half_mm, middle_mm - self.pupil_mm)
        return share * half_mm / self.radius_mm

    @cached_property
    def rays_mm(self) -> np.ndarray:
        """Intersections of the rays of `positions_px` with two depths, (rows, columns, 2, 3); NaN in the dark."""
        x_px = positions_px(self.camera.sensor.size_px)
        near = self.depth_mm[0]
        planes = planes_of_rays(self.rig, x_px, (near, _APART * near))
        moments = integrals(self.rig.tracer, Bundles(x_px, np.full(len(x_px), NO_MICROLENS), planes), 1).moments
        ends = planes[:, :, 0] + np.einsum("nek,nekj->nej", moments[:, :4].reshape(-1, 2, 2), planes[:, :, 1:3])
        ends[self.rig.hit_fraction(moments) < _LEAST_LIGHT] = np.nan
        return ends.reshape(ROWS, COLUMNS, 2, 3)

    def object_point(self, x_px: np.ndarray, z_mm: float) -> tuple[np.ndarray, np.ndarray]:
        """Object point of an image position at a depth, (3,) [mm], vision frame, and the axes of the target's plane at
        that point, the columns of a (3, 3): parallel to the image, but for a wide camera across the ray.

        Both are interpolated bilinearly between the rays of `rays_mm`; NaN where no light passes.
        """
        column, row = (x_px + 0.5) / (2 * self.middle_px + 1) * (COLUMNS - 1, ROWS - 1)
        # Both depths and all three coordinates of the grid at this row and column
        start, end = map_coordinates(self.rays_mm, np.broadcast_arrays(row, column, *np.indices((2, 3))), order=1)
        point = start + (z_mm / self.depth_mm[0] - 1) / (_APART - 1) * (end - start)
        return point, axes_across((end - start)[None])[0].T if self.is_wide else np.eye(3)

    def away_mm(self, point_mm: np.ndarray) -> float:
        """Depth of a point: its vision z, or for a wide camera its distance from the entrance pupil."""
        if not self.is_wide:
            return float(point_mm[2])
        return self.pupil_mm + float(np.linalg.norm(point_mm - (0.0, 0.0, self.pupil_mm)))

    @cached_property
    def around_mm(self) -> float:
        """Width of the surroundings that a detector needs of a point: half the distance to its neighbours, so that
        discs and halves of squares lie in the image entirely, but no more than a quarter of a target of few points. A
        whole square would keep points away from the edge of the image, where distortion is largest.
        """
        return min(self.nearest_mm, self.radius_mm) / 2

    @cached_property
    def nearest_mm(self) -> float:
        """Distance of neighbouring points."""
        return float(np.median(KDTree(self.points_mm).query(self.points_mm, k=[2])[0]))

    @cached_property
    def _chart(self) -> LinearNDInterpolator:
        """Interpolant of image positions by directions from the entrance pupil."""
        points_mm = self.rays_mm[:, :, 1].reshape(-1, 3)
        lit = np.isfinite(points_mm).all(axis=1)
        return LinearNDInterpolator(self._angles(points_mm[lit]), positions_px(self.camera.sensor.size_px)[lit])

    def _angles(self, points_mm: np.ndarray) -> np.ndarray:
        """Directions of points from the entrance pupil, (n, 2): angles with the axis, along x and y."""
        x, y, z = (points_mm - (0.0, 0.0, self.pupil_mm)).T
        across = np.hypot(x, y)
        return np.column_stack([x, y]) * (np.arctan2(across, z) / np.maximum(across, 1e-9))[:, None]

    def roughly_px(self, vision_from_target: np.ndarray) -> np.ndarray:
        """Approximate `seen_px`, right to a pixel or so: interpolated between traced rays."""
        planes = tangent_planes(vision_from_target, self.points_mm, self.target.points().plane_axes)
        return np.where(faces_camera(planes)[:, None], self._chart(self._angles(planes[:, 0])), np.nan)

    def seen_px(self, vision_from_target: np.ndarray) -> np.ndarray:
        """Image positions of all points, (n, 2); NaN where a point is not visible."""
        planes = tangent_planes(vision_from_target, self.points_mm, self.target.points().plane_axes)
        images = solve(self.rig, guesses(self.rig, planes)[0], planes, _ROUGH_PX, _LEAST_LIGHT).solutions
        positions = np.full((len(planes), 2), np.nan)
        positions[images.point] = np.stack([images.x_px, images.y_px], axis=1)
        return positions

    def has_margin(self, seen_px: np.ndarray, z_mm: float) -> np.ndarray:
        """Whether the surroundings of target points at a depth are in the image as well, (n,) bool."""
        margin_px = self.around_mm * self.principal_distance_px / (z_mm - self.pupil_mm)
        inside: np.ndarray = np.all(np.abs(seen_px - self.middle_px) <= self.middle_px + 0.5 - margin_px, axis=1)
        return inside


def poses_that_fill(fields: Sequence[CameraField], margins: tuple[bool, ...] = (True, False)) -> Iterator[BoardPose]:
    """Poses all over the images and the depths of field of cameras, each with the visible points.

    Where possible, the surroundings of points are in the image as well, or always if `margins` is (True,). UsageError
    if the target is too large to be seen from any distance.
    """
    wish = fields[0].wish
    for index, numbers in enumerate(qmc.Halton(6, scramble=True, seed=wish.seed).random(wish.of * wish.count)):
        candidates = (
            _pose(fields, index % len(fields), numbers, retreat, needs_margin=needs_margin)
            for needs_margin, retreat in itertools.product(margins, _RETREATS)
        )
        pose = next(filter(None, candidates), None)
        if pose is None:
            raise _too_large(fields[0])
        yield pose


def _too_large(field: CameraField) -> UsageError:
    """The error about a target that no pose shows well enough."""
    near, far = field.depth_mm
    finding = f"no place between {near:.6g} and {far:.6g} mm before the camera"
    if near >= far:
        finding = f"it fits into the image from {near:.6g} mm on but is sharp up to {far:.6g} mm only: no place"
    smaller = "" if field.wish.fit else "take a smaller target, --fit to scale it, "
    hint = f"{smaller}allow more blur with --blur, or ask for a smaller share of its points with --seen"
    message = f"the target reaches {field.radius_mm:.4g} mm from its middle, and {finding} shows enough of it"
    return UsageError(message, hint=hint)


def _pose(
    fields: Sequence[CameraField],
    index: int,
    numbers: np.ndarray,
    retreat: tuple[float, float, float],
    *,
    needs_margin: bool,
) -> BoardPose | None:
    """The pose drawn by six numbers in [0, 1) in the image of camera `index`, after a retreat of `_RETREATS`.

    The numbers are the position of the target's middle across and down the image, its depth, the angle of its tilt, the
    direction of the tilt's axis, and a turn about the target's normal. `needs_margin`: only points whose surroundings
    lie in the image count. None if a camera sees too little of the target, or not sharply.
    """
    field = fields[index]
    across, down, deep, tilted, axis_share, turned = numbers
    kept_offset, kept_tilt, towards_far = retreat
    near, far = field.depth_mm
    middle = field.middle_px
    # Between three quarters of the largest tilt and all of it: steep tilts tell the principal distance from the
    # distance of the target.
    tilt = kept_tilt * (3 + tilted) / 4 * math.radians(min(field.steepest_deg, field.wish.most_tilt_deg))
    # The depth is drawn where the tilted target stays sharp from its nearest to its farthest point; the steepest tilt
    # of a field leaves some of its depth for that.
    reach = field.radius_mm * math.sin(tilt)
    z = near + reach + (deep + towards_far * (1 - deep)) * (far - near - 2 * reach)
    drawn_px = middle + kept_offset * (2 * np.array([across, down]) - 1) * (middle + 0.5)
    centre, axes = field.object_point(drawn_px, z)
    if len(fields) > 1:  # what is not kept of the offset leads to the middle of the common field
        middles = [
            apply(field.vision_from_first @ inverse(other.vision_from_first), other.object_point(other.middle_px, z)[0])
            for other in fields
        ]
        centre[:2] += (1 - kept_offset) * (np.mean(middles, axis=0) - field.object_point(middle, z)[0])[:2]
    if np.isnan(centre).any() or far <= near:
        return None
    tilt_axis = np.array([math.cos(2 * math.pi * axis_share), math.sin(2 * math.pi * axis_share), 0.0])
    turn = Rotation.from_rotvec(tilt * tilt_axis) * Rotation.from_euler("z", 30 * (2 * turned - 1), degrees=True)
    pose = np.eye(4)
    # A target that faces the camera has its y and z axes opposite to those of vision.
    pose[:3, :3] = axes @ turn.as_matrix() @ np.diag([1, -1, -1])
    pose[:3, 3] = centre
    pose = inverse(field.vision_from_first) @ pose
    # All cameras have to see enough, first by interpolated positions, which are cheap, then by traced ones.
    positions = list[np.ndarray]()
    for positions_of, other in itertools.product((CameraField.roughly_px, CameraField.seen_px), fields):
        vision_from_target = other.vision_from_first @ pose
        away_mm = other.away_mm(vision_from_target[:3, 3])
        seen_px = positions_of(other, vision_from_target)
        positions.append(seen_px)
        counts = other.has_margin(seen_px, away_mm) if needs_margin else np.isfinite(seen_px[:, 0])
        is_sharp = other is field or other.depth_mm[0] <= away_mm <= other.depth_mm[1]
        if not is_sharp or counts.sum() < max(1, other.wish.least_seen * len(counts)):
            return None
    return BoardPose(
        vision_from_target=pose,
        away_mm=fields[0].away_mm(pose[:3, 3]),
        tilt_deg=math.degrees(tilt),
        seen_px=np.array(positions[len(fields) :]),
    )
