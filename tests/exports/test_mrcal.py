"""mrcal itself, where its Debian package is installed: it converges on our corners and reads our models."""

import ast
import shutil
import subprocess

import numpy as np
import pytest
from exports.pretended import (
    CENTRE_PX,
    COLUMNS,
    F_PX,
    FACING,
    ROWS,
    SIZE_PX,
    SQUARE_MM,
    Scene,
    turned,
    write_build,
)

from pipeline.built.output import open_output
from pipeline.exports.export import export
from pipeline.frames import rigid

pytestmark = [
    pytest.mark.heavy,
    pytest.mark.skipif(shutil.which("mrcal-calibrate-cameras") is None, reason="mrcal is not installed"),
]


def many_poses() -> dict[int, np.ndarray]:
    """Twenty boards over the image, turned by up to half a radian: three are too few for mrcal to start from."""
    random = np.random.default_rng(3)
    return {
        frame: rigid(
            turned(*random.uniform(-0.5, 0.5, 3)) @ FACING,
            np.array([*random.uniform(-1, 1, 2) * [70, 50] - [20, 0], random.uniform(300, 480)]),
        )
        for frame in range(1, 21)
    }


def test_mrcal_converges_on_our_corners_to_our_pinholes(tmp_path):
    scene = Scene(poses=many_poses())
    (folder,) = export(open_output(write_build(tmp_path / "out", scene)), ["mrcal"], tmp_path)
    board = ["--object-spacing", SQUARE_MM / 1000, "--object-width-n", COLUMNS, "--object-height-n", ROWS]
    command = ["mrcal-calibrate-cameras", "--corners-cache", folder / "corners.vnl", "--focal", F_PX, *board]
    command += ["--lensmodel", "LENSMODEL_OPENCV5", "--imagersize", *SIZE_PX, "--outdir", tmp_path]
    command += ["--skip-calobject-warp-solve", "--skip-regularization"]
    done = subprocess.run(
        [str(word) for word in (*command, *(f"frames/*/{name}/image.png" for name in scene.rig))],
        capture_output=True, text=True, cwd=folder, check=True,
    )  # fmt: skip
    assert "RMS reprojection error: 0.0 pixels" in done.stdout
    for number, name in enumerate(scene.rig):
        text = (tmp_path / f"camera-{number}.cameramodel").read_text().splitlines()
        found = ast.literal_eval("\n".join(line for line in text if not line.lstrip().startswith("#")))
        np.testing.assert_allclose(found["intrinsics"][:4], [F_PX, F_PX, *CENTRE_PX], rtol=0, atol=0.5)
        np.testing.assert_allclose(found["extrinsics"][3:], scene.rig[name][:3, 3] / 1000, rtol=0, atol=1e-3), name
