"""The data of the report: the very numbers of the files, laws of ideal lenses, and nothing made twice."""

import hashlib
import json
import math
import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest
from builds import cells, tiny
from places import ROOT

from pipeline.errors import UsageError
from pipeline.files.png import read_png, write_png
from pipeline.plugins.report.optics import field_curvature, transfer
from pipeline.plugins.report.parts import picture_of
from pipeline.plugins.report.report import Report
from pipeline.results.records import BuiltFolder
from pipeline.results.spots import field_bundles, spots
from pipeline.scene.load import open_dataset

WEB = ROOT / "web"
ASSETS = ROOT / "pipeline/plugins/report/assets"


@pytest.fixture(scope="module")
def built(tmp_path_factory, common_store):
    out = tiny("plenoptic", tmp_path_factory.mktemp("built"), common_store)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(common_store))
        return out, Report().write(out, warn=pytest.fail).parent


def data(place: Path, name: str):
    """What a script hands to the page."""
    found = re.fullmatch(r"plenopticReport\((\".*?\"),(.*)\);\n", (place / f"data/{name}.js").read_text(), re.DOTALL)
    assert json.loads(found[1]) == name
    return json.loads(found[2])


def test_rows_are_those_of_the_table_to_the_last_digit(built):
    out, place = built
    stated = cells(out / "frames/0001/Rig.Camera/correspondences.csv")
    table = data(place, "rows.Rig.Camera.0001")
    assert table["rows"] == len(stated) > 20
    assert set(table["same"]) | set(table["columns"]) == set(stated[0])
    for name in stated[0]:
        column = table["columns"].get(name, [table["same"].get(name)] * len(stated))
        texts = ["" if cell is None else cell if isinstance(cell, str) else repr(cell) for cell in column]
        assert texts == [row[name] for row in stated], name


def test_the_page_counts_what_the_manifest_counts(built):
    out, place = built
    manifest, page = json.loads((out / "manifest.json").read_text()), data(place, "page")
    (camera,) = page["cameras"]
    assert camera["certificate"] == manifest["certificate"]["Rig.Camera"]
    assert [view["rows"] for view in camera["views"]] == [
        row["rows"] for row in manifest["points"]["Rig.Camera"]["frames"]
    ]
    assert page["files"] == len(manifest["files"])
    history = data(place, page["history"].removeprefix("data/").removesuffix(".js"))
    assert sorted(task["name"] for task in history["tasks"]) == sorted(manifest["tasks"])
    assert all(task["cpu_s"] >= 0 for task in history["tasks"])


def test_the_histogram_of_the_certificate_counts_all_rows_that_it_solved_again(built):
    out, place = built
    judged = json.loads((out / "manifest.json").read_text())["certificate"]["Rig.Camera"]
    apart = np.array(judged["differences_px"])
    assert len(apart) == judged["rows"] > 10 and (np.diff(apart) >= 0).all()
    assert [apart.mean(), math.sqrt((apart**2).mean()), apart.max()] == pytest.approx(
        [judged["mean_px"], judged["rms_px"], judged["max_px"]], rel=1e-3
    )
    shown = data(place, "page")["cameras"][0]["residuals"]["histograms"][0]
    assert "certificate" in shown["title"] and shown["mark"] == judged["claim_px"]
    assert sum(shown["counts"]) == np.count_nonzero(apart)
    assert shown["edges"][0] == pytest.approx(apart[apart > 0].min()) and shown["edges"][-1] == pytest.approx(
        apart.max()
    )


def test_a_second_report_makes_nothing_again_and_another_build_leaves_nothing_behind(built):
    out, place = built
    before = {path: path.stat().st_mtime_ns for path in place.rglob("*") if path.is_file()}
    (place / "images/0123456789abcdef.png").write_bytes(b"of an earlier build")
    (place / "data/rows.Gone.0001.js").write_text("")
    Report().write(out, warn=pytest.fail)
    after = {path: path.stat().st_mtime_ns for path in place.rglob("*") if path.is_file()}
    assert {path.name for path in before if before[path] != after.get(path)} <= {"made_of"}
    assert after.keys() == before.keys()


def test_what_inform_said_stays_in_the_report_as_long_as_the_build_is_the_same(built, tmp_path):
    shutil.copytree(built[0], tmp_path / "out")
    out, place = tmp_path / "out", tmp_path / "out.report"

    def shown() -> str | None:
        return data(place, "page")["cameras"][0]["told"].get("Information")

    Report().write(out)
    assert shown() is None
    informed = Report()
    informed.tell("Information", "Rig.Camera", ["rank 9"], "<svg/>")
    informed.write(out)
    Report().write(out)
    assert data(place, shown().removeprefix("data/").removesuffix(".js")) == {"lines": ["rank 9"], "drawing": "<svg/>"}
    with (out / "manifest.json").open("a") as manifest:
        manifest.write("\n")
    Report().write(out)
    assert shown() is None and not list(place.glob("data/information*"))


def test_a_report_is_not_written_over_other_files_and_fails_no_build(built, tmp_path):
    out, _ = built
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/index.html").write_text("my page")
    with pytest.raises(UsageError, match="no report of ours"):
        Report().write(out, tmp_path / "mine")
    shutil.copytree(out, tmp_path / "out")
    (tmp_path / "out.report").mkdir()
    (tmp_path / "out.report/notes.txt").write_text("mine")
    said: list[str] = []
    assert Report().write_after_build(tmp_path / "out", warn=said.append) is None
    assert len(said) == 1 and "no report was written" in said[0]
    assert (tmp_path / "mine/index.html").read_text() == "my page"


def test_the_finest_tiles_are_the_image_and_coarser_ones_its_means(tmp_path):
    """2,100 x 1,100 px of one grey: three levels; halves are the means of 2 x 2 pixels."""
    grey = np.random.default_rng(3).integers(0, 256, (1100, 2100), dtype=np.uint8)
    (tmp_path / "images").mkdir()
    write_png(tmp_path / "image.png", np.repeat(grey[..., None], 3, axis=2))
    folder = BuiltFolder(path=tmp_path, stage="", digests={"image.png": "ab" * 32})
    shown = picture_of(folder, "image.png", "image", tmp_path)
    assert (shown.width_px, shown.height_px, shown.levels, shown.tile_px) == (2100, 1100, 4, 512)

    def level(number: int) -> np.ndarray:
        place = tmp_path / shown.path / str(number)
        across, down = (max(int(path.stem.split("_")[axis]) for path in place.glob("*.png")) + 1 for axis in (0, 1))
        return np.vstack([np.hstack([read_png(place / f"{x}_{y}.png") for x in range(across)]) for y in range(down)])

    assert (level(3) == grey).all()
    blocks = grey.reshape(550, 2, 1050, 2).mean(axis=(1, 3))
    assert level(2).shape == (550, 1050) and np.abs(level(2) - blocks).max() <= 0.5
    assert level(0).shape == (138, 263)


def test_spots_of_an_ideal_lens_are_discs_as_wide_as_similar_triangles_say(ideal):
    """In the scene a disc of radius R |z - z_f| / z_f, in the image that times B / (z pitch)."""
    bundles = field_bundles(ideal)
    near, focus, far = (one for one in spots(ideal, bundles) if one.place == "centre")
    assert focus.distance_mm == pytest.approx(500) and focus.rms_px < 1e-6
    for one in (near, far):
        z = one.distance_mm
        radius_px = 5.0 * abs(z - 500) / 500 * ideal.sensor_distance_mm / z / 0.01
        assert one.rms_px == pytest.approx(radius_px / math.sqrt(2), rel=0.01)
        assert max(map(math.hypot, one.dx_px, one.dy_px)) == pytest.approx(radius_px, rel=0.02)
    assert all(line.y == (1.0,) * 26 for line in transfer(ideal, bundles).lines)


def test_spots_end_where_planes_across_the_axis_say_nothing():
    """A fisheye of 220 degrees: half of the way to the corner is 78 degrees off its axis, and 0.75 of it is dark."""
    camera = open_dataset(ROOT / "examples/10_fisheye/dataset.usda").cameras[0].camera
    steepest = [bundle.bundle.direction[:, 2].min(initial=1.0) for bundle in field_bundles(camera)]
    assert len(steepest) < 4 and min(steepest) > math.cos(math.radians(81))


def test_an_ideal_lens_has_no_field_curvature(ideal):
    tangential, sagittal = field_curvature(ideal).lines
    np.testing.assert_allclose(tangential.y, 500, rtol=1e-3)
    np.testing.assert_allclose(sagittal.y, 500, rtol=1e-3)


def test_the_bundle_is_that_of_the_sources():
    """`make web` bundles them; its first line has their digest, so that this needs no npm."""
    names = [f"src/{path.name}" for path in (WEB / "src").iterdir()]
    digest = hashlib.sha256()
    for name in sorted([*names, "package.json", "package-lock.json", "build.mjs"]):
        digest.update(name.encode() + b"\0" + (WEB / name).read_bytes() + b"\0")
    for asset in ("report.js", "report.css"):
        head = (ASSETS / asset).read_bytes()[:200].decode()
        assert f"sources {digest.hexdigest()};" in head, "run `make web`"
    assert sum(path.stat().st_size for path in ASSETS.iterdir()) < 1.2e6
    assert '"resolved"' not in (WEB / "package-lock.json").read_text()  # names a registry


def test_the_scripts_know_the_records_of_python():
    written = runpy.run_path(str(WEB / "record_types.py"))["text"]()
    assert (WEB / "src/records.ts").read_text() == written, "run python web/record_types.py"


def test_a_build_writes_the_report_unless_refused(tmp_path, monkeypatch, common_store, in_this_process):
    """`--no-report`, PIPELINE_REPORT=no, and parts of a build: no report."""
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    monkeypatch.setenv("PIPELINE_REPORT", "")
    monkeypatch.chdir(tmp_path)
    stage = str(ROOT / "tests/data/tiny_plenoptic/dataset.usda")
    page = tmp_path / "out.report/index.html"

    def build(*options: str) -> str:
        code, _, log = in_this_process("build", stage, "-o", "out", "-j", "1", *options)
        assert code == 0
        return log

    build("--no-report")
    build("frames/0001/Rig.Camera/image.png")
    monkeypatch.setenv("PIPELINE_REPORT", "no")
    build()
    assert not page.exists()
    monkeypatch.setenv("PIPELINE_REPORT", "")
    assert f"report: {page}" in build()
    first = (tmp_path / "out.report/data/history.js").read_text()
    assert "made before" in first  # nothing ran
    assert f"report: {page}" in build("--force", "image/Rig.Camera/0001")
    runs = {run["name"]: run for run in data(page.parent, "history")["tasks"]}
    assert runs["image/Rig.Camera/0001"]["state"] == "executed"
    assert runs["image/Rig.Camera/0001"]["end_s"] > runs["image/Rig.Camera/0001"]["start_s"] >= 0
    assert runs["camera/Rig.Camera"]["state"] == "cached"
