"""The command as a user meets it: what it prints where, and its exit codes."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli import toy_command

from pipeline import cli
from pipeline.engine.perform import ONE_THREAD

COMMAND = Path(__file__).with_name("toy_command.py")
STATES = ("executed", "cached", "failed", "skipped")


@pytest.fixture
def command(tmp_path, kit, cache):
    """Start the command in an empty folder with a stage `s.json`."""

    def start(*arguments, **options):
        settings = {**os.environ, "PIPELINE_CACHE": str(cache), "NO_COLOR": "1", "COLUMNS": "200"}
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options}
        return subprocess.Popen(
            [sys.executable, str(COMMAND), str(kit.parent), *arguments], cwd=tmp_path, env=settings, **pipes
        )

    return start


@pytest.fixture
def pipeline(tmp_path, kit, monkeypatch, capsys):
    """Run the command in this process, in the same folder: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    for name in ONE_THREAD:
        monkeypatch.setenv(name, "1")
    for name, module in toy_command.fakes().items():
        monkeypatch.setitem(sys.modules, name, module)

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["pipeline", *arguments])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def stage(tmp_path):
    """Write the stage; gives its path as the user types it."""

    def write(**facts):
        (tmp_path / "s.json").write_text(json.dumps(facts))
        return "s.json"

    write()
    return write


def failing(tmp_path):
    return {"extra": [["fail", "fail", {"flag": str(tmp_path / "flag")}]]}


def test_build_prints_the_folder_on_stdout_and_the_rest_on_stderr(pipeline, stage, tmp_path):
    code, output, log = pipeline("build", stage(), "-j1")
    assert (code, output) == (0, f"{tmp_path / 'build' / 's'}\n")
    assert "5 executed, 0 cached, 0 failed" in log and str(tmp_path / "store") in log
    assert "\x1b" not in log and "\r" not in log
    code, output, log = pipeline("build", stage(), "-j1", "-q")
    assert (code, log) == (0, "")


def test_json_is_one_object_as_the_contract_says(pipeline, stage, tmp_path):
    code, output, _ = pipeline("build", stage(), "-j2", "--json", "-o", "here")
    summary = json.loads(output)
    assert code == 0 and summary["out"] == str(tmp_path / "here")
    assert list(summary) == ["stage", "out", *STATES, "seconds", "certificate", "tasks"]
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
    assert "ValueError: the flag is not there" in log and f"{key}.log" in log
    assert "pipeline build s.json --until fail -j1" in log
    (tmp_path / "flag").touch()
    assert pipeline("build", "s.json", "--until", "fail", "-j1")[0] == 0


def test_json_is_complete_after_a_failure(pipeline, stage, tmp_path):
    code, output, _ = pipeline("build", stage(project=failing(tmp_path)), "-k", "-j1", "--json")
    summary = json.loads(output)
    failed = next(task for task in summary["tasks"] if task["state"] == "failed")
    assert code == 1 and summary["failed"] == 1
    assert "the flag" in failed["error"] and Path(failed["log"]).is_file()


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


def test_a_stage_with_warnings_passes(pipeline, stage):
    assert pipeline("check", stage(problems=[["warning", "hm"]]))[0] == 0


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
    _, output, _ = pipeline("status", "s.json")
    assert "built    lens" in output and "stale    rays/cam" in output
    assert "running" not in output


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["build"], "STAGE"),
        (["build", "s.json", "--wrong"], "--wrong"),
        (["build", "s.json", "-j0"], "-j"),
        (["biuld", "s.json"], "biuld"),
        (["build", "s.json", "rays/can"], "did you mean"),
        (["build", "missing.json"], "does not exist"),
        (["check", "missing.json"], "does not exist"),
    ],
)
def test_wrong_usage_ends_with_2_and_a_word(pipeline, stage, arguments, message):
    stage()
    code, output, log = pipeline(*arguments)
    assert (code, output) == (2, "") and message in log and "Traceback" not in log


def test_another_stages_folder_is_refused(pipeline, stage):
    pipeline("build", stage(), "-o", "out", "-j1")
    code, _, log = pipeline("build", stage(project={"stage": "other"}), "-o", "out")
    assert code == 2 and "another stage" in log


def test_a_full_disk_ends_with_5(pipeline, stage):
    assert pipeline("build", stage(project={"extra": [["full", "full", {}]]}), "-j1")[0] == 5


def test_a_store_that_cannot_be_made_ends_with_5(pipeline, stage, cache):
    cache.write_text("a file")
    code, _, log = pipeline("build", stage(), "-j1")
    assert code == 5 and "store" in log and "Traceback" not in log


def test_a_bug_of_ours_ends_with_70(pipeline, stage):
    code, _, log = pipeline("build", stage(bug=True))
    assert code == 70 and "report" in log and "ZeroDivisionError" in log


def test_a_reader_that_goes_away_ends_with_141_and_no_word(command, stage):
    stage(problems=[["warning", "x" * 200]] * 2000)
    reading, writing = os.pipe()
    os.close(reading)
    process = command("check", "s.json", stdout=writing)
    os.close(writing)
    _, log = process.communicate(timeout=30)
    assert process.returncode == 141 and "Error" not in log


def started(tmp_path):
    give_up = time.monotonic() + 20
    while not list(tmp_path.glob("ran-*")):
        assert time.monotonic() < give_up
        time.sleep(0.02)


def slow(tmp_path, seconds):
    tasks = [["slow/a", "slow", {"folder": str(tmp_path), "name": "a", "seconds": seconds}]]
    return {"project": {"extra": [*tasks, ["slow/b", "report", {}, {}]], "poses": []}}


@pytest.mark.parametrize("jobs", ["-j1", "-j2"])
def test_ctrl_c_once_lets_running_tasks_end(command, pipeline, stage, tmp_path, jobs):
    process = command("build", stage(**slow(tmp_path, 0.6)), jobs, "slow/a")
    started(tmp_path)
    process.send_signal(signal.SIGINT)
    _, log = process.communicate(timeout=30)
    assert process.returncode == 130 and "press Ctrl-C again" in log
    states = json.loads(pipeline("plan", "s.json", "--json")[1])["tasks"]
    assert next(task for task in states if task["name"] == "slow/a")["state"] == "cached"


@pytest.mark.parametrize(("jobs", "signals", "code"), [("-j2", 2, 130), ("-j1", 2, 130), ("-j2", 1, 143)])
def test_ctrl_c_twice_and_sigterm_stop_at_once(command, pipeline, stage, tmp_path, jobs, signals, code):
    process = command("build", stage(**slow(tmp_path, 60)), jobs)
    started(tmp_path)
    if signals == 2:
        process.send_signal(signal.SIGINT)
        assert any("press Ctrl-C again" in line for line in process.stderr)  # two at once would count as one
    process.send_signal(signal.SIGINT if code == 130 else signal.SIGTERM)
    process.communicate(timeout=10)
    assert process.returncode == code
    assert not (tmp_path / "build").exists()
    assert pipeline("build", stage(), "-j1")[0] == 0


def test_events_are_lines_of_json_and_tell_the_same_story(pipeline, stage, tmp_path):
    pipeline("build", stage(), "-j2", "--events", "events.jsonl")
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text().splitlines()]
    assert events[0]["event"] == "begin" and events[-1]["event"] == "end"
    assert sum(event["event"] == "done" for event in events) == 5
    assert events[-1]["summary"]["executed"] == 5


def test_version_says_which_usd_and_where_the_plug_in_is(pipeline):
    code, output, _ = pipeline("--version")
    assert code == 0 and "usd-core 26" in output and "schemas" in output
    code, output, _ = pipeline("plugin-path")
    assert code == 0 and [Path(line).name for line in output.splitlines()] == ["schemas", "stages"]


def test_help_is_instant():
    code = "import sys; from pipeline import cli; print(sorted({m.split('.')[0] for m in sys.modules}))"
    output = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    for heavy in ("numpy", "pxr", "networkx", "numba"):
        assert f"'{heavy}'" not in output
