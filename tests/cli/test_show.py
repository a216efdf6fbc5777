"""`pipeline show`: the figures of a camera, as a table, as JSON, as a drawing."""

import dataclasses
import json
import math
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from places import ROOT, TINY_PLENOPTIC

import pipeline as package
from pipeline.camera.parts.camera import Camera
from pipeline.files.jsonfile import json_bytes
from pipeline.results.drawing import bundle
from pipeline.scene.load import load

PAPER = str(ROOT / "stages/rigs/plenoptic_michels_2019.usda")
LENS = str(ROOT / "stages/lenses/double_gauss_100mm_tronnier.usda")
SVG = "{http://www.w3.org/2000/svg}"


def test_the_papers_rig_shows_its_published_figures(run):
    """Michels, Petersen and Koch 2019, listed n_d: known independently of this code."""
    code, page, log = run("show", PAPER)
    assert (code, log) == (0, "")
    types = re.findall(r"^ +\d +([\d.]+) +([\d.]+) +([\d.]+) ", page, re.MULTILINE)
    assert types[:3] == [("1.9", "9.50", "362.7"), ("2.1", "5.25", "429.5"), ("2.3", "3.83", "459.7")]
    assert re.search(r"principal distance +121\.7", page)
    assert re.search(r"stop that would match +ø 10\.59 mm", page)
    assert re.search(r"micro-image pitch +0\.2202 mm.*1\.013226 MLA pitches", page)
    assert re.search(r"effective focal length +100\.716 mm", page)
    rows = [list(map(float, line.split())) for line in page.split("distortion [%]")[1].splitlines() if line]
    assert len(rows) == 11
    assert rows[0] == [0.0, 0.0, 1.0, 0.0], "on the axis light and distortion of real rays are exact"
    assert rows[-1][0] == 5.0 and 0.99 < rows[-1][2] < 1.0, "the corner of this small field is hardly darker"
    assert -0.1 < rows[-1][3] < 0.0


def test_json_is_what_a_build_writes_into_camera_json(run, tmp_path, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    package.build(TINY_PLENOPTIC, tmp_path / "out", jobs=1, until=["first_order/Rig.Camera"])
    code, text, _ = run("show", TINY_PLENOPTIC, "Rig.Camera", "--json")
    stored = [path.read_bytes() for path in (tmp_path / "store").rglob("*") if path.is_file()]
    figures = json.loads(text)
    curves = figures.pop("field_curves")
    assert code == 0 and json_bytes(figures) in stored
    assert len(curves["distortion"]) == len(curves["relative_illumination"]) == 11
    assert figures["mla"]["depth_of_field_gaps_mm"] == []
    assert len(figures["field_of_view_deg"]) == 3


def test_a_drawing_is_svg_with_rays_that_reach_the_sensor(run, tmp_path):
    code, page, log = run("show", PAPER, "--plot", "lens.svg")
    assert code == 0 and page and "lens.svg" in log
    root = ElementTree.parse(tmp_path / "lens.svg").getroot()
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    lines = root.findall("{http://www.w3.org/2000/svg}polyline")
    rays = [line for line in lines if line.get("stroke") in ("#c0392b", "#27803d", "#1f5fa8")]
    assert len(rays) == 21
    assert len(root.findall("{http://www.w3.org/2000/svg}svg")) == 1  # the microlenses, enlarged
    ends = {line.get("points").split()[-1].split(",")[0] for line in rays}
    assert len(ends) == 1
    words = {text.text for text in root.findall("{http://www.w3.org/2000/svg}text")}
    assert {"stop", "sensor", "MLA", "0 mm"} <= words


def test_a_lens_alone_shows_its_figures_its_curves_and_a_drawing(run, tmp_path):
    """Tronnier 100 mm: EFL 100.7163 and BFD 72.2118 mm, pupils 6.123 behind and 5.233 mm before the stop."""
    code, page, _ = run("show", LENS, "--plot", "lens.svg")
    assert code == 0 and page.startswith("Tronnier double Gauss 100 mm f/2, for objects at infinity")
    assert re.search(r"effective focal length +100\.716 mm", page)
    assert re.search(r"back focal distance +72\.212 mm", page)
    assert re.search(r"entrance pupil +-6\.123 mm", page) and re.search(r"exit pupil +5\.233 mm", page)
    rows = [list(map(float, line.split())) for line in page.split("distortion [%]")[1].splitlines() if line]
    assert len(rows) == 11 and rows[-1][0] == pytest.approx(0.2 * 100.716, rel=1e-4)
    words = [text.text for text in ElementTree.parse(tmp_path / "lens.svg").getroot().iter(f"{SVG}text")]
    assert "rear focus" in words and "sensor" not in words
    figures = json.loads(run("show", LENS, "--json")[1])
    assert figures["lens"]["efl_mm"] == pytest.approx(100.7163, rel=0, abs=0.5001e-4)
    assert len(figures["field_curves"]["angle_deg"]) == 11


def test_all_cameras_of_a_dataset_are_shown_unless_one_is_named(run, tmp_path):
    text = TINY_PLENOPTIC.read_text(encoding="utf-8")
    rig = text[text.index('    def "Rig"') : text.index("    def PlenCheckerboard")]
    both = text.replace(rig, rig + rig.replace('"Rig"', '"Left"'))
    (tmp_path / "two.usda").write_text(both.replace("</TinyPlenoptic/Rig/Camera>", "[</TinyPlenoptic/Rig/Camera>]"))
    code, page, _ = run("show", "two.usda")
    assert code == 0 and re.findall(r"^(\S+): Tronnier", page, re.M) == ["Rig.Camera", "Left.Camera"]
    assert run("show", "two.usda", "Left.Camera")[1] == page[page.index("Left.Camera") :]
    assert list(json.loads(run("show", "two.usda", "--json")[1])) == ["Rig.Camera", "Left.Camera"]
    code, _, log = run("show", "two.usda", "--plot", "lens.svg")
    assert code == 2 and "Rig.Camera, Left.Camera" in log and not (tmp_path / "lens.svg").exists()


LENSES = [
    pytest.param(path, marks=[pytest.mark.heavy] * (number % 10 > 0), id=path.stem)
    for number, path in enumerate(sorted((ROOT / "stages/lenses").glob("*.usda")))
]


@pytest.mark.parametrize("path", LENSES)
def test_every_lens_of_the_library_can_be_shown(run, path):
    code, page, log = run("show", str(path), "--plot", "lens.svg")
    assert (code, log) == (0, "wrote lens.svg\n") and "nan" not in page


@pytest.mark.parametrize("offset_mm", [-0.7, 0.9])
def test_the_drawing_shows_the_sensor_where_it_stands(offset_mm):
    """Rays meet its centre and its far edge, which the offset of the axis moves; aberrations are a few µm."""
    camera = load(ROOT / "stages/rigs/conventional_100mm.usda").cameras[0].camera
    assert isinstance(camera, Camera)
    moved = dataclasses.replace(camera, sensor=dataclasses.replace(camera.sensor, offset_y_mm=offset_mm))
    for field, height in ((0.0, -offset_mm), (1.0, -offset_mm + math.copysign(2.4, -offset_mm))):
        ends = [ray[-1] for ray in bundle(moved, field, -60.0)]
        assert len(ends) == 7
        assert all(x == camera.sensor_distance_mm and y == pytest.approx(height, rel=0, abs=0.01) for x, y in ends)


def test_a_rig_that_asks_for_focus_and_a_matched_stop_shows_what_solves_it(run, tmp_path):
    """The middle type in focus at 429.52 mm and the sensor at 125 mm are one camera; its match is 10.59 mm."""
    text = Path(PAPER).read_text(encoding="utf-8").replace("@../", "@")
    focus = "uniform double plen:camera:focusDistance = 429.5196"
    asked = f'{focus}\n        uniform token plen:camera:stopMatch = "microlenses"'
    (tmp_path / "rig.usda").write_text(text.replace("uniform double plen:camera:sensorDistance = 125", asked), "utf-8")
    code, page, log = run("show", "rig.usda")
    assert (code, log) == (0, "")
    assert "focus at 429.52 mm for microlens type 1" in page
    assert re.search(r"distance behind the stop +125\.000 mm", page)
    assert re.search(r"stop +ø 10\.586 mm", page)
    assert re.search(r"F-number, lens / microlens +1\.0000 +\(matched\)", page)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([PAPER, "Camra"], 'did you mean "Camera"'),
        ([PAPER, "--plot", "lens.pdf"], "is no .svg"),
        ([PAPER, "--at", "10", "10"], "--psf"),
        ([str(ROOT / "stages/sensors/michels_2019.usda")], "no-camera"),
        (["nowhere.usda"], "no such file"),
    ],
)
def test_what_cannot_be_shown_ends_with_2_and_a_word(run, arguments, message):
    code, page, log = run("show", *arguments)
    assert (code, page) == (2, "") and message in log and "Traceback" not in log


def test_images_of_points_are_printed_and_drawn(run, tmp_path):
    """The diffraction limit of the paper's microlenses: 0.61 wavelengths over their aperture, on the page and drawn."""
    code, page, log = run("show", PAPER, "--psf", "points.svg")
    assert code == 0 and "wrote points.svg" in log
    rows = re.findall(r"^microlens type (\d) .* ([\d.]+)  0\.54   0\.000  0\.00  1\.000 ", page, re.MULTILINE)
    assert rows == [("0", "5.35"), ("1", "5.35"), ("2", "5.35")]
    drawing = (tmp_path / "points.svg").read_text(encoding="utf-8")
    assert len(list(ElementTree.fromstring(drawing).iter(f"{SVG}image"))) == 3
    assert drawing.count("Airy radius 5.35") == 3


def test_a_picture_without_matplotlib_says_what_to_install(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    code, page, log = run("show", PAPER, "--psf", "points.svg")
    assert (code, page) == (2, "") and "plenoptic-pipeline[plot]" in log and not (tmp_path / "points.svg").exists()
