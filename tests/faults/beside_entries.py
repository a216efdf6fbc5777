"""Faults beside the entries of the store: things of others, and bytes that change after they were verified.

Every function does one row of the table, as in `catalogue`.
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

from faults.workbench import Row, Workbench

from pipeline.engine.store import store as store_module
from pipeline.engine.store.store import Store

_FOLDERS = ("cas", "cas/sha256", "ac", "ac/v1", "lock", "tmp", "logs", "history", "sources", "index")
_FILES = ("VERSION", "gc.lock")


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
