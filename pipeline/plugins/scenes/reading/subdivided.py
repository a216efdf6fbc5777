"""Readers of meshes that are subdivision surfaces: creases, boundaries and primvars."""

from dataclasses import replace
from functools import cached_property

import numpy as np
from pxr import Usd, UsdGeom

from pipeline.limits import limits
from pipeline.plugins.scenes.reading.cage import Cage, NotManifold
from pipeline.plugins.scenes.reading.solid_prims import tolerance_of
from pipeline.plugins.scenes.reading.subdivision import BILINEAR, LOOP, Levels
from pipeline.scene.usd.meshes import (
    CORNERS,
    TOPOLOGY,
    Drawn,
    Polygons,
    array_of,
    fan_corners,
    plain_shape,
    polygons_of,
)
from pipeline.scene.usd.poses import stage_mm_per_unit
from pipeline.scene.usd.readers import read_once


class SubdivisionSurface:
    """The topology of a subdivision surface, with the levels of its vertices and of its primvars."""

    def __init__(self, prim: Usd.Prim, time: float | None, polygons: Polygons, scheme: str) -> None:
        if scheme == LOOP and (polygons.count != CORNERS).any():
            raise NotManifold("Loop subdivides triangles alone, and not all of its faces are such")
        mesh = UsdGeom.Mesh(prim)
        self.scheme = scheme
        self._mesh = mesh
        self._polygons = polygons
        self.flaws = list[str]()
        boundary = mesh.GetInterpolateBoundaryAttr().Get(Usd.TimeCode.EarliestTime())
        corner = np.zeros(len(polygons.points))
        if boundary == UsdGeom.Tokens.edgeAndCorner and scheme != BILINEAR:
            corner[np.bincount(polygons.vertex, minlength=len(corner)) == 1] = np.inf
        indices = array_of(prim, "cornerIndices", time).astype(int)
        sharpness = array_of(prim, "cornerSharpnesses", time)
        if len(indices) == len(sharpness) and ((indices >= 0) & (indices < len(corner))).all():
            np.maximum.at(corner, indices, sharpness)
        else:
            self.flaws.append("cornerSharpnesses do not fit cornerIndices and are ignored")
        self.cage = Cage(polygons.vertex, polygons.count, self._creases(prim, time), corner)
        self.levels = Levels(self.cage, scheme)
        self.is_hole = polygons.is_hole
        if boundary == UsdGeom.Tokens.none:  # faces at a boundary only support the others
            at_boundary = _at_boundary(self.cage)[self.cage.vertex]
            self.is_hole = self.is_hole | (np.bincount(self.cage.face, at_boundary) > 0)

    def _creases(self, prim: Usd.Prim, time: float | None) -> np.ndarray:
        """Sharpness of the edge from each corner to the next."""
        sharp = np.zeros(len(self._polygons.vertex))
        along, lengths = (array_of(prim, name, time).astype(int) for name in ("creaseIndices", "creaseLengths"))
        sharpness = array_of(prim, "creaseSharpnesses", time)
        edges = np.maximum(lengths - 1, 0)
        if len(sharpness) == len(lengths):
            sharpness = np.repeat(sharpness, edges)
        if lengths.sum() != len(along) or len(sharpness) != edges.sum():
            self.flaws.append("creaseLengths do not fit creaseIndices or creaseSharpnesses, and creases are ignored")
            return sharp
        # Neighbours along a crease, but not the last vertex of one and the first of the next.
        is_last = np.zeros(len(along), bool)
        is_last[np.cumsum(lengths)[lengths > 0] - 1] = True
        first = np.flatnonzero(~is_last)
        # The sharpest crease of each edge counts.
        sharp_of = dict[tuple[int, int], float]()
        for a, b, value in zip(along[first].tolist(), along[first + 1].tolist(), sharpness.tolist(), strict=True):
            edge = min(a, b), max(a, b)
            sharp_of[edge] = max(sharp_of.get(edge, 0.0), value)
        if not sharp_of:
            return sharp
        bare = Cage(self._polygons.vertex, self._polygons.count, sharp, np.zeros(len(self._polygons.points)))
        return np.array([sharp_of.get((a, b), 0.0) for a, b in bare.ends.tolist()])[bare.edge]

    @cached_property
    def varying(self) -> Levels:
        """Levels of values that are interpolated between vertices linearly."""
        return Levels(self.cage, BILINEAR, self.scheme)

    def face_varying(self, indices: np.ndarray | None, count: int) -> Levels:
        """Levels of face-varying values, which are joined where corners share an index."""
        polygons = self._polygons
        rule = self._mesh.GetFaceVaryingLinearInterpolationAttr().Get(Usd.TimeCode.EarliestTime())
        index = polygons.corner if indices is None else indices[polygons.corner]
        corner = np.zeros(count)
        sheet = Cage(index, polygons.count, self.cage.sharp, corner)
        if rule == UsdGeom.Tokens.all or self.scheme == BILINEAR:
            return Levels(sheet, BILINEAR, self.scheme)
        if rule == UsdGeom.Tokens.boundaries:
            corner[_at_boundary(sheet)] = np.inf
        elif rule != UsdGeom.Tokens.none:
            alone = np.bincount(index, minlength=count) == 1
            corner[alone] = np.inf
            if rule != UsdGeom.Tokens.cornersOnly:
                corner[self._junctions(sheet, alone, rule)] = np.inf
        try:
            return Levels(sheet, self.scheme)
        except NotManifold:
            return Levels(sheet, BILINEAR, self.scheme)

    def _junctions(self, sheet: Cage, alone: np.ndarray, rule: str) -> np.ndarray:
        """Values where three of them or more meet at a vertex. By cornersPlus2 also those where one of two is `alone`,
        of a single face, and where a seam ends inside of the mesh.
        """
        vertex, value = np.unique(np.stack([self._polygons.vertex, sheet.vertex], axis=1), axis=0).T
        count = len(self._polygons.points)
        meeting = np.bincount(vertex, minlength=count)
        is_junction = meeting > 2
        if rule == UsdGeom.Tokens.cornersPlus2:
            has_corner, has_seam = (np.bincount(vertex, of[value], count) > 0 for of in (alone, _at_boundary(sheet)))
            ends_seam = (meeting == 1) & has_seam & ~_at_boundary(self.cage)
            is_junction = is_junction | ((meeting == 2) & has_corner) | ends_seam
        return value[is_junction[vertex]]


def _at_boundary(cage: Cage) -> np.ndarray:
    """Whether each vertex of a cage lies on a boundary."""
    return cage.marked_at(cage.faces_at_edge == 1) > 0


@read_once
def _surface_of(prim: Usd.Prim, time: float | None, scheme: str) -> SubdivisionSurface:
    return SubdivisionSurface(prim, time, polygons_of(prim, time), scheme)


def subdivided(prim: Usd.Prim, time: float | None, polygons: Polygons, scheme: str) -> Drawn:
    """The triangles of a subdivision surface, or of its polygons where these are no surface."""
    try:
        return refined(prim, time, polygons, scheme)
    except NotManifold as error:
        flaw = f"{error}, so it is drawn as its polygons and not subdivided"
        return plain_shape(replace(polygons, flaws=(*polygons.flaws, flaw)))


def refined(prim: Usd.Prim, time: float | None, polygons: Polygons, scheme: str) -> Drawn:
    """The triangles of a subdivision surface, as fine as the tolerance of the prim asks; NotManifold."""
    is_still = not any(prim.GetAttribute(name).ValueMightBeTimeVarying() for name in TOPOLOGY)
    surface = _surface_of(prim, None if is_still else time, scheme)
    levels, points = surface.levels, polygons.points
    tolerance = tolerance_of(prim, float(np.ptp(points[polygons.vertex], axis=0).max()))
    level, distance = levels.level_for(points, tolerance, limits().triangles // 2)
    flaws = [*polygons.flaws, *surface.flaws]
    if distance > tolerance:
        far = distance * stage_mm_per_unit(prim)
        flaws.append(
            f"it is subdivided {level} times and then up to {far:.3g} mm off: more would be too many triangles"
        )
    cage = levels.cage(level)
    origin = levels.origin(level)
    corners, face = fan_corners(cage.count, surface.is_hole[origin])

    def carry(values: np.ndarray, interpolation: str, indices: np.ndarray | None) -> np.ndarray:
        """Values of a primvar at the corners of the level; IndexError for too few."""
        if interpolation == UsdGeom.Tokens.faceVarying:
            if len(values) <= polygons.corner.max(initial=-1):
                raise IndexError
            if indices is not None:  # back to the values that corners share
                shared = np.zeros((int(indices.max(initial=-1)) + 1, values.shape[1]))
                shared[indices] = values
                values = shared
            sheet = surface.face_varying(indices, len(values))
            return (sheet.points(level) @ values)[sheet.cage(level).vertex]
        if len(values) < len(points):
            raise IndexError
        of_values = levels if interpolation == UsdGeom.Tokens.vertex else surface.varying
        return (of_values.points(level) @ values[: len(points)])[cage.vertex]

    return Drawn(
        points=levels.points(level) @ points,
        indices=cage.vertex,
        corners=corners,
        faces=polygons.face[origin[face]],
        carry=carry,
        normals=levels.normals(level, points) if scheme != BILINEAR else None,
        is_smooth=True,
        flaws=tuple(flaws),
    )
