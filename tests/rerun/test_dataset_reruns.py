"""What an edit of a stage reruns: exactly the tasks that read what changed, counted by executions, never by clocks."""

import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from shorter import few
from stage_text import edited, stage_in, tiny_text, without_method
from typer.testing import CliRunner

import pipeline
from pipeline.app.verify import verify
from pipeline.cli import app
from pipeline.files.exr import read_exr

RAYS = {"rays_tile", "rays"}
TRUTH = {"truth", "certificate"}
"""Truth and what judges it."""


class Workshop:
    """A copy of a tiny dataset that can be edited and built again; `run` counts the executed tasks by kind."""

    def __init__(self, folder: Path, tiny: str) -> None:
        self.stage = stage_in(folder, tiny_text(tiny))
        self.out = folder / "out"
        self._known: set[str | None] = set()

    def edit(self, old: str, new: str) -> None:
        self.stage.write_text(edited(self.stage.read_text(encoding="utf-8"), (old, new)), encoding="utf-8")

    def add(self, line: str) -> None:
        """A property more of the camera."""
        self.edit(
            "            uniform int plen:truth:samples",
            f"            {line}\n            uniform int plen:truth:samples",
        )

    def use_method(self, method: str) -> None:
        self.stage.write_text(without_method(self.stage.read_text(encoding="utf-8")), encoding="utf-8")
        self.add(f'uniform token plen:truth:method = "{method}"')

    def run(self) -> Counter:
        return Counter(kind for _, kind in self._made())

    def ran_names(self) -> list[str]:
        return sorted(name for name, _ in self._made())

    def _made(self) -> list[tuple[str, str]]:
        """Tasks that ran, or whose results the common store has from another test and not from this workshop."""
        result = pipeline.build(self.stage, self.out, jobs=1)
        assert result.exit_code == 0, [task.error for task in result.failures]
        made = [task for task in result.tasks if task.state == "executed" or task.key not in self._known]
        self._known |= {task.key for task in result.tasks}
        return [(task.name, task.kind) for task in made]


@pytest.fixture
def conventional(tmp_path, common_store, monkeypatch):
    return _workshop(tmp_path, common_store, monkeypatch, "conventional")


@pytest.fixture
def plenoptic(tmp_path, common_store, monkeypatch):
    return _workshop(tmp_path, common_store, monkeypatch, "plenoptic")


def _workshop(tmp_path, common_store, monkeypatch, tiny):
    """A tiny dataset that is finished: every test edits from there."""
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    workshop = Workshop(tmp_path, tiny)
    workshop.run()
    return workshop


def _facts(folder: Path) -> dict[str, tuple[int, bytes]]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {path.relative_to(folder).as_posix(): (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


@pytest.mark.parametrize("name", few(["conventional"], "plenoptic"))
def test_a_second_build_executes_nothing_and_rewrites_no_file(name, request):
    workshop = request.getfixturevalue(name)
    before = _facts(workshop.out)
    assert workshop.run() == Counter()
    assert _facts(workshop.out) == before


def test_one_pose_sample_reruns_that_frame_and_undoing_it_reruns_nothing(conventional):
    conventional.edit("2: (0.3, -0.2, -432)", "2: (0.31, -0.2, -432)")
    once = ["certificate/Rig.Camera", "frame_poses/Rig.Camera"]
    assert conventional.ran_names() == [*once, "image/Rig.Camera/0002", "truth/Rig.Camera/0002"]
    conventional.edit("2: (0.31, -0.2, -432)", "2: (0.3, -0.2, -432)")
    assert conventional.run() == Counter()


def test_plan_and_explain_name_the_edit_and_its_line(conventional, monkeypatch):
    monkeypatch.chdir(conventional.stage.parent)
    conventional.edit("2: (0.3, -0.2, -432)", "2: (0.317, -0.2, -432)")
    lines = conventional.stage.read_text(encoding="utf-8").splitlines()
    (line,) = (number for number, text in enumerate(lines, 1) if "(0.317, -0.2, -432)" in text)
    told = f"dataset.usda:{line}: </TinyConventional/Board.xformOp:translate> at frame 2:"
    told += " (0.3, -0.2, -432) -> (0.317, -0.2, -432)"

    def said(*arguments):
        return CliRunner().invoke(app, [*arguments[:1], "dataset.usda", *arguments[1:], "-o", "out"]).stdout

    assert [text.strip() for text in said("explain", "image/Rig.Camera/2").splitlines()[1:]] == [told]
    assert said("plan").count(told) == 4
    (task,) = json.loads(said("explain", "truth/Rig.Camera/2", "--json"))["tasks"]
    (edit,) = task["reasons"][0]["edits"]
    assert (edit["at"], edit["time"]) == ("/TinyConventional/Board.xformOp:translate", 2.0)
    assert (edit["old"], edit["new"]) == ([0.3, -0.2, -432.0], [0.317, -0.2, -432.0])
    assert (edit["file"], edit["line"]) == ("dataset.usda", line)


def test_a_comment_and_the_order_of_properties_rerun_nothing(conventional):
    conventional.edit("    rel plen:targets", "    # a remark\n    rel plen:targets")
    conventional.edit("        uniform int plen:columns = 3\n        uniform int plen:rows = 2\n", "")
    conventional.edit("            1: (0, 0, -434.4),", "            1: (0, 0, -434.40),")
    conventional.edit(
        "        uniform double plen:squareSize = 1.4\n",
        "        uniform double plen:squareSize = 1.4\n        uniform int plen:rows = 2\n"
        "        uniform int plen:columns = 3\n",
    )
    assert conventional.run() == Counter()


def test_binary_layers_and_another_folder_rerun_nothing(conventional, tmp_path):
    from pxr import Sdf

    moved = tmp_path / "elsewhere"
    moved.mkdir()
    layer = Sdf.Layer.FindOrOpen(str(conventional.stage))
    lower = moved / "lower.usdc"
    assert layer.Export(str(lower))
    text = conventional.stage.read_text(encoding="utf-8")
    head, _, _ = text.partition("def PlenDataset")
    head = head.replace("#usda 1.0\n(", "#usda 1.0\n(\n    subLayers = [\n        @./lower.usdc@\n    ]", 1)
    conventional.stage, conventional.out = stage_in(moved, head + 'over "TinyConventional"\n{\n}\n'), moved / "out"
    assert conventional.run() == Counter()


def test_moving_rig_and_board_together_never_touches_rays(conventional):
    moved = (
        "    double3 xformOp:translate = (512, 64, -128)\n"
        '    uniform token[] xformOpOrder = ["xformOp:translate"]\n    rel plen:targets'
    )
    conventional.edit("    rel plen:targets", moved)
    assert not RAYS & set(conventional.run())


def test_rays_that_are_asked_for_are_one_more_product_and_no_row_knows_of_them(plenoptic):
    """The same J_near and J_far that `two-plane` needs: from there they come from the store."""
    assert not (plenoptic.out / "cameras/Rig.Camera/rays.exr").exists()
    tables = sorted(plenoptic.out.glob("frames/*/*/correspondences.csv"))
    before = [table.read_bytes() for table in tables]
    plenoptic.add("uniform bool plen:truth:rays = true")
    assert set(plenoptic.run()) == RAYS
    rays = (plenoptic.out / "cameras/Rig.Camera/rays.exr").read_bytes()
    assert [table.read_bytes() for table in tables] == before
    assert verify(plenoptic.out).agrees
    plenoptic.use_method("two-plane")
    assert set(plenoptic.run()) == TRUTH
    assert (plenoptic.out / "cameras/Rig.Camera/rays.exr").read_bytes() == rays


def test_the_certificate_judges_every_camera_in_manifest_and_result(conventional):
    found = json.loads((conventional.out / "manifest.json").read_text(encoding="utf-8"))["certificate"]
    assert list(found) == ["Rig.Camera"] and found["Rig.Camera"]["passed"] is True
    assert found["Rig.Camera"]["own_sigma_px"] < found["Rig.Camera"]["claim_px"] / 3
    assert pipeline.build(conventional.stage, conventional.out, jobs=1).certificate == found


@pytest.mark.parametrize("tiny", few(["conventional"], "plenoptic"))
def test_tiles_of_position_images_give_the_rows_of_full_ones(tiny, request):
    """To the byte; and they are traced only where points may be seen."""
    workshop, tables, filled = request.getfixturevalue(tiny), [], []
    workshop.use_method("image")
    for extent in ("tiles", "full"):
        if extent == "full":
            workshop.add('uniform token plen:truth:extent = "full"')
        workshop.run()
        tables.append([(workshop.out / f"frames/000{n}/Rig.Camera/correspondences.csv").read_bytes() for n in (1, 2)])
        part = read_exr(workshop.out / "frames/0001/Rig.Camera/positions.exr")["Board"]
        filled.append(np.isfinite(part.channels["X"]).mean())
    body = [[table.split(b"\nframe,")[1] for table in pair] for pair in tables]
    assert body[0] == body[1]
    assert filled[0] < filled[1] or tiny == "plenoptic"  # its micro-images are tiles already


def test_a_frame_that_is_dropped_leaves_no_file(conventional):
    conventional.edit("endTimeCode = 2", "endTimeCode = 1")
    assert set(conventional.run()) == {"certificate", "frame_poses"}
    assert not (conventional.out / "frames/0002").exists()


@pytest.mark.heavy
@pytest.mark.parametrize("tiny", ["conventional", "plenoptic"])
def test_bytes_do_not_depend_on_workers_folder_locale_time_zone_or_hash_seed(tiny, tmp_path, request):
    """Built here in one process, and from nothing by two workers of another one with other settings."""
    here, folder = request.getfixturevalue(tiny), tmp_path / "elsewhere"
    folder.mkdir()
    there = Workshop(folder, tiny)
    environment = {**os.environ, "LC_ALL": "C", "TZ": "Asia/Kathmandu", "PYTHONHASHSEED": "12345"}
    environment["PIPELINE_CACHE"] = str(folder / "store")
    command = [sys.executable, "-m", "pipeline.cli", "build", "dataset.usda", "-o", "out", "-j", "2", "-q"]
    subprocess.run(command, cwd=folder, env=environment, check=True, capture_output=True)
    outs = [{name: data for name, (_, data) in _facts(workshop.out).items()} for workshop in (here, there)]
    assert outs[0].keys() == outs[1].keys() and "frames/0002/Rig.Camera/correspondences.csv" in outs[0]
    assert [name for name in outs[0] if outs[0][name] != outs[1][name]] == []
    machine = str(tmp_path).encode()
    assert [name for name, data in outs[0].items() if machine in data] == []
