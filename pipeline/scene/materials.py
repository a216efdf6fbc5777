"""Materials of the meshes of a lit scene, with their normals and texture coordinates, and which meshes these are."""

from collections.abc import Iterator, Set

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from pipeline.render.lighting.records import Finish, Numbers
from pipeline.scene.lamps import is_in_images, is_lit
from pipeline.scene.shaders import Wanted, primvar_of, remarks_on, shades
from pipeline.scene.targets import is_preview
from pipeline.scene.usd.meshes import Fans, fans
from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import UnreadableValue, plain, read, read_once, targets


def seen_meshes(root: Usd.Prim) -> list[Usd.Prim]:
    """Meshes besides targets that images of a dataset show: those that it names, and with lamps all others, too."""
    named = targets(root, "plen:occluders", "Mesh")
    stage = root.GetStage()
    if not is_lit(stage):
        return named
    taken = {mesh for prim in stage.Traverse() for mesh in targets(prim, "plen:mesh", "Mesh")}
    others = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh) and prim not in named and prim not in taken]
    return named + [prim for prim in others if is_in_images(prim) and not is_preview(prim)]


@read_once
def read_finish(prim: Usd.Prim) -> Finish:
    """The materials of a Mesh, with its normals and texture coordinates; UnreadableValue if any cannot be used."""
    mesh, (shaded, of_face) = UsdGeom.Mesh(prim), shades(prim)
    shape = fans(mesh)
    wanted = {each.name: each for shade in shaded for each in shade.primvars}
    return Finish(
        materials=tuple(each.material for each in shaded),
        material_of=tuple(of_face.get(face, 0) for face in shape.faces) if of_face else (),
        normals=_normals(mesh, shape),
        primvars={name: _primvar(mesh, shape, each) for name, each in sorted(wanted.items())},
    )


def _normals(mesh: UsdGeom.Mesh, shape: Fans) -> tuple[Numbers, ...]:
    """Authored normals at the corners of all triangles; none: flat ones."""
    primvar = UsdGeom.PrimvarsAPI(mesh.GetPrim()).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        values, interpolation, attribute = primvar.ComputeFlattened(), primvar.GetInterpolation(), primvar.GetAttr()
    else:
        attribute = mesh.GetNormalsAttr()
        values, interpolation = attribute.Get(), mesh.GetNormalsInterpolation()
    return _at_corners(plain(values or ()), interpolation, shape, attribute, 3)


def _primvar(mesh: UsdGeom.Mesh, shape: Fans, wanted: Wanted) -> tuple[Numbers, ...]:
    """Values of a primvar at the corners of all triangles; its fallback without one."""
    primvar = primvar_of(mesh.GetPrim(), wanted)
    if primvar is None:
        return (wanted.fallback * 3,) * len(shape.corners)
    values, size = plain(primvar.ComputeFlattened(Usd.TimeCode.EarliestTime())), len(wanted.fallback)
    return _at_corners(values, primvar.GetInterpolation(), shape, primvar.GetAttr(), size)


def _at_corners(
    values: tuple[Numbers, ...], interpolation: str, shape: Fans, attribute: Usd.Attribute, size: int
) -> tuple[Numbers, ...]:
    """Values of a primvar, of so many numbers each, at the three corners of each triangle, one after the other."""
    if not values:
        return ()
    try:
        table = np.array(values, float).reshape(len(values), size)
    except (TypeError, ValueError):
        what = f'"{attribute.GetName()}" holds something else than {size} numbers each'
        raise UnreadableValue(what, attribute) from None
    rows = shape.places(interpolation)
    if not np.isfinite(table).all() or (len(rows) and np.max(rows) >= len(table)):
        raise UnreadableValue(f'"{attribute.GetName()}" has {len(table)} values, too few for the faces', attribute)
    return tuple(map(tuple, (table[np.array(rows, int)].reshape(len(rows), -1) + 0.0).tolist()))


def check_finishes(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of meshes and targets that depend on whether lamps light them; `wrong` holds prims with wrong values."""
    has_light = is_lit(root.GetStage())
    for prim in targets(root, "plen:targets", "PlenTarget"):
        coat = prim.GetAttribute("plen:coat:roughness")
        if not has_light and coat and coat.HasAuthoredValue():
            message = "the coat of a target is not seen, because the dataset has no lamp"
            hint = "add a light of UsdLux, such as a RectLight"
            yield problem(coat, "unused-value", message, hint=hint, severity="warning")
        for name in ("plen:white", "plen:black") if has_light else ():
            if (read(prim, name) or 0.0) > 1:
                message = f'"{name}" = {read(prim, name):g} of a target that lamps light is a reflectance, at most 1'
                hint = "make the lamps brighter instead"
                yield problem(prim.GetAttribute(name), "reflectance", message, hint=hint)
    remarks = dict[Problem, None]()  # meshes share materials
    for prim in seen_meshes(root) if has_light else ():
        scheme = UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr()
        if prim.GetPath() in wrong:
            continue
        if scheme.Get() != UsdGeom.Tokens.none:
            message = f'"subdivisionScheme" is {scheme.Get()}, and surfaces are not subdivided'
            yield problem(scheme, "not-yet-supported", message, hint='write uniform token subdivisionScheme = "none"')
            continue
        try:
            read_finish(prim)
            remarks |= dict.fromkeys(remarks_on(prim))
        except UnreadableValue as error:
            yield problem(error.thing, error.code, error.what, hint=error.hint)
        except ValueError:
            continue  # faces that contradict each other are reported elsewhere
    yield from remarks
