"""Another program shows a built scene as our camera sees it: three.js opens dataset.usda, with textures."""

import base64
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path

import chromium
import numpy as np
import pytest
from builds import tiny
from PIL import Image
from places import ROOT

pytestmark = pytest.mark.heavy  # a browser, and a bundle of three.js
VIEWER = Path(__file__).parent / "scripts/stock_viewer.js"
SCALE = 10
"""Pixels of the viewer per pixel of the camera."""
PACK = """
import sys
from pxr import Sdf, Usd, UsdGeom, UsdUtils
stage = Usd.Stage.Open(sys.argv[1])
assert Usd.SchemaRegistry().FindConcretePrimDefinition("PlenDataset") is None
for prim in stage.Traverse():  # three.js animates no prims of types that it does not know: the first frame stands still
    for op in UsdGeom.Xformable(prim).GetOrderedXformOps() if UsdGeom.Xformable(prim) else ():
        value = op.Get(1)
        op.GetAttr().Clear()
        op.Set(value)
for prim in list(stage.Traverse()):  # three.js knows no purposes: a renderer leaves guides out
    if prim and prim.IsA(UsdGeom.Imageable) and UsdGeom.Imageable(prim).ComputePurpose() == "guide":
        prim.SetActive(False)
stage.Export(sys.argv[2] + ".usdc")
assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(sys.argv[2] + ".usdc"), sys.argv[2])
"""


def stock_image(tmp_path: Path, layer: Path, size_px: tuple[int, int]) -> np.ndarray:
    """Grey values of what three.js draws, at the size of the camera's image."""
    bundler = ROOT / "web/node_modules/.bin/esbuild"
    program = chromium.found()
    if program is None or not bundler.is_file():
        loud = "NO CHROMIUM, OR NO THREE.JS (`make web`): NO STOCK VIEWER HAS OPENED THE SCENE"
        warnings.warn(loud, stacklevel=1)
        pytest.skip(loud)
    foreign = {key: value for key, value in os.environ.items() if not key.startswith("PXR_")}
    packed = tmp_path / "scene.usdz"
    subprocess.run([sys.executable, "-c", PACK, str(layer), str(packed)], check=True, env=foreign, cwd=layer.parent)
    bundle = [str(bundler), str(VIEWER), "--bundle", "--format=iife", f"--outfile={tmp_path / 'viewer.js'}"]
    where = {**os.environ, "NODE_PATH": str(ROOT / "web/node_modules")}
    subprocess.run([*bundle, "--log-level=error"], check=True, env=where)
    data = base64.b64encode(packed.read_bytes()).decode()
    wide, high = (SCALE * one for one in size_px)
    page = tmp_path / "page.html"
    page.write_text(
        f"<body style='margin:0'><script>window.USDZ={json.dumps(data)};window.SIZE=[{wide},{high}]</script>"
        "<script src='viewer.js'></script>"
    )
    with chromium.browser(program) as tab:
        tab.look_as(wide, high)
        tab.open(page)
        shown = Image.open(tab.picture(tmp_path / "stock.png")).convert("L")
        assert tab.errors == []
    return np.array(shown.resize(size_px, Image.Resampling.BOX), float)


def test_three_js_shows_the_board_upright_with_its_picture(tmp_path, common_store):
    """Over the pixels of the board its picture is that of our camera, and of no mirrored or turned one."""
    out = tiny("conventional", tmp_path, common_store)
    ours = np.array(Image.open(out / "frames/0001/Rig.Camera/image.png").convert("L"), float)
    theirs = stock_image(tmp_path, out / "dataset.usda", (ours.shape[1], ours.shape[0]))

    def alike(image: np.ndarray) -> float:
        return float(np.corrcoef(ours.ravel(), image.ravel())[0, 1])

    turned = [theirs[::-1], theirs[:, ::-1], theirs[::-1, ::-1]]
    assert alike(theirs) > 0.95
    assert max(map(alike, turned)) < 0.9
