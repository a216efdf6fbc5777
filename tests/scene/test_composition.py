"""What USD lays over a part: opinions below an instance, of which it takes no notice, and a second reference, which
replaces nothing unless it states all that the first one did; both are refused.
"""

from pathlib import Path

import pytest
from stage_text import head

from pipeline.scene.load import load

RIG = """def Xform "Rig" (
    prepend references = @rigs/conventional_100mm.usda@
)
{{
{text}
}}
"""
TOP = """def Xform "Two"
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
        (tmp_path / "rig.usda").write_text(head("Rig") + RIG.format(text=text))
        (tmp_path / "two.usda").write_text(head("Two") + TOP.format(below=below))
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
    (tmp_path / "two.usda").write_text(head("Two") + TOP.format(below="").replace("rig.usda", "inner.usda"))
    [problem] = load(tmp_path / "two.usda").problems
    assert (problem.code, problem.at) == ("below-instance", "/Two/Left/Left")


PART = """def {type} "Part" (
    prepend references = [{references}]
)
{{
{text}
}}
"""
TRIPLET, GAUSS = "@lenses/cooke_triplet_50mm.usda@", "@lenses/double_gauss_100mm_tronnier.usda@"
SMALL, LARGE = "@sensors/sensor_640x480_10um.usda@", "@sensors/sensor_800x600_10um.usda@"
FILTER = """    uniform token[] plen:surfaceOrder = ["Front", "S1", "S2", "S3", "Stop", "S5", "S6"]
    def PlenSurface "Front" {
        uniform double plen:thickness = 5
        uniform double plen:semiDiameter = 12
    }"""


def codes(folder: Path, type_name: str, references: str, text: str = "") -> list[str]:
    path = folder / "part.usda"
    path.write_text(head("Part") + PART.format(type=type_name, references=references, text=text))
    return [problem.code for problem in load(path).errors]


@pytest.mark.parametrize(
    ("kind", "one", "other", "expected"), [("PlenLens", TRIPLET, GAUSS, ["merged"]), ("PlenSensor", SMALL, LARGE, [])]
)
def test_two_lenses_in_one_are_one_mistake_and_what_replaces_all_is_none(tmp_path, kind, one, other, expected):
    assert codes(tmp_path, kind, f"{one}, {other}") == codes(tmp_path, kind, f"{other}, {one}") == expected


def test_what_is_kept_of_a_sensor_is_told(tmp_path):
    other = PART.format(
        type="PlenSensor",
        references="",
        text='    uniform token plen:acceptance = "cosine"\n    uniform double plen:acceptancePower = 2',
    )
    (tmp_path / "cosine.usda").write_text(head("Part") + other.replace("    prepend references = []\n", ""))
    assert codes(tmp_path, "PlenSensor", f"{SMALL}, @cosine.usda@") == ["merged"]
    assert codes(tmp_path, "PlenSensor", f"{SMALL}, @cosine.usda@", "    uniform double plen:acceptancePower = 3") == [
        "merged"
    ]
    own = '    uniform token plen:acceptance = "cosine"\n    uniform double plen:acceptancePower = 3'
    assert codes(tmp_path, "PlenSensor", f"{SMALL}, @cosine.usda@", own) == []
    (tmp_path / "part.usda").rename(tmp_path / "mine.usda")
    assert codes(tmp_path, "PlenSensor", "@mine.usda@") == []


@pytest.mark.parametrize("text", ["", FILTER])
def test_a_lens_that_builds_on_another_is_one_lens(tmp_path, text):
    """Two files deep, with a surface of its own before the others."""
    assert codes(tmp_path, "PlenLens", TRIPLET, text) == []
    (tmp_path / "part.usda").rename(tmp_path / "mine.usda")
    assert codes(tmp_path, "PlenLens", "@mine.usda@") == []
