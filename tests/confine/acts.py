"""Things that a confined process is asked to do; most of them it must not be able to."""

import ctypes
import mmap
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def read_and_compute(question: dict[str, Any], guards: Any) -> dict[str, str]:
    """What must work: reading below the roots, threads, files in memory."""
    inside = Path(question["inside"])
    thread = threading.Thread(target=time.sleep, args=(0,))
    acts = {
        "read": lambda: (inside / "file").read_text(),
        "list": lambda: list(inside.iterdir()),
        "thread": lambda: (thread.start(), thread.join()),
        "memory": lambda: os.write(os.memfd_create("x"), b"x"),
        "executable memory": lambda: mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC),
    }
    return _outcomes(acts)


def read_elsewhere(question: dict[str, Any], guards: Any = None) -> dict[str, str]:
    """Reading outside of the roots, by name and by links from inside."""
    inside, outside = Path(question["inside"]), Path(question["outside"])
    acts = {
        "by name": lambda: (outside / "file").read_text(),
        "by dots": lambda: (inside / "../outside/file").read_text(),
        "by a link": lambda: (inside / "link").read_text(),
        "listed": lambda: list(outside.iterdir()),
    }
    return _outcomes(acts)


def write_or_start(question: dict[str, Any], guards: Any = None) -> dict[str, str]:
    """Everything that changes something, starts something, or reaches others."""
    inside = Path(question["inside"])
    new, old = inside / "new", inside / "file"
    acts: dict[str, Callable[[], Any]] = {
        "create": lambda: new.write_text("x"),
        "append": lambda: old.open("a"),
        "truncate": lambda: os.truncate(old, 0),
        "remove": lambda: old.unlink(),
        "rename": lambda: old.rename(new),
        "link": lambda: os.link(old, new),
        "symbolic link": lambda: new.symlink_to(old),
        "folder": lambda: new.mkdir(),
        "mode": lambda: old.chmod(0),
        "times": lambda: os.utime(old),
        "spawn": lambda: subprocess.run([sys.executable, "-c", ""], check=True),
        "fork": _fork,
        "socket": lambda: socket.socket(),
        "local socket": lambda: socket.socketpair(),
        "signal": lambda: os.kill(os.getppid(), 0),
        "limits": lambda: resource.setrlimit(resource.RLIMIT_CPU, (10**6, 10**6)),
    }
    if question.get("execute", True):  # otherwise this process would end
        acts["execute"] = lambda: os.execv(sys.executable, [sys.executable, "-c", ""])
    return _outcomes(acts)


def crash(question: Any, guards: Any) -> None:
    """The end by a signal, after some words."""
    print("last words", flush=True)
    ctypes.string_at(0) if question else os.abort()


def fill_memory(question: Any, guards: Any) -> int:
    """Ever more memory."""
    return len([bytes(2**28) for _ in range(1000)])


def compute_for_ever(question: Any, guards: Any) -> None:
    """No answer, ever."""
    while True:
        pass


def answer_too_much(question: Any, guards: Any) -> str:
    """More than a parent should have to hold."""
    return "x" * 10_000_000


def wait(question: Any, guards: Any) -> None:
    """Time for somebody to kill the parent."""
    time.sleep(30)


def _fork() -> None:
    if os.fork() == 0:
        os._exit(0)
    os.wait()


def _outcomes(acts: dict[str, Callable[[], Any]]) -> dict[str, str]:
    """The names of the errors that acts end with; `done` where there was none."""
    found = {}
    for name, act in acts.items():
        try:
            act()
            found[name] = "done"
        except OSError as error:
            found[name] = type(error).__name__
        except ValueError:
            found[name] = "PermissionError"  # `resource` turns every refusal into a ValueError
    return found
