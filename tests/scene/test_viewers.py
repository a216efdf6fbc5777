"""What a build leaves in OUT/dataset.usda shows the true scene in a program that knows nothing of our schemas."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from foreign_usd import foreign
from places import ROOT
from shorter import few
from stage_text import edited, stage_in

import pipeline
from pipeline.app.build import build, project
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.scene.load import load
from pipeline.targets.preview import preview_faces

TWO_POSES = (ROOT / "tests/data/two_poses.usda").read_text(encoding="utf-8")
VIEWER = """
import json, sys
from pxr import Usd, UsdGeom, UsdValidation
stage = Usd.Stage.Open(sys.argv[1])
assert Usd.SchemaRegistry().FindConcretePrimDefinition("PlenDataset") is None
root = stage.GetDefaultPrim()
boxes, windows, colours = [], [], []
for time in (1, 2):
    cache = UsdGeom.BBoxCache(time, [UsdGeom.Tokens.default_])
    box = cache.ComputeWorldBound(root.GetChild("Board")).ComputeAlignedRange()
    boxes.append([list(box.GetMin()), list(box.GetMax())])
camera = UsdGeom.Camera(stage.GetPrimAtPath(f"{root.GetPath()}/Rig/Camera")).GetCamera(1)
window = camera.frustum.GetWindow()
errors = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators()).Validate(stage)
print(json.dumps({
    "boxes": boxes, "window": [list(window.GetMin()), list(window.GetMax())],
    "focus": camera.focusDistance, "clipping": [camera.clippingRange.min, camera.clippingRange.max],
    "lens_radius": camera.focalLength / 10 / camera.fStop / 2,
    "errors": [f"{error.GetIdentifier()} {error.GetMessage()}" for error in errors],
}))
"""


FOR_VIEWERS = ("dataset.usda", "pictures", "cameras/*/parts.usda")


def seen(stage: Path, folder: Path):
    """What a process that imports pxr alone makes of the dataset.usda that a build of a stage delivers."""
    out = folder / "delivered"
    assert build(stage, out, jobs=1, targets=FOR_VIEWERS).exit_code == 0
    return foreign(VIEWER, out / "dataset.usda"), out / "dataset.usda"


@pytest.fixture
def stage(tmp_path):
    """The stage of two poses, with changes of its text."""

    def write(*changes: tuple[str, str]) -> Path:
        return stage_in(tmp_path, edited(TWO_POSES, *changes))

    return write


def test_a_stage_of_two_poses_is_seen_as_it_is(stage, tmp_path):
    """Its board has 8 x 5 squares of 3 mm and a margin of one, and turns by 25 degrees in frame 2."""
    path = stage()
    viewed, out = seen(path, tmp_path)
    turn = np.radians(25)

    assert viewed["errors"] == []
    assert np.allclose(viewed["boxes"][0], [[-15, -10.5, -430], [15, 10.5, -430]], rtol=0, atol=1e-5)
    reach = np.array([15 * np.cos(turn), 10.5, 15 * np.sin(turn)])
    centre = np.array([-1, 0.5, -400])
    assert np.allclose(viewed["boxes"][1], [centre - reach, centre + reach], rtol=0, atol=1e-4)
    assert load(out).problems == []
    assert load(out).dataset == load(path).dataset
    assert project(out).files["dataset.usda"] == out.read_bytes()


@pytest.mark.parametrize("offset", few([(1.5, -0.8)], (0.0, 0.0)))
def test_the_frustum_is_the_field_that_real_rays_leave_the_camera_in(stage, tmp_path, offset):
    """Mean rays of the middles of the image's edges, of 800 x 600 pixels; the rest of 1e-3 is distortion and coma."""
    moved = f"{{\n            uniform double2 plen:offset = {offset}\n        }}"
    path = stage(('over "Camera"', f'over "Sensor"\n        {moved}\n\n        over "Camera"'))
    viewed, _ = seen(path, tmp_path)
    camera = focused(load(path).dataset.cameras[0].camera)
    main = dataclasses.replace(camera, microlenses=None)

    def slope(x_px, y_px):
        rays = pipeline.bundle(main, x_px, y_px, samples=4096)
        return (np.array(rays.mean_at(10_000.0)) - np.array(rays.mean_at(1000.0))) / 9000.0

    left, right = slope(-0.5, 299.5)[0], slope(799.5, 299.5)[0]
    top, bottom = slope(399.5, -0.5)[1], slope(399.5, 599.5)[1]
    wanted = np.array([[left, -bottom], [right, -top]])  # vision y points down
    width = right - left
    assert np.abs(np.array(viewed["window"]) - wanted).max() < 1e-3 * width
    assert viewed["focus"] == pytest.approx(429.52, abs=0.01)  # of the middle type, see tests/cli/test_show.py
    pupil = pipeline.bundle(main, 399.5, 299.5, samples=4096).at_distance(
        -6.123
    )  # the published value of this lens of the library
    assert viewed["lens_radius"] == pytest.approx(np.hypot(*np.array(pupil)[:, :2].T).max(), rel=0.01)
    assert viewed["clipping"][0] < 350 and viewed["clipping"][1] > 1000


def test_a_charuco_board_has_a_preview_and_metres_are_metres(stage, tmp_path):
    """Of the library: 8 x 5 squares of 6 mm and a margin of one."""
    delivered = project(stage(("targets/checkerboard_4x7", "targets/charuco_8x5"))).files["dataset.usda"].decode()
    changes = [("metersPerUnit = 0.001", "metersPerUnit = 1"), ("-430", "-0.43"), ("(-1, 0.5, -400)", "(0, 0, -0.4)")]
    (tmp_path / "metres.usda").write_text(edited(delivered, *changes), encoding="utf-8")
    viewed, _ = seen(tmp_path / "metres.usda", tmp_path)

    assert viewed["errors"] == []
    assert np.allclose(viewed["boxes"][0], [[-0.03, -0.021, -0.43], [0.03, 0.021, -0.43]], rtol=0, atol=1e-8)
    assert viewed["focus"] == pytest.approx(0.42952, abs=1e-5)
    slope = (viewed["window"][1][0] - viewed["window"][0][0]) / 2
    assert slope == pytest.approx(4.0 / 121.7263, rel=1e-5)  # the principal distance that `show` prints


@pytest.mark.parametrize(
    "name", ["charuco_cylinder", "checkerboard_4x7_warped", "aprilgrid_cube", "checkerboard_stairs"]
)
def test_preview_faces_of_other_shapes_lie_on_the_surface_and_look_outwards(name):
    """The points of the target, which have normals of their own, lie on them to the sag of a face."""
    target = load(ROOT / f"stages/targets/{name}.usda").targets[0].target
    faces, points = preview_faces(target), target.points()
    corners = faces.points_mm[faces.faces]
    normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals /= np.linalg.norm(normals, axis=1)[:, None]

    for point, axes in list(zip(points.position_mm, points.axes, strict=True))[::7]:
        nearest = np.argmin(np.linalg.norm(corners.mean(axis=1) - point, axis=1) + 1e3 * (normals @ axes[:, 2] < 0.9))
        assert abs((point - corners[nearest].mean(axis=0)) @ normals[nearest]) < 0.05


def test_what_the_source_says_of_a_pinhole_gives_way_to_the_lens_but_for_the_clipping_range(stage):
    wrong = 'over "Camera"\n        {\n            float focalLength = 50\n            float2 clippingRange = (7, 8000)'
    text = load(stage(('over "Camera"\n        {', wrong))).flattened

    assert re.findall(r"float focalLength = (.*)", text) == ["1217.2632"]
    assert re.findall(r"clippingRange = (.*)", text) == ["(7, 8000)"]


def test_instances_are_written_out_so_that_what_is_delivered_builds_again(stage, tmp_path):
    plain = stage(('over "Camera"\n        {', 'over "Spare"\n        {'), ('over "Spare"', 'def Scope "Spare"'))
    text = plain.read_text(encoding="utf-8").replace("            uniform int plen:image:samples = 256\n", "")
    plain.write_text(text, encoding="utf-8")
    instanced = tmp_path / "instanced.usda"
    made = text.replace("        prepend references", "        instanceable = true\n        prepend references")
    instanced.write_text(made.replace('def Scope "Spare"\n        {\n        }', ""), encoding="utf-8")
    loaded = load(instanced)
    (tmp_path / "delivered.usda").write_text(loaded.flattened, encoding="utf-8")
    again = load(tmp_path / "delivered.usda")

    assert made.count("instanceable") == 2
    assert loaded.dataset == again.dataset == load(plain).dataset
    assert (again.problems, again.flattened) == ([], loaded.flattened)
    assert re.findall(r"float focalLength = (.*)", again.flattened) == ["1217.2632"]
