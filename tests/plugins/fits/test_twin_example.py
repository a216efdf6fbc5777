"""Example 14 and the page about it, walked to their end: the twin is the real camera, as far as it says that it is."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from places import ROOT
from stage_text import edited

import pipeline
from pipeline.files.exr import read_exr
from pipeline.files.jsonfile import read_json
from pipeline.files.tables import read_table
from pipeline.plugins.fits.free_numbers import FreeStage

EXAMPLE = ROOT / "examples/14_twin"


@pytest.mark.heavy(minutes=4)
@pytest.mark.parametrize(
    ("script", "told", "apart_px"),
    [("twin", ["/Twin/Rig/Sensor.plen:offset[0]"], 0.05), ("plenoptic", ["/Twin/Rig/Microlenses.plen:pitch"], 0.1)],
)
def test_the_twin_of_the_example_is_its_real_camera(script, told, apart_px, tmp_path, common_store):
    """Within five deviations; and so are the exact rows of all points, which the fit was never told."""
    environment = {**os.environ, "PIPELINE_CACHE": str(common_store)}
    subprocess.run([sys.executable, EXAMPLE / f"{script}.py", tmp_path], check=True, env=environment)
    fit = read_json(tmp_path / "fitted.json")
    numbers = {each["name"]: each for each in fit["numbers"]}
    real = {each.name: each.before for each in FreeStage(tmp_path / "real.usda", [*numbers], [EXAMPLE]).numbers}
    assert fit["converged"] and real.keys() == numbers.keys()
    for name, number in numbers.items():
        assert abs(number["after"] - real[name]) < 5 * number["deviation"], name
    assert all(numbers[name]["information_share"] > 0.3 for name in told)
    assert rms_px(tmp_path / "real", tmp_path / "fitted") < apart_px


def rms_px(real: Path, fitted: Path) -> float:
    """Length of what parts the exact rows of two builds, root of the mean square."""
    theirs, ours = (rows_of(out) for out in (real, fitted))
    assert len(theirs.keys() & ours.keys()) > 0.9 * len(theirs)
    off = np.array([theirs[key] - ours[key] for key in theirs.keys() & ours.keys()])
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def rows_of(out: Path) -> dict[tuple, np.ndarray]:
    rows = {}
    for file in out.glob("frames/*/Rig.Camera/correspondences.csv"):
        table = read_table(file)
        keys = (table.columns[name] for name in ("point_id", "microlens_k", "microlens_l"))
        x_px = np.stack([table.numbers(name) for name in ("x_px", "y_px")], axis=1)
        rows |= dict(zip(zip([file.parts[-3]] * len(x_px), *keys, strict=True), x_px, strict=True))
    return rows


@pytest.mark.heavy
def test_the_walk_of_the_page_ends_with_the_camera_that_took_the_photos(run, tmp_path):
    """The double Gauss of example 01 plays the unknown lens, and the page is told its numbers."""
    parts = ("--rig", "rigs/conventional_100mm.usda", "--target", "targets/charuco_8x5.usda")
    assert run("new", "dataset", "real.usda", *parts, "--poses", "12", "--fit")[0] == 0
    assert run("build", "real.usda")[0] == 0
    square, marker = (
        re.search(rf"plen:{name}Size = (\S+)", Path("real.usda").read_text("utf-8"))[1] for name in ("square", "marker")
    )
    page = edited(
        (ROOT / "docs/how_to/calibrate.md").read_text("utf-8").partition("\n## A lens")[0],
        *(("0.00345", "0.01"), ("(1920, 1200)", "(640, 480)"), ("Size = 22.5", f"Size = {marker}")),
        *(("Size = 30", f"Size = {square}"), ("30, 22.5", f"{square}, {marker}"), ("--poses 20", "--poses 12")),
        *(("--focal-length 16 --f-number 4", "--focal-length 100 --f-number 7.7"), ("--focus 700", "--focus 430")),
    )
    photograph(Path("build/real"), Path("photos"))
    for language, block in re.findall(r"```(\w+)\n(.*?)```", page, re.DOTALL):
        if language == "usda":
            Path(f"own_{'sensor' if 'PlenSensor' in block else 'board'}.usda").write_text(block, "utf-8")
        elif language == "python":
            exec(compile(block, "calibrate.md", "exec"), {})
        else:
            for line in block.replace("\\\n", " ").splitlines():
                words = shlex.split(line.removeprefix("$ pipeline "))
                files = [f"frames/00{n:02}/Rig.Camera/correspondences.csv" for n in range(1, 13)]
                assert run(*words, *(files if words[0] == "build" else ()))[0] in (0, 6), line
    assert read_json(tmp_path / "own_camera.json")["converged"]
    assert rms_px(tmp_path / "build/real", tmp_path / "build/own_camera") < 0.05


def photograph(out: Path, folder: Path) -> None:
    """Images of 8 bits, as the page names them."""
    folder.mkdir()
    for view in pipeline.open_output(out).cameras["Rig.Camera"].views:
        light = read_exr(view.image_path)["image"].channels["Y"]
        cv2.imwrite(
            str(folder / f"{view.frame:02}.png"), np.rint(255 * np.clip(light / light.max(), 0, 1)).astype(np.uint8)
        )
