"""Radiance of the scene along rays: targets and occluders in front of a uniform background.

For a few flat sheets the first one that a ray meets is computed in double precision. In other scenes, rays that meet
a box around any object ask Embree for the first triangle, and the hit is computed again in double precision on the
true surface. The pattern is evaluated there by its formula, without texture or filter. Vision frame, mm.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.camera.tracing.records import Leaving
from pipeline.frames import apply
from pipeline.jit.decorators import kernel
from pipeline.records.shapes import Bool, Float64, Int64
from pipeline.render.footprints import TOUCHING_MM, Footprints
from pipeline.render.pixel_rays import PixelRays
from pipeline.render.spectral.prints import Colours
from pipeline.render.surroundings import MeshScene, in_vision
from pipeline.targets import surface_kernels as kernels
from pipeline.targets.drawing import check_colour, only_checks, whiteness
from pipeline.targets.mesh import Occluder
from pipeline.targets.surface_kernels import on_plane
from pipeline.targets.surfaces import CYLINDER, MESH, PLANE, Patch
from pipeline.targets.target import AnyTarget, Target
from pipeline.targets.vectors import row


@kernel
def may_meet(boxes, origin, direction, near):
    """Whether rays meet any axis-aligned box in front of their start, by the slabs between opposite faces.

    `boxes`, (k, 2, 3) float64: lowest and highest corner.
    `near`, (n,) bool: written; true also where a ray holds NaN.
    """
    for i in range(near.size):
        near[i] = False
        for k in range(boxes.shape[0]):
            enters = 0.0
            leaves = math.inf
            for axis in range(3):
                per_mm = 1.0 / direction[i, axis]
                a = (boxes[k, 0, axis] - origin[i, axis]) * per_mm
                b = (boxes[k, 1, axis] - origin[i, axis]) * per_mm
                enters, leaves = max(enters, min(a, b)), min(leaves, max(a, b))
            if not leaves < enters:
                near[i] = True


@kernel
def first_sheet(poses, half_sizes, origin, direction, first):
    """Nearest sheet in front of the start of each ray, in double precision.

    `poses`, (k, 4, 4) float64: vision_from_sheet; a sheet lies in z = 0 about the origin.
    `half_sizes`, (k, 2) float64: along x and y.
    `first`, (n,) int64: written; -1 where the ray meets none or holds NaN.
    """
    for i in range(first.size):
        nearest, first[i] = 0.0, -1
        for k in range(half_sizes.shape[0]):
            t, x, y, _ = on_plane(poses[k], row(origin, i), row(direction, i))
            is_nearer = t > 0.0 and (first[i] < 0 or t < nearest)
            if is_nearer and abs(x) <= half_sizes[k, 0] and abs(y) <= half_sizes[k, 1]:
                nearest, first[i] = t, k


@kernel
def add_light(artwork, background, rays, pixels, wanted, image):
    """Add the light of rays to an image, ray by ray, if the scene is a flat patch before a background.

    `rays`, `pixels`, camera.records.Leaving, (n,) int64: rays, and the pixel of each.
    `wanted`, `image`, (m,) bool, (m,) float64: pixels that are added to, and their sums.
    """
    # Plain numbers stay in registers; the arrays of a drawing would be passed on for every ray.
    drawing, colours, pose = artwork
    origin, direction, share, _ = rays
    half_x = drawing.half_x
    half_y = drawing.half_y
    black = colours[0]
    white = colours[1]
    is_checks, columns, rows, square = only_checks(drawing)
    for i in range(pixels.size):
        if not wanted[pixels[i]]:
            continue
        t, x, y, towards = on_plane(pose, row(origin, i), row(direction, i))
        if not (t > 0.0 and abs(x) <= half_x and abs(y) <= half_y):
            light = background
        elif towards >= 0.0:
            light = 0.0
        elif is_checks:
            light = black if check_colour(columns, rows, square, x, y) == 0.0 else white
        else:
            value = whiteness(drawing, x, y)
            light = black if value == 0.0 else white
        image[pixels[i]] += share[i] * light


@kernel
def add_values(share, light, pixels, image):
    """Add light (n,) of rays, times their shares (n,), to their pixels (n,), ray by ray."""
    for i in range(pixels.size):
        image[pixels[i]] += share[i] * light[i]


_FEW = 8
"""Most flat sheets that are tried one by one for every ray; beyond that Embree's tree is faster."""
Placed = Sequence[tuple[AnyTarget, np.ndarray]]
"""Targets with their poses vision_from_target."""


class PatchLight:
    """A patch of a target at a pose vision_from_patch, which shines like its artwork."""

    def __init__(self, patch: Patch, vision_from_patch: Float64[np.ndarray, "4 4"]) -> None:
        self._patch = patch
        self._pose = np.ascontiguousarray(vision_from_patch)
        self._triangles = np.ascontiguousarray(patch.mesh())
        self.artwork = kernels.Artwork(patch.drawing.arrays, np.array(patch.colours), self._pose)

    def mesh_in_vision(self) -> np.ndarray:
        """Triangles, vision frame."""
        return apply(self._pose, self._triangles.reshape(-1, 3)).reshape(-1, 3, 3)

    @property
    def is_flat(self) -> bool:
        """Whether the patch is plane."""
        return self._patch.kind == PLANE

    def shine(
        self,
        triangle: Int64[np.ndarray, "n"],
        origin: Float64[np.ndarray, "n 3"],
        direction: Float64[np.ndarray, "n 3"],
        light: Float64[np.ndarray, "n"],
    ) -> None:
        """Write the light of the rays whose first hit is a triangle of this patch; -1 marks all other rays."""
        kind = self._patch.kind
        if kind == PLANE:
            kernels.plane_light(self.artwork, triangle >= 0, origin, direction, light)
        elif kind == MESH:
            kernels.mesh_light(self._patch.albedo, self._triangles, self._pose, triangle, origin, direction, light)
        else:
            surface = kernels.Curved(kind == CYLINDER, self._patch.shape, self._triangles)
            kernels.curved_light(self.artwork, surface, triangle, origin, direction, light)


class TargetLight:
    """Targets that radiate like their artwork, equally in all directions from their front; their back is black.

    `occluders`: each with its pose vision_from_occluder; they radiate equally from both sides.
    """

    is_sampled: ClassVar[bool] = False

    def __init__(
        self,
        targets: Placed,
        background: float,
        occluders: Sequence[tuple[Occluder, np.ndarray]] = (),
    ) -> None:
        self._background = background
        patches = [(patch, pose @ patch.target_from_patch) for target, pose in targets for patch in target.patches()]
        self._lights = [PatchLight(patch, pose) for patch, pose in patches]
        self._occluder_radiance = [occluder.radiance for occluder, _ in occluders]
        self._flat = [(patch, pose) for patch, pose in patches if patch.kind == PLANE]
        meshes = [light.mesh_in_vision() for light in self._lights]
        occluder_meshes = [in_vision(occluder, pose) for occluder, pose in occluders]
        curved = [mesh for mesh, light in zip(meshes, self._lights, strict=True) if not light.is_flat]
        self._solids = [mesh.reshape(-1, 3) for mesh in [*curved, *occluder_meshes]]
        boxes = [(points.min(axis=0) - TOUCHING_MM, points.max(axis=0) + TOUCHING_MM) for points in self._solids]
        self._boxes = np.array(boxes).reshape(-1, 2, 3)
        halves = [(patch.drawing.half_x_mm, patch.drawing.half_y_mm) for patch, _ in self._flat]
        poses = np.array([pose for _, pose in self._flat]).reshape(-1, 4, 4)
        self._sheets = (poses, np.array(halves).reshape(-1, 2)) if len(self._flat) <= _FEW else None
        if len(self._boxes) or self._sheets is None:
            self._scene = MeshScene([*meshes, *occluder_meshes])

    def in_light(self, number: int) -> "TargetLight":
        """This light, whatever the wavelength: nothing here has a colour."""
        return self

    def uniform(self, sight: Footprints) -> np.ndarray:
        """Radiance in pixels, (2, n), NaN unless certainly of one colour: see `Footprints.uniform_light`."""
        return sight.uniform_light(self._flat, self._solids, self._background)

    def add(
        self,
        of_pixels: PixelRays,
        pixels: Int64[np.ndarray, "n"],
        wanted: Bool[np.ndarray, "m"],
        image: Float64[np.ndarray, "m"],
    ) -> None:
        """Add the light of rays to their pixels (n,) of an image, where these are wanted.

        `wanted`, `image`: selected pixels, and the image, by pixel.
        """
        rays = of_pixels.leaving
        if self._is_one_sheet:
            add_light(self._lights[0].artwork, self._background, rays, pixels, wanted, image)
            return
        chosen = np.flatnonzero(wanted[pixels])
        if len(chosen) < len(pixels):
            rays = Leaving(*(values[chosen] for values in rays))
            pixels = pixels[chosen]
        add_values(rays.share, self.radiance(rays.origin, rays.direction), pixels, image)

    def radiance(self, origin_mm: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"]) -> np.ndarray:
        """Radiance that arrives along each ray, (n,); origins and directions (n, 3), vision frame."""
        light = np.full(len(origin_mm), self._background)
        if self._sheets is None:
            self._by_embree(origin_mm, direction, light)
            return light
        # The choice depends on the ray alone, never on other rays of the call.
        near = np.zeros(len(light), bool)
        may_meet(self._boxes, origin_mm, direction, near)
        if near.size and near.all():
            self._by_embree(origin_mm, direction, light)
            return light
        self._by_sheets(origin_mm, direction, light)  # of all rays, because most are not near, and copies cost more
        chosen = np.flatnonzero(near)
        if len(chosen):
            light_of_chosen = np.full(len(chosen), self._background)
            self._by_embree(origin_mm[chosen], direction[chosen], light_of_chosen)
            light[chosen] = light_of_chosen
        return light

    @property
    def _is_one_sheet(self) -> bool:
        return self._sheets is not None and len(self._lights) == 1 and not len(self._boxes)

    def _by_sheets(self, origin: np.ndarray, direction: np.ndarray, light: np.ndarray) -> None:
        """Write the light of flat sheets, ignoring everything else."""
        assert self._sheets is not None
        first = np.empty(len(light), np.int64)
        first_sheet(*self._sheets, origin, direction, first)
        for k, patch in enumerate(light_of for light_of in self._lights if light_of.is_flat):
            patch.shine(np.where(first == k, 0, -1), origin, direction, light)

    def _by_embree(self, origin: np.ndarray, direction: np.ndarray, light: np.ndarray) -> None:
        """Write the light of everything in the scene."""
        hit = self._scene.first_hit(origin, direction)
        starts = self._scene.first_triangle
        for patch, first, end in zip(self._lights, starts, starts[1:], strict=False):
            patch.shine(np.where((hit >= first) & (hit < end), hit - first, -1), origin, direction, light)
        starts = starts[len(self._lights) :]
        for radiance, first, end in zip(self._occluder_radiance, starts, starts[1:], strict=False):
            light[(hit >= first) & (hit < end)] = radiance


def inked(targets: Placed, colours: Sequence[Colours], number: int, slices: slice = slice(None)) -> Placed:
    """Targets at a wavelength of an image, averaged over some of its slices; unchanged if no colours are given."""
    inked_targets: list[tuple[AnyTarget, np.ndarray]] = []
    for (target, pose), light in zip(targets, colours or [()] * len(targets), strict=True):
        if light and isinstance(target, Target):
            black, white = np.mean(light[number][slices], axis=0).tolist()
            target = Target(dataclasses.replace(target.pattern, black=black, white=white), target.surface)
        inked_targets.append((target, pose))
    return inked_targets


@dataclass(frozen=True, slots=True)
class GlowingView:
    """Targets with coloured ink or paper that glow evenly, without lamps."""

    is_sampled: ClassVar[bool] = False

    targets: Placed
    background: float
    occluders: Sequence[tuple[Occluder, np.ndarray]]
    colours: Sequence[Colours]

    def in_light(self, number: int) -> TargetLight:
        """The view at one of its wavelengths."""
        return TargetLight(inked(self.targets, self.colours, number), self.background, self.occluders)
