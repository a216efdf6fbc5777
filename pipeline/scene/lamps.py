"""Lamps, which are lights of UsdLux: those that are supported, and whether they shine on any target."""

import math
from collections.abc import Iterator, Sequence, Set
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux

from pipeline.frames import apply
from pipeline.records.shapes import Float64
from pipeline.render.lighting.records import Lamp, Rgb
from pipeline.scene.dataset import Dataset, Frame, LampEntry, TargetEntry
from pipeline.scene.pictures import is_picture, name_of, picture_of
from pipeline.scene.usd.poses import comes_and_goes, frame_numbers, is_visible, stage_mm_per_unit, world_from
from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import UnreadableValue, need, take, target_paths
from pipeline.spelling import frames_in_words

KINDS = {
    "RectLight": ("rect", ("inputs:width", "inputs:height"), (0.5, 0.5)),
    "DiskLight": ("disk", ("inputs:radius",), (1.0,)),
    "SphereLight": ("sphere", ("inputs:radius",), (1.0,)),
    "CylinderLight": ("cylinder", ("inputs:length", "inputs:radius"), (0.5, 1.0)),
    "DistantLight": ("distant", ("inputs:angle",), (0.5,)),
    "DomeLight": ("dome", (), ()),
    "DomeLight_1": ("dome", (), ()),
}
"""Kind of the record, attributes of its size, and factors of these, by type of prim."""
_ANY_TIME = 0.0
"""Time code at which a visibility is read that never changes."""
_BRIGHTEST = 1e30
"""Largest radiance of a lamp [1]: images are single precision, and sums of many rays must fit."""
_SHOWN = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
"""Purposes of what is in images."""

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
_POINTS_ASKED = 64
"""Most points of a target that are asked."""
_DIRECTED = "rects, disks and distant lamps shine along their -Z; the front of a target is its +Z"


def is_in_images(prim: Usd.Prim) -> bool:
    """Whether a prim has a purpose with which it is in images, and is not invisible for ever."""
    return UsdGeom.Imageable(prim).ComputePurpose() in _SHOWN and (comes_and_goes(prim) or is_visible(prim, _ANY_TIME))


def lamp_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """Lights that count, of any kind, in stage order: neither for viewers alone, nor invisible for ever."""
    return [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI) and is_in_images(prim)]


def read_lamp_entry(prim: Usd.Prim, times: Sequence[float]) -> LampEntry:
    """A light of a kind in `KINDS`; its size does not change with time."""
    take(prim.GetPath())
    kind, names, factors = KINDS[str(prim.GetTypeName())]
    unit_mm = stage_mm_per_unit(prim)
    numbers = [need(prim, name) * factor for name, factor in zip(names, factors, strict=True)]
    if kind == "distant":
        size = (math.radians(min(numbers[0], 180.0)), 0.0)
    else:
        scale = _scale_of(world_from(prim, times[:1], 1.0)[0])
        numbers = [number * unit_mm * scale for number in numbers] + [0.0, 0.0]
        size = numbers[0], numbers[1]
    picture = prim.GetAttribute("inputs:texture:file")
    texture = name_of(picture) if kind == "dome" and is_picture(picture) else ""
    area = Lamp(kind=kind, radiance=(0.0, 0.0, 0.0), size=size).area
    lamp = Lamp(kind=kind, radiance=_radiance(prim, kind, area, unit_mm), size=size, texture=texture)
    if texture:
        least, most = picture_of(picture).least, max(lamp.radiance) * picture_of(picture).most
        if not (least >= 0 and most <= _BRIGHTEST):
            what = f"the sky shines with {least * max(lamp.radiance):g} to {most:g}, not with 0 to {_BRIGHTEST:g}"
            raise UnreadableValue(what, picture, hint="clip the picture, or lower inputs:intensity")
    return LampEntry(prim_path=str(prim.GetPath()), lamp=lamp)


def _radiance(prim: Usd.Prim, kind: str, area: float, unit_mm: float) -> Rgb:
    """Radiance of a lamp in linear sRGB, as UsdLux defines it."""
    with np.errstate(over="ignore"):  # what is infinite is refused below
        scalar = need(prim, "inputs:intensity") * float(np.exp2(need(prim, "inputs:exposure")))
    if need(prim, "inputs:normalize"):
        scalar /= _size_factor(prim, kind, area, unit_mm)
    colour = np.array(need(prim, "inputs:color")) * scalar
    if need(prim, "inputs:enableColorTemperature"):
        colour = colour * np.array(UsdLux.BlackbodyTemperatureAsRgb(need(prim, "inputs:colorTemperature")))
    if (colour < 0).any():
        hint = "no inputs:intensity and no component of inputs:color is below 0"
        raise UnreadableValue(f"<{prim.GetPath()}> has a radiance of {colour.tolist()}", prim, hint=hint)
    if not (colour <= _BRIGHTEST).all():
        hint = "inputs:exposure is a power of two: 10 makes a lamp about a thousand times as bright"
        what = f"<{prim.GetPath()}> has a radiance of {colour.tolist()}, and images hold {_BRIGHTEST:g} at most"
        raise UnreadableValue(what, prim, hint=hint)
    red, green, blue = (colour + 0.0).tolist()
    return red, green, blue


def _size_factor(prim: Usd.Prim, kind: str, area: float, unit_mm: float) -> float:
    """Divisor of a normalised light: its area in units of the stage, or what a cosine sees of a distant one's angle."""
    if kind == "dome":
        return 1.0
    if kind != "distant":
        return area / unit_mm**2
    half = math.radians(min(need(prim, "inputs:angle"), 360.0) / 2)
    squared = math.sin(half) ** 2
    return math.pi * (squared if half <= math.pi / 2 else 2.0 - squared) if half > 0 else 1.0


def _scale_of(world_from_prim: np.ndarray) -> float:
    """Factor of lengths of a transform that is a rotation times a number."""
    return float(abs(np.linalg.det(world_from_prim[:3, :3])) ** (1 / 3))


def world_from_lamp(prim: Usd.Prim, times: Sequence[float], unit_mm: float) -> np.ndarray:
    """Poses of a lamp at some times, without the scale, (n, 4, 4) [mm]."""
    stack = np.array(world_from(prim, times, unit_mm))
    stack[:, :3, :3] /= np.array([_scale_of(matrix) for matrix in stack])[:, None, None]
    return stack


def check_lamps(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of the lamps of a dataset; `wrong` holds the prims with wrong values."""
    lamps, skies = lamp_prims(root.GetStage()), []
    frames = frame_numbers(root)
    for prim in lamps:
        problems = [*_check_features(prim), *_check_inputs(prim)]
        yield from problems
        if problems or prim.GetPath() in wrong or not len(frames):
            continue
        stack = world_from(prim, tuple(frames), 1.0)
        scale = _scale_of(stack[0])
        gram = (stack[:, :3, :3, None] * stack[:, :3, None, :3]).sum(axis=1)
        if not scale > 0 or np.abs(gram / scale**2 - np.eye(3)).max() > _EVEN:
            message = "the transform of a light scales unevenly, shears, or changes its scale with time"
            hint = "write its size instead: inputs:width, inputs:height, inputs:radius, inputs:length"
            yield problem(prim, "non-rigid", message, hint=hint)
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


def _check_features(prim: Usd.Prim) -> Iterator[Problem]:
    kind = prim.GetTypeName()
    if kind not in KINDS:
        hint = f"known are {', '.join(KINDS)}; {_OFF}"
        yield problem(prim, "not-yet-supported", f"lights of type {kind} are not supported", hint=hint)
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
    if kind == "DomeLight_1" and up != UsdGeom.Tokens.y and prim.GetAttribute("poleAxis").Get() == "scene":
        hint = 'write uniform token poleAxis = "Y" and turn the dome'
        yield problem(prim, "not-yet-supported", f"a DomeLight_1 whose pole is {up} is not supported", hint=hint)


def _check_inputs(prim: Usd.Prim) -> Iterator[Problem]:
    for attribute in prim.GetAuthoredAttributes():
        if not attribute.GetName().startswith("inputs:"):
            continue
        if attribute.ValueMightBeTimeVarying():
            message = f'"{attribute.GetName()}" of a light is animated, and lamps shine evenly'
            hint = "animate its xformOps, or use one lamp per value and make it invisible in other frames"
            yield problem(attribute, "not-yet-supported", message, hint=hint)
        elif attribute.HasAuthoredConnections():
            message = f'"{attribute.GetName()}" of a light is connected, and lamps have values only'
            yield problem(attribute, "not-yet-supported", message, hint="write a value")


def check_shone(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """A warning for each lamp without light, each lamp around a camera, and each target that no lamp shines on."""
    for entry in dataset.lamps:
        prim = stage.GetPrimAtPath(entry.prim_path)
        if not any(entry.lamp.radiance):
            hint = "raise inputs:intensity, lighten inputs:color, or take the lamp out"
            message = f'"{prim.GetName()}" is a lamp without light: its radiance is 0'
            yield problem(prim, "dark-lamp", message, hint=hint, severity="warning")
        for camera in _inside(dataset, entry.prim_path, entry.lamp):
            message = f'"{camera}" stands inside of this lamp: its images show the lamp and nothing else'
            hint = "move the lamp, or make it smaller"
            yield problem(prim, "lamp-around-camera", message, hint=hint, severity="warning")
    bright = {entry.prim_path: entry.lamp for entry in dataset.lamps if any(entry.lamp.radiance)}
    for target in dataset.targets if bright else ():
        dark = [frame.number for frame in dataset.frames if not _is_reached(target, frame, bright)]
        if dark:
            prim = stage.GetPrimAtPath(target.prim_path)
            message = (
                f'no lamp shines on the front of "{prim.GetName()}" in {len(dark)} of {len(dataset.frames)} frames: '
                f"{frames_in_words(dark)}"
            )
            hint = f"turn a lamp, or add a DomeLight: {_DIRECTED}"
            yield problem(prim, "unlit", message, hint=hint, severity="warning")


def _inside(dataset: Dataset, path: str, lamp: Lamp) -> list[str]:
    """Cameras whose aperture stop, the origin of their frame, lies in a lamp in any frame."""
    if lamp.kind not in ("sphere", "cylinder"):
        return []
    names = dict[str, None]()
    for frame in dataset.frames:
        for name, pose in frame.camera_from_world.items() if path in frame.world_from_lamp else ():
            x, y, z = (np.linalg.inv(np.array(pose) @ np.array(frame.world_from_lamp[path])))[:3, 3]
            a, b = lamp.size
            if math.hypot(x, y, z) < a if lamp.kind == "sphere" else abs(x) < a and math.hypot(y, z) < b:
                names[name] = None
    return list(names)


def _is_reached(target: TargetEntry, frame: Frame, lamps: dict[str, Lamp]) -> bool:
    """Whether light of any lamp that is visible in a frame falls on the front of any point of a target."""
    points = target.target.points()
    some = np.unique(np.linspace(0, len(points.kinds) - 1, min(_POINTS_ASKED, len(points.kinds))).astype(int))
    if not len(some):
        return True
    pose = np.array(frame.world_from_target[target.name])
    places, fronts = apply(pose, points.position_mm[some]), points.plane_axes[some][:, :, 2] @ pose[:3, :3].T
    return any(
        shines(lamps[path], np.array(matrix), places, fronts)
        for path, matrix in frame.world_from_lamp.items()
        if path in lamps
    )


def shines(
    lamp: Lamp,
    world_from_lamp: Float64[np.ndarray, "4 4"],
    places_mm: Float64[np.ndarray, "n 3"],
    fronts: Float64[np.ndarray, "n 3"],
) -> bool:
    """Whether light of a lamp falls on the front of any of some places, if nothing is in between."""
    z, (a, b) = world_from_lamp[:3, 2], lamp.size
    if lamp.kind == "dome":
        return True
    if lamp.kind == "distant":
        return bool((fronts @ z > -math.sin(min(a, math.pi / 2))).any())
    faces = (places_mm - world_from_lamp[:3, 3]) @ z < 0 if lamp.kind in ("rect", "disk") else True
    reach = math.hypot(a, b)  # the sphere around the lamp: which parts of it a place sees is not asked
    return bool((faces & (np.sum((world_from_lamp[:3, 3] - places_mm) * fronts, axis=1) > -reach)).any())
