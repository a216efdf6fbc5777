"""Claim: the picture of a board that flies past a rolling shutter is that of Blender's Cycles."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from laws import test_shutter

PYTHON = os.environ.get("BLENDER_PYTHON", sys.executable)
"""An interpreter that has `bpy`: it may be another one, as its wheels are made for one version of Python each."""
SIZE_PX, SQUARE_MM, BACKGROUND = (32, 24), 1.4, 0.5
OPEN_FRAMES, EXPOSED_SHARE, TURN_DEG = 0.75, 0.25, 40.0
# Cycles exposes row r of H for the share d of the time S that it is open, from S (1 - d) (r + 1) / H on.
SHUTTER = """
token scanOrder = "topToBottom"
double2 opens = (1, 1024)
double2 lineOffset = (1, 1024)
double2 exposure = (1, 128)
int instants = 64
"""
PLACES_MM = (-1.5, 2.0, -434.4), (4.5, -3.0, -430.0)
SAME, APART = 0.006, 0.05
"""Differences of pixels, rms over white [1]: more than the samples of both make, and less than a delay by one line."""


def rectangles() -> list:
    """The tiny board: 4 x 3 squares, the top left one black, before a sheet with a margin of one square."""
    sheet = [-3, -2.5, 3, 2.5, 0.0]
    black = [[c - 2, 0.5 - r, c - 1, 1.5 - r, 1e-3] for r in range(3) for c in range(4) if (r + c) % 2 == 0]
    return [[*(SQUARE_MM * np.array(each)).tolist(), float(each is sheet)] for each in (sheet, *black)]


def of_cycles(folder: Path, camera: dict) -> np.ndarray:
    f_px, centre_z_mm = camera["principal_distance_px"], camera["centre_mm"][2]
    keys = [
        (frame, [x, y, z + centre_z_mm], np.radians(turn))
        for frame, (x, y, z), turn in zip((1, 2), PLACES_MM, (0, TURN_DEG), strict=True)
    ]
    how = {"f_widths": f_px / SIZE_PX[0], "keys": keys, "rectangles": rectangles(), "background": BACKGROUND}
    how |= {"size_px": SIZE_PX, "open_frames": OPEN_FRAMES, "exposed_share": EXPOSED_SHARE, "samples": 4096}
    (folder / "how.json").write_text(json.dumps(how))
    program = Path(__file__).with_name("cycles_board.py")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [PYTHON, program, folder / "how.json", folder / "out.npy"]
    said = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert (folder / "out.npy").exists(), said.stdout + said.stderr
    return np.load(folder / "out.npy")


@pytest.mark.heavy
def test_cycles_paints_the_board_where_we_do(tmp_path, common_store):
    if subprocess.run([PYTHON, "-c", "import bpy"], capture_output=True).returncode:
        assert "BLENDER_PYTHON" not in os.environ, f"{PYTHON} has no bpy"
        pytest.skip("NOT JUDGED: bpy is not installed; BLENDER_PYTHON may name a Python that has it")
    turn = (np.cos(np.radians(TURN_DEG / 2)), 0, 0, np.sin(np.radians(TURN_DEG / 2)))
    samples = "uniform int plen:image:samples = 64\n"
    edits = (
        (samples, samples + '            uniform token plen:camera:model = "pinhole"\n'),
        ("1: (1, 0, 0, 0),", f"1: (1, 0, 0, 0),\n            2: {tuple(map(float, turn))},"),
        ("uniform int plen:seed = 3", f"uniform int plen:seed = 3\n    uniform double plen:background = {BACKGROUND}"),
    )
    images = []
    for name, shutter in (("scanned", SHUTTER), ("late", SHUTTER.replace("opens = (1", "opens = (2"))):
        path = test_shutter.stage(tmp_path / name, shutter, tuple(map(str, PLACES_MM)), *edits)
        images.append(test_shutter.built(path, common_store)[1])
    camera = json.loads((tmp_path / "scanned/out/cameras/Rig.Camera/camera.json").read_text())["pinhole"]
    theirs = of_cycles(tmp_path, camera)
    same, late = (np.sqrt(np.mean((image - theirs) ** 2)) for image in images)
    assert same < SAME and late > APART
