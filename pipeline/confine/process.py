"""Confined processes: call a function in a process that can read some folders and compute for a limited time, and
answers in JSON.

The process ends with its parent. If the kernel supports Landlock and seccomp, it cannot write, execute, start
processes or reach the network; limits of memory, time and bytes apply everywhere.
"""

import contextlib
import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO, Any

from pipeline.confine import landlock, seccomp
from pipeline.confine.kernel import END_WITH_PARENT, prctl
from pipeline.machine.another_python import command
from pipeline.machine.processor import settings

_WORDS = 64 * 2**10
"""Bytes of the end of its output that are read."""
_SYSTEM = (
    *("/usr", "/lib", "/lib64", "/nix/store", "/etc/ld.so.cache", "/etc/localtime"),
    *("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system", "/sys/fs/cgroup"),
    *("/dev/null", "/dev/zero", "/dev/urandom"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """Limits of a process.

    Attributes
    ----------
    memory_bytes : int
        Address space.
    cpu_s, wall_s : float
        Computing time and elapsed time [s].
    file_bytes : int
        Size of its answer, and of its anonymous files.
    """

    memory_bytes: int = 4 * 2**30
    cpu_s: float = 120
    wall_s: float = 300
    file_bytes: int = 512 * 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class Guards:
    """The guards in force in a process.

    Attributes
    ----------
    landlock : int
        Version of Landlock's interface; 0 where the kernel, or who runs it, has none.
    seccomp : bool
        Whether calls are filtered.
    parent : bool
        Whether the kernel ends it with its parent.
    """

    landlock: int = 0
    seccomp: bool = False
    parent: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Plain values for `--json`, and the sentence."""
        return {**asdict(self), "told": str(self)}

    def __str__(self) -> str:
        told = f"Landlock {self.landlock}" if self.landlock else "no Landlock"
        return f"{told}, {'' if self.seccomp else 'no '}seccomp, limits on time and memory"


class Ended(Exception):
    """A process ended without an answer.

    Attributes
    ----------
    why : str
        The reason for its end.
    words : str
        The end of what it printed.
    guards : Guards
        Guards that were in force.
    """

    def __init__(self, why: str, words: str = "", guards: Guards | None = None) -> None:
        super().__init__(why)
        self.why, self.words, self.guards = why, words, guards or Guards()


def ask(function: str, question: Any, readable: Iterable[Path], bounds: Bounds) -> tuple[Any, Guards]:
    """Call a function in a confined process.

    Parameters
    ----------
    function : str
        `module:name` of a function of ours, which takes a question and its `Guards`.
    question : JSON value
    readable : iterable of Path
        Folders and files that it may read, besides Python and the libraries.

    Returns
    -------
    answer : JSON value
    guards : Guards
        Guards that were in force.

    Raises
    ------
    Ended
        It crashed, took more than its bounds, or answered nonsense.
    """
    order = {"function": function, "question": question, "parent": os.getpid(), "bounds": asdict(bounds)}
    order["readable"] = [str(path) for path in readable]
    with _scratch() as orders, _scratch() as answer, _scratch() as words:
        orders.write(json.dumps(order).encode())
        orders.seek(0)
        try:
            done = subprocess.run(
                command("pipeline.confine.process:main"),
                stdin=orders,
                stdout=answer,
                stderr=words,
                timeout=bounds.wall_s,
                env={**os.environ, **settings()},
                check=False,
            )
            why = _reason(done.returncode, _last(words)) if done.returncode else None
        except subprocess.TimeoutExpired:
            why = f"it took longer than {bounds.wall_s:g} s"
        answer.seek(0)
        said = answer.read(bounds.file_bytes).split(b"\n")
        guards = _guards(said[0])
        if why is None:
            with contextlib.suppress(ValueError, IndexError, RecursionError):
                return json.loads(said[1]), guards
        raise Ended(why or "it gave no answer", _last(words), guards)


def _guards(said: bytes) -> Guards:
    """Guards by the first line of an answer; none if there is none."""
    with contextlib.suppress(ValueError, TypeError, RecursionError):
        return Guards(**json.loads(said))
    return Guards()


def main() -> None:
    """Run the confined process: the order comes on stdin, one answer goes to stdout."""
    order = json.load(sys.stdin)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print must not mix with the answer
    guards = confine(map(Path, order["readable"]), Bounds(**order["bounds"]), order["parent"])
    print(json.dumps(asdict(guards)), file=answers, flush=True)
    module, name = order["function"].split(":")
    print(json.dumps(getattr(importlib.import_module(module), name)(order["question"], guards)), file=answers)
    answers.close()


def confine(readable: Iterable[Path], bounds: Bounds, parent: int) -> Guards:
    """Confine this process for good. Call it before threads are started, because guards apply to each thread."""
    ends = prctl(END_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)  # the parent has ended already
    for limit, value in (
        (resource.RLIMIT_AS, bounds.memory_bytes),
        (resource.RLIMIT_CPU, int(bounds.cpu_s)),
        (resource.RLIMIT_FSIZE, bounds.file_bytes),
        (resource.RLIMIT_CORE, 0),
    ):
        with contextlib.suppress(ValueError):  # a lower limit is already in force
            resource.setrlimit(limit, (value, value))
    fence = landlock.restrict([*readable, *_installation()])
    return Guards(landlock=fence, seccomp=seccomp.restrict(), parent=ends)


def _installation() -> list[Path]:
    """Python, its libraries, this package, and what the C libraries look up."""
    package = Path(__file__).resolve().parents[2]
    places = [sys.prefix, sys.base_prefix, sys.exec_prefix, *filter(None, sys.path), *_SYSTEM]
    return [package, *map(Path, places)]


def _scratch() -> IO[bytes]:
    """An anonymous file, in memory if the system supports it."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("pipeline"), "w+b")
    return tempfile.TemporaryFile()


def _last(words: IO[bytes]) -> str:
    size = words.seek(0, os.SEEK_END)
    words.seek(max(0, size - _WORDS))
    return words.read(_WORDS).decode(errors="replace")


def _reason(code: int, words: str) -> str:
    if code == -signal.SIGXCPU or code == -signal.SIGKILL:
        return "it took too much time or memory"
    if code < 0:
        return f"it crashed ({signal.Signals(-code).name})"
    last = words.strip().splitlines()[-1:] or [f"exit code {code}"]
    return f"it ended with: {last[0]}"
