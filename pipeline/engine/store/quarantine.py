"""A place for damaged entries of a store, for a person to look at: `quarantine/<time>-<name>`.

What the store made itself is removed by the next collection. Anything else that stood in the way stays for ever: it may
be somebody's.
"""

import contextlib
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

from pipeline.engine.store.sharing import rights_of

_ENTRY = re.compile(r"\d+-[0-9a-f]{64}(\.json|\.log)?")


def put_away(root: Path, path: Path) -> Path | None:
    """Move a file or folder of the store at `root` into its quarantine; its new place, or None if that cannot be."""
    folder = root / "quarantine"
    try:
        if os.path.lexists(folder) and not folder.is_dir():
            folder.rename(root / f"quarantine.{time.time_ns()}")
        if path == folder:
            return folder
        rights_of(root).make_folder(folder)
        return path.rename(folder / f"{time.time_ns()}-{path.name}")
    except OSError:  # a read-only store keeps it
        return None


def entries(root: Path) -> Iterator[Path]:
    """Damaged entries that were put away, by their names: a digest, or a digest with a suffix of ours."""
    folder = root / "quarantine"
    yield from (path for path in sorted(folder.iterdir()) if _ENTRY.fullmatch(path.name)) if folder.is_dir() else ()


def empty(root: Path) -> None:
    """Remove them. A folder that holds anything was not made by the store, and stays."""
    for path in entries(root):
        with contextlib.suppress(FileNotFoundError, OSError):
            path.rmdir() if path.is_dir() and not path.is_symlink() else path.unlink()
