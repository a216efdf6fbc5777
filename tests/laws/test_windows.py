"""Claim: a camera looks through windows, and into media, as Snell's law has it in closed form."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from builds import made
from scipy.optimize import brentq
from stage_text import in_the_library

from pipeline.app.show import show
from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.files.tables import read_table
from pipeline.optics.first_order import first_order
from pipeline.optics.glass.row import medium
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_scene, unbounded
from pipeline.products.graph import graph_of
from pipeline.render.radiometry import photon_rate
from pipeline.render.sensor.response import Radiance
from pipeline.scene.load import open_dataset

_PLANES = "double plen:camera:near = 500\ndouble plen:camera:far = 560\n"
_PINHOLE = f'uniform token plen:camera:model = "pinhole"\n{_PLANES}'
_BOARD = "double3 xformOp:translate = (1, -1.2, -530)\nuniform double plen:squareSize = {square}\n" + (
    'float3 xformOp:rotateXYZ = (10, 20, 0)\nuniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]'
)
WATER = 'uniform string plen:medium = "constant(1.34)"\n'
PORT_MM, _GLASS_MM, _GLASS, _MEDIUM = 150.0, 10.0, 1.52, 1.34


def surface(name: str, radius_mm: float, thickness_mm: float, glass: str) -> str:
    shape = f"double plen:radius = {radius_mm}\nuniform double plen:thickness = {thickness_mm}"
    lines = (shape, "double plen:semiDiameter = 45", f'uniform string plen:glass = "{glass}"')
    return "\n".join((f'def PlenSurface "{name}"\n{{', *lines, "}\n"))


def window(
    z_mm: float, *, turn: str = "", radii_mm: tuple[float, float] = (np.inf, np.inf), glass: float = _GLASS
) -> str:
    """A pane whose outer vertex is at a z of what it stands below."""
    order = '"xformOp:translate"' + (', "xformOp:rotateXYZ"' if turn else "")
    lines = (
        f"double3 xformOp:translate = (0, 0, {z_mm})\nuniform token[] xformOpOrder = [{order}]",
        f"float3 xformOp:rotateXYZ = {turn}" if turn else "",
        'uniform token[] plen:surfaceOrder = ["Outer", "Inner"]',
        surface("Outer", radii_mm[0], _GLASS_MM, f"constant({glass})") + surface("Inner", radii_mm[1], 0, ""),
    )
    return "\n".join(('def PlenWindow "Pane"\n{', *lines, "}\n"))


def stage(
    folder: Path, name: str, pane: str = "", *, fixed: bool = True, camera: str = _PINHOLE, dataset: str = ""
) -> Path:
    """A board before the library's camera, a pinhole of a wide field or as it is, looked at through a pane below the
    camera, or one of the scene.
    """
    path = "/Scene/Rig/Camera/Pane" if fixed else "/Scene/Pane"
    rel = f"rel plen:camera:windows = <{path}>\n" if pane else ""
    wide = camera == _PINHOLE
    sensor = 'over "Sensor"\n{\ndouble plen:pixelPitch = 0.05\n}\n' if wide else ""
    rig = f'over "Camera"\n{{\n{camera}{rel}{pane if fixed else ""}}}\n{sensor}'
    text = in_the_library(dataset + ("" if fixed else pane), board=_BOARD.format(square=10 if wide else 1.5), rig=rig)
    file = folder / f"{name}.usda"
    file.write_text(text, encoding="utf-8")
    return file


def table(file: Path, store: Path) -> np.ndarray:
    """Rows of a stage: image positions and vision positions, (n, 5)."""
    built = made(file, file.with_suffix(""), store, targets=["frames/0001/Rig.Camera/correspondences.csv"])
    names = ("x_px", "y_px", "camera_x_mm", "camera_y_mm", "camera_z_mm")
    read = read_table(built.out / "frames/0001/Rig.Camera/correspondences.csv")
    result = np.stack([read.numbers(name) for name in names], axis=1)
    assert len(result) == 28
    return result


def test_a_flat_port_bends_chief_rays_by_snells_law(tmp_path, common_store):
    """The ray of a pinhole leaves at a slope s in air and crosses distances in air, glass and medium."""
    file = stage(tmp_path, "port", window(-PORT_MM), dataset=WATER)
    camera = open_dataset(file).cameras[0].camera
    for x, y, px, py, pz in table(file, common_store):
        across = np.hypot(px, py)
        media = ((PORT_MM - _GLASS_MM, 1.0), (_GLASS_MM, _GLASS), (pz - PORT_MM, _MEDIUM))
        sine = brentq(reached, 0.0, 0.9, (media, across), xtol=1e-16, rtol=1e-15)
        height_px = camera.sensor_distance_mm * sine / np.sqrt(1 - sine**2) / camera.sensor.pitch_mm
        expected = height_px * np.array([px, py]) / across + (np.array(camera.sensor.size_px) - 1) / 2
        assert np.abs(expected - [x, y]).max() < 1e-9


def test_the_focus_through_a_port_is_that_of_the_port_upright(tmp_path):
    """A plane at z in the medium seems to stand where each layer counts its thickness over its index; a tilt of the
    port, whose two foci lie apart, changes nothing of this figure of the centred lens.
    """

    def sensor_mm(name: str, focus_mm: float, pane: str = "", dataset: str = "") -> float:
        camera = f"double plen:camera:sensorDistance = None\ndouble plen:camera:focusDistance = {focus_mm!r}\n"
        return focused(
            open_dataset(stage(tmp_path, name, pane, camera=camera, dataset=dataset)).cameras[0].camera
        ).sensor_distance_mm

    tilted = sensor_mm("tilted", 530.0, window(-PORT_MM, turn="(4, -3, 0)"), WATER)
    upright = sensor_mm("upright", 530.0, window(-PORT_MM), WATER)
    seeming_mm = PORT_MM - _GLASS_MM + _GLASS_MM / _GLASS + (530.0 - PORT_MM) / _MEDIUM
    assert tilted == upright == pytest.approx(sensor_mm("air", seeming_mm), rel=1e-12)


def reached(sine: float, media: tuple[tuple[float, float], ...], across_mm: float) -> float:
    """How far beyond a height a ray comes that has this sine in air."""
    return sum(mm * (sine / n) / np.sqrt(1 - (sine / n) ** 2) for mm, n in media) - across_mm


def test_a_dome_about_the_pupil_moves_no_chief_ray(tmp_path, common_store):
    """Rays of a pinhole meet concentric surfaces at right angles; a dome 5 mm off its place moves them."""
    plain = table(stage(tmp_path, "plain"), common_store)
    dome = window(-60.0, radii_mm=(60.0, 50.0))
    through = table(stage(tmp_path, "dome", dome, dataset=WATER), common_store)
    assert np.abs(through - plain).max() < 1e-9
    off = window(-65.0, radii_mm=(60.0, 50.0))
    assert np.abs(table(stage(tmp_path, "off", off, dataset=WATER), common_store) - plain).max() > 0.1


@pytest.mark.parametrize("roll_deg", [0.0, 30.0])
def test_a_cylinder_about_the_pupil_is_a_flat_port_in_every_plane_of_its_axis(tmp_path, common_store, roll_deg):
    """A ray stays in the plane of the axis, x as rolled, and meets the surfaces there as planes across the radius."""
    bent = "double plen:radius", "uniform bool plen:cylindrical = 1\ndouble plen:radius"
    pane = window(-60.0, radii_mm=(60.0, 50.0), turn=f"(0, 0, {roll_deg})").replace(*bent)
    file = stage(tmp_path, "bent", pane, dataset=WATER)
    camera, roll = open_dataset(file).cameras[0].camera, np.radians(-roll_deg)  # vision has y down
    from_pane = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    for x, y, px, py, pz in table(file, common_store):
        along, across = np.array([px, py]) @ from_pane
        radius = np.hypot(across, pz)
        media = ((60 - _GLASS_MM, 1.0), (_GLASS_MM, _GLASS), (radius - 60, _MEDIUM))
        sine = brentq(reached, 0.0, 0.9, (media, abs(along)), xtol=1e-16, rtol=1e-15)
        way = np.array([np.sign(along) * sine, *np.sqrt(1 - sine**2) * np.array([across, pz]) / radius])
        expected = camera.sensor_distance_mm / camera.sensor.pitch_mm * from_pane @ way[:2] / way[2]
        assert np.abs(expected + (np.array(camera.sensor.size_px) - 1) / 2 - [x, y]).max() < 1e-9


def test_a_pane_by_heights_is_the_pane_whose_heights_they_are(tmp_path, common_store):
    """The outer face turned about x: heights are those of its plane, in the lens frame with y up."""
    turned = window(-100.0).replace("double plen:radius", "double2 plen:tilt = (4, 0)\ndouble plen:radius", 1)
    spacing, count = 14.0, 9
    y = (np.arange(count) - (count - 1) / 2) * spacing
    heights = [float(np.tan(np.radians(4)) * v) for v in y for _ in y]
    field = f"uniform double[] plen:heights = {heights}\nuniform int plen:heightColumns = {count}\n"
    field += f"uniform double plen:heightSpacing = {spacing}\n"
    uneven = window(-100.0).replace("double plen:radius", f"{field}double plen:radius", 1)
    by_tilt, by_heights, plain = (
        table(stage(tmp_path, name, pane, dataset=WATER), common_store)
        for name, pane in (("turned", turned), ("uneven", uneven), ("plain", window(-100.0)))
    )
    assert np.abs(by_heights - by_tilt).max() < 1e-9
    assert np.abs(by_tilt - plain).max() > 1


def test_a_turned_pane_in_the_world_bends_rays_by_snells_law_in_vectors(tmp_path, common_store):
    """The ray of each row's position, traced from the pinhole outwards, meets the row's point under water."""
    file = stage(tmp_path, "pane", window(-200.0, turn="(9, -7, 0)"), fixed=False, dataset=WATER)
    camera = open_dataset(file).cameras[0].asked
    turn = np.radians([9.0, -7.0])
    about_x = np.array([[1, 0, 0], [0, np.cos(turn[0]), -np.sin(turn[0])], [0, np.sin(turn[0]), np.cos(turn[0])]])
    about_y = np.array([[np.cos(turn[1]), 0, np.sin(turn[1])], [0, 1, 0], [-np.sin(turn[1]), 0, np.cos(turn[1])]])
    normal = about_y @ about_x @ [0.0, 0.0, 1.0]  # rotateXYZ: about x first; of a stage, whose y is up
    outer = np.array([0.0, 0.0, -200.0])
    for x, y, px, py, pz in table(file, common_store):
        middle = (np.array(camera.sensor.size_px) - 1) / 2
        across = (np.array([x, y]) - middle) * camera.sensor.pitch_mm / camera.sensor_distance_mm
        way, place = np.array([across[0], -across[1], -1.0]), np.zeros(3)
        way /= np.linalg.norm(way)
        for on_plane, ratio in ((outer + _GLASS_MM * normal, 1 / _GLASS), (outer, _GLASS / _MEDIUM)):
            place = place + way * ((on_plane - place) @ normal) / (way @ normal)
            cosine = -(way @ normal)
            way = ratio * way + (ratio * cosine - np.sqrt(1 - ratio**2 * (1 - cosine**2))) * normal
        point = np.array([px, -py, -pz])
        assert np.linalg.norm(np.cross(point - place, way)) < 1e-8  # mm; a pixel sees 0.2 mm of it


@pytest.mark.parametrize("camera", [_PINHOLE, ""])
def test_a_window_of_the_index_of_its_medium_changes_nothing(tmp_path, common_store, camera):
    plain = table(stage(tmp_path, "plain", camera=camera), common_store)
    glass = window(-200.0, glass=1.0, turn="(25, -20, 10)")
    through = table(stage(tmp_path, "pane", glass, camera=camera), common_store)
    assert np.abs(through - plain).max() < 1e-8


def test_a_pane_in_the_world_acts_as_one_below_the_camera_and_moves_nothing_of_the_rig(tmp_path, common_store):
    pane = window(-200.0, turn="(25, -20, 10)")
    below, world = (
        stage(tmp_path, name, pane, camera="", fixed=fixed) for name, fixed in (("below", True), ("world", False))
    )
    assert np.abs(table(world, common_store) - table(below, common_store)).max() < 1e-8
    moved = stage(tmp_path, "moved", window(-250.0, turn="(25, -20, 10)"), camera="", fixed=False)
    before, after = (graph_of(open_dataset(file))[0] for file in (world, moved))
    behind = "camera/Rig.Camera/windows"
    assert before[behind].params != after[behind].params
    for name in (name for name in before if name == "camera/Rig.Camera" or name.startswith("white")):
        assert before[name].params == after[name].params and behind not in before[name].reads.values()


def test_a_camera_that_moves_together_with_its_windshield_is_one_camera(tmp_path):
    pane = window(-200.0, turn="(25, -20, 10)")
    file = stage(tmp_path, "car", pane, camera="", fixed=False)
    drive = (
        "double3 xformOp:translate.timeSamples = {1: (0, 0, 0), 2: (100.1, 20.3, 7.7)}\n"
        "float3 xformOp:rotateXYZ.timeSamples = {1: (0, 0, 0), 2: (3.3, -5.7, 11.1)}\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]\n'
    )
    text = (
        file.read_text()
        .replace(pane, f'def Xform "Car"\n{{\n{drive}{pane}}}\n')
        .replace("/Scene/Pane", "/Scene/Car/Pane")
    )
    text = text.replace("endTimeCode = 1", "endTimeCode = 2").replace(
        'over "Camera"\n{\n', f'{drive}over "Camera"\n{{\n', 1
    )
    board = text.index('def "Board"')
    text = text[:board] + text[board:].replace(
        "double3 xformOp:translate = (1, -1.2, -530)",
        "double3 xformOp:translate.timeSamples = {1: (1, -1.2, -530), 2: (1, -1.2, -530)}",
    )
    file.write_text(text)
    (entry,) = open_dataset(file).cameras
    assert entry.name == "Rig.Camera" and entry.windows is not None


def test_an_aquarium_is_seen_from_the_air_before_it(tmp_path, common_store):
    """Behind a pane of the world lies the medium of the scene; the camera is focused in what its inner side has."""
    port = stage(tmp_path, "port", window(-200.0), dataset=WATER)
    tank = stage(tmp_path, "tank", window(-200.0), dataset=WATER, fixed=False)
    assert np.abs(table(port, common_store) - table(tank, common_store)).max() < 1e-8
    assert open_dataset(tank).cameras[0].asked.prescription.index_in_front == 1.0


def test_the_focus_is_found_through_port_and_medium(tmp_path):
    """A thin lens sees a point under water at its apparent distance: each stretch over its index."""
    camera = 'uniform token plen:camera:model = "thinLens"\ndouble plen:camera:focusDistance = 530\n'
    file = stage(
        tmp_path,
        "port",
        window(-PORT_MM),
        camera=camera + "double plen:camera:sensorDistance = None\n",
        dataset=WATER,
    )
    focused = open_dataset(file).cameras[0].camera
    apparent = (PORT_MM - _GLASS_MM) + _GLASS_MM / _GLASS + (530 - PORT_MM) / _MEDIUM
    focal = focused.prescription.surfaces[-1].focal_length_mm
    assert focused.sensor_distance_mm == pytest.approx(1 / (1 / focal - 1 / apparent), abs=1e-9)


def test_first_order_figures_hold_for_a_medium_before_the_lens(tmp_path):
    """Real rays near the axis, from the middle of the stop and from the sensor, through a lens, a port and water."""
    file = stage(tmp_path, "port", window(-PORT_MM), camera="", dataset=WATER)
    camera = open_dataset(file).cameras[0].asked
    lens, figures, image_mm, slope = camera.prescription, first_order(camera.prescription), -131.81, 1e-6
    before_stop = unbounded(towards_scene(lens))[len(lens.surfaces) - lens.stop_index - 1 :]
    cases = ((before_stop, 0.0), (unbounded(towards_scene(lens)), image_mm))
    met = []
    for rows, z_mm in cases:
        place, way, _ = traced(rows, np.array([[0.0, 0.0, z_mm]]), np.array([[slope, 0.0, np.sqrt(1 - slope**2)]]))
        met.append((place[0, 2] - place[0, 0] * way[0, 2] / way[0, 0], slope * way[0, 2] / way[0, 0]))
    assert figures.entrance_pupil.z_mm == pytest.approx(met[0][0], abs=1e-6)
    assert figures.object_mm(image_mm) == pytest.approx(met[1][0], abs=1e-5)
    # Lagrange's invariant: n y u stays, so that the magnification is n times the ratio of slopes.
    assert figures.magnification(met[1][0]) == pytest.approx(_MEDIUM / met[1][1], rel=1e-7)


def test_the_plane_of_focus_of_a_tilted_sensor_is_turned_less_in_a_medium(tmp_path):
    """Points of the sensor near the axis, and of the scene where their images are, turn by the same ratio of steps."""
    file = stage(tmp_path, "port", window(-PORT_MM), camera="", dataset=WATER)
    camera = focused(open_dataset(file).cameras[0].asked)
    camera = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, tilt_deg=(0.0, 5.0)))
    lens, image_mm, step = first_order(camera.prescription), -camera.sensor_distance_mm, 1e-4
    height = step / np.tan(np.radians(5.0)) / lens.magnification(lens.object_mm(image_mm))
    turned = np.degrees(np.arctan((lens.object_mm(image_mm + step) - lens.object_mm(image_mm)) / height))
    assert abs(report(camera)["lens"]["focus_plane_tilt_deg"][1]) == pytest.approx(abs(turned), rel=1e-4)


def test_fluids_have_their_published_indices():
    """Water: CRC Handbook, at 20 °C and sodium's D. Air: NIST's calculator, dry, 20 °C, 101.325 kPa, 633 nm."""
    water, vacuum = (medium(glass=name, index=None, abbe=None, wavelength_nm=587.56) for name in ("water", "vacuum"))
    assert water.index(589.3) == pytest.approx(1.33299, abs=2e-5)
    assert 1 / vacuum.index(632.99) == pytest.approx(1.000271800, abs=2e-8)


def test_cameras_say_what_they_look_into(tmp_path, common_store):
    """Under water the field of view shrinks by the index, and a pinhole leaves a residual."""
    told = []
    for name, pane, dataset in (("port", window(-PORT_MM), WATER), ("plain", "", "")):
        file = stage(tmp_path, name, pane, dataset=dataset)
        out = made(file, tmp_path / name, common_store, targets=["cameras/Rig.Camera/camera.json"]).out
        told.append(json.loads((out / "cameras/Rig.Camera/camera.json").read_text()))
    assert told[0]["principal_distance_px"] == pytest.approx(_MEDIUM * told[1]["principal_distance_px"], rel=1e-9)
    assert told[0]["lens"]["index_in_front"] == _MEDIUM and "index_in_front" not in told[1]["lens"]
    assert told[0]["pinhole"]["residual_px"]["max"] > 1e-3 > 1e-6 > told[1]["pinhole"]["residual_px"]["max"]


def test_show_says_of_windows_what_a_build_does(tmp_path, common_store):
    """A rolled dome off the axis: its centres are one point, and the pupil behind it is that of the camera alone."""
    dome = window(-60.0, radii_mm=(60.0, 50.0), turn="(9, -7, 30)").replace("(0, 0, -60.0)", "(3, 4, -60)")
    (plain,) = show(stage(tmp_path, "plain", camera=""))
    for fixed in (True, False):
        file = stage(tmp_path, f"fixed_{fixed}", dome, camera=_PLANES, fixed=fixed, dataset=WATER)
        (shown,) = show(file)
        out = made(file, file.with_suffix(""), common_store, targets=["cameras/Rig.Camera/camera.json"]).out
        assert json.loads((out / "cameras/Rig.Camera/camera.json").read_text())["lens"] == shown.document["lens"]
    lens, (pane,) = plain.document["lens"], shown.document["lens"]["windows"]
    assert shown.document["lens"]["pupil_behind_windows_mm"] == lens["entrance_pupil"]["z_mm"]
    outer, inner = pane["surfaces"]
    assert pane["name"] == "Pane" and outer["vertex_mm"] == [3.0, -4.0, 60.0]  # vision has y down
    assert [outer["index_behind"], inner["index_behind"]] == [_GLASS, 1.0]
    centres = [np.array(face["vertex_mm"]) - face["radius_mm"] * np.array(face["axis"]) for face in (outer, inner)]
    assert np.abs(centres[1] - centres[0]).max() < 1e-12 and "(3.000, -4.000, 60.000) mm" in "".join(shown.page())


def test_exports_that_a_stage_asks_for_see_through_windows_of_the_world(tmp_path, common_store):
    pane, rays = window(-200.0, turn="(25, -20, 10)"), []
    asked = f'uniform token[] plen:exports = ["rays"]\n{WATER}'
    for name, fixed in (("below", True), ("world", False)):
        file = stage(tmp_path, name, pane, fixed=fixed, dataset=asked)
        file.write_text(
            file.read_text().replace("plen:pixelPitch = 0.05", "plen:pixelPitch = 2\nint2 plen:resolution = (16, 12)")
        )
        out = made(file, tmp_path / name, common_store, targets=["exports/rays/Rig.Camera.rays.npz"]).out
        rays.append(np.load(out / "exports/rays/Rig.Camera.rays.npz"))
    assert np.abs(rays[0]["direction"] - rays[1]["direction"]).max() < 1e-9


def test_light_of_a_medium_fills_a_wider_cone(tmp_path):
    """The stop fills one cone at the sensor, with and without port and water: etendue carries 1/n^2 of the radiance."""
    light = Radiance(w_per_m2_sr=2.0, effective_nm=550.0)
    port = stage(tmp_path, "port", window(-PORT_MM), camera="", dataset=WATER)
    wet, dry = (open_dataset(file).cameras[0].camera for file in (port, stage(tmp_path, "plain", camera="")))
    assert wet.sensor_distance_mm == dry.sensor_distance_mm
    assert photon_rate(wet, light) == pytest.approx(photon_rate(dry, light) / _MEDIUM**2, rel=1e-7)
