"""The quarantine of a store, for the inspection of damaged entries: `quarantine/<time>-<name>`.

The next collection removes entries made by the store itself. Anything else that was in the way stays for ever: it may
belong to somebody.
"""

import contextlib
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

_ENTRY = re.compile(r"\d+-[0-9a-f]{64}(\.json|\.log)?")


def put_away(root: Path, path: Path) -> Path | None:
    """Move a file or folder of the store at `root` into its quarantine; its new path, or None if it cannot be moved."""
    folder = root / "quarantine"
    try:
        if os.path.lexists(folder) and not folder.is_dir():
            folder.rename(root / f"quarantine.{time.time_ns()}")
        if path == folder:
            return folder
        folder.mkdir(exist_ok=True)
        return path.rename(folder / f"{time.time_ns()}-{path.name}")
    except OSError:  # a read-only store keeps it
        return None


def entries(root: Path) -> Iterator[Path]:
    """Damaged entries in the quarantine, recognised by their names: a digest, possibly with one of our suffixes."""
    folder = root / "quarantine"
    yield from (path for path in sorted(folder.iterdir()) if _ENTRY.fullmatch(path.name)) if folder.is_dir() else ()


def empty(root: Path) -> None:
    """Remove the damaged entries. A folder that is not empty was not made by the store and stays."""
    for path in entries(root):
        with contextlib.suppress(FileNotFoundError, OSError):
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
