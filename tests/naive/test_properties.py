"""Claim: for any input, frames invert, records survive JSON, and the half-pixel rule is its own inverse."""

import json
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.microlens_array import MicrolensArray
from pipeline.frames import apply, inverse, rigid, rotation_vector
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.records.plain import from_plain, to_plain
from pipeline.truth.grid.ray_grid import fine_from_image, image_from_fine

repeatable = settings(deadline=None, derandomize=True, max_examples=100)
metres = st.floats(-1e3, 1e3)
positive = st.floats(1e-3, 1e3)
vectors = st.tuples(metres, metres, metres).map(np.array)
rotations = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(lambda v: Rotation.from_rotvec(v).as_matrix())
transforms = st.builds(rigid, rotations, vectors)


@repeatable
@given(transforms, transforms, vectors)
def test_transforms_chain_and_invert(a_from_b: np.ndarray, b_from_c: np.ndarray, point: np.ndarray) -> None:
    points = point[None]
    np.testing.assert_allclose(apply(a_from_b @ b_from_c, points), apply(a_from_b, apply(b_from_c, points)), atol=1e-9)
    np.testing.assert_allclose(apply(inverse(a_from_b), apply(a_from_b, points)), points, atol=1e-9)
    np.testing.assert_allclose(inverse(inverse(a_from_b)), a_from_b, atol=1e-9)


@repeatable
@given(rotations)
def test_a_rotation_vector_is_axis_times_angle(rotation: np.ndarray) -> None:
    """Rodrigues' formula gives the rotation back."""
    vector = rotation_vector(rigid(rotation, np.zeros(3)))
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle > 0 else np.zeros(3)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    found = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    np.testing.assert_allclose(found, rotation, atol=1e-12)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Any camera that may exist, with planes, with and without microlenses, near and far open or settled."""
    surfaces = draw(
        st.lists(
            st.builds(
                Surface,
                radius_mm=st.one_of(st.just(math.inf), st.floats(50.0, 500.0), st.floats(-500.0, -50.0)),
                thickness_mm=st.floats(0.0, 20.0),
                semi_diameter_mm=st.floats(0.1, 49.0),
                index=st.floats(1.0, 2.0),
                decentre_mm=st.tuples(metres, metres),
                tilt_deg=st.tuples(st.floats(-89, 89), st.floats(-89, 89)),
            ),
            max_size=4,
        )
    )
    surfaces.insert(draw(st.integers(0, len(surfaces))), Surface(semi_diameter_mm=draw(positive), is_stop=True))
    group = st.builds(Group, name=st.text(), first=st.just(0), count=st.just(1), pivot_mm=metres)
    array = st.builds(
        MicrolensArray,
        pitch_mm=positive,
        focal_lengths_mm=st.one_of(st.tuples(positive), st.tuples(positive, positive, positive)),
        width_mm=positive,
        height_mm=positive,
        distance_mm=st.floats(0.1, 10.0),
        rotation_deg=st.floats(-180, 180),
    )
    sensor = st.builds(
        Sensor,
        width_px=st.integers(1, 9999),
        height_px=st.integers(1, 9999),
        pitch_mm=positive,
        offset_x_mm=metres,
    )
    return Camera(
        prescription=Prescription(surfaces=tuple(surfaces), groups=draw(st.just(()) | st.tuples(group))),
        sensor=draw(sensor),
        sensor_distance_mm=draw(st.floats(150.0, 900.0)),
        microlenses=draw(st.none() | array),
        near_mm=draw(st.none() | positive),
        far_mm=draw(st.none() | positive),
    )


@settings(repeatable, max_examples=40)
@given(cameras())
def test_a_camera_survives_the_way_through_json(camera: Camera) -> None:
    assert from_plain(Camera, json.loads(json.dumps(to_plain(camera)))) == camera


@repeatable
@given(st.floats(-0.5, 1e4), st.integers(1, 16))
def test_the_half_pixel_rule_is_its_own_inverse(x_px: float, k: int) -> None:
    """There and back; and K fine pixels of a whole one have their mean in its centre."""
    assert math.isclose(image_from_fine(fine_from_image(np.array([x_px]), k), k)[0], x_px, rel_tol=0, abs_tol=1e-9)
    whole = math.floor(x_px)
    fine = np.arange(whole * k, whole * k + k)
    assert math.isclose(image_from_fine(fine, k).mean(), whole, rel_tol=0, abs_tol=1e-9)
