"""Claim: derivatives of rows are those of the law that rows obey.

Judged by rows solved again, by what the world and a unit of length cannot change, and in a stage from the attribute to
the file; `published/test_drjit.py` has a trace of its own.
"""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from builds import made
from laws import rigs
from laws.solving import planes_of, rig_of
from laws.test_shutter import moving, stage, turning
from scipy.spatial.transform import Rotation
from stage_text import DATA, over_tiny

import pipeline
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.parts.errors import CameraError
from pipeline.camera.rig import Rig
from pipeline.files.tables import read_table
from pipeline.frames import rigid
from pipeline.motion import Shutter
from pipeline.scene.dataset import Dataset
from pipeline.scene.load import load
from pipeline.truth.derivatives import Derivatives, Neighbour, SolvedRows, Variation, derivatives
from pipeline.truth.direct.direct_rows import Guess, guesses, solve
from pipeline.truth.moving import solve_points
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.rows import Solutions

SAME = 1e-6
"""Relative to the largest derivative of a kind: what is asked for. Rims that cut each other at small angles bend it,
and rows solved again tell it to some 1e-7."""
POSE = rigid(Rotation.from_euler("xyz", (200.0, 15.0, 20.0), degrees=True).as_matrix(), np.array([3.0, -2.0, 500.0]))
POINTS_MM = np.array([[x, y, 0.0] for x in (-30.0, -5.0, 22.0) for y in (-21.0, 4.0, 18.0)])


def planes_at(pose: np.ndarray = POSE, points_mm: np.ndarray = POINTS_MM) -> np.ndarray:
    return tangent_planes(pose, points_mm)


def solved_rows(rows: Solutions, planes: Planes) -> SolvedRows:
    return SolvedRows(rows.point, rows.cell, rows.xy_px, planes)


def rates(
    camera: Camera, change: Callable[[Camera, float], Camera], step: float
) -> tuple[Rig, np.ndarray, Derivatives]:
    """The rig, its rows' positions, and their derivatives by one number of the camera."""
    rig, planes = rig_of(camera), planes_at()
    rows = solve(rig, guesses(rig, planes)[0], planes, 1e-9, 0.05).solutions
    on = Planes(planes)
    sides = (Neighbour(rig.tracer.next_to(change(camera, sign * step)), on) for sign in (-1, 1))
    return rig, rows.xy_px, derivatives(rig, solved_rows(rows, on), [Variation(step, *sides)])


def of_surface(place: int, /, **field: int | None) -> Callable[[Camera, float], Camera]:
    """Add to a field of a surface of the lens, or to one of its entries."""
    ((name, entry),) = field.items()

    def change(camera: Camera, by: float) -> Camera:
        value = getattr(camera.prescription.surfaces[place], name)
        moved = value + by if entry is None else tuple(v + by * (i == entry) for i, v in enumerate(value))
        return rigs.reshaped(camera, {place: {name: moved}})

    return change


def of_sensor(name: str) -> Callable[[Camera, float], Camera]:
    def change(camera: Camera, by: float) -> Camera:
        sensor = dataclasses.replace(camera.sensor, **{name: getattr(camera.sensor, name) + by})
        return dataclasses.replace(camera, sensor=sensor)

    return change


def farther(camera: Camera, by: float) -> Camera:
    return dataclasses.replace(camera, sensor_distance_mm=camera.sensor_distance_mm + by)


def vignetting(stop_semi_mm: float = 16.5, inner_semi_mm: float = 0.0) -> Camera:
    """The double Gauss with an asphere, before a sensor that its rims shade: bundles have corners, at 16.5 mm all."""
    sensor = Sensor(width_px=400, height_px=300, pitch_mm=0.08)
    camera = rigs.bare(rigs.tronnier(stop_semi_mm), sensor, 125.0, (400.0, 600.0))
    asphere = {"conic": -0.2, "even_coefficients": (0.0, 1e-7)}
    return rigs.reshaped(camera, {0: asphere, 3: {"inner_semi_diameter_mm": inner_semi_mm}})


NUMBERS = {
    "radius": (of_surface(2, radius_mm=None), 4e-4),
    "thickness": (of_surface(1, thickness_mm=None), 1e-4),
    "index": (of_surface(3, index=None), 1e-6),
    "conic": (of_surface(0, conic=None), 1e-5),
    "coefficient": (of_surface(0, even_coefficients=1), 1e-11),
    "decentre": (of_surface(3, decentre_mm=0), 1e-4),
    "tilt": (of_surface(7, tilt_deg=1), 1e-4),
    "stop": (of_surface(5, semi_diameter_mm=None), 1e-4),
    "sensor distance": (farther, 1e-4),
    "offset": (of_sensor("offset_x_mm"), 1e-4),
    "pitch": (of_sensor("pitch_mm"), 1e-7),
}


@pytest.mark.parametrize(
    "name", ["radius", "stop", "tilt", *(pytest.param(n, marks=pytest.mark.heavy) for n in NUMBERS)]
)
def test_derivatives_are_differences_of_rows_that_are_solved_again_vignetted_ones_too(name):
    change, step = NUMBERS[name]
    camera = vignetting()
    _, x_px, rate = rates(camera, change, step)
    rows = Guess(np.arange(len(x_px)), np.zeros(len(x_px), np.int64), x_px)

    def again(by: float) -> np.ndarray:
        return solve(rig_of(change(camera, by)), rows, planes_at(), 1e-10, 0.05).solutions.xy_px

    # Rows are solved to 1e-9 px or so, which long steps divide.
    wide, narrow = ((again(h) - again(-h)) / (2 * h) for h in (80 * step, 40 * step))
    expected = narrow + (narrow - wide) / 3  # Richardson's: their error is of the fourth order

    assert len(x_px) == len(POINTS_MM)
    np.testing.assert_allclose(rate.x_px[:, 0], expected, atol=SAME * np.abs(expected).max(), rtol=0)


def test_a_ring_has_derivatives_and_its_inner_edge_counts():
    change = of_surface(3, inner_semi_diameter_mm=None)
    camera = vignetting(inner_semi_mm=5.0)
    _, x_px, rate = rates(camera, change, 1e-3)
    rows = Guess(np.arange(len(x_px)), np.zeros(len(x_px), np.int64), x_px)
    ends = [solve(rig_of(change(camera, h)), rows, planes_at(), 1e-10, 0.05).solutions.xy_px for h in (0.02, -0.02)]
    expected = (ends[0] - ends[1]) / 0.04

    assert np.abs(expected).max() > 1e-2
    np.testing.assert_allclose(rate.x_px[:, 0], expected, atol=1e-4 * np.abs(expected).max(), rtol=0)


def test_rows_that_move_with_their_lines_have_the_derivatives_of_rows_that_are_solved_again():
    """By a radius, by the place of the board along its way, and by the time from line to line."""
    camera, shutter = (
        rigs.conventional(),
        Shutter(scan_order="topToBottom", opens_s=-0.01, line_s=2e-4, exposure_s=4e-3),
    )
    rig, radius = rig_of(camera), of_surface(0, radius_mm=None)

    def planes(x_mm: float = 0.0, line_s: float = 0.0) -> Planes:
        def pose(t: float) -> np.ndarray:
            return turning(t) + np.outer([x_mm, 0, 0, 0], [0, 0, 0, 1])

        return moving(rig, pose, dataclasses.replace(shutter, line_s=shutter.line_s + line_s))

    changes = {
        1e-4: lambda by: (rig_of(radius(camera, by)), planes()),
        2e-3: lambda by: (rig, planes(x_mm=by)),
        1e-7: lambda by: (rig, planes(line_s=by)),
    }
    rows = solve_points(rig, planes(), slice(None), 1e-9, 0.05).solutions
    variations, expected = [], []
    for step, change in changes.items():
        ends = [change(side * step) for side in (-1, 1)]
        less, more = (solve_points(*end, slice(None), 1e-9, 0.05).solutions.xy_px for end in ends)
        expected.append((more - less) / (2 * step))
        sides = (Neighbour(rig.tracer.next_to(end.tracer.camera), on) for end, on in ends)
        variations.append(Variation(step, *sides))
    rate = derivatives(rig, solved_rows(rows, planes()), variations).x_px

    largest = np.abs(expected).max(axis=(1, 2))
    assert len(rows.point) == 12 and largest[2] * 1e-3 > 1, largest  # px by a millisecond from line to line
    off = np.abs(rate.transpose(1, 0, 2) - expected).max(axis=(1, 2)) / largest
    assert (off < SAME).all(), off


def test_the_spread_changes_as_that_of_rows_that_are_solved_again():
    camera, h = vignetting(8.0), 0.02
    _, x_px, rate = rates(camera, farther, 1e-3)
    rows = Guess(np.arange(len(x_px)), np.zeros(len(x_px), np.int64), x_px)
    spread = []
    for by in (h, -h):
        rig = rig_of(farther(camera, by))
        again = solve(rig, rows, planes_at(), 1e-10, 0.05).solutions.xy_px
        _, covariance = _covariance(rig, again)
        spread.append(covariance)
    expected = (spread[0] - spread[1]) / (2 * h)

    np.testing.assert_allclose(rate.spread_mm2[:, 0], expected, atol=1e-5 * np.abs(expected).max(), rtol=0)


def _covariance(rig: Rig, x_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of hits by random rays' own weights: of single rays, none of the code of derivatives."""
    from pipeline.camera.integrals import Bundles, integrals
    from pipeline.camera.tracing.moments import COVARIANCE
    from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS

    planes = np.stack([planes_at(), planes_at()], axis=1)
    moments = integrals(rig.tracer, Bundles(x_px, np.full(len(x_px), NO_MICROLENS), planes), 3).moments
    full = moments[:, COVARIANCE : COVARIANCE + 10]
    return moments[:, :2], np.stack([full[:, [0, 1]], full[:, [1, 4]]], axis=1)


def stage_with(folder: Path, numbers: str) -> Path:
    path = folder / "dataset.usda"
    asked = f"rel plen:truth:derivatives = [{numbers}]\nuniform bool plen:truth:blurDerivatives = true"
    path.write_text(over_tiny(f"{asked}\nuniform bool plen:truth:rays = false"))
    return path


def dataset_of(path: Path) -> Dataset:
    dataset = load(path, [DATA.parents[1]]).dataset
    assert dataset is not None
    return dataset


def all_rates(dataset: Dataset, frame: int = 0) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of numbers, and derivatives of positions (n, v, 2) and blur (n, v, 2, 2) of a frame, without the engine."""
    (camera,), (target,) = dataset.cameras, dataset.targets
    rig, points = rig_of(camera.camera), target.target.points()

    def planes(of: Dataset) -> np.ndarray:
        pose = of.frames[frame].vision_from_target(camera.name, target.name)
        return planes_of(of.targets[0].target, pose)

    here = planes(dataset)
    rows = solve(rig, guesses(rig, here)[0], here, 1e-9, 0.05).solutions
    varied = dataset.varied[camera.prim_path]
    variations = []
    for number in varied:
        ends = (
            Neighbour(rig.tracer.next_to(end.cameras[0].camera), Planes(planes(end)))
            for end in (number.less, number.more)
        )
        variations.append(Variation(number.step, *ends))
    assert len(rows.point) == len(points.kinds)
    rate = derivatives(rig, solved_rows(rows, Planes(here)), variations, with_blur=True)
    assert rate.blur_px2 is not None
    return [number.name for number in varied], rate.x_px, rate.blur_px2


ROOT = "/TinyConventional"


def adjoint(a_from_b: np.ndarray) -> np.ndarray:
    """How a small motion in b, shift [mm] and turn [deg], looks in a, (6, 6)."""
    turn, (x, y, z) = a_from_b[:3, :3], a_from_b[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result = np.zeros((6, 6))
    result[:3, :3] = result[3:, 3:] = turn
    result[:3, 3:] = math.radians(1) * cross @ turn
    return result


def test_a_camera_and_a_board_that_move_together_by_all_six_gauges_leave_every_row_where_it_is(tmp_path):
    dataset = dataset_of(stage_with(tmp_path, f"<{ROOT}/Board>, <{ROOT}/Rig/Camera>"))
    names, rate, blur = all_rates(dataset, frame=1)
    vision_from_target = dataset.frames[1].vision_from_target("Rig.Camera", "Board")
    by_board, by_camera = rate[:, :6], rate[:, 6:]
    # A motion of the vision frame, which the camera makes, is one of the target's own frame to the board.
    of_board = np.einsum("nvi,vw->nwi", by_board, adjoint(np.linalg.inv(vision_from_target)))

    assert [name.removeprefix(ROOT) for name in names[:2]] == ["/Board x", "/Board y"]
    assert np.abs(by_camera).max() > 1
    np.testing.assert_allclose(of_board + by_camera, 0.0, atol=1e-9 * np.abs(by_camera).max())
    blur_by_board = np.einsum("nvij,vw->nwij", blur[:, :6], adjoint(np.linalg.inv(vision_from_target)))
    np.testing.assert_allclose(blur_by_board + blur[:, 6:], 0.0, atol=SAME * np.abs(blur).max())


def test_a_camera_that_moves_before_a_pane_of_the_world_leaves_the_pane_where_it_is(tmp_path):
    """Camera, board and pane along the same way leave every row where it is, and the pane alone does not."""
    across = "xformOp:translate[0]"
    wish = f"<{ROOT}/Rig/Camera>, <{ROOT}/Board.xformOp:translate>, <{ROOT}/Pane.xformOp:translate>"
    surface = 'def PlenSurface "{}"\n{{\n{}\nuniform double plen:semiDiameter = 90\n}}\n'
    glass = 'uniform string plen:glass = "schott:N-BK7"\nuniform double plen:thickness = 12\n'
    pane = "double3 xformOp:translate = (0, 0, -300)\ndouble3 xformOp:rotateXYZ = (20, 5, 0)\n"
    order = 'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]\n'
    faces = surface.format("Outer", glass + "uniform double plen:radius = 500") + surface.format("Inner", "")
    pane += f'{order}uniform token[] plen:surfaceOrder = ["Outer", "Inner"]\n{faces}'
    path, camera = stage_with(tmp_path, wish), f"rel plen:camera:windows = <{ROOT}/Pane>\nrel plen:truth:"
    text = path.read_text(encoding="utf-8").replace("rel plen:truth:", camera)
    path.write_text(f'{text.rstrip()[:-1]}def PlenWindow "Pane"\n{{\n{pane}}}\n}}\n', encoding="utf-8")
    names, rate, _ = all_rates(dataset_of(path))
    by = dict(zip((name.removeprefix(ROOT) for name in names), rate.transpose(1, 0, 2), strict=True))

    assert np.abs(by[f"/Pane.{across}"]).max() > 0.1
    together = by["/Rig/Camera x"] + by[f"/Board.{across}"] + by[f"/Pane.{across}"]
    np.testing.assert_allclose(together, 0.0, atol=SAME * np.abs(by["/Rig/Camera x"]).max())


def test_a_scene_of_twice_all_lengths_has_the_same_image_which_is_euler_s_law(tmp_path):
    lens = dataset_of(stage_with(tmp_path, f"<{ROOT}/Board>")).cameras[0].camera.prescription
    of_lens = [
        f"<{ROOT}/Rig/Lens/{'Stop' if surface.is_stop else f'S{number}'}.plen:{name}>"
        for number, surface in enumerate(lens.surfaces, 1)
        for name in ("radius", "thickness", "semiDiameter")
        if not (name == "radius" and surface.is_stop) and not (name == "thickness" and number == len(lens.surfaces))
    ]
    rest = ("Rig/Camera.plen:camera:sensorDistance", "Rig/Sensor.plen:pixelPitch", "Board.plen:squareSize")
    others = [f"<{ROOT}/{name}>" for name in (*rest, "Board.xformOp:translate")]
    dataset = dataset_of(stage_with(tmp_path, ", ".join([*of_lens, *others])))
    names, rate, blur = all_rates(dataset)
    translate = dict(zip("012", np.array(dataset.frames[0].world_from_target["Board"])[:3, 3], strict=True))
    sensor = dataset.cameras[0].asked.sensor
    lengths = []
    for name in names:
        prim, field = name.removeprefix(f"{ROOT}/").split(".", 1)
        if prim.startswith("Rig/Lens/"):
            at = prim.split("/")[-1]
            number = next(
                i for i, s in enumerate(lens.surfaces, 1) if (at == "Stop") == s.is_stop and at in ("Stop", f"S{i}")
            )
            attribute = {"radius": "radius_mm", "thickness": "thickness_mm", "semiDiameter": "semi_diameter_mm"}
            lengths.append(getattr(lens.surfaces[number - 1], attribute[field.removeprefix("plen:")]))
        elif field.startswith("xformOp"):
            lengths.append(translate[field[-2]])
        else:
            values = (dataset.cameras[0].camera.sensor_distance_mm, sensor.pitch_mm, 1.4)
            lengths.append(values[rest.index(f"{prim}.{field}")])
    terms = rate * np.array(lengths)[:, None]

    assert len(of_lens) > 25
    np.testing.assert_allclose(terms.sum(axis=1), 0.0, atol=1e-7 * np.abs(terms).max())
    blur_terms = blur * np.array(lengths)[:, None, None]
    np.testing.assert_allclose(blur_terms.sum(axis=1), 0.0, atol=1e-5 * np.abs(blur_terms).max())


def test_a_build_delivers_derivatives_of_all_rows_and_an_edit_of_the_wish_runs_nothing_else(tmp_path):
    plain, numbers = tmp_path / "dataset.usda", f"<{ROOT}/Board>, <{ROOT}/Rig/Lens/S3.plen:radius>"
    plain.write_text(over_tiny("uniform bool plen:truth:rays = false"))
    made(plain, tmp_path / "out", tmp_path / "store", allow_roots=[DATA.parents[1]])
    result = made(stage_with(tmp_path, numbers), tmp_path / "out", tmp_path / "store", allow_roots=[DATA.parents[1]])
    ran = {task.name.partition("/")[0] for task in result.tasks if task.state == "executed"}
    delivered = np.load(tmp_path / "out/frames/0002/Rig.Camera/derivatives.npz")
    _, rate, blur = all_rates(dataset_of(stage_with(tmp_path, numbers)), frame=1)

    assert ran == {"camera", "derivatives"}
    assert list(delivered["names"][-1:]) == [f"{ROOT}/Rig/Lens/S3.plen:radius"]
    assert list(delivered["units"]) == ["mm"] * 3 + ["deg"] * 3 + ["mm"]
    np.testing.assert_allclose(delivered["x_px"], rate, atol=1e-6 * np.abs(rate).max())
    np.testing.assert_allclose(delivered["blur_px2"], blur, atol=1e-4 * np.abs(blur).max())


def test_a_stage_has_derivatives_by_the_delay_of_lines_and_by_the_pose_of_a_board_that_moves(tmp_path, common_store):
    """Rows come again from builds with a delay of 1.001 ms, and with the board a thousandth of a mm to the right."""
    camera, board = f"{ROOT}/Rig/Camera.plen:shutter:lineOffset", f"{ROOT}/Board"
    wish = 'token scanOrder = "topToBottom"\ndouble2 opens = (1, 500)\ndouble2 lineOffset = ({}, 1000)'

    def built(name: str, line: float, x_mm: float) -> Path:
        places = f"({x_mm - 0.1}, 0.3, -434.4)", f"({x_mm + 0.3}, -0.9, -430.4)"
        asked = (
            'over "Camera"\n        {\n',
            f'over "Camera"\n        {{\n            rel plen:truth:derivatives = [<{camera}>, <{board}>]\n',
        )
        path = stage(tmp_path / name, wish.format(line), places, *([asked] if name == "here" else []))
        made(path, tmp_path / name / "out", common_store)
        return tmp_path / name / "out/frames/0001/Rig.Camera"

    def rows(folder: Path) -> np.ndarray:
        table = read_table(folder / "correspondences.csv")
        return np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1)

    here = built("here", 1.0, 0.0)
    with np.load(here / "derivatives.npz") as file:
        rate = dict(zip(file["names"].tolist(), file["x_px"].transpose(1, 0, 2), strict=True))
    for name, step, there in (
        (f"{camera}[0]", 1e-3, built("slow", 1.001, 0.0)),
        (f"{board} x", 1e-3, built("right", 1.0, 1e-3)),
    ):
        expected = (rows(there) - rows(here)) / step
        np.testing.assert_allclose(rate[name], expected, rtol=0, atol=1e-3 * np.abs(expected).max(), err_msg=name)
    np.testing.assert_allclose(rate[f"{camera}[1]"], -rate[f"{camera}[0]"] / 1000, rtol=1e-6)


def test_a_camera_made_ready_gives_derivatives_by_points_and_by_numbers_of_its_stage(tmp_path):
    path = tmp_path / "dataset.usda"
    path.write_text(over_tiny())
    camera, points, h = (
        pipeline.ready(path, allow_roots=[DATA.parents[1]]),
        np.array([[1.0, -0.5, 434.0], [-2.0, 1.0, 430.0]]),
        1e-2,
    )
    radius = f"{ROOT}/Rig/Lens/S3.plen:radius"
    seen = camera.project(points, accuracy_px=1e-9, derivatives=["point", radius], blur_derivatives=True)
    for axis in range(3):
        shift = h * np.eye(3)[axis]
        more, less = (camera.project(points + sign * shift, accuracy_px=1e-9) for sign in (1, -1))
        expected = np.stack([more.x_px - less.x_px, more.y_px - less.y_px], axis=1) / (2 * h)
        np.testing.assert_allclose(seen.derivatives["point"][:, :, axis], expected, atol=1e-6)
        of_blur = (more.blur_px2 - less.blur_px2) / (2 * h)
        np.testing.assert_allclose(seen.blur_derivatives["point"][..., axis], of_blur, atol=1e-6)

    assert np.abs(of_blur).max() > 1e-3
    assert seen.derivatives[radius].shape == (2, 2) and seen.blur_derivatives[radius].shape == (2, 2, 2)
    for wrong in ("point", [3]):
        with pytest.raises(CameraError, match="no list of names"):
            pipeline.ready(camera.camera).project(points, derivatives=wrong)
    with pytest.raises(CameraError, match="without a stage"):
        pipeline.ready(camera.camera).project(points, derivatives=[radius])


def test_a_pitch_that_moves_the_number_of_microlenses_on_an_array_has_derivatives_all_the_same(tmp_path):
    rig = rig_of(camera := pipeline.ready(DATA / "tiny_plenoptic/dataset.usda").camera)
    planes = planes_at(rigid(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 434.0])), np.zeros((1, 3)))
    rows = solve(rig, guesses(rig, planes)[0], planes, 1e-9, 0.2).solutions

    def change(by: float) -> Camera:
        array = camera.microlenses
        return dataclasses.replace(camera, microlenses=dataclasses.replace(array, pitch_mm=array.pitch_mm * (1 + by)))

    step, on = 1e-4, Planes(planes)
    sides = [rig.tracer.next_to(change(sign * step)) for sign in (-1, 1)]
    variation = Variation(step, *(Neighbour(side, on) for side in sides))
    rate = derivatives(rig, solved_rows(rows, on), [variation])
    # The middle microlens stays where it is; all others move away from it as their distance grows.
    axial = rig.axial[rows.cell]
    away = np.hypot(*axial.T) > 0

    assert len({len(side.lattice.k) for side in sides} | {len(rig.tracer.lattice.k)}) > 1
    assert np.isfinite(rate.x_px).all()
    moved = np.einsum("ni,ni->n", rate.x_px[:, 0], rows.xy_px - rows.xy_px[~away].mean(axis=0))
    assert (moved[away] > 0).all()
