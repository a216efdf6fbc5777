"""Parts of cameras that a build leaves for programs that know nothing of our schemas."""

import json
from pathlib import Path

import numpy as np
import pytest
from foreign_usd import foreign
from published.library import prescription

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.files.png import read_png
from pipeline.plugins.report.shapes import ray_fans

PARTS_VIEWER = """
import json, sys
import numpy as np
from pxr import Usd, UsdGeom, UsdShade, UsdValidation
stage = Usd.Stage.Open(sys.argv[1])
assert Usd.SchemaRegistry().FindConcretePrimDefinition("PlenDataset") is None
parts = next(prim for prim in stage.Traverse() if prim.GetName() == "PreviewParts")
gprims = parts.GetChildren()
points = {prim.GetName(): np.array(prim.GetAttribute("points").Get()) for prim in gprims if prim.IsA(UsdGeom.Gprim)}
copies = UsdGeom.PointInstancer(parts.GetChild("Microlenses"))
surfaces = [prim for prim in stage.Traverse() if prim.HasAttribute("plen:semiDiameter")]
counts = np.array(parts.GetChild("Rays1").GetAttribute("curveVertexCounts").Get())
board = next(prim for prim in stage.Traverse() if prim.GetName() == "Preview")
surface, _, _ = UsdShade.MaterialBindingAPI(board).ComputeBoundMaterial()[0].ComputeSurfaceSource()
texture = UsdShade.Shader(surface.GetInput("diffuseColor").GetConnectedSources()[0][0].source)
reader = UsdShade.Shader(texture.GetInput("st").GetConnectedSources()[0][0].source)
places = UsdGeom.PrimvarsAPI(board).GetPrimvar(reader.GetInput("varname").Get())
errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(stage)
print(json.dumps({
    "errors": [f"{error.GetIdentifier()} {error.GetMessage()}" for error in errors],
    "purposes": sorted({str(UsdGeom.Imageable(prim).ComputePurpose()) for prim in gprims}),
    "kinds": {prim.GetName(): prim.GetTypeName() for prim in gprims},
    "microlenses": np.array(copies.GetPositionsAttr().Get()).tolist(),
    "glasses": sum((prim.GetAttribute("plen:index").Get() or 1) > 1 for prim in surfaces),
    "radius": surfaces[0].GetAttribute("plen:semiDiameter").Get(),
    "widest": float(np.hypot(*points["Element1"][:, :2].T).max()),
    "sensor": [points["Sensor"].min(axis=0).tolist(), points["Sensor"].max(axis=0).tolist()],
    "starts": points["Rays1"][np.cumsum(counts) - counts][:, 2].tolist(),
    "ends": points["Rays1"][np.cumsum(counts) - 1][:, 2].tolist(),
    "surface": [surface.GetIdAttr().Get(), texture.GetIdAttr().Get(), reader.GetIdAttr().Get()],
    "picture": texture.GetInput("file").Get().resolvedPath,
    "places": [len(places.Get()), len(board.GetAttribute("points").Get()), places.GetInterpolation()],
}))
"""


def test_a_viewer_without_our_plug_in_sees_the_lens_its_rays_and_a_board_with_a_material(plenoptic_build):
    """Behind the camera, along +z, lies the sensor; rays start at the microlenses and go along -z."""
    found = foreign(PARTS_VIEWER, plenoptic_build / "dataset.usda")
    camera = json.loads((plenoptic_build / "cameras/Rig.Camera/camera.json").read_text())
    assert found["errors"] == [] and found["purposes"] == ["guide"]
    assert found["surface"] == ["UsdPreviewSurface", "UsdUVTexture", "UsdPrimvarReader_float2"]
    picture = read_png(Path(found["picture"]))
    assert picture.shape[:2] == (1024, 1024) and set(np.unique(picture)) == {0, 255} and picture[300, 250].max() == 0
    assert found["places"][0] == found["places"][1] and found["places"][2] == "vertex"
    assert found["kinds"]["Rays1"] == "BasisCurves" and found["kinds"]["Microlenses"] == "PointInstancer"
    places = np.array(found["microlenses"])
    apart = np.linalg.norm(places[1:] - places[0], axis=1)
    assert len(places) == camera["mla"]["count"]
    assert apart.min() == pytest.approx(camera["mla"]["pitch_mm"], abs=2e-4)
    elements = [name for name in found["kinds"] if name.startswith("Element")]
    assert len(elements) == found["glasses"] > 1
    assert found["widest"] == pytest.approx(found["radius"], rel=1e-6)
    low, high = np.array(found["sensor"])
    np.testing.assert_allclose(high - low, [*camera["sensor_mm"], 0], atol=1e-5)
    assert high[2] == pytest.approx(camera["sensor_distance_mm"])
    np.testing.assert_allclose(
        found["starts"], camera["sensor_distance_mm"] - camera["mla"]["distance_mm"], rtol=1e-6, atol=2e-3
    )
    assert max(found["ends"]) < -100


def test_rays_from_beside_a_fisheye_end_behind_its_first_vertex():
    """The outermost light of 220 degrees comes from behind."""
    sensor = Sensor(width_px=480, height_px=480, pitch_mm=0.05)
    camera = Camera(prescription=prescription("fisheye_6mm_nikkor"), sensor=sensor, sensor_distance_mm=49.6)
    _, *fans = ray_fans(focused(camera))
    for fan in fans:
        assert fan.rays and all(path[-1][2] < path[-2][2] < 40.0 for path in fan.rays)
