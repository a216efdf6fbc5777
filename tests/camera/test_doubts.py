"""Claim: what is doubted of a camera is so, by kernels and closed forms, and nothing is doubted of sound cameras."""

import dataclasses
import re

import numpy as np
import pytest
from laws import rigs

from pipeline.camera.figures.doubts import doubts
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import with_matched_stop, with_stop
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.pupil.outlines import passes
from pipeline.camera.tracer import Tracer

CONVENTIONAL, PLENOPTIC = focused(rigs.conventional()), focused(rigs.plenoptic(extent_mm=3.0))


def codes(camera: Camera) -> list[str]:
    return [doubt.code for doubt in doubts(camera)]


def with_sensor(camera: Camera, **values) -> Camera:
    return dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, **values))


def with_array(camera: Camera, **values) -> Camera:
    return dataclasses.replace(camera, microlenses=dataclasses.replace(camera.microlenses, **values))


@pytest.mark.parametrize("camera", [CONVENTIONAL, PLENOPTIC], ids=["conventional", "plenoptic"])
def test_sound_cameras_raise_no_doubt(camera: Camera) -> None:
    assert codes(camera) == []


def test_light_ends_where_the_kernels_pass_no_ray_any_more() -> None:
    """A fine grid on the rear surface, a little inside and a little outside of the stated circle."""
    wide = with_sensor(CONVENTIONAL, width_px=3000, height_px=20)
    (doubt,) = doubts(wide)
    tracer, far_mm = Tracer(wide), float(re.search(r"farther out than ([\d.]+) mm", doubt.message)[1])
    u = np.linspace(-20.0, 20.0, 301)
    grid = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    for height_mm, is_lit in ((far_mm - 0.5, True), (far_mm + 0.5, False)):
        starts = np.broadcast_to([height_mm, 0.0, tracer.film_z_mm], (len(grid), 3))
        assert passes(tracer.table, starts, grid).any() == is_lit
    assert doubt.code == "image-circle"


@pytest.mark.parametrize(
    "camera",
    [pytest.param(CONVENTIONAL, marks=pytest.mark.heavy), rigs.displaced(CONVENTIONAL)],
    ids=["centred", "displaced"],
)
def test_light_comes_through_a_stop_however_narrow(camera: Camera) -> None:
    """Half of a millimetre down to a tenth of a micrometre; and no farther out than through a wide one."""
    for wide_mm in (0.5, 0.02, 1e-4):
        assert codes(with_stop(camera, wide_mm)) == []
    far = [
        float(re.search(r"farther out than ([\d.]+) mm", doubt.message)[1])
        for stopped in (camera, with_stop(camera, 0.02))
        for doubt in doubts(with_sensor(stopped, width_px=3000, height_px=20))
    ]
    assert far[0] > far[1] > 0.7 * far[0]


def test_where_no_chief_ray_leaves_the_camera_cannot_be_traced() -> None:
    with pytest.raises(CameraError, match=r"no ray from .* reaches the centre of the aperture stop"):
        codes(with_sensor(CONVENTIONAL, pitch_mm=20.0))
    with pytest.raises(CameraError, match="the farthest microlens"):
        codes(with_array(PLENOPTIC, width_mm=400.0, height_mm=0.3))


def test_a_matched_stop_is_where_overlap_begins() -> None:
    """Matched micro-images are one pitch wide, and stand apart by a pitch and its share B / P: here 1.4 %."""
    matched = with_matched_stop(PLENOPTIC)
    wide_mm = 2 * matched.prescription.stop.semi_diameter_mm
    for share, found in ((0.54, ["gaps"]), (0.57, []), (1.05, []), (1.08, ["overlap"])):
        assert codes(with_stop(PLENOPTIC, share * wide_mm)) == found


def test_a_slip_of_a_unit_is_named() -> None:
    assert "pixel-pitch" in codes(with_sensor(CONVENTIONAL, pitch_mm=1e-5))
    focal = PLENOPTIC.microlenses.focal_lengths_mm
    assert "weak-microlens" in codes(with_array(PLENOPTIC, focal_lengths_mm=tuple(1e3 * f for f in focal)))
    assert "small-array" in codes(with_array(PLENOPTIC, width_mm=0.6, height_mm=0.6))
    assert "microlens-pitch" in codes(with_array(PLENOPTIC, pitch_mm=1.0))
    assert "wide-stop" in codes(with_stop(CONVENTIONAL, 60.0))
