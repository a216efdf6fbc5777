"""A confined process reads, computes and answers; whatever else it tries, the kernel refuses."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.confine import landlock, process, seccomp
from pipeline.confine.process import Bounds, Ended, Guards, ask

HAS_LANDLOCK = landlock.version() > 0
HAS_SECCOMP = "Seccomp:" in Path("/proc/self/status").read_text() if Path("/proc/self/status").exists() else False
needs_landlock = pytest.mark.skipif(not HAS_LANDLOCK, reason="this kernel has no Landlock, or does not let us use it")
needs_seccomp = pytest.mark.skipif(not HAS_SECCOMP, reason="this kernel has no seccomp")


@pytest.fixture
def question(tmp_path):
    """A folder that may be read, and one beside it that may not."""
    for name in ("inside", "outside"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(name)
    (tmp_path / "inside/link").symlink_to("../outside/file")
    return {"inside": str(tmp_path / "inside"), "outside": str(tmp_path / "outside")}


def confined(act, question=None, **bounds):
    """Outcomes of an act in a confined process."""
    return ask(f"confine.acts:{act}", question, [Path(question["inside"])] if question else [], Bounds(**bounds))


def alone(guard, act, question):
    """Outcomes of an act in a process that has one of the guards and no other."""
    code = "import json, sys; from pathlib import Path; from pipeline.confine import landlock, seccomp, process; "
    code += f"{guard}; from confine import acts; print(json.dumps(acts.{act}(json.loads(sys.argv[1]))))"
    paths = os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, "-c", code, json.dumps(question)]
    done = subprocess.run(command, capture_output=True, check=True, env={**os.environ, "PYTHONPATH": paths})
    return json.loads(done.stdout)


def test_reading_and_computing_go_on(question):
    outcomes, guards = confined("read_and_compute", question)
    assert set(outcomes.values()) == {"done"}, outcomes
    assert guards == Guards(landlock=landlock.version(), seccomp=HAS_SECCOMP, parent=sys.platform == "linux")


@needs_landlock
def test_landlock_alone_keeps_a_process_in_its_folders(question):
    guard = "landlock.restrict([Path(json.loads(sys.argv[1])['inside']), *process._installation()])"
    assert set(alone(guard, "read_elsewhere", question).values()) == {"PermissionError"}
    written = alone(guard, "write_or_start", question)
    assert {written[name] for name in ("create", "append", "remove", "rename", "link", "folder", "execute")} == {
        "PermissionError"
    }


@needs_seccomp
def test_seccomp_alone_refuses_to_write_start_and_connect(question):
    assert set(alone("seccomp.restrict()", "write_or_start", question).values()) == {"PermissionError"}
    assert (Path(question["inside"]) / "file").read_text() == "inside"


def test_without_a_guard_all_this_can_be_done(question):
    """Else the tests above would say nothing."""
    assert set(alone("pass", "read_elsewhere", question).values()) == {"done"}
    outcomes = alone("pass", "write_or_start", {**question, "execute": False})
    assert {outcomes[name] for name in ("create", "append", "truncate", "folder", "spawn", "fork", "socket")} <= {
        "done",
        "FileExistsError",
    }


def test_a_kernel_that_knows_no_guard_is_told_of(monkeypatch):
    """The answer of a kernel that refuses everything, or of another system."""
    monkeypatch.setattr(landlock, "syscall", lambda *_: -1)
    monkeypatch.setattr(seccomp, "prctl", lambda *_: False)
    assert landlock.restrict([Path("/")]) == 0
    assert seccomp.restrict() is False
    assert str(Guards()) == "no Landlock, no seccomp, limits on time and memory"


@pytest.mark.parametrize(
    ("act", "asked", "bounds", "why"),
    [
        ("crash", True, {}, "crashed .SIGSEGV"),
        ("crash", False, {}, "crashed .SIGABRT"),
        ("fill_memory", None, {"memory_bytes": 2**30}, "MemoryError"),
        ("compute_for_ever", None, {"cpu_s": 1}, "too much time"),
        ("compute_for_ever", None, {"wall_s": 1}, "longer than 1 s"),
        ("answer_too_much", None, {"file_bytes": 2**20}, "crashed .SIGXFSZ|File too large"),
    ],
)
def test_a_process_that_goes_astray_ends_and_says_how(act, asked, bounds, why):
    with pytest.raises(Ended, match=why) as caught:
        ask(f"confine.acts:{act}", asked, [], Bounds(**bounds))
    assert caught.value.guards.seccomp == HAS_SECCOMP
    assert ("last words" in caught.value.words) == (act == "crash")


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux ends a process with its parent")
def test_a_confined_process_ends_with_its_parent():
    """Even one that is stopped, when the parent had no chance to do anything about it."""
    code = "from pipeline.confine.process import *; ask('confine.acts:wait', None, [], Bounds())"
    paths = os.pathsep.join(filter(None, sys.path))
    parent = subprocess.Popen([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": paths})
    child = _until(lambda: _confined_child(parent.pid))
    os.kill(child, signal.SIGSTOP)
    parent.kill()
    parent.wait()
    is_gone = _until(lambda: not Path(f"/proc/{child}/stat").exists() or _state(child) == "Z")
    if not is_gone:
        os.kill(child, signal.SIGKILL)
    assert is_gone


def test_a_process_whose_parent_has_gone_does_not_start(monkeypatch):
    ended = []
    monkeypatch.setattr(process, "prctl", lambda *_: True)
    monkeypatch.setattr(process.os, "_exit", lambda code: ended.append(code))
    monkeypatch.setattr(process.resource, "setrlimit", lambda *_: None)
    monkeypatch.setattr(process.landlock, "restrict", lambda _: 0)
    monkeypatch.setattr(process.seccomp, "restrict", lambda: False)
    process.confine([], Bounds(), os.getppid() + 1)
    assert ended == [1]


def _confined_child(parent):
    """A child that has its guards on, if there is one."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return next((int(pid) for pid in children if "NoNewPrivs:\t1" in Path(f"/proc/{pid}/status").read_text()), None)


def _state(pid):
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


def _until(found, seconds=30):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if value := found():
            return value
        time.sleep(0.02)
    return None
