"""Reasons why a path chosen by the user cannot be used."""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

_ASIDE = 64  # longer than what is added while files are put into place


def flaw_of(folder: Path, files: Iterable[str] = ()) -> str | None:
    """The reason why nothing can be read or written under a path, or under names below it; None if no problem is
    known.

    Our texts and USD use UTF-8, and a file system limits the number of bytes.
    """
    whole = str(folder.absolute())
    if "\0" in whole:
        return f"holds a character that no path can hold: {str(folder)!r}"
    try:
        whole.encode()
    except UnicodeEncodeError:
        with contextlib.suppress(UnicodeError):
            os.fsencode(whole).decode()
            return f"has letters that Python does not know in this locale (set PYTHONUTF8=1): {str(folder)!a}"
        return f"is not UTF-8: {str(folder)!a}"
    name_max, path_max = os.pathconf("/", "PC_NAME_MAX"), os.pathconf("/", "PC_PATH_MAX")
    if any(len(os.fsencode(name)) > name_max for name in whole.split("/")):
        return f"has a name of more than {name_max} bytes"
    longest = max((os.fsencode(f"/{file}") for file in files), key=len, default=b"")
    if len(os.fsencode(whole)) + len(longest) + _ASIDE > path_max:
        return f"is longer than {path_max} bytes with all that comes below it"
    return None
