"""Claim: optiland, a lens-design program, brings chief rays of wide fields to the positions of our truth.

Its numbers are kept, and asked of it again where it is installed (`pip install optiland`).
"""

import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
from tolerances import OPTILAND_AIMED_MM

from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.optics.prescription import Prescription, Surface
from pipeline.results.ready_camera import ReadyCamera

LENSES = json.loads((Path(__file__).parent / "optiland_wide.json").read_text(encoding="utf-8"))["lenses"]
PIN_MM, FAR_MM, PITCH_MM = 1e-4, 1e8, 1e-3
"""Semi-diameter of a stop whose mean ray is the chief ray to its square, distance for infinity, and pixels."""


def ready(lens: dict) -> ReadyCamera:
    """The lens before a sensor in the plane where the listing ends."""
    surfaces = [
        Surface(
            radius_mm=radius or math.inf,
            thickness_mm=thickness,
            index=index,
            semi_diameter_mm=PIN_MM if stop else semi_mm,
            is_stop=bool(stop),
        )
        for radius, thickness, index, semi_mm, *stop in lens["surfaces"]
    ]
    prescription = Prescription(surfaces=tuple(surfaces))
    behind = sum(surface.thickness_mm for surface in surfaces[prescription.stop_index :])
    sensor = Sensor(width_px=2400, height_px=2400, pitch_mm=PITCH_MM)
    camera = Camera(prescription=prescription, sensor=sensor, sensor_distance_mm=behind)
    return ReadyCamera(name="wide", rig=Rig.of(Tracer(camera)), min_hit_fraction=0.0, accuracy_px=1e-5)


@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens["sample"])
def test_far_points_lie_where_its_chief_rays_arrive(lens):
    angle_deg, height_mm = np.array(lens["chief_rays"]).T
    camera, angle = ready(lens), np.radians(angle_deg)
    way = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    rows = camera.project(FAR_MM * way, -way)
    assert rows.is_seen.all()
    seen_mm = camera.rig.tracer.positions_mm(rows.x_px, rows.y_px)
    np.testing.assert_allclose(np.hypot(*seen_mm.T), height_mm, rtol=0, atol=OPTILAND_AIMED_MM)


@pytest.mark.heavy
@pytest.mark.parametrize("lens", LENSES, ids=lambda lens: lens["sample"])
def test_optiland_says_so(lens):
    objectives = pytest.importorskip("optiland.samples.objectives")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        optic = getattr(objectives, lens["sample"])()
        widest = lens["chief_rays"][-1][0]
        heights = [optic.trace_generic(0, angle / widest, 0, 0, 0.5876).y[0] for angle, _ in lens["chief_rays"]]
        own = [
            (1 / surface.geometry.radius, np.ravel(surface.material_post.n(0.5876))[0])
            for surface in optic.surfaces.surfaces[1:-1]
        ]
    kept = [(1 / (radius or math.inf), index) for radius, _, index, *_ in lens["surfaces"]]
    np.testing.assert_allclose(own, kept, rtol=0, atol=1e-12)
    np.testing.assert_allclose(heights, [height for _, height in lens["chief_rays"]], rtol=0, atol=OPTILAND_AIMED_MM)
