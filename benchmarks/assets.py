"""Assets of others beside a board: what is built, what is refused, what is warned of, and a contact sheet.

    python benchmarks/assets.py FOLDER [--out build/assets] [--only WORD] [--without WORD] [--instances N]

Every .usd, .usda, .usdc and .usdz file below FOLDER that no other file there uses is referenced beside a ChArUco board,
below a sky and a round lamp (`assets.usda`), converted into millimetres, and scaled to a width of 30 mm; a lens camera
looks at both. Prints a table and the warnings, and writes stages, builds, `table.md` and `sheet.jpg` into the output
folder. With `--instances` also what a check costs, in processor time per instance, of a tenth of so many spheres and of
all, and of as many cubes that share nothing.
"""

import argparse
import os
import textwrap
import time
from pathlib import Path

from PIL import Image, ImageDraw
from pxr import Ar, Gf, Sdf, Tf, Usd, UsdGeom, UsdSkel, UsdUtils

import pipeline
from pipeline.limits import VARIABLE
from pipeline.scene.load import load

_SCENE = Path(__file__).with_suffix(".usda")
_ENDINGS = (".usd", ".usda", ".usdc", ".usdz")
_SIZE_MM, _PLACE_MM = 30.0, (20.0, 0.0, -440.0)
"""Largest extent of an asset, and its place: the camera sees 90 x 56 mm there."""
_FRAME = 1.0
"""Time code of the picture."""
_TILE, _TEXT, _COLUMNS = (240, 150), 14, 6
"""Size of a picture of the sheet and height of the line below it [px], and pictures in a row."""
_QUALITY = 75
"""JPEG quality: a sheet of 60 assets has less than 300 kB."""


def assets(folder: Path) -> list[Path]:
    """Files of USD below a folder that no other file there uses."""
    files = sorted(path.resolve() for path in folder.rglob("*") if path.suffix.lower() in _ENDINGS)
    used = set[Path]()
    for file in files:
        layers, _, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
        names = (Ar.SplitPackageRelativePathOuter(layer.realPath)[0] for layer in layers)
        used |= {Path(name).resolve() for name in names} - {file}
    return [file for file in files if file not in used]


def write_stage(file: Path, path: Path) -> float:
    """A stage with an asset beside the board; the size of the asset by its own units [m]."""
    asset = Usd.Stage.Open(str(file))
    asset.SetEditTarget(asset.GetSessionLayer())
    tops = [prim for prim in asset.GetPseudoRoot().GetChildren() if prim.IsDefined() and not prim.IsAbstract()]
    tops = [asset.GetDefaultPrim()] if asset.GetDefaultPrim() else tops
    UsdSkel.BakeSkinning(asset.Traverse(), Gf.Interval(_FRAME))
    cache = UsdGeom.BBoxCache(Usd.TimeCode(_FRAME), [UsdGeom.Tokens.default_, UsdGeom.Tokens.render])
    for extent in (prim.GetAttribute("extent") for prim in asset.TraverseAll()):
        if extent and extent.HasAuthoredValue():  # some are wrong
            extent.Block()
    box = Gf.Range3d()
    for prim in tops:
        box.UnionWith(cache.ComputeWorldBound(prim).ComputeAlignedRange())
    size, middle = (max(box.GetSize()), box.GetMidpoint()) if not box.IsEmpty() else (0.0, Gf.Vec3d())
    top = asset.GetRootLayer().pseudoRoot  # some have a float there, which the stage refuses
    unit = top.GetInfo("metersPerUnit") if top.HasInfo("metersPerUnit") else UsdGeom.LinearUnits.centimeters
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(_SCENE)))
    xform = UsdGeom.Xform.Define(stage, "/Scene/Asset")
    double = UsdGeom.XformOp.PrecisionDouble
    xform.AddTranslateOp().Set(Gf.Vec3d(_PLACE_MM))
    xform.AddRotateXYZOp(double).Set(Gf.Vec3d(15, -25, 0))
    xform.AddScaleOp(double, "fit").Set(Gf.Vec3d(_SIZE_MM / (size * unit * 1e3 or 1.0)))
    if UsdGeom.GetStageUpAxis(asset) == UsdGeom.Tokens.z:
        xform.AddRotateXOp(double, "unitsResolve").Set(-90.0)
    xform.AddScaleOp(double, "unitsResolve").Set(Gf.Vec3d(unit * 1e3))
    xform.AddTranslateOp(double, "middle").Set(-Gf.Vec3d(middle))
    for prim in tops:
        here = stage.DefinePrim(f"/Scene/Asset/{prim.GetName()}")
        here.GetReferences().AddReference(str(file), prim.GetPath())
    # A reference brings nothing from beside its prim: what others name there, such as materials, is named anew.
    for thing in [each for prim in asset.Traverse() if len(tops) > 1 for each in prim.GetAuthoredRelationships()]:
        paths = [path for path in thing.GetTargets() if asset.GetObjectAtPath(path)]
        if any(len(path.GetCommonPrefix(thing.GetPath()).pathString) == 1 for path in paths):
            over = stage.OverridePrim(f"/Scene/Asset{thing.GetPrim().GetPath()}")
            there = [path.ReplacePrefix("/", "/Scene/Asset") for path in paths]
            over.CreateRelationship(thing.GetName(), custom=False).SetTargets(there)
    path.parent.mkdir(parents=True, exist_ok=True)
    stage.GetRootLayer().Export(str(path))
    return size * unit


def row_of(name: str, file: Path, folder: Path, out: Path) -> tuple[str, Image.Image]:
    """A row of the table, and the picture of one asset; prints what `check` says."""
    tile, start, size, problems = Image.new("RGB", _TILE, (90, 30, 30)), time.process_time(), 0.0, []
    stage = out / "stages" / f"{name}.usda"
    try:
        size = write_stage(file, stage)
        loaded = load(stage, [folder], look=True)
        problems, verdict = loaded.problems, "refused"
        if not loaded.errors:
            options = {"allow_roots": (folder,), "targets": ["frames/0001/Rig.Camera/image.png"]}
            done = pipeline.build(stage, out / "builds" / name, **options)
            verdict = "failed" if done.failed else "built"
            [picture] = (out / "builds" / name / "frames").glob("*/*/image.png")
            with Image.open(picture) as image:
                tile = image.convert("RGB").resize(_TILE)
    except (Tf.ErrorException, Exception) as error:  # an asset that ends the program is what this is about
        verdict = f"ended: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
    errors = [problem for problem in problems if problem.is_error]
    print(f"{verdict} {name} after {time.process_time() - start:.1f} s of this process", flush=True)
    for problem in problems:
        print(textwrap.indent(str(problem), "    "), flush=True)
    return f"| {name} | {size:.3g} | {verdict} | {len(errors)} | {len(problems) - len(errors)} |", tile


def cost_of_instances(count: int, kind: str, path: Path) -> float:
    """Processor time of a check of so many instances beside the board [ms each]: `native`, `points` or `alone`."""
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(_SCENE)))
    places = [Gf.Vec3d(i % 100 / 10, i // 100 / 10, -450) for i in range(count)]
    ball = UsdGeom.Sphere.Define(stage, "/Scene/Many/Ball" if kind == "points" else "/Ball/Shape")
    ball.CreateRadiusAttr(0.04)
    if kind == "points":
        many = UsdGeom.PointInstancer.Define(stage, "/Scene/Many")
        many.CreatePrototypesRel().SetTargets([ball.GetPath()])
        many.CreateProtoIndicesAttr([0] * count)
        many.CreatePositionsAttr([Gf.Vec3f(each) for each in places])
    for i, each in enumerate(places if kind != "points" else ()):
        if kind == "alone":
            thing = UsdGeom.Cube.Define(stage, f"/Scene/One{i}")
            thing.CreateSizeAttr(0.04)
        else:
            thing = UsdGeom.Xform.Define(stage, f"/Scene/One{i}")
            thing.GetPrim().GetReferences().AddInternalReference("/Ball")
            thing.GetPrim().SetInstanceable(True)
        thing.AddTranslateOp().Set(each)
    if kind != "points":
        stage.GetPrimAtPath("/Ball").SetSpecifier(Sdf.SpecifierClass)
    path.parent.mkdir(parents=True, exist_ok=True)
    stage.GetRootLayer().Export(str(path))
    start = time.process_time()
    assert not load(path, look=True).errors
    return 1e3 * (time.process_time() - start) / count


def sheet_of(tiles: list[tuple[str, Image.Image]]) -> Image.Image:
    """All pictures with their names."""
    (width, height), rows = _TILE, -(-len(tiles) // _COLUMNS)
    sheet = Image.new("RGB", (_COLUMNS * width, rows * (height + _TEXT)), "white")
    draw = ImageDraw.Draw(sheet)
    for i, (name, tile) in enumerate(tiles):
        left, top = i % _COLUMNS * width, i // _COLUMNS * (height + _TEXT)
        sheet.paste(tile, (left, top))
        draw.text((left + 2, top + height + 1), ".".join(name.split(".")[-2:])[: width // 6], "black")
    return sheet


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("build/assets"))
    parser.add_argument("--only", default="", help="only files with this in their path")
    parser.add_argument("--without", help="no file with this in its path")
    parser.add_argument("--instances", type=int, help="time checks of so many instances, too")
    options = parser.parse_args()
    place = options.out.resolve() / "stages"
    os.environ.setdefault(VARIABLE, "shapes=1e9")  # 10,000 spheres have more triangles than a build should
    for kind in ("native", "points", "alone") if options.instances else ():
        cost_of_instances(10, kind, place / "warm.usda")  # modules are loaded
        for count in (options.instances // 10, options.instances):
            print(
                f"{kind} {count}: {cost_of_instances(count, kind, place / f'{kind}_{count}.usda'):.2f} ms each",
                flush=True,
            )
    folder, rows, tiles = options.folder.resolve(), [], []
    for file in assets(folder):
        name = file.relative_to(folder).as_posix().replace("/", ".").replace(" ", "_")
        if options.only in str(file) and not (options.without and options.without in str(file)):
            row, tile = row_of(name, file, folder, options.out.resolve())
            rows.append(row)
            tiles.append((name, tile))
    table = "\n".join(["| asset | size [m] | | errors | warnings |", "|---|---|---|---|---|", *rows]) + "\n"
    (options.out / "table.md").write_text(table, encoding="utf-8")
    sheet_of(tiles).save(options.out / "sheet.jpg", quality=_QUALITY, optimize=True)
    print(f"{table}\n{sum('| built |' in row for row in rows)} of {len(rows)} built")


if __name__ == "__main__":
    main()
