"""`pipeline design` as a user meets it: a rig that passes `check`, and a page of what real rays make of it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from places import ROOT

from pipeline.scene.load import load

SENSOR = "sensors/sensor_640x480_10um.usda"
THIN = ("--focal-length", "50", "--sensor", SENSOR)
REAL = ("--lens", "lenses/double_gauss_100mm_tronnier.usda", "--sensor", SENSOR)
RANGE = ("--near", "380", "--far", "480")


def test_a_designed_rig_passes_check_and_real_rays_keep_its_promise(run):
    """Ends of the ranges by rays, against what the formulas promise; views as the exit pupil of a thin lens has it."""
    code, output, _ = run(
        "design", "plenoptic", "r.usda", *THIN, "--near", "250", "--far", "500", "--micro-image", "16", "--json"
    )
    assert code == 0
    answer = json.loads(output)
    seen, meant = answer["judged"]["depth_of_field_mm"], answer["promised"]["depth_of_field_mm"]
    np.testing.assert_allclose(seen, meant, rtol=3e-4)  # rays are not paraxial: the square of their slopes, F/7
    assert (meant[0][0], meant[-1][1]) == pytest.approx((250, 500))
    views = answer["judged"]["views"]
    assert [row["formula_mm"] for row in views] == pytest.approx([row["z_mm"] for row in views], rel=1e-3)
    design = answer["design"]
    gap_mm = design["microlens_distance_mm"]
    for point in answer["judged"]["viewpoints"][:2]:  # the edge of the pupil cuts the bundles of the third
        x_mm = 0.01 * point["view_px"] * (design["sensor_distance_mm"] - gap_mm) / gap_mm  # seen through the vertices
        assert point["place_mm"][:2] == pytest.approx([x_mm, 0], abs=0.02)
        assert abs(point["place_mm"][2]) < 0.2  # bundles are wide, and the light across them falls off in the field
    loaded = load("r.usda", look=True)
    assert loaded.problems == []
    (entry,) = loaded.cameras
    assert list(entry.camera.microlenses.focal_lengths_mm) == design["focal_lengths_mm"]
    assert 2 * entry.camera.prescription.stop.semi_diameter_mm == pytest.approx(design["stop_diameter_mm"])


def test_an_unfocused_rig_of_the_library_says_where_its_views_meet(run):
    code, output, _ = run("design", "plenoptic", "r.usda", *REAL, *RANGE, "--unfocused", "--micro-image", "8")
    assert code == 0
    assert "views of one pixel are sharp from 380.00 to 480.00 mm" in output
    assert "@lenses/double_gauss_100mm_tronnier.usda@" in Path("r.usda").read_text(encoding="utf-8")
    assert load("r.usda", look=True).problems == []
    table = output.partition("refocusing")[2].splitlines()[2:11]
    assert [float(table[row].split()[1]) for row in (0, -1)] == pytest.approx([-1, 1], abs=0.02)


def test_the_rig_of_the_example_is_what_its_command_writes(run):
    page = (ROOT / "examples/13_design/README.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"    pipeline (design .*\n.*)\n", page)
    code, output, _ = run(*command.replace("\\", "").split())
    assert code == 0
    assert Path("rig.usda").read_text(encoding="utf-8") == (ROOT / "examples/13_design/rig.usda").read_text("utf-8")
    shown = re.findall(r"^    (.*\d.*)$", page.partition("## What was designed")[2].partition("## Edits")[0], re.M)
    lines = [line.strip() for line in output.splitlines()]
    assert len(shown) == 12 and [line for line in shown if line.strip() not in lines] == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((*REAL, *RANGE, "--unfocused"), "px per micro-image"),
        ((*REAL, "--near", "380"), "--magnification"),
        (("--sensor", "targets/charuco_8x5.usda", *THIN[:2], *RANGE), "PlenSensor"),
        ((*REAL, "--near", "500", "--far", "inf", "--types", "1"), "--near farther"),
        (("--sensor", SENSOR, *RANGE), "--focal-length"),
        ((*THIN, "--magnification", "0.1"), "--f-number"),
        ((*REAL, *RANGE, "--unfocused", "--types", "3"), "--types"),
    ],
)
def test_what_cannot_be_designed_writes_nothing_and_says_what_to_change(run, options, words):
    code, output, log = run("design", "plenoptic", "r.usda", *options)
    assert (code, output) == (2, "")
    assert words in log.rpartition("hint:")[2]
    assert not Path("r.usda").exists()
