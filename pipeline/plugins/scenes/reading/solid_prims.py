"""Readers of the solids of UsdGeom, as triangles within a tolerance of the curved surface."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pipeline.plugins.scenes.reading import solids
from pipeline.plugins.scenes.reading.solids import Solid
from pipeline.scene.usd.meshes import SOLIDS, Drawn, code_at
from pipeline.scene.usd.poses import stage_mm_per_unit
from pipeline.scene.usd.values import read

_MAKERS: dict[str, Callable[..., Solid]] = {
    "Sphere": solids.sphere,
    "Cube": lambda size, _: solids.cube(size),
    "Cylinder": solids.frustum,
    "Cylinder_1": solids.frustum,
    "Cone": lambda radius, height, tolerance: solids.frustum(radius, 0.0, height, tolerance),
    "Capsule": solids.capsule,
    "Capsule_1": solids.capsule,
    "Plane": lambda width, length, _: solids.plane(width, length),
}
"""The solid of each type of prim, by its measures and a tolerance."""
_FINENESS = 1e-3
"""Largest distance of triangles from a curved surface, in greatest extents of the shape [1]; see plen:tolerance."""
_SIDES_OF_CUBE = (4, 5, 2, 3, 0, 1)
"""Numbers of the sides +x, -x, +y, -y, +z and -z in renderers of USD, for values of primvars."""
_CORNERS_OF_CUBE = (7, 3, 1, 5, 0, 2, 6, 4)
"""Corners of a cube in their order in these renderers, as numbers of three bits: is x, y, z positive?"""


def tolerance_of(prim: Usd.Prim, size: float) -> float:
    """Largest distance of triangles from a curved surface of some size, in units of the stage."""
    tolerance_mm = read(prim, "plen:tolerance") or 0.0
    return tolerance_mm / stage_mm_per_unit(prim) if tolerance_mm > 0 else _FINENESS * size


def solid(prim: Usd.Prim, time: float | None) -> Drawn:
    """The triangles of a prim of a type in `meshes.SOLIDS`."""
    kind = str(prim.GetTypeName())
    time_code = code_at(time)
    make, names = _MAKERS[kind], SOLIDS[kind]
    measures: list[Any] = [prim.GetAttribute(name).Get(time_code) for name in names]
    flaws: tuple[str, ...] = ()
    if not all(np.isfinite(measures)) or min(measures) < 0 or not max(measures) > 0:
        listed = ", ".join(f"{name} = {value:g}" for name, value in zip(names, measures, strict=True))
        flaws = (f"{listed}: nothing is drawn",)
        shape = Solid(np.zeros((0, 3)), np.zeros((0, 3), int), np.zeros((0, 3, 3)), np.zeros((0, 3, 2)))
    else:
        rough = make(*measures, max(measures)).points
        shape = make(*measures, tolerance_of(prim, float(np.ptp(rough, axis=0).max())))
        shape = shape.along(str(prim.GetAttribute("axis").Get(time_code))) if prim.HasAttribute("axis") else shape
    count = len(shape.triangles)
    is_cube = kind == "Cube"
    vertex = np.argsort(_CORNERS_OF_CUBE)[(shape.points > 0) @ [4, 2, 1]] if is_cube else np.zeros(0, int)

    def carry(values: np.ndarray, interpolation: str, indices: np.ndarray | None) -> np.ndarray:
        """Values of a primvar at the corners of triangles; IndexError unless they are those of a cube's vertices."""
        if interpolation == UsdGeom.Tokens.faceVarying or len(values) != len(_CORNERS_OF_CUBE) or not is_cube:
            raise IndexError  # nobody says which vertices other solids have
        return values[vertex[shape.triangles.ravel()]]

    return Drawn(
        points=shape.points + 0.0,
        indices=shape.triangles.ravel(),
        corners=np.arange(3 * count).reshape(-1, 3),
        faces=np.repeat(_SIDES_OF_CUBE, count // len(_SIDES_OF_CUBE)) if is_cube else np.zeros(count, int),
        carry=carry,
        normals=shape.normals.reshape(-1, 3),
        st=shape.st.reshape(-1, 2),
        is_smooth=True,
        flaws=flaws,
    )
