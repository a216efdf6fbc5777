"""Claim: `pipeline verify` believes a build and disbelieves a tampered one, from the output folder alone."""

import hashlib
import json
import re
import shutil

import pytest
import typer
from builds import made
from stage_text import edited, stage_in, tiny_text, without_method

from pipeline import cli
from pipeline.app.pages.ending import certificate_lines, failed, point_lines
from pipeline.app.verify import verify
from pipeline.errors import Exit, UsageError
from pipeline.files.exr import read_exr

TABLE = "frames/0001/Rig.Camera/correspondences.csv"


def test_a_build_agrees_without_store_and_stage(conventional_build, tmp_path, monkeypatch):
    """Moved elsewhere, the store gone."""
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "nothing"))
    moved = tmp_path / "moved"
    shutil.copytree(conventional_build, moved)
    verdict = verify(moved, seed=4)
    assert verdict.agrees and verdict.problems == []
    assert verdict.cameras["Rig.Camera"]["rows"] == 12
    assert "passed" in "\n".join(certificate_lines(verdict.cameras)) and not failed(verdict.cameras)
    json.dumps(verdict.to_dict())


def test_a_build_whose_truth_came_in_tiles_agrees(tmp_path, common_store):
    """More points than one tile solves."""
    many = ("columns = 3", "columns = 30"), ("rows = 2", "rows = 17"), ("Size = 1.4", "Size = 0.13")
    stage = stage_in(tmp_path, without_method(tiny_text("conventional", *many)))
    assert "truth_tile" in {task.kind for task in made(stage, tmp_path / "out", common_store).tasks}
    verdict = verify(tmp_path / "out", seed=4)
    assert verdict.agrees and verdict.problems == []
    assert verdict.cameras["Rig.Camera"]["rows"] > 0


def test_a_build_without_pictures_agrees(conventional_build, tmp_path, common_store):
    """Members of ensembles have none."""
    stage = shutil.copy(conventional_build / "dataset.usda", tmp_path / "stage.usda")
    made(stage, tmp_path / "out", common_store, pictures=False)
    assert not list((tmp_path / "out").rglob("*.exr"))
    assert verify(tmp_path / "out", seed=4).agrees
    manifest = json.loads((tmp_path / "out/manifest.json").read_text(encoding="utf-8"))
    del manifest["pictures"]  # as if somebody had lost them, and their entries
    (tmp_path / "out/manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    assert any("image.exr" in problem for problem in verify(tmp_path / "out", seed=4).problems)


def sign(out, name):
    """Write size and digest of a file, as it is now, into the manifest."""
    data, path = (out / name).read_bytes(), out / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    manifest["files"][name] = {"sha256": hashlib.sha256(data).hexdigest(), "size": len(data)}
    path.write_text(json.dumps(manifest), encoding="utf-8")


def change_cells(path, column, change):
    """Change a column of a table, in all rows."""
    text = path.read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(text) if line.startswith("frame,"))
    number = text[start].split(",").index(column)
    for i in range(start + 1, len(text)):
        cells = text[i].split(",")
        cells[number] = change(cells[number])
        text[i] = ",".join(cells)
    path.write_text("\n".join([*text, ""]), encoding="utf-8")


def stage_of(folder, *lines, text=None):
    """The tiny stage in a folder of its own, with further lines about its camera."""
    head = '        over "Camera"\n        {\n'
    text = edited(text or tiny_text("conventional"), (head, head + "".join(f"{line}\n" for line in lines)))
    return stage_in(folder, text)


@pytest.fixture
def out(conventional_build, tmp_path):
    return shutil.copytree(conventional_build, tmp_path / "copy")


def test_rows_moved_by_a_hundredth_of_a_pixel_disagree_though_every_digest_fits(out):
    """The certificate alone tells them."""
    change_cells(out / TABLE, "x_px", lambda cell: repr(float(cell) + 0.01))
    sign(out, TABLE)
    verdict = verify(out)
    assert verdict.problems == [] and not verdict.agrees
    certificate = verdict.cameras["Rig.Camera"]
    assert certificate["passed"] is False
    assert certificate["max_px"] == pytest.approx(0.01, abs=1e-3)
    with pytest.raises(typer.Exit) as ended:
        cli.verify(out, 1, False)
    assert ended.value.exit_code == Exit.NOT_CONFIRMED


def test_files_that_are_altered_lost_or_new_are_named(out):
    flipped = bytearray((out / TABLE).read_bytes())
    flipped[-2] ^= 1
    (out / TABLE).write_bytes(flipped)
    (out / "frames/0002/Rig.Camera/image.png").unlink()
    (out / "cameras/Rig.Camera/camera.json").write_text("{}")
    (out / "notes.txt").write_text("mine")
    extra, size, flip, lost = verify(out).problems
    assert extra == "notes.txt is not in the manifest"
    assert size.startswith("cameras/Rig.Camera/camera.json is not as it was built: 2 bytes, not ")
    assert flip == f"{TABLE} is not as it was built: its bytes differ"
    assert lost == "frames/0002/Rig.Camera/image.png is lost"


@pytest.mark.parametrize(
    "broken",
    [
        lambda text: text[:-200],
        lambda text: text.replace("x_px", "x_pixels"),
        lambda text: re.sub(r"(?m)^1,Rig.Camera,Board,.*?,", "1,Rig.Camera,Board,one,", text),
    ],
    ids=["cut", "another column", "no number"],
)
def test_a_table_that_cannot_be_read_is_said_though_its_digest_fits(broken, out):
    path = out / TABLE
    path.write_text(broken(path.read_text(encoding="utf-8")), encoding="utf-8")
    sign(out, TABLE)
    (problem,) = verify(out).problems
    assert problem.startswith("camera Rig.Camera cannot be judged by its tables: ")


def test_the_manifest_lists_the_files_of_a_build_of_the_stage(out):
    (out / "notes.txt").write_text("mine")
    sign(out, "notes.txt")
    listed = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    del listed["files"]["cameras/Rig.Camera/camera.json"]
    (out / "cameras/Rig.Camera/camera.json").unlink()
    (out / "manifest.json").write_text(json.dumps(listed), encoding="utf-8")
    assert verify(out).problems == [
        "the manifest lists no cameras/Rig.Camera/camera.json",
        "notes.txt is no file of a build of the stage",
    ]


def test_a_stage_that_does_not_belong_to_the_folder_disagrees(out):
    """Another pose, digests that fit: the tables are not those of this stage. And a stage that is none."""
    stage = out / "dataset.usda"
    text = stage.read_text(encoding="utf-8")
    stage.write_text(re.sub(r"(translate.*?\n\s*1: \(-?\d+)", r"\g<1>1", text, count=1), encoding="utf-8")
    assert stage.read_text(encoding="utf-8") != text
    sign(out, "dataset.usda")
    verdict = verify(out)
    assert not verdict.agrees and verdict.cameras["Rig.Camera"]["passed"] is False
    stage.write_text("#usda 1.0\n", encoding="utf-8")
    sign(out, "dataset.usda")
    (problem,) = verify(out).problems
    assert problem.startswith("dataset.usda is no stage that could have been built")


def test_a_method_without_a_claim_has_no_verdict_whatever_its_rows_are(tmp_path, common_store):
    """The naive search by two planes puts rows wherever a pixel is; what the certificate says can be printed."""
    lines_of = ('uniform token plen:truth:method = "two-plane"', 'uniform token plen:truth:search = "nearest"')
    text = without_method(tiny_text("conventional"))
    stage = stage_of(tmp_path, *lines_of, "uniform double plen:truth:nearestThreshold = 2", text=text)
    result = made(stage, tmp_path / "out", common_store)
    said = "\n".join(certificate_lines(result.certificate))
    assert "no verdict, the method makes no claim" in said and not failed(result.certificate)


METHODS = {method: f'uniform token plen:truth:method = "{method}"' for method in ("image", "two-plane", "direct")}
METHODS["direct"] += '\nuniform token[] plen:truth:columns = ["chief"]'


@pytest.mark.heavy
@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
@pytest.mark.parametrize("method", METHODS)
def test_builds_by_every_method_agree(method, kind, tmp_path, common_store):
    """Their tables have other columns and comments."""
    stage = stage_of(tmp_path, METHODS[method], text=without_method(tiny_text(kind)))
    made(stage, tmp_path / "out", common_store)
    verdict = verify(tmp_path / "out")
    assert verdict.agrees, verdict.problems


def test_a_folder_without_a_manifest_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"no finished build: it has no manifest\.json"):
        verify(tmp_path)
    (tmp_path / "manifest.json").write_text("[]")
    with pytest.raises(UsageError, match="none of a build, or damaged"):
        verify(tmp_path)


def test_weight_and_footprint_travel_into_every_file_and_the_judge_reads_them(tmp_path, common_store):
    """A build by area and with pixels: headers say so, its certificate passes, and `verify` agrees."""
    lines_of = ('uniform token plen:camera:weight = "area"', 'uniform token plen:truth:footprint = "pixel"')
    stage = stage_of(tmp_path, *lines_of)
    out = tmp_path / "out"
    result = made(stage, out, common_store)
    assert result.certificate["Rig.Camera"]["passed"] is True
    camera = json.loads((out / "cameras/Rig.Camera/camera.json").read_text(encoding="utf-8"))
    assert (camera["weight"], camera["footprint"]) == ("area", "pixel")
    table = (out / "frames/0001/Rig.Camera/correspondences.csv").read_text(encoding="utf-8")
    assert "# weight: area; " in table and "footprint: pixel" in table
    for name in ("cameras/Rig.Camera/rays.exr", "cameras/Rig.Camera/white.exr", "frames/0001/Rig.Camera/image.exr"):
        for part in read_exr(out / name).values():
            assert part.attributes["weight"] == "area"
            assert part.attributes.get("footprint", "pixel") == "pixel"
    white = read_exr(out / "cameras/Rig.Camera/white.exr")["white"].attributes
    assert float(white["W_ref_mm2"]) > 1 and "dA in the sampling plane" in white["content"]
    assert verify(out, seed=4).agrees


def test_a_build_that_sees_nothing_certifies_nothing(tmp_path, common_store):
    """The board shows its back in both frames: no frame is called seen, and nothing is called passed."""
    stage = tmp_path / "dataset.usda"
    text = tiny_text("conventional")
    for number, pose in ((1, "(0.9990482215818578, 0, 0, 0.043619387365336)"), (2, "(0.9762960071199334, 0, 0.2164")):
        text = re.sub(rf"{number}: {re.escape(pose)}[^\n]*", f"{number}: (0, 0, 1, 0),", text)
    stage.write_text(text, encoding="utf-8")
    result = made(stage, tmp_path / "out", common_store)
    frames = [{"frame": number, "rows": 0, "seen": {"Board": 0}} for number in (1, 2)]
    assert result.points == {"Rig.Camera": {"of": {"Board": 6}, "frames": frames}}
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["points"] == result.to_dict()["points"] == result.points
    assert point_lines(result.points)[-1].startswith("warning: Rig.Camera sees no point in any frame")
    for found in (result.certificate, verify(tmp_path / "out").cameras):
        assert found["Rig.Camera"]["passed"] is None and not failed(found)
        assert certificate_lines(found) == [
            "certificate of Rig.Camera: nothing to certify: the tables have no row (claim 0.001 px)"
        ]
