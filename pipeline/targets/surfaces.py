"""Surfaces that carry a pattern: one sheet, flat or bent, or several, as on a cube and on stairs.

Target frame: origin at the centre of the pattern (of a cube: of the cube), x right, y up, z towards the viewer.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pipeline.frames import rigid
from pipeline.targets.drawing import Drawing
from pipeline.targets.patches import CYLINDER, HEIGHTS, PLANE, Patch
from pipeline.targets.patterns.pattern import Pattern, TargetError


@dataclass(frozen=True, slots=True, kw_only=True)
class Flat:
    """The plane z = 0."""

    KIND: ClassVar[str] = "flat"

    def patches(self, pattern: Pattern) -> list[tuple[Patch, Pattern | None]]:
        """Patches of the surface, each with the pattern on it; None for a blank one."""
        return [(Patch(PLANE, np.eye(4), pattern.drawing, (pattern.black, pattern.white)), pattern)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Warped:
    """A board bent like a bow: z = dx (1 - (x / half width)^2) + dy (1 - (y / half height)^2), of the whole sheet.

    The pattern keeps its x and y, as in mrcal. (A bent print keeps lengths along the surface instead; the total
    difference is 8/3 of the squared deflection over the width.)

    Attributes
    ----------
    deflection_mm : (float, float)
        dx and dy, positive if the middle stands out towards the viewer.
    """

    KIND: ClassVar[str] = "warped"

    deflection_mm: tuple[float, float]

    def patches(self, pattern: Pattern) -> list[tuple[Patch, Pattern | None]]:
        """The one patch of the surface."""
        drawing = pattern.drawing
        shape = np.array([0.0, 0.0, drawing.half_x_mm, drawing.half_y_mm, *self.deflection_mm])
        return [(Patch(HEIGHTS, np.eye(4), drawing, (pattern.black, pattern.white), shape), pattern)]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMap:
    """A measured board: heights on a grid over the whole sheet, its edges included, joined by Catmull-Rom cubics.

    The pattern keeps its x and y.

    Attributes
    ----------
    resolution : (int, int)
        Number of heights along x and along y.
    heights_mm : tuple of float
        z, rows from the top, each from the left.
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

    def patches(self, pattern: Pattern) -> list[tuple[Patch, Pattern | None]]:
        """The one patch of the surface."""
        drawing = pattern.drawing
        shape = np.array([*self.resolution, drawing.half_x_mm, drawing.half_y_mm, *self.heights_mm], float)
        return [(Patch(HEIGHTS, np.eye(4), drawing, (pattern.black, pattern.white), shape), pattern)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder:
    """A sheet rolled about an upright axis without stretching; its middle touches the plane z = 0.

    Attributes
    ----------
    radius_mm : float
        Positive: the pattern is on the outside, the axis behind it. Negative: a hollow, seen from inside.
    """

    KIND: ClassVar[str] = "cylinder"

    radius_mm: float

    def patches(self, pattern: Pattern) -> list[tuple[Patch, Pattern | None]]:
        """The one patch of the surface."""
        drawing = pattern.drawing
        if drawing.half_x_mm > math.pi * abs(self.radius_mm):
            raise TargetError(
                f"the sheet is {2 * drawing.half_x_mm:g} mm wide, and the cylinder"
                f" {2 * math.pi * abs(self.radius_mm):.6g} mm around",
                hint="enlarge the radius",
                code="cylinder-radius",
            )
        shape = np.array([self.radius_mm])
        return [(Patch(CYLINDER, np.eye(4), drawing, (pattern.black, pattern.white), shape), pattern)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cube:
    """A cube with the pattern on every face; tag numbers go on from face to face. The origin is its centre.

    Faces: 0 front (+z), 1 right (+x), 2 top (+y), 3 left, 4 bottom, 5 back.

    Attributes
    ----------
    edge_mm : float
        Edge of the cube; the part of a face beyond the sheet of the pattern is white.
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

    def patches(self, pattern: Pattern) -> list[tuple[Patch, Pattern | None]]:
        """The six faces."""
        half = self.edge_mm / 2
        widest = max(pattern.drawing.half_x_mm, pattern.drawing.half_y_mm)
        if half < widest:
            raise TargetError(
                f"an edge of {self.edge_mm:g} mm is too short for a sheet of {2 * widest:g} mm",
                hint="enlarge the edge",
                code="cube-edge",
            )
        pieces: list[tuple[Patch, Pattern | None]] = []
        for number, (normal, up) in enumerate(self._NORMALS_AND_UPS):
            z, y = np.array(normal, float), np.array(up, float)
            pose = rigid(np.stack([np.cross(y, z), y, z], axis=1), half * z)
            face = pattern.for_face(number)
            pieces.append((Patch(PLANE, pose, face.drawing.on_sheet(half, half), (face.black, face.white)), face))
        return pieces


@dataclass(frozen=True, slots=True, kw_only=True)
class Stairs:
    """Stairs: the pattern on the front of each step, white treads between the fronts.

    The origin is the centre of the lowest front, step 0. Tags go on counting from step to step.

    Attributes
    ----------
    steps : int
    depth_mm : float
        Distance from one front back to the next.
    """

    KIND: ClassVar[str] = "stairs"

    steps: int
    depth_mm: float

    def __post_init__(self) -> None:
        if self.steps < 2 or not self.depth_mm > 0:
            raise TargetError(f"{self.steps} steps of {self.depth_mm} mm", hint="two steps at least")

    def patches(self, pattern: Pattern) -> list[tuple[Patch, Pattern | None]]:
        """Fronts from the lowest, then treads from the lowest."""
        half_x, half_y, back = pattern.drawing.half_x_mm, pattern.drawing.half_y_mm, self.depth_mm
        colours = pattern.black, pattern.white
        fronts: list[tuple[Patch, Pattern | None]] = []
        for number in range(self.steps):
            front = pattern.for_face(number)
            pose = rigid(np.eye(3), np.array([0.0, 2 * number * half_y, -number * back]))
            fronts.append((Patch(PLANE, pose, front.drawing, colours), front))
        lying = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        treads: list[tuple[Patch, Pattern | None]] = []
        for number in range(self.steps - 1):
            pose = rigid(lying, np.array([0.0, (2 * number + 1) * half_y, -(number + 0.5) * back]))
            treads.append((Patch(PLANE, pose, Drawing(half_x, back / 2), colours), None))
        return [*fronts, *treads]


Surface = Flat | Warped | HeightMap | Cylinder | Cube | Stairs
