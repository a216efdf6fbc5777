"""Note about an output folder, kept in the store: digests of the files that we wrote, and their signatures.

A file is ours only if it holds the bytes that we wrote under its name. A file with an unchanged signature need not be
read again. Only certain signatures are kept: a file that somebody may have written to since is read again next time.
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
"""Resolution of the time stamps of a file system [ns], generously: two writes within it cannot be told apart."""


class Seen:
    """The note about one output folder.

    Parameters
    ----------
    stage_id : str
        Identity of the stage that is built now. It is not in the output folder, which holds no path of a machine.

    Attributes
    ----------
    ours : dict
        Path -> digests of the bytes that we wrote: one, or two (before and after) if a delivery was interrupted. For a
        folder that was moved or copied they are taken from its old place.
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
        """Refuse a folder that holds files of another stage.

        Raises
        ------
        UsageError
        """
        other = self._note.get("stage") or self._stage
        if other == self._stage or not Path(other).exists():  # a stage that was moved is the same stage
            return
        if any(os.path.lexists(f"{self._out}/{path}") for path in self.ours):
            raise UsageError(
                f"{self._out} holds a build of another stage: {other}, not {self._stage}",
                hint="choose another folder with -o, or delete that one",
            )

    def is_ours(self, path: str) -> bool:
        """Whether a file holds the bytes that we wrote."""
        return path in self.ours and self.digest(path) in self.ours[path]

    def digest(self, path: str) -> str | None:
        """Digest of a file, which is read again unless its signature is the one noted with a known digest."""
        target = f"{self._out}/{path}"
        try:
            looks = signature(os.lstat(target))
        except OSError:
            return None
        is_known = self._looks.get(path) == looks and path in self.ours
        if is_known or looks[3] < self._settled_ns:  # the signature from before reading: a later write changes it
            self._certain[path] = looks
        if is_known:
            return self.ours[path][0]
        if path not in self._read or self._read[path][0] != looks:
            self._read[path] = looks, digest_of(target)
        return self._read[path][1]

    def wrote(self, path: str, aside: Path) -> None:
        """Note a new file, written aside, which will be moved to `path`."""
        self._aside[path] = signature(os.lstat(aside))

    def placed(self, path: str) -> None:
        """Note that it was renamed. Only its ctime may have changed, and by too little for a write in between."""
        aside, now = self._aside.pop(path), signature(os.lstat(self._out / path))
        self._certain.pop(path, None)
        if now[:3] == aside[:3] and now[3] - now[2] > _CLOCK_TICK_NS:
            self._certain[path] = now

    def begin(self, digests: Mapping[str, str]) -> None:
        """Note the digests of files that are about to be put into place. No signature counts until `keep`."""
        both = {path: [digest] for path, digest in digests.items()}
        for path, before in self.ours.items():
            both[path] = list(dict.fromkeys([*both.get(path, []), *before]))
        self._write({"looks": {}, "ours": both})

    def keep(self, digests: Mapping[str, str], *, whole: bool = True) -> None:
        """Note that the folder holds these bytes, with the signatures of files that nobody has touched meanwhile.

        After a partial delivery (not `whole`) our other files, except the manifest, remain ours with their old
        signatures.
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
    """Name of a folder's note and lock in the store; it does not depend on links in the path."""
    return key_of("out/v1", os.path.realpath(out))


def _delivered(note: dict[str, Any]) -> dict[str, list[str]]:
    """Paths and digests of a note; invalid entries are left out."""
    ours = note.get("ours")
    return {
        path: [digest for digest in digests if isinstance(digest, str) and DIGEST.fullmatch(digest)]
        for path, digests in (ours.items() if isinstance(ours, dict) else ())
        if manifest.is_plain_path(path) and isinstance(digests, list)
    }


def _moved_here(out: Path, store: Store) -> dict[str, Any]:
    """The note of another folder that received the same manifest from us; empty if there is none.

    A manifest alone proves nothing: anybody can write one that lists foreign files.
    """
    data = read_regular(out / manifest.NAME)
    digest = None if data is None else hashlib.sha256(data).hexdigest()
    notes = (store.read_facts("index", name) for name in (store.notes("index") if digest else ()))
    return next((note for note in notes if digest in _delivered(note).get(manifest.NAME, ())), {})
