"""Reading of lamps: lights of UsdLux."""

import math
from collections.abc import Sequence

import numpy as np
from pxr import Usd, UsdGeom, UsdLux

from pipeline.render.lighting.records import Lamp, Rgb
from pipeline.scene.dataset import LampEntry
from pipeline.scene.read.pictures import is_picture, name_of, picture_of
from pipeline.scene.usd.poses import world_from
from pipeline.scene.usd.values import UnreadableValue, need, take
from pipeline.units import mm_per_unit

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
_BRIGHTEST = 1e30
"""Largest radiance of a lamp [1]: images are single precision, and sums of many rays must fit."""
_SHOWN = (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
"""Purposes of what is in images."""


def is_light(prim: Usd.Prim) -> bool:
    """Whether a prim is a light of any kind."""
    return bool(prim.HasAPI(UsdLux.LightAPI))


def is_in_images(prim: Usd.Prim) -> bool:
    """Whether a prim has a purpose with which it is in images, and is not invisible for ever."""
    return UsdGeom.Imageable(prim).ComputePurpose() in _SHOWN and not _is_off(prim)


def lamp_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """Lights of a stage that count, of any kind, in stage order: all but those for viewers alone and those that are
    invisible and stay so.
    """
    return [prim for prim in stage.Traverse() if is_light(prim) and is_in_images(prim)]


def _is_off(prim: Usd.Prim) -> bool:
    above = (prim.GetStage().GetPrimAtPath(path) for path in prim.GetPath().GetPrefixes())
    if any(one.GetAttribute("visibility").ValueMightBeTimeVarying() for one in above):
        return False
    return UsdGeom.Imageable(prim).ComputeVisibility() == UsdGeom.Tokens.invisible


def read_lamp_entry(prim: Usd.Prim, times: Sequence[float]) -> LampEntry:
    """A light of a kind in `KINDS`; its size does not change with time."""
    take(prim.GetPath())
    kind, names, factors = KINDS[str(prim.GetTypeName())]
    unit_mm = mm_per_unit(UsdGeom.GetStageMetersPerUnit(prim.GetStage()))
    numbers = [need(prim, name) * factor for name, factor in zip(names, factors, strict=True)]
    if kind == "distant":
        size = (math.radians(min(numbers[0], 180.0)), 0.0)
    else:
        scale = scale_of(world_from(prim, times[:1], 1.0)[0])
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
    """Number by which a normalised light is divided: its area in square units of the world, or what a cosine sees of
    the solid angle of a distant one.
    """
    if kind == "dome":
        return 1.0
    if kind != "distant":
        return area / unit_mm**2
    half = math.radians(min(need(prim, "inputs:angle"), 360.0) / 2)
    squared = math.sin(half) ** 2
    return math.pi * (squared if half <= math.pi / 2 else 2.0 - squared) if half > 0 else 1.0


def scale_of(world_from_prim: np.ndarray) -> float:
    """Factor of lengths of a transform that is a rotation times a number."""
    return float(abs(np.linalg.det(world_from_prim[:3, :3])) ** (1 / 3))


def world_from_lamp(prim: Usd.Prim, times: Sequence[float], unit_mm: float) -> np.ndarray:
    """Poses of a lamp at some times, without the scale, (n, 4, 4) [mm]."""
    stack = np.array(world_from(prim, times, unit_mm))
    stack[:, :3, :3] /= np.array([scale_of(matrix) for matrix in stack])[:, None, None]
    return stack
