"""The folder of a store: creating or refusing it, repairing it if something stands in the place of a folder or file,
writing.

Files are written under a temporary name and then renamed, so that nobody ever finds half a file.
"""

import contextlib
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.engine.digest import DIGEST
from pipeline.engine.files import chosen_place, has_other_names, is_no_file, read_regular
from pipeline.engine.locks import Errand, locked
from pipeline.engine.store.structure import TABLES, VERSION, misplaced, require_store
from pipeline.engine.store.workspace import Workspace, sweep
from pipeline.errors import EnvironmentFault
from pipeline.folders import flaw_of

_QUARANTINED = re.compile(r"\d+-[0-9a-f]{64}(\.json|\.log)?")
_SUFFIXES = {"record": ".json", "log": ".log", "spec": ".json"}


class StoreFolder:
    """The folder of a store, its tables and its locks.

    Attributes
    ----------
    displaced : tuple of str
        Names of things that stood in the place of a folder or file and went to quarantine when the store was opened.
    counts : Counter
        Number of entries moved to quarantine (`damaged`), and of keys with two results (`nondeterministic`).

    Raises
    ------
    EnvironmentFault
        The folder cannot be created, or it is neither empty nor a store.
    """

    def __init__(self, root: Path, warn: Callable[[str], None]) -> None:
        self.root, self.warn = root, warn
        self.counts: Counter[str] = Counter()
        if flaw := flaw_of(self.root):
            raise EnvironmentFault(f"the path of the store {flaw}", hint="set PIPELINE_CACHE to another folder")
        if self.root.exists() and not self.root.is_dir():
            raise EnvironmentFault(f"the store {self.root} is not a folder", hint="set PIPELINE_CACHE to a folder")
        with chosen_place("make the store", self.root):
            if not self.root.is_dir():
                self.root.mkdir(parents=True, exist_ok=True)
            require_store(self.root)
        self._workspace = Workspace(self.root / "tmp")
        self.displaced = self._mend()
        if read_regular(self.root / "VERSION") != VERSION and os.access(self.root, os.W_OK):
            with chosen_place("make the store", self.root):
                self._write(self.root / "VERSION", VERSION)

    def path(self, table: str, name: str) -> Path:
        """Path of an entry. Names must be digests, so no path leads outside."""
        return Path(self._at(table, name))

    def _at(self, table: str, name: str) -> str:
        """The path as text, for thousands of look-ups: making a `Path` takes longer than the look-up."""
        if not DIGEST.fullmatch(name):
            raise ValueError(f"not a digest: {name!r}")
        return f"{self.root}/{TABLES[table]}/{name[:2]}/{name}{_SUFFIXES.get(table, '')}"

    @contextlib.contextmanager
    def single_flight(self, key: str, doing: str) -> Iterator[bool]:
        """Hold the lock of a key, so that two builders compute it only once; `doing` describes the work to those who
        wait.
        """
        with locked(self.file_for("lock", key), errand=Errand(doing=doing, say=self.say_waiting)) as held:
            yield held

    def say_waiting(self, text: str) -> None:
        """Report the process for which this one waits."""
        self.warn(text)

    @contextlib.contextmanager
    def in_use(self) -> Iterator[bool]:
        """Context during which no process collects garbage in this store."""
        errand = Errand(say=self.say_waiting)
        if has_other_names(self.root / "gc.lock"):
            with contextlib.suppress(OSError):  # a read-only store
                (self.root / "gc.lock").unlink()
        with locked(self.root / "gc.lock", timeout_s=60.0, shared=True, errand=errand) as held:
            yield held

    def file_for(self, table: str, name: str) -> Path:
        """Path of a lock or log file, present or future; anything else in its place is moved to quarantine."""
        path = self.path(table, name)
        if is_no_file(path):
            self._quarantine(path)
        elif has_other_names(path):  # writing to it would change the file with the other name
            path.unlink()
        return path

    def new_path(self) -> Path:
        """A temporary path on the store's file system for this process alone; leftovers are removed later."""
        try:
            return self._workspace.new_path()
        except (FileExistsError, NotADirectoryError):
            self._mend()
            return self._workspace.new_path()

    def sweep(self, older_than_s: float | None = None) -> int:
        """Remove leftovers of dead processes in `tmp`; see `workspace.sweep`."""
        return sweep(self.root / "tmp", older_than_s)

    def entries(self, table: str) -> Iterator[tuple[str, os.stat_result]]:
        """Name and file status of every entry of a table, sorted by name; other names are ignored."""
        suffix = _SUFFIXES.get(table, "")
        for folder in filter(Path.is_dir, sorted((self.root / TABLES[table]).glob("[0-9a-f][0-9a-f]"))):
            with os.scandir(folder) as found:
                for entry in sorted(found, key=lambda entry: entry.name):
                    name = entry.name.removesuffix(suffix)
                    with contextlib.suppress(FileNotFoundError):  # another process has moved it to quarantine
                        if DIGEST.fullmatch(name):
                            yield name, entry.stat(follow_symlinks=False)

    def _write(self, final: Path, data: bytes) -> None:
        aside = self.new_path()
        aside.write_bytes(data)
        self._keep(aside, final)

    def _keep(self, aside: Path, final: Path) -> None:
        if not final.parent.is_dir():
            try:
                final.parent.mkdir(parents=True, exist_ok=True)
            except (FileExistsError, NotADirectoryError):
                self._mend()
                final.parent.mkdir(parents=True, exist_ok=True)
        aside.chmod(0o444)
        if final.is_dir() and not final.is_symlink():  # a rename replaces anything but a folder
            self._quarantine(final)
        aside.replace(final)

    def quarantined(self) -> list[Path]:
        """Damaged entries that were moved away for inspection, recognised by their names: the time and a digest.

        Anything else in the quarantine was in the way, may belong to somebody, and stays for ever.
        """
        return sorted(path for path in (self.root / "quarantine").glob("*") if _QUARANTINED.fullmatch(path.name))

    def _quarantine(self, path: Path) -> None:
        """Move a damaged or misplaced entry to quarantine, if it exists and we may."""
        if not os.path.lexists(path):
            return
        self.counts["damaged"] += 1
        folder, done = self.root / "quarantine", "moved to quarantine"
        try:
            if os.path.lexists(folder) and not folder.is_dir():
                folder.rename(self.root / f"quarantine.{time.time_ns()}")
            if path != folder:
                folder.mkdir(exist_ok=True)
                path.rename(folder / f"{time.time_ns()}-{path.name}")
        except OSError:  # a read-only store keeps it
            done = "which cannot be moved away"
        self.warn(f"damaged entry of the store, {done}: {path}")

    def _mend(self) -> tuple[str, ...]:
        """Move everything that stands in the place of a folder of the store to quarantine; returns the names."""
        found = tuple(misplaced(self.root))
        for path in found:
            self._quarantine(path)
        return tuple(path.relative_to(self.root).as_posix() for path in found)
