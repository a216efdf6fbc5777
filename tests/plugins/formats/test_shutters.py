"""Before a rolling shutter a board flies past: exports say where it was when the line of each corner was exposed."""

import json
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
import yaml
from plugins.formats.pretended import (
    F_PX,
    SIZE_PX,
    STOP_MM,
    Scene,
    board_mm,
    projected,
    same,
    turned,
    write_build,
    write_manifest,
)
from scipy.spatial.transform import Rotation, Slerp

from pipeline.exports.export import export
from pipeline.files.tables import read_table, write_table
from pipeline.formats import ExportError
from pipeline.frames import apply, rigid
from pipeline.results.output import Output, open_output

LINE_S, OPENS_S, EXPOSURE_S = 1e-4, 0.01, 2e-3
ORDERS = {"topToBottom": (1, 1), "bottomToTop": (1, -1), "leftToRight": (0, 1), "rightToLeft": (0, -1)}
"""Axis of the image along which lines follow each other, and whether their time grows with it."""
SOLVED_PX = 1e-7


@dataclass(frozen=True)
class FlyingScene(Scene):
    """The scene before cameras that scan; the board moves evenly before each, by tens of pixels."""

    order: str = "topToBottom"

    def motion(self, camera: str, frame: int, time_s: float) -> np.ndarray:
        """The pose of the board [s after the time code]."""
        turn, shift = turned(0, 0, 0.2 * time_s), np.array([300.0, 200.0, 100.0]) * time_s
        pose = self.camera_from_target(camera, frame)
        return rigid(turn @ pose[:3, :3], pose[:3, 3] + shift)

    def time_s(self, pixel: np.ndarray) -> float:
        """Middle of the exposure at a position."""
        axis, sign = ORDERS[self.order]
        line = pixel[axis] if sign > 0 else SIZE_PX[axis] - 1 - pixel[axis]
        return OPENS_S + LINE_S * float(line) + EXPOSURE_S / 2

    @cached_property
    def _seen(self) -> dict:
        return {}

    def pixels(self, camera: str, frame: int) -> np.ndarray:
        """Positions at which the line of the position itself sees the point."""
        if (camera, frame) not in self._seen:
            pixels = np.full((len(board_mm()), 2), 200.0)
            for _ in range(30):
                pixels = np.array(
                    [
                        seen_at(self.motion(camera, frame, self.time_s(pixel)), point)
                        for pixel, point in zip(pixels, board_mm(), strict=True)
                    ]
                )
            self._seen[camera, frame] = pixels
        return self._seen[camera, frame]


def seen_at(pose: np.ndarray, point_mm: np.ndarray) -> np.ndarray:
    return projected(pose, point_mm[None])[0]


def write_flying_build(folder: Path, scene: FlyingScene) -> Path:
    """What a build would write of it; the stop stands 6 mm behind the centre of projection."""
    write_build(folder, scene)
    to_stop = rigid(np.eye(3), STOP_MM)
    shutter = {"scan_order": scene.order, "opens_s": OPENS_S, "line_offset_s": LINE_S, "exposure_s": EXPOSURE_S}
    for name in scene.rig:
        file = folder / f"cameras/{name}/camera.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), "shutter": shutter}))
        for frame in scene.poses:
            view, pixels = folder / f"frames/{frame:04d}/{name}", scene.pixels(name, frame)
            poses, file = json.loads((view / "poses.json").read_text()), view / "correspondences.csv"
            axis, sign = ORDERS[scene.order]
            ends = [np.full(2, line) for line in (0, SIZE_PX[axis] - 1)[::sign]]
            lines = [to_stop @ scene.motion(name, frame, scene.time_s(pixel)) for pixel in ends]
            at_lines = dict(zip(("first", "last"), np.array(lines).tolist(), strict=True))
            poses["targets"]["Board"]["camera_from_target_at_lines"] = at_lines
            (view / "poses.json").write_text(json.dumps(poses))
            table = read_table(file)
            places = [
                apply(to_stop @ scene.motion(name, frame, scene.time_s(pixels[point])), board_mm()[point])
                for point in map(int, table.columns["point_id"])
            ]
            columns = dict(zip(("camera_x_mm", "camera_y_mm", "camera_z_mm"), np.transpose(places), strict=True))
            write_table(file, ["by a pinhole"], {**table.columns, **columns})
    write_manifest(folder)
    return folder


def flown(folder: Path, order: str) -> tuple[FlyingScene, Output]:
    scene = FlyingScene(order=order)
    return scene, open_output(write_flying_build(folder / "out", scene))


@pytest.fixture(scope="module")
def flying(tmp_path_factory):
    return flown(tmp_path_factory.mktemp("flying"), "topToBottom")


def test_the_pinhole_of_rows_before_a_shutter_is_that_of_a_still_scene(flying, tmp_path):
    scene, output = flying
    still = Scene().pixels("Left", 2)
    assert np.abs(scene.pixels("Left", 2) - still).max() > 10
    (folder,) = export(output, ["opencv"], tmp_path)
    for name, pinhole in json.loads((folder / "export.json").read_text())["pinholes_of_rows"].items():
        assert pinhole["residual_px"]["max"] < SOLVED_PX, name
        same(pinhole["principal_distance_px"], F_PX, 1e-5)
        same(pinhole["centre_mm"], [0, 0, -6], 1e-5)


@pytest.mark.parametrize("order", ["topToBottom", "bottomToTop"])
def test_kalibr_sees_each_corner_at_the_stamp_and_the_delay_of_its_row(order, tmp_path):
    """RollingShutter.hpp: the time of a keypoint is the stamp of its image and y times the delay."""
    scene, output = flown(tmp_path, order)
    (folder,) = export(output, ["kalibr"], tmp_path)
    text = (folder / "camchain.yaml").read_text()
    assert "positions are those at the times of their lines" in text
    chain = yaml.safe_load(text)
    stamps_s = [float(stamp) for stamp in re.findall(r"time code of its frame: (\S+) s", text)]
    corners = read_table(folder / "corners.csv")
    frame, camera, point = (corners.numbers(name).astype(int) for name in ("frame", "camera", "point"))
    pixels = np.stack([corners.numbers("x_px"), corners.numbers("y_px")], axis=1)
    assert len(stamps_s) == 3 and len(pixels) == 105
    for row, pixel in enumerate(pixels):
        number, name = camera[row], list(scene.rig)[camera[row]]
        time_s = stamps_s[number] + chain[f"cam{number}"]["line_delay"] * pixel[1]
        same(seen_at(scene.motion(name, frame[row], time_s), board_mm()[point[row]]), pixel, SOLVED_PX)


def test_kalibr_knows_no_scan_by_columns(tmp_path):
    with pytest.raises(ExportError, match="Left scans leftToRight"):
        export(flown(tmp_path, "leftToRight")[1], ["kalibr"], tmp_path)


@pytest.mark.parametrize("order", ORDERS)
def test_gsplat_goes_from_the_pose_of_the_first_line_to_that_of_the_last(order, tmp_path):
    """Cameras.cuh of gsplat: by slerp, with the share of the scan; in it the centre of the first line is 0."""
    scene, output = flown(tmp_path, order)
    (folder,) = export(output, ["nerfstudio"], tmp_path)
    for frame in json.loads((folder / "transforms.json").read_text())["frames"]:
        _, number, name, _ = frame["file_path"].split("/")
        axis, sign = ORDERS[order]
        along = ("LEFT", "TOP")[axis], ("RIGHT", "BOTTOM")[axis]
        assert frame["shutter_type"] == f"ROLLING_{'_TO_'.join(along[::sign])}"
        assert np.linalg.norm(np.array(frame["transform_matrix_start"]) - frame["transform_matrix_end"]) > 0.01
        ends = [opencv_pose(frame[f"transform_matrix_{end}"]) for end in ("start", "end")]
        turns = Slerp([0, 1], Rotation.from_matrix([pose[:3, :3] for pose in ends]))
        for point, pixel in enumerate(scene.pixels(name, int(number))):
            share = (pixel[axis] if sign > 0 else SIZE_PX[axis] - 1 - pixel[axis]) / (SIZE_PX[axis] - 1)
            shift = (1 - share) * ends[0][:3, 3] + share * ends[1][:3, 3]
            pose = rigid(turns(share).as_matrix(), shift * 1000)
            same(seen_at(pose, board_mm()[point]), pixel, SOLVED_PX)
        same(opencv_pose(frame["transform_matrix"])[:3, 3] * 1000, scene.motion(name, int(number), 0.0)[:3, 3], 1e-9)


def opencv_pose(transform_matrix: list) -> np.ndarray:
    """What gsplat calls a viewmat, from the world, in metres: x right, y down, z ahead."""
    return np.linalg.inv(np.array(transform_matrix) @ np.diag([1, -1, -1, 1]))
