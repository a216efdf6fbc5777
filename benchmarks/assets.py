"""Assets of others beside a board: what is built, what is refused, what is warned of, and a contact sheet.

    python benchmarks/assets.py FOLDER [--out build/assets] [--only WORD]

Every .usd, .usda, .usdc and .usdz file below FOLDER that no other file there uses is referenced beside a ChArUco board,
below a sky and a round lamp, and scaled to 36 mm; a lens camera looks at both. Prints a table and the warnings, and
writes stages, builds, `table.md` and `sheet.jpg` into the output folder.
"""

import argparse
import textwrap
import time
from pathlib import Path

from PIL import Image, ImageDraw
from pxr import Ar, Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils

import pipeline
from pipeline.scene.load import load

_ENDINGS = (".usd", ".usda", ".usdc", ".usdz")
_SIZE_MM = 36.0
"""Largest extent of an asset: the camera sees 90 x 56 mm."""
_TILE, _TEXT, _COLUMNS = (240, 150), 14, 6
"""Size of a picture of the sheet and height of the line below it [px], and pictures in a row."""
_QUALITY = 80
"""JPEG quality: a sheet of 60 assets has less than 300 kB."""
_STAGE = """#usda 1.0
(
    defaultPrim = "Scene"
    endTimeCode = 1
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def PlenDataset "Scene"
{{
    rel plen:cameras = </Scene/Rig/Camera>
    uniform string plen:illuminant = "D65"
    rel plen:targets = </Scene/Board>

    def "Rig" (
        prepend references = @rigs/conventional_100mm.usda@
    )
    {{
        over "Camera"
        {{
            float horizontalAperture = 275.2
            uniform int plen:image:samples = 128
            float verticalAperture = 172
        }}

        over "Lens"
        {{
            uniform token plen:indexSource = "catalogue"
        }}

        over "Sensor" (
            prepend references = @sensors/bayer_640x480_10um.usda@
        )
        {{
            uniform double plen:pixelPitch = 0.1146666666666667
            uniform int2 plen:resolution = (240, 150)
        }}
    }}

    def "Board" (
        prepend references = @targets/charuco_8x5.usda@
    )
    {{
        uniform double plen:black = 0.035
        uniform double plen:markerSize = 3.2
        uniform double plen:squareSize = 4.2
        uniform double plen:white = 0.82
        double3 xformOp:rotateXYZ = (-10, 20, 0)
        double3 xformOp:translate = (-23, 0, -440)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    }}

    def DomeLight "Sky"
    {{
        float inputs:intensity = 0.5
    }}

    def SphereLight "Lamp"
    {{
        float inputs:intensity = 400
        float inputs:radius = 15
        double3 xformOp:translate = (-120, 160, -250)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}

    def Xform "Asset"
    {{
        double3 xformOp:translate = (21, 0, -440)
        double xformOp:rotateX:tilt = 15
        double xformOp:rotateY:turn = -25
        double xformOp:rotateX:unitsResolve = {turn}
        double3 xformOp:scale:unitsResolve = ({scale!r}, {scale!r}, {scale!r})
        double3 xformOp:translate:centre = ({x!r}, {y!r}, {z!r})
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateX:tilt", "xformOp:rotateY:turn",
            "xformOp:rotateX:unitsResolve", "xformOp:scale:unitsResolve", "xformOp:translate:centre"]

{prims}
    }}
}}
"""
_PRIM = """        def "{name}" (
            prepend references = @{file}@<{path}>
        )
        {{
        }}
"""


def assets(folder: Path) -> list[Path]:
    """Files of USD below a folder that no other file there uses."""
    files = sorted(path.resolve() for path in folder.rglob("*") if path.suffix.lower() in _ENDINGS)
    used = set[Path]()
    for file in files:
        layers, _, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
        names = (Ar.SplitPackageRelativePathOuter(layer.realPath)[0] for layer in layers)
        used |= {Path(name).resolve() for name in names} - {file}
    return [file for file in files if file not in used]


def stage_of(file: Path) -> str:
    """The text of a stage with an asset beside a board."""
    asset = Usd.Stage.Open(str(file))
    tops = [prim for prim in asset.GetPseudoRoot().GetChildren() if prim.IsDefined() and not prim.IsAbstract()]
    tops = [asset.GetDefaultPrim()] if asset.GetDefaultPrim() else tops
    cache = UsdGeom.BBoxCache(Usd.TimeCode(1.0), [UsdGeom.Tokens.default_, UsdGeom.Tokens.render])
    box = Gf.Range3d()
    for prim in tops:
        box.UnionWith(cache.ComputeWorldBound(prim).ComputeAlignedRange())
    size = max(box.GetSize()) if not box.IsEmpty() else 1.0
    x, y, z = (-number for number in (box.GetMidpoint() if not box.IsEmpty() else Gf.Vec3d()))
    turn = -90 if UsdGeom.GetStageUpAxis(asset) == UsdGeom.Tokens.z else 0
    prims = "\n".join(_PRIM.format(name=prim.GetName(), file=file, path=prim.GetPath()) for prim in tops)
    return _STAGE.format(turn=turn, scale=_SIZE_MM / (size or 1.0), x=x, y=y, z=z, prims=prims)


def row_of(name: str, file: Path, folder: Path, out: Path) -> tuple[str, Image.Image]:
    """A row of the table, with what the check says below it, and the picture of one asset."""
    tile, seconds = Image.new("RGB", _TILE, (90, 30, 30)), time.process_time()
    stage, verdict = out / "stages" / f"{name}.usda", "built"
    stage.parent.mkdir(parents=True, exist_ok=True)
    try:
        stage.write_text(stage_of(file), encoding="utf-8")
        loaded = load(stage, [folder], look=True)
        problems = loaded.problems
        if loaded.errors:
            verdict = "refused"
        else:
            done = pipeline.build(stage, out / "builds" / name, allow_roots=(folder,), jobs=1)
            verdict = "failed" if done.failed else "built"
            [picture] = (out / "builds" / name / "frames").rglob("image.png")
            with Image.open(picture) as image:
                tile = image.convert("RGB").resize(_TILE)
    except (Tf.ErrorException, Exception) as error:  # an asset that ends the program is what this is about
        verdict, problems = f"ended: {type(error).__name__}: {str(error)[:200]}", []
    errors = [problem for problem in problems if problem.is_error]
    print(f"{verdict:8} {name}  {time.process_time() - seconds:.1f} s", flush=True)
    for problem in problems:
        print(textwrap.indent(str(problem), "    "), flush=True)
    return f"| {name} | {verdict} | {len(errors)} | {len(problems) - len(errors)} |", tile


def sheet_of(tiles: list[tuple[str, Image.Image]]) -> Image.Image:
    """All pictures with their names."""
    (width, height), rows = _TILE, -(-len(tiles) // _COLUMNS)
    sheet = Image.new("RGB", (_COLUMNS * width, rows * (height + _TEXT)), "white")
    draw = ImageDraw.Draw(sheet)
    for i, (name, tile) in enumerate(tiles):
        left, top = i % _COLUMNS * width, i // _COLUMNS * (height + _TEXT)
        sheet.paste(tile, (left, top))
        draw.text((left + 2, top + height + 1), name.rpartition(".")[2][: width // 6], "black")
    return sheet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("build/assets"))
    parser.add_argument("--only", default="", help="only files with this in their path")
    options = parser.parse_args()
    folder, rows, tiles = options.folder.resolve(), [], []
    for file in assets(folder):
        name = file.relative_to(folder).with_suffix("").as_posix().replace("/", ".").replace(" ", "_")
        if options.only in str(file):
            row, tile = row_of(name, file, folder, options.out.resolve())
            rows.append(row)
            tiles.append((name, tile))
    table = "\n".join(["| asset | | errors | warnings |", "|---|---|---|---|", *rows]) + "\n"
    (options.out / "table.md").write_text(table, encoding="utf-8")
    sheet_of(tiles).save(options.out / "sheet.jpg", quality=_QUALITY, optimize=True)
    print(f"{table}\n{sum('| built |' in row for row in rows)} of {len(rows)} built")


if __name__ == "__main__":
    main()
