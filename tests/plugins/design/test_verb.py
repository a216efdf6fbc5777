"""`pipeline design` as a user meets it: a rig that passes `check`, and a page of what real rays make of it."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from places import ROOT
from stage_text import head

from pipeline.scene.load import load

SENSOR = "sensors/sensor_640x480_10um.usda"
THIN = ("--focal-length", "50", "--sensor", SENSOR)
REAL = ("--lens", "lenses/double_gauss_100mm_tronnier.usda", "--sensor", SENSOR)
RANGE = ("--near", "380", "--far", "480")
SMALL = """def PlenSensor "Sensor"
{
    uniform double plen:pixelPitch = 0.0055
    uniform int2 plen:resolution = (600, 450)
}
"""
UNFOCUSED = (
    *("--lens", "lenses/double_gauss_50mm_tronnier.usda", "--sensor", "s.usda", "--near", "400", "--far", "3000"),
    *("--unfocused", "--micro-image", "14"),
)


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


def test_design_show_fit_and_planes_of_an_unfocused_rig_say_the_same_range(run):
    """Lytro's kind; by its micro-images everything from 44 to 409 mm would be sharp, and boards stood there."""
    Path("s.usda").write_text(head("Sensor") + SMALL, encoding="utf-8")
    assert run("design", "plenoptic", "r.usda", *UNFOCUSED)[0] == 0
    figures = json.loads(run("show", "r.usda", "--json")[1])
    assert figures["depth_of_field_mm"] == pytest.approx([400, 3000], rel=1e-6)
    assert figures["near_far_mm"][0] == pytest.approx(400, rel=1e-6)
    wanted = ("--target", "targets/checkerboard_4x7.usda", "--fit", "--poses", "2")
    code, _, said = run("new", "dataset", "d.usda", "--rig", "r.usda", *wanted)
    assert (code, "warning" in said) == (0, False)
    boards = [np.array(frame.world_from_target["Board"])[2, 3] for frame in load("d.usda").dataset.frames]
    assert all(-3000 < z_mm < -400 for z_mm in boards)
    text = Path("d.usda").read_text(encoding="utf-8")
    for z_mm, is_seen in ((143, False), (600, True)):  # micro-images have squares of 1.2 px, without blur, at 143 mm
        moved = re.sub(r"(translate.timeSamples = \{)[^}]*", rf"\1 1: (0, 0, -{z_mm}) ", text)
        near = re.sub(r"squareSize = [\d.]+", "squareSize = 1.49", moved).replace("endTimeCode = 2", "endTimeCode = 1")
        Path("near.usda").write_text(near, encoding="utf-8")
        codes = [problem.code for problem in load("near.usda", look=True).problems]
        assert codes == ([] if is_seen else ["blank"])


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
