"""What runs again after an edit, and that the plan says so beforehand."""

import pytest
from engine import toy

from pipeline.engine.options import ALONE, BuildOptions
from pipeline.engine.project import tasks_of
from pipeline.engine.running.session import build, plan_of
from pipeline.errors import UsageError

EDITED = [toy.POSES[0], [[3.0, 0.0], [0.0, 1.0]]]


def states(project, **options):
    return {task.name: task.state for task in plan_of(project, BuildOptions(**options))}


def reasons(project, name):
    return [str(reason) for task in plan_of(project) if task.name == name for reason in task.reasons]


def test_equal_bytes_stop_a_rerun_early(tmp_path):
    build(toy.project(tmp_path / "out", power=4.0), ALONE)
    edited = toy.project(tmp_path / "out", power=4.1)
    planned = states(edited)
    assert planned.pop("lens") == "run"
    assert set(planned.values()) == {"maybe"}
    assert toy.executed(build(edited, ALONE)) == {"lens"}


def test_edited_code_reruns_its_kind_and_a_comment_nothing(tmp_path, kit):
    build(toy.project(tmp_path / "out"), BuildOptions(jobs=2))
    image = kit / "tasks" / "image.py"
    image.write_text("# A comment.\n" + image.read_text())
    assert build(toy.project(tmp_path / "out"), BuildOptions(jobs=2)).executed == 0
    image.write_text(image.read_text() + "UNUSED = 1\n")
    assert reasons(toy.project(tmp_path / "out"), "image/cam/0000") == ["code changed"]
    # The bytes are the same ones, so the report has nothing to do.
    assert toy.executed(build(toy.project(tmp_path / "out"), BuildOptions(jobs=2))) == {
        "image/cam/0000",
        "image/cam/0001",
    }


def test_the_plan_names_the_parameter_with_old_and_new_value(tmp_path):
    build(toy.project(tmp_path / "out"), ALONE)
    edited = toy.project(tmp_path / "out", poses=EDITED)
    assert reasons(edited, "image/cam/0001") == ["params.pose[0][0]: 2.0 -> 3.0"]
    assert reasons(edited, "report") == ["image/cam/0001 must run first"]
    assert reasons(edited, "rays/cam") == []


def test_the_plan_says_new_forced_and_missing(tmp_path, cache):
    project = toy.project(tmp_path / "out")
    assert reasons(project, "lens") == ["never built"]
    build(project, ALONE)
    assert states(project, force=["lens"])["lens"] == "run"
    for blob in (cache / "cas").rglob("*"):
        if blob.is_file() and blob.read_bytes().startswith(b"far"):
            blob.unlink()
    assert reasons(project, "rays/cam") == ["missing in the store: planes/far.bin"]


def test_until_runs_a_part_and_leaves_the_folder_alone(tmp_path):
    result = build(toy.project(tmp_path / "out"), BuildOptions(jobs=1, until=("cameras/cam/near.bin",)))
    assert toy.executed(result) == {"lens", "rays/cam"}
    assert result.delivery is None and not (tmp_path / "out").exists()
    assert build(toy.project(tmp_path / "out"), ALONE).executed == 3


def test_a_target_may_be_a_path_to_a_file_of_this_output_folder_and_of_no_other(tmp_path):
    project = toy.project(tmp_path / "out")
    (tmp_path / "elsewhere").touch()
    with pytest.raises(UsageError, match="another output folder is named by -o"):
        tasks_of(project, str(tmp_path / "elsewhere"))
    assert tasks_of(project, str(tmp_path / "out" / "report" / "index.html")) == ["report"]
