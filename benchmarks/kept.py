"""Results of benchmarks: files in results/, each with the date and the processor."""

import contextlib
import io
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any, TypeVar

from beside import tell_ratios

R = TypeVar("R")
RESULTS = Path(__file__).resolve().parent / "results"


def keep(name: str, found: dict[str, Any]) -> None:
    """Write what a benchmark found."""
    RESULTS.mkdir(exist_ok=True)
    head = {"date": date.today().isoformat(), "processor": processor()}
    (RESULTS / f"{name}.json").write_text(json.dumps({**head, **found}, indent=2) + "\n", encoding="utf-8")


@contextlib.contextmanager
def keeping(name: str, *, compared: bool = False) -> Iterator[None]:
    """Keep the lines that are printed meanwhile; if compared, with those of the commit before and ratios.

    Not those of a run with --small, or of help.
    """
    with seen() as lines:
        yield
        if "--small" not in sys.argv:
            if compared:
                tell_ratios(f"{name}.py", lines(), *sys.argv[1:])
            keep(name, {"arguments": sys.argv[1:], "printed": lines()})


@contextlib.contextmanager
def seen() -> Iterator[Callable[[], list[str]]]:
    """Inside, what is printed is remembered, too: what is called gives the lines."""
    text = _Twice(sys.stdout)
    with contextlib.redirect_stdout(text):
        yield lambda: text.getvalue().splitlines()


class _Twice(io.StringIO):
    """Text that another stream gets, too."""

    def __init__(self, other: Any) -> None:
        super().__init__()
        self._other = other

    def write(self, text: str) -> int:
        self._other.write(text)
        self._other.flush()
        return super().write(text)


def processor() -> str:
    """Name of the processor, and the number of cores that this process may use."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text(encoding="utf-8").split("\n") if facts.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {len(os.sched_getaffinity(0))} cores"


def timed(job: Callable[[], R], turns: int) -> tuple[R, float]:
    """What a job returns, and its least processor time in some turns [s]."""
    seconds, answer = [], job()
    for _ in range(turns):
        start = time.process_time()
        answer = job()
        seconds.append(time.process_time() - start)
    return answer, min(seconds)
