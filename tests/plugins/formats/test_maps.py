"""Pinholes before a board, rays and ST maps through programs that read them: the half-pixel law. Maps of real lenses.
`test_programs` and `test_mrcal` have formats whose programs not everybody has.
"""

import numpy as np
import pytest
from fits.pixel_rays import lit_rays
from plugins.formats.flipping import flips, require_notice
from plugins.formats.maps import CHECKS, PinholeSight, channels, write_small_build
from plugins.formats.pretended import CORNER_PX, Scene, write_build
from plugins.formats.readers import CHECKS as BOARD_CHECKS

import pipeline
from pipeline.exports.export import export
from pipeline.exports.ray_patches import rows_of_rays
from pipeline.results import opening
from pipeline.results.output import open_output


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return open_output(write_small_build(tmp_path_factory.mktemp("pretended") / "out"))


@pytest.fixture(scope="module")
def conventional(conventional_build):
    return open_output(conventional_build)


@pytest.fixture(scope="module")
def plenoptic(plenoptic_build):
    return open_output(plenoptic_build)


def test_point_0_is_seen_in_the_middle_of_a_pixel():
    np.testing.assert_allclose(Scene().pixels("Left", 1)[0], CORNER_PX, rtol=0, atol=1e-9)


@pytest.fixture
def judged(name, request):
    """A build that a format knows, and the check of its export."""
    if name in CHECKS:
        return request.getfixturevalue("small"), CHECKS[name]
    return request.getfixturevalue("output"), lambda folder: BOARD_CHECKS[name](folder, Scene())


@pytest.mark.parametrize("name", [*BOARD_CHECKS, *CHECKS])
def test_its_reader_gets_back_every_number(judged, name, tmp_path):
    built, check = judged
    (folder,) = export(built, [name], tmp_path)
    check(folder)


@pytest.fixture(scope="module")
def one_view(tmp_path_factory):
    """What the left camera sees in the first frame, and its check: coco asks the rays of all pixels of each view."""
    scene = Scene()
    alone = Scene(rig={"Left": scene.rig["Left"]}, poses={1: scene.poses[1]})
    built = open_output(write_build(tmp_path_factory.mktemp("pretended") / "out", alone))
    return built, lambda folder: BOARD_CHECKS["coco"](folder, alone)


UNSEEN = (("*", "centre"), ("*", "microlenses"))
"""All centres of cameras before a board are one, and no camera here has microlenses."""
UNSEEN_BY_MAPS = (("*", "microlenses"), ("*", "board"), ("*", "pose"))
"""Maps know no board."""


@pytest.mark.parametrize(("name", "field", "other"), [*flips(BOARD_CHECKS, UNSEEN), *flips(CHECKS, UNSEEN_BY_MAPS)])
def test_a_flip_of_a_convention_is_noticed(judged, one_view, name, field, other, tmp_path, monkeypatch):
    built, check = one_view if name == "coco" else judged
    require_notice(check, built, name, {field: other}, tmp_path, monkeypatch)


def some_pixels(output) -> np.ndarray:
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


def test_bands_do_not_show(small, tmp_path, monkeypatch):
    from pipeline.exports import ray_patches
    from pipeline.plugins.formats.maps import traced

    monkeypatch.setattr(ray_patches, "EDGE_PX", 16)
    (whole,) = export(small, ["rays"], tmp_path / "a")
    monkeypatch.setattr(traced, "AT_ONCE", 100)
    (bands,) = export(small, ["rays"], tmp_path / "b")
    for path in whole.iterdir():
        assert path.read_bytes() == (bands / path.name).read_bytes(), path.name


def test_each_export_makes_its_camera_ready_anew(small, tmp_path, monkeypatch):
    """In a notebook, the folder may have been built again in between; formats of one call share a camera."""
    monkeypatch.undo()  # what stands for cameras of pretended builds
    made = []
    monkeypatch.setattr(opening, "ready", lambda out, name: made.append(name) or PinholeSight())
    for number in range(2):
        export(small, ["rays", "stmap"], tmp_path / str(number))
    assert made == ["Left"] * 2


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


PLANES_MM = (400.0, 500.0)


class Counting:
    def __init__(self, rays):
        self.traced, self._rays = 0, rays

    def rays(self, x_px, y_px):
        self.traced += len(x_px)
        return self._rays(np.asarray(x_px, float), np.asarray(y_px, float))


def made_up(bend):
    """Rays through the centre of the stop whose slopes are those of a pinhole of 200 px, and a bend (n, 2)."""

    def rays(x, y):
        slope = np.stack([x - 60, y - 50], axis=1) / 200 + bend(x, y)
        ahead = np.column_stack([slope, np.ones(len(x))])
        return lit_rays(x, y, np.where(np.isnan(ahead[:, :1]), np.nan, np.zeros((len(x), 3))), ahead)

    return rays


def crossings(origin, direction, z_mm):
    return origin + (z_mm - origin[..., 2:]) / direction[..., 2:] * direction


def largest_px(rays, size, traced):
    """Largest difference of all pixels on both planes, in pixels of the pinhole of 200 px; NaN must be where NaN is."""
    width, height = size
    origin, direction = rows_of_rays(traced, width, (0, height), PLANES_MM)
    y, x = np.mgrid[0:height, 0:width].reshape(2, -1)
    exact, worst = rays(x.astype(float), y.astype(float)), 0.0
    for z_mm in PLANES_MM:
        off = crossings(origin, direction, z_mm).reshape(-1, 3) - exact.at_distance(z_mm)
        assert (np.isnan(off[:, 0]) == np.isnan(exact.direction[:, 0])).all()
        worst = max(worst, float(np.nanmax(np.linalg.norm(off, axis=1))) * 200 / z_mm)
    return worst


BENDS = {
    "smooth": lambda x, y: 0.02 * np.stack([np.sin(x / 80) * np.cos(y / 90), np.exp(-(x + y) / 300)], axis=1),
    # The mean ray has a kink where an edge begins to vignette: here the circle of radius 55 px about (60, 50).
    "kink": lambda x, y: 1e-5 * np.maximum(np.hypot(x - 60, y - 50) - 55, 0)[:, None] * np.ones(2),
    "dark": lambda x, y: np.where(np.hypot(x - 60, y - 50) < 70, 0.0, np.nan)[:, None] * np.ones(2),
}


@pytest.mark.parametrize(("bend", "most_traced"), [("smooth", 0.07), ("kink", 1.0), ("dark", 1.0)])
def test_patches_agree_with_rays_traced_one_by_one(bend, most_traced):
    """Smooth rays by one traced in fourteen at most; a kink and an end of the light by as many as it takes."""
    rays, size = made_up(BENDS[bend]), (131, 100)
    traced = Counting(rays)
    assert largest_px(rays, size, traced) < 2e-9
    assert traced.traced < most_traced * size[0] * size[1]


def test_a_real_lens_that_vignettes():
    """A singlet with a far stop: corners of its image lose light by the rim of the lens."""
    singlet = pipeline.Prescription(
        surfaces=(
            pipeline.Surface(radius_mm=50.0, thickness_mm=6.0, semi_diameter_mm=9.0, index=1.5168),
            pipeline.Surface(radius_mm=-50.0, thickness_mm=14.0, semi_diameter_mm=9.0),
            pipeline.Surface(semi_diameter_mm=4.0, is_stop=True),
        )
    )
    sensor = pipeline.Sensor(width_px=160, height_px=64, pitch_mm=0.1)
    camera = pipeline.ready(pipeline.Camera(prescription=singlet, sensor=sensor, sensor_distance_mm=38.0))
    light = camera.rays([80.0, 1.0], [32.0, 1.0]).hit_fraction
    assert light[1] < 0.95 * light[0]
    traced = Counting(camera.rays)
    origin, direction = rows_of_rays(traced, 160, (0, 64), camera.planes_mm)
    y, x = np.divmod(np.arange(0, 160 * 64, 11), 160)
    exact = camera.rays(x.astype(float), y.astype(float))
    ahead = camera.rays(x + 0.1, y.astype(float))
    for z_mm in camera.planes_mm:
        off = crossings(origin[y, x], direction[y, x], z_mm) - exact.at_distance(z_mm)
        px_per_mm = 0.1 / np.linalg.norm(ahead.at_distance(z_mm) - exact.at_distance(z_mm), axis=1)
        allowed_px = 1e-8 + 2 * np.hypot(*exact.error_px.T).max()
        assert (np.linalg.norm(off, axis=1) * px_per_mm).max() < allowed_px
    assert traced.traced < 160 * 64
