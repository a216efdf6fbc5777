"""The folder of a store: recognition, repair of misplaced entries, and atomic writing.

Files are written under a temporary name and then renamed, so that nobody ever finds half a file.
"""

import contextlib
import os
import re
import shutil
import socket
import stat
import time
import uuid
import weakref
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path

from pipeline.engine.digest import DIGEST
from pipeline.engine.files import chosen_place, has_other_names, is_no_file, read_regular
from pipeline.engine.locks import locked, try_lock
from pipeline.errors import EnvironmentFault
from pipeline.folders import path_flaw

VERSION = b"plenoptic-pipeline store 1\n"
"""Content of the file VERSION. A non-empty folder without it is not a store, and nothing in it is touched."""

_TABLES = {"blob": "cas/sha256", "record": "ac/v1", "lock": "lock", "log": "logs", "spec": "specs"}
"""Folder of each table, whose entries lie in subfolders named by the first two digits of their digests."""

_PARENTS = ("cas", "ac")
_NOTE_FOLDERS = ("history", "sources", "events", "index")
_FILES = ("VERSION", "gc.lock")
_FOLDERS = (*_PARENTS, *_TABLES.values(), "tmp", *_NOTE_FOLDERS)
_NAMES = {*_FOLDERS, *_FILES}
_SUBFOLDER = re.compile(r"[0-9a-f]{2}")

ABANDONED_S = 86400.0
"""Age after which a workspace of another machine counts as abandoned [s]: locks may not work between machines."""

_WORKSPACE = re.compile(r"(?P<host>.+)-\d+-[0-9a-f]{32}")
"""Names in `tmp/`, `<machine>-<pid>-<32 hex digits>`; machine names may have dashes. Nothing else in it is touched."""
_SUFFIXES = {"record": ".json", "log": ".log", "spec": ".json"}


class StoreFolder:
    """The folder of a store, its tables and its locks.

    EnvironmentFault if the folder cannot be created, or if it is neither empty nor a store.
    """

    def __init__(self, root: Path, warn: Callable[[str], None]) -> None:
        self.root = root
        self.warn = warn
        self.say_waiting = warn
        if flaw := path_flaw(self.root):
            raise EnvironmentFault(f"the path of the store {flaw}", hint="set PIPELINE_CACHE to another folder")
        self._workspace: Path | None = None  # made when first needed, removed with this object, or swept later
        with chosen_place("make or use the store", self.root):  # of which another user may let nobody see anything
            if self.root.exists() and not self.root.is_dir():
                raise EnvironmentFault(f"the store {self.root} is not a folder", hint="set PIPELINE_CACHE to a folder")
            if not self.root.is_dir():
                self.root.mkdir(parents=True, exist_ok=True)
            _require_store(self.root)
            self._mend()
            if read_regular(self.root / "VERSION") != VERSION and os.access(self.root, os.W_OK):
                self._write(self.root / "VERSION", VERSION)

    def path(self, table: str, name: str) -> Path:
        """Path of an entry. Names must be digests, so no path leads outside."""
        return Path(self._at(table, name))

    def _at(self, table: str, name: str) -> str:
        """The path as text, for thousands of look-ups: making a `Path` takes longer than the look-up."""
        if not DIGEST.fullmatch(name):
            raise ValueError(f"not a digest: {name!r}")
        return f"{self.root}/{_TABLES[table]}/{name[:2]}/{name}{_SUFFIXES.get(table, '')}"

    def single_flight(self, key: str, doing: str) -> AbstractContextManager[bool]:
        """Hold the lock of a key, so that it is computed once; `doing` is reported to waiting processes."""
        return locked(self.file_for("lock", key), doing=doing, say=self.say_waiting)

    def in_use(self) -> AbstractContextManager[bool]:
        """Context during which no process collects garbage in this store."""
        path = self.root / "gc.lock"
        if has_other_names(path):
            with contextlib.suppress(OSError):  # a read-only store
                path.unlink()
        return locked(path, timeout_s=60.0, shared=True, say=self.say_waiting)

    def file_for(self, table: str, name: str) -> Path:
        """Path of a lock or log file, existing or not; anything else at that path is moved away."""
        path = self.path(table, name)
        if is_no_file(path):
            self._clear(path)
        elif has_other_names(path):  # writing to it would change the file with the other name
            path.unlink()
        return path

    def new_path(self) -> Path:
        """A temporary path on the store's file system for this process alone; leftovers are removed later."""
        if self._workspace is None or not self._workspace.is_dir():
            self._make(self.root / "tmp")
            self._workspace, lock = _new_workspace(self.root / "tmp")
            weakref.finalize(self, _remove, self._workspace, lock)
        return self._workspace / uuid.uuid4().hex

    def sweep(self, older_than_s: float | None = None) -> int:
        """Remove workspaces of dead processes in `tmp` and count them. Folders with other names stay.

        File locks tell which processes live, not clocks or process ids. Locks may not work between machines, so
        workspaces of other machines stay unless they are older than `older_than_s`.
        """
        swept = 0
        tmp = self.root / "tmp"
        for folder in sorted(tmp.iterdir()) if tmp.is_dir() else ():
            match = _WORKSPACE.fullmatch(folder.name)
            handle = _open_folder(folder) if match else None
            if match is None or handle is None:
                continue
            age_s = max(0.0, time.time() - os.fstat(handle).st_mtime)
            is_old = older_than_s is not None and age_s >= older_than_s
            if (is_old or match["host"] == socket.gethostname()) and try_lock(handle):
                shutil.rmtree(folder, ignore_errors=True)
                swept += not folder.exists()
            os.close(handle)
        return swept

    def entries(self, table: str) -> Iterator[tuple[str, os.stat_result]]:
        """Name and file status of every entry of a table, sorted by name; other names are ignored."""
        suffix = _SUFFIXES.get(table, "")
        for folder in filter(Path.is_dir, sorted((self.root / _TABLES[table]).glob("[0-9a-f][0-9a-f]"))):
            with os.scandir(folder) as entries:
                for entry in sorted(entries, key=lambda entry: entry.name):
                    name = entry.name.removesuffix(suffix)
                    with contextlib.suppress(FileNotFoundError):  # another process has deleted it
                        if DIGEST.fullmatch(name):
                            yield name, entry.stat(follow_symlinks=False)

    def _make(self, folder: Path) -> None:
        """Make a folder of the store, moving away anything else at its path."""
        if not folder.is_dir():
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except (FileExistsError, NotADirectoryError):
                self._mend()
                folder.mkdir(parents=True, exist_ok=True)

    def _write(self, final: Path, data: bytes) -> None:
        """Write a file of the store atomically."""
        aside = self.new_path()
        aside.write_bytes(data)
        self._keep(aside, final)

    def _keep(self, aside: Path, final: Path) -> None:
        """Move a temporary file to its final path, read-only."""
        self._make(final.parent)
        aside.chmod(0o444)
        if final.is_dir() and not final.is_symlink():  # a rename replaces anything but a folder
            self._clear(final)
        aside.replace(final)

    def _clear(self, path: Path) -> None:
        """Move away whatever occupies the path of an entry, a folder or a file of the store, if we may.

        A damaged entry, recognised by its name, and an empty folder are deleted. Anything else may be somebody's, and
        is renamed.
        """
        if not os.path.lexists(path):
            return
        is_folder = path.is_dir() and not path.is_symlink()
        outcome = "deleted"
        try:
            if is_folder and not any(path.iterdir()):
                path.rmdir()
            elif DIGEST.fullmatch(path.stem) and not is_folder:
                path.unlink()
            else:
                aside = path.rename(path.with_name(f"{path.name}.{time.time_ns()}"))
                outcome = f"renamed to {aside.name}"
        except OSError:  # a read-only store keeps it
            outcome = "which cannot be removed"
        self.warn(f"damaged entry of the store, {outcome}: {path}")

    def _mend(self) -> None:
        """Move away everything that occupies the path of a folder or file of the store."""
        for path in tuple(_misplaced(self.root)):
            self._clear(path)


def _require_store(root: Path) -> None:
    """Refuse a folder that is no store of this version.

    A store that has results but lost its VERSION is accepted, and so is one whose making was interrupted: it has at
    most a beginning of VERSION and temporary files.
    """
    names = sorted(_names_in(root))
    version = read_regular(root / "VERSION") or b""
    if version == VERSION:
        return
    if version.startswith(VERSION[:-2]):
        raise EnvironmentFault(
            f"the store {root} is of another version of this program", hint="set PIPELINE_CACHE to another folder"
        )
    has_results = any((root / _TABLES[table]).is_dir() for table in ("blob", "record"))
    temporary = _names_in(root / "tmp") if _is_folder(root / "tmp") else ()
    is_begun = (
        {"VERSION", "gc.lock", "tmp"}.issuperset(names)
        and all(map(_WORKSPACE.fullmatch, temporary))
        and VERSION.startswith(version.rstrip(b"\0"))
    )
    if _NAMES.issuperset(names) and (has_results or is_begun):
        return
    content = ", ".join(names[:3]) + (" …" if len(names) > 3 else "")
    raise EnvironmentFault(
        f"{root} is no store of results: it holds {content}, and no VERSION of ours",
        hint="set PIPELINE_CACHE to a folder that is new or empty; nothing in this one was touched",
    )


def store_around(path: Path) -> Path | None:
    """The store that is this folder or contains it, with links followed; None if there is none."""
    real = Path(os.path.realpath(path))
    return next(
        (folder for folder in (real, *real.parents) if read_regular(folder / "VERSION", len(VERSION)) == VERSION), None
    )


def _misplaced(root: Path) -> Iterator[Path]:
    """Paths in a store that should be folders or files and are not: damage that no entry shows."""
    for name in _FOLDERS:
        if os.path.lexists(root / name) and not _is_folder(root / name):
            yield root / name
    for name in _FILES:
        if is_no_file(root / name):
            yield root / name
    for table in _TABLES.values():
        if _is_folder(root / table):
            with contextlib.suppress(PermissionError), os.scandir(root / table) as entries:
                wrong = [entry.name for entry in entries if _SUBFOLDER.fullmatch(entry.name) and not entry.is_dir()]
                yield from [root / table / name for name in sorted(wrong)]


def _is_folder(path: Path) -> bool:
    """Whether a path leads to a folder at present; any text is allowed."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def _names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {"lost+found"}  # an empty disk contains that folder


def _new_workspace(tmp: Path) -> tuple[Path, int]:
    """A folder of this process alone, and the descriptor that holds its lock."""
    while True:
        folder = tmp / f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex}"
        folder.mkdir()
        handle = _open_folder(folder)
        # Another process may have swept the folder before it was locked.
        if handle is not None and try_lock(handle) is not False and folder.is_dir():
            return folder, handle
        if handle is not None:
            os.close(handle)


def _open_folder(folder: Path) -> int | None:
    try:
        return os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return None


def _remove(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)
