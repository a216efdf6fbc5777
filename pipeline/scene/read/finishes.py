"""Reading of what meshes of a lit scene are made of, and of which meshes these are."""

from collections.abc import Callable

import numpy as np
from pxr import Usd, UsdGeom, UsdShade

from pipeline.render.lighting.materials import all_of
from pipeline.render.lighting.records import Finish, Input, Material, Numbers
from pipeline.scene.read.lamps import is_in_images, lamp_prims
from pipeline.scene.read.materials import Shaded, read_material
from pipeline.scene.read.targets import is_preview
from pipeline.scene.usd.meshes import Fans, fans
from pipeline.scene.usd.values import NotSupported, UnreadableValue, plain, read_once, take, targets

_GREY = (0.18, 0.18, 0.18)
"""Colour of what has none [1]: UsdPreviewSurface's."""


def seen_meshes(root: Usd.Prim) -> list[Usd.Prim]:
    """Meshes besides targets that images of a dataset show: those that it names, and with lamps all others, too."""
    named = targets(root, "plen:occluders", "Mesh")
    stage = root.GetStage()
    if not lamp_prims(stage):
        return named
    taken = {mesh for prim in stage.Traverse() for mesh in targets(prim, "plen:mesh", "Mesh")}
    others = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh) and prim not in named and prim not in taken]
    return named + [prim for prim in others if is_in_images(prim) and not is_preview(prim)]


@read_once
def read_finish(prim: Usd.Prim) -> Finish:
    """The materials of a Mesh, with its normals and texture coordinates.

    Raises
    ------
    NotSupported, UnreadableValue
        A material, a normal or a texture coordinate cannot be used.
    """
    mesh = UsdGeom.Mesh(prim)
    shape = fans(mesh)
    found = [_material_of(prim)]
    of_face = dict[int, int]()
    for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
        take(subset.GetPath())
        of_face |= dict.fromkeys(plain(subset.GetIndicesAttr().Get() or ()), len(found))
        found.append(_material_of(subset.GetPrim()))
    materials = tuple(one.material for one in found)
    return Finish(
        materials=materials,
        material_of=tuple(of_face.get(face, 0) for face in shape.faces) if of_face else (),
        normals=_normals(mesh, shape),
        st=_st(mesh, shape, found) if all_of(materials) else (),
    )


def _material_of(prim: Usd.Prim) -> Shaded:
    """The material that is bound to a mesh or a subset, else the display colour of the mesh."""
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(UsdShade.Tokens.full)
    if material:
        return read_material(material)
    mesh = prim if prim.IsA(UsdGeom.Mesh) else prim.GetParent()
    colour = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor")
    values = plain(colour.Get() or ()) if colour else ()
    if len(values) > 1:
        raise NotSupported(
            f'"primvars:displayColor" has {len(values)} colours',
            colour.GetAttr(),
            hint="write one colour, or bind a material with a texture",
        )
    return Shaded(Material(diffuse_color=Input(value=values[0] if values else _GREY), ior=1.0), "")


def _normals(mesh: UsdGeom.Mesh, shape: Fans) -> tuple[Numbers, ...]:
    """Authored normals at the corners of all triangles; none: flat ones."""
    primvar = UsdGeom.PrimvarsAPI(mesh.GetPrim()).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        values, interpolation, attribute = primvar.ComputeFlattened(), primvar.GetInterpolation(), primvar.GetAttr()
    else:
        attribute = mesh.GetNormalsAttr()
        values, interpolation = attribute.Get(), mesh.GetNormalsInterpolation()
    return _at_corners(plain(values or ()), interpolation, shape, attribute, 3)


def _st(mesh: UsdGeom.Mesh, shape: Fans, found: list[Shaded]) -> tuple[Numbers, ...]:
    """Texture coordinates at the corners of all triangles."""
    names = list(dict.fromkeys(one.primvar for one in found if all_of([one.material])))
    if len(names) > 1:
        raise NotSupported(
            f"its materials read texture coordinates from {' and '.join(names)}",
            mesh.GetPrim(),
            hint="use one set of texture coordinates",
        )
    primvar = UsdGeom.PrimvarsAPI(mesh.GetPrim()).FindPrimvarWithInheritance(names[0])
    values = plain(primvar.ComputeFlattened() or ()) if primvar and primvar.HasValue() else ()
    if not values:
        hint = f"write texCoord2f[] primvars:{names[0]} with an interpolation"
        what = f'the material reads texture coordinates "{names[0]}", which <{mesh.GetPath()}> does not have'
        raise UnreadableValue(what, mesh.GetPrim(), hint=hint)
    return _at_corners(values, primvar.GetInterpolation(), shape, primvar.GetAttr(), 2)


def _at_corners(
    values: tuple[Numbers, ...], interpolation: str, shape: Fans, attribute: Usd.Attribute, size: int
) -> tuple[Numbers, ...]:
    """Values of a primvar, of so many numbers each, at the three corners of each triangle, one after the other."""
    if not values:
        return ()
    place: dict[str, Callable[[int, int], int]] = {
        UsdGeom.Tokens.constant: lambda face, corner: 0,
        UsdGeom.Tokens.uniform: lambda face, corner: face,
        UsdGeom.Tokens.faceVarying: lambda face, corner: corner,
    }
    index = place.get(interpolation, lambda face, corner: shape.indices[corner])
    try:
        found = np.array(values, float).reshape(len(values), size)
    except (TypeError, ValueError):
        raise UnreadableValue(
            f'"{attribute.GetName()}" holds something else than {size} numbers each', attribute
        ) from None
    rows = [[index(face, corner) for corner in fan] for face, fan in zip(shape.faces, shape.corners, strict=True)]
    if not np.isfinite(found).all() or (len(rows) and np.max(rows) >= len(found)):
        raise UnreadableValue(f'"{attribute.GetName()}" has {len(found)} values, too few for the faces', attribute)
    return tuple(map(tuple, (found[np.array(rows, int)].reshape(len(rows), -1) + 0.0).tolist()))
