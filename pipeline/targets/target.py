"""A calibration target: a pattern on a surface, or a mesh with marked points."""

import dataclasses
import reprlib
from dataclasses import dataclass, field

import numpy as np

from pipeline.frames import apply
from pipeline.records.plain import Json, from_plain, to_plain
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.patterns import checkerboard, circles, lines, stars, tags
from pipeline.targets.patterns.pattern import Pattern, TargetError
from pipeline.targets.points import TargetPoints, frames_at
from pipeline.targets.surfaces import PLANE, Cube, Cylinder, Flat, HeightMap, Patch, Stairs, Surface, Warped

PATTERNS: dict[str, type[Pattern]] = {
    kind.KIND: kind
    for module in (checkerboard, circles, lines, stars, tags)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, Pattern) and kind is not Pattern
}
"""All patterns of these modules by their kind."""
SURFACES: dict[str, type] = {kind.KIND: kind for kind in (Flat, Warped, HeightMap, Cylinder, Cube, Stairs)}


@dataclass(frozen=True, slots=True)
class Target:
    """A pattern on a surface. Target frame: x right, y up, z towards the viewer.

    Raises TargetError: the pattern does not fit on the surface.
    """

    pattern: Pattern
    surface: Surface = field(default_factory=Flat)

    def __post_init__(self) -> None:
        for name, value, kinds in (("pattern", self.pattern, PATTERNS), ("surface", self.surface, SURFACES)):
            if not isinstance(value, tuple(kinds.values())):
                names = ", ".join(kind.__name__ for kind in kinds.values())
                raise TargetError(f"Target: {name} is {reprlib.repr(value)}", hint=f"it has to be one of: {names}")
        self.surface.patches(self.pattern)

    @property
    def kind(self) -> str:
        return self.pattern.KIND

    def patches(self) -> list[Patch]:
        return [patch for patch, _ in self.surface.patches(self.pattern)]

    def points(self) -> TargetPoints:
        """All points, patch by patch."""
        pieces = [(patch, pattern) for patch, pattern in self.surface.patches(self.pattern) if pattern]
        return TargetPoints.joined([_points_on(patch, pattern) for patch, pattern in pieces])


AnyTarget = Target | MeshTarget


def _points_on(patch: Patch, pattern: Pattern) -> TargetPoints:
    """Points of a pattern on its patch, target frame; those of a plane share one tangent plane."""
    marks = pattern.marks()
    n = len(marks.xy_mm)
    points, axes_in_patch, curvature = patch.surface_at(marks.xy_mm)
    is_flat = patch.kind == PLANE
    position = apply(patch.target_from_patch, points)
    axes = patch.target_from_patch[:3, :3] @ axes_in_patch
    # The nominal shape of a cylinder is the cylinder; that of a board with a height map is flat.
    nominal = np.pad(marks.xy_mm, ((0, 0), (0, 1))) if patch.kind == "heights" else position
    return TargetPoints(
        position_mm=position,
        nominal_mm=nominal,
        axes=axes,
        curvature_per_mm=curvature,
        kinds=marks.kinds,
        radius_mm=marks.radius_mm,
        plane=np.zeros(n, int) if is_flat else np.arange(n),
        frames=patch.target_from_patch[None] if is_flat else frames_at(position, axes),
    )


def bare(target: AnyTarget) -> AnyTarget:
    """The shape, drawing and points of a target with radiance 1 for white and 0 for black; a mesh is 1 everywhere."""
    if isinstance(target, MeshTarget):
        return dataclasses.replace(target, albedo=((1.0, 1.0, 1.0),) * len(target.triangles))
    return Target(dataclasses.replace(target.pattern, white=1.0, black=0.0), target.surface)


def plain_from_target(target: AnyTarget) -> Json:
    """A target as plain values, with its kind."""
    if isinstance(target, MeshTarget):
        return {"kind": target.KIND, "mesh": to_plain(target)}
    return {
        "kind": target.kind,
        "pattern": to_plain(target.pattern),
        "surface": {"kind": target.surface.KIND, **to_plain(target.surface)},
    }


def target_from_plain(plain: Json) -> AnyTarget:
    """The target of `plain_from_target`."""
    if plain["kind"] == MeshTarget.KIND:
        return from_plain(MeshTarget, plain["mesh"])
    surface = dict(plain["surface"])
    kind = SURFACES[surface.pop("kind")]
    return Target(from_plain(PATTERNS[plain["kind"]], plain["pattern"]), from_plain(kind, surface))


@dataclass(frozen=True, slots=True, kw_only=True)
class Coat:
    """A smooth transparent coat on a target: its roughness, as UsdPreviewSurface has it, and its refractive index."""

    roughness: float
    ior: float = 1.5
