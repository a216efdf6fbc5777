"""R30: signals to a command, at any moment of it."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from faults.workbench import STAGE, Row, Workbench

BOUND_S = 3.0 if "PYTEST_XDIST_WORKER" not in os.environ else 15.0
"""The time that docs/engine.md promises [s]; more where several processes of tests share a core."""
_CALL_S = 15.0
"""The time for a first Ctrl-C, which waits for the call of a library that runs, such as LLVM's [s]."""

_HOLD = """
import sys, time
from pipeline.engine.store.store import Store
with Store(sys.argv[1]).single_flight(sys.argv[2], "sleeps"):
    print("held", flush=True)
    time.sleep(600)
"""


def ended(process: subprocess.Popen, *numbers: int) -> tuple[int, str, float]:
    """Exit code, stderr and seconds of a process that gets signals, a quarter of a second apart."""
    start = time.monotonic()
    for number in numbers:
        process.send_signal(number)
        time.sleep(0.25 * (len(numbers) > 1))
    try:
        _, log = process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        _, log = process.communicate()
    return process.returncode, log, time.monotonic() - start


@contextlib.contextmanager
def held_by_another(store: Path, key: str) -> Iterator[int]:
    holder = subprocess.Popen([sys.executable, "-c", _HOLD, str(store), key], stdout=subprocess.PIPE)
    try:
        holder.stdout.readline()
        yield holder.pid
    finally:
        holder.kill()
        holder.wait()


def signals_at_any_moment(bench: Workbench) -> Row:
    """Real commands that load, compile and build: each ends in time, with the right code and without a traceback."""
    row = Row("R30", "SIGINT, SIGINT twice, SIGTERM, SIGHUP: start-up, compilation, build")
    ways = ((signal.SIGINT,), (signal.SIGINT, signal.SIGINT), (signal.SIGTERM,), (signal.SIGHUP,))
    for cold in (True, False):
        for number in range(24 if bench.whole else 0):
            place = bench.new_place()
            numbers = ways[number % len(ways)]
            process = _command(bench, place, cold=cold)
            time.sleep(bench.chance.uniform(0.1, 12.0 if cold else 5.0))
            code, log, seconds = ended(process, *numbers)
            row.tried += 1
            if process.returncode == 0:  # the build ended before the signal came
                bench.judge(row, place)
                continue
            row.failed += 1
            lets_end = numbers == (signal.SIGINT,) and "press Ctrl-C again" in log
            late = seconds > (_CALL_S if numbers == (signal.SIGINT,) else BOUND_S) and not lets_end
            wrong = code not in (128 + numbers[0], -numbers[0]) or late or "Traceback" in log
            row.wrong += wrong
            row.notes += [f"{numbers}: {code} after {seconds:.1f} s: {log[-300:]}"] if wrong else []
            bench.judge(row, place)
    return row


def _command(bench: Workbench, place: Path, *, cold: bool) -> subprocess.Popen:
    settings = {**os.environ, "PIPELINE_REPORT": "no", "PIPELINE_CACHE": str(place / "store")}
    if cold:
        settings["PIPELINE_JIT_CACHE"] = str(place / "jit")
    command = [sys.executable, "-m", "pipeline", "build", str(STAGE), "-o", str(place / "out")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    jobs = f"-j{bench.chance.choice((1, 2))}"
    return subprocess.Popen([*command, jobs], env=settings, preexec_fn=_listening, **pipes)


def _listening() -> None:
    """Hear signals also where this row runs under nohup, or behind a shell's &: what is ignored is inherited."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
