"""Structure of a store: recognising one, and finding misplaced folders and files in it."""

import contextlib
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path

from pipeline.engine.files import is_no_file, read_regular
from pipeline.engine.store.workspace import is_workspace
from pipeline.errors import EnvironmentFault

VERSION = b"plenoptic-pipeline store 1\n"
"""Content of the file VERSION. A folder without it that is not empty is not a store, and nothing in it is touched."""

TABLES = {"blob": "cas/sha256", "record": "ac/v1", "lock": "lock", "log": "logs", "spec": "specs"}

_PARENTS = ("cas", "ac")
_OTHERS = ("tmp", "quarantine", "history", "sources", "events", "index")
_FILES = ("VERSION", "gc.lock")
FOLDERS = (*_PARENTS, *TABLES.values(), *_OTHERS)
_NAMES = {*_PARENTS, *TABLES.values(), *_OTHERS, *_FILES}
_BEGUN = {"VERSION", "gc.lock", "tmp"}
_SHARD = re.compile(r"[0-9a-f]{2}")


def require_store(root: Path) -> None:
    """Refuse a folder that is neither empty nor a store.

    Raises
    ------
    EnvironmentFault
        The folder is refused; the hint tells what to do. Nothing was touched.
    """
    names = sorted(_listed(root))
    if not names or is_store(root):
        return
    says = (read_regular(root / "VERSION") or b"").split(b" store ")
    if len(says) == 2 and VERSION.startswith(says[0]):
        raise EnvironmentFault(
            f"the store {root} is of another version of this program", hint="set PIPELINE_CACHE to another folder"
        )
    shown = ", ".join(names[:3]) + (" …" if len(names) > 3 else "")
    raise EnvironmentFault(
        f"{root} is no store of results: it holds {shown}, and no VERSION of ours",
        hint="set PIPELINE_CACHE to a folder that is new or empty; nothing in this one was touched",
    )


def is_store(root: Path) -> bool:
    """Whether a folder is a store of this version, including one that lost its VERSION or was never finished."""
    said = read_regular(root / "VERSION")
    if said == VERSION:
        return True
    names = _listed(root)
    if not names <= _NAMES or (said is not None and b" store " in said):
        return False
    if any((root / TABLES[table]).is_dir() for table in ("blob", "record")):
        return True
    begun = said is None or VERSION.startswith(said.rstrip(b"\0")) or said == b"1\n"
    return (
        bool(names)
        and begun
        and names <= _BEGUN
        and all(is_workspace(name) for name in (_listed(root / "tmp") if is_folder(root / "tmp") else ()))
    )


def store_around(path: Path) -> Path | None:
    """The store that a folder is or lies in, with links followed; None if there is none."""
    real = Path(os.path.realpath(path))
    return next(
        (folder for folder in (real, *real.parents) if read_regular(folder / "VERSION", len(VERSION)) == VERSION), None
    )


def misplaced(root: Path) -> Iterator[Path]:
    """Paths in a store that should be folders or files and are not: damage that no entry shows."""
    for name in FOLDERS:
        if os.path.lexists(root / name) and not is_folder(root / name):
            yield root / name
    for name in _FILES:
        if is_no_file(root / name):
            yield root / name
    for table in TABLES.values():
        if is_folder(root / table):
            with contextlib.suppress(PermissionError), os.scandir(root / table) as found:
                wrong = [entry.name for entry in found if _SHARD.fullmatch(entry.name) and not entry.is_dir()]
                yield from [root / table / name for name in sorted(wrong)]


def is_folder(path: Path) -> bool:
    """Whether a path leads to a folder at present; any text is allowed."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def _listed(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()} - {"lost+found"}  # an empty disk contains that folder
