"""Mitsuba 3 renders the same pictures on surfaces: files, colour spaces, wrapping, transforms, holes, glow and bumps.

The scene is a stage that is read as those of users are; for Mitsuba its polygons are written as OBJ, and its materials
by hand. Both count t from the lower edge of a picture; only Mitsuba's transforms count it from the upper one.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from plugins.scenes.test_mitsuba import agree, at, grey
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

mitsuba = pytest.importorskip("mitsuba", reason="needs the extra `referees`")
pytestmark = pytest.mark.heavy
TILED = [(-0.7, -0.3), (1.9, -0.3), (1.9, 2.4), (-0.7, 2.4)]
"""Texture coordinates of four corners, beyond one copy of the picture on all sides."""
WHOLE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A UsdUVTexture on the input of a surface, and its transform: scale, rotation [deg] and translation."""

    file: str
    output: str = "rgb"
    space: str = "auto"
    wrap: str = "repeat"
    transform: tuple[tuple[float, float], float, tuple[float, float]] | None = None
    scale: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)
    bias: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)


def grey_file(path: Path, seed: int, size: tuple[int, int]) -> str:
    """A picture of random greys in eight bits a channel, (w, h) px."""
    values = np.random.default_rng(seed).integers(0, 256, size[::-1], np.uint8)
    Image.fromarray(np.repeat(values[..., None], 3, axis=2)).save(path)
    return path.name


def stage_in_mm(folder: Path) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(folder / "scene.usda"))
    UsdGeom.SetStageMetersPerUnit(stage, 0.001)
    return stage


def sheet(
    stage: Usd.Stage, name: str, pose: np.ndarray, half_mm: float, st: list[tuple[float, float]], **inputs: Any
) -> None:
    """A square with a UsdPreviewSurface whose inputs are values or pictures."""
    mesh = UsdGeom.Mesh.Define(stage, f"/{name}")
    corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * half_mm
    mesh.CreatePointsAttr([Gf.Vec3f(*point) for point in (corners @ pose[:3, :3].T + pose[:3, 3]).tolist()])
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3])
    mesh.CreateSubdivisionSchemeAttr("none")
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, "vertex")
    primvar.Set([Gf.Vec2f(*place) for place in st])
    material = UsdShade.Material.Define(stage, f"/{name}/Material")
    surface = shader(stage, f"/{name}/Material/Surface", "UsdPreviewSurface")
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    surface.CreateInput("ior", Sdf.ValueTypeNames.Float).Set(1.0)
    for key, value in inputs.items():
        kind = Sdf.ValueTypeNames.Float if np.ndim(value) == 0 else Sdf.ValueTypeNames.Color3f
        if not isinstance(value, Picture):
            surface.CreateInput(key, kind).Set(value)
            continue
        kind = Sdf.ValueTypeNames.Color3f if value.output == "rgb" else Sdf.ValueTypeNames.Float
        surface.CreateInput(key, kind).ConnectToSource(network(stage, f"/{name}/Material/{key}", value), value.output)


def shader(stage: Usd.Stage, path: str, kind: str, **inputs: Any) -> UsdShade.Shader:
    made = UsdShade.Shader.Define(stage, path)
    made.CreateIdAttr(kind)
    types = Sdf.ValueTypeNames
    names = {str: types.Token, float: types.Float, Sdf.AssetPath: types.Asset, Gf.Vec2f: types.Float2}
    for name, value in inputs.items():
        made.CreateInput(name, names.get(type(value), types.Float4)).Set(value)
    return made


def network(stage: Usd.Stage, path: str, picture: Picture) -> UsdShade.ConnectableAPI:
    """The texture of a picture, behind a reader and a transform if it has one."""
    wraps = {"wrapS": picture.wrap, "wrapT": picture.wrap, "sourceColorSpace": picture.space}
    texture = shader(stage, path, "UsdUVTexture", file=Sdf.AssetPath(picture.file), **wraps)
    texture.CreateInput("scale", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*picture.scale))
    texture.CreateInput("bias", Sdf.ValueTypeNames.Float4).Set(Gf.Vec4f(*picture.bias))
    source = shader(stage, f"{path}Reader", "UsdPrimvarReader_float2", varname="st")
    if picture.transform:
        scale, rotation, translation = picture.transform
        place = {"scale": Gf.Vec2f(*scale), "rotation": rotation, "translation": Gf.Vec2f(*translation)}
        moved = shader(stage, f"{path}Transform", "UsdTransform2d", **place)
        moved.CreateInput("in", Sdf.ValueTypeNames.Float2).ConnectToSource(source.ConnectableAPI(), "result")
        source = moved
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(source.ConnectableAPI(), "result")
    return texture.ConnectableAPI()


def theirs(data: Any, **more: Any) -> dict[str, Any]:
    """Mitsuba's picture, from a file or of linear numbers."""
    where = {"filename": str(data)} if isinstance(data, Path) else {"bitmap": mitsuba.Bitmap(data), "raw": True}
    return {"type": "bitmap", "wrap_mode": "repeat", **where, **more}


def twosided(bsdf: dict[str, Any]) -> dict[str, Any]:
    return {"bsdf": {"type": "twosided", "bsdf": bsdf}}


def as_it_is(path: Path) -> np.ndarray:
    """Components of a file from 0 to 1, (h, w, 3)."""
    return np.asarray(Image.open(path).convert("RGB"), np.float32) / np.float32(255.0)


def to_linear(path: Path) -> np.ndarray:
    """Mitsuba's own decoding of sRGB."""
    bitmap = mitsuba.Bitmap(str(path))
    return np.array(bitmap.convert(mitsuba.Bitmap.PixelFormat.RGB, mitsuba.Struct.Type.Float32, srgb_gamma=False))


def test_walls_with_pictures_look_alike_by_the_light_of_one_that_glows(tmp_path):
    """Three colour spaces and three ways to go on beyond a picture. The lamp also shines behind it, on nothing."""
    from plugins.scenes.mitsuba_scenes import Both, mi

    for seed, (name, size) in enumerate({"wall.png": (5, 4), "floor.png": (3, 3), "lamp.png": (4, 2)}.items()):
        grey_file(tmp_path / name, seed, size)
    (scale, turn, shift) = moved = ((1.5, 0.7), 25.0, (0.3, -0.2))
    wall = Picture(file="wall.png", transform=moved)
    floor = Picture(file="floor.png", space="raw", wrap="mirror", scale=(0.6,) * 4, bias=(0.2,) * 4)
    lamp = Picture(file="lamp.png", space="sRGB", wrap="clamp", scale=(6.0,) * 4)
    stage, black = stage_in_mm(tmp_path), (0.0, 0.0, 0.0)
    sheet(stage, "Wall", at(240, 0, 500), 240.0, TILED, diffuseColor=wall)
    sheet(stage, "Floor", at(240, 120, 300, (0.0, -1.0, 0.0)), 240.0, TILED, diffuseColor=floor)
    sheet(stage, "Lamp", at(-110, -20, 330, (1.0, 0.0, 0.0)), 60.0, WHOLE, diffuseColor=black, emissiveColor=lamp)
    stage.Save()
    part = mi.ScalarTransform3f
    upright = part().translate([0, 1]) @ part().scale([1, -1])
    there = upright @ part().translate(list(shift)) @ part().rotate(turn) @ part().scale(list(scale)) @ upright
    glow = {"type": "area", "radiance": theirs(6.0 * to_linear(tmp_path / "lamp.png"), wrap_mode="clamp")}
    tiles = theirs(0.6 * as_it_is(tmp_path / "floor.png") + 0.2, wrap_mode="mirror")
    both = Both()
    both.sheets(
        tmp_path / "scene.usda",
        {
            "Wall": twosided({"type": "diffuse", "reflectance": theirs(tmp_path / "wall.png", to_uv=there)}),
            "Floor": twosided({"type": "diffuse", "reflectance": tiles}),
            "Lamp": {"bsdf": grey(0.0), "emitter": glow},
        },
    )
    agree(both, 3)


def test_holes_and_bumps_of_pictures_look_alike(tmp_path):
    """A lattice cut out by the fourth channel, and a wavy plate.

    Holes end where the opacity between texels is the threshold: at the edges of texels, where Mitsuba's are without
    interpolation.
    """
    from plugins.scenes.mitsuba_scenes import Both

    bits = np.full((4, 8, 4), 255, np.uint8)
    bits[:, ::2, 3] = 0
    Image.fromarray(bits).save(tmp_path / "bars.png")
    tilts = np.random.default_rng(7).integers((60, 60, 215), (196, 196, 256), (5, 6, 3))
    Image.fromarray(tilts.astype(np.uint8)).save(tmp_path / "waves.png")
    bars = Picture(file="bars.png", output="a")
    waves = Picture(file="waves.png", space="raw", scale=(2.0, 2.0, 2.0, 1.0), bias=(-1.0, -1.0, -1.0, 0.0))
    stage = stage_in_mm(tmp_path)
    sheet(stage, "Wall", at(0, 0, 500), 500.0, WHOLE, diffuseColor=(0.5,) * 3)
    sheet(stage, "Bars", at(40, -10, 400), 60.0, WHOLE, diffuseColor=(0.7,) * 3, opacity=bars, opacityThreshold=0.5)
    sheet(stage, "Waves", at(-60, 30, 350, (0.4, -0.3, -0.9)), 60.0, WHOLE, diffuseColor=(0.8,) * 3, normal=waves)
    stage.Save()
    there = theirs(np.repeat(bits[..., 3:] / np.float32(255.0), 3, axis=2), filter_type="nearest")
    waved = {"type": "normalmap", "normalmap": theirs(as_it_is(tmp_path / "waves.png")), "bsdf": grey(0.8)}
    both = Both()
    both.sheets(
        tmp_path / "scene.usda",
        {
            "Wall": twosided(grey(0.5)),
            "Bars": {"bsdf": {"type": "mask", "opacity": there, **twosided(grey(0.7))}},
            "Waves": twosided(waved),
        },
    )
    both.lamp("rect", (90.0, 70.0), at(-80, -90, 250, (0.2, -0.8, -0.6)), 3.0)
    both.lamp("sphere", (15.0, 0.0), at(60, -40, 250), 8.0)
    agree(both, 6, 16)
