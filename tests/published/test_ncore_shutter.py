"""Claim: rows before a rolling shutter are those of NVIDIA's NCore, whose time is that of whole lines."""

from dataclasses import replace

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of
from laws.test_shutter import BOARD, moving, shifted, still

from pipeline.camera.figures.equivalent_pinhole import pinhole
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.ideal_lens import with_ideal_lens
from pipeline.motion import Shutter
from pipeline.truth.moving import solve_points

LINE_S = 5e-4
SAME_PX = 1e-9


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("order", "name"),
    [
        ("topToBottom", "TOP_TO_BOTTOM"),
        ("bottomToTop", "BOTTOM_TO_TOP"),
        ("leftToRight", "LEFT_TO_RIGHT"),
        ("rightToLeft", "RIGHT_TO_LEFT"),
    ],
)
def test_a_board_that_flies_past_lies_where_ncore_says_but_for_the_part_of_a_line(order, name):
    data = pytest.importorskip("ncore.data", reason="nvidia-ncore is not installed")
    torch, sensors = pytest.importorskip("torch"), pytest.importorskip("ncore.sensors")
    camera = focused(with_ideal_lens(replace(rigs.conventional(), near_mm=None, far_mm=None), "pinhole", ()))
    rig, ideal = rig_of(camera), pinhole(camera).distorted
    size = np.array([camera.sensor.width_px, camera.sensor.height_px])
    shutter = Shutter(scan_order=order, line_s=LINE_S)
    rows = solve_points(
        rig, moving(rig, lambda t: shifted(30 * t, -40 * t), shutter), slice(None), 1e-6, 0.05
    ).solutions

    model = data.OpenCVPinholeCameraModelParameters(
        resolution=size.astype(np.uint64),
        shutter_type=getattr(data.ShutterType, f"ROLLING_{name}"),
        principal_point=np.array(ideal.principal_point_px, np.float32) + np.float32(0.5),
        focal_length=np.full(2, ideal.principal_distance_px, np.float32),
        radial_coeffs=np.zeros(6, np.float32),
        tangential_coeffs=np.zeros(2, np.float32),
        thin_prism_coeffs=np.zeros(4, np.float32),
    )
    theirs = sensors.camera_model_from_parameters(model, device="cpu", dtype=torch.float64)
    theirs.focal_length[:] = ideal.principal_distance_px  # which single precision had rounded
    theirs.principal_point[:] = torch.tensor(ideal.principal_point_px) + 0.5
    end_s = shutter.window_s(camera.sensor.size_px)[1]
    first, end = shifted(0, 0), shifted(30 * end_s, -40 * end_s)
    for pose in (first, end):
        pose[:3, 3] -= pinhole(camera).centre_mm
    found = theirs.world_points_to_image_points_shutter_pose(
        BOARD.points_mm(), first, end, max_iterations=60, stop_t_delta=1e-13,
        return_T_world_sensors=True, return_valid_indices=True,
    )  # fmt: skip
    assert len(found.valid_indices) == len(rows.point) == len(BOARD.points_mm())
    their_s = (found.T_world_sensors[:, 0, 3].numpy() - first[0, 3]) / 30
    v = 100 * (still(rig, shifted(0.3, -0.4)) - still(rig, shifted(0, 0)))
    # Uniform motion before a pinhole is uniform in the image: by their time both are at one place.
    own_s = shutter.middle_s(rows.xy_px, camera.sensor.size_px)
    assert 1e-5 < np.abs(their_s - own_s).max() < LINE_S
    there = rows.xy_px + v * (their_s - own_s)[:, None]
    np.testing.assert_allclose(found.image_points.numpy() - 0.5, there, rtol=0, atol=SAME_PX)
