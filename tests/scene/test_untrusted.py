"""Stages that nobody vouches for: nothing outside is opened, nothing is unpacked, and reading has an end."""

import os
import zipfile
from pathlib import Path

import pytest
from pxr import Sdf

import pipeline
from pipeline.app import sandbox
from pipeline.app.build import project
from pipeline.app.sandbox import problems_of_untrusted
from pipeline.confine.process import Bounds
from pipeline.errors import UsageError
from pipeline.scene.load import load

TINY = Path(__file__).parents[1] / "data/tiny_conventional/dataset.usda"
HEAD = '#usda 1.0\n(\n    defaultPrim = "A"\n    metersPerUnit = 0.001\n    upAxis = "Y"\n{more})\n'
BODY = 'def Xform "A" (\n    prepend references = @{asset}@\n)\n{{\n}}\n'


def codes(path, *roots):
    """Codes of the problems of an untrusted stage, found in this process."""
    return [problem.code for problem in load(path, roots).problems]


def test_a_good_stage_gives_the_same_project_through_the_sandbox(tmp_path):
    assert project(TINY, untrusted=True).to_plain() == project(TINY).to_plain()


def test_a_file_outside_is_not_even_opened(tmp_path):
    """Opening a FIFO that nobody writes to would wait for ever."""
    inside = tmp_path / "inside"
    inside.mkdir()
    os.mkfifo(tmp_path / "outside.usda")
    for asset in ("../outside.usda", str(tmp_path / "outside.usda"), "./link.usda"):
        (inside / "link.usda").unlink(missing_ok=True)
        (inside / "link.usda").symlink_to(tmp_path / "outside.usda")
        (inside / "s.usda").write_text(HEAD.format(more="") + BODY.format(asset=asset))
        assert codes(inside / "s.usda") == ["asset-outside"]


def test_a_fifo_inside_is_no_layer(tmp_path):
    os.mkfifo(tmp_path / "pipe.usda")
    (tmp_path / "s.usda").write_text(HEAD.format(more="") + BODY.format(asset="./pipe.usda"))
    assert codes(tmp_path / "s.usda") == ["file-kind"]


def test_sublayers_and_layers_of_layers_are_followed(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.usda").write_text(HEAD.format(more=""))
    (inside / "middle.usda").write_text(HEAD.format(more="    subLayers = [@../secret.usda@]\n"))
    (inside / "s.usda").write_text(HEAD.format(more="    subLayers = [@./middle.usda@]\n"))
    assert codes(inside / "s.usda") == ["asset-outside"]
    assert "asset-outside" not in codes(inside / "s.usda", tmp_path)


def test_value_clips_are_refused(tmp_path):
    clips = (
        'def Xform "A" (\n    clips = {\n        dictionary x = {\n            asset[] assetPaths = [@/etc/passwd@]\n'
    )
    clips += "        }\n    }\n)\n{\n}\n"
    (tmp_path / "s.usda").write_text(HEAD.format(more="") + clips)
    assert [problem.code for problem in load(tmp_path / "s.usda").problems] == ["not-yet-supported"]


@pytest.mark.parametrize("name", ["../evil.usda", "/etc/evil.usda", "C:/evil.usda"])
def test_members_of_a_package_stay_in_it(tmp_path, name):
    with zipfile.ZipFile(tmp_path / "p.usdz", "w") as archive:
        archive.writestr(name, "#usda 1.0\n")
    (tmp_path / "s.usda").write_text(HEAD.format(more="") + BODY.format(asset="./p.usdz"))
    assert codes(tmp_path / "s.usda") == ["package"]


def test_packages_that_unpack_to_more_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "p.usdz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.usda", b"#usda 1.0\n" + bytes(10**7))
    (tmp_path / "s.usda").write_text(HEAD.format(more="") + BODY.format(asset="./p.usdz"))
    assert set(codes(tmp_path / "s.usda")) == {"package"}
    (tmp_path / "p.usdz").write_bytes(b"PK" + bytes(100))
    assert codes(tmp_path / "s.usda") == ["package"]


def test_a_huge_layer_is_refused_by_its_size(tmp_path):
    with (tmp_path / "s.usda").open("wb") as stream:
        stream.truncate(2**40)  # sparse
    assert codes(tmp_path / "s.usda") == ["file-size"]


@pytest.mark.parametrize("share", [0.5, *(pytest.param(share, marks=pytest.mark.heavy) for share in (0.1, 0.9))])
def test_a_binary_layer_that_is_cut_ends_in_a_message(tmp_path, share):
    whole = tmp_path / "whole.usdc"
    assert Sdf.Layer.FindOrOpen(str(TINY)).Export(str(whole))
    data = whole.read_bytes()
    (tmp_path / "cut.usdc").write_bytes(data[: int(len(data) * share)])
    rows, _ = problems_of_untrusted(tmp_path / "cut.usdc", ())
    assert [row["line"] for row in rows] == [1]


def test_reading_has_an_end(monkeypatch):
    monkeypatch.setattr(sandbox, "BOUNDS", Bounds(wall_s=0.05))
    with pytest.raises(UsageError, match="took longer"):
        project(TINY, untrusted=True)


def test_tasks_of_an_untrusted_build_are_ended_when_their_time_is_up(tmp_path, monkeypatch):
    """By workers also where one process would do all; a stage that is trusted may take as long as it needs."""
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    monkeypatch.setenv("PIPELINE_LIMITS", "task_s=0")
    result = pipeline.build(TINY, tmp_path / "out", jobs=1, untrusted=True)
    (error,) = {task.error for task in result.tasks if task.state == "failed"}
    assert result.exit_code == 1 and "took longer than 0 s" in error
    in_time = pipeline.build(TINY, tmp_path / "out", jobs=1, untrusted=True, timeout_s=300.0, until=("focus",))
    assert in_time.exit_code == 0 and in_time.executed > 0


def test_no_module_knows_pickle_eval_or_yaml():
    """Of what stores and readers are made of."""
    words = ("pickle.", "import pickle", "marshal", "shelve", "yaml.load", " eval(", "exec(", "allow_pickle=True")
    for path in sorted(Path(pipeline.__file__).parent.rglob("*.py")):
        if path.parts[-2:] == ("jit", "cache.py"):
            continue  # Numba's own format, read from a folder of this user and behind a digest
        text = path.read_text(encoding="utf-8")
        assert [word for word in words if word in text] == [], path
