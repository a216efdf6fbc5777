"""Surfaces that carry a pattern: one sheet, flat or bent, or several, as on a cube and on stairs.

Target frame: origin at the centre of the pattern (of a cube: of the cube), x right, y up, z towards the viewer.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.frames import rigid
from pipeline.targets.drawing import Drawing
from pipeline.targets.patches import CYLINDER, HEIGHTS, PLANE, Kind, Patch
from pipeline.targets.patterns.pattern import Pattern, TargetError

Pieces = list[tuple[Patch, Pattern | None]]
"""Patches of a surface, each with the pattern on it; None for a blank one."""


def _alone(kind: Kind, pattern: Pattern, *shape: float) -> Pieces:
    colours = pattern.black, pattern.white
    return [(Patch(kind, np.eye(4), pattern.drawing, colours, np.array(shape, float)), pattern)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Flat:
    """The plane z = 0."""

    KIND: ClassVar[str] = "flat"

    def patches(self, pattern: Pattern) -> Pieces:
        return _alone(PLANE, pattern)


@dataclass(frozen=True, slots=True, kw_only=True)
class Warped:
    """A board bent like a bow: z = dx (1 - (x / half width)^2) + dy (1 - (y / half height)^2), of the whole sheet.

    The pattern keeps its x and y, as in mrcal. (A bent print keeps lengths along the surface instead; the total
    difference is 8/3 of the squared deflection over the width.)

    `deflection_mm`: dx and dy, positive if the middle stands out towards the viewer.
    """

    KIND: ClassVar[str] = "warped"

    deflection_mm: tuple[float, float]

    def patches(self, pattern: Pattern) -> Pieces:
        drawing = pattern.drawing
        return _alone(HEIGHTS, pattern, 0.0, 0.0, drawing.half_x_mm, drawing.half_y_mm, *self.deflection_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMap:
    """A measured board: heights on a grid over the whole sheet, its edges included, joined by Catmull-Rom cubics.

    The pattern keeps its x and y.

    `resolution`: number of heights along x and along y.
    `heights_mm`: z, rows from the top, each from the left.
    """

    KIND: ClassVar[str] = "height-map"

    resolution: tuple[int, int]
    heights_mm: tuple[float, ...]

    def __post_init__(self) -> None:
        across, down = self.resolution
        if min(across, down) < 2 or len(self.heights_mm) != across * down:
            raise TargetError(
                f"{len(self.heights_mm)} heights for a map of {across} x {down}",
                hint="rows from the top, each from the left; two at least in each direction",
                code="height-map",
            )

    def patches(self, pattern: Pattern) -> Pieces:
        drawing = pattern.drawing
        return _alone(HEIGHTS, pattern, *self.resolution, drawing.half_x_mm, drawing.half_y_mm, *self.heights_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder:
    """A sheet rolled about an upright axis without stretching; its middle touches the plane z = 0.

    `radius_mm`: positive: the pattern is on the outside, the axis behind it. Negative: a hollow, seen from inside.
    """

    KIND: ClassVar[str] = "cylinder"

    radius_mm: float

    def patches(self, pattern: Pattern) -> Pieces:
        width_mm = 2 * pattern.drawing.half_x_mm
        if width_mm > 2 * math.pi * abs(self.radius_mm):
            raise TargetError(
                f"the sheet is {width_mm:g} mm wide, and the cylinder"
                f" {2 * math.pi * abs(self.radius_mm):.6g} mm around",
                hint="enlarge the radius",
                code="cylinder-radius",
            )
        return _alone(CYLINDER, pattern, self.radius_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cube:
    """A cube with the pattern on every face; tag numbers go on from face to face. The origin is its centre.

    Faces: 0 front (+z), 1 right (+x), 2 top (+y), 3 left, 4 bottom, 5 back.

    `edge_mm`: the part of a face beyond the sheet of the pattern is white.
    """

    KIND: ClassVar[str] = "cube"
    _NORMALS_AND_UPS: ClassVar = (
        ((0, 0, 1), (0, 1, 0)),
        ((1, 0, 0), (0, 1, 0)),
        ((0, 1, 0), (0, 0, -1)),
        ((-1, 0, 0), (0, 1, 0)),
        ((0, -1, 0), (0, 0, 1)),
        ((0, 0, -1), (0, 1, 0)),
    )

    edge_mm: float

    def patches(self, pattern: Pattern) -> Pieces:
        """The six faces."""
        half = self.edge_mm / 2
        widest = max(pattern.drawing.half_x_mm, pattern.drawing.half_y_mm)
        if half < widest:
            raise TargetError(
                f"an edge of {self.edge_mm:g} mm is too short for a sheet of {2 * widest:g} mm",
                hint="enlarge the edge",
                code="cube-edge",
            )
        pieces: Pieces = []
        for number, (normal, up) in enumerate(self._NORMALS_AND_UPS):
            z, y = np.array(normal, float), np.array(up, float)
            pose = rigid(np.stack([np.cross(y, z), y, z], axis=1), half * z)
            face = pattern.for_face(number)
            pieces.append(
                (Patch(PLANE, pose, Drawing(half, half, face.drawing.shapes), (face.black, face.white)), face)
            )
        return pieces


@dataclass(frozen=True, slots=True, kw_only=True)
class Stairs:
    """Stairs: the pattern on the front of each step, white treads between the fronts.

    The origin is the centre of the lowest front, step 0. Tags go on counting from step to step.

    `depth_mm`: distance from one front back to the next.
    """

    KIND: ClassVar[str] = "stairs"

    steps: int
    depth_mm: float

    def __post_init__(self) -> None:
        if self.steps < 2 or not self.depth_mm > 0:
            raise TargetError(f"{self.steps} steps of {self.depth_mm} mm", hint="two steps at least")

    def patches(self, pattern: Pattern) -> Pieces:
        """Fronts from the lowest, then treads from the lowest."""
        half_x, half_y, back = pattern.drawing.half_x_mm, pattern.drawing.half_y_mm, self.depth_mm
        colours = pattern.black, pattern.white
        pieces: Pieces = []
        for number in range(self.steps):
            front = pattern.for_face(number)
            pose = rigid(np.eye(3), np.array([0.0, 2 * number * half_y, -number * back]))
            pieces.append((Patch(PLANE, pose, front.drawing, colours), front))
        lying = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        for number in range(self.steps - 1):
            pose = rigid(lying, np.array([0.0, (2 * number + 1) * half_y, -(number + 0.5) * back]))
            pieces.append((Patch(PLANE, pose, Drawing(half_x, back / 2), colours), None))
        return pieces


Surface = Flat | Warped | HeightMap | Cylinder | Cube | Stairs
