"""BOP: two boards and something before them, by the formulas of bop_toolkit."""

import importlib
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from fits.pixel_rays import lit_rays
from plugins.formats.flipping import flips, require_notice
from plugins.formats.pretended import (
    FACING,
    STOP_MM,
    board_mm,
    same,
    turned,
    write_camera,
    write_manifest,
    write_poses,
    write_rows,
    write_target,
)
from plugins.formats.test_programs import clone

from pipeline.exports import export
from pipeline.files.png import read_png
from pipeline.frames import rigid
from pipeline.results.output import open_output

SIZE_PX, F_PX, CENTRE_PX = (64, 48), 100.0, np.array([30.25, 20.75])
K = np.array([[F_PX, 0, CENTRE_PX[0]], [0, F_PX, CENTRE_PX[1]], [0, 0, 1]])
POSES = {
    "Board": rigid(turned(0.2, -0.35, 0.1) @ FACING, np.array([5.0, 8.0, 400.0])),
    "Alpha": rigid(turned(0.0, 0.2, 0.0) @ FACING, np.array([-60.0, -20.0, 380.0])),
}
"""Targets before the centre of projection; their folder lists Alpha first."""
HALF_MM = np.array([40.0, 30.0])
"""Half of the width and of the height of a sheet."""
BAR_MM = (350.0, -40.0, 0.0)
"""A dark bar from top to bottom: its z before the centre of projection, and where it begins and ends along x."""


def through(slopes: np.ndarray, name: str | None) -> np.ndarray:
    """z where rays (n, 2) from the centre of projection meet a target, or the bar; NaN: nowhere."""
    if name is None:
        z, left, right = BAR_MM
        return np.where((slopes[:, 0] * z > left) & (slopes[:, 0] * z < right), z, np.nan)
    pose, ahead = POSES[name], np.column_stack([slopes, np.ones(len(slopes))])
    z = (pose[:3, 3] @ pose[:3, 2]) / (ahead @ pose[:3, 2])
    place = (ahead * z[:, None] - pose[:3, 3]) @ pose[:3, :2]
    return np.where((np.abs(place) < HALF_MM).all(axis=1), z, np.nan)


def met(slopes: np.ndarray, only: str | None = None) -> np.ndarray:
    """The same, of the first of all things, or of one target."""
    return through(slopes, only) if only else np.fmin.reduce([through(slopes, name) for name in (*POSES, None)])


class Sight:
    def rays(self, x_px, y_px):
        ahead = np.column_stack([(np.column_stack([x_px, y_px]) - CENTRE_PX) / F_PX, np.ones(len(x_px))])
        return lit_rays(np.asarray(x_px), np.asarray(y_px), STOP_MM - STOP_MM[2] * ahead, ahead)


class Things:
    def distance_mm(self, frame, camera, origin_mm, direction, only=None):
        assert (frame, camera) == (7, "Left")
        z = met(direction[:, :2] / direction[:, 2:], only)
        return (z + STOP_MM[2] - origin_mm[:, 2]) / direction[:, 2]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bop") / "out"
    write_camera(folder / "cameras/Left", SIZE_PX, F_PX, CENTRE_PX, np.zeros(5))
    view = folder / "frames/0007/Left"
    write_poses(view, np.eye(4), POSES)
    write_rows(view, [], np.zeros((0, 2)))
    write_target(folder, 10.0)
    shutil.copy(folder / "targets/Board.json", folder / "targets/Alpha.json")
    write_manifest(folder)
    return open_output(folder)


@pytest.fixture(autouse=True)
def seen(monkeypatch):
    monkeypatch.setattr(export, "sight_of", lambda out, name: Sight())
    monkeypatch.setattr(export, "scene_of", lambda out: Things())


def check(folder: Path) -> None:
    """P_m2i = K [R t] in mm, pixels with their centres at whole numbers, boxes as `calc_2d_bbox` has them."""
    place = folder / "000000"
    camera, poses, info = (
        json.loads((place / f"{name}.json").read_text())["7"] for name in ("scene_camera", "scene_gt", "scene_gt_info")
    )
    matrix = np.reshape(camera["cam_K"], (3, 3))
    y, x = np.mgrid[0 : SIZE_PX[1], 0 : SIZE_PX[0]].reshape(2, -1)
    slopes = np.column_stack([x, y, np.ones(len(x))]) @ np.linalg.inv(matrix).T
    depth_mm = read_png(place / "depth/000007.png") * camera["depth_scale"]
    first = met(slopes[:, :2])
    same(depth_mm.ravel(), np.nan_to_num(first), camera["depth_scale"])
    assert camera["depth_scale"] < 0.01
    for number, (name, pose) in enumerate(sorted(POSES.items())):
        assert poses[number]["obj_id"] == number + 1
        turn, shift = np.reshape(poses[number]["cam_R_m2c"], (3, 3)), np.array(poses[number]["cam_t_m2c"])
        ahead = (board_mm() @ turn.T + shift) @ matrix.T
        truth = (board_mm() @ pose[:3, :3].T + pose[:3, 3]) @ K.T
        same(ahead[:, :2] / ahead[:, 2:], truth[:, :2] / truth[:, 2:], 1e-9)
        alone = met(slopes[:, :2], name)
        whole, visible = np.isfinite(alone), alone == first
        assert 0 < visible.sum() < whole.sum(), "something stands before it"
        for kind, expected in (("mask", whole), ("mask_visib", visible)):
            mask = read_png(place / f"{kind}/000007_{number:06d}.png")
            assert (mask.ravel() == np.where(expected, 255, 0)).all()
        facts = info[number]
        assert (facts["px_count_all"], facts["px_count_visib"]) == (whole.sum(), visible.sum())
        assert facts["visib_fract"] == visible.sum() / whole.sum() and facts["px_count_valid"] == whole.sum()
        for key, mask in (("bbox_obj", whole), ("bbox_visib", visible)):
            left, top = x[mask].min(), y[mask].min()
            assert facts[key] == [left, top, x[mask].max() - left, y[mask].max() - top]


def test_its_reader_gets_back_every_number(built, tmp_path):
    (folder,) = export.export(built, ["bop"], tmp_path)
    check(folder)
    said = (folder / "dataset_info.md").read_text()
    assert "object 1: Alpha" in said and "object 2: Board" in said and "scene 000000: Left" in said


@pytest.mark.heavy
def test_bop_toolkit_loads_it_and_projects_points_and_distances(built, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(clone("bop_toolkit"))
    for name in ("png", "imageio"):
        pytest.importorskip(name, reason=f"bop_toolkit needs {name}")
    inout, misc = (importlib.import_module(f"bop_toolkit_lib.{name}") for name in ("inout", "misc"))
    (folder,) = export.export(built, ["bop"], tmp_path)
    place = folder / "000000"
    camera = inout.load_scene_camera(place / "scene_camera.json")[7]
    poses = inout.load_scene_gt(place / "scene_gt.json")[7]
    for entry, (_, pose) in zip(poses, sorted(POSES.items()), strict=True):
        seen = misc.project_pts(board_mm(), camera["cam_K"], entry["cam_R_m2c"], entry["cam_t_m2c"])
        truth = (board_mm() @ pose[:3, :3].T + pose[:3, 3]) @ K.T
        same(seen, truth[:, :2] / truth[:, 2:], 1e-9)
    depth = inout.load_depth(place / "depth/000007.png") * camera["depth_scale"]
    distance = misc.depth_im_to_dist_im_fast(depth, camera["cam_K"])
    y, x = np.mgrid[0 : SIZE_PX[1], 0 : SIZE_PX[0]]
    ahead = np.stack([(x - CENTRE_PX[0]) / F_PX, (y - CENTRE_PX[1]) / F_PX, np.ones(x.shape)], axis=-1)
    z = np.nan_to_num(met(ahead[..., :2].reshape(-1, 2))).reshape(x.shape)
    same(distance, z * np.linalg.norm(ahead, axis=2), 1.5 * camera["depth_scale"])
    for number, facts in enumerate(inout.load_json(place / "scene_gt_info.json", keys_to_int=True)[7]):
        rows, columns = inout.load_im(place / f"mask_visib/000007_{number:06d}.png").nonzero()
        assert facts["bbox_visib"] == misc.calc_2d_bbox(columns, rows) and facts["px_count_visib"] == len(rows)


@pytest.mark.parametrize(("name", "field", "other"), list(flips(["bop"], [("bop", "centre")])))
def test_a_flip_of_a_convention_is_noticed(built, name, field, other, tmp_path, monkeypatch):
    require_notice(check, built, name, {field: other}, tmp_path, monkeypatch)
