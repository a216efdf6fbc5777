"""`camera.project` and `camera.rays` answer as the ground truth does, and each is the other's inverse."""

import dataclasses
import inspect

import numpy as np
import pytest
from laws import test_shutter
from places import DATA

import pipeline
from pipeline.camera.parts.errors import CameraError
from pipeline.errors import UsageError
from pipeline.frames import apply, rigid
from pipeline.results.answers import Fate

SAME_PX = 1e-9
"""Two runs of one solver from the same points [px]: planes have other axes, so last digits may differ."""
ROUNDING_PX = 1e-8
"""Roundings of traces and poses as image positions [px], added to errors that are stated smaller than these."""
DISTANCES_MM = (390.0, 434.4, 700.0)
"""Before, in and behind the focus of the rigs."""


@pytest.fixture(scope="module")
def ready_plenoptic(plenoptic_build):
    return pipeline.ready(plenoptic_build)


def positions(camera, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions anywhere in the image, on no pixel's centre."""
    sensor, random = camera.camera.sensor, np.random.default_rng(5)
    return random.uniform(0, sensor.width_px - 1, count), random.uniform(0, sensor.height_px - 1, count)


def test_what_moves_before_a_shutter_is_imaged_as_the_table_says(tmp_path, common_store):
    ends = "(-0.4, 1.2, -434.4)", "(-0.4, -6.8, -434.4)"  # a stage of test_shutter, which is built once
    exposed = "double2 exposure = (1, 240)\nint instants = 2"
    path = test_shutter.stage(tmp_path / "moving", f"{test_shutter.SCAN}{exposed}", ends)
    rows, _ = test_shutter.built(path, common_store)
    camera, board = pipeline.ready(path.parent / "out"), pipeline.open_dataset(path).targets[0].target.points()
    motion = pipeline.open_dataset(path).frames[0].motions["Rig.Camera"].targets["Board"]
    found = camera.project(board.position_mm, moving=motion)
    assert found.point.tolist() == [int(point) for point in rows.columns["point_id"]] and set(found.fates) == {
        Fate.SEEN,
        Fate.OUTSIDE,
    }
    for name, values in {"x_px": found.x_px, "y_px": found.y_px, "t_s": found.t_s}.items():
        np.testing.assert_allclose(values, rows.numbers(name), rtol=0, atol=SAME_PX)
    at_code = pipeline.open_dataset(path).frames[0].vision_from_target("Rig.Camera", "Board")

    def flight(time_s: float) -> np.ndarray:
        return rigid(at_code[:3, :3], at_code[:3, 3] + [0.0, 8.0 * 24 * time_s, 0.0])

    poses = pipeline.open_output(path.parent / "out").cameras["Rig.Camera"].views[0].poses
    ends = [flight(1 / 500 + line / 1000 + 1 / 480) for line in (0, 23)]
    np.testing.assert_allclose(poses.camera_from_target_at_lines["Board"], ends, rtol=0, atol=1e-9)
    by_function = camera.project(board.position_mm, moving=flight)
    assert (np.abs(by_function.x_px - found.x_px) <= found.error_px[:, 0] + ROUNDING_PX).all()
    still = camera.project(apply(at_code, board.position_mm))
    assert np.abs(still.y_px[found.point] - found.y_px).min() > 0.1
    np.testing.assert_allclose(still.t_s, 1 / 500 + still.y_px / 1000 + 1 / 480, rtol=0, atol=1e-15)


def test_nothing_moves_before_a_camera_without_a_shutter(conventional):
    with pytest.raises(CameraError, match="no shutter"):
        pipeline.ready(conventional).project([[0.0, 0.0, 0.0]], moving=lambda _: np.eye(4))


def test_a_point_on_the_ray_of_a_position_is_imaged_there(conventional):
    camera = pipeline.ready(conventional)
    x, y = positions(camera, 20)
    rays = camera.rays(x, y)
    assert np.isfinite(rays.direction).all() and (np.hypot(*rays.error_px.T) < 1e-3).all()
    for z_mm in DISTANCES_MM:
        found = camera.project(rays.at_distance(z_mm))
        off = np.abs(np.stack([found.x_px - x, found.y_px - y], axis=1))
        assert found.point.tolist() == list(range(20)) and found.is_seen.all()
        assert (off <= found.error_px + rays.error_px + ROUNDING_PX).all()


def test_behind_microlenses_the_own_one_of_several_images_is_there(ready_plenoptic):
    camera = ready_plenoptic
    x, y = positions(camera, 24)
    rays = camera.rays(x, y)
    lit = np.flatnonzero(rays.hit_fraction > 0.5)
    found = camera.project(rays.at_distance(410.0)[lit])
    assert len(lit) > 8 and len(found.point) > 2 * len(lit)
    for number, row in enumerate(lit):
        (own,) = np.flatnonzero((found.point == number) & (found.microlens == rays.microlens[row]).all(axis=1))
        error = found.error_px[own] + rays.error_px[row] + ROUNDING_PX
        assert abs(found.x_px[own] - x[row]) <= error[0] and abs(found.y_px[own] - y[row]) <= error[1]


def test_it_equals_the_rows_of_the_table(plenoptic_build, ready_plenoptic):
    """All rows of all frames, and no others: points, microlenses and types, positions, errors and light."""
    out = pipeline.open_output(plenoptic_build)
    for view in out.camera.views:
        rows, pose = view.correspondences, view.poses.camera_from_target["Board"]
        points = apply(pose, out.targets["Board"].points_mm)
        found = ready_plenoptic.project(points, pose[:3, 2])
        assert found.point.tolist() == rows.point_id.tolist()
        assert found.microlens.tolist() == np.stack([rows.microlens_k, rows.microlens_l], 1).tolist()
        assert found.microlens_type.tolist() == rows.microlens_type.tolist()
        np.testing.assert_allclose(found.x_px, rows.x_px, rtol=0, atol=SAME_PX)
        np.testing.assert_allclose(found.y_px, rows.y_px, rtol=0, atol=SAME_PX)
        np.testing.assert_allclose(found.hit_fraction, rows.hit_fraction, rtol=1e-9)
        np.testing.assert_allclose(found.rho_px, rows.rho_px, rtol=0, atol=SAME_PX)
    upright = ready_plenoptic.project(points[:1])  # tilted by 20 degrees in the last frame: the surface matters
    same = upright.x_px[:, None] - rows.x_px[rows.point_id == 0]
    assert np.abs(same).min(axis=1).max() > 100 * SAME_PX


def test_the_ray_is_the_mean_of_single_rays(conventional):
    """By random rays, which share the trace and nothing else."""
    camera = pipeline.ready(conventional)
    x, y = 85.3, 60.2
    rays = camera.rays(x, y)
    for z_mm in DISTANCES_MM:
        single = pipeline.bundle(conventional, x, y, samples=1 << 14)
        spread = np.sqrt(np.cov(single.at_distance(z_mm).T, aweights=single.weight_sr).trace() / len(single.weight_sr))
        assert np.hypot(*(single.mean_at(z_mm) - rays.at_distance(z_mm)[0, :2])) < 3 * spread


def test_a_finer_answer_states_a_smaller_error(conventional):
    near = pipeline.ready(conventional).project([[3.0, 2.0, 500.0]], accuracy_px=1e-1)
    fine = pipeline.ready(conventional).project([[3.0, 2.0, 500.0]], accuracy_px=1e-7)
    assert np.hypot(*fine.error_px[0]) < 1e-7
    assert np.hypot(fine.x_px - near.x_px, fine.y_px - near.y_px) <= np.hypot(*(near.error_px + fine.error_px)[0])


def test_points_without_a_position_say_why(conventional):
    camera = pipeline.ready(conventional)
    points = [[0, 0, 434.0], [0, 0, -50.0], [0, 0, 5.0], [2000.0, 0, 434.0], [40.0, 0, 434.0]]
    found = camera.project(points)
    assert found.fates == (Fate.SEEN, Fate.BEHIND, Fate.BEHIND, Fate.NO_LIGHT, Fate.OUTSIDE)
    assert found.point.tolist() == [0] and found.is_seen.tolist() == [True, False, False, False, False]
    assert camera.project(points[:1], [0, 0, 1.0]).fates == (Fate.AWAY,)
    dark = dataclasses.replace(camera, min_hit_fraction=1.5)
    assert dark.project(points[:1]).fates == (Fate.DARK,) and not len(dark.project(points[:1]).x_px)
    assert not len(camera.project(np.zeros((0, 3))).point)


def test_a_position_without_light_has_no_ray(ready_plenoptic):
    rays = ready_plenoptic.rays([24.0, 5000.0], [20.0, 5000.0])
    assert np.isfinite(rays.direction[0]).all()
    assert np.isnan(rays.direction[1]).all() and np.isnan(rays.origin_mm[1]).all()


def test_stage_and_output_give_the_same_camera(plenoptic_build, ready_plenoptic):
    from_stage = pipeline.ready(DATA / "tiny_plenoptic/dataset.usda", "Rig.Camera")
    assert from_stage.camera == ready_plenoptic.camera and from_stage.name == ready_plenoptic.name == "Rig.Camera"
    assert from_stage.rig.tracer.seed == ready_plenoptic.rig.tracer.seed == 4


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([[1, 2]],), r"points_mm has the shape \(1, 2\)"),
        (([[1, 2, np.nan]],), "points_mm holds numbers that are not finite"),
        (("here",), "points_mm holds values that are not numbers"),
        (([[1, 2, 3]], [0, 0, 0]), "a normal has no direction"),
        (([[1, 2, 3]], [[0, 0, -1], [0, 0, -1]]), "1 points have 2 normals"),
    ],
)
def test_wrong_numbers_are_named(conventional, arguments, said):
    with pytest.raises(CameraError, match=said):
        pipeline.ready(conventional).project(*arguments)


def test_a_camera_says_what_it_is_and_which_positions_do_not_go_together(conventional):
    camera = pipeline.ready(conventional)
    assert str(camera) == "camera: 96 x 72 px, f = 100.72 mm, F/7.71"
    with pytest.raises(CameraError, match="2 x_px have 3 y_px"):
        camera.rays([1, 2], [1, 2, 3])


def test_wrong_cameras_are_named(plenoptic_build, tmp_path):
    with pytest.raises(UsageError, match=r'did you mean "Rig.Camera"\?'):
        pipeline.ready(plenoptic_build, "Rig.Camra")
    with pytest.raises(UsageError, match=r"it has no manifest.json"):
        pipeline.ready(tmp_path)
    with pytest.raises(CameraError, match="accuracy_px"):
        pipeline.ready(plenoptic_build).project([[0, 0, 400]], accuracy_px=-1)
    with pytest.raises(UsageError, match="a Output is no stage") as refused:
        pipeline.ready(pipeline.open_output(plenoptic_build))
    assert "path" in refused.value.hint


def test_completion_sees_what_is_there_and_nothing_else():
    assert {"jobs", "preview", "keep_going"} <= set(inspect.signature(pipeline.build).parameters)
    assert "options" not in inspect.signature(pipeline.build).parameters
    assert dir(pipeline) == sorted(pipeline.__all__)
