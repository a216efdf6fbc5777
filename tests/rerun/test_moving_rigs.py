"""A rig that moves over a standing board: moving it by T is moving the board by the inverse of T."""

import json

import numpy as np
import pytest
from builds import made
from scipy.spatial.transform import Rotation
from stage_text import tiny_text
from tolerances import SAME_GEOMETRY_PX

from pipeline.files.exr import read_exr
from pipeline.files.tables import read_table
from pipeline.frames import inverse, rigid

PLACES = {
    1: ((0.3, -0.2, -434.4), (0, 0, 5)),
    2: ((0.6, 0.4, -432.0), (3, 25, 10)),
    3: ((-1.0, 0.5, -436.0), (-20, 0, 40)),
}
"""Poses of the board before the camera in each frame [mm, deg]."""
STOOD = rigid(Rotation.from_euler("xyz", [20, 60, -35], degrees=True).as_matrix(), np.array([400.0, -30.0, 150.0]))
"""world_from_board where the rig moves."""


def moves(poses: dict[int, np.ndarray]) -> str:
    turns = {
        frame: Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True).tolist() for frame, pose in poses.items()
    }
    turn = "\n".join(f"            {frame}: {tuple(quat)}," for frame, quat in turns.items())
    shift = "\n".join(f"            {frame}: {tuple(pose[:3, 3].tolist())}," for frame, pose in poses.items())
    return (
        f"        quatd xformOp:orient.timeSamples = {{\n{turn}\n        }}\n"
        f"        double3 xformOp:translate.timeSamples = {{\n{shift}\n        }}\n"
        '        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]\n'
    )


def stage_of(rig: dict[int, np.ndarray], board: dict[int, np.ndarray]) -> str:
    """The tiny dataset with three frames and poses in the world of the rig and of the board."""
    samples = ("plen:image:samples = 64", "plen:image:samples = 16")
    text = tiny_text("conventional", ("endTimeCode = 2", "endTimeCode = 3"), ("rays = 1", "rays = false"), samples)
    before, _, rest = text.partition("        quatd xformOp:orient.timeSamples")
    end = rest.partition('["xformOp:translate", "xformOp:orient"]\n')[2]
    text = before + moves(board) + end
    return text.replace('    {\n        over "Camera"', "    {\n" + moves(rig) + '\n        over "Camera"', 1)


@pytest.fixture(scope="module")
def builds(tmp_path_factory, common_store):
    """Output folders, and what ran: of a rig that stands, and then of a rig that moves."""
    camera_from_board = {
        frame: rigid(Rotation.from_euler("xyz", turn, degrees=True).as_matrix(), np.array(place))
        for frame, (place, turn) in PLACES.items()
    }
    still = dict.fromkeys(PLACES, np.eye(4)), camera_from_board
    # camera_from_board = camera_from_world world_from_board
    moved = {frame: STOOD @ inverse(pose) for frame, pose in camera_from_board.items()}, dict.fromkeys(PLACES, STOOD)
    folder, found = tmp_path_factory.mktemp("moving"), []
    for name, poses in (("still", still), ("moved", moved)):
        stage = folder / f"{name}.usda"
        stage.write_text(stage_of(*poses), encoding="utf-8")
        tasks = made(stage, folder / name, common_store).tasks
        found.append((folder / name, {task.key for task in tasks if task.kind in ("camera", "white")}))
    return found


def test_rows_and_images_are_those_of_a_board_that_moves_the_other_way(builds):
    (still, _), (moved, _) = builds
    for frame in PLACES:
        one, other = (folder / f"frames/{frame:04d}/Rig.Camera" for folder in (still, moved))
        tables = [read_table(place / "correspondences.csv") for place in (one, other)]
        for column in ("x_px", "y_px"):
            rows = [table.numbers(column) for table in tables]
            assert len(rows[0]) == 6
            np.testing.assert_allclose(rows[1], rows[0], rtol=0, atol=SAME_GEOMETRY_PX)
        pixels = [read_exr(place / "image.exr")["image"].channels["Y"] for place in (one, other)]
        # A ray in sixteen that meets an edge may fall to its other side by rounding.
        assert np.mean(pixels[0] != pixels[1]) < 0.01


def test_nothing_that_belongs_to_the_rig_alone_runs_again(builds):
    (_, still), (_, moved) = builds
    assert still == moved


def test_every_frame_says_where_the_camera_was(builds):
    _, (folder, _) = builds
    for frame, (place, turn) in PLACES.items():
        plain = json.loads((folder / f"frames/{frame:04d}/Rig.Camera/poses.json").read_text())
        pose = np.array(plain["camera_from_world"]) @ STOOD
        expected = np.diag([1.0, -1.0, -1.0, 1.0]) @ rigid(
            Rotation.from_euler("xyz", turn, degrees=True).as_matrix(), np.array(place)
        )
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-9)
        np.testing.assert_allclose(plain["targets"]["Board"]["camera_from_target"], expected, rtol=0, atol=1e-9)
        through = np.array(plain["pinhole"]["pinhole_from_world"])
        assert np.abs(inverse(through) - np.array(plain["pinhole"]["world_from_pinhole"])).max() < 1e-9
