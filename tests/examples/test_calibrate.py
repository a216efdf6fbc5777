"""The script of example 01 reads what a build writes, and finds the camera that made it."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exports.pretended import write_manifest

from pipeline.app.build import build
from pipeline.files.tables import write_table
from pipeline.frames import apply, rigid
from pipeline.graph.poses import vision_from_target
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.load import open_dataset
from pipeline.targets.patterns.checkerboard import Checkerboard

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "examples/01_conventional/dataset.usda"
PRINCIPAL_MM, PUPIL_MM = 128.0, -6.0

COARSE = f"""#usda 1.0
(
    defaultPrim = "Conventional"
    endTimeCode = 6
    metersPerUnit = 0.001
    startTimeCode = 1
    subLayers = [
        @{EXAMPLE.as_posix()}@
    ]
    timeCodesPerSecond = 24
    upAxis = "Y"
)

over "Conventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            uniform int plen:image:samples = 4
            uniform int plen:truth:samples = 256
        }}
    }}
}}
"""


def calibrate(out: Path) -> tuple[float, float, np.ndarray]:
    """What the script prints: RMS [px], deviation of the principal distance [%], board errors (n, 4) [mm, degrees]."""
    script = EXAMPLE.parent / "calibrate.py"
    run = subprocess.run([sys.executable, script, out], capture_output=True, text=True, check=True, cwd=out)
    rms = float(re.search(r"RMS (\S+) px", run.stdout)[1])
    share = float(re.search(r"difference (\S+) %", run.stdout)[1])
    errors = re.findall(r"off by \((\S+), (\S+), (\S+)\) mm, (\S+) degrees", run.stdout)
    return rms, share, np.array(errors, float)


def write_frame(folder: Path, number: int, entry: CameraEntry, board: Checkerboard, pose: np.ndarray) -> None:
    """What a build writes of a frame, seen through a pinhole at the entrance pupil."""
    points = board.points_mm()
    seen = apply(pose, points) - [0, 0, PUPIL_MM]
    pitch, sensor = entry.camera.sensor.pitch_mm, entry.camera.sensor
    pixels = (
        PRINCIPAL_MM / pitch * seen[:, :2] / seen[:, 2:] + np.array([sensor.width_px - 1, sensor.height_px - 1]) / 2
    )
    columns = dict(zip(("x_px", "y_px"), pixels.T, strict=True))
    columns |= dict(zip(("target_x_mm", "target_y_mm", "target_z_mm"), points.T, strict=True))
    folder = folder / f"frames/{number:04d}/{entry.name}"
    folder.mkdir(parents=True)
    write_table(folder / "correspondences.csv", ["by a pinhole, with a comma, and another"], columns)
    through = pose.copy()
    through[2, 3] -= PUPIL_MM
    where = {"camera_from_target": pose.tolist(), "pinhole": {"pinhole_from_target": through.tolist()}}
    still = np.eye(4).tolist()
    poses = {"camera_from_world": still, "pinhole": {"pinhole_from_world": still}, "targets": {"Board": where}}
    (folder / "poses.json").write_text(json.dumps(poses))


def test_a_pinhole_camera_is_found_as_it_was(tmp_path):
    """Positions in single precision, as OpenCV takes them, leave 3e-5 px and 1e-3 %: nothing else is in the way."""
    dataset = open_dataset(EXAMPLE)
    (entry,), (target,) = dataset.cameras, dataset.targets
    for frame in dataset.frames:
        pose = vision_from_target(frame, entry.name, target.name)
        write_frame(tmp_path, frame.number, entry, target.target.pattern, rigid(pose[:3, :3], pose[:3, 3]))
    sensor = entry.camera.sensor
    plain = {"principal_distance_px": PRINCIPAL_MM / sensor.pitch_mm, "residual_px": {"rms": 0.0, "max": 0.0}}
    plain["principal_point_px"] = [(sensor.width_px - 1) / 2, (sensor.height_px - 1) / 2]
    camera = {
        "resolution": [sensor.width_px, sensor.height_px],
        "pixel_pitch_mm": sensor.pitch_mm,
        "pinhole": {"centre_mm": [0.0, 0.0, PUPIL_MM], **plain, "with_distortion": plain},
    }
    (tmp_path / "cameras/Rig.Camera").mkdir(parents=True)
    (tmp_path / "cameras/Rig.Camera/camera.json").write_text(json.dumps(camera))
    write_manifest(tmp_path)

    rms, share, boards = calibrate(tmp_path)

    assert rms < 1e-4
    assert abs(share) < 2e-3
    assert boards == pytest.approx(0, abs=0.01)


@pytest.mark.heavy
def test_the_lens_of_the_example_is_found_as_far_as_it_is_a_pinhole(tmp_path, monkeypatch):
    """With a quarter of its rays; doubtful corners are solved directly, so what is left is what no pinhole can be.

    The short sibling is `test_a_pinhole_camera_is_found_as_it_was`.
    """
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    stage = tmp_path / "coarse.usda"
    stage.write_text(COARSE)
    build(stage, tmp_path / "out", allow_roots=[ROOT], jobs=1)

    rms, share, boards = calibrate(tmp_path / "out")

    assert len(boards) == 6
    assert rms < 0.03
    assert abs(share) < 1.5
    assert boards[:, :2] == pytest.approx(0, abs=0.05)
    assert np.ptp(boards[:, 2]) < 0.2
    assert boards[:, 3].max() < 0.15


def test_a_folder_without_a_build_is_named(tmp_path):
    script = EXAMPLE.parent / "calibrate.py"
    run = subprocess.run([sys.executable, script, tmp_path], capture_output=True, text=True, check=False)

    assert run.returncode == 1
    assert f"{tmp_path} holds no finished build" in run.stderr
