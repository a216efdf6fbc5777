"""Readers and checks of lamps, the lights of UsdLux."""

import math
from collections.abc import Iterator, Sequence, Set
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdLux

from pipeline.frames import apply
from pipeline.plugins.scenes.lighting.records import Lamp, Rgb, Shaping
from pipeline.plugins.scenes.reading.lamp_axes import EVEN, LENGTHS, axes_and_scales, flattened_at
from pipeline.plugins.scenes.reading.pictures import is_picture, name_of, picture_of
from pipeline.records.shapes import Float64
from pipeline.scene.dataset import Dataset, Frame, LampEntry, TargetEntry
from pipeline.scene.usd.poses import frame_numbers, is_in_images, stage_mm_per_unit, world_from
from pipeline.scene.usd.problems import Problem, not_drawn, of_reader, problem, warning
from pipeline.scene.usd.readers import note_read, read_once
from pipeline.scene.usd.values import NotSupported, UnreadableValue, need, plain, target_paths
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
_BRIGHTEST = 1e30
"""Largest radiance of a lamp [1]: images are single precision, and sums of many rays must fit."""
_IGNORED: dict[str, tuple[Any, str]] = {
    "inputs:diffuse": (1.0, "lamps light all materials alike"),
    "inputs:specular": (1.0, "lamps light all materials alike"),
    "collection:lightLink:includeRoot": (True, "a lamp lights everything"),
    "collection:shadowLink:includeRoot": (True, "everything throws shadows"),
    "light:filters": (None, "the lamp shines without filters"),
    "portals": (None, "the sky shines everywhere"),
    "collection:lightLink:includes": (None, "a lamp lights everything"),
    "collection:lightLink:excludes": (None, "a lamp lights everything"),
    "collection:shadowLink:includes": (None, "everything throws shadows"),
    "collection:shadowLink:excludes": (None, "everything throws shadows"),
    "inputs:shadow:enable": (True, "everything throws shadows"),
    "inputs:shadow:color": ((0.0, 0.0, 0.0), "shadows are without light"),
    "inputs:shadow:distance": (-1.0, "shadows reach to infinity"),
}
"""Attributes and relationships without effect: their idle values, and what is drawn instead."""
_BRIGHT_SKY = 4.0
"""Radiance of a sky above which an image shows little but white [1]: paper is four times as bright as mid grey."""
_POINT_MM = 0.1
"""Radius of the sphere that is drawn for a point light [mm]: from afar all spheres of one power look alike."""
_FORMATS = ("automatic", "latlong")
"""Formats of pictures of the sky that are drawn."""
_FAR = ("distant", "dome")
"""Kinds of lamps at infinity, without position or shape."""
_OFF = 'take it out, or keep it from images with uniform token purpose = "guide"'
_MOST_POINTS = 64
"""Most points of a target at which its lighting is checked."""
_DIRECTED = "rects, disks and distant lamps shine along their -Z; the front of a target is its +Z"


@read_once
def lights(stage: Usd.Stage) -> list[Usd.Prim]:
    """Lights of any kind in images, in stage order."""
    return [prim for prim in stage.Traverse() if prim.HasAPI(UsdLux.LightAPI) and is_in_images(prim)]


def lamp_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    """Lights that are lamps."""
    return [prim for prim in lights(stage) if prim.GetTypeName() in KINDS]


def is_lit(stage: Usd.Stage) -> bool:
    """Whether any lamp, or a mesh that is a light, lights a stage."""
    return any(prim.GetTypeName() in KINDS or is_mesh_light(prim) for prim in lights(stage))


def is_mesh_light(prim: Usd.Prim) -> bool:
    """Whether a shape is a light."""
    return bool(prim.HasAPI(UsdLux.MeshLightAPI) and prim.IsA(UsdGeom.Gprim))


def mesh_light(prim: Usd.Prim) -> Rgb:
    """Radiance of a shape that is a light."""
    return _radiance(prim, 1.0)


def read_lamp_entry(prim: Usd.Prim, times: Sequence[float]) -> LampEntry:
    """A light of a kind in `KINDS`; its size does not change with time."""
    note_read(prim)
    kind = KINDS[str(prim.GetTypeName())][0]
    unit_mm = stage_mm_per_unit(prim)
    size = _size(prim, times[0])
    picture = prim.GetAttribute("inputs:texture:file")
    texture = name_of(picture) if _shows_picture(prim) else ""
    area = Lamp(kind=kind, radiance=(0.0, 0.0, 0.0), size=size).area
    radiance = _radiance(prim, _size_factor(prim, kind, area, unit_mm))
    shaping = None if kind in _FAR or not prim.HasAPI(UsdLux.ShapingAPI) else _shaping(prim, kind)
    lamp = Lamp(kind=kind, radiance=radiance, size=size, texture=texture, shaping=shaping)
    if texture:
        least = picture_of(picture).least
        most = max(lamp.radiance) * picture_of(picture).most
        if not (least >= 0 and most <= _BRIGHTEST):
            darkest = least * max(lamp.radiance)
            message = f"the picture shines with {darkest:g} to {most:g}, not with 0 to {_BRIGHTEST:g}"
            raise UnreadableValue(message, picture, hint="clip the picture, or lower inputs:intensity")
    return LampEntry(prim_path=str(prim.GetPath()), lamp=lamp)


def _size(prim: Usd.Prim, time: float) -> tuple[float, float]:
    """Size of a lamp, see `Lamp.size`, with the scale of its transform at a time."""
    kind, names, factors = KINDS[str(prim.GetTypeName())]
    numbers = [need(prim, name) * factor for name, factor in zip(names, factors, strict=True)]
    for name, number in zip(names, numbers, strict=True):
        if number < 0:
            raise UnreadableValue(f'"{name}" is below 0', prim.GetAttribute(name), hint="sizes are 0 or more")
    if kind == "distant":
        return math.radians(min(need(prim, "inputs:angle"), 360.0)) / 2, 0.0
    if kind == "dome":
        return 0.0, 0.0
    if _is_point(prim):
        return _POINT_MM, 0.0
    # Disks and cylinders stay round under an uneven scale, and spheres keep their volume.
    _, (sx, sy, sz) = axes_and_scales(world_from(prim, [time], 1.0)[0])
    mean_scale = sx if sx == sy == sz else (sx * sy * sz) ** (1 / 3)
    scales = {"rect": (sx, sy), "disk": (math.sqrt(sx * sy),), "cylinder": (sx, math.sqrt(sy * sz))}
    unit_mm = stage_mm_per_unit(prim)
    sizes = [n * unit_mm * scale for n, scale in zip(numbers, scales.get(kind, (mean_scale,)), strict=True)]
    return sizes[0], sizes[1] if len(sizes) > 1 else 0.0


def _is_point(prim: Usd.Prim) -> bool:
    """Whether a light is a point: a sphere of radius 0 with a power."""
    is_sphere = prim.GetTypeName() == "SphereLight"
    return is_sphere and need(prim, "inputs:normalize") and not need(prim, "inputs:radius") > 0


def _shows_picture(prim: Usd.Prim) -> bool:
    """Whether the picture of a light is drawn."""
    kind = KINDS[str(prim.GetTypeName())][0]
    form = prim.GetAttribute("inputs:texture:format")
    return (
        kind in ("rect", "dome")
        and is_picture(prim.GetAttribute("inputs:texture:file"))
        and not (form and form.HasAuthoredValue() and form.Get() not in _FORMATS)
    )


def _shaping(prim: Usd.Prim, kind: str) -> Shaping | None:
    """Shaping of a lamp; None if its radiance is the same in all directions of its bright side."""
    profile = prim.GetAttribute("inputs:shaping:ies:file")
    if is_picture(profile):
        hint = "shape the lamp by inputs:shaping:cone:angle, cone:softness and focus, or use one of another size"
        raise NotSupported("lamps have no IES profiles of luminaires", profile, hint=hint)
    focus, tint = need(prim, "inputs:shaping:focus"), need(prim, "inputs:shaping:focusTint")
    cone = math.radians(min(max(need(prim, "inputs:shaping:cone:angle"), 0.0), 180.0))
    softness = min(max(need(prim, "inputs:shaping:cone:softness"), 0.0), 1.0)
    full = math.pi / 2 if kind in ("rect", "disk") else math.pi
    if focus <= 0 and cone >= full and not softness:
        return None
    return Shaping(focus=max(focus, 0.0), focus_tint=tint, cone=cone, softness=softness)


def _radiance(prim: Usd.Prim, size_factor: float) -> Rgb:
    """Radiance of a light in linear sRGB, at least 0, as UsdLux defines it: over `size_factor` if it is normalised."""
    with np.errstate(over="ignore"):  # what is infinite is refused below
        scalar = need(prim, "inputs:intensity") * float(np.exp2(need(prim, "inputs:exposure")))
    if need(prim, "inputs:normalize"):
        scalar /= size_factor
    colour = np.array(need(prim, "inputs:color")) * scalar
    if need(prim, "inputs:enableColorTemperature"):
        colour = colour * np.array(UsdLux.BlackbodyTemperatureAsRgb(need(prim, "inputs:colorTemperature")))
    if not (colour <= _BRIGHTEST).all():
        hint = "inputs:exposure is a power of two: 10 makes a lamp about a thousand times as bright"
        message = f"<{prim.GetPath()}> has a radiance of {colour.tolist()}, and images hold {_BRIGHTEST:g} at most"
        raise UnreadableValue(message, prim, hint=hint)
    red, green, blue = np.maximum(colour, 0.0).tolist()
    return red, green, blue


def _size_factor(prim: Usd.Prim, kind: str, area: float, unit_mm: float) -> float:
    """Divisor of a normalised light: its area in units of the stage, or the projected solid angle of a distant one."""
    if kind == "dome":
        return 1.0
    if kind != "distant":
        return area / unit_mm**2 or 1.0  # a lamp without area is reported
    half = math.radians(min(need(prim, "inputs:angle"), 360.0) / 2)
    squared = math.sin(half) ** 2
    return math.pi * (squared if half <= math.pi / 2 else 2.0 - squared) if half > 0 else 1.0


def check_lamps(root: Usd.Prim, wrong: Set[Sdf.Path]) -> Iterator[Problem]:
    """Problems of the lamps of a dataset; `wrong` holds the prims with wrong values."""
    stage = root.GetStage()
    skies = list[Usd.Prim]()
    frames = tuple(frame_numbers(root))
    for prim in lights(stage):
        yield from _ignored(prim)
        kind = str(prim.GetTypeName())
        if prim.GetPath() in wrong or not frames or (kind not in KINDS and not is_mesh_light(prim)):
            continue
        try:
            entry = read_lamp_entry(prim, frames) if kind in KINDS else mesh_light(prim)
        except UnreadableValue as error:
            yield of_reader(error.thing, error)
            continue
        if any(component * need(prim, "inputs:intensity") < 0 for component in need(prim, "inputs:color")):
            yield not_drawn(prim, f"<{prim.GetPath()}> has a radiance below 0: it counts as 0")
        if isinstance(entry, LampEntry):
            if flat := flattened_at(prim, frames):
                message = (
                    f"the transform of a light flattens it at time code {flat[0]}: it has no shape or no direction"
                )
                hint = (
                    f"scales are {LENGTHS[0]:g} to {LENGTHS[1]:g}, and axes do not lie in one plane; "
                    "to hide a light at a time, make it invisible"
                )
                yield problem(prim, "lamp-size", message, hint=hint)
                continue
            yield from _check_scale(prim, entry.lamp, frames)
            skies += [prim] if entry.lamp.texture and entry.lamp.kind == "dome" else []
            if _is_point(prim):
                message = f"a point is drawn as a sphere with a radius of {_POINT_MM} mm and the same power"
                yield not_drawn(prim, message, hint="write its inputs:radius")
            if entry.lamp.kind not in _FAR and not entry.lamp.area > 0:
                yield problem(prim, "lamp-size", "a lamp without area shines nothing", hint="give it a size above 0")
    if len(skies) > 1:
        message = f"one sky with a picture at most: <{skies[0].GetPath()}> has one, too"
        yield problem(skies[-1], "not-yet-supported", message, hint=f"keep one: {_OFF}")


def _check_scale(prim: Usd.Prim, lamp: Lamp, frames: tuple[int, ...]) -> Iterator[Problem]:
    """A warning if the transform of a lamp gives it a shape that is not drawn."""
    if lamp.kind in _FAR:
        return
    stack = world_from(prim, frames, 1.0)
    _, (x, y, z) = axes_and_scales(stack[0])
    unevenness = {"rect": 0.0, "disk": x - y, "cylinder": y - z}.get(lamp.kind, max(x, y, z) - min(x, y, z))
    axes = stack[0][:3, :3] / np.maximum(np.linalg.norm(stack[0][:3, :3], axis=0), 1e-300)
    moves = any(not np.allclose(axes_and_scales(matrix)[1], (x, y, z), rtol=EVEN) for matrix in stack[1:])
    bent = np.abs(axes.T @ axes - np.eye(3)).max()
    if abs(unevenness) > EVEN * x or bent > EVEN or moves:
        message = "the transform of a light scales unevenly, shears, or changes its scale with time"
        a, b = lamp.size
        drawn = f"it is drawn as a {lamp.kind} of {a:.4g} mm" + (f" by {b:.4g} mm" if b else "")
        hint = "write its size instead: inputs:width, inputs:height, inputs:radius, inputs:length"
        yield not_drawn(prim, f"{message}: {drawn} (half its width, or its radius)", hint=hint)


def _ignored(prim: Usd.Prim) -> Iterator[Problem]:
    """Warnings of attributes without effect on a light, and of what is drawn instead."""
    kind = str(prim.GetTypeName())
    if kind not in KINDS and not is_mesh_light(prim):
        yield not_drawn(prim, f"lights of type {kind} shine nothing here", f"known are {', '.join(KINDS)}; {_OFF}")
        return
    for name, (idle, instead) in _IGNORED.items():
        if relationship := prim.GetRelationship(name):
            if target_paths(relationship):
                yield not_drawn(relationship, f'"{name}" of a light has no effect: {instead}')
        elif (attribute := prim.GetAttribute(name)) and attribute.HasAuthoredValue() and plain(attribute.Get()) != idle:
            yield not_drawn(attribute, f'"{name}" = {attribute.Get()} of a light has no effect: {instead}')
    shapeless = kind not in KINDS or KINDS[kind][0] in _FAR or not prim.HasAPI(UsdLux.ShapingAPI)
    for attribute in prim.GetAuthoredAttributes():
        name = attribute.GetName()
        if shapeless and name.startswith("inputs:shaping:"):
            yield not_drawn(
                attribute, f'"{name}" has no effect on a light without an axis or ShapingAPI: it shines evenly'
            )
        elif name.startswith("inputs:") and attribute.ValueMightBeTimeVarying():
            message = f'"{name}" of a light is animated, and lamps shine evenly: its value at time code 0 is drawn'
            hint = "animate its xformOps, or use one lamp per value and hide it in other frames"
            yield not_drawn(attribute, message, hint)
        elif name.startswith("inputs:") and attribute.HasAuthoredConnections():
            yield not_drawn(
                attribute, f'"{name}" of a light is connected, and lamps have values only: its own value is drawn'
            )
    picture = prim.GetAttribute("inputs:texture:file")
    if kind in KINDS and picture and is_picture(picture) and not _shows_picture(prim):
        form = prim.GetAttribute("inputs:texture:format").Get()
        yield not_drawn(
            picture, f'pictures of the sky of the format "{form}" are not drawn: it shines without', "use latlong"
        )
    if is_mesh_light(prim) and need(prim, "inputs:normalize"):
        yield not_drawn(
            prim.GetAttribute("inputs:normalize"), "the light of a mesh is not divided by its area", "write 0"
        )


def check_shone(stage: Usd.Stage, dataset: Dataset) -> Iterator[Problem]:
    """A warning for each lamp without light, each lamp around a camera, and each target that no lamp shines on."""
    for entry in dataset.lamps:
        prim = stage.GetPrimAtPath(entry.prim_path)
        if not any(entry.lamp.radiance):
            hint = "raise inputs:intensity, lighten inputs:color, or take the lamp out"
            message = f'"{prim.GetName()}" is a lamp without light: its radiance is 0'
            yield warning(prim, "dark-lamp", message, hint=hint)
        brightest = max(entry.lamp.radiance)
        if entry.lamp.kind == "dome" and not entry.lamp.texture and brightest > _BRIGHT_SKY:
            message = f'"{prim.GetName()}" alone makes white {brightest:.3g} times as bright as the white of image.png'
            hint = f"lower inputs:exposure by {math.log2(brightest):.2g}; image.exr and raw images hold it"
            yield warning(prim, "bright-sky", message, hint=hint)
        for camera in _cameras_inside(dataset, entry.prim_path, entry.lamp):
            message = f'"{camera}" stands inside of this lamp: its images show the lamp and nothing else'
            yield warning(prim, "lamp-around-camera", message, hint="move the lamp, or make it smaller")
    bright = {entry.prim_path: entry.lamp for entry in dataset.lamps if any(entry.lamp.radiance)}
    for target in dataset.targets if bright else ():
        dark = [frame.number for frame in dataset.frames if not _is_reached(target, frame, bright)]
        if dark:
            prim = stage.GetPrimAtPath(target.prim_path)
            message = (
                f'no lamp shines on the front of "{prim.GetName()}" in {len(dark)} of {len(dataset.frames)} frames: '
                f"{frames_in_words(dark)}"
            )
            yield warning(prim, "unlit", message, hint=f"turn a lamp, or add a DomeLight: {_DIRECTED}")


def _cameras_inside(dataset: Dataset, path: str, lamp: Lamp) -> list[str]:
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
    """Whether any lamp that is visible in a frame lights the front of any point of a target."""
    points = target.target.points()
    sample = np.unique(np.linspace(0, len(points.kinds) - 1, min(_MOST_POINTS, len(points.kinds))).astype(int))
    if not len(sample):
        return True
    pose = np.array(frame.world_from_target[target.name])
    points_mm = apply(pose, points.position_mm[sample])
    fronts = points.plane_axes[sample][:, :, 2] @ pose[:3, :3].T
    return any(
        shines(lamps[path], np.array(matrix), points_mm, fronts)
        for path, matrix in frame.world_from_lamp.items()
        if path in lamps
    )


def shines(
    lamp: Lamp,
    world_from_lamp: Float64[np.ndarray, "4 4"],
    points_mm: Float64[np.ndarray, "n 3"],
    fronts: Float64[np.ndarray, "n 3"],
) -> bool:
    """Whether a lamp lights the front of any of the points, if nothing is in between."""
    z, (a, b) = world_from_lamp[:3, 2], lamp.size
    if lamp.kind == "dome":
        return True
    if lamp.kind == "distant":
        return bool((fronts @ z > -math.sin(min(a, math.pi / 2))).any())
    faces = (points_mm - world_from_lamp[:3, 3]) @ z < 0 if lamp.kind in ("rect", "disk") else True
    radius = math.hypot(a, b)  # of the sphere around the lamp, every part of which counts as visible
    return bool((faces & (np.sum((world_from_lamp[:3, 3] - points_mm) * fronts, axis=1) > -radius)).any())
