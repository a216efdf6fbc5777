"""Rigs of several cameras, channels of their light and states of their lens in a fit, and what it takes for still."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plugins.fits.planted import fitted, narrow_stage, only, seen, wide_stage
from stage_text import edited

from pipeline.errors import UsageError
from pipeline.plugins.fits.free_numbers import FreeStage
from pipeline.scene.load import open_dataset

RIG = """prepend references = @rigs/conventional_100mm.usda@
)
{
"""
"""Where opinions of a stage on its rig begin."""
GLASSES = 'over "Lens"\n{\nuniform token plen:indexSource = "catalogue"\n}\n'
SECOND = """def "Second" (
prepend references = @rigs/conventional_100mm.usda@
)
{
over "Camera"
{
uniform token plen:camera:model = "pinhole"
}
over "Sensor"
{
uniform double plen:pixelPitch = 0.2
}
double3 xformOp:translate = (60, 0, 0)
double3 xformOp:rotateXYZ = (0, 8, 0)
uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
"""


def written(path: Path, *edits: tuple[str, str]) -> Path:
    path.write_text(edited(path.read_text(encoding="utf-8"), *edits), encoding="utf-8")
    return path


def test_two_cameras_share_boards_of_which_each_misses_one_and_tell_how_they_stand(tmp_path):
    """The pose of the second one, eight millimetres and five degrees beside its place, and a number of each. Of the
    second board it sees too little for a first pose; the last one nobody sees, and it stays where the stage has it.
    """
    path = written(
        wide_stage(tmp_path, frames=5),
        ('def "Board"', f'{SECOND}def "Board"'),
        ("rel plen:cameras = </Scene/Rig/Camera>", "rel plen:cameras = [</Scene/Rig/Camera>, </Scene/Second/Camera>]"),
    )
    free = [*(f"Second.xformOp:{op}" for op in ("translate", "rotateXYZ")), "Rig/Sensor.plen:offset"]
    stage = FreeStage(path, [*free, "Second/Camera.plen:camera:sensorDistance"])
    off = np.array([5.0, -4.0, 5.0, 3.0, -3.0, 2.5, 0.3, -0.2, 0.1])
    found = seen(stage, off, 1e-3)
    missed = (found.camera == "Rig.Camera") & (found.frame == 4) | (found.camera != "Rig.Camera") & (found.frame == 1)
    missed |= (found.camera != "Rig.Camera") & (found.frame == 2) & (found.point_id > 2) | (found.frame == 5)
    twin = fitted(stage, only(found, ~missed), tmp_path)
    assert twin.solution.converged and twin.doubts == []
    assert {group.name for group in twin.groups["camera"]} == {"Rig.Camera", "Second.Camera"}
    np.testing.assert_allclose(twin.solution.correction, off, rtol=0, atol=1e-5)
    assert "no position shows Board in frame 5: it has the pose of wide.usda there" in twin.notes
    layer, _ = twin.write(tmp_path / "fitted.usda")
    poses = [np.array(frame.world_from_target["Board"]) for frame in open_dataset(layer).frames]
    unseen = stage.nominal.frames[4].world_from_target["Board"]
    np.testing.assert_allclose(poses, [*twin.solution.poses, unseen], rtol=0, atol=1e-9)


def test_channels_of_a_camera_tell_a_number_together(tmp_path):
    bands = "".join(
        f'def PlenChannel "{name}"\n{{\nuniform double[] plen:wavelengths = [{nm - 5}, {nm}, {nm + 5}]\n'
        "uniform double[] plen:response = [0, 1, 0]\nuniform int plen:nodes = 2\n}\n"
        for name, nm in (("blue", 460), ("red", 630))
    )
    path = written(narrow_stage(tmp_path, frames=2), (RIG, f'{RIG}{GLASSES}over "Sensor"\n{{\n{bands}}}\n'))
    stage = FreeStage(path, ["Rig/Sensor.plen:offset", "Rig/Camera.plen:camera:sensorDistance"])
    off = np.array([0.02, -0.01, 0.03])
    found = seen(stage, off, 1e-5)
    assert set(found.camera.tolist()) == {"Rig.Camera@blue", "Rig.Camera@red"}
    twin = fitted(stage, found, tmp_path, known_poses=True)
    assert twin.solution.converged and twin.doubts == []
    np.testing.assert_allclose(twin.solution.correction, off, rtol=0, atol=1e-6)


def test_a_camera_whose_focus_changes_is_in_each_frame_in_its_state(tmp_path):
    pull = "double plen:camera:focusDistance.timeSamples = {1: 432, 2: 434}\ndouble plen:camera:sensorDistance = None"
    path = written(narrow_stage(tmp_path, frames=2), (RIG, f'{RIG}over "Camera"\n{{\n{pull}\n}}\n'))
    stage = FreeStage(path, ["Rig/Sensor.plen:offset", "Rig/Camera.plen:camera:focusDistance"])
    off = np.array([0.02, -0.01, 0.5])
    found = seen(stage, off, 1e-5)
    assert len(set(found.camera.tolist())) == 2
    for name in ("Rig.Camera", ""):  # the frame says the state
        twin = fitted(stage, replace(found, camera=np.full(len(found), name)), tmp_path, known_poses=True)
        assert twin.solution.converged and twin.doubts == []
        np.testing.assert_allclose(twin.solution.correction, off, rtol=0, atol=1e-5)
    with pytest.raises(UsageError, match="in another state of lens and sensor in frame"):
        fitted(stage, replace(found, camera=found.camera[::-1]), tmp_path)


def test_a_board_that_moves_while_a_shutter_is_open_is_refused(tmp_path):
    shutter = (
        "uniform double2 plen:shutter:lineOffset = (1, 24000)\nuniform double2 plen:shutter:opens = (-1, 100)\n"
        'uniform token plen:shutter:scanOrder = "topToBottom"\n'
    )
    path = written(narrow_stage(tmp_path, frames=2), (RIG, f'{RIG}over "Camera"\n{{\n{shutter}}}\n'))
    stage = FreeStage(path, ["Rig/Sensor.plen:offset"])
    with pytest.raises(UsageError, match=r"Board moves before Rig\.Camera while its shutter is open in frame \d"):
        fitted(stage, seen(stage, np.zeros(2), 0.01), tmp_path)
