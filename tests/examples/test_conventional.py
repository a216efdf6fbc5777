"""What example 01 promises: whole, large and partly sharp boards, from which OpenCV finds the camera that made them."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from builds import made
from stage_text import edited, stage_in

import pipeline

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/01_conventional"
COLUMNS, ROWS = 7, 4


@pytest.fixture(scope="module")
def built(tmp_path_factory, common_store):
    """The example with noisy images, which nothing here reads."""
    folder = tmp_path_factory.mktemp("example")
    text = (EXAMPLE / "dataset.usda").read_text(encoding="utf-8")
    rig = "@rigs/conventional_100mm.usda@\n    )\n    {\n"
    coarse = edited(text, (rig, f'{rig}over "Camera"\n{{\nuniform int plen:image:samples = 4\n}}\n'))
    return made(stage_in(folder, coarse), folder / "out", common_store).out


def calibrate(out: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, EXAMPLE / "calibrate.py", out], capture_output=True, text=True)


def test_the_lens_is_found_as_far_as_it_is_a_pinhole(built):
    """Rows are solved to 0.001 px; what is left is what no pinhole can be."""
    text = calibrate(built).stdout
    boards = np.array(re.findall(r"off by \((\S+), (\S+), (\S+)\) mm, (\S+) degrees", text), float)
    assert float(re.search(r"RMS (\S+) px", text)[1]) < 0.01
    assert abs(float(re.search(r"difference (\S+) %", text)[1])) < 0.1
    assert boards.shape == (6, 4) and np.abs(boards[:, :3]).max() < 0.05 and boards[:, 3].max() < 0.01


def test_boards_are_whole_and_large_and_two_are_sharp(built):
    """All corners and the margin in every frame, 12 px per square or more, and a blur below 1 px^2 in two frames."""
    camera = pipeline.open_output(built).camera
    sharp = 0
    for view in camera.views:
        rows = view.correspondences
        assert rows.point_id.tolist() == list(range(COLUMNS * ROWS))
        grid = np.stack([rows.x_px, rows.y_px], axis=-1).reshape(ROWS, COLUMNS, 2)
        along, down = np.diff(grid, axis=1), np.diff(grid, axis=0)
        assert min(np.linalg.norm(along, axis=2).min(), np.linalg.norm(down, axis=2).min()) >= 12
        # Beyond the outermost corners: a square, and the white margin as wide as one.
        rim = (
            grid[:, [0, -1]] + 2 * along[:, [0, -1]] * [[-1], [1]],
            grid[[0, -1]] + 2 * down[[0, -1]] * [[[-1]], [[1]]],
        )
        outermost = np.concatenate([part.reshape(-1, 2) for part in rim])
        assert (outermost > -0.5).all() and (outermost < np.array(camera.size_px) - 0.5).all()
        sharp += bool((rows.blur_xx_px2 + rows.blur_yy_px2 < 1).all())
    assert sharp >= 2


def test_a_folder_without_a_build_is_named(tmp_path):
    run = calibrate(tmp_path)
    assert run.returncode == 1 and f"{tmp_path} holds no finished build" in run.stderr
