"""Ctrl-C, SIGTERM and SIGHUP end the command in bounded time and without a traceback."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli.slow_tasks import slow, started
from faults.signals import BOUND_S, ended, held_by_another

from pipeline.engine.interrupts import Interrupts


@pytest.mark.parametrize("numbers", [(signal.SIGTERM,), (signal.SIGHUP,), (signal.SIGINT, signal.SIGINT)])
def test_sigterm_sighup_and_a_second_ctrl_c_end_the_process(command, stage, tmp_path, numbers):
    process = command("build", stage(**slow(tmp_path, 60)), "-j1", "slow/a")
    started(tmp_path)
    code, log, seconds = ended(process, *numbers)
    assert code == -numbers[0] and seconds < BOUND_S and "Traceback" not in log
    assert ("press Ctrl-C again" in log) == (len(numbers) == 2)


def test_one_ctrl_c_ends_a_build_that_compiles(command, stage, tmp_path):
    """Nothing is lost: what was compiled is kept."""
    (tmp_path / "compiling").touch()
    process = command("build", stage(), "-j1")
    started(tmp_path)
    code, log, seconds = ended(process, signal.SIGINT)
    assert code == 130 and seconds < BOUND_S and "Traceback" not in log
    assert "press Ctrl-C again" not in log


def test_one_ctrl_c_ends_a_waiter_which_has_said_for_whom_it_waits(command, pipeline, stage, cache):
    stage()
    key = next(t["key"] for t in json.loads(pipeline("plan", "s.json", "--json")[1])["tasks"] if t["name"] == "lens")
    with held_by_another(cache, key) as holder:
        process = command("build", "s.json", "-j2")
        said = next(line for line in process.stderr if "waiting for" in line)
        assert re.search(rf"process {holder} on \S+, which sleeps since \d{{4}}-\S+", said)
        code, log, seconds = ended(process, signal.SIGINT)
    assert code == 130 and seconds < BOUND_S and "Traceback" not in log
    assert pipeline("build", "s.json", "-j1")[0] == 0


def test_a_signal_in_the_first_second_ends_without_a_word(tmp_path):
    """Wherever it meets the start: in an import, before the first line of ours has run or after."""
    (tmp_path / "s.usda").write_text("#usda 1.0\n")
    for number, delay_s in ((signal.SIGINT, 0.3), (signal.SIGTERM, 0.5), (signal.SIGHUP, 0.7)):
        code = "import sys; print(1, flush=True); from pipeline.__main__ import main; sys.argv = sys.argv[1:]; main()"
        arguments = [sys.executable, "-c", code, "pipeline", "check", *["s.usda"] * 5000]
        process = subprocess.Popen(
            arguments, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        process.stdout.readline()
        time.sleep(delay_s)
        code, log, seconds = ended(process, number)
        assert code in (-number, 128 + number) and log == "" and seconds < BOUND_S


def test_nohup_is_respected(command, stage, tmp_path):
    process = command(
        "build",
        stage(**slow(tmp_path, 1.0)),
        "-j1",
        "slow/a",
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
    )
    started(tmp_path)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=60)
    assert process.returncode == 0


def test_ctrl_c_stops_run_task_which_tidies_up(command, pipeline, stage, tmp_path, cache):
    pipeline("plan", stage(**slow(tmp_path, 60)), "--specs", "specs")
    [path] = [path for path in Path(tmp_path, "specs").iterdir() if "slow/a" in path.read_text()]
    process = command("run-task", str(path))
    started(tmp_path)
    code, log, seconds = ended(process, signal.SIGINT)
    assert code == 130 and seconds < BOUND_S and log == "interrupted\n"
    assert not list((cache / "tmp").iterdir())


def test_what_a_library_makes_of_ctrl_c_is_ctrl_c_and_other_errors_stay():
    """Numba's compiler, interrupted in a call back from LLVM, misses what this should have made."""

    def compile_until(stop):
        try:
            stop()
        except KeyboardInterrupt:
            raise RuntimeError("no compiled object yet") from None
        raise RuntimeError("another fault")

    with Interrupts() as interrupts, interrupts.stopping():
        compile_until(lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(OSError, match="full"), interrupts.stopping():  # of the delivery that follows
        raise OSError("full")
    assert interrupts.arrived
    with pytest.raises(RuntimeError, match="another"), Interrupts() as interrupts, interrupts.stopping():
        compile_until(lambda: None)
