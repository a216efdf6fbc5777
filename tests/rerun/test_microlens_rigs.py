"""Whole builds of rigs with other microlenses than the paper's: from the stage to correspondences."""

import json
from pathlib import Path

import numpy as np
import pytest
from stage_text import tiny_text

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table

SQUARE = """
        over "Microlenses"
        {
            uniform token plen:layout = "square"
            uniform double[] plen:focalLengths = [2.1]
            uniform double plen:width = None
            uniform double plen:height = None
            uniform int plen:columns = 12
            uniform int plen:rows = 10
            uniform token plen:aperture = "disc"
            uniform double plen:discDiameter = 0.19
        }
"""
REFRACTIVE = """
        over "Microlenses"
        {
            uniform token plen:model = "refractive"
            uniform token plen:layout = "hexagonal-columns"
            uniform double[] plen:focalLengths = [1.9, 2.1, 2.3]
            uniform double[] plen:frontRadii = [0.98176, 1.0851, 1.18845]
            uniform double[] plen:rearRadii = [inf, inf, inf]
            uniform string plen:glass = "schott:N-BK7"
            uniform double plen:thickness = 0.1
            uniform double2 plen:tilt = (0.02, -0.015)
        }
"""
PIXELS = """
            uniform token plen:acceptance = "cosine"
            uniform double plen:acceptancePower = 2
            uniform int2 plen:resolution"""


@pytest.fixture(
    scope="module",
    params=[SQUARE, pytest.param(REFRACTIVE, marks=pytest.mark.heavy)],
    ids=["square discs", "refractive columns, tilted"],
)
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    folder = tmp_path_factory.mktemp("rig")
    sensor = '\n        over "Sensor"'
    pixels = ("\n            uniform int2 plen:resolution", PIXELS)
    text = tiny_text("plenoptic", (sensor, request.param + sensor), pixels)
    (folder / "dataset.usda").write_text(text, encoding="utf-8")
    result = pipeline.build(folder / "dataset.usda", folder / "out", jobs=1)
    assert result.exit_code == 0, [task.error for task in result.failures]
    return request.param, folder / "out"


def test_the_truth_of_the_rig_is_built(built: tuple[str, Path]) -> None:
    """Rows of every type, each seen through its own microlens."""
    kind, out = built
    table = read_table(out / "frames/0001/Rig.Camera/correspondences.csv")
    assert len(table.numbers("x_px")) > 0
    types = read_table(out / "cameras/Rig.Camera/micro_images.csv").numbers("microlens_type")
    assert set(types) == ({0} if kind is SQUARE else {0, 1, 2})


def test_the_report_names_the_microlenses(built: tuple[str, Path]) -> None:
    """Layout, model, apertures, acceptance, and the focal lengths that faces make."""
    kind, out = built
    document = json.loads((out / "cameras/Rig.Camera/camera.json").read_text(encoding="utf-8"))
    array = document["mla"]
    assert document["pixel_acceptance"] == {"shape": "cosine", "power": 2.0}
    if kind is SQUARE:
        assert (array["layout"], array["count"], array["disc_diameter_mm"]) == ("square", 120, 0.19)
        return
    assert (array["layout"], array["model"]) == ("hexagonal-columns", "refractive")
    assert array["tilt_deg"] == [0.02, -0.015]
    found = [entry["focal_length_mm"] for entry in array["types"]]
    np.testing.assert_allclose(found, [1.9, 2.1, 2.3], rtol=1e-3)
    assert found != [1.9, 2.1, 2.3]


def test_the_white_image_says_what_came_through_neighbours(built: tuple[str, Path]) -> None:
    """Per pixel a share of its light, NaN where there is none, and over all of it one in the header."""
    white = read_exr(built[1] / "cameras/Rig.Camera/white.exr")
    share = white["crosstalk"].channels["Y"]
    lit = white["white"].channels["Y"] > 0
    assert np.all((share[lit] >= 0) & (share[lit] <= 1))
    assert np.isnan(share[~lit]).all()
    assert 0 <= float(white["crosstalk"].attributes["of_all_light"]) < 0.5
