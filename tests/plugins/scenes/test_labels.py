"""Claim: labels say what each pixel sees, by the light that it receives; CONVENTIONS.md, "Labels", defines them.

A pinhole has them in closed form. Of a lens and of microlenses the exact positions of target points are the judge.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of, solved
from laws.test_model_cameras import model
from plugins.scenes.lit import matt, mesh, plate, scene

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import parallel_planes
from pipeline.frames import apply, rigid
from pipeline.plugins.scenes.labels.cryptomatte import id_of
from pipeline.plugins.scenes.labels.pixels import RANKS, Requested, labels_of
from pipeline.plugins.scenes.labels.sight_lines import SightLines
from pipeline.plugins.scenes.labels.things import LabelledScene, Later
from pipeline.plugins.scenes.lighting.records import Input, Material
from pipeline.render.pixel_rays import Band
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.surfaces import Cube, Cylinder, Flat, Warped
from pipeline.targets.target import Target

BOARD = Checkerboard(columns=5, rows=4, square_mm=2.0)
TOKENS = ("depth", "range", "position", "normal", "board", "flow", "targets")
SAMPLES = 64
SINGLE_MM = 5e-5
"""A depth of 434 mm in single precision [mm]: half a unit of its last place is 1.5e-5 mm, of a mean of two as much."""
OF_SAMPLES = 0.05
"""What a mean of 64 scrambled Sobol points may miss, over their spread [1]: independent ones would miss 0.125 rms."""
FLOW_PX = 2e-3
"""Flow beside the difference of two truths [px]: on a board that is tilted by 30 degrees J of its own plane and of
one across the axis differ by 1e-3 px from frame to frame; what is interpolated between pixels by 3e-4 px."""
LIT_FLOW_PX = 1e-3
"""The same behind microlenses, in the inner half of micro-images, where no edge cuts light off [px]."""


@dataclass
class Labelled:
    rig: Rig
    channels: dict[str, np.ndarray]

    def __getitem__(self, name: str) -> np.ndarray:
        return self.channels[name]

    def at(self, name: str, xy_px: np.ndarray) -> np.ndarray:
        """A channel between the centres of four pixels."""
        x, y = xy_px.T
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        a, b, c = x - i, y - j, self.channels[name].astype(float)
        return (c[j, i] * (1 - a) + c[j, i + 1] * a) * (1 - b) + (c[j + 1, i] * (1 - a) + c[j + 1, i + 1] * a) * b


def labelled(
    camera: Camera,
    targets=(),
    occluders=(),
    later: Later | None = None,
    samples: int = SAMPLES,
    pose=None,
    then: Camera | None = None,
) -> Labelled:
    """Labels of things that are called t0, t1, … and o0, o1, …; `then`: the camera in the next frame."""
    rig = rig_of(camera)
    lines = SightLines(rig), SightLines(rig_of(then or camera))
    names = [f"t{k}" for k in range(len(targets))] + [f"o{k}" for k in range(len(occluders))]
    ids = np.array([id_of(name) for name in names], np.float32)
    asked = Requested(TOKENS, tuple(names[: len(targets)]), {"Crypto": ids}, np.eye(4) if pose is None else pose)
    (values,) = labels_of(Band.of(rig), samples, [(LabelledScene(targets, occluders, later), asked)], lines)
    return Labelled(rig, dict(zip(asked.channels, np.moveaxis(values, 2, 0), strict=True)))


def pinhole(height_px: int = 72) -> Camera:
    return model(rigs.conventional(height_px=height_px), "pinhole")


def slopes(rig: Rig) -> np.ndarray:
    """x and y over z of what a pinhole sees in each pixel, (h, w, 2)."""
    sensor, z_mm = rig.tracer.camera.sensor, rig.tracer.camera.sensor_distance_mm
    y, x = np.mgrid[: sensor.height_px, : sensor.width_px]
    return -rig.tracer.positions_mm(x.ravel(), y.ravel()).reshape(*x.shape, 2) / z_mm


@pytest.mark.parametrize("camera", [pinhole(8), model(rigs.conventional(height_px=8), "thinLens"), rigs.plenoptic(3.0)])
def test_a_plane_across_the_axis_has_one_depth_through_any_lens(camera):
    seen = labelled(camera, occluders=[(plate(434.4), np.eye(4))])
    lit = seen["A"] > 0
    assert lit.mean() > 0.9
    np.testing.assert_allclose(seen["Z"][lit], 434.4, rtol=0, atol=SINGLE_MM)
    assert seen["spread.Z"][lit].max() < SINGLE_MM
    np.testing.assert_array_equal(seen["A"][lit], 1.0)
    np.testing.assert_allclose(seen["N.Z"][lit], -1.0, rtol=0, atol=1e-6)


def test_a_tilted_plane_before_a_pinhole():
    """Depth z0 / (1 - tan(30 deg) x) along slopes x, to the second order in a pixel's square."""
    pose, tangent = rigs.facing(434.4, 30.0), np.tan(np.radians(30.0))
    seen = labelled(pinhole(), [(Target(Checkerboard(columns=50, rows=39, square_mm=4.0), Flat()), pose)])
    slope = slopes(seen.rig)
    normal = pose[:3, 2]
    z_mm = 434.4 * normal[2] / (normal[2] + slope @ normal[:2])
    assert abs(abs(normal[0] / normal[2]) - tangent) < 1e-12
    step_mm = np.abs(np.diff(z_mm, axis=1)).max()
    np.testing.assert_allclose(seen["Z"], z_mm, rtol=0, atol=OF_SAMPLES * step_mm)
    for axis in range(2):
        np.testing.assert_allclose(seen[f"P.{'XY'[axis]}"], z_mm * slope[..., axis], rtol=0, atol=OF_SAMPLES * 0.4)
        np.testing.assert_allclose(seen[f"N.{'XY'[axis]}"], normal[axis], rtol=0, atol=1e-6)
    point = np.stack([seen["P.X"], seen["P.Y"], seen["P.Z"]], axis=-1).astype(float)
    np.testing.assert_allclose(seen["range"], np.linalg.norm(point, axis=-1), rtol=0, atol=1e-3)
    np.testing.assert_array_equal(seen["board.share"], 1.0)


def test_position_and_normal_are_in_the_world():
    world_from_vision = rigid(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), np.array([10.0, 20.0, 30.0]))
    seen = labelled(pinhole(8), occluders=[(plate(434.4), np.eye(4))], pose=world_from_vision)
    np.testing.assert_allclose(seen["P.X"], 444.4, rtol=0, atol=SINGLE_MM)
    np.testing.assert_allclose(seen["N.X"], -1.0, rtol=0, atol=1e-6)
    np.testing.assert_allclose(seen["P.Y"] - 20.0, 434.4 * slopes(seen.rig)[..., 0], rtol=0, atol=OF_SAMPLES * 0.4)


def test_two_half_planes_share_the_pixels_at_their_edge():
    """Through a pinhole the edge at x = 0.3 px of a column cuts it at 0.8; mean and spread are those of two depths."""
    camera = pinhole(6)
    pitch = 0.05 / camera.sensor_distance_mm  # slope of a pixel
    edge = (0.3 - 0.5) * pitch  # 96 columns: the axis lies between columns 47 and 48
    left, right = (plate(z, 400.0, 400.0 * side + edge * z) for z, side in ((400.0, -1), (600.0, 1)))
    seen = labelled(camera, occluders=[(left, np.eye(4)), (right, np.eye(4))], samples=1024)
    share = {float(i): s for i, s in zip(seen["Crypto00.R"][3, 47:49], seen["Crypto00.G"][3, 47:49], strict=True)}
    near = seen["Crypto00.R"] == id_of("o0")
    assert near[:, :48].all() and not near[:, 48:].any() and len(share) == 2
    # Column 47 has its centre at -0.5 px, so the edge, at -0.2 px, leaves 0.8 of it to the left plate.
    np.testing.assert_allclose(seen["Crypto00.G"][:, 47], 0.8, atol=0.01)
    np.testing.assert_allclose(seen["Crypto00.A"][:, 47], 0.2, atol=0.01)
    np.testing.assert_allclose(seen["Z"][:, 47], 0.8 * 400 + 0.2 * 600, atol=0.01 * 200)
    np.testing.assert_allclose(seen["spread.Z"][:, 47], 200 * np.sqrt(0.8 * 0.2), atol=0.01 * 200)
    np.testing.assert_allclose(seen["A"][:, 47], 1.0, atol=1e-6)


def test_an_edge_out_of_focus_is_shared_as_the_disc_of_its_blur_is_cut():
    """A thin lens at F/11, focused at 434 mm, before an edge at 300 mm: shares are those of segments of a disc."""
    camera = model(rigs.conventional(height_px=7), "thinLens")
    rig = rig_of(camera)
    stop_mm = camera.prescription.stop.semi_diameter_mm
    seen = labelled(camera, occluders=[(plate(300.0, 400.0, -400.0), np.eye(4))], samples=1024)
    focus_mm = 1 / (1 / camera.prescription.stop.focal_length_mm - 1 / camera.sensor_distance_mm)
    x_mm = -rig.tracer.positions_mm(np.arange(96), np.full(96, 3))[:, 0] / camera.sensor_distance_mm * 300.0
    radius_mm = stop_mm * (1 - 300.0 / focus_mm)
    cut = np.clip(x_mm / radius_mm, -1, 1)
    expected = (np.arccos(cut) - cut * np.sqrt(1 - cut**2)) / np.pi
    assert np.count_nonzero((expected > 0) & (expected < 1)) > 3
    np.testing.assert_allclose(seen["A"][3], expected, atol=0.02)
    assert np.isnan(seen["Z"][3, expected == 0]).all()


def test_shares_of_ids_sum_to_what_is_hit_and_the_rest_has_none():
    small = [(plate(420.0 + 4 * k, 0.7, 2.0 * k - 7), np.eye(4)) for k in range(8)]
    seen = labelled(rigs.conventional(), occluders=small)
    ids = [seen[f"Crypto{rank // 2:02d}.{'RB'[rank % 2]}"] for rank in range(RANKS)]
    shares = np.array([seen[f"Crypto{rank // 2:02d}.{'GA'[rank % 2]}"] for rank in range(RANKS)])
    lit = np.isfinite(seen["A"])
    np.testing.assert_allclose(shares.sum(axis=0)[lit], seen["A"][lit], atol=1e-6)
    assert (np.diff(shares, axis=0) <= 0).all() and 0 < seen["A"][lit].mean() < 0.5
    known = {float(id_of(f"o{k}")) for k in range(8)}
    assert {float(value) for values in ids for value in np.unique(values)} == known | {0.0}


def test_board_coordinates_at_the_truth_of_a_corner_are_those_of_the_corner():
    warped = Warped(deflection_mm=(0.4, -0.2))  # a pinhole is exact of any surface; such a board has planes of its own
    for camera, surface in ((pinhole(), Flat()), (pinhole(), warped), (rigs.conventional(), Flat())):
        target, pose = Target(BOARD, surface), rigs.facing(434.4, 30.0)
        seen = labelled(camera, [(target, pose)])
        points = target.points()
        if surface == warped:
            there = apply(pose, points.position_mm)
            xy = seen.rig.tracer.pixels_at(-there[:, :2] / there[:, 2:] * camera.sensor_distance_mm)
            which = np.arange(len(xy))
        else:
            rows = solved(seen.rig, BOARD, pose).solutions
            xy, which = rows.xy_px, rows.point
        assert len(xy) == 20
        spread = seen.at("spread.board", xy)
        for axis, name in enumerate(("board.U", "board.V")):
            off = np.abs(seen.at(name, xy) - points.nominal_mm[which, axis])
            assert (off < OF_SAMPLES * spread).all()


def test_a_cylinder_has_the_arc_and_a_cube_names_its_face():
    rolled = Target(BOARD, Cylinder(radius_mm=20.0))
    seen = labelled(pinhole(), [(rolled, rigs.facing(434.4))])
    on = seen["A"] == 1
    u, x, z = seen["board.U"][on], seen["P.X"][on], seen["P.Z"][on]
    np.testing.assert_allclose(20 * np.sin(u / 20), x, atol=2e-3)
    np.testing.assert_allclose(434.4 + 20 * (1 - np.cos(u / 20)), z, atol=2e-3)
    np.testing.assert_allclose(seen["N.X"][on], np.sin(u / 20), atol=1e-3)
    cube = labelled(pinhole(), [(Target(BOARD, Cube(edge_mm=16.0)), rigs.facing(434.4, 40.0))])
    faces = cube["board.face"][cube["A"] == 1]
    assert set(np.unique(faces)) == {0.0, 3.0} or set(np.unique(faces)) == {0.0, 1.0}


def pairs(now, then) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the same points in the same cells."""
    place = {key: row for row, key in enumerate(zip(then.point.tolist(), then.cell.tolist(), strict=True))}
    common = [
        (row, place[key])
        for row, key in enumerate(zip(now.point.tolist(), now.cell.tolist(), strict=True))
        if key in place
    ]
    return tuple(np.array(common).T)


@pytest.mark.parametrize("camera", [pinhole(), model(rigs.conventional(), "thinLens"), rigs.conventional()])
def test_flow_is_the_difference_of_the_truths_of_two_frames(camera):
    now, then = rigs.facing(434.4, 30.0), rigs.facing(440.0, 32.0, 0.3, -0.2)
    seen = labelled(camera, [(Target(BOARD, Flat()), now)], later=Later([then], []))
    before, after = (solved(seen.rig, BOARD, pose).solutions for pose in (now, then))
    first, second = pairs(before, after)
    way = after.xy_px[second] - before.xy_px[first]
    assert len(first) == 20 and np.abs(way).max() > 2
    for axis, name in enumerate(("flow.X", "flow.Y")):
        np.testing.assert_allclose(seen.at(name, before.xy_px[first]), way[:, axis], rtol=0, atol=FLOW_PX)
    assert seen["spread.flow"][30:40, 40:50].max() < 1e-6


def test_flow_is_through_the_lens_as_it_is_in_the_next_frame():
    """A focus that is pulled moves what stands still: the image breathes."""
    near, far, pose = rigs.conventional(), rigs.conventional(), rigs.facing(434.4)
    far = replace(far, sensor_distance_mm=far.sensor_distance_mm + 5.0)
    seen = labelled(near, [(Target(BOARD, Flat()), pose)], later=Later([pose], []), then=far)
    before, after = (solved(rig_of(camera), BOARD, pose).solutions for camera in (near, far))
    way = after.xy_px - before.xy_px
    assert len(way) == 20 and np.abs(way).max() > 0.1
    for axis, name in enumerate(("flow.X", "flow.Y")):
        np.testing.assert_allclose(seen.at(name, before.xy_px), way[:, axis], rtol=0, atol=FLOW_PX)


def test_flow_behind_microlenses_is_that_of_each_micro_image():
    now, then = rigs.facing(434.4, 10.0), rigs.facing(436.0, 11.0, 0.2, -0.1)
    seen = labelled(rigs.plenoptic(extent_mm=3.0), [(Target(BOARD, Flat()), now)], later=Later([then], []))
    before, after = (solved(seen.rig, BOARD, pose).solutions for pose in (now, then))
    first, second = pairs(before, after)
    images = seen.rig.images
    inner = np.ones(len(first), bool)
    for rows, some in ((before, first), (after, second)):
        off_mm = seen.rig.tracer.positions_mm(*rows.xy_px[some].T) - images.centre_mm[rows.cell[some]]
        inner &= np.hypot(*off_mm.T) < images.radius_mm / 2
    inner &= (np.abs(before.xy_px[first] - [63.5, 47.5]) < [62, 46]).all(axis=1)  # with pixels on all sides
    way = (after.xy_px[second] - before.xy_px[first])[inner]
    assert len(way) >= 6 and np.abs(way).max() > 0.5
    for axis, name in enumerate(("flow.X", "flow.Y")):
        flow = seen.at(name, before.xy_px[first[inner]])
        np.testing.assert_allclose(flow, way[:, axis], rtol=0, atol=LIT_FLOW_PX)
    u = seen.at("board.U", before.xy_px[first[inner]])
    spread = seen.at("spread.board", before.xy_px[first[inner]])
    assert (np.abs(u - BOARD.points_mm()[before.point[first[inner]], 0]) < OF_SAMPLES * spread).all()


def test_light_through_other_microlenses_is_seen_and_does_not_flow():
    """A stop so wide that micro-images overlap: what the others show lies ten pixels away and grows, too.

    A plate that is larger by a twentieth moves each point in proportion to its place, so J(x + flow) is 1.05 J(x)
    through the microlens of the pixel's own cell, and no mixture of other places is.
    """
    sensor, growth = Sensor(width_px=32, height_px=24, pitch_mm=0.01), 1.05
    lens, array = rigs.tronnier(9.0), rigs.michels_array(1.5)
    camera = focused(Camera(prescription=lens, sensor=sensor, sensor_distance_mm=125.0, microlenses=array))
    here, still = plate(434.4, 60.0), np.eye(4)
    there = mesh([(growth * x, growth * y, z) for x, y, z in here.vertices_mm])
    seen = labelled(camera, occluders=[(here, still)], later=Later([], [(there, still)]))
    y, x = np.mgrid[: sensor.height_px, : sensor.width_px].reshape(2, -1)
    at_mm, images = seen.rig.tracer.positions_mm(x, y), seen.rig.images
    cell = images.owner(at_mm)
    flow = np.stack([seen["flow.X"], seen["flow.Y"]], axis=-1).reshape(-1, 2).astype(float)
    lit = np.isfinite(flow).all(axis=1) & (np.hypot(*(at_mm - images.centre_mm[cell]).T) < images.radius_mm / 2)

    def meets(x_px: np.ndarray) -> np.ndarray:
        planes = np.broadcast_to(parallel_planes(434.4, 900.0), (lit.sum(), 2, 4, 3))
        bundles = Bundles(x_px, seen.rig.microlens(cell[lit]), planes)
        return integrals(seen.rig.tracer, bundles, 2).moments[:, :2]

    places = np.stack([x, y], axis=1)[lit].astype(float)
    now = meets(places)
    mm_per_px = np.linalg.norm(meets(places + np.array([0.1, 0.0])) - now, axis=1) / 0.1
    mixed = seen["spread.P"].ravel()[lit] > 5 * mm_per_px
    assert mixed.mean() > 0.3, "light of other places arrives"
    off_px = np.linalg.norm(meets(places + flow[lit]) - growth * now, axis=1) / mm_per_px
    assert off_px.max() < FLOW_PX


def test_a_mesh_that_changes_its_shape_flows_corner_by_corner():
    """A plate twice as large flows away from its middle; one that is gone, or has other faces, has no flow."""
    here = plate(434.4, 10.0)
    larger, other = mesh(np.array(here.vertices_mm) * [2, 2, 1]), mesh(here.vertices_mm, here.triangles[:1])
    still = np.eye(4)
    seen = labelled(pinhole(), occluders=[(here, still)], later=Later([], [(larger, still)]))
    inside = (np.abs(slopes(seen.rig)) * 434.4 < 9.0).all(axis=2)
    x = np.mgrid[:72, :96][1] - 47.5
    stays = inside & np.isfinite(seen["flow.X"])
    assert stays.sum() > 100
    np.testing.assert_allclose(seen["flow.X"][stays], x[stays], rtol=0, atol=0.02)
    for then in (None, (other, still)):
        assert np.isnan(labelled(pinhole(8), occluders=[(here, still)], later=Later([], [then]))["flow.X"]).all()


def test_bands_of_rows_are_rows_of_the_whole():
    camera, pose = rigs.plenoptic(extent_mm=3.0), rigs.facing(434.4)
    rig = rig_of(camera)
    asked = Requested(TOKENS, ("t0",), {"Crypto": np.array([id_of("t0")], np.float32)})
    scene = [(LabelledScene([(Target(BOARD, Flat()), pose)], [], Later([pose], [])), asked)]
    lines = SightLines(rig), SightLines(rig)
    (whole,), (some,) = (labels_of(Band.of(rig, rows), 16, scene, lines) for rows in (None, (20, 50)))
    np.testing.assert_array_equal(whole[20:50], some)


@pytest.mark.parametrize(("threshold", "share"), [(0.0, 0.3), (0.5, 0.0), (0.2, 1.0)])
def test_light_passes_a_veil_by_chance_and_a_hole_for_certain(threshold, share):
    """A plate of opacity 0.3 before a wall has 0.3 of the light, or with a threshold all of it or none."""
    veil = Material(opacity=Input(value=(0.3,)), opacity_threshold=threshold, is_presence=True)
    things = [(plate(400.0), veil), (plate(500.0), matt(0.5))]
    lit, camera = scene(things, []), pinhole()
    meshes = [(mesh, np.eye(4)) for mesh, _ in things]
    ids = np.array([id_of("veil"), id_of("wall")], np.float32)
    asked = Requested(("depth",), (), {"Crypto": ids})
    (values,) = labels_of(Band.of(rig_of(camera), (30, 33)), 1024, [(LabelledScene([], meshes, lit=lit), asked)])
    seen = dict(zip(asked.channels, np.moveaxis(values, 2, 0), strict=True))
    of_veil = sum((seen[f"Crypto00.{a}"] == id_of("veil")) * seen[f"Crypto00.{b}"] for a, b in ("RG", "BA"))
    np.testing.assert_allclose(of_veil, share, atol=0.02)
    np.testing.assert_allclose(seen["Z"], 500.0 - 100.0 * of_veil, rtol=0, atol=1e-3)
    assert (seen["A"] == 1).all()
