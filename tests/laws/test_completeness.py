"""Claim: method `direct` has every row that exists: J on a grid of sensor positions, behind every microlens that may
see them, says which do, without any guess from the side of the target.
"""

import dataclasses
import itertools

import numpy as np
import pytest
from laws import rigs
from laws.solving import planes_of, rig_of
from shorter import few
from tolerances import DIRECT_PX

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.optics.prescription import Group, Prescription, Surface
from pipeline.products.truth.table import TargetNote
from pipeline.results.ready_camera import ReadyCamera
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target
from pipeline.truth.direct.direct_rows import guesses, mean_rays, solve

LEAST_LIGHT, NEAR_PX, SAME_PX = 0.05, 25.0, 1e-3
"""Hit fraction that rows need; farthest centre of a cell that reaches into an image, for micro-images of 22 px; within
which distance two solutions are one [px]: the scan errs by up to 1e-4 behind slits, and DIRECT_PX is less.
"""
OPEN, STOP, FRONT, REAR = {"inner_semi_diameter_mm": 0.0}, 5, 0, 9
"""A surface without its obstruction; places of surfaces of the double Gauss."""


def behind_a_port(lens: Prescription, index: float, gap_mm: float, tilt_deg: tuple[float, float]) -> Prescription:
    """The lens in air behind a pane of 10 mm, as it looks into a medium."""
    pane = (
        Surface(thickness_mm=10.0, index=1.52, semi_diameter_mm=60.0),
        Surface(thickness_mm=gap_mm, semi_diameter_mm=52.0),
    )
    port = Group(name="port", first=0, count=2, tilt_deg=tilt_deg)
    return dataclasses.replace(lens, surfaces=pane + lens.surfaces, index_in_front=index, groups=(port,))


def gauss(stop_mm: float, surfaces: dict[int, dict] | None = None) -> Prescription:
    return rigs.reshaped(rigs.conventional(stop_mm), surfaces or {}).prescription


def plenoptic(lens: Prescription, offset_mm: tuple[float, float] = (0.0, 0.0), **array: object) -> Camera:
    """A corner of the camera of the paper: some eight micro-images."""
    tilt_deg = array.pop("sensor_tilt_deg", (0.0, 0.0))
    x_mm, y_mm = offset_mm
    sensor = Sensor(width_px=64, height_px=48, pitch_mm=0.01, offset_x_mm=x_mm, offset_y_mm=y_mm, tilt_deg=tilt_deg)
    microlenses = dataclasses.replace(rigs.michels_array(1.7), **array)
    return focused(Camera(prescription=lens, sensor=sensor, sensor_distance_mm=125.0, microlenses=microlenses))


def slivers() -> Camera:
    """Three blades and a large obstruction before them: of full bundles some parts in a thousand are left."""
    sensor = Sensor(width_px=48, height_px=40, pitch_mm=0.05, offset_x_mm=-1.0, offset_y_mm=1.0)
    blades = {"blades": 3, "aperture_rotation_deg": 20.0}
    lens = gauss(12.0, {FRONT: {"inner_semi_diameter_mm": 16.0}, STOP: blades})
    return focused(Camera(prescription=lens, sensor=sensor, sensor_distance_mm=131.81))


_TILTED = {"tilt_x_deg": 3.0, "tilt_y_deg": -3.0, "sensor_tilt_deg": (4.0, -3.0)}
_CUT = {FRONT: {"semi_diameter_mm": 9.0}, REAR: {"semi_diameter_mm": 7.0}, STOP: {"blades": 5}}
_HOLLOW = {FRONT: {"inner_semi_diameter_mm": 5.6}, STOP: {"blades": 6, "aperture_rotation_deg": 40.0}}
_SLIT = {STOP: {"half_widths_mm": (4.5, 0.8), "aperture_rotation_deg": 22.0}}
_DIM = {FRONT: {"semi_diameter_mm": 4.2}, REAR: {"semi_diameter_mm": 3.2}}
_THICK = {"model": "refractive", "index": 1.52, "thickness_mm": 0.6, "focal_lengths_mm": (), "distance_mm": 2.4}
_GLASS = {**_THICK, "front_radii_mm": (1.1,) * 3, "rear_radii_mm": (np.inf,) * 3, "sensor_tilt_deg": (0.3, 3.3)}
CASES = {
    # Camera, depth of the board, step of the scan
    "medium": (lambda: plenoptic(behind_a_port(gauss(5.0), 1.41, 60.0, (0.0, 0.0)), (8.0, 6.0)), 571.0, 3.0),
    "port": (lambda: plenoptic(behind_a_port(gauss(5.0), 1.0, 60.0, (6.0, 9.0)), (8.0, 6.0)), 430.0, 3.0),
    "both": (lambda: plenoptic(behind_a_port(gauss(5.0), 1.41, 60.0, (-12.0, -9.0)), (3.0, 2.0)), 450.0, 3.0),
    "tilted": (lambda: plenoptic(gauss(5.0), (4.0, 3.0), **_TILTED), 430.0, 3.0),
    "cut": (lambda: plenoptic(gauss(8.0, _CUT), (9.0, 6.0)), 380.0, 2.0),
    "discs": (lambda: plenoptic(gauss(5.0), (5.0, -3.0), aperture="disc", disc_diameter_mm=0.1), 520.0, 3.0),
    "hollow": (
        lambda: plenoptic(behind_a_port(gauss(8.0, _HOLLOW), 1.41, 44.0, (-14.0, 3.5))),
        606.0,
        1.5,
    ),
    "slivers": (slivers, 400.0, 2.0),
    # At the edge of the image: rims turn J back, so that two positions see a point; J moves otherwise than chief rays.
    "folded": (lambda: plenoptic(gauss(3.0, _DIM), **_GLASS), 430.0, 2.0),
    "slit": (
        lambda: plenoptic(gauss(5.0, _SLIT), (6.0, -7.0), distance_mm=1.0, sensor_tilt_deg=(3.6, 4.7)),
        300.0,
        1.5,
    ),
}


def before(rig: Rig, depth_mm: float) -> np.ndarray:
    """Pose of a board, turned twice, where the middle of the image looks; obstructions left aside."""
    camera = rig.tracer.camera
    rig = rig_of(rigs.reshaped(camera, dict.fromkeys(range(len(camera.prescription.surfaces)), OPEN)))
    size = np.array([[camera.sensor.width_px, camera.sensor.height_px]])
    middle = (size - 1) / 2
    if rig.images is not None:
        middle = rig.home_px(rig.microlens_at(rig.tracer.positions_mm(*middle.T)))
    ray = mean_rays(rig, middle, parallel_planes(depth_mm, depth_mm + 1)[None], 1e-2)
    pose = rigs.facing(depth_mm, -15.0, *ray.crossings_mm[0, 0])
    cos, sin = np.cos(0.3), np.sin(0.3)
    return pose @ np.array([[1, 0, 0, 0], [0, cos, -sin, 0], [0, sin, cos, 0], [0, 0, 0, 1.0]])


def j_of(rig: Rig, x_px: np.ndarray, cell: np.ndarray, plane: np.ndarray, level: int) -> tuple[np.ndarray, np.ndarray]:
    planes = np.repeat(np.stack([plane] * 2)[None], len(x_px), axis=0)
    moments = integrals(rig.tracer, Bundles(x_px, rig.microlens(cell), planes), level).moments
    return moments[:, :2], rig.hit_fraction(moments)


def scanned(rig: Rig, planes: np.ndarray, step_px: float) -> dict[tuple[int, int], np.ndarray]:
    """Positions of all rows of the points of a flat board, by point and cell."""
    plane, sensor = planes[0], rig.tracer.camera.sensor
    points = np.einsum("pj,ij->pi", planes[:, 0] - plane[0], plane[1:3])
    axes = (np.arange(-0.5 - 3 * step_px, size + 3 * step_px, step_px) for size in (sensor.width_px, sensor.height_px))
    nodes = np.stack(np.meshgrid(*axes), axis=-1)
    flat, starts = nodes.reshape(-1, 2), []
    homes = rig.home_px(np.arange(len(rig.axial)))
    for cell in np.flatnonzero(rig.in_image(homes, NEAR_PX)):
        inside = rig.in_image(flat, 1.5 * step_px) & rig.in_cell(flat, np.full(len(flat), cell), 1.5 * step_px)
        if not inside.any():
            continue
        j = np.full(flat.shape, np.nan)
        j[inside] = j_of(rig, flat[inside], np.full(inside.sum(), cell), plane, 1)[0]
        j = j.reshape(nodes.shape)
        # J is a plane over each node and its neighbours to a side and to another: where it meets a point a row may be.
        for side in itertools.product((1, -1), repeat=2):
            ends = (sign * (np.roll(j, -sign, axis=axis) - j) for sign, axis in zip(side, (1, 0), strict=True))
            slope = np.stack(list(ends), axis=-1) / step_px
            good = np.isfinite(slope).all(axis=(2, 3))
            good[good] = np.abs(np.linalg.det(slope[good])) > 0
            for number, point in enumerate(points):
                way = np.linalg.solve(slope[good], (point - j[good])[..., None])[..., 0]
                near = (np.abs(way - np.array(side) * step_px / 2) < step_px).all(axis=1)
                starts += [(number, cell, *x) for x in nodes[good][near] + way[near]]
    found = np.array(starts)  # neighbours find the same: one start of a cell of half a step is refined
    _, first = np.unique(np.floor(found / [1, 1, step_px / 2, step_px / 2]), axis=0, return_index=True)
    found = found[first]
    point, cell, x_px = found[:, 0].astype(int), found[:, 1].astype(int), found[:, 2:]
    for half_px in (0.1, 0.1, 0.05, 0.02, 0.02, 0.02):
        ends_px = half_px * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])[:, None]
        at = (x_px + ends_px).reshape(-1, 2)
        j, light = (values.reshape(5, len(x_px), -1) for values in j_of(rig, at, np.tile(cell, 5), plane, 2))
        slope = np.stack([j[1] - j[2], j[3] - j[4]], axis=2) / (2 * half_px)
        good = np.isfinite(slope).all(axis=(1, 2)) & np.isfinite(j[0]).all(axis=1)
        point, cell, x_px, j, light, slope = (v[good] for v in (point, cell, x_px, j[0], light[0, :, 0], slope))
        way = np.linalg.solve(slope, (points[point] - j)[..., None])[..., 0]
        x_px = x_px + way * np.minimum(1, step_px / np.maximum(np.hypot(*way.T), 1e-9))[:, None]
    exists = (np.hypot(*way.T) < 1e-3) & (light >= LEAST_LIGHT) & rig.in_image(x_px) & rig.in_cell(x_px, cell)
    return {(int(p), int(c)): x for p, c, x in zip(point[exists], cell[exists], x_px[exists], strict=True)}


QUICK = "slivers", "folded"
"""Two of which rows were missing once, as of "both", "hollow" and "slit": the first ones that are solved."""


@pytest.mark.parametrize("name", few(QUICK, *(name for name in CASES if name not in QUICK)))
def test_direct_and_project_have_every_row_that_a_grid_of_positions_has(name: str) -> None:
    """Six points. What cannot be solved is named, and nothing that a point may have is left out without a name."""
    camera, depth_mm, step_px = CASES[name]
    rig = rig_of(camera())
    planes = planes_of(Target(Checkerboard(columns=3, rows=2, square_mm=1.0)), before(rig, depth_mm))
    scan = scanned(rig, planes, step_px)
    rows = solve(rig, guesses(rig, planes)[0], planes, DIRECT_PX, LEAST_LIGHT)
    found = dict(
        zip(
            zip(rows.solutions.point.tolist(), rows.solutions.cell.tolist(), strict=True),
            rows.solutions.xy_px,
            strict=True,
        )
    )
    assert len(scan) > 5 and found.keys() == scan.keys()
    assert max(np.hypot(*(found[pair] - scan[pair])) for pair in scan) < SAME_PX
    assert len(rows.unsolved) == rows.counts["unsolved"]
    assert not found.keys() & set(map(tuple, rows.unsolved.tolist()))
    ready = ReadyCamera(name="", rig=rig, min_hit_fraction=LEAST_LIGHT, accuracy_px=DIRECT_PX)
    seen = ready.project(planes[:, 0], planes[:, 3])
    np.testing.assert_array_equal(seen.point, rows.solutions.point)
    np.testing.assert_allclose(seen.x_px, rows.solutions.x_px, rtol=0, atol=SAME_PX)


def test_what_stays_unsolved_is_named_by_point_and_microlens() -> None:
    notes = [TargetNote(target="Board", counts={"unsolved": 1}, unsolved=((point, -2, 5),)) for point in (3, 7)]
    assert "unsolved 2, unsolved are point 3 behind (-2, 5), point 7 behind (-2, 5)" in notes[0].joined(notes[1]).text
    assert "unsolved are point 4" in TargetNote(target="Board", counts={"unsolved": 1}, unsolved=((4,),)).text
