"""`pipeline check --fix` inserts what viewers miss, and touches nothing else."""

import re

import pytest
from places import ROOT
from pxr import Sdf, Usd, UsdGeom
from stage_text import stage_in

from pipeline.errors import UsageError
from pipeline.scene.load import load, open_dataset
from pipeline.scene.write.viewers import fix, note_on_viewers

SNIPPET = re.search(r"```usda\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.S)[1]
OWN = """#usda 1.0
# a comment ( that opens a bracket
(
    defaultPrim = "Mine" # { and a brace
    metersPerUnit = 0.001
    fallbackPrimTypes = { token[] PlenDataset = ["Scope"]
    }
    startTimeCode = 1
    endTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
)
def PlenDataset "Mine" {
    rel plen:cameras = </Mine/Eye>
    rel plen:targets = </Mine/Board>

    def Camera "Eye" ( # mine ( too
        prepend apiSchemas = ["PlenCameraAPI"]
    )
    {   # { here
        rel plen:camera:lens = </Mine/Lens>
        uniform double plen:camera:sensorDistance = 115
        rel plen:camera:sensor = </Mine/Sensor>
    }
    def "Lens" ( prepend references = @lenses/double_gauss_100mm_tronnier.usda@ ) {}
    def PlenSensor "Sensor" {
        double2 plen:offset = (1, 0.5)
        uniform double plen:pixelPitch = 0.01
        uniform int2 plen:resolution = (800, 600)
    }
    def "Board" ( prepend references = @targets/checkerboard_4x7.usda@ ) {
        double3 xformOp:translate = (0, 0, -900)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""


def test_the_snippet_of_the_readme_gets_six_types_and_stays_the_same_dataset(tmp_path):
    path = stage_in(tmp_path, SNIPPET)
    before = open_dataset(path)
    assert "`pipeline check --fix`" in note_on_viewers(path, write=False)
    assert path.read_text(encoding="utf-8") == SNIPPET

    note_on_viewers(path, write=True)
    lines = path.read_text(encoding="utf-8").splitlines()
    old = SNIPPET.splitlines()
    start = lines.index("    fallbackPrimTypes = {")
    assert lines[:start] + lines[start + 8 :] == old
    assert len(lines) == len(old) + 8  # six types in a dictionary
    assert open_dataset(path) == before
    assert note_on_viewers(path, write=False) is None


def test_a_camera_of_ones_own_gets_its_view_among_comments_and_odd_layout(tmp_path):
    """121.7263 mm from a sensor 125 mm behind the stop, published; the exit pupil stands 5.233 mm before the stop."""
    path = stage_in(tmp_path, OWN)
    assert load(path).errors == []
    assert fix(path) == 4 + 5  # all types except that of the dataset; three lengths and two offsets
    text = path.read_text(encoding="utf-8")
    kept = iter(text)
    assert all(character in kept for character in OWN)  # in this order
    stage = Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(path.as_posix()))
    eye = UsdGeom.Camera(stage.GetPrimAtPath("/Mine/Eye"))
    assert stage.GetMetadata("fallbackPrimTypes")["PlenDataset"] == ["Scope"]
    assert stage.GetMetadata("fallbackPrimTypes")["PlenSurface"] == ["Scope"]
    assert eye.GetFocalLengthAttr().Get() == pytest.approx(1217.263 * (115 + 5.233) / (125 + 5.233), rel=1e-5)
    assert (eye.GetHorizontalApertureAttr().Get(), eye.GetVerticalApertureAttr().Get()) == (80, 60)
    assert (eye.GetHorizontalApertureOffsetAttr().Get(), eye.GetVerticalApertureOffsetAttr().Get()) == (-10, 5)


def test_a_file_that_is_no_text_is_left_as_it_is(tmp_path):
    Sdf.Layer.OpenAsAnonymous(stage_in(tmp_path, SNIPPET).as_posix()).Export(str(tmp_path / "binary.usdc"))
    before = (tmp_path / "binary.usdc").read_bytes()

    with pytest.raises(UsageError, match=r"by hand:\s+token\[\] PlenCheckerboard"):
        fix(tmp_path / "binary.usdc")
    assert (tmp_path / "binary.usdc").read_bytes() == before
