"""The faults, by their numbers; every function does one row of the table."""

import errno
import fcntl
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from faults.beside_entries import (
    flips_after_verification,
    something_in_the_place_of_folders,
)
from faults.other_numerics import other_numerics
from faults.shim import fail_at, in_fork, kill_at
from faults.signals import signals_at_any_moment
from faults.users import second_users
from faults.workbench import Row, Workbench, damage, entries

from pipeline.engine.maintenance import collect
from pipeline.engine.options import BuildOptions
from pipeline.engine.output import manifest
from pipeline.engine.records import Blob
from pipeline.engine.running.session import build
from pipeline.engine.store.store import Store


def killed_at_every_step(bench: Workbench) -> Row:
    steps = bench.steps_of_a_build
    row = Row("R1", f"SIGKILL before each of {steps} steps of a build")
    for number in bench.some(steps, 2):
        place = bench.new_place()
        row.failed += bench.build_in_fork(place, kill_at(number)) == -signal.SIGKILL
        row.tried += 1
        bench.judge(row, place)
    return row


def power_failures(bench: Workbench) -> Row:
    row = Row("R2", "power failure: entry missing, empty, cut, or zeros")
    makers = (
        lambda path, data: None,
        lambda path, data: path.touch(),
        lambda path, data: path.write_bytes(data[: len(data) // 2]),
        lambda path, data: path.write_bytes(bytes(len(data))),
    )
    return _replaced_entries(bench, row, makers)


def entries_of_another_kind(bench: Workbench) -> Row:
    row = Row("R5 R11", "swapped or foreign entry: link, hard link, FIFO, folder")
    precious, first = bench.folder / "precious.txt", entries(bench.folder / "right")[0]
    precious.write_text("precious")
    makers = (
        lambda path, data: shutil.copyfile(first, path),
        lambda path, data: path.symlink_to(precious),
        lambda path, data: path.hardlink_to(precious),
        lambda path, data: os.mkfifo(path),
        lambda path, data: path.mkdir(),
    )
    row = _replaced_entries(bench, row, makers)
    row.wrong += precious.read_text() != "precious"
    return row


def _replaced_entries(bench: Workbench, row: Row, makers: Sequence[Callable[[Path, bytes], object]]) -> Row:
    """Something else in the place of an entry of the store, which the makers get with its bytes."""
    names = [path.relative_to(bench.folder / "right") for path in entries(bench.folder / "right")]
    cases = [(name, make) for name in names for make in makers]
    for number in bench.some(len(cases), 2):
        name, make = cases[number - 1]
        place = bench.new_place(built=True)
        shutil.rmtree(place / "out")
        data = (place / name).read_bytes()
        (place / name).unlink()
        make(place / name, data)
        row.tried += 1
        bench.judge(row, place, meanwhile=False)
    return row


def cut_at_every_byte(bench: Workbench) -> Row:
    row = Row("R3", "record, manifest or note cut at every byte")
    place = bench.new_place(built=True)
    store = Store(place / "store")
    for key, _ in list(store.entries("record")):
        path = store.path("record", key)
        whole = path.read_bytes()
        for size in range(0, len(whole), 1 if bench.whole else 97):
            path.unlink(missing_ok=True)
            path.write_bytes(whole[:size])
            row.tried += 1
            row.wrong += store.peek(key) is not None
        path.unlink(missing_ok=True)
        path.write_bytes(whole)
    path = place / "out" / manifest.NAME
    whole = path.read_bytes()
    for size in range(0, len(whole) - 2, 1 if bench.whole else 97):
        path.write_bytes(whole[:size])
        row.tried += 1
        row.wrong += bool(manifest.read(path.parent).files)
    for note in [note for folder in ("history", "sources", "index") for note in (place / "store" / folder).glob("*")]:
        whole = note.read_bytes()
        for size in (0, 1, len(whole) // 2, len(whole) - 1):
            note.unlink()
            note.write_bytes(whole[:size])
            row.tried += 1
            row.wrong += store.read_note(note.parent.name, note.stem) is not None
    bench.judge(row, place, meanwhile=False)
    return row


def flipped_bits(bench: Workbench) -> Row:
    row = Row("R4", "one flipped bit in every record and blob")
    place = bench.new_place(built=True)
    flips = 24 if bench.whole else 2
    for path in entries(place):
        whole = path.read_bytes()
        for _ in range(flips):
            store, data = Store(place / "store"), bytearray(whole)
            data[bench.chance.randrange(len(data))] ^= 1 << bench.chance.randrange(8)
            path.unlink(missing_ok=True)
            path.write_bytes(data)
            row.tried += 1
            if path.suffix == ".json":
                row.wrong += store.peek(path.stem) is not None
            else:
                row.wrong += store.is_whole(Blob(sha256=path.name, size=len(whole)))
    bench.judge(row, place, meanwhile=False)
    return row


def errors_of_the_system(bench: Workbench, number: str, fault: str, error: int, *, for_good: bool, most: int) -> Row:
    steps = bench.steps_of_a_build
    row = Row(number, f"{fault}, at each of {steps} steps{', and from there on' if for_good else ''}")
    for step in bench.some(steps, most):
        place = bench.new_place()
        code = bench.build_in_fork(place, fail_at(step, error, for_good=for_good))
        row.tried += 1
        row.failed += code != 0
        row.wrong += code not in (0, 1, 5)
        row.notes += bench.unexpected()
        bench.judge(row, place)
    return row


_FULL_DISK = """
import shutil, subprocess, sys
sys.path[:0] = sys.argv[3].split(":")
from pipeline.machine.processor import pin
pin()
from pathlib import Path
from engine import toy
from faults.workbench import Workbench, Row, damage
mount, sizes = Path(sys.argv[1]), [int(size) for size in sys.argv[2].split(",")]
bench = Workbench(mount.parent, whole=False)
failed = wrong = bad = 0
for kib in sizes:
    subprocess.check_call(["mount", "-t", "tmpfs", "-o", f"size={kib}k", "tmpfs", mount])
    code = bench.build_in_fork(mount)
    failed += code == 5
    wrong += code not in (0, 5)
    for text in bench.unexpected():
        print(text, file=sys.stderr)
    if (mount / "out" / "manifest.json").exists():
        wrong += toy.contents(mount / "out") != bench.right
    bad += (mount / "store/VERSION").exists() and bool(damage(mount).damaged)
    subprocess.check_call(["mount", "-o", "remount,size=64m", mount])
    wrong += bench.build_in_fork(mount) != 0 or toy.contents(mount / "out") != bench.right
    bad += bool(damage(mount).damaged)
    subprocess.check_call(["umount", "-l", mount])
print(failed, wrong, bad)
"""


def full_disks(bench: Workbench) -> Row:
    row = Row("R6", "a real disk that is full, by its size")
    if subprocess.run(["unshare", "-m", "true"], check=False, capture_output=True).returncode:
        row.notes.append("not tried: file systems may not be mounted here")
        return row
    mount = bench.new_place() / "mount"
    mount.mkdir()
    sizes = range(4, 1800, 16) if bench.whole else (40, 200)
    command = ["unshare", "-m", sys.executable, "-c", _FULL_DISK, str(mount), ",".join(map(str, sizes))]
    done = subprocess.run([*command, ":".join(sys.path)], capture_output=True, text=True, check=False)
    if done.returncode:
        row.notes.append(done.stderr.strip().splitlines()[-1])
        row.bad += 1
        return row
    row.notes += [done.stderr] if done.stderr.strip() else []
    row.tried = len(sizes)
    row.failed, row.wrong, row.bad = map(int, done.stdout.split()[-3:])
    return row


def several_builders(bench: Workbench) -> Row:
    row = Row("R8", "builders at the same time on one store")
    for count in (2, 6) if bench.whole else (2,):
        place = bench.new_place()
        codes, ran = _race(bench, place, count)
        row.tried += count
        row.wrong += any(codes) + (ran != Counter(bench.project.graph))
        bench.judge(row, place)
    return row


def builders_without_common_locks(bench: Workbench) -> Row:
    """As on two machines that share a store over a network: each grants its own locks, or there are none at all."""
    row = Row("R8", "two builders whose locks do not reach each other, or that have none")

    def no_locks(handle: int, operation: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    kinds = (no_locks, lambda handle, operation: None)
    for flock in kinds * 10 if bench.whole else kinds[:1]:
        place = bench.new_place()

        def prepare(number: int, flock=flock) -> None:
            fcntl.flock = flock
            socket.gethostname = lambda: f"machine{number}"

        codes, ran = _race(bench, place, 2, prepare)
        row.tried += 2
        row.failed += sum(code != 0 for code in codes)
        row.wrong += not set(codes) <= {0, 5} or max(ran.values()) > 2
        bench.judge(row, place)
    return row


def _race(
    bench: Workbench, place: Path, count: int, prepare: Callable[[int], None] = lambda number: None
) -> tuple[list[int], Counter[str]]:
    """Exit codes of builders that begin at the same time, and how often each task ran."""
    children = [_builder(bench, place, number, prepare) for number in range(count)]
    codes = [os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in children]
    ran = Counter[str]()
    for path in place.glob("ran-*"):
        ran.update(json.loads(path.read_text()))
        path.unlink()
    return codes, ran


def _builder(bench: Workbench, place: Path, number: int, prepare: Callable[[int], None] = lambda number: None) -> int:
    pid = os.fork()
    if pid:
        return pid
    code = 99
    try:
        prepare(number)
        result = bench.build(place)
        ran = [task.name for task in result.tasks if task.state == "executed"]
        (place / f"ran-{number}").write_text(json.dumps(ran))
        code = result.exit_code
    finally:
        os._exit(code)


def soak(bench: Workbench) -> Row:
    """Three builders; one of them gets a signal at a random time and is started again; until the time is up."""
    row = Row("R9 R22", "soak: three builders under SIGKILL, SIGTERM and SIGINT")
    end = time.monotonic() + bench.soak_s
    builds = 0
    while time.monotonic() < end:
        place = bench.new_place()
        running = [_builder(bench, place, number) for number in range(3)]
        finished = False
        while not finished and time.monotonic() < end + 30:
            time.sleep(bench.chance.uniform(0.05, 0.4))
            victim = bench.chance.randrange(3)
            for number, pid in enumerate(running):
                done, status = os.waitpid(pid, os.WNOHANG)
                finished = finished or (done and os.waitstatus_to_exitcode(status) == 0)
                if done:
                    running[number] = _builder(bench, place, number)
                elif number == victim:
                    os.kill(pid, bench.chance.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
                    row.tried += 1
        for pid in running:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        for path in place.glob("ran-*"):
            path.unlink()
        builds += 1
        bench.judge(row, place)
    row.notes.append(f"{builds} datasets")
    return row


def clocks(bench: Workbench) -> Row:
    row = Row("R16", "files of 1970 and of 2100: all hits")
    for seconds in (0, 4102444800):
        place = bench.new_place(built=True)
        for path in place.rglob("*"):
            os.utime(path, (seconds, seconds))
        row.tried += 1
        row.wrong += bench.build(place).executed != 0
        bench.judge(row, place)
    return row


def collectors(bench: Workbench) -> Row:
    place = _forsaken(bench)
    bench.shim.arm(place)
    dropped = collect(Store(place / "store"), 0)
    steps, bench.shim._root = bench.shim.steps, None
    row = Row("R19", f"collector killed at each of {steps} steps, and beside a running build")
    row.wrong += dropped.records != len(bench.project.graph) or dropped.bytes_left != 0
    for number in bench.some(steps, 1):
        place = _forsaken(bench)

        def work(place: Path = place, number: int = number) -> int:
            bench.shim.arm(place, kill_at(number))
            collect(Store(place / "store"), 0)
            return 0

        row.failed += in_fork(work) == -signal.SIGKILL
        row.tried += 1
        row.bad += bool(damage(place).incomplete)
        bench.judge(row, place)
    place = bench.new_place()
    pid = os.fork()
    if pid == 0:
        while True:
            collect(Store(place / "store"), 0)
    for _ in range(3 if bench.whole else 1):
        row.tried += 1
        row.wrong += bench.build_in_fork(place) != 0
        shutil.rmtree(place / "out")
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    bench.judge(row, place)
    return row


def _forsaken(bench: Workbench) -> Path:
    """A place whose store has a finished build that no output folder keeps from being collected."""
    place = bench.new_place(built=True)
    shutil.rmtree(place / "out")
    shutil.rmtree(place / "store/history")
    return place


def determinism(bench: Workbench) -> Row:
    row = Row("R20", "every task computed twice: other bytes")
    place = bench.new_place()
    result = build(bench.at(place), BuildOptions(jobs=2, check_percent=100), store=Store(place / "store"))
    row.tried = len(result.checked)
    row.wrong = len(result.different) + (result.exit_code != 0)
    bench.judge(row, place)
    return row


def lost_workers(bench: Workbench) -> Row:
    row = Row("R21", "worker killed in a task, driver killed and started again")
    for number in range(4 if bench.whole else 1):
        place = bench.new_place()
        killed = []

        def kill_a_worker(event, killed=killed) -> None:
            if event.name == "started" and event.kind == ("rays_tile", "image")[len(killed) % 2] and not killed:
                children = subprocess.run(
                    ["pgrep", "-P", str(os.getpid())], capture_output=True, text=True, check=False
                )
                pids = [int(pid) for pid in children.stdout.split() if _is_worker(int(pid))]
                if pids:
                    killed.append(pids[0])
                    os.kill(pids[0], signal.SIGKILL)

        if number % 2 == 0:
            row.wrong += bench.build(place, jobs=2, on_event=kill_a_worker).exit_code != 0
            row.tried += len(killed)
        else:
            pid = _builder(bench, place, 0)
            time.sleep(0.5)
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            (place / "ran-0").unlink(missing_ok=True)
            row.tried += 1
        bench.judge(row, place)
    return row


def _is_worker(pid: int) -> bool:
    try:
        return b"pipeline.engine.running.engines" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False


FAULTS = (
    killed_at_every_step,
    power_failures,
    cut_at_every_byte,
    flipped_bits,
    entries_of_another_kind,
    full_disks,
    lambda bench: errors_of_the_system(bench, "R6", "disk full (ENOSPC)", errno.ENOSPC, for_good=True, most=1),
    several_builders,
    builders_without_common_locks,
    soak,
    clocks,
    collectors,
    determinism,
    lost_workers,
    lambda bench: errors_of_the_system(bench, "R24", "I/O error (EIO), once", errno.EIO, for_good=False, most=1),
    lambda bench: errors_of_the_system(bench, "R24", "too many open files", errno.EMFILE, for_good=False, most=1),
    lambda bench: errors_of_the_system(bench, "R24", "out of memory (ENOMEM)", errno.ENOMEM, for_good=False, most=1),
    something_in_the_place_of_folders,
    flips_after_verification,
    other_numerics,
    signals_at_any_moment,
    second_users,
)

SHORT = (0, 2, 4, 6, 7, 17)
"""Rows that `make test` does too, by number; the others start processes that load everything again."""
