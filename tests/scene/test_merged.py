"""A part that a second reference is laid over is told, unless the second says all that the first one said."""

from pathlib import Path

import pytest

from pipeline.scene.load import load

PART = """#usda 1.0
(
    defaultPrim = "Part"
    metersPerUnit = 0.001
    upAxis = "Y"
)

def {type} "Part" (
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


def said(folder: Path, type_name: str, references: str, text: str = "") -> list[str]:
    """Codes of what `check` says."""
    path = folder / "part.usda"
    path.write_text(PART.format(type=type_name, references=references, text=text))
    return [problem.code for problem in load(path).errors]


@pytest.mark.parametrize("references", [f"{TRIPLET}, {GAUSS}", f"{GAUSS}, {TRIPLET}"])
def test_two_lenses_in_one_are_one_mistake(tmp_path, references):
    assert said(tmp_path, "PlenLens", references) == ["merged"]


@pytest.mark.parametrize("references", [f"{SMALL}, {LARGE}", f"{LARGE}, {SMALL}"])
def test_what_replaces_all_is_no_mistake(tmp_path, references):
    assert said(tmp_path, "PlenSensor", references) == []


def test_what_is_kept_of_a_sensor_is_told(tmp_path):
    other = PART.format(
        type="PlenSensor",
        references="",
        text='    uniform token plen:acceptance = "cosine"\n    uniform double plen:acceptancePower = 2',
    )
    (tmp_path / "cosine.usda").write_text(other.replace("    prepend references = []\n", ""))
    assert said(tmp_path, "PlenSensor", f"{SMALL}, @cosine.usda@") == ["merged"]


@pytest.mark.parametrize("text", ["", FILTER])
def test_a_lens_that_builds_on_another_is_one_lens(tmp_path, text):
    """Two files deep, with a surface of its own before the others."""
    assert said(tmp_path, "PlenLens", TRIPLET, text) == []
    (tmp_path / "part.usda").rename(tmp_path / "mine.usda")
    assert said(tmp_path, "PlenLens", "@mine.usda@") == []
