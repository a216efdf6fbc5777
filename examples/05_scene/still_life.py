"""Write still_life.usda and its pictures: a plain scene, as another program would export it, without our schemas.

python examples/05_scene/still_life.py
"""

import argparse
import math
from pathlib import Path

import numpy as np
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

HERE = Path(__file__).parent
TABLE_MM = -22.0
"""Height of the table."""
ROOT = "/StillLife"


def main() -> None:
    """Write everything beside this script."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    write_wood(HERE / "wood.png")
    write_cover(HERE / "cover.png")
    stage = Usd.Stage.CreateInMemory()
    stage.SetMetadata("metersPerUnit", 0.001)
    stage.SetMetadata("upAxis", "Y")
    stage.SetMetadata("timeCodesPerSecond", 24.0)
    root = UsdGeom.Xform.Define(stage, ROOT)
    root.GetPrim().SetMetadata("kind", "component")
    stage.SetDefaultPrim(root.GetPrim())
    stage.GetRootLayer().documentation = "Things on a table below a window and a lamp; still_life.py makes this file."
    add_lamps(stage)
    add_materials(stage)
    add_things(stage)
    text = stage.GetRootLayer().ExportToString().rstrip("\n") + "\n"
    (HERE / "still_life.usda").write_text(text, encoding="utf-8")


def add_lamps(stage: Usd.Stage) -> None:
    """A window at the upper left, a warm bulb behind at the right, and a faint sky."""
    window = UsdLux.RectLight.Define(stage, f"{ROOT}/Window")
    window.CreateWidthAttr(260)
    window.CreateHeightAttr(260)
    window.CreateIntensityAttr(18)
    window.CreateColorAttr(Gf.Vec3f(0.92, 0.97, 1.0))
    window.AddTranslateOp().Set(Gf.Vec3d(-250, 260, -280))
    window.AddRotateYXZOp().Set(Gf.Vec3f(-43, -55, 0))
    bulb = UsdLux.SphereLight.Define(stage, f"{ROOT}/Bulb")
    bulb.CreateRadiusAttr(16)
    bulb.CreateIntensityAttr(45)
    bulb.CreateEnableColorTemperatureAttr(True)
    bulb.CreateColorTemperatureAttr(2900)
    bulb.AddTranslateOp().Set(Gf.Vec3d(150, 110, -520))
    UsdLux.DomeLight.Define(stage, f"{ROOT}/Sky").CreateIntensityAttr(0.12)


def add_materials(stage: Usd.Stage) -> None:
    """Paints, metals and two pictures."""
    plain = {
        "Wall": ((0.62, 0.55, 0.47), 1.0, 0.0),
        "Gold": ((0.95, 0.68, 0.28), 0.22, 1.0),
        "Red": ((0.72, 0.05, 0.04), 0.12, 0.0),
        "Blue": ((0.05, 0.16, 0.55), 0.25, 0.0),
        "Glaze": ((0.10, 0.42, 0.38), 0.18, 0.0),
        "Steel": ((0.72, 0.72, 0.74), 0.35, 1.0),
    }
    for name, (colour, roughness, metallic) in plain.items():
        surface = _surface(stage, name, roughness, metallic)
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*colour))
    for name, picture, roughness in (("Wood", "wood.png", 0.4), ("Cover", "cover.png", 0.6)):
        _connect_picture(stage, name, picture, _surface(stage, name, roughness, 0.0))


def _surface(stage: Usd.Stage, name: str, roughness: float, metallic: float) -> UsdShade.Shader:
    material = UsdShade.Material.Define(stage, f"{ROOT}/Looks/{name}")
    shader = UsdShade.Shader.Define(stage, f"{ROOT}/Looks/{name}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(roughness)
    shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(metallic)
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
    return shader


def _connect_picture(stage: Usd.Stage, name: str, picture: str, surface: UsdShade.Shader) -> None:
    reader = UsdShade.Shader.Define(stage, f"{ROOT}/Looks/{name}/Reader")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
    texture = UsdShade.Shader.Define(stage, f"{ROOT}/Looks/{name}/Picture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{picture}")
    texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
    for axis in ("wrapS", "wrapT"):
        texture.CreateInput(axis, Sdf.ValueTypeNames.Token).Set("mirror")
    result = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
    texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(result)
    rgb = texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(rgb)


def add_things(stage: Usd.Stage) -> None:
    """A table, a wall, and what lies on the table."""
    low = TABLE_MM
    table = np.array([[-600, low, 100], [600, low, 100], [600, low, -640], [-600, low, -640]], float)
    add_mesh(stage, "Table", table, [[0, 1, 2, 3]], "Wood", st=np.array([[0, 0], [9, 0], [9, 5.5], [0, 5.5]]))
    wall = np.array([[-700, low, -640], [700, low, -640], [700, 600, -640], [-700, 600, -640]], float)
    add_mesh(stage, "Wall", wall, [[0, 1, 2, 3]], "Wall")
    turn = np.linspace(0, math.pi, 19)
    ball = np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    add_turned(stage, "GoldBall", 8.5 * ball, (21.5, low + 8.5, -424), "Gold")
    add_turned(stage, "RedBall", 7.5 * ball, (4.5, low + 7.5, -408), "Red")
    around = np.linspace(0, 2 * math.pi, 25)
    ring = np.stack([6.4 + 2.1 * np.cos(around), 2.1 * np.sin(around)], axis=1)
    add_turned(stage, "Ring", ring, (-21.5, low + 2.1, -410), "Blue")
    height = np.linspace(0, 1, 25)
    width = 7.5 + 4.5 * np.sin(0.4 + 5.2 * height) * (1 - 0.25 * height)
    vase = np.stack([np.concatenate([[0], width]), 34 * np.concatenate([[0], height])], axis=1)
    add_turned(stage, "Vase", vase, (27, low, -475), "Glaze")
    rim = np.array([[0, 0], [4.2, 0], [4.2, 11], [3.6, 11], [3.6, 0.6], [0, 0.6]])
    add_turned(stage, "Cup", rim, (-9, low, -398), "Steel", smooth=False)
    add_book(stage)


def add_book(stage: Usd.Stage) -> None:
    """A box with a picture on all sides, upright behind at the left."""
    half = np.array([13.0, 17.0, 3.0])
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    turn, lean = math.radians(28), math.radians(-9)
    about_y = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    about_x = np.array([[1, 0, 0], [0, math.cos(lean), -math.sin(lean)], [0, math.sin(lean), math.cos(lean)]])
    points = (signs * half) @ (about_y @ about_x).T + [-32, TABLE_MM + 17.2, -472]
    faces = [[4, 5, 7, 6], [1, 0, 2, 3], [5, 1, 3, 7], [0, 4, 6, 2], [6, 7, 3, 2], [0, 1, 5, 4]]
    add_mesh(stage, "Book", points, faces, "Cover", st=np.array([[0, 0], [1, 0], [1, 1], [0, 1]] * 6), varying=True)


def add_turned(
    stage: Usd.Stage,
    name: str,
    profile: np.ndarray,
    foot: tuple[float, float, float],
    look: str,
    smooth: bool = True,
    count: int = 36,
) -> None:
    """A surface of revolution: a profile (n, 2) of radius and height, about an upright axis through a foot."""
    angle = np.arange(count) * 2 * math.pi / count
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.array([[r * c, h, r * s] for r, h in profile for c, s in ring]) + foot
    faces = [
        [(i + 1) * count + j, (i + 1) * count + (j + 1) % count, i * count + (j + 1) % count, i * count + j]
        for i in range(len(profile) - 1)
        for j in range(count)
    ]
    slope = np.gradient(profile, axis=0)
    outwards = np.stack([slope[:, 1], -slope[:, 0]], axis=1)
    outwards /= np.maximum(np.linalg.norm(outwards, axis=1, keepdims=True), 1e-9)
    normals = np.array([[r * c, h, r * s] for r, h in outwards for c, s in ring])
    add_mesh(stage, name, points, faces, look, normals=normals if smooth else None)


def add_mesh(
    stage: Usd.Stage,
    name: str,
    points: np.ndarray,
    faces: list[list[int]],
    look: str,
    st: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    varying: bool = False,
) -> None:
    """A mesh with its material; coordinates by vertex, or by corner of a face."""
    mesh = UsdGeom.Mesh.Define(stage, f"{ROOT}/{name}")
    rounded = np.round(points, 3) + 0.0
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(rounded.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([len(face) for face in faces])
    mesh.CreateFaceVertexIndicesAttr([index for face in faces for index in face])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if normals is not None:
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy((np.round(normals, 3) + 0.0).astype(np.float32)))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    if st is not None:
        kind = UsdGeom.Tokens.faceVarying if varying else UsdGeom.Tokens.vertex
        primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, kind)
        primvar.Set(Vt.Vec2fArray.FromNumpy(st.astype(np.float32)))
    material = UsdShade.Material.Get(stage, f"{ROOT}/Looks/{look}")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)


def write_wood(path: Path) -> None:
    """Boards of wood with rings and fibres, in 32 colours."""
    generator = np.random.default_rng(1)
    y, x = np.mgrid[:256, :384] / 256
    board = np.floor(y * 4)
    shift = generator.random(4)[board.astype(int)] * 7
    rings = np.sin(2 * math.pi * (7 * (y * 4 % 1 - 0.5) ** 2 + 0.6 * np.sin(2.2 * x + shift) + 1.4 * x * 0.4 + shift))
    fibres = np.repeat(generator.normal(size=(256, 24)), 16, axis=1)
    shade = 0.62 + 0.10 * rings + 0.035 * fibres + 0.05 * np.sin(shift)
    shade *= np.where((y * 4 % 1) < 0.02, 0.45, 1.0)
    colour = np.stack([0.86 * shade, 0.60 * shade, 0.38 * shade], axis=-1)
    _save(path, colour)


def write_cover(path: Path) -> None:
    """The cover of a book: a sun above hills."""
    y, x = np.mgrid[:256, :192]
    colour = np.empty((256, 192, 3))
    colour[:] = (0.91, 0.83, 0.66)
    colour[np.hypot(x - 96, y - 100) < 46] = (0.87, 0.33, 0.18)
    for height, tone in ((150, (0.20, 0.47, 0.47)), (185, (0.13, 0.32, 0.38)), (215, (0.08, 0.20, 0.27))):
        colour[y > height + 16 * np.sin(x / 31 + height)] = tone
    colour[(x < 8) | (x > 183) | (y < 8) | (y > 247)] = (0.13, 0.25, 0.30)
    _save(path, colour)


def _save(path: Path, colour: np.ndarray) -> None:
    picture = Image.fromarray(np.clip(np.rint(255 * colour), 0, 255).astype(np.uint8))
    picture.quantize(32, dither=Image.Dither.NONE).convert("RGB").save(path, optimize=True)


if __name__ == "__main__":
    main()
