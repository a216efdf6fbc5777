"""Checks of targets: values of the shape, the pattern on its surface, marked points off their mesh."""

from collections.abc import Iterator, Set
from itertools import pairwise

import numpy as np
from pxr import Sdf, Usd

from pipeline.render.spectral.nodes import SpectrumError
from pipeline.scene.check.occluders import check_skin
from pipeline.scene.read.targets import read_target
from pipeline.scene.usd.hints import of_reader
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read, target
from pipeline.targets.mesh import MeshTarget
from pipeline.targets.patterns.pattern import TargetError
from pipeline.targets.target import AnyTarget

OFF_MESH_MM = 1e-3
"""Distance of a marked point from its mesh above which there is a warning [mm]: its image would not be where the
truth says.
"""


def check_target(prim: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of a PlenTarget as a whole; `wrong` holds the prims with wrong values."""
    parts = [*_check_shape(prim), *_check_mesh(prim), *_check_print(prim)]
    yield from parts
    mesh = target(prim, "plen:mesh", "Mesh") if prim.IsA("PlenMeshTarget") else None
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
        yield problem(prim, error.code, error.what, hint=error.hint)
        return
    yield from _check_contrast(prim, record)
    if isinstance(record, MeshTarget):
        yield from _check_on_mesh(prim, record)


def _check_contrast(prim: Usd.Prim, record: AnyTarget) -> Iterator[Problem]:
    """A warning if a target is uniformly dark or bright, so that its pattern is invisible."""
    white = prim.GetAttribute("plen:white")
    if isinstance(record, MeshTarget):
        if not np.any(record.albedo):
            message = "the mesh is dark all over: its images are black"
            yield problem(
                white, "no-contrast", message, hint="write a plen:white and colours above 0", severity="warning"
            )
    elif record.pattern.white == record.pattern.black:
        message = f"white and black of the pattern are the same, {record.pattern.white:g}: its images show no pattern"
        yield problem(white, "no-contrast", message, hint="the fallbacks are 1 and 0", severity="warning")


def _check_shape(prim: Usd.Prim) -> Iterator[Problem]:
    """A problem if a shape is stated for a mesh target."""
    shape = read(prim, "plen:shape")
    if prim.IsA("PlenMeshTarget") and shape not in ("flat", None):
        message = f'a mesh has its own shape, and "plen:shape" is {shape}'
        yield problem(prim.GetAttribute("plen:shape"), "shape-value", message, hint="remove it")


def _check_print(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of spectra of ink and paper that are none."""
    for what in ("ink", "paper"):
        yield from _check_patch(prim, what)
        table, values = (read(prim, f"plen:{what}:{name}") or () for name in ("wavelengths", "reflectance"))
        place = prim.GetAttribute(f"plen:{what}:wavelengths")
        if len(table) != len(values):
            message = f"the {what} has {len(table)} wavelengths and {len(values)} reflectances"
            yield problem(place, "spectrum", message, hint="one reflectance for each wavelength")
        elif any(a >= b for a, b in pairwise(table)):
            yield problem(place, "spectrum", f"the wavelengths of the {what} do not ascend", hint="sort them")
        elif table and prim.IsA("PlenMeshTarget"):
            message = f"a mesh has colours of its own, and the {what} a spectrum"
            yield problem(place, "not-yet-supported", message, hint="leave the spectrum out")


def _check_patch(prim: Usd.Prim, what: str) -> Iterator[Problem]:
    """Problems of the patch of the ColorChecker that an ink or a paper is said to be."""
    patch, place = read(prim, f"plen:{what}:patch"), prim.GetAttribute(f"plen:{what}:patch")
    if not patch:
        return
    if read(prim, f"plen:{what}:wavelengths") or read(prim, f"plen:{what}:reflectance"):
        message, hint = f"the {what} has a patch and a table", f'either "plen:{what}:patch" or a table'
        yield problem(place, "spectrum", message, hint=hint)
    elif prim.IsA("PlenMeshTarget"):
        message = f"a mesh has colours of its own, and the {what} a patch"
        yield problem(place, "not-yet-supported", message, hint="leave the patch out")
    else:
        from pipeline.render.spectral.spectra import reflectance  # colour-science takes half a second to import

        try:
            reflectance(patch)
        except SpectrumError as error:
            yield problem(place, error.code, error.what, hint=error.hint)


def _check_mesh(prim: Usd.Prim) -> Iterator[Problem]:
    """Problems of a mesh that would not move with its target, or that would move relative to it."""
    mesh = target(prim, "plen:mesh", "Mesh") if prim.IsA("PlenMeshTarget") else None
    if mesh is None:
        return
    relationship = prim.GetRelationship("plen:mesh")
    if not mesh.GetPath().HasPrefix(prim.GetPath()):
        message = f"<{mesh.GetPath()}> does not lie below its target <{prim.GetPath()}>"
        yield problem(relationship, "bad-mesh", message, hint="a mesh moves with its target: put it below")
    elif any(attribute.ValueMightBeTimeVarying() for attribute in mesh.GetAuthoredAttributes()):
        yield problem(relationship, "not-yet-supported", f"<{mesh.GetPath()}> is animated, and targets are rigid")
    else:
        yield from check_skin(mesh)


def _check_on_mesh(prim: Usd.Prim, record: MeshTarget) -> Iterator[Problem]:
    distances = record.distances_mm()
    off = [(float(distance), index) for index, distance in enumerate(distances) if distance > OFF_MESH_MM]
    if off:
        distance, index = max(off)
        which = f"{len(off)} of {len(distances)} marked points do not lie on the mesh"
        message = f"{which}; point {index} is {distance:.4g} mm off"
        hint = "images show the mesh, and the ground truth uses the points"
        yield problem(prim.GetAttribute("plen:points"), "off-mesh", message, hint=hint, severity="warning")
