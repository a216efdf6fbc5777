"""Workspaces: temporary folders in the store, one per process and locked while it lives; files are written there and
then renamed.
"""

import os
import re
import shutil
import socket
import time
import uuid
import weakref
from pathlib import Path

from pipeline.engine.locks import try_lock

ABANDONED_S = 86400.0
"""Age after which a workspace of another machine counts as abandoned [s], one day: locks may not work between machines.
"""

_NAME = re.compile(r"(?P<host>.+)-\d+-[0-9a-f]{32}")  # names of machines may contain dashes


def is_workspace(name: str) -> bool:
    """Whether a name is that of a workspace, `<machine>-<pid>-<32 hex digits>`. Others are not touched."""
    return _NAME.fullmatch(name) is not None


class Workspace:
    """A folder in `tmp/`, made when first needed and removed with this object, or swept after its process has died."""

    def __init__(self, tmp: Path) -> None:
        self._tmp = tmp
        self._folder: Path | None = None

    def new_path(self) -> Path:
        """A path in the folder that nobody else uses."""
        if self._folder is None or not self._folder.is_dir():
            self._folder, lock = _locked_folder(self._tmp)
            weakref.finalize(self, _remove, self._folder, lock)
        return self._folder / uuid.uuid4().hex


def sweep(tmp: Path, older_than_s: float | None = None) -> int:
    """Remove workspaces of dead processes and count them. Folders with other names stay.

    File locks tell which processes live, not clocks or process ids. Locks may not work between machines, so workspaces
    of other machines stay unless they are older than `older_than_s`.
    """
    swept = 0
    for folder in sorted(tmp.iterdir()) if tmp.is_dir() else ():
        match = _NAME.fullmatch(folder.name)
        handle = _open_folder(folder) if match else None
        if match is None or handle is None:
            continue
        age_s = max(0.0, time.time() - os.fstat(handle).st_mtime)
        is_ours = match["host"] == socket.gethostname()
        if not is_ours and (older_than_s is None or age_s < older_than_s):
            os.close(handle)
            continue
        if try_lock(handle):
            shutil.rmtree(folder, ignore_errors=True)
            swept += not folder.exists()
        os.close(handle)
    return swept


def _locked_folder(tmp: Path) -> tuple[Path, int]:
    while True:
        folder = tmp / f"{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex}"
        tmp.mkdir(exist_ok=True)
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
