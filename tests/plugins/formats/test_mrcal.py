"""mrcal itself, where its Debian package is installed: it converges on our corners and reads our models."""

import ast
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from debian_mrcal import by_mrcal
from plugins.formats.pretended import (
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

from pipeline.exports.export import Request, export
from pipeline.exports.noise import Noise
from pipeline.frames import rigid
from pipeline.results.output import open_output

pytestmark = [
    pytest.mark.heavy,
    pytest.mark.skipif(
        shutil.which("mrcal-calibrate-cameras") is None, reason="NOT JUDGED: mrcal is not installed (Debian: mrcal)"
    ),
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


def calibrated(folder: Path, scene: Scene, out: Path, *more: str) -> str:
    """What mrcal's own command says of an exported folder; it writes `out`/camera-0.cameramodel and so on."""
    board = ["--object-spacing", SQUARE_MM / 1000, "--object-width-n", COLUMNS, "--object-height-n", ROWS]
    command = ["mrcal-calibrate-cameras", "--corners-cache", folder / "corners.vnl", "--focal", F_PX, *board]
    command += ["--lensmodel", "LENSMODEL_OPENCV5", "--imagersize", *SIZE_PX, "--outdir", out]
    command += ["--skip-calobject-warp-solve", *more, *(f"frames/*/{name}/image.png" for name in scene.rig)]
    return subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, cwd=folder, check=True
    ).stdout


def test_mrcal_converges_on_our_corners_to_our_pinholes(tmp_path):
    scene = Scene(poses=many_poses())
    (folder,) = export(open_output(write_build(tmp_path / "out", scene)), ["mrcal"], tmp_path)
    assert "RMS reprojection error: 0.0 pixels" in calibrated(folder, scene, tmp_path, "--skip-regularization")
    for number, name in enumerate(scene.rig):
        text = (tmp_path / f"camera-{number}.cameramodel").read_text().splitlines()
        found = ast.literal_eval("\n".join(line for line in text if not line.lstrip().startswith("#")))
        np.testing.assert_allclose(found["intrinsics"][:4], [F_PX, F_PX, *CENTRE_PX], rtol=0, atol=0.5)
        np.testing.assert_allclose(found["extrinsics"][3:], scene.rig[name][:3, 3] / 1000, rtol=0, atol=1e-3), name


COMPARED = """
fitted, ours = (mrcal.cameramodel(name) for name in given["models"])
distance_m = given["distance_m"]
apart, _, places, _ = mrcal.projection_diff((fitted, ours), gridn_width=12, gridn_height=9, distance=distance_m,
                                            use_uncertainties=False, focus_radius=200)
points = mrcal.unproject(places, *fitted.intrinsics(), normalize=True) * distance_m
stated = mrcal.projection_uncertainty(points, fitted, what="worstdirection-stdev")
print(json.dumps([apart.ravel().tolist(), stated.ravel().tolist()]))
"""
"""Program for Debian's Python: how far two models are apart over the image, and what mrcal states of the first [px].

Frames of the two are laid over each other by what 200 px about the middle show, where boards were: with all of the
image, corners that no board reached would decide.
"""


def test_what_mrcal_finds_from_noisy_corners_differs_from_our_camera_by_what_it_states(tmp_path):
    """Our own .cameramodel is the truth, 400 mm away; three of its sigmas anywhere, and noise of the right size."""
    scene, request = Scene(poses=many_poses()), Request(noise=Noise(noise_px=0.2, seed=7))
    (folder,) = export(open_output(write_build(tmp_path / "out", scene)), ["mrcal"], tmp_path, request)
    calibrated(folder, scene, tmp_path, "--skip-outlier-rejection")
    models = tmp_path / "camera-0.cameramodel", folder / f"{next(iter(scene.rig))}.cameramodel"
    apart, stated = np.array(by_mrcal(COMPARED, {"models": list(map(str, models)), "distance_m": 0.4}))
    assert (apart < 3 * stated).all()
    assert 0.2 < np.sqrt(np.mean((apart / stated) ** 2)) < 1.5
