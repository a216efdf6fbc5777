"""Memory of an output folder in the store: the bytes that we put there, and how files looked when we knew them.

A file is ours only if its bytes are those that we put under its name: whatever else it holds is somebody's. A file that
still looks the same need not be read again. Only what was certain is remembered: a file that somebody else may have
written to since is read again next time.
"""

import hashlib
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.engine.digest import DIGEST, key_of
from pipeline.engine.files import Signature, digest_of, read_regular, signature
from pipeline.engine.output import manifest
from pipeline.engine.store.store import Store
from pipeline.errors import UsageError

_CLOCK_TICK_NS = 20_000_000
"""Tick of the time stamps of a file system [ns], generously: two writes within one cannot be told apart."""


class Seen:
    """The note of one output folder.

    Parameters
    ----------
    stage_id : str
        The stage that is built now: what the output folder cannot say, because no path of a machine stands in it.

    Attributes
    ----------
    ours : dict
        Path -> digests of the bytes that we put there: one, or before and after a delivery that was cut short. Of a
        folder that was moved or copied, what we put into the place where it was.
    """

    def __init__(self, out: Path, store: Store, stage_id: str = "") -> None:
        self._out, self._store, self._stage = out, store, stage_id
        self._note = store.read_facts("index", name_of(out))
        self._looks: dict[str, Signature] = self._note.get("looks", {})
        self._before = self._looks
        self.ours = _delivered(self._note) or _delivered(_moved_here(out, store))
        self._settled_ns = time.time_ns() - _CLOCK_TICK_NS
        self._certain: dict[str, Signature] = {}
        self._aside: dict[str, Signature] = {}
        self._read: dict[str, tuple[Signature, str | None]] = {}

    def require_same_stage(self) -> None:
        """Refuse a folder that files of another stage lie in.

        Raises
        ------
        UsageError
        """
        other = self._note.get("stage") or self._stage
        if other == self._stage or not Path(other).exists():  # a stage that was moved is no other one
            return
        if any(os.path.lexists(f"{self._out}/{path}") for path in self.ours):
            raise UsageError(
                f"{self._out} holds a build of another stage: {other}, not {self._stage}",
                hint="choose another folder with -o, or delete that one",
            )

    def is_ours(self, path: str) -> bool:
        """Whether a file holds the bytes that we put there."""
        return path in self.ours and self.digest(path) in self.ours[path]

    def digest(self, path: str) -> str | None:
        """Digest of a file; read again unless it looks exactly as when its bytes were last known."""
        target = f"{self._out}/{path}"
        try:
            looks = signature(os.lstat(target))
        except OSError:
            return None
        is_known = self._looks.get(path) == looks and path in self.ours
        if is_known or looks[3] < self._settled_ns:  # looks from before it is read: what is written then shows
            self._certain[path] = looks
        if is_known:
            return self.ours[path][0]
        if path not in self._read or self._read[path][0] != looks:
            self._read[path] = looks, digest_of(target)
        return self._read[path][1]

    def wrote(self, path: str, aside: Path) -> None:
        """A file has been written aside, to come to `path`."""
        self._aside[path] = signature(os.lstat(aside))

    def placed(self, path: str) -> None:
        """It has been renamed: only its ctime may be another one, and later by so much that no write hides between."""
        aside, now = self._aside.pop(path), signature(os.lstat(self._out / path))
        self._certain.pop(path, None)
        if now[:3] == aside[:3] and now[3] - now[2] > _CLOCK_TICK_NS:
            self._certain[path] = now

    def begin(self, digests: Mapping[str, str]) -> None:
        """Files with these digests are about to be put into place: no looks count until `keep`."""
        both = {path: [digest] for path, digest in digests.items()}
        for path, before in self.ours.items():
            both[path] = list(dict.fromkeys([*both.get(path, []), *before]))
        self._write({"looks": {}, "ours": both})

    def keep(self, digests: Mapping[str, str], *, whole: bool = True) -> None:
        """Remember that the folder holds these bytes, and the looks of files that nobody has touched meanwhile.

        After a partial delivery, not `whole`, other files of ours but the manifest stay ours, as they looked before.
        """
        now = {path: signature(os.lstat(f"{self._out}/{path}")) for path in digests}
        looks = {path: seen for path, seen in now.items() if seen == self._certain.get(path)}
        ours = {path: [digest] for path, digest in digests.items()}
        if not whole:
            rest = {path: known for path, known in self.ours.items() if path not in {*digests, manifest.NAME}}
            ours |= rest
            looks |= {path: seen for path, seen in self._before.items() if path in rest}
        self._write({"looks": looks, "ours": ours})

    def _write(self, note: dict[str, Any]) -> None:
        note["stage"] = self._stage
        if note != self._note:
            self._store.write_note("index", name_of(self._out), note)
            self._note = note
        self._looks, self.ours = note["looks"], note["ours"]


def name_of(out: Path) -> str:
    """Name of a folder's note and of its lock in the store, the same by whichever links one comes to the folder."""
    return key_of("out/v1", os.path.realpath(out))


def _delivered(note: dict[str, Any]) -> dict[str, list[str]]:
    """Paths and digests of a note, without anything that is none."""
    ours = note.get("ours")
    return {
        path: [digest for digest in digests if isinstance(digest, str) and DIGEST.fullmatch(digest)]
        for path, digests in (ours.items() if isinstance(ours, dict) else ())
        if manifest.is_plain_path(path) and isinstance(digests, list)
    }


def _moved_here(out: Path, store: Store) -> dict[str, Any]:
    """The note of another folder into which we put the very manifest that lies in this one; empty if there is none.

    A manifest alone is no evidence: anybody can write one that lists files of somebody else.
    """
    data = read_regular(out / manifest.NAME)
    digest = None if data is None else hashlib.sha256(data).hexdigest()
    notes = (store.read_facts("index", name) for name in (store.notes("index") if digest else ()))
    return next((note for note in notes if digest in _delivered(note).get(manifest.NAME, ())), {})
