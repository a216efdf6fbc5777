"""Warnings about differences from a USD viewer: geometry that it shows and no image has, targets that
images have and it does not show.
"""

from collections.abc import Iterator, Sequence

from pxr import Sdf, Usd, UsdGeom

from pipeline.scene.read.finishes import seen_meshes
from pipeline.scene.read.lamps import lamp_prims
from pipeline.scene.read.occluders import is_visible
from pipeline.scene.read.prims import frame_numbers
from pipeline.scene.read.targets import is_preview
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import target_paths, targets
from pipeline.spelling import frames_in_words

_MOST_KINDS = 8
"""Number of types of prims with a warning of their own: scenes made elsewhere have dozens, and errors must stay in
sight.
"""
_MOST_PATHS = 4
"""Number of prims that the warning about a type lists; further ones are counted."""
_AIDS = 'what is there for viewers alone says so with uniform token purpose = "guide"'


def check_unnamed(root: Usd.Prim) -> Iterator[Problem]:
    """One warning per type of prim that is in the stage of a dataset but has no effect on its images.

    Previews of targets, prims with the purposes guide and proxy, and prims invisible in all frames are left out.
    """
    named = _named(root.GetStage())
    frames = frame_numbers(root)
    lit = {prim.GetPath() for prim in (*lamp_prims(root.GetStage()), *seen_meshes(root))}
    kinds: dict[str, list[Usd.Prim]] = {}
    for prim in Usd.PrimRange(root.GetStage().GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        is_left_out = _is_geometry(prim) and prim.GetPath() not in named and not is_preview(prim)
        if is_left_out and prim.GetPath() not in lit and _is_shown(prim, frames):
            kinds.setdefault(prim.GetTypeName(), []).append(prim)
    for kind, prims in list(kinds.items())[:_MOST_KINDS]:
        yield _left_out(kind, prims)


def check_invisible(root: Usd.Prim) -> Iterator[Problem]:
    """A warning for each target that is invisible in USD in some frames, although images and truth have it in all."""
    frames = frame_numbers(root)
    for prim in targets(root, "plen:targets", "PlenTarget"):
        if _comes_and_goes(prim):
            hidden = [number for number in frames if not is_visible(prim, float(number))]
        else:
            hidden = [] if all(is_visible(prim, float(number)) for number in frames[:1]) else list(frames)
        if hidden:
            number = f"{len(hidden)} of {len(frames)} frames: {frames_in_words(hidden)}"
            message = f'"{prim.GetName()}" is invisible in {number}; its images and ground truth are made all the same'
            hint = "take it out of rel plen:targets, list other plen:frames, or make it visible"
            yield problem(prim, "invisible-target", message, hint=hint, severity="warning")


def _left_out(kind: str, prims: list[Usd.Prim]) -> Problem:
    paths = ", ".join(f"<{prim.GetPath()}>" for prim in prims[:_MOST_PATHS])
    more = f" and {len(prims) - _MOST_PATHS} more" if len(prims) > _MOST_PATHS else ""
    message = f"{kind} {paths}{more} is in no image: no relationship names it"
    what = "name it in" if kind == "Mesh" else "make it a Mesh and name that in"
    hint = f"{what} rel plen:occluders of the dataset, or plen:mesh of a PlenMeshTarget; {_AIDS}"
    return problem(prims[0], "not-in-image", message, hint=hint, severity="warning")


def _named(stage: Usd.Stage) -> set[Sdf.Path]:
    """All targets of our relationships; problems of these prims are reported elsewhere."""
    relationships = [
        relationship
        for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies())
        for relationship in prim.GetAuthoredRelationships()
        if relationship.GetName().startswith("plen:")
    ]
    return {path for relationship in relationships for path in target_paths(relationship)}


def _is_geometry(prim: Usd.Prim) -> bool:
    return bool(prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer))


def _is_shown(prim: Usd.Prim, frames: Sequence[int]) -> bool:
    if UsdGeom.Imageable(prim).ComputePurpose() in (UsdGeom.Tokens.guide, UsdGeom.Tokens.proxy):
        return False
    return any(is_visible(prim, float(number)) for number in (frames if _comes_and_goes(prim) else frames[:1]))


def _comes_and_goes(prim: Usd.Prim) -> bool:
    """Whether a prim may be visible in some frames and invisible in others."""
    above = (prim.GetStage().GetPrimAtPath(path) for path in prim.GetPath().GetPrefixes())
    return any(one.GetAttribute("visibility").ValueMightBeTimeVarying() for one in above)
