"""Locations of the shipped data and of the user's cache, unusable paths, and atomic writing."""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from pipeline.errors import EnvironmentFault

_ASIDE = 64
"""Bytes kept free in a path: more than a temporary file name adds."""


def shipped_folder(name: str) -> Path:
    """Folder `name` of the shipped data: `pipeline/_share/` in an installed wheel, beside the package in a checkout."""
    package = Path(__file__).resolve().parent
    installed = package / "_share" / name
    return installed if installed.is_dir() else package.parent / name


def user_cache() -> Path:
    """`plenoptic-pipeline/` in $XDG_CACHE_HOME, else in `.cache/` of the user's home.

    EnvironmentFault if the user has no home, as in a container that runs under a user number without a name.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "plenoptic-pipeline"
    except RuntimeError:
        raise EnvironmentFault(
            f"user {os.geteuid()} has no home: HOME is not set, and no entry of the system says where it is",
            hint="set XDG_CACHE_HOME to a folder that you may write to: results and compiled kernels are kept there",
        ) from None


def path_flaw(folder: Path, files: Iterable[str] = ()) -> str | None:
    """Reason why nothing can be read or written under a path, or under these names below it; None if there is none.

    Our texts and USD use UTF-8, and a file system limits the number of bytes.
    """
    full = str(folder.absolute())
    if "\0" in full:
        return f"holds a character that no path can hold: {str(folder)!r}"
    try:
        full.encode()
    except UnicodeEncodeError:
        with contextlib.suppress(UnicodeError):
            os.fsencode(full).decode()  # the bytes are UTF-8, but Python has decoded them by another locale
            return f"has letters that Python does not know in this locale (set PYTHONUTF8=1): {str(folder)!a}"
        return f"is not UTF-8: {str(folder)!a}"
    name_max, path_max = os.pathconf("/", "PC_NAME_MAX"), os.pathconf("/", "PC_PATH_MAX")
    if any(len(os.fsencode(name)) > name_max for name in full.split("/")):
        return f"has a name of more than {name_max} bytes"
    longest = max((os.fsencode(f"/{file}") for file in files), key=len, default=b"")
    if len(os.fsencode(full)) + len(longest) + _ASIDE > path_max:
        return f"is longer than {path_max} bytes with all that comes below it"
    return None


def put(path: Path, content: bytes) -> None:
    """Write a file atomically, unless it already has this content; a failure changes nothing."""
    if path.is_file() and path.read_bytes() == content:
        return
    aside = path.with_name(f".{os.getpid()}.new")
    try:
        aside.write_bytes(content)
        aside.replace(path)
    except BaseException:
        aside.unlink(missing_ok=True)
        raise
