"""Radiance of a lit scene along rays of the camera, by paths that are traced from there to the lamps.

Embree names the triangle that a ray meets, for whole batches; everything else is computed in double precision. The
artwork of targets is evaluated by its formula at the exact hit, as in scenes without lamps.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, TypeVar

import numpy as np

from pipeline.camera.parts.spectrum import Slices
from pipeline.camera.tracer import SEED_STEP
from pipeline.camera.tracing.records import Leaving
from pipeline.plugins.scenes.lighting import draws, shapes
from pipeline.plugins.scenes.lighting import path_kernels as kernels
from pipeline.plugins.scenes.lighting.draws import Names
from pipeline.plugins.scenes.lighting.emitting import emitting_of
from pipeline.plugins.scenes.lighting.glass_kernels import cross
from pipeline.plugins.scenes.lighting.lamps import TOUCHING, Lamps, lamps_of
from pipeline.plugins.scenes.lighting.materials import INDEX, SOLID, THRESHOLD, VEIL, Materials, MaterialTable
from pipeline.plugins.scenes.lighting.paths import Hits, Paths, Shadows
from pipeline.plugins.scenes.lighting.records import Finish, Lighting
from pipeline.plugins.scenes.lighting.reflection import Layers, tabled_layers
from pipeline.plugins.scenes.lighting.shading_kernels import shade
from pipeline.plugins.scenes.lighting.skies import sky_of
from pipeline.records.plain import from_plain
from pipeline.records.shapes import Bool, Float64, Int64, Num
from pipeline.render.footprints import Footprints
from pipeline.render.glow import PatchLight, add_values, inked
from pipeline.render.pixel_rays import PixelRays
from pipeline.render.spectral.prints import Colours
from pipeline.render.surroundings import MeshScene
from pipeline.targets.mesh import Occluder
from pipeline.targets.target import AnyTarget

_GAP_MM, _GAP = 1e-3, 2e-7
"""Least gap between a surface and the rays that leave it [mm], and the same as a part of the largest coordinate [1]:
Embree's single precision moves corners by 6e-8 of that.
"""
_Passes = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int], None]
"""Writes the paths to the triangles that rays pass: of triangles, rows of these rays, starts, paths and the layer."""
_Arrays = TypeVar("_Arrays", Leaving, Names, Paths, Hits, Shadows)


@dataclass(frozen=True)
class LitView:
    """Targets, occluders and lamps before a camera: a `render.imaging.SceneView`."""

    is_sampled: ClassVar[bool] = True

    targets: Sequence[tuple[AnyTarget, np.ndarray]]
    occluders: Sequence[tuple[Occluder, np.ndarray]]
    lighting: Lighting
    pictures: Mapping[str, Num[np.ndarray, "h w c"]]  # (h, w, 4) pictures of materials and domes, by name
    background: float  # radiance that the camera sees where there is nothing, if no dome is there
    lights: tuple[Slices, ...]  # light of each wavelength of the image, in the order of `Rig.in_each_light`
    colours: Sequence[Colours] = ()  # colours of each target; empty: all of them are neutral
    like: "LitView | None" = None  # a view in another light, whose triangles are those of this one

    def in_light(self, number: int) -> "LitScene":
        """The view at one of its wavelengths."""
        return LitScene(self, number)

    @cached_property
    def surfaces(self) -> "_Surfaces":
        """Triangles, materials and their tree, which are the same at all wavelengths."""
        if self.like is not None:
            return self.like.surfaces
        table = MaterialTable(self.pictures)
        pieces = list[shapes.Shapes]()
        for (target, pose), coat in zip(self.targets, self.lighting.coats, strict=True):
            row = table.add_coat(coat)
            for patch in target.patches():
                pieces.append(shapes.of_patch(patch, pose @ patch.target_from_patch, row))
        for (occluder, pose), plain in zip(self.occluders, self.lighting.finishes, strict=True):
            finish = from_plain(Finish, plain)
            columns = shapes.columns_of(finish)
            is_body = any(material.glass for material in finish.materials) and occluder.is_closed()
            rows = [table.add(material, occluder.radiance, columns, is_body) for material in finish.materials]
            piece = shapes.of_mesh(occluder, pose, finish, rows)
            pieces.append(shapes.outward(piece) if is_body else piece)
        return _Surfaces(table, shapes.joined(pieces), MeshScene([piece.corners for piece in pieces]))


class _Surfaces(NamedTuple):
    """Materials, triangles, and the same for Embree, patch by patch and mesh by mesh."""

    table: MaterialTable
    shapes: shapes.Shapes
    embree: MeshScene


class _Tint(NamedTuple):
    """Artwork of the patches of targets, materials and lamps, which differ between slices of a light."""

    art: list[PatchLight]
    materials: Materials
    lamps: Lamps


class LitScene:
    """A view at one wavelength of the image, by its number; each ray samples one slice of the light there."""

    def __init__(self, view: LitView, number: int) -> None:
        from pipeline.render.spectral.spectra import weights_of_rgb  # colour-science takes longer than most tasks

        self._light = number, len(view.lights)
        lighting = view.lighting
        table, self._shapes, self._embree = view.surfaces
        corners = self._shapes.corners.reshape(-1, 3)
        weights = np.array([weights_of_rgb(light) for light in view.lights[number]])
        sky = sky_of(lighting.lamps, view.pictures, weights.mean(axis=0))
        self._tints = list[_Tint]()
        emitting = emitting_of(lighting.lamps, view.pictures)
        for k, rgb_weights in enumerate(weights):
            materials = table.arrays(rgb_weights, view.lights[number][k])
            art = list[PatchLight]()
            for target, pose in inked(view.targets, view.colours, number, slice(k, k + 1)):
                art += [PatchLight(patch, pose @ patch.target_from_patch) for patch in target.patches()]
            glow = shapes.glow_of(self._shapes, materials)
            lamps = lamps_of(lighting.lamps, sky, emitting, rgb_weights, glow, view.background)
            self._tints.append(_Tint(art, materials, lamps))
        flags = self._tints[0].materials.flags
        self._lets_pass = bool(((flags[:, THRESHOLD] > 0) | (flags[:, VEIL] != SOLID)).any())
        self._has_glass = bool((flags[:, INDEX] > 0).any())
        self._gap_mm = max(_GAP_MM, _GAP * float(np.abs(corners).max(initial=0.0)))
        self._scene = tabled_layers(), draws.points(), self._gap_mm
        self._bounces = lighting.bounces

    def uniform(self, sight: Footprints) -> np.ndarray:
        """NaN for each pixel, (2, n): no pixel of a lit scene is of one colour for certain."""
        return sight.undecided()

    def add(
        self,
        of_pixels: PixelRays,
        pixels: Int64[np.ndarray, "n"],
        wanted: Bool[np.ndarray, "m"],
        image: Float64[np.ndarray, "m"],
    ) -> None:
        """Add the light of rays to their pixels, as `glow.TargetLight.add`."""
        is_traced = wanted[pixels]
        rays = _selected(of_pixels.leaving, is_traced)
        names = _selected(self._names(of_pixels), is_traced)
        light = self.radiance(rays.origin, rays.direction, names)
        add_values(rays.share, light, pixels if is_traced.all() else pixels[is_traced], image)

    def radiance(
        self, origin_mm: Float64[np.ndarray, "n 3"], direction: Float64[np.ndarray, "n 3"], names: Names
    ) -> np.ndarray:
        """Radiance that arrives along each ray, (n,)."""
        light = np.empty(len(origin_mm))
        slices = np.empty(len(origin_mm), np.int64)
        draws.choose_slices(draws.points(), *names, len(self._tints), slices)
        # Rows of the rays of each slice
        rows = np.argsort(slices, kind="stable")
        ends = np.cumsum(np.bincount(slices, minlength=len(self._tints)))
        for tint, rays in zip(self._tints, np.split(rows, ends[:-1]), strict=True):
            light[rays] = self._traced(tint, _from_camera(origin_mm, direction, names, rays))
        return light

    def _traced(self, tint: _Tint, paths: Paths) -> np.ndarray:
        """Light of paths from the camera in a slice, (n,)."""
        count = len(paths.power)
        lamps = tint.lamps
        light, all_hits, all_shadows = np.zeros(count), _no_hits(count), _no_shadows(count)
        for vertex in range(self._bounces + 2):
            if vertex > self._bounces and lamps.glow.estimate == 0.0:
                # After the last surface only paths count that meet a lamp unless something is in their way.
                paths = _first_of(paths, kernels.reach_lamps(lamps, paths))
            if not len(paths.power):
                break
            # Where paths meet surfaces, and the light before that.
            hits = _first_of(all_hits, len(paths.power))
            self._meet(tint, vertex, paths, hits)
            kernels.gather(lamps, paths, hits, light)
            if self._has_glass:
                self._cross_glass(tint, vertex, paths, hits, light)
            if vertex > self._bounces:
                break
            # Shadow rays, and the next directions.
            rays, going_on = shade(lamps, self._scene, vertex, paths, hits, all_shadows)
            self._add_direct_light(tint, _first_of(all_shadows, rays), light)
            paths = _first_of(paths, going_on)
        return light

    def _cross_glass(self, tint: _Tint, vertex: int, paths: Paths, hits: Hits, light: np.ndarray) -> None:
        """Follow paths through smooth glass; paths and hits are replaced by those behind it."""
        for crossing in range(draws.CROSSINGS + 1):
            rows = np.flatnonzero(hits.is_smooth_glass)
            if not len(rows):
                return
            if crossing == draws.CROSSINGS:
                hits.distance[rows] = np.inf
                return
            crossed = Paths(*(values[rows] for values in paths))
            faces = Hits(*(values[rows] for values in hits))
            cross(self._scene, draws.crossing_stage(vertex, crossing), crossed, faces)
            next_hits = _no_hits(len(rows))
            self._meet(tint, vertex, crossed, next_hits, crossing + 1)
            kernels.gather(tint.lamps, crossed, next_hits, light)
            for values, behind in (*zip(paths, crossed, strict=True), *zip(hits, next_hits, strict=True)):
                values[rows] = behind

    def _names(self, rays: PixelRays) -> Names:
        """Keys and ranks of the random numbers of rays."""
        owner = np.ascontiguousarray(rays.leaving.owner)
        names = Names(np.empty(len(owner), np.uint32), np.empty(len(owner), np.int64))
        # Each wavelength has a seed of its own, by this step; paths of all of them share one.
        seed = np.uint32((rays.seed - self._light[0] * SEED_STEP) & 0xFFFFFFFF)
        draws.name_rays(seed, self._light, rays.squares, owner, *names)
        return names

    def _add_direct_light(self, tint: _Tint, shadows: Shadows, light: np.ndarray) -> None:
        """Add direct light: that of shadow rays which reach their lamps."""
        length = shadows.end * (1.0 - TOUCHING) - self._gap_mm

        def dimmed(triangle: np.ndarray, rays: np.ndarray, start: np.ndarray, past: np.ndarray, layer: int) -> None:
            """Multiply the light of rays by what their triangles let pass."""
            direction = shadows.direction[rays]
            left = length[rays] - np.sum((start - shadows.origin[rays]) * direction, axis=1)
            light_left = shadows.light[rays]
            straight = shadows.straight[rays]
            shapes.dim(self._surfaces(tint), triangle, start, direction, straight, left, light_left, past)
            shadows.light[rays] = light_left

        triangle = self._first_triangle(shadows.origin, shadows.direction, dimmed)
        kernels.arrive(self._shapes.corners, triangle, shadows, self._gap_mm, light)

    def first_seen(self, of_pixels: PixelRays) -> np.ndarray:
        """First triangle that each ray of the camera does not pass, (n,), of targets, then of occluders; -1: none."""
        rays = of_pixels.leaving
        passes = self._by_chance(self._tints[0], (0, 0), self._names(of_pixels), rays.direction)
        return self._first_triangle(rays.origin, rays.direction, passes)

    def _by_chance(self, tint: _Tint, numbers: tuple[int, int], names: Names, direction: np.ndarray) -> _Passes:
        """Surfaces let rays pass by chance. `numbers`: of the next vertex, and of faces of glass before it."""

        def passes(triangle: np.ndarray, rays: np.ndarray, start: np.ndarray, past: np.ndarray, layer: int) -> None:
            dice = draws.points(), names.key[rays], names.rank[rays], draws.passing_stage(*numbers, layer)
            shapes.pass_by_chance(self._surfaces(tint), dice, triangle, start, direction[rays], past)

        return passes

    def _meet(self, tint: _Tint, vertex: int, paths: Paths, hits: Hits, crossing: int = 0) -> None:
        """Write the hits of paths."""
        passes = self._by_chance(tint, (vertex, crossing), Names(paths.key, paths.rank), paths.direction)
        triangle = self._first_triangle(paths.origin, paths.direction, passes)
        hits.triangle[:] = triangle
        albedo = np.full(len(paths.power), np.nan)
        starts = self._embree.first_triangle
        for art, first, end in zip(tint.art, starts, starts[1:], strict=False):
            on_art = (triangle >= first) & (triangle < end)
            if on_art.any():
                albedo[on_art] = 0.0
                art.shine(np.where(on_art, triangle - first, -1), paths.origin, paths.direction, albedo)
        kernels.meet(self._shapes, tint.materials, tabled_layers(), albedo, paths, hits)

    def _surfaces(self, tint: _Tint) -> tuple[shapes.Shapes, Materials, Layers]:
        """Triangles, materials and tables of layers, as kernels take them."""
        return self._shapes, tint.materials, tabled_layers()

    def _first_triangle(self, origin: np.ndarray, direction: np.ndarray, passes: _Passes) -> np.ndarray:
        """First triangle of each ray that it does not pass, (n,) int64; -1: none."""
        triangle = self._embree.first_hit(origin, direction).astype(np.int64)
        if not self._lets_pass:
            return triangle
        left = np.arange(len(triangle))  # rays that have passed all triangles so far
        start = origin
        for layer in range(draws.LAYERS):
            past = np.empty(len(left))
            passes(triangle[left], left, start, past, layer)
            through = np.flatnonzero(np.isfinite(past))
            if not len(through):
                break
            left = left[through]
            start = start[through] + (past[through] + self._gap_mm)[:, None] * direction[left]
            triangle[left] = self._embree.first_hit(start, direction[left])
        return triangle


def _selected(arrays: _Arrays, chosen: np.ndarray) -> _Arrays:
    """The chosen rows of arrays, contiguous."""
    if chosen.all():
        return type(arrays)(*(np.ascontiguousarray(values) for values in arrays))
    rows = np.flatnonzero(chosen)
    return type(arrays)(*(values.take(rows, axis=0) for values in arrays))


def _first_of(arrays: _Arrays, count: int) -> _Arrays:
    """The first rows of arrays."""
    return type(arrays)(*(values[:count] for values in arrays))


def _from_camera(origin: np.ndarray, direction: np.ndarray, names: Names, rows: np.ndarray) -> Paths:
    """Rays of the camera, by their rows, as the beginnings of paths."""
    count = len(rows)
    from_none = np.zeros(count), np.zeros((count, 3)), np.zeros(count), np.zeros(count)
    rays = origin.take(rows, axis=0), direction.take(rows, axis=0), np.ones(count)
    return Paths(*rays, *from_none, names.key.take(rows), names.rank.take(rows), np.arange(count))


def _no_hits(count: int) -> Hits:
    """Empty arrays for the hits of `count` paths."""
    (point, flat, normal), (distance, emission, beyond) = np.empty((3, count, 3)), np.empty((3, count))
    return Hits(distance, np.empty(count, np.int64), point, flat, normal, np.empty((count, 6)), emission, beyond)


def _no_shadows(count: int) -> Shadows:
    """Empty arrays for a shadow ray from each of `count` surfaces."""
    (origin, direction), (end, light) = np.empty((2, count, 3)), np.empty((2, count))
    return Shadows(origin, direction, end, light, np.empty(count, bool), np.empty(count, np.int64))
