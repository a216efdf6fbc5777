"""Checks of lamps: kinds and features of UsdLux that are not supported, scales, and values that change with time."""

from collections.abc import Iterator, Sequence, Set
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux

from pipeline.scene.read.lamps import KINDS, lamp_prims, read_lamp_entry, scale_of
from pipeline.scene.read.prims import frame_numbers
from pipeline.scene.usd.poses import world_from
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, target_paths

_IDLE: dict[str, tuple[Any, ...]] = {
    "inputs:diffuse": (1.0,),
    "inputs:specular": (1.0,),
    "inputs:texture:format": ("automatic", "latlong"),
    "collection:lightLink:includeRoot": (True,),
    "collection:shadowLink:includeRoot": (True,),
    "poleAxis": ("scene", "Y"),
    "treatAsLine": (False,),
    "treatAsPoint": (False,),
}
"""Attributes that only some values of are supported."""
_LINKS = (
    "light:filters",
    "portals",
    "collection:lightLink:includes",
    "collection:lightLink:excludes",
    "collection:shadowLink:includes",
    "collection:shadowLink:excludes",
)
"""Relationships that are not supported."""
_APIS = ("ShapingAPI", "ShadowAPI")
"""Schemas whose attributes are not supported."""
_OFF = 'take it out, or keep it from images with uniform token purpose = "guide"'
_EVEN = 1e-6
"""Deviation of a scale from the same in all directions that is accepted [1]: that of single precision."""


def check_lamps(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of the lamps of a dataset; `wrong` holds the prims with wrong values."""
    lamps, skies = lamp_prims(root.GetStage()), []
    frames = frame_numbers(root)
    for prim in lamps:
        found = [*_check_kind(prim), *_check_features(prim), *_check_still(prim)]
        yield from found
        if found or prim.GetPath() in wrong or not len(frames):
            continue
        yield from _check_scale(prim, frames)
        try:
            entry = read_lamp_entry(prim, frames)
        except UnreadableValue as error:
            yield problem(error.thing, error.code, error.what, hint=error.hint)
            continue
        if entry.lamp.texture:
            skies.append(prim)
        if entry.lamp.kind in ("rect", "disk", "sphere", "cylinder") and not entry.lamp.area > 0:
            yield problem(prim, "lamp-size", "a lamp without area shines nothing", hint="give it a size above 0")
    if len([prim for prim in lamps if prim.GetTypeName() in ("DomeLight", "DomeLight_1")]) > 1 and skies:
        message = "one sky with a picture at most, and no other dome beside it"
        yield problem(skies[-1], "not-yet-supported", message, hint="keep one DomeLight")


def _check_kind(prim: Usd.Prim) -> Iterator[Problem]:
    if str(prim.GetTypeName()) not in KINDS:
        known = ", ".join(KINDS)
        yield problem(
            prim,
            "not-yet-supported",
            f"lights of type {prim.GetTypeName()} are not supported",
            hint=(f"known are {known}; {_OFF}"),
        )


def _check_features(prim: Usd.Prim) -> Iterator[Problem]:
    for name, idle in _IDLE.items():
        attribute = prim.GetAttribute(name)
        if attribute and attribute.HasAuthoredValue() and attribute.Get() not in idle:
            message = f'"{name}" = {attribute.Get()} of a light is not supported'
            yield problem(attribute, "not-yet-supported", message, hint=f"write {idle[0]}, or leave it out")
    for name in _LINKS:
        relationship = prim.GetRelationship(name)
        if relationship and target_paths(relationship):
            message = f'"{name}" of a light is not supported: a lamp lights everything'
            yield problem(relationship, "not-yet-supported", message, hint="leave it out")
    for api in _APIS:
        names = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(api).GetPropertyNames()
        for name in names if api in prim.GetAppliedSchemas() else ():
            prop = prim.GetProperty(name)
            if prop and prop.IsAuthored():
                message = f'"{name}" of a light is not supported'
                yield problem(prop, "not-yet-supported", message, hint=f"leave out {api} and its attributes")
    picture = prim.GetAttribute("inputs:texture:file")
    if prim.IsA(UsdLux.RectLight) and picture and picture.HasAuthoredValue():
        yield problem(picture, "not-yet-supported", "pictures on a RectLight are not supported", hint="leave it out")
    up = UsdGeom.GetStageUpAxis(prim.GetStage())
    if (
        prim.GetTypeName() == "DomeLight_1"
        and up != UsdGeom.Tokens.y
        and prim.GetAttribute("poleAxis").Get() == "scene"
    ):
        hint = 'write uniform token poleAxis = "Y" and turn the dome'
        yield problem(prim, "not-yet-supported", f"a DomeLight_1 whose pole is {up} is not supported", hint=hint)


def _check_still(prim: Usd.Prim) -> Iterator[Problem]:
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetName().startswith("inputs:") and attribute.ValueMightBeTimeVarying():
            message = f'"{attribute.GetName()}" of a light is animated, and lamps shine evenly'
            hint = "animate its xformOps, or use one lamp per value and make it invisible in other frames"
            yield problem(attribute, "not-yet-supported", message, hint=hint)
        elif attribute.GetName().startswith("inputs:") and attribute.HasAuthoredConnections():
            message = f'"{attribute.GetName()}" of a light is connected, and lamps have values only'
            yield problem(attribute, "not-yet-supported", message, hint="write a value")


def _check_scale(prim: Usd.Prim, frames: Sequence[int]) -> Iterator[Problem]:
    stack = world_from(prim, tuple(frames), 1.0)
    scale = scale_of(stack[0])
    gram = (stack[:, :3, :3, None] * stack[:, :3, None, :3]).sum(axis=1)
    if not scale > 0 or np.abs(gram / scale**2 - np.eye(3)).max() > _EVEN:
        message = "the transform of a light scales unevenly, shears, or changes its scale with time"
        hint = "write its size instead: inputs:width, inputs:height, inputs:radius, inputs:length"
        yield problem(prim, "non-rigid", message, hint=hint)
