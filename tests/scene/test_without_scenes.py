"""Without the plug-in `scenes` a stage that needs it is refused, where it says so; tests/examples builds all others."""

import numpy as np
import pytest
from stage_text import in_the_library, mesh_text, placed, stage_in

from pipeline.scene.load import load
from pipeline.scene.usd import plug_in

CORNERS = [(-30.0, -30.0, 0.0), (30.0, -30.0, 0.0), (0.0, 30.0, 0.0)]
BOARD, AWAY = placed(0, 0, -434.4), placed(60, 0, -300)
PLAIN = mesh_text("Thing", CORNERS, AWAY)


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    """The core without its plug-in."""
    monkeypatch.setattr(plug_in, "offered", lambda kind: {})
    plug_in.scene_reader.cache_clear()
    yield
    plug_in.scene_reader.cache_clear()


@pytest.mark.parametrize(
    ("things", "rig", "subject"),
    [
        ('def RectLight "Thing" {\n}', "", "is a lamp, RectLight"),
        (f'def Sphere "Thing" {{\n{AWAY}\n}}', "", "is a Sphere"),
        (PLAIN.replace('"none"', '"loop"'), "", "is a subdivision surface: its subdivisionScheme is loop"),
        ('def PointInstancer "Thing" {\n}', "", "is a point instancer"),
        ('def SkelRoot "Thing" {\n}', "", "is the root of a skeleton"),
        (PLAIN, 'over "Camera" {\nuniform token[] plen:image:labels = ["depth"]\n}', "is a wish for labels of pixels"),
    ],
)
def test_what_only_the_plug_in_reads_is_refused_at_its_line(tmp_path, things, rig, subject):
    text = in_the_library(things, board=BOARD, rig=rig, occluders="/Scene/Thing")
    (wrong,) = load(stage_in(tmp_path, text)).errors
    assert wrong.code == "plug-in-missing" and f"{subject}, and the plug-in that reads it is not" in wrong.message
    line = text.splitlines()[wrong.line - 1]
    assert wrong.file.endswith("dataset.usda") and ("Thing" in line or "plen:image:labels" in line)


def test_a_plain_mesh_is_read_as_it_stands(tmp_path):
    found = load(stage_in(tmp_path, in_the_library(PLAIN, board=BOARD, occluders="/Scene/Thing")))
    assert found.errors == []
    np.testing.assert_array_equal(found.dataset.occluders[0].occluder.vertices_mm, CORNERS)
