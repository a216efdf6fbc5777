"""Readers and checks of targets: pattern, surface or mesh, and spectra of ink and paper."""

import re
from collections.abc import Iterator, Set
from itertools import pairwise
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom

from pipeline.frames import apply
from pipeline.render.spectral.nodes import SpectrumError
from pipeline.render.spectral.prints import Print, Spectrum
from pipeline.scene.dataset import TargetEntry
from pipeline.scene.usd.meshes import Drawn, fans, polygons_of
from pipeline.scene.usd.poses import ancestry, stage_mm_per_unit, world_from
from pipeline.scene.usd.problems import Problem, not_drawn, of_reader, problem, warning
from pipeline.scene.usd.readers import read_once
from pipeline.scene.usd.values import UnreadableValue, fields_of, need, plain, read, target
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.patterns.pattern import TargetError
from pipeline.targets.target import PATTERNS, SURFACES, AnyTarget, Coat, Target

PREVIEW = "Preview"
"""Name of the preview mesh below a target."""
TYPES: dict[str, type[Any]] = {f"Plen{kind.__name__}": kind for kind in PATTERNS.values()}
"""The pattern of each type of prim."""

SHAPES = {re.sub("-(.)", lambda match: match[1].upper(), kind): surface for kind, surface in SURFACES.items()}
"""The surface of each plen:shape."""

OFF_MESH_MM = 1e-3
"""Distance of a marked point from its mesh above which there is a warning [mm]: its image would be elsewhere than the
truth.
"""


def is_preview(prim: Usd.Prim) -> bool:
    """Whether a prim is the preview of a target, written by us or in the library."""
    return bool(prim.GetName() == PREVIEW and prim.GetParent().IsA("PlenTarget"))


def is_in_preview(prim: Usd.Prim) -> bool:
    """Whether a prim is part of the preview of a target, such as its material."""
    if PREVIEW not in prim.GetPath().pathString:
        return False
    return any(is_preview(prim.GetStage().GetPrimAtPath(path)) for path in prim.GetPath().GetPrefixes())


def read_target_entries(stage: Usd.Stage) -> tuple[TargetEntry, ...]:
    """Every target on a stage that passed the checks, in stage order."""
    return tuple(read_target_entry(prim) for prim in stage.Traverse() if prim.IsA("PlenTarget"))


@read_once
def read_target_entry(prim: Usd.Prim) -> TargetEntry:
    """The entry of a PlenTarget."""
    roughness = read(prim, "plen:coat:roughness")
    coat = None if roughness is None else Coat(roughness=roughness, ior=need(prim, "plen:coat:ior"))
    return TargetEntry(
        name=prim.GetName(),
        prim_path=str(prim.GetPath()),
        target=read_target(prim),
        coat=coat,
        printed=Print(ink=_spectrum(prim, "ink"), paper=_spectrum(prim, "paper")),
    )


def _spectrum(prim: Usd.Prim, part: str) -> Spectrum:
    """The spectrum of the `ink` or the `paper` of a target: of a patch by name, or a table."""
    if patch := need(prim, f"plen:{part}:patch"):
        from pipeline.render.spectral.spectra import reflectance  # colour-science takes half a second to import

        wavelengths, values = reflectance(patch)
        return Spectrum(wavelengths_nm=tuple(wavelengths.tolist()), reflectance=tuple(values.tolist()))
    return Spectrum(
        wavelengths_nm=need(prim, f"plen:{part}:wavelengths"), reflectance=need(prim, f"plen:{part}:reflectance")
    )


@read_once
def read_target(prim: Usd.Prim) -> AnyTarget:
    """A target of any type; TargetError if its values contradict each other."""
    if prim.IsA("PlenMeshTarget"):
        return _read_mesh_target(prim)
    pattern, surface = TYPES[str(prim.GetTypeName())], SHAPES[need(prim, "plen:shape")]
    return Target(pattern(**fields_of(prim, pattern)), surface(**fields_of(prim, surface)))


def _read_mesh_target(prim: Usd.Prim) -> MeshTarget:
    """The record of a PlenMeshTarget: triangles in the target frame, with colours as radiance at their corners."""
    mesh_prim = target(prim, "plen:mesh", "Mesh")
    if mesh_prim is None:
        raise UnreadableValue('"plen:mesh" has to name one Mesh', prim.GetRelationship("plen:mesh") or prim)
    mesh = UsdGeom.Mesh(mesh_prim)
    scale_mm = stage_mm_per_unit(prim)
    white = need(prim, "plen:white")
    shape = fans(mesh)
    # Affine, because the mesh may be scaled; a mesh does not move on its target, so any time will do.
    vertices_mm = apply(world_from(mesh_prim, [0.0], scale_mm, prim)[0], shape.points * scale_mm)
    return MeshTarget(
        # + 0.0 turns -0.0 into 0.0: keys must not differ by it.
        vertices_mm=tuple((x, y, z) for x, y, z in (vertices_mm + 0.0).tolist()),
        triangles=tuple(map(tuple, shape.triangles.tolist())),
        albedo=tuple(tuple(white * shade for shade in row) for row in _colours(mesh, shape)),  # type: ignore[misc]
        points_mm=need(prim, "plen:points"),
        normals=need(prim, "plen:normals"),
    )


def _colours(mesh: UsdGeom.Mesh, shape: Drawn) -> list[tuple[float, ...]]:
    """First component of the display colour at the corners of each triangle; 1 without display colour."""
    colour = UsdGeom.PrimvarsAPI(mesh.GetPrim()).GetPrimvar("displayColor")
    values = plain(colour.ComputeFlattened() or ()) if colour and colour.HasValue() else ()
    if not values:
        return [(1.0, 1.0, 1.0)] * len(shape.corners)
    return [tuple(row) for row in shape.at_corners(np.array(values), colour.GetInterpolation())[:, :, 0].tolist()]


def check_target(prim: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of a PlenTarget as a whole; `wrong` holds the prims with wrong values."""
    preview = prim.GetChild(PREVIEW)
    for flaw in polygons_of(preview, None).flaws if preview and preview.IsA(UsdGeom.Mesh) else ():
        yield not_drawn(preview, f"<{preview.GetPath()}>: {flaw}", "mend or delete it: viewers show it, no image does")
    mesh = target(prim, "plen:mesh", "Mesh") if prim.IsA("PlenMeshTarget") else None
    parts = [*(_check_mesh(prim, mesh) if mesh else ()), *_check_print(prim)]
    if prim.IsA("PlenMeshTarget") and (shape := read(prim, "plen:shape")) not in ("flat", None):
        message = f'a mesh has its own shape, and "plen:shape" is {shape}'
        parts.insert(0, problem(prim.GetAttribute("plen:shape"), "shape-value", message, hint="remove it"))
    yield from parts
    if parts or prim.GetPath() in wrong or (mesh and mesh.GetPath() in wrong):
        return
    try:
        record = read_target(prim)
    except UnreadableValue as error:
        yield of_reader(prim, error)
        return
    except (ValueError, IndexError):
        message = "the mesh has colours or faces that do not fit its points"
        yield problem(prim, "bad-mesh", message, hint="check faceVertexCounts, faceVertexIndices and displayColor")
        return
    except TargetError as error:
        yield problem(prim, error.code, error.message, hint=error.hint)
        return
    white = prim.GetAttribute("plen:white")
    if isinstance(record, MeshTarget):
        if not np.any(record.albedo):
            message = "the mesh is dark all over: its images are black"
            yield warning(white, "no-contrast", message, hint="write a plen:white and colours above 0")
        yield from _check_on_mesh(prim, record)
        if mesh:
            yield from _check_scheme(mesh)
    elif record.pattern.white == record.pattern.black:
        message = f"white and black of the pattern are the same, {record.pattern.white:g}: its images show no pattern"
        yield warning(white, "no-contrast", message, hint="the fallbacks are 1 and 0")


def _check_print(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of the spectra of ink and paper."""
    for part in ("ink", "paper"):
        yield from _check_patch(prim, part)
        table, values = (read(prim, f"plen:{part}:{name}") or () for name in ("wavelengths", "reflectance"))
        attribute = prim.GetAttribute(f"plen:{part}:wavelengths")
        if len(table) != len(values):
            message = f"the {part} has {len(table)} wavelengths and {len(values)} reflectances"
            yield problem(attribute, "spectrum", message, hint="one reflectance for each wavelength")
        elif any(a >= b for a, b in pairwise(table)):
            yield problem(attribute, "spectrum", f"the wavelengths of the {part} do not ascend", hint="sort them")
        elif table and prim.IsA("PlenMeshTarget"):
            message = f"a mesh has colours of its own, and the {part} a spectrum"
            yield problem(attribute, "not-yet-supported", message, hint="leave the spectrum out")


def _check_patch(prim: Usd.Prim, part: str) -> Iterator[Problem]:
    """Problems of a patch by name for the `ink` or the `paper`."""
    patch = read(prim, f"plen:{part}:patch")
    attribute = prim.GetAttribute(f"plen:{part}:patch")
    if not patch:
        return
    if read(prim, f"plen:{part}:wavelengths") or read(prim, f"plen:{part}:reflectance"):
        hint = f'either "plen:{part}:patch" or a table'
        yield problem(attribute, "spectrum", f"the {part} has a patch and a table", hint=hint)
    elif prim.IsA("PlenMeshTarget"):
        message = f"a mesh has colours of its own, and the {part} a patch"
        yield problem(attribute, "not-yet-supported", message, hint="leave the patch out")
    else:
        from pipeline.render.spectral.spectra import reflectance  # colour-science takes half a second to import

        try:
            reflectance(patch)
        except SpectrumError as error:
            yield problem(attribute, error.code, error.message, hint=error.hint)


def _check_mesh(prim: Usd.Prim, mesh: Usd.Prim) -> Iterator[Problem]:
    """Problems of a mesh that does not move with its target, or is animated."""
    relationship = prim.GetRelationship("plen:mesh")
    if prim not in ancestry(mesh):
        message = f"<{mesh.GetPath()}> does not lie below its target <{prim.GetPath()}>"
        yield problem(relationship, "bad-mesh", message, hint="a mesh moves with its target: put it below")
    elif any(attribute.ValueMightBeTimeVarying() for attribute in mesh.GetAuthoredAttributes()):
        yield problem(relationship, "not-yet-supported", f"<{mesh.GetPath()}> is animated, and targets are rigid")


def _check_scheme(mesh: Usd.Prim) -> Iterator[Problem]:
    """A warning of a mesh with a subdivision scheme: a target is its polygons, on which its points lie."""
    attribute = UsdGeom.Mesh(mesh).GetSubdivisionSchemeAttr()
    if (scheme := attribute.Get()) in (UsdGeom.Tokens.catmullClark, UsdGeom.Tokens.loop):
        by = "" if attribute.HasAuthoredValue() else ", USD's fallback"
        message = f"<{mesh.GetPath()}> asks for {scheme} subdivision{by}; a target is its polygons as they stand"
        hint = 'write uniform token subdivisionScheme = "none", or the subdivided mesh'
        yield not_drawn(attribute if not by else mesh, message, hint=hint)


def _check_on_mesh(prim: Usd.Prim, record: MeshTarget) -> Iterator[Problem]:
    """A warning of marked points that do not lie on their mesh."""
    distances = record.distances_mm()
    beside = [(float(distance), index) for index, distance in enumerate(distances) if distance > OFF_MESH_MM]
    if beside:
        distance, index = max(beside)
        message = (
            f"{len(beside)} of {len(distances)} marked points do not lie on the mesh; point {index} is"
            f" {distance:.4g} mm off"
        )
        hint = "images show the mesh, and the ground truth uses the points"
        yield warning(prim.GetAttribute("plen:points"), "off-mesh", message, hint=hint)
