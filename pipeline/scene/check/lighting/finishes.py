"""Checks of what lamps light: subdivision surfaces, materials that are not supported, reflectances above 1."""

from collections.abc import Iterator, Set

from pxr import Sdf, Usd, UsdGeom

from pipeline.scene.read.finishes import read_finish, seen_meshes
from pipeline.scene.read.lamps import lamp_prims
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read, targets


def check_finishes(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of meshes and targets that depend on whether lamps light them; `wrong` holds prims with wrong values."""
    is_lit = bool(lamp_prims(root.GetStage()))
    for prim in targets(root, "plen:targets", "PlenTarget"):
        yield from _check_target(prim) if is_lit else _check_unlit(prim)
    for prim in seen_meshes(root) if is_lit else ():
        if prim.GetPath() not in wrong:
            yield from _check_mesh(prim)


def _check_target(prim: Usd.Prim) -> Iterator[Problem]:
    for name in ("plen:white", "plen:black"):
        value = read(prim, name)
        if value is not None and value > 1:
            message = f'"{name}" = {value:g} of a target that lamps light is a reflectance, at most 1'
            hint = "make the lamps brighter instead"
            yield problem(prim.GetAttribute(name), "reflectance", message, hint=hint)


def _check_unlit(prim: Usd.Prim) -> Iterator[Problem]:
    coat = prim.GetAttribute("plen:coat:roughness")
    if coat and coat.HasAuthoredValue():
        message = "the coat of a target is not seen, because the dataset has no lamp"
        hint = "add a light of UsdLux, such as a RectLight"
        yield problem(coat, "unused-value", message, hint=hint, severity="warning")


def _check_mesh(prim: Usd.Prim) -> Iterator[Problem]:
    mesh = UsdGeom.Mesh(prim)
    scheme = mesh.GetSubdivisionSchemeAttr()
    if scheme.Get() != UsdGeom.Tokens.none:
        message = f'"subdivisionScheme" is {scheme.Get()}, and surfaces are not subdivided'
        yield problem(scheme, "not-yet-supported", message, hint='write uniform token subdivisionScheme = "none"')
        return
    try:
        read_finish(prim)
    except UnreadableValue as error:
        yield problem(error.thing, error.code, error.what, hint=error.hint)
    except ValueError:
        return  # faces that contradict each other are reported elsewhere
