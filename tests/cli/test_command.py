"""The command as a user meets it: what it prints where, and its exit codes."""

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest
from cli.slow_tasks import slow, started

STATES = ("executed", "cached", "failed", "skipped")


def failing(tmp_path):
    return {"extra": [["fail", "fail", {"flag": str(tmp_path / "flag")}]]}


def test_build_prints_the_folder_on_stdout_and_the_rest_on_stderr(pipeline, stage, tmp_path):
    code, output, log = pipeline("build", stage(), "-j1")
    assert (code, output) == (0, f"{tmp_path / 'build' / 's'}\n")
    assert "5 executed, 0 cached, 0 failed" in log and str(tmp_path / "store") in log
    assert "\x1b" not in log and "\r" not in log
    code, output, log = pipeline("build", stage(), "-j1", "-q")
    assert (code, log) == (0, "")


def test_data_and_log_keep_their_order_in_one_pipe(command, stage, monkeypatch):
    monkeypatch.delenv("PYTHONUNBUFFERED", raising=False)
    process = command("check", stage(problems=[["error", "a mistake"]]), stderr=subprocess.STDOUT)
    said = process.communicate()[0].splitlines()
    assert [line for line in said if "mistake" in line or "checked" in line] == [
        "stage:1: error: a mistake",
        "1 stage checked: 1 error, 0 warnings",
    ]


def test_json_is_one_object_as_the_contract_says(pipeline, stage, tmp_path):
    code, output, _ = pipeline("build", stage(), "-j1", "--json", "-o", "here")
    summary = json.loads(output)
    assert code == 0 and summary["out"] == str(tmp_path / "here")
    assert list(summary) == ["stage", "out", *STATES, "seconds", "certificate", "points", "tasks"]
    assert [summary[state] for state in STATES] == [5, 0, 0, 0]
    assert all(set(task) == {"name", "kind", "state", "seconds", "key"} for task in summary["tasks"])
    _, output, _ = pipeline("build", stage(), "--json", "-o", "here")
    again = json.loads(output)
    assert again["executed"] == 0 and {task["seconds"] for task in again["tasks"]} == {0}


def test_a_failure_says_task_key_log_and_the_command_to_repeat_it(pipeline, stage, tmp_path):
    code, output, log = pipeline("build", stage(project=failing(tmp_path)), "-k", "-j1")
    assert (code, output) == (1, "")
    key = json.loads(pipeline("plan", stage(project=failing(tmp_path)), "--json")[1])["tasks"][0]["key"]
    assert f"task fail failed (key {key[:12]})" in log
    assert "ValueError: the flag is not there\n    hint: this is a bug of ours" in log and f"{key}.log" in log
    assert "Traceback" not in log
    spec = re.search(r"again: pipeline run-task (\S+)", log)[1]
    code, _, log = pipeline("run-task", spec)
    assert code == 1 and "about to look" in log and "ValueError: the flag is not there" in log
    (tmp_path / "flag").touch()
    code, output, _ = pipeline("run-task", spec)
    assert code == 0 and output.startswith("fail executed 0.")
    assert pipeline("run-task", spec)[:2] == (0, "fail cached 0.0 s\n")
    assert pipeline("build", stage(project=failing(tmp_path)), "-k", "-j1")[0] == 0
    (tmp_path / "flag").touch()
    assert pipeline("build", "s.json", "--until", "fail", "-j1")[0] == 0


def test_a_stage_with_errors_ends_with_2_and_writes_nothing(pipeline, stage, tmp_path):
    stage(problems=[["error", "no such lens"], ["warning", "hm"]])
    code, output, log = pipeline("check", "s.json")
    assert code == 2 and output.splitlines() == ["stage:1: error: no such lens", "stage:1: warning: hm"]
    before = set(tmp_path.iterdir())
    code, output, log = pipeline("build", "s.json", "--events", "events.jsonl")
    assert (code, output) == (2, "") and "no such lens" in log and "Traceback" not in log
    code, output, _ = pipeline("build", "s.json", "--json")
    assert code == 2 and "no such lens" in json.loads(output)["error"]
    assert set(tmp_path.iterdir()) == before
    assert json.loads(pipeline("check", "s.json", "--json")[1])["errors"] == 1
    assert pipeline("plan", "s.json")[0] == 2


def test_plan_explain_and_status_agree(pipeline, stage):
    stage()
    assert pipeline("plan", "s.json")[0] == 0
    assert pipeline("plan", "s.json", "--exit-code")[0] == 3
    pipeline("build", "s.json", "-j1")
    assert pipeline("plan", "s.json", "--exit-code")[0] == 0
    stage(project={"samples": 9})
    plan = json.loads(pipeline("build", "s.json", "-n", "--json")[1])
    assert (plan["cached"], plan["run"], plan["maybe"]) == (1, 1, 3)
    assert "params.samples: 8 -> 9" in pipeline("explain", "s.json", "cameras/cam/near.bin")[1]
    assert pipeline("explain", "s.json")[1].count("params.samples: 8 -> 9") == 1
    assert pipeline("status", "s.json")[1].splitlines()[:2] == [
        "frames: 2 maybe; other files: 1 built, 1 maybe, 2 stale",
        "maybe    frames 0-1",
    ]
    pipeline("build", "s.json", "frames/0001", "-j1")
    head, *lines = pipeline("status", "s.json")[1].splitlines()
    assert head.startswith("frames: 1 built, 1 stale; other files: 1 built, 1 maybe, 2 stale; no manifest")
    assert [line for line in lines if "frame " in line] == ["built    frame 1", "stale    frame 0"]


def test_every_verb_that_answers_does_so_in_json(run, conventional_build):
    asked = [("cache", "path"), ("target", "targets/charuco_8x5.usda")]
    answers = [json.loads(run(*words, "--json")[1]) for words in asked]
    assert answers[1]["kinds"] == ["corner"] * len(answers[1]["points_mm"]) and len(answers[1]["kinds"]) == 28
    assert Path(answers[0]["store"]).is_absolute()
    stage = str(Path(conventional_build) / "dataset.usda")
    assert json.loads(run("graph", stage, "--json")[1])["groups"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["build"], "STAGE"),
        (["build", "s.json", "--wrong"], "--wrong"),
        (["build", "s.json", "-j0"], "-j"),
        (["biuld", "s.json"], "biuld"),
        (["build", "s.json", "rays/can"], "there is rays/cam"),
        (["build", "s.json", "-o", "s.json"], "is a file"),
        (["build", "s.json", "-o", "s.json/below/it"], "below the file"),
        (["build", "missing.json"], "does not exist"),
        (["check", "missing.json"], "does not exist"),
        (["build", "s.json", "-o", ""], "an argument is empty: pipeline build s.json -o ''"),
        (["plan", "s.json", "--specs="], "an argument is empty"),
    ],
)
def test_wrong_usage_ends_with_2_and_a_word(pipeline, stage, arguments, message):
    stage()
    code, output, log = pipeline(*arguments)
    assert (code, output) == (2, "") and message in log and "Traceback" not in log


def test_a_store_that_cannot_be_made_ends_with_5(pipeline, stage, cache):
    cache.write_text("a file")
    code, _, log = pipeline("build", stage(), "-j1")
    assert code == 5 and "store" in log and "Traceback" not in log


@pytest.mark.parametrize("arguments", [("-j1", "--events", "no/such/folder/e.jsonl"), ("-j1", "--events", ".")])
def test_events_that_cannot_be_written_end_with_5_before_anything_runs(pipeline, stage, cache, arguments):
    code, _, log = pipeline("build", stage(), *arguments)
    assert code == 5 and "cannot write events to" in log and "Traceback" not in log
    assert not (cache / "cas").exists()


def test_events_do_not_overwrite_a_file_of_the_user(pipeline, stage, tmp_path):
    text = (tmp_path / stage()).read_text()
    code, _, log = pipeline("build", stage(), "-j1", "--events", "s.json")
    assert code == 2 and "s.json exists and is not an event file" in log
    assert (tmp_path / "s.json").read_text() == text
    for _ in range(2):  # an older one of ours may be overwritten
        assert pipeline("build", stage(), "-j1", "--events", "e.jsonl")[0] == 0


def test_a_store_in_a_folder_of_the_user_is_refused_with_the_way_out(pipeline, stage, cache):
    (cache / "tmp/experiment").mkdir(parents=True)
    for arguments in (("build", stage(), "-j1"), ("cache", "gc")):
        code, _, log = pipeline(*arguments)
        assert code == 5 and "set PIPELINE_CACHE to a folder that is new or empty" in log
    assert [path.name for path in cache.rglob("*")] == ["tmp", "experiment"]


def test_a_wrong_limit_of_the_store_is_told_before_anything_runs(pipeline, stage, cache, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE_SIZE", "lots")
    code, _, log = pipeline("build", stage(), "-j1")
    assert code == 2 and "PIPELINE_CACHE_SIZE: 'lots' is not a size" in log
    assert not (cache / "cas").exists()


def test_a_bug_of_ours_ends_with_70(pipeline, stage):
    code, _, log = pipeline("build", stage(bug=True))
    assert code == 70 and "report" in log and "ZeroDivisionError" in log


def test_a_reader_that_goes_away_ends_with_141_and_no_word(command, stage):
    stage(problems=[["warning", "x" * 200]] * 2000)
    reading, writing = os.pipe()
    os.close(reading)
    process = command("check", "s.json", stdout=writing)
    os.close(writing)
    _, log = process.communicate(timeout=60)
    assert process.returncode == 141 and "Error" not in log


@pytest.mark.parametrize("jobs", ["-j1", "-j2"])
def test_ctrl_c_once_lets_running_tasks_end(command, pipeline, stage, tmp_path, jobs):
    process = command("build", stage(**slow(tmp_path, 0.6)), jobs, "slow/a")
    started(tmp_path)
    process.send_signal(signal.SIGINT)
    _, log = process.communicate(timeout=60)
    assert process.returncode == 130 and "press Ctrl-C again" in log
    states = json.loads(pipeline("plan", "s.json", "--json")[1])["tasks"]
    assert next(task for task in states if task["name"] == "slow/a")["state"] == "cached"


def test_a_build_by_single_tasks_alone_gives_the_same_manifest(pipeline, stage, tmp_path, monkeypatch):
    """As an array of a batch system does it: what can run now, again and again."""
    rounds = 0
    while pipeline("plan", stage(), "--specs", "specs", "--exit-code")[0] == 3:
        names = sorted(path.name for path in (tmp_path / "specs").iterdir())
        assert names == [f"{number}.json" for number in range(len(names))]
        for name in names:
            assert pipeline("run-task", f"specs/{name}")[0] == 0
        rounds += 1
    assert rounds == 4
    result = json.loads(pipeline("build", "s.json", "-j1", "--json")[1])
    assert result["executed"] == 0
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "fresh"))
    pipeline("build", "s.json", "-j2", "-o", "other")
    assert (tmp_path / "other/manifest.json").read_bytes() == (tmp_path / "build/s/manifest.json").read_bytes()


def test_specs_go_into_no_folder_with_other_peoples_numbered_files(pipeline, stage, tmp_path):
    (tmp_path / "specs").mkdir()
    (tmp_path / "specs/2024.json").write_text('{"mine": 1}')
    code, _, log = pipeline("plan", stage(), "--specs", "specs")
    assert code == 2 and "2024.json is not the spec of a task" in log
    assert [path.name for path in (tmp_path / "specs").iterdir()] == ["2024.json"]


def test_specs_in_a_place_without_folders_end_with_5(pipeline, stage):
    code, _, log = pipeline("plan", stage(), "--specs", "/dev/null/specs")
    assert code == 5 and "cannot write /dev/null/specs" in log


def test_a_spec_that_was_altered_or_is_none_is_refused(pipeline, stage, tmp_path):
    pipeline("plan", stage(), "--specs", "specs")
    path = tmp_path / "specs/0.json"
    spec = json.loads(path.read_text())
    spec["components"]["params"]["power"] = 5.0
    path.write_text(json.dumps(spec))
    code, _, log = pipeline("run-task", "specs/0.json")
    assert code == 2 and "altered" in log
    for text in ("", "[]", "{}", '{"name": 1}', '{"name": "a", "key": "../../x", "components": {}}'):
        path.write_text(text)
        assert pipeline("run-task", "specs/0.json")[0] == 2
    assert pipeline("run-task", "specs/none.json")[0] == 2


def test_logs_print_what_a_task_said_and_took(pipeline, stage, tmp_path):
    said = pipeline("logs", stage(), "rays")[1]
    assert "never built" in said and "; -o names another folder" in said
    pipeline("build", stage(), "-j1")
    code, output, _ = pipeline("logs", "s.json", "image")
    assert code == 0 and output.count("rendering\n") == 2
    assert re.search(
        r"== image/cam/0001: executed, key [0-9a-f]{12}, [\d.]+ s on \S+, \d{4}-.*, [\d.]+ [kMG]B\n", output
    )
    pipeline("build", "s.json", "-j1")
    assert pipeline("logs", "s.json", "image")[1] == output  # tasks taken from the cache say nothing new
    pipeline("build", stage(project=failing(tmp_path)), "-k", "-j1")
    code, output, _ = pipeline("logs", "s.json", "fail")
    assert "== fail: failed" in output and "about to look" in output and "again: pipeline run-task" in output


def test_explain_groups_what_changed_alike(pipeline, stage):
    poses = [[[float(number)]] for number in range(50)]
    pipeline("build", stage(project={"poses": poses}), "-j1")
    pipeline("build", stage(project={"poses": [[[100 + x for x in row] for row in pose] for pose in poses]}), "-n")
    output = pipeline("explain", "s.json", "image")[1]
    assert "params.pose[0][0]: 0.0 -> 100.0" in output
    assert "… and 49 more image alike, up to image/cam/0049" in output
    assert len(output.splitlines()) == 3


def test_check_determinism_computes_twice_and_ends_with_4(pipeline, stage):
    code, _, log = pipeline("build", stage(), "-j1", "--check-determinism", "50")
    assert code == 0 and "3 tasks computed twice, 0 with other bytes" in log
    noisy = {"project": {"extra": [["noisy", "noisy", {}]]}}
    code, output, log = pipeline("build", stage(**noisy), "-j2", "--check-determinism", "100", "--json")
    assert code == 4 and "6 tasks computed twice, 1 with other bytes" in log
    assert "NON-DETERMINISM: noisy" in log and "noise.txt" in log and "the first ones stay" in log
    assert [task["differs"] for task in json.loads(output)["tasks"] if "differs" in task] == [["noise.txt"]]
    assert pipeline("build", "s.json", "-j1")[0] == 0  # the first bytes stay


@pytest.mark.parametrize("jobs", ["-j1", "-j2"])
def test_a_task_that_takes_too_long_is_ended_and_the_others_go_on(pipeline, stage, tmp_path, jobs):
    code, _, log = pipeline("build", stage(**slow(tmp_path, 60)), jobs, "-k", "--timeout", "2")
    assert code == 1 and "slow/a took longer" not in log
    assert "it took longer than 2 s and was ended (--timeout)" in log and "5 executed" not in log
    assert "again: pipeline run-task" in log


def test_retries_try_a_failure_again(pipeline, stage, tmp_path):
    flaky = {"project": {"extra": [["flaky", "flaky", {"folder": str(tmp_path), "times": 2}]]}}
    assert pipeline("build", stage(**flaky), "-j1", "--retries", "1")[0] == 1
    for path in tmp_path.glob("try*"):
        path.unlink()
    code, _, log = pipeline("build", stage(**flaky), "-j1", "--retries", "2")
    assert code == 0 and log.count("flaky tried again: ValueError: not yet") == 2


def test_events_are_lines_of_json_and_tell_the_same_story(pipeline, stage, tmp_path):
    pipeline("build", stage(), "-j1", "--events", "events.jsonl")
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert events[0]["event"] == "begin" and events[-1]["event"] == "end"
    assert sum(event["event"] == "done" for event in events) == 5
    assert events[-1]["summary"]["executed"] == 5


def test_version_says_which_usd_and_where_the_plug_in_is(pipeline):
    code, output, _ = pipeline("--version")
    assert code == 0 and "usd-core 26" in output and "schemas" in output
    code, output, _ = pipeline("plugin-path")
    assert code == 0 and [Path(line).name for line in output.splitlines()] == ["schemas", "stages"]
