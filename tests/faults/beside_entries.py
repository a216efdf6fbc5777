"""Faults beside the entries of the store: things of others, kernels, and bytes that change after they were verified.

Every function does one row of the table, as in `catalogue`.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from faults.workbench import STAGE, Row, Workbench

from pipeline.app.build import steps_of
from pipeline.engine.store import store as store_module
from pipeline.engine.store.store import Store
from pipeline.jit import files
from pipeline.jit.decorators import cache_folder
from pipeline.machine.facts import command

_FOLDERS = ("cas", "cas/sha256", "ac", "ac/v1", "lock", "tmp", "logs", "history", "sources", "index")
_FILES = ("VERSION", "gc.lock")


def damaged_kernels(bench: Workbench) -> Row:
    """Every state of every kernel is noticed before it is unpickled; in the whole run, builds compile them again."""
    row = Row("R25", "kernel cache: empty, cut, zeros, swapped, flipped, a folder")
    called = _called(bench)  # compiles what is missing, before the copy
    folder = bench.new_place() / "jit" / cache_folder().name
    shutil.copytree(cache_folder(), folder)
    closed = [kernel for kernel in folder.iterdir() if files.is_whole(kernel)]  # others may be compiling now
    kernels = sorted(path for kernel in closed for path in kernel.rglob("*") if path.is_file() and path.stat().st_size)
    assert len(kernels) > len(called)
    for number, path in list(enumerate(kernels))[:: 1 if bench.whole else 8]:
        whole, kernel = path.read_bytes(), folder / path.relative_to(folder).parts[0]
        flips = [_flipped(bench, whole) for _ in range(24 if bench.whole else 2)]
        for data in (
            b"",
            whole[:-1],
            whole[: len(whole) // 2],
            bytes(len(whole)),
            kernels[number - 1].read_bytes(),
            *flips,
        ):
            path.write_bytes(data)
            row.tried += 1
            row.wrong += files.is_whole(kernel)
        path.write_bytes(whole)
        row.wrong += not files.is_whole(kernel)
    code = (next((folder / name).rglob("*.nbc")) for name in called)
    small = sorted(code, key=lambda path: path.stat().st_size)[:3]  # they compile fast
    for path in small if bench.whole else ():
        for damage in (lambda path: path.write_bytes(b""), lambda path: (path.unlink(), path.mkdir())):
            damage(path)
            codes = [_command(bench, folder.parent, path.parents[1], said) for said in (True, False)]
            path = next(path.parents[1].rglob("*.nbc"))
            row.tried += 1
            row.wrong += codes != [0, 0]
    return row


def _called(bench: Workbench) -> list[str]:
    """Folders of the kernels that a build of the stage calls; it looks at no others."""
    graph = bench.project.graph
    steps = steps_of(graph[name] for name in graph)
    asked = [command("pipeline.app.compile_kernels:compile_apart", share, *steps) for share in ("0", "1")]
    names = {name for words in asked for name in subprocess.check_output(words, text=True).split()}
    return [name for name in names if (cache_folder() / name).is_dir()]


def _command(bench: Workbench, kernels: Path, damaged: Path, is_said: bool) -> int:
    """A cold build by a process that has loaded nothing; 0 if it is right, and says what was damaged just this once."""
    place = bench.new_place()
    settings = {
        **os.environ,
        "PIPELINE_REPORT": "no",
        "PIPELINE_JIT_CACHE": str(kernels),
        "PIPELINE_CACHE": str(place / "store"),
    }
    command = [sys.executable, "-m", "pipeline.cli", "build", str(STAGE), "-j1", "-o", str(place / "out")]
    done = subprocess.run(command, env=settings, capture_output=True, text=True, check=False)
    right = (damaged.name in done.stderr) == is_said and "Traceback" not in done.stderr
    return done.returncode if right and not bench.differs(place) else 99


def something_in_the_place_of_folders(bench: Workbench) -> Row:
    row = Row("R26", "a file or link where the store has a folder, or the reverse")
    makers = {"file": lambda path: path.write_text("x"), "link": lambda path: path.symlink_to("/nonexistent")}
    shards = [
        path.relative_to(bench.folder / "right/store")
        for table in ("cas/sha256", "ac/v1", "lock")
        for path in sorted((bench.folder / "right/store" / table).iterdir())
    ]
    cases = [(name, maker) for name in (*_FOLDERS, *shards) for maker in makers.values()]
    cases += [(name, Path.mkdir) for name in _FILES]
    for number in bench.some(len(cases), 2):
        name, make = cases[number - 1]
        place = bench.new_place(built=True)
        shutil.rmtree(place / "out")
        path = place / "store" / name
        shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
        make(path)
        row.tried += 1
        bench.judge(row, place, meanwhile=False)
    return row


def flips_after_verification(bench: Workbench) -> Row:
    """One bit of an input, after it was hashed and before the task opens it; and of a result, before it is copied."""
    row = Row("R27", "a bit that flips between the look at a blob and its use")
    for what, count in (("input", len(bench.project.graph)), ("copy", len(bench.project.files))):
        for number in bench.some(count, 1):
            place = bench.new_place(built=what == "copy")
            shutil.rmtree(place / "out", ignore_errors=True)
            row.tried += 1
            code = bench.build_in_fork(place, meanwhile=_flipping(bench, what, number))
            row.wrong += code != 0 or bench.differs(place)
            bench.judge(row, place)
    return row


def _flipping(bench: Workbench, what: str, number: int) -> Callable[[], None]:
    """Makes the n-th input of a task, or the n-th copy, meet another byte; size and mtime stay."""
    chance, calls = bench.chance.random(), []

    def flip(path: Path) -> None:
        whole, times = bytearray(path.read_bytes()), path.stat()
        whole[int(chance * len(whole))] ^= 1
        path.chmod(0o644)
        path.write_bytes(whole)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))

    def verified(self: Store, digest: str, real=Store.verified):
        found = real(self, digest)
        calls.append(1)
        if len(calls) == number:
            flip(found.path)
        return found

    def copy(source: Path, target: Path, real=store_module.copy) -> None:
        calls.append(1)
        if len(calls) == number:
            flip(source)
        real(source, target)

    def arm() -> None:
        if what == "input":
            Store.verified = verified
        else:
            store_module.copy = copy

    return arm


def _flipped(bench: Workbench, whole: bytes) -> bytes:
    data = bytearray(whole)
    data[bench.chance.randrange(len(data))] ^= 1 << bench.chance.randrange(8)
    return bytes(data)
