"""The real pipeline at small size, a right result to compare with, and what counts as wrong."""

import dataclasses
import functools
import hashlib
import multiprocessing
import random
import re
import shutil
import tempfile
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from engine import toy
from faults.shim import Shim, in_fork

from pipeline.app.build import project
from pipeline.engine.events import silent
from pipeline.engine.options import BuildOptions, Caller
from pipeline.engine.project import Project
from pipeline.engine.records import unseal
from pipeline.engine.running.session import build
from pipeline.engine.store.store import Store
from pipeline.errors import PipelineError

STAGE = Path(__file__).parents[1] / "data/tiny_conventional/dataset.usda"


@dataclass(slots=True)
class Row:
    """A line of the table: faults that were done, builds that ended with an error that says so, which is right, and
    wrong results and damaged stores, which both must be 0.
    """

    number: str
    fault: str
    tried: int = 0
    failed: int = 0
    wrong: int = 0
    bad: int = 0
    notes: list[str] = field(default_factory=list)


class Workbench:
    """A project whose right files are known, folders for faults, and a seeded source of chance.

    It is `whole` if every place of every fault is tried, else a few; builders are killed at random for `soak_s`.
    """

    def __init__(self, folder: Path, *, whole: bool, soak_s: float = 3.0) -> None:
        self.folder, self.whole, self.soak_s = folder, whole, soak_s
        self.shim, self.chance = Shim(), random.Random(1)
        # Read in another process: this one must stay free of USD, whose threads do not survive a fork.
        with multiprocessing.get_context("spawn").Pool(1) as pool:
            self.project = pool.apply(project, (STAGE, folder))
        self.build(folder / "right")  # which compiles and loads what forks inherit
        self.right = toy.contents(folder / "right" / "out")

    def at(self, place: Path, out: str = "out") -> Project:
        return dataclasses.replace(self.project, out=place / out)

    def build(self, place: Path, *, jobs: int = 1, on_event=None, out: str = "out"):
        """Build into `out` with the store `store`, both below a place."""
        caller = Caller(on_event=on_event or silent)
        return build(self.at(place, out), BuildOptions(jobs=jobs), store=Store(place / "store"), caller=caller)

    def build_in_fork(self, place: Path, act=None, meanwhile=None, out: str = "out") -> int:
        """The same in a fork, with a fault at a step, or one that `meanwhile` arms; gives its exit code."""

        def work() -> int:
            if act is not None:
                self.shim.arm(place, act)
            if meanwhile is not None:
                meanwhile()
            try:
                return self.build(place, out=out).exit_code
            except PipelineError as error:
                return error.exit_code
            except Exception:  # the command would say: this is a bug of ours
                (self.folder / "unexpected.txt").write_text(traceback.format_exc())
                return 70

        return in_fork(work)

    def unexpected(self) -> list[str]:
        """The traceback of a fork that ended with what the command would call a bug; then it is forgotten."""
        path = self.folder / "unexpected.txt"
        found = [path.read_text()] if path.exists() else []
        path.unlink(missing_ok=True)
        return found

    def new_place(self, *, built: bool = False) -> Path:
        place = Path(tempfile.mkdtemp(dir=self.folder))
        if built:
            shutil.copytree(self.folder / "right", place, dirs_exist_ok=True, symlinks=True)
        return place

    def some(self, count: int, most: int) -> Iterator[int]:
        """Numbers from 1 to `count`: all of them, or `most` spread over them."""
        yield from (
            range(1, count + 1) if self.whole else sorted(self.chance.sample(range(1, count + 1), min(count, most)))
        )

    def judge(self, row: Row, place: Path, *, meanwhile: bool = True) -> None:
        """After a fault: nothing wrong lies about, and a build heals everything; then the place goes."""
        if meanwhile:
            row.bad += bool(damage(place).damaged)
            if (place / "out" / "manifest.json").exists():
                row.wrong += self.differs(place)
        code = self.build_in_fork(place)
        row.wrong += code != 0 or self.differs(place)
        row.notes += [f"the build after it ended with {code}"] if code else []
        found = damage(place)
        row.bad += bool(found.damaged or found.incomplete or list((place / "out").glob(".pipeline-*")))
        shutil.rmtree(place)

    def differs(self, place: Path, out: str = "out") -> bool:
        return toy.contents(place / out) != self.right

    @functools.cached_property
    def steps_of_a_build(self) -> int:
        place = self.new_place()
        self.shim.arm(place)
        self.build(place)
        steps, self.shim._root = self.shim.steps, None
        shutil.rmtree(place)
        return steps


def entries(place: Path) -> list[Path]:
    tables = (place / "store" / "ac", place / "store" / "cas")
    return [path for table in tables for path in sorted(table.rglob("*")) if path.is_file()]


class Damage(NamedTuple):
    """Entries that are not what their names or seals say, and records of files that are not there."""

    damaged: list[str]
    incomplete: list[str]


def damage(place: Path) -> Damage:
    """Every byte of the store of a place, read without the store's own code; what it has put aside is no entry."""
    aside = re.compile(r"\.\d{19}$")
    paths = [path for table in ("ac", "cas") for path in (place / "store" / table).rglob("*") if not path.is_dir()]
    paths = [path for path in paths if not aside.search(path.name)]
    content = {path.name: path.read_bytes() if path.is_file() else b"" for path in paths}
    records = {name: unseal(data) for name, data in content.items() if name.endswith(".json")}
    blobs = {name for name in content.keys() - records if hashlib.sha256(content[name]).hexdigest() == name}
    damaged = [name for name in content if name not in blobs and not records.get(name)]
    needed = {name: [one["sha256"] for one in record["outputs"].values()] for name, record in records.items() if record}
    return Damage(damaged, [name for name, outputs in needed.items() if not blobs.issuperset(outputs)])
