"""What the store remembers of an output folder: which files are ours, and how they looked when their bytes were known.

A file that still looks the same need not be read again. Only what was certain is remembered: a file that somebody
else may have written to since is read again next time.
"""

import os
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from pipeline.engine import manifest
from pipeline.engine.digest import key_of
from pipeline.engine.files import Signature, digest_of, signature
from pipeline.engine.store import Store

_CLOCK_TICK_NS = 20_000_000  # file systems stamp times in ticks: two writes within one cannot be told apart


class Seen:
    """The note of one output folder.

    Attributes
    ----------
    is_known : bool
        Whether there is a note, even a damaged one: then a build of ours was here.
    ours : set of str
        Files that we made; also after a delivery that was cut short, when there is no manifest.
    """

    def __init__(self, out: Path, store: Store) -> None:
        self._out, self._store = out, store
        self.is_known = store.note_time_ns("index", name_of(out)) > 0
        self._note: dict[str, Any] = store.read_note("index", name_of(out)) or {}
        self._before: dict[str, Any] = self._note.get("looks", {})
        self.ours = set(filter(manifest.is_plain_path, self._note.get("ours", [])))
        self._settled_ns = time.time_ns() - _CLOCK_TICK_NS
        self._certain: dict[str, Signature] = {}

    def digest(self, path: str) -> str | None:
        """Digest of a file; read again unless it looks exactly as when its bytes were last known."""
        target = f"{self._out}/{path}"
        try:
            looks = signature(os.lstat(target))
        except OSError:
            return None
        known = self._note.get("looks", {}).get(path)
        is_known = known is not None and known[0] == looks
        if is_known or looks[3] < self._settled_ns:  # looks from before it is read: what is written then shows
            self._certain[path] = looks
        return str(known[1]) if is_known else digest_of(target)

    def wrote(self, path: str, aside: Path) -> None:
        """A file has been written aside, to come to `path`."""
        self._certain[path] = signature(os.lstat(aside))

    def placed(self, path: str) -> None:
        """It has been renamed: only its ctime may be another one, and later by so much that no write hides between."""
        aside, now = self._certain.pop(path), signature(os.lstat(self._out / path))
        if now[:3] == aside[:3] and now[3] - now[2] > _CLOCK_TICK_NS:
            self._certain[path] = now

    def begin(self, ours: Iterable[str]) -> None:
        """Files are about to be put into place: no looks count until `keep`."""
        self._write({"looks": {}, "ours": sorted(ours)})

    def keep(self, entries: Mapping[str, Mapping[str, Any]], others: Iterable[str] = ()) -> None:
        """Remember that the folder holds these files, and the looks of those that nobody has touched meanwhile.

        `others` are files of ours that a partial delivery left alone: they stay ours, with the looks known before.
        """
        now = {path: signature(os.lstat(f"{self._out}/{path}")) for path in entries}
        certain = {path: looks for path, looks in now.items() if looks == self._certain.get(path)}
        known = {path: [looks, entries[path]["sha256"]] for path, looks in certain.items()}
        known |= {path: self._before[path] for path in others if path in self._before}
        self._write({"looks": known, "ours": sorted({*entries, *others})})

    def _write(self, note: dict[str, Any]) -> None:
        if note != self._note:
            self._store.write_note("index", name_of(self._out), note)
            self._note = note


def name_of(out: Path) -> str:
    """Name of a folder's note and of its lock in the store, the same by whichever links one comes to the folder."""
    return key_of("out/v1", os.path.realpath(out))
