"""Rays, ST maps and lookup tables through their readers: a pinhole that is known, and real lenses."""

import numpy as np
import pytest
from exports.flipping import flips, require_notice
from exports.maps import CHECKS, channels, write_small_build

import pipeline
from pipeline.exports.export import export
from pipeline.results.output import open_output


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    return open_output(write_small_build(tmp_path_factory.mktemp("pretended") / "out"))


@pytest.fixture(scope="module")
def conventional(conventional_build):
    return open_output(conventional_build)


@pytest.fixture(scope="module")
def plenoptic(plenoptic_build):
    return open_output(plenoptic_build)


@pytest.mark.parametrize("name", CHECKS)
def test_its_reader_gets_back_every_number(output, name, tmp_path):
    (folder,) = export(output, [name], tmp_path)
    CHECKS[name](folder)


UNSEEN = (("*", "microlenses"), ("*", "board"), ("*", "pose"))
"""This camera has no microlenses, and maps know no board."""


@pytest.mark.parametrize(("name", "field", "other"), list(flips(CHECKS, UNSEEN)))
def test_a_flip_of_a_convention_is_noticed(output, name, field, other, tmp_path, monkeypatch):
    require_notice(CHECKS[name], output, name, {field: other}, tmp_path, monkeypatch)


def some_pixels(output) -> np.ndarray:
    """Row and column of every seventh pixel."""
    width, height = output.camera.size_px
    return np.stack(np.divmod(np.arange(0, width * height, 7), width))


PATCHED_PX = 2e-9
"""Most that rays of pixels differ from traced ones [px]: patches may err by 1e-9 where they are judged."""


def px_apart(camera, origin_mm, direction, rays) -> float:
    """Largest distance of rays on the near and on the far plane, in pixels by those of neighbouring positions."""
    found = []
    ahead = camera.rays(rays.x_px + 0.1, rays.y_px)
    for z_mm in camera.planes_mm:
        points = origin_mm + (z_mm - origin_mm[:, 2:]) / direction[:, 2:] * direction
        px_per_mm = 0.1 / np.linalg.norm(ahead.at_distance(z_mm) - rays.at_distance(z_mm), axis=1)
        found.append(np.linalg.norm(points - rays.at_distance(z_mm), axis=1) * px_per_mm)
    return float(np.max(found))


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_rays_are_those_of_the_camera_made_ready(kind, request, tmp_path):
    output = request.getfixturevalue(kind)
    (folder,) = export(output, ["rays"], tmp_path)
    data, camera = np.load(folder / "Rig.Camera.rays.npz"), pipeline.ready(output.path)
    width, height = output.camera.size_px
    y, x = some_pixels(output)
    rays = camera.rays(x, y)
    if kind == "conventional":
        assert px_apart(camera, data["origin"][y, x], data["direction"][y, x], rays) < PATCHED_PX
    else:  # each is traced
        np.testing.assert_array_equal(data["origin"][y, x], rays.origin_mm)
        np.testing.assert_array_equal(data["direction"][y, x], rays.direction)
    assert "microlenses" not in data if kind == "conventional" else data["microlenses"].shape == (height, width, 2)
    if kind == "plenoptic":
        assert data["microlenses"][y, x].tolist() == rays.microlens.tolist()
        numbers = channels(folder / "Rig.Camera.rays.exr", "microlens.k", "microlens.l")
        assert (numbers == data["microlenses"]).all()


def test_bands_do_not_show(output, tmp_path, monkeypatch):
    from pipeline.exports import ray_patches
    from pipeline.exports.writers.maps import traced

    monkeypatch.setattr(ray_patches, "EDGE_PX", 16)
    (whole,) = export(output, ["rays"], tmp_path / "a")
    monkeypatch.setattr(traced, "AT_ONCE", 100)
    (bands,) = export(output, ["rays"], tmp_path / "b")
    for path in whole.iterdir():
        assert path.read_bytes() == (bands / path.name).read_bytes(), path.name


@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_depth_of_a_board_is_that_of_its_plane(kind, request, tmp_path):
    """By the pose of the board and the ray of each pixel; beyond its margin there is nothing."""
    output = request.getfixturevalue(kind)
    (folder,) = export(output, ["depth"], tmp_path)
    camera, (y, x) = pipeline.ready(output.path), some_pixels(output)
    rays = camera.rays(x, y)
    for view in output.camera.views:
        depth = channels(folder / f"Rig.Camera/{view.frame:04d}.depth.exr", "Z")[y, x, 0]
        pose = view.poses.camera_from_target["Board"]
        normal, place = pose[:3, 2], pose[:3, 3]
        points = (
            rays.origin_mm + ((place - rays.origin_mm) @ normal / (rays.direction @ normal))[:, None] * rays.direction
        )
        on_board = (points - place) @ pose[:3, :3]
        square = output.targets["Board"].parameters["square_mm"]
        inside = (np.abs(on_board[:, :2]) < (np.array([4, 3]) / 2 + 1) * square).all(axis=1)
        assert inside.sum() > 10
        np.testing.assert_allclose(depth[inside], points[inside, 2], rtol=0, atol=1e-4)
        assert np.isnan(depth[~inside]).all()


def test_st_maps_of_a_real_lens_undo_each_other_and_are_its_rays(conventional, tmp_path):
    """There and back is the identity; and a point of the ray of a pixel is where the map sends it."""
    (folder,) = export(conventional, ["stmap"], tmp_path)
    undistort, distort = (channels(folder / f"Rig.Camera.{name}.exr", "R", "G") for name in ("undistort", "distort"))
    (width, height), model = conventional.camera.size_px, conventional.camera.pinhole_with_distortion
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    near, far = conventional.camera.record["near_far_mm"]
    points = pipeline.ready(conventional.path).rays(x, y).at_distance(2 / (1 / near + 1 / far)) - model.centre_mm
    ideal = model.principal_distance_px * points[:, :2] / points[:, 2:] + model.principal_point_px
    shares = np.stack([(ideal[:, 0] + 0.5) / width, 1 - (ideal[:, 1] + 0.5) / height], axis=1)
    np.testing.assert_allclose(distort[y, x], shares, rtol=0, atol=1e-6)
    identity = np.stack([(x + 0.5) / width, 1 - (y + 0.5) / height], axis=1)
    np.testing.assert_allclose(undistort[y, x] + distort[y, x], 2 * identity, rtol=0, atol=1e-5)
    assert np.abs(distort[y, x] - identity).max() > 1e-6
