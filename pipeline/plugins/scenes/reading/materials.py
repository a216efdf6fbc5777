"""Readers and checks of finishes: the materials of a mesh, with normals and primvars at its corners."""

import math
from collections.abc import Hashable, Iterator, Set
from functools import partial
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdShade

from pipeline.plugins.scenes.lighting.records import Finish, Numbers
from pipeline.plugins.scenes.reading.lamps import is_lit
from pipeline.plugins.scenes.reading.shaders import Wanted, primvar_of, remarks_on, shades, values_of
from pipeline.scene.occluders import shapes_in_images
from pipeline.scene.usd.meshes import Drawn, alike, appearance_key, drawn, likeness_with_above
from pipeline.scene.usd.problems import Problem, not_drawn, of_reader, problem, warning
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, plain, read, target_paths, targets


@partial(read_once, named=appearance_key)
def _shaded_as(prim: Usd.Prim) -> Hashable:
    """Key of the materials of a shape and of what it inherits."""
    shaded, of_face = shades(prim)
    return likeness_with_above(prim), tuple(each.material for each in shaded), tuple(of_face.items())


def _named(prim: Usd.Prim, frame: int | None = None) -> Hashable:
    """Key of the finish of a shape: all that it depends on, inherited primvars too."""
    return _shaded_as(prim) if frame is None else (prim, frame)


@partial(read_once, named=_named)
def read_finish(prim: Usd.Prim, frame: int | None = None) -> Finish:
    """The materials of a shape in a frame, with its normals and primvars; UnreadableValue if any cannot be used."""
    shape, (shaded, of_face) = drawn(prim, frame), shades(prim)
    normals, primvars, _ = _carried(prim, frame)
    return Finish(
        materials=tuple(each.material for each in shaded),
        material_of=np.array([of_face.get(face, 0) for face in shape.faces.tolist()], int) if of_face else None,
        normals=normals,
        primvars=primvars,
    )


@partial(read_once, named=_named)
def _carried(
    prim: Usd.Prim, frame: int | None = None
) -> tuple[np.ndarray | None, dict[str, np.ndarray], list[Problem]]:
    """Normals and primvars at the corners of all triangles, and warnings of those that do not fit the shape."""
    shape = drawn(prim, frame)
    time = Usd.TimeCode.EarliestTime() if frame is None else Usd.TimeCode(frame)
    wanted = {primvar.name: primvar for shade in shades(prim)[0] for primvar in shade.primvars}
    flaws = list[Problem]()
    primvars = dict[str, np.ndarray]()
    normals = None
    try:
        normals = _normals(prim, shape, time)
    except UnreadableValue as error:
        flaws.append(_ignored(error))
    for name, primvar in sorted(wanted.items()):
        flaws += _several(prim, primvar, time)
        try:
            primvars[name] = _primvar(prim, shape, primvar, time)
        except UnreadableValue as error:
            flaws.append(_ignored(error))
            primvars[name] = np.tile(primvar.fallback, (len(shape.corners), 3))
    return normals, primvars, flaws


def _several(prim: Usd.Prim, wanted: Wanted, time: Usd.TimeCode) -> list[Problem]:
    """A warning of a primvar that is constant on its shape, and has several values."""
    primvar = primvar_of(prim, wanted)
    if primvar is None or primvar.GetInterpolation() != UsdGeom.Tokens.constant:
        return []
    if (count := len(values_of(primvar, time))) < 2:
        return []
    attribute = primvar.GetAttr()
    message = f'"{attribute.GetName()}" has {count} values and is constant: the first one counts everywhere'
    return [not_drawn(attribute, message, "write its interpolation: uniform, vertex, varying or faceVarying")]


def _ignored(error: UnreadableValue) -> Problem:
    # Not the error itself: its frames would hold the stage after an edit.
    hint = "faces are drawn flat without normals, and plain without values"
    return not_drawn(error.thing, f"{error.message}: it is ignored", hint=hint)


def _normals(prim: Usd.Prim, shape: Drawn, time: Usd.TimeCode) -> np.ndarray | None:
    """Normals at the corners of all triangles: of the smooth surface, or authored ones; None: flat ones."""
    if shape.is_smooth:
        return None if shape.normals is None else _rows(shape.normals[shape.corners])
    primvar = UsdGeom.PrimvarsAPI(prim).GetPrimvar("normals")
    if primvar and primvar.HasAuthoredValue():
        values, interpolation, attribute = primvar.ComputeFlattened(time), primvar.GetInterpolation(), primvar.GetAttr()
    else:
        mesh = UsdGeom.PointBased(prim)
        attribute = mesh.GetNormalsAttr()
        values, interpolation = attribute.Get(time), mesh.GetNormalsInterpolation()
    return _at_corners(plain(values), interpolation, shape, attribute, 3) if values else None


def _primvar(prim: Usd.Prim, shape: Drawn, wanted: Wanted, time: Usd.TimeCode) -> np.ndarray:
    """Values of a primvar at the corners of all triangles; without one the coordinates of a solid, or its fallback."""
    primvar = primvar_of(prim, wanted)
    size = len(wanted.fallback)
    if primvar is not None:
        return _at_corners(values_of(primvar, time), primvar.GetInterpolation(), shape, primvar.GetAttr(), size)
    if shape.st is not None and size == shape.st.shape[1]:
        return _rows(shape.st[shape.corners])
    return np.tile(wanted.fallback, (len(shape.corners), 3))


def _at_corners(
    values: tuple[Numbers, ...], interpolation: str, shape: Drawn, attribute: Usd.Attribute, size: int
) -> np.ndarray:
    """Values of `size` components at the corners of each triangle, (t, 3 size)."""
    try:
        table = np.array(values, float).reshape(len(values), size)
    except (TypeError, ValueError):
        message = f'"{attribute.GetName()}" holds something else than {size} numbers each'
        raise UnreadableValue(message, attribute) from None
    primvar = UsdGeom.Primvar(attribute)
    indices = np.asarray(primvar.GetIndices(), int) if primvar and primvar.IsIndexed() else None
    try:
        if not np.isfinite(table).all():
            raise IndexError
        return _rows(shape.at_corners(table, interpolation, indices))
    except IndexError:
        flaw = (
            f"{len(table)} values, which do not fit its shape" if values else "indices of values that it does not have"
        )
        message = f'"{attribute.GetName()}" has {flaw}'
        raise UnreadableValue(message, attribute) from None


def _rows(corners: np.ndarray) -> np.ndarray:
    return corners.reshape(len(corners), math.prod(corners.shape[1:])) + 0.0


def check_finishes(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of meshes and targets that depend on whether lamps light them; `wrong` holds prims with wrong values."""
    has_light = is_lit(root.GetStage())
    for prim in targets(root, "plen:targets", "PlenTarget"):
        coat = prim.GetAttribute("plen:coat:roughness")
        if not has_light and coat and coat.HasAuthoredValue():
            message = "the coat of a target is not seen, because the dataset has no lamp"
            yield warning(coat, "unused-value", message, hint="add a light of UsdLux, such as a RectLight")
        for name in ("plen:white", "plen:black") if has_light else ():
            if (read(prim, name) or 0.0) > 1:
                message = f'"{name}" = {read(prim, name):g} of a target that lamps light is a reflectance, at most 1'
                yield problem(prim.GetAttribute(name), "reflectance", message, hint="make the lamps brighter instead")
    remarks = dict[Problem, None]()  # meshes share materials
    lit = (prim for prim in shapes_in_images(root) if has_light and prim.GetPath() not in wrong)
    waiting = alike(lit, appearance_key)
    blamed = set[Any]()
    while waiting:
        first, *rest = waiting[0]
        try:
            read_finish(first)
            of_first = [*remarks_on(first), *_carried(first)[2]]
            of_rest = [remark for prim in rest if of_first for remark in remarks_on(prim)]
            remarks |= dict.fromkeys(of_first + of_rest)
        except UnreadableValue as error:
            if error.thing not in blamed:
                blamed.add(error.thing)
                yield of_reader(error.thing, error)
                continue  # with its next value: one in a third-party layer counts as not written from now on
        waiting.pop(0)
    yield from remarks
    for prim in root.GetStage().Traverse() if has_light else ():
        yield from _not_bound(prim)


def _not_bound(prim: Usd.Prim) -> Iterator[Problem]:
    """Warnings of bindings that name something else than a Material, which USD ignores."""
    for purpose in (UsdShade.Tokens.allPurpose, UsdShade.Tokens.full, UsdShade.Tokens.preview):
        binding = UsdShade.MaterialBindingAPI(prim).GetDirectBindingRel(purpose)
        for path in target_paths(binding):
            named = prim.GetStage().GetPrimAtPath(path)
            if named and not named.IsA(UsdShade.Material):
                message = f'"{binding.GetName()}" names <{path}>, which is a {named.GetTypeName()}: it binds nothing'
                yield not_drawn(binding, message, "name the Material")
