"""Cameras of other programs become rigs that do what their files say, and name what they cannot keep."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from laws import rigs
from plugins.lenses import lens_writers as write
from plugins.lenses import on_the_spot
from scipy.spatial import cKDTree

from pipeline.app.stages import import_camera, write_stage
from pipeline.camera.figures.first_order_figures import report
from pipeline.camera.parts.lattice import lattice
from pipeline.errors import UsageError
from pipeline.plugins.lenses.read import read_camera_file
from pipeline.scene.load import load

refused = partial(on_the_spot.refused, read_camera_file)
BLENDER = """objective_file_name;table
prop_objective_scale;1.0
prop_aperture_blades;6
prop_aperture_size;10.0
prop_aperture_angle;30.0
prop_sensor_width;10.0
prop_sensor_height;8.0
prop_pixel_size;0.009999999776482582
prop_wavelength;587.5999755859375
prop_focus_distance;43.0
prop_sensor_mainlens_distance;125.0
prop_mla_enabled;True
prop_mla_type;HEX
prop_microlens_diam;217.3000030517578
prop_mla_sensor_dist;1.7000000476837158
prop_three_ml_types;True
prop_ml_type_1_f;1.899999976158142
prop_ml_type_2_f;2.0999999046325684
prop_ml_type_3_f;2.299999952316284
"""
UPRIGHT = [["1", "0", "0"], ["0", "1", "0"], ["0", "0", "1"]]


def libpleno(columns: int = 11, rows: int = 10, **changes) -> dict:
    """A small camera whose array is centred on the axis, as libpleno writes it: numbers are strings."""
    pitch, sensor_mm = 0.2, (0.01 * 239, 0.01 * 179)
    x, y = pitch * (columns - 0.5) / 2, pitch * (rows - 1) * 3**0.5 / 4
    mesh = {"geometry": "1", "width": str(columns), "height": str(rows), "pitch": [[str(pitch), str(pitch)]]}
    place = {"rotation": UPRIGHT, "translation": [[repr(-x), repr(-y), "-56.0"]]}
    at = {"rotation": UPRIGHT, "translation": [[repr(-sensor_mm[0] / 2), repr(-sensor_mm[1] / 2), "-57.0"]]}
    file = {
        "I": "3",
        "main_lens": {"f": "50", "aperture": "4"},
        "sensor": {"width": "240", "height": "180", "scale": "0.01", "pose": at},
        "mla": {"focal_lengths": ["1.1", "1.2", "1.3"], "mesh": {**mesh, "pose": place}},
        "distortions": {"radial": [["0", "0", "0"]]},
    }
    return {**file, **changes}


def imported(folder: Path, name: str, text: str):
    """The camera of a file, by way of a stage that passes the checks."""
    (folder / name).write_text(text, encoding="utf-8")
    out = folder / "rig.usda"
    assert not any(problem.is_error for problem in write_stage(import_camera(folder / name).text, out))
    (entry,) = load(out).cameras
    return entry.camera


def blender_folder(folder: Path) -> Path:
    (folder / "table.csv").write_bytes(write.blender(rigs.tronnier()))
    return folder


def test_a_camera_of_the_add_on_is_the_rig_that_it_describes(tmp_path):
    """The rig of Michels et al. 2019 with a stop of 10 mm: in focus at 362.70, 459.65 and 429.52 mm, printed n_d."""
    camera = imported(blender_folder(tmp_path), "mine.csv", BLENDER)
    stop, array = camera.prescription.stop, camera.microlenses
    assert (stop.semi_diameter_mm, stop.blades, stop.aperture_rotation_deg) == (5.0, 6, 30.0)
    assert (camera.sensor.width_px, camera.sensor.height_px, camera.sensor.pitch_mm) == (1000, 800, 0.01)
    assert array.pitch_mm == pytest.approx(0.2173, rel=1e-15)
    assert (array.distance_mm, array.focal_lengths_mm) == (1.7, (1.9, 2.3, 2.1))
    found = [kind["focus_distance_mm"] for kind in report(camera)["mla"]["types"]]
    assert found == pytest.approx([362.704, 459.652, 429.52], rel=0, abs=0.5001e-3)


def test_the_aperture_of_the_add_on_is_clipped_by_the_stop_and_the_lens_is_scaled(tmp_path):
    text = BLENDER.replace("aperture_size;10.0", "aperture_size;100.0").replace("scale;1.0", "scale;0.5")
    lens = imported(blender_folder(tmp_path), "mine.csv", text).prescription
    assert lens.stop.semi_diameter_mm == 17.1 / 2
    assert lens.surfaces[0].radius_mm == 58.95 / 2 and lens.surfaces[0].thickness_mm == 7.52 / 2


def test_what_the_add_on_says_beyond_that_is_named(tmp_path):
    text = BLENDER.replace("587.59", "500.0") + "prop_new;1\n"
    (blender_folder(tmp_path) / "mine.csv").write_text(text)
    lost = {one.statement.split(" = ")[0]: one.line for one in read_camera_file(tmp_path / "mine.csv").lost}
    assert (lost["prop_focus_distance"], lost["prop_wavelength"], lost["prop_new is not read"]) == (10, 9, 20)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("objective_file_name;table", "objective_file_name;other", 'mine.csv:1: its lens "other" is not here'),
        ("prop_mla_enabled;True", "prop_mla_enabled", 'mine.csv:12: a row must be key;value, not "prop_mla_enabled"'),
    ],
)
def test_cameras_of_the_add_on_are_refused_with_file_and_line(old, new, said, tmp_path):
    assert refused(blender_folder(tmp_path), "mine.csv", BLENDER.replace(old, new)).startswith(said)


def test_a_camera_of_libpleno_is_a_thin_lens_camera(tmp_path):
    camera = imported(tmp_path, "intrinsics.js", json.dumps(libpleno()))
    figures, array = report(camera), camera.microlenses
    assert (figures["lens"]["efl_mm"], figures["lens"]["f_number"]) == pytest.approx((50.0, 4.0), rel=1e-14)
    assert (camera.sensor_distance_mm, array.distance_mm, array.pitch_mm) == (57.0, 1.0, 0.2)
    assert figures["optical_axis_px"] == pytest.approx([119.5, 89.5], rel=0, abs=1e-9)
    # Image at 56 + f / (f - 1) mm, object by the thin-lens equation.
    for kind in figures["mla"]["types"]:
        focal = kind["focal_length_mm"]
        image = 56 + focal / (focal - 1)
        assert kind["focus_distance_mm"] == pytest.approx(1 / (1 / 50 - 1 / image), rel=1e-12)


def theirs(geometry: int, k: int, l: int, x_mm: float, y_mm: float) -> tuple[float, float]:
    """Node of GridMesh of libpleno 48db282: even rows shifted to the right, odd columns up, by half a pitch."""
    sin_60 = 3**0.5 / 2
    x = (k + 0.5 * (geometry == 1 and l % 2 == 0)) * (sin_60 if geometry == 2 else 1)
    y = (l - 0.5 * (geometry == 2 and k % 2 == 1)) * (sin_60 if geometry == 1 else 1)
    return x * x_mm, y * y_mm


@pytest.mark.parametrize(
    ("geometry", "count"),
    [
        (0, (11, 10)),
        (0, (10, 9)),
        (1, (11, 10)),
        (1, (12, 12)),
        (1, (12, 10)),
        (2, (10, 9)),
        (2, (12, 12)),
        (2, (10, 12)),
    ],
)
def test_the_microlenses_of_libpleno_stand_where_its_own_model_has_them(geometry, count, tmp_path):
    """Nodes turned and moved by its pose, seen turned by 180 degrees; types by micro-image. 2-D and in depth."""
    (columns, rows), file = count, libpleno(*count)
    mesh = file["mla"]["mesh"]
    mesh["geometry"], mesh["pitch"] = str(geometry), [["0.2", "0.201"]]
    turn = cv2.Rodrigues(np.array([0.004, -0.003, 0.002]))[0]
    mesh["pose"]["rotation"] = [[repr(float(value)) for value in column] for column in turn.T]
    camera = imported(tmp_path, "intrinsics.js", json.dumps(file))
    array, found = camera.microlenses, lattice(camera.microlenses)
    origin = np.array([float(value) for value in mesh["pose"]["translation"][0]])
    nodes, focal = [], []
    for l in range(rows):
        for k in range(columns):
            nodes.append(turn @ [*theirs(geometry, k, l, 0.2, 0.201), 0] + origin)
            k_seen, l_seen = columns - 1 - k, rows - 1 - l
            line, place = (l_seen, k_seen) if geometry == 1 else (k_seen, l_seen)
            focal.append((1.1, 1.2, 1.3)[(line % 2 + place) % 3])
    ours = np.stack([-found.x_mm, -found.y_mm, array.distance_mm + found.z_mm - 57], axis=1)
    apart, node = cKDTree(nodes).query(ours)
    same = apart < 1e-12
    lost = any("every other" in one.statement for one in read_camera_file(tmp_path / "intrinsics.js").lost)
    assert len(ours) == columns * rows
    missing = np.count_nonzero(~same)
    assert missing <= (max(count) + 1) // 2 and (missing > 0) == lost
    assert np.array_equal(np.array(array.focal_lengths_mm)[found.type][same], np.array(focal)[node[same]])


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ({"main_lens": {}, "sensor": {}}, "a.js: holds start values without a microlens array"),
        ({"poses": []}, "a.js: is no camera of libpleno"),
        (libpleno(main_lens={"f": "nan", "aperture": "4"}), "a.js: lacks something or has no number there: nan is not"),
        (libpleno(mla={"focal_lengths": [], "mesh": libpleno()["mla"]["mesh"]}), "a.js: its array has 0 types"),
        (libpleno(mla={"mesh": {"geometry": "3"}}), "a.js: its microlenses have the geometry 3, and not 0, 1 or 2"),
    ],
)
def test_cameras_of_libpleno_that_cannot_be_represented_are_refused(file, said, tmp_path):
    assert refused(tmp_path, "a.js", json.dumps(file)).startswith(said)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.js", json.dumps(libpleno(sensor=libpleno()["sensor"] | {"width": "3000000000"})), "pixels in a row"),
        ("a.csv", BLENDER.replace("blades;6", "blades;3000000000"), "blades"),
    ],
)
def test_a_camera_with_more_of_a_thing_than_a_stage_can_count_is_refused(name, text, said, tmp_path):
    (blender_folder(tmp_path) / name).write_text(text)
    with pytest.raises(UsageError, match=f"3000000000 {said} are more than a stage can hold"):
        import_camera(tmp_path / name)


def test_other_files_are_refused(tmp_path):
    assert refused(tmp_path, "a.js", "{").startswith("a.js:1: is no JSON")
    assert refused(tmp_path, "a.js", "[" * 100_000).startswith("a.js: is JSON nested too deeply")
    with pytest.raises(UsageError, match=r'has the reader "camera.zmx"\n.*camera.csv, camera.js'):
        import_camera(tmp_path / "a.zmx")
    assert "--lens is for" in refused(tmp_path, "a.js", "{}", lens=tmp_path / "table.csv")
    assert refused(tmp_path, "none.csv", "radius;thickness\n").startswith("none.csv: ")


def test_tilt_and_pitches_are_kept_and_distortion_is_named(tmp_path):
    file = libpleno(distortions={"radial": [["1e-4"]]}, scaling={})
    file["mla"]["mesh"]["pitch"] = [["0.2", "0.2001"]]
    file["mla"]["mesh"]["pose"]["rotation"] = [["1", "0", "1e-3"], ["0", "1", "0"], ["-1e-3", "0", "1"]]
    (tmp_path / "a.js").write_text(json.dumps(file))
    camera = read_camera_file(tmp_path / "a.js")
    array, said = camera.microlenses, " ".join(one.statement for one in camera.lost)
    assert (array.pitches_mm, array.columns, array.rows) == ((0.2, 0.2001), 11, 10)
    # Lenses at their +x, our -x, are nearer to the scene: a positive tilt about y.
    assert (array.tilt_x_deg, array.tilt_y_deg) == pytest.approx((0, np.degrees(1e-3)), rel=1e-6)
    assert "distortion coefficients" in said and "depth scaling" in said


def test_square_microlenses_of_the_add_on_are_kept(tmp_path):
    text = BLENDER.replace("prop_mla_type;HEX", "prop_mla_type;RECT")
    array = imported(blender_folder(tmp_path), "mine.csv", text).microlenses
    assert (array.layout, array.focal_lengths_mm, array.width_mm, array.height_mm) == ("square", (1.9,), 10.0, 8.0)
