"""Surfaces that carry a pattern: one sheet, flat or bent, or several, as on a cube and on stairs. Each consists of
patches with a chart of their own, for images and for the positions of marks.

Target frame: origin at the centre of the pattern (or of the cube), x right, y up, z towards the viewer.
"""

import math
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np

from pipeline.frames import rigid
from pipeline.records.shapes import Float64
from pipeline.targets.drawing import Drawing
from pipeline.targets.patterns.pattern import Pattern, TargetError
from pipeline.targets.surface_kernels import heights_at_points

SAG_MM = 1e-4
"""Largest distance of a mesh from a curved surface [mm], visible only at silhouettes: hits are refined to the
surface."""
_MOST_CELLS = 600
"""Most cells of a mesh along an axis: a surface with more curvature gets a coarser mesh, which is reported."""

Kind = Literal["plane", "heights", "cylinder", "mesh"]
PLANE: Kind = "plane"
HEIGHTS: Kind = "heights"
CYLINDER: Kind = "cylinder"
MESH: Kind = "mesh"


@dataclass(frozen=True)
class Patch:
    """A piece of a surface. Patch frame: chart x right and y up, z out of the front, origin in the chart's middle."""

    kind: Kind  # `plane`, `heights` (z is a function of the chart), `cylinder` (chart x is rolled up) or `mesh`
    target_from_patch: Float64[np.ndarray, "4 4"]
    drawing: Drawing  # its sheet is the extent of the patch
    colours: tuple[float, float]  # radiance of black and of white
    # numbers of a curved surface, see `surface_kernels`; for a cylinder the radius
    shape: Float64[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0))
    # for a mesh: corners in the patch frame, and radiance at the corners
    triangles: Float64[np.ndarray, "m 3 3"] | None = None
    albedo: Float64[np.ndarray, "m 3"] | None = None

    def mesh(self) -> np.ndarray:
        """Triangles near the surface, anticlockwise as seen from the front, patch frame (m, 3, 3) [mm]."""
        if self.triangles is not None:
            return self.triangles
        nx, ny = self._cells()
        x, y = self.drawing.half_x_mm, self.drawing.half_y_mm
        u, v = np.meshgrid(np.linspace(-x, x, nx + 1), np.linspace(y, -y, ny + 1))
        points, _, _ = self.surface_at(np.stack([u.ravel(), v.ravel()], axis=1))
        corner = np.arange(points.shape[0]).reshape(ny + 1, nx + 1)
        a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
        # Top left, bottom left, bottom right; top left, bottom right, top right.
        triangles = np.stack([np.stack([a, d, c], axis=-1), np.stack([a, c, b], axis=-1)], axis=2)
        return points[triangles.reshape(-1, 3)]

    def mesh_sag_mm(self) -> float:
        """Largest distance of the mesh from the surface, to second order."""
        if self.kind in (PLANE, MESH):
            return 0.0
        nx, ny = self._cells()
        x, y = 2 * self.drawing.half_x_mm / nx, 2 * self.drawing.half_y_mm / ny
        return self._curvature() * (x**2 if self.kind == CYLINDER else x**2 + y**2) / 8

    def _cells(self) -> tuple[int, int]:
        """Cells of the mesh along x and along y, fine enough for `SAG_MM` if these are few enough."""
        if self.kind == PLANE:
            return 1, 1
        # The sag of a chord of length s is curvature * s^2 / 8; the longest chord is the diagonal of a cell.
        step = math.sqrt(8 * SAG_MM / max(self._curvature(), 1e-12))
        if self.kind == CYLINDER:
            return _cell_count(self.drawing.half_x_mm, step, 10 * _MOST_CELLS), 1
        step /= math.sqrt(2)
        return _cell_count(self.drawing.half_x_mm, step, _MOST_CELLS), _cell_count(
            self.drawing.half_y_mm, step, _MOST_CELLS
        )

    def _curvature(self) -> float:
        """Upper bound of the curvature over the patch, from samples [1/mm]."""
        if self.kind == CYLINDER:
            return 1 / abs(float(self.shape[0]))
        x, y = self.drawing.half_x_mm, self.drawing.half_y_mm
        u, v = np.meshgrid(np.linspace(-x, x, 101), np.linspace(-y, y, 101))
        _, _, curvature = self.surface_at(np.stack([u.ravel(), v.ravel()], axis=1))
        return float(np.max(curvature))

    def surface_at(self, xy_mm: Float64[np.ndarray, "n 2"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Place points of the chart on the surface, patch frame.

        Returns positions (n, 3) [mm]; axes (n, 3, 3), columns: x and y of the chart on the surface made orthonormal,
        and the normal; largest curvature without sign, (n,) [1/mm].
        """
        n = len(xy_mm)
        if self.kind == PLANE:
            return np.pad(xy_mm, ((0, 0), (0, 1))), np.tile(np.eye(3), (n, 1, 1)), np.zeros(n)
        if self.kind == CYLINDER:
            radius = float(self.shape[0])
            angle = xy_mm[:, 0] / radius
            sine, cosine = np.sin(angle), np.cos(angle)
            zero, ones = np.zeros(n), np.ones(n)
            columns = (cosine, zero, -sine), (zero, ones, zero), (sine, zero, cosine)
            axes = np.stack([np.stack(column, axis=1) for column in columns], axis=2)
            positions = np.stack([radius * sine, xy_mm[:, 1], radius * (cosine - 1)], axis=1)
            return positions, axes, ones / abs(radius)
        height = np.empty((n, 6))
        heights_at_points(self.shape, *np.ascontiguousarray(xy_mm.T), height)
        return np.column_stack([xy_mm, height[:, 0]]), *_axes_and_curvature(height)

    def along(self, direction_rad: Float64[np.ndarray, "n 2"], axes: Float64[np.ndarray, "n 3 3"]) -> np.ndarray:
        """Unit vectors on the surface, (n, k, 3), for directions (n, k) of the chart at points with `axes` from
        `surface_at`.

        Patch frame. A cylinder is rolled without stretching; height maps keep x and y of the chart.
        """
        flat = np.stack([np.cos(direction_rad), np.sin(direction_rad)], axis=-1)
        if self.kind != HEIGHTS:
            return flat @ axes[:, :, :2].transpose(0, 2, 1)
        normal = axes[:, :, 2]
        rise = -np.einsum("nki,ni->nk", flat, normal[:, :2]) / normal[:, 2:]
        raised = np.concatenate([flat, rise[..., None]], axis=-1)
        return raised / np.linalg.norm(raised, axis=-1, keepdims=True)


def _cell_count(half_mm: float, step_mm: float, limit: int) -> int:
    """Cells of at most a step over twice a half length, but one at least, and no more than a limit."""
    return max(1, min(limit, math.ceil(2 * half_mm / step_mm)))


def _axes_and_curvature(heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Axes (n, 3, 3) and largest curvature (n,) of a surface z(x, y) from z, zx, zy, zxx, zxy, zyy."""
    # The normal is (-zx, -zy, 1), made a unit vector; x runs along (1, 0, zx), and y is across both.
    _, zx, zy, zxx, zxy, zyy = heights.T
    zero, ones = np.zeros(len(zx)), np.ones(len(zx))
    normal = np.stack([-zx, -zy, ones], axis=1)
    length = np.linalg.norm(normal, axis=1)
    normal /= length[:, None]
    along = np.stack([ones, zero, zx], axis=1)
    along /= np.linalg.norm(along, axis=1)[:, None]
    axes = np.stack([along, np.cross(normal, along), normal], axis=2)
    # Eigenvalues of the second fundamental form by the first: their mean and their product.
    e, f, g = 1 + zx**2, zx * zy, 1 + zy**2
    l, m, n = zxx / length, zxy / length, zyy / length
    mean = (e * n - 2 * f * m + g * l) / (2 * (e * g - f**2))
    product = (l * n - m**2) / (e * g - f**2)
    return axes, np.abs(mean) + np.sqrt(np.maximum(mean**2 - product, 0))


Pieces = list[tuple[Patch, Pattern | None]]
"""Patches of a surface, each with the pattern on it; None for a blank one."""


def _one_patch(kind: Kind, pattern: Pattern, *shape: float) -> Pieces:
    """The only patch of a surface, in the target frame, with the whole pattern."""
    colours = pattern.black, pattern.white
    return [(Patch(kind, np.eye(4), pattern.drawing, colours, np.array(shape, float)), pattern)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Flat:
    """The plane z = 0."""

    KIND: ClassVar[str] = "flat"

    def patches(self, pattern: Pattern) -> Pieces:
        return _one_patch(PLANE, pattern)


@dataclass(frozen=True, slots=True, kw_only=True)
class Warped:
    """A bowed board: z = dx (1 - (x / half width)^2) + dy (1 - (y / half height)^2), over the full sheet.

    The pattern keeps its x and y, as in mrcal. (A bent print keeps lengths along the surface instead; the total
    difference is 8/3 of the squared deflection over the width.)
    """

    KIND: ClassVar[str] = "warped"

    deflection_mm: Annotated[
        tuple[float, float], "plen:shape:deflection"
    ]  # dx and dy, positive if the middle stands out towards the viewer

    def patches(self, pattern: Pattern) -> Pieces:
        drawing = pattern.drawing
        return _one_patch(HEIGHTS, pattern, 0.0, 0.0, drawing.half_x_mm, drawing.half_y_mm, *self.deflection_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeightMap:
    """A measured board: heights on a grid over the full sheet, edges included, joined by Catmull-Rom cubics.

    The pattern keeps its x and y.
    """

    KIND: ClassVar[str] = "height-map"

    resolution: Annotated[tuple[int, int], "plen:shape:resolution"]  # number of heights along x and along y
    heights_mm: Annotated[tuple[float, ...], "plen:shape:heights"]  # z, rows from the top, each from the left

    def __post_init__(self) -> None:
        across, down = self.resolution
        if len(self.heights_mm) != across * down:
            raise TargetError(
                f"{len(self.heights_mm)} heights for a map of {across} x {down}",
                hint="rows from the top, each from the left; two at least in each direction",
                code="height-map",
            )

    def patches(self, pattern: Pattern) -> Pieces:
        drawing = pattern.drawing
        return _one_patch(HEIGHTS, pattern, *self.resolution, drawing.half_x_mm, drawing.half_y_mm, *self.heights_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder:
    """A sheet rolled about an upright axis without stretching; its middle touches the plane z = 0."""

    KIND: ClassVar[str] = "cylinder"

    # positive: the pattern is on the outside, the axis behind it. Negative: a hollow, seen from inside
    radius_mm: Annotated[float, "plen:shape:radius"]

    def patches(self, pattern: Pattern) -> Pieces:
        width_mm = 2 * pattern.drawing.half_x_mm
        if width_mm > 2 * math.pi * abs(self.radius_mm):
            raise TargetError(
                f"the sheet is {width_mm:g} mm wide, and the cylinder"
                f" {2 * math.pi * abs(self.radius_mm):.6g} mm around",
                hint="enlarge the radius",
                code="cylinder-radius",
            )
        return _one_patch(CYLINDER, pattern, self.radius_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cube:
    """A cube with the pattern on every face; tag numbers continue from face to face. The origin is its centre.

    Faces: 0 front (+z), 1 right (+x), 2 top (+y), 3 left, 4 bottom, 5 back.
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

    edge_mm: Annotated[float, "plen:shape:edge"]  # the part of a face beyond the sheet of the pattern is white

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

    The origin is the centre of the lowest front, step 0. Tag numbers continue from step to step.
    """

    KIND: ClassVar[str] = "stairs"

    steps: Annotated[int, "plen:shape:steps"]
    depth_mm: Annotated[float, "plen:shape:depth"]  # distance from one front back to the next

    def patches(self, pattern: Pattern) -> Pieces:
        """Fronts from the lowest, then treads from the lowest."""
        half_x = pattern.drawing.half_x_mm
        half_y = pattern.drawing.half_y_mm
        back = self.depth_mm
        colours = pattern.black, pattern.white
        pieces: Pieces = []
        for number in range(self.steps):
            front = pattern.for_face(number)
            pose = rigid(np.eye(3), np.array([0.0, 2 * number * half_y, -number * back]))
            pieces.append((Patch(PLANE, pose, front.drawing, colours), front))
        level_turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        for number in range(self.steps - 1):
            pose = rigid(level_turn, np.array([0.0, (2 * number + 1) * half_y, -(number + 0.5) * back]))
            pieces.append((Patch(PLANE, pose, Drawing(half_x, back / 2), colours), None))
        return pieces


Surface = Flat | Warped | HeightMap | Cylinder | Cube | Stairs
