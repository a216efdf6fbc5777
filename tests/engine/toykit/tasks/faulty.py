"""Tasks that fail, die, take their time, or are meddled with."""

import errno
import json
import os
import signal
import sys
import time
import uuid
from pathlib import Path


def fail(params, inputs, out):
    """Fail until a file appears."""
    print("about to look")
    if not Path(params["flag"]).exists():
        raise ValueError("the flag is not there")
    (out / "fine.txt").write_text("fine")


def flaky(params, inputs, out):
    """Fail the first `times` times."""
    tries = len(list(Path(params["folder"]).glob("try*")))
    Path(params["folder"], f"try{tries}").touch()
    if tries < params["times"]:
        raise ValueError("not yet")
    (out / "done.txt").write_text("done")


def full(params, inputs, out):
    """Raise what the operating system raises when a disk is full."""
    raise OSError(errno.ENOSPC, "No space left on device")


def hungry(params, inputs, out):
    """Count how many of its kind run at the same time; a greedy one claims that there is no memory beside another."""
    mine = Path(params["folder"], f"running-{uuid.uuid4().hex}")
    mine.touch()
    try:
        time.sleep(0.3)
        beside = len(list(Path(params["folder"]).glob("running-*"))) - 1
        if beside and params["greedy"]:
            raise MemoryError
        time.sleep(0.1)
    finally:
        mine.unlink()
    (out / "fed.txt").write_text(params["name"])


def killed(params, inputs, out):
    """Kill its own process the first `times` times."""
    for n in range(params["times"]):
        if not Path(params["folder"], f"death{n}").exists():
            Path(params["folder"], f"death{n}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
    (out / "alive.txt").write_text("alive")


def linked(params, inputs, out):
    """Write a link to a file of the machine instead of a file."""
    (out / "passwd").symlink_to("/etc/passwd")


def meddled(params, inputs, out):
    """Flip a bit of the input, read it, and maybe put it back, as often as it is told: same size, same mtime."""
    path, tries = inputs["lens"]["lens.txt"], Path(params["folder"])
    if len(list(tries.iterdir())) < params["times"]:
        (tries / f"try{len(list(tries.iterdir()))}").touch()
        right, times = path.read_bytes(), path.stat()
        path.chmod(0o644)
        path.write_bytes(bytes([right[0] ^ 1]) + right[1:])
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        (out / "read.txt").write_bytes(path.read_bytes())
        if params["put_back"]:
            path.write_bytes(right)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    else:
        (out / "read.txt").write_bytes(path.read_bytes())


def noisy(params, inputs, out):
    """Give other bytes every time."""
    (out / "noise.txt").write_text(uuid.uuid4().hex)


def probe(params, inputs, out):
    """Write what a worker has imported and how many threads it may use."""
    threads = {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")}
    (out / "probe.json").write_text(json.dumps({"modules": sorted(sys.modules), "threads": threads}))


def slow(params, inputs, out):
    """Say that it started, take its time, and count how often it ran."""
    Path(params["folder"], f"ran-{params['name']}-{uuid.uuid4().hex}").touch()
    time.sleep(params["seconds"])
    (out / "slow.txt").write_text(params["name"])
