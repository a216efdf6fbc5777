"""Whole builds of rigs with other microlenses than the paper's: from the stage to correspondences."""

import json
from pathlib import Path

import numpy as np
import pytest
from shorter import few
from stage_text import stage_in, tiny_text

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


@pytest.mark.parametrize("array", few([SQUARE], REFRACTIVE), ids=["square discs", "refractive columns, tilted"])
def test_rigs_with_other_microlenses_are_built(array: str, tmp_path: Path) -> None:
    """Rows and types, what camera.json says, and the share of light in white.exr that came through neighbours."""
    sensor, pixels = '\n        over "Sensor"', ("\n            uniform int2 plen:resolution", PIXELS)
    stage = stage_in(tmp_path, tiny_text("plenoptic", (sensor, array + sensor), pixels))
    result = pipeline.build(stage, tmp_path / "out", jobs=1)
    assert result.exit_code == 0, [task.error for task in result.failures]

    assert len(read_table(result.out / "frames/0001/Rig.Camera/correspondences.csv").numbers("x_px")) > 0
    folder = result.out / "cameras/Rig.Camera"
    types = set(read_table(folder / "micro_images.csv").numbers("microlens_type"))
    document = json.loads((folder / "camera.json").read_text(encoding="utf-8"))
    mla = document["mla"]
    assert document["pixel_acceptance"] == {"shape": "cosine", "power": 2.0}
    if array is SQUARE:
        assert (types, mla["layout"], mla["count"], mla["disc_diameter_mm"]) == ({0}, "square", 120, 0.19)
    else:
        assert (types, mla["layout"], mla["model"]) == ({0, 1, 2}, "hexagonal-columns", "refractive")
        found = [entry["focal_length_mm"] for entry in mla["types"]]
        np.testing.assert_allclose(found, [1.9, 2.1, 2.3], rtol=1e-3)
        assert (mla["tilt_deg"], found == [1.9, 2.1, 2.3]) == (
            [0.02, -0.015],
            False,
        )  # the focal lengths that faces make

    white = read_exr(folder / "white.exr")
    share, lit = white["crosstalk"].channels["Y"], white["white"].channels["Y"] > 0
    assert np.all((share[lit] >= 0) & (share[lit] <= 1)) and np.isnan(share[~lit]).all()
    assert 0 <= float(white["crosstalk"].attributes["of_all_light"]) < 0.5
