"""Meshes of USD, split into triangles."""

from collections.abc import Iterator
from dataclasses import dataclass

from pxr import Usd, UsdGeom, UsdSkel

from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import plain, take

SHAPE = ("points", "faceVertexCounts", "faceVertexIndices", "holeIndices")
"""Attributes that define the triangles of a mesh."""


@dataclass(frozen=True, slots=True)
class Fans:
    """Faces as fans of triangles, as viewers of USD draw them.

    `points` are vertices in the frame of the mesh, in the unit of the stage, and `indices` has the vertex of every face
    corner. Of each triangle, `corners` has its three face corners, anticlockwise as seen from the front, and `faces`
    its face.
    """

    points: tuple[tuple[float, float, float], ...]
    indices: tuple[int, ...]
    corners: list[tuple[int, int, int]]
    faces: list[int]

    @property
    def triangles(self) -> tuple[tuple[int, int, int], ...]:
        """Vertices of the triangles."""
        return tuple((self.indices[a], self.indices[b], self.indices[c]) for a, b, c in self.corners)

    def places(self, interpolation: str) -> list[tuple[int, ...]]:
        """Places of the corners of all triangles among the values of a primvar, (n, 3)."""
        if interpolation == UsdGeom.Tokens.constant:
            return [(0, 0, 0)] * len(self.corners)
        if interpolation == UsdGeom.Tokens.uniform:
            return [(face, face, face) for face in self.faces]
        return list(self.corners if interpolation == UsdGeom.Tokens.faceVarying else self.triangles)


def fans(mesh: UsdGeom.Mesh) -> Fans:
    """The triangles of a mesh: n - 2 of a face with n corners, none of a hole; ValueError if the faces contradict."""
    take(mesh.GetPath())
    attributes, earliest = map(mesh.GetPrim().GetAttribute, SHAPE), Usd.TimeCode.EarliestTime()
    points, counts, indices, holes = (plain(attribute.Get(earliest) or ()) for attribute in attributes)
    if sum(counts) != len(indices) or min(counts, default=3) < 3:
        raise ValueError("faceVertexCounts do not fit faceVertexIndices")
    holes, corners, faces, start = frozenset(holes), [], [], 0
    for face, count in enumerate(counts):
        if face not in holes:
            corners += [(start, start + i, start + i + 1) for i in range(1, count - 1)]
            faces += [face] * (count - 2)
        start += count
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        corners = [(a, c, b) for a, b, c in corners]
    return Fans(points, indices, corners, faces)


def check_skin(prim: Usd.Prim) -> Iterator[Problem]:
    """A problem if a skeleton moves the vertices of a mesh: images and truth would have it as it was modelled."""
    joints = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("skel:jointIndices")
    blends = UsdSkel.BindingAPI(prim).GetBlendShapeTargetsRel()
    if UsdSkel.Root.Find(prim) and (joints.HasValue() or (blends and blends.GetTargets())):
        message = f"UsdSkel moves the vertices of <{prim.GetPath()}>, and skinned meshes are not drawn"
        hint = "bake its shape (UsdSkel.BakeSkinning) and keep one, or take its joints and blend shapes out"
        yield problem(prim, "not-yet-supported", message, hint=hint)
