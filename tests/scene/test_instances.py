"""What is said below an instance is refused, because USD takes no notice of it; instances themselves are prims."""

import pytest

from pipeline.scene.load import load

RIG = """#usda 1.0
(
    defaultPrim = "Rig"
    metersPerUnit = 0.001
    upAxis = "Y"
)

def Xform "Rig" (
    prepend references = @rigs/conventional_100mm.usda@
)
{{
{text}
}}
"""
TOP = """#usda 1.0
(
    defaultPrim = "Two"
    metersPerUnit = 0.001
    upAxis = "Y"
)

def Xform "Two"
{{
    def "Left" (
        instanceable = true
        prepend references = @rig.usda@
    )
    {{
{below}
    }}
}}
"""
PITCH = """        over "Sensor"
        {
            uniform double plen:pixelPitch = 0.02
        }"""

SCOPE = """        def Scope "Mine"
        {
        }"""
OTHER_LENS = """        over "Lens" (
            references = @lenses/tessar_100mm_zemax.usda@
        )
        {
        }"""


@pytest.fixture
def path(tmp_path):
    """A function that writes a rig that is an instance, with opinions in its file and with others below it."""

    def written(text: str = "", below: str = ""):
        (tmp_path / "rig.usda").write_text(RIG.format(text=text))
        (tmp_path / "two.usda").write_text(TOP.format(below=below))
        return tmp_path / "two.usda"

    return written


@pytest.mark.parametrize("below", [SCOPE, OTHER_LENS])
def test_new_prims_and_references_are_such_opinions(path, below):
    assert [problem.code for problem in load(path(below=below)).problems] == ["below-instance"]


def test_what_the_file_of_an_instance_says_counts(path):
    loaded = load(path(text=PITCH))
    assert not loaded.errors
    [entry] = loaded.cameras
    assert entry.camera.sensor.pitch_mm == 0.02


def test_instances_in_instances_are_looked_at(path, tmp_path):
    inner = path(below=PITCH).rename(tmp_path / "inner.usda")
    assert [problem.code for problem in load(inner).problems] == ["below-instance"]
    (tmp_path / "two.usda").write_text(TOP.format(below="").replace("rig.usda", "inner.usda"))
    [problem] = load(tmp_path / "two.usda").problems
    assert (problem.code, problem.at) == ("below-instance", "/Two/Left/Left")
