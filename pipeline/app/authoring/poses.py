"""Poses of a target that fill the field of view and the depth of field of a camera, by its real lens.

Where the middle of the target goes, how deep, how far and about which axis it is tilted come from one sequence of
Halton, so that few poses already spread over all of them. A pose that shows too little of the target is moved towards
the middle of the image, then tilted less, until it shows enough.
"""

import dataclasses
import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree
from scipy.stats import qmc

from pipeline.camera.figures.outlook import covered_mm
from pipeline.camera.focusing.depth_of_field import foci
from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.errors import UsageError
from pipeline.targets.target import AnyTarget
from pipeline.truth.direct.direct_rows import guesses, solve
from pipeline.truth.planes import tangent_planes

_FARTHEST = 3.0
"""Farthest distance of a target over that of the focus [1]: a depth of field may end at infinity."""
_TRIES = tuple((pull, lean) for lean in (1.0, 0.5, 0.0) for pull in np.linspace(1.0, 0.0, 9))
"""Ways from the middle of the image to the place that was drawn, and shares of the tilt that was drawn [1], in the
order in which they are tried: a pose gives up its place before its tilt."""
_ROUGH_PX = 0.05
"""Accuracy of image positions that only decide what is seen [px]."""
_LEAST_LIGHT = 0.2
"""Least share of the light on the axis with which a point counts as seen [1]: detectors fail in deep vignetting."""
_APART_MM = 10.0
"""Distance of a second plane that integrals want [mm]: it is not looked at."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """Demands on poses.

    Attributes
    ----------
    count : int
    seed : int
        Seed of the sequence; another one gives other poses of the same kind.
    most_tilt_deg : float
        Largest angle between the target and the image plane.
    least_seen : float
        Least share of the points of the target that a pose shows.
    blur_px : float
        Largest diameter of blur, by the paraxial depth of field.
    """

    count: int
    seed: int = 1
    most_tilt_deg: float = 40.0
    least_seen: float = 1.0
    blur_px: float = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """A place and a turn of a target, and what a camera sees of it.

    Attributes
    ----------
    vision_from_target : (4, 4) float64
    tilt_deg : float
    seen_px : (n, 2) float64
        Image positions of its points; NaN: not seen.
    """

    vision_from_target: np.ndarray
    tilt_deg: float
    seen_px: np.ndarray

    @property
    def seen(self) -> int:
        """Number of points that are seen."""
        return int(np.isfinite(self.seen_px[:, 0]).sum())


@dataclass(frozen=True)
class Field:
    """A camera's main lens before a target: image positions of poses, and places that have an image position.

    Microlenses are left out: they move a point by less than a micro-image.
    """

    camera: Camera
    target: AnyTarget

    @cached_property
    def rig(self) -> Rig:
        """The main lens alone."""
        return Rig.of(Tracer(dataclasses.replace(self.camera, microlenses=None)))

    @cached_property
    def radius_mm(self) -> float:
        """Distance of the farthest point from the middle of the target."""
        return float(np.linalg.norm(self.target.points().position_mm, axis=1).max())

    @property
    def middle_px(self) -> np.ndarray:
        """Middle of the image."""
        return (np.array([self.camera.sensor.width_px, self.camera.sensor.height_px]) - 1) / 2

    def depth_mm(self, blur_px: float) -> tuple[float, float]:
        """Nearest and farthest distance that blurs to that diameter at most, of any microlens type."""
        found = foci(dataclasses.replace(self.camera, circle_of_confusion_px=blur_px))
        near = min(focus.depth_of_field_mm[0] for focus in found)
        far = max(focus.depth_of_field_mm[1] for focus in found)
        farthest = _FARTHEST * max(focus.focus_distance_mm for focus in found)
        first = -self.camera.prescription.vertices_from_stop_mm[0]
        return max(near, first + 1.0), min(far, farthest) if math.isfinite(farthest) else min(far, 1e5)

    def place_mm(self, x_px: np.ndarray, z_mm: float) -> np.ndarray:
        """The point at a depth whose bundle's middle is an image position, (3,); NaN where nothing passes."""
        planes = parallel_planes(z_mm, z_mm + _APART_MM)[None]
        bundle = Bundles(x_px[None], np.array([NO_MICROLENS]), planes)
        return np.append(integrals(self.rig.tracer, bundle, 1).moments[0, :2], z_mm)

    @cached_property
    def around_mm(self) -> float:
        """Width of the surroundings that a detector needs of a point: half of the distance of its neighbours, so that
        discs and halves of squares are in the image as a whole, but no more than a quarter of a target of few points.
        A whole square would keep points away from the edge of the image, where distortion is largest.
        """
        points = self.target.points().position_mm
        nearest, _ = KDTree(points).query(points, k=[2])
        return min(float(np.median(nearest)), self.radius_mm) / 2

    def seen_px(self, vision_from_target: np.ndarray) -> np.ndarray:
        """Image positions of all points, (n, 2); NaN where one is not seen."""
        points = self.target.points()
        planes = tangent_planes(vision_from_target, points.position_mm, points.plane_axes)
        found = solve(self.rig, guesses(self.rig, planes)[0], planes, _ROUGH_PX, _LEAST_LIGHT).found
        seen = np.full((len(planes), 2), np.nan)
        seen[found.point] = np.stack([found.x_px, found.y_px], axis=1)
        return seen

    def has_room(self, seen_px: np.ndarray, z_mm: float) -> np.ndarray:
        """Whether what is around points of a target at vision z is in the image as well, (n,) bool."""
        shown_mm, _ = covered_mm(self.camera, z_mm)
        room_px = self.around_mm * self.camera.sensor.width_px / shown_mm
        inside: np.ndarray = np.all(np.abs(seen_px - self.middle_px) <= self.middle_px + 0.5 - room_px, axis=1)
        return inside


def poses_that_fill(camera: Camera, target: AnyTarget, wish: Wish) -> list[Pose]:
    """Poses all over the image and the depth of field, each with the points that are seen.

    Raises
    ------
    UsageError
        The target is too large to be seen, wherever it stands.
    """
    field = Field(camera, target)
    near_mm, far_mm = field.depth_mm(wish.blur_px)
    poses = []
    for numbers in qmc.Halton(6, scramble=True, seed=wish.seed).random(wish.count):
        ways = itertools.product((True, False), _TRIES)  # with room around the points if any way leaves some
        tries = (_tried(field, wish, numbers, (*way, roomy), (near_mm, far_mm)) for roomy, way in ways)
        pose = next(filter(None, tries), None)
        if pose is None:
            what = (
                f"the target reaches {field.radius_mm:.4g} mm from its middle, and no place between {near_mm:.6g} and"
            )
            hint = "take a smaller target, --fit to scale it, or a smaller share of its points with --seen"
            raise UsageError(f"{what} {far_mm:.6g} mm before the camera shows enough of it", hint=hint)
        poses.append(pose)
    return poses


def _tried(
    field: Field, wish: Wish, numbers: np.ndarray, way: tuple[float, float, bool], depth_mm: tuple[float, float]
) -> Pose | None:
    """The pose of six numbers in [0, 1), by one of `_TRIES` and with or without room around points; None where it shows
    too little.
    """
    across, down, deep, tilted, about, turned = numbers
    (pull, lean, roomy), (near, far), middle = way, depth_mm, field.middle_px
    steepest = math.asin(min(1.0, 0.4 * (far - near) / field.radius_mm))
    # The root favours steep tilts: they tell the principal distance from the distance of the target.
    tilt = lean * math.sqrt(tilted) * min(steepest, math.radians(wish.most_tilt_deg))
    reach = field.radius_mm * math.sin(tilt)
    z = near + reach + deep * (far - near - 2 * reach)
    centre = field.place_mm(middle + pull * (2 * np.array([across, down]) - 1) * (middle + 0.5), z)
    if np.isnan(centre).any():
        return None
    pose = np.eye(4)
    # A target that faces the camera has its y and z axes opposite to those of vision.
    pose[:3, :3] = _turn(2 * math.pi * about, tilt) @ _roll(math.radians(30) * (2 * turned - 1)) @ np.diag([1, -1, -1])
    pose[:3, 3] = centre
    found = Pose(vision_from_target=pose, tilt_deg=math.degrees(tilt), seen_px=field.seen_px(pose))
    shown = int(field.has_room(found.seen_px, z).sum()) if roomy else found.seen
    return found if shown >= max(1, wish.least_seen * len(found.seen_px)) else None


def _turn(about: float, angle: float) -> np.ndarray:
    """Rotation by an angle about an axis of the image plane, itself at the angle `about` from x, (3, 3)."""
    roll = _roll(about)
    cos, sin = math.cos(angle), math.sin(angle)
    return roll @ np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) @ roll.T


def _roll(angle: float) -> np.ndarray:
    """Rotation about z, (3, 3)."""
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
