"""Shapes as triangles: polygon meshes here, subdivision surfaces and solids by the plug-in `scenes`.

A faulty shape never refuses a dataset: it is drawn as far as possible, and `Drawn.flaws` lists its faults.
"""

import itertools
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from pipeline.scene.usd.plug_in import scene_reader
from pipeline.scene.usd.readers import note_read, read_once
from pipeline.scene.usd.values import numbers

TOPOLOGY = (
    *("faceVertexCounts", "faceVertexIndices", "holeIndices", "creaseIndices", "creaseLengths", "creaseSharpnesses"),
    *("cornerIndices", "cornerSharpnesses"),
)
SOLIDS = {
    "Sphere": ("radius",),
    "Cube": ("size",),
    "Cylinder": ("radius", "radius", "height"),
    "Cylinder_1": ("radiusBottom", "radiusTop", "height"),
    "Cone": ("radius", "height"),
    "Capsule": ("radius", "radius", "height"),
    "Capsule_1": ("radiusBottom", "radiusTop", "height"),
    "Plane": ("width", "length"),
}
"""Attributes with the measures of each type of solid."""
CORNERS = 3
"""Fewest corners of a face."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A shape as triangles, in its own frame and the unit of the stage.

    `points`, (v, 3), are its vertices, and `indices`, (c,), has the vertex of every corner of a polygon. Of each
    triangle, `corners`, (t, 3), has three of these corners, anticlockwise as seen from the front, and `faces`, (t,),
    the face of the mesh. `normals`, (c, 3), and `st`, (c, 2), are those of the shape itself, if it has any. `carry`
    interpolates a primvar to the corners of polygons. `flaws` are statements of the prim that are not drawn.
    """

    points: np.ndarray
    indices: np.ndarray
    corners: np.ndarray
    faces: np.ndarray
    carry: Callable[[np.ndarray, str, np.ndarray | None], np.ndarray]
    normals: np.ndarray | None = None
    st: np.ndarray | None = None
    is_smooth: bool = False  # its normals replace those that the prim has
    flaws: tuple[str, ...] = ()

    @property
    def triangles(self) -> np.ndarray:
        """Vertices of the triangles, (t, 3)."""
        return self.indices[self.corners]

    def at_corners(self, values: np.ndarray, interpolation: str, indices: np.ndarray | None = None) -> np.ndarray:
        """Values of a primvar, (n, k), at the three corners of each triangle, (t, 3, k); IndexError if they do not fit.

        `indices` are those of the primvar into its values before it was flattened: where they join corners of faces,
        face-varying values are joined.
        """
        if interpolation == UsdGeom.Tokens.constant:
            return np.broadcast_to(values[0], (len(self.corners), 3, values.shape[1]))
        if interpolation == UsdGeom.Tokens.uniform:
            if self.st is not None and len(values) != self.faces.max(initial=0) + 1:
                raise IndexError  # a solid has as many faces as these
            return np.repeat(values[self.faces][:, None], 3, axis=1)
        return self.carry(values, interpolation, indices)[self.corners]


@dataclass(frozen=True)
class Polygons:
    """The usable faces of a mesh, corner by corner."""

    points: np.ndarray
    vertex: np.ndarray
    count: np.ndarray
    face: np.ndarray  # (f,), of the mesh
    corner: np.ndarray  # (c,), of the mesh
    is_hole: np.ndarray
    flaws: tuple[str, ...]

    def carry(self, values: np.ndarray, interpolation: str, indices: np.ndarray | None) -> np.ndarray:
        """Values at the corners."""
        if interpolation == UsdGeom.Tokens.faceVarying:
            return values[self.corner]
        if len(values) < len(self.points):
            raise IndexError
        return values[self.vertex]


_OF_NO_SHAPE = ("xformOp", "visibility", "purpose")
"""Beginnings of properties on which a shape does not depend: pose, visibility and purpose."""


@read_once
def likeness(prim: Usd.Prim) -> Hashable:
    """Type and opinions of a prim, but for its pose: prims with equal ones have equal shapes."""
    opinions = prim.GetPrimStack()
    shaping = [spec for spec in opinions if any(not name.startswith(_OF_NO_SHAPE) for name in spec.properties.keys())]  # noqa: SIM118  # no dict
    opinion_keys = ((spec.layer.identifier, spec.path) for spec in shaping)
    return prim.GetTypeName(), *prim.GetAppliedSchemas(), *opinion_keys, _clipped(prim)


@read_once
def _clipped(prim: Usd.Prim) -> Sdf.Path | None:
    """Path of the nearest prim with value clips, from a prim upwards: no opinion shows these."""
    return prim.GetPath() if prim.HasAuthoredMetadata("clips") else prim.GetParent() and _clipped(prim.GetParent())


@read_once
def likeness_with_above(prim: Usd.Prim) -> Hashable:
    """Likeness of a prim and of all its ancestors, from which it may inherit primvars."""
    return (likeness(prim), likeness_with_above(prim.GetParent())) if prim.GetParent() else ()


@read_once
def appearance_key(mesh: Usd.Prim) -> Hashable:
    """Key of the look of a shape: likeness with that of ancestors and subsets, and the materials bound to them."""
    parts = [mesh, *(child for child in mesh.GetChildren() if child.IsA(UsdGeom.Subset))]
    apis = map(UsdShade.MaterialBindingAPI, parts)
    purposes = UsdShade.Tokens.full, UsdShade.Tokens.preview
    materials = (api.ComputeBoundMaterial(purpose)[0] for api, purpose in itertools.product(apis, purposes))
    return likeness_with_above(mesh), *map(likeness, parts[1:]), *(material.GetPath() for material in materials)


def alike(prims: Iterable[Usd.Prim], named: Callable[[Usd.Prim], Hashable] = likeness) -> list[list[Usd.Prim]]:
    """Prims in groups of equal keys, as instances have, in order: a finding about the first holds for all."""
    kinds = dict[Hashable, list[Usd.Prim]]()
    for prim in prims:
        kinds.setdefault(named(prim), []).append(prim)
    return list(kinds.values())


def shape_key(prim: Usd.Prim, time: float | None = None) -> Hashable:
    """Key of a shape for `read_once`, the same for instances; animated instances may be shifted in time."""
    return likeness(prim) if time is None else (prim, time)


def is_drawn(prim: Usd.Prim) -> bool:
    """Whether a prim is a shape: a mesh or a solid."""
    return prim.IsA(UsdGeom.Mesh) or str(prim.GetTypeName()) in SOLIDS


@partial(read_once, named=lambda prim, *flags: (likeness_with_above(prim), *flags))
def is_animated(prim: Usd.Prim, with_primvars: bool = False) -> bool:
    """Whether the shape of a prim is animated; with primvars also these, inherited or not."""
    names = set(SOLIDS.get(str(prim.GetTypeName()), ("points", *TOPOLOGY)))
    primvars = UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance() if with_primvars else []
    names |= {"normals"} if with_primvars else set()
    attributes = [attribute for attribute in prim.GetAuthoredAttributes() if attribute.GetName() in names]
    return any(value.ValueMightBeTimeVarying() for value in [*attributes, *primvars])


@partial(read_once, named=shape_key)
def drawn(prim: Usd.Prim, time: float | None = None) -> Drawn:
    """The triangles of a Mesh or a solid at a time, by default the earliest one."""
    note_read(prim)
    if str(prim.GetTypeName()) in SOLIDS:
        return scene_reader().solid(prim, time)
    polygons = polygons_of(prim, time)
    authored = UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().Get(code_at(time))
    scheme = authored if authored in ("none", "loop", "bilinear") else "catmullClark"  # also where it has a wrong type
    is_plain = scheme == UsdGeom.Tokens.none or not len(polygons.count)
    shape = plain_shape(polygons) if is_plain else scene_reader().subdivided(prim, time, polygons, scheme)
    return _oriented(prim, shape, time)


def _oriented(prim: Usd.Prim, shape: Drawn, time: float | None) -> Drawn:
    """A shape with its fronts as the orientation of the prim has them."""
    if UsdGeom.Gprim(prim).GetOrientationAttr().Get(code_at(time)) != UsdGeom.Tokens.leftHanded:
        return shape
    return replace(
        shape, corners=shape.corners[:, [0, 2, 1]], normals=None if shape.normals is None else -shape.normals
    )


def fans(mesh: UsdGeom.Mesh) -> Drawn:
    """The triangles of a mesh as it is written, n - 2 of a face with n corners; ValueError if the faces contradict."""
    note_read(mesh.GetPrim())
    polygons = polygons_of(mesh.GetPrim(), None)
    if polygons.flaws:
        raise ValueError(polygons.flaws[0])
    return _oriented(mesh.GetPrim(), plain_shape(polygons), None)


def code_at(time: float | None) -> Usd.TimeCode:
    """USD's time code of a time; of None the earliest one."""
    return Usd.TimeCode.EarliestTime() if time is None else Usd.TimeCode(time)


def array_of(prim: Usd.Prim, name: str, time: float | None) -> np.ndarray:
    """Numbers of an attribute at a time, (n,); none without a value."""
    value = prim.GetAttribute(name).Get(code_at(time))
    return numbers(value if value is not None else [])


def _points_at(prim: Usd.Prim, time: float | None) -> tuple[np.ndarray, list[str]]:
    """Vertices of a mesh at a time, (v, 3), between samples by its velocities, as USD has it; and flaws of these."""
    points = array_of(prim, "points", time).reshape(-1, 3)
    mesh = UsdGeom.PointBased(prim)
    if time is None or not mesh.GetVelocitiesAttr().GetNumTimeSamples():
        return points, []
    # USD would read beyond the end of arrays that are shorter than that of the points at the sample before.
    before = next(iter(mesh.GetPointsAttr().GetBracketingTimeSamples(time)), time)
    rates = [rate for rate in (mesh.GetVelocitiesAttr(), mesh.GetAccelerationsAttr()) if rate.HasAuthoredValue()]
    if len({len(array_of(prim, name, before)) for name in ("points", *(rate.GetName() for rate in rates))}) > 1:
        return points, ["its velocities or accelerations do not fit its points and are ignored"]
    return numbers(mesh.ComputePointsAtTime(time, time) or []).reshape(-1, 3), []


@read_once
def polygons_of(prim: Usd.Prim, time: float | None) -> Polygons:
    """The usable faces of a mesh at a time, and the flaws of the others."""
    points, flaws = _points_at(prim, time)
    points = points + 0.0
    counts, indices, holes = (array_of(prim, name, time).astype(int) for name in TOPOLOGY[:3])
    # Leave out faces whose corners are not written, and corners that no face counts.
    counts = np.maximum(counts, 0)
    if counts.sum() != len(indices):
        flaws.append(f"faceVertexCounts name {counts.sum():,} corners, and faceVertexIndices has {len(indices):,}")
        counts = counts[np.cumsum(counts) <= len(indices)]
    indices = indices[: counts.sum()]
    # Leave out faces with a vertex that does not exist or is not finite.
    face = np.repeat(np.arange(len(counts)), counts)
    exists = (indices >= 0) & (indices < len(points))
    exists &= np.isfinite(points[np.where(exists, indices, 0)]).all(axis=1) if len(points) else False
    good = np.bincount(face[~exists], minlength=len(counts)) == 0
    if not good.all():
        flaws.append(f"{(~good).sum():,} of its faces name a vertex that is not among its {len(points):,} finite ones")
    # A corner that is written twice is one corner: compare each with the next one of its face, the last with the first.
    first = np.cumsum(counts) - counts
    next_corner = np.arange(1, len(indices) + 1)
    next_corner[(first + counts - 1)[counts > 0]] = first[counts > 0]
    kept = good[face] & (indices != indices[next_corner] if len(indices) else True)
    kept_counts = np.bincount(face[kept], minlength=len(counts))
    if thin := ((kept_counts < CORNERS) & good).sum():
        flaws.append(f"{thin:,} of its faces have fewer than three corners")
    is_polygon = kept_counts >= CORNERS
    kept &= is_polygon[face]
    if not kept.any():
        flaws = [", ".join([*flaws, "it has no faces"]) + ": nothing is drawn"]
    return Polygons(
        points=points,
        vertex=indices[kept],
        count=kept_counts[is_polygon],
        face=np.flatnonzero(is_polygon),
        corner=np.flatnonzero(kept),
        is_hole=np.isin(np.flatnonzero(is_polygon), holes),
        flaws=tuple(flaws),
    )


def fan_corners(count: np.ndarray, is_hole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the triangles of faces that are no holes, (t, 3), and the face of each: a fan about its first corner.

    `count`, (f,), are the corners of each face.
    """
    first = np.cumsum(count) - count
    triangles = np.where(is_hole, 0, count - 2)
    face = np.repeat(np.arange(len(count)), triangles)
    step = np.arange(len(face)) - np.repeat(np.cumsum(triangles) - triangles, triangles)  # of a triangle in its fan
    return np.stack([first[face], first[face] + step + 1, first[face] + step + 2], axis=1), face


def plain_shape(polygons: Polygons) -> Drawn:
    """The polygons, each a fan of triangles."""
    corners, face = fan_corners(polygons.count, polygons.is_hole)
    return Drawn(
        points=polygons.points,
        indices=polygons.vertex,
        corners=corners,
        faces=polygons.face[face],
        carry=polygons.carry,
        flaws=polygons.flaws,
    )
