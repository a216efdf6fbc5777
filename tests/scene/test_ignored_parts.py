"""What no number of a build heeds is told all the same, where it contradicts itself."""

from pathlib import Path

import pytest
from stage_text import stage_in, tiny_text

from pipeline.errors import PipelineError
from pipeline.scene.load import load

LENS = """
        over "Lens"
        {{
            over "S1"
            {{
                {}
            }}
        }}

        over "Sensor"
"""
PREVIEW = """        uniform int plen:columns = 3

        def Mesh "Preview"
        {
            int[] faceVertexCounts = [3, 4]
            int[] faceVertexIndices = [0, 1, 7]
            point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
        }

"""


def told(folder: Path, *edits: tuple[str, str]) -> list[str]:
    path = stage_in(folder, tiny_text("conventional", *edits))
    try:
        return [one.message for one in load(path).problems]
    except PipelineError as error:
        return str(error).splitlines()


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("double[] plen:coatingReflectance = [0.1, 0.2, 0.3, 0.4, 0.5]", "a coating has 0 wavelengths"),
        ("double[] plen:coatingFilmIndices = [1.38]", "a coating has films of 1 indices and 0 thick"),
    ],
)
def test_coatings_that_contradict_themselves_are_refused_where_lenses_are_ideal(written, said, tmp_path):
    edit = '        over "Sensor"\n', LENS.format(written).lstrip("\n")
    lines = told(tmp_path, edit)
    assert any(said in line for line in lines), lines


def test_the_broken_mesh_of_a_preview_is_named(tmp_path):
    lines = told(tmp_path, ("        uniform int plen:columns = 3\n", PREVIEW))
    assert any("Preview>: faceVertexCounts name 7 corners" in line for line in lines), lines
