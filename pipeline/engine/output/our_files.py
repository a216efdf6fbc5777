"""Our files in an output folder: those that still hold the bytes that we wrote under their names.

A note in the store, one for each output folder, holds the digests of these bytes and the signatures of the files that
were read: a file with an unchanged signature is not read again.
"""

import hashlib
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.engine.digest import key_of
from pipeline.engine.files import CTIME, Signature, digest_of, read_regular, signature
from pipeline.engine.output import manifest
from pipeline.engine.store.store import Store
from pipeline.errors import UsageError

_CLOCK_TICK_NS = 20_000_000
"""Resolution of the time stamps of a file system [ns], generously: two writes within it cannot be told apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Note:
    """The stage of an output folder, `OurFiles.digests` (`ours`), and signature and digest of the files that were read
    (`looks`).
    """

    stage: str = ""
    ours: dict[str, list[str]] = field(default_factory=dict)
    looks: dict[str, tuple[Signature, str]] = field(default_factory=dict)


class OurFiles:
    """Our files in one output folder: `path in ours`.

    `digests` are those of the bytes that we wrote, by path: one, or two (after and before) if a delivery was
    interrupted. For a folder that was moved or copied they are taken from its old location.
    """

    def __init__(self, out: Path, store: Store, stage_id: str = "") -> None:
        self._out, self._store, self._stage = out, store, stage_id
        self._note = store.read_record(_Note, "index", name_of(out)) or _Note()
        self.digests = self._note.ours or _moved_here(out, store)
        self._read: dict[str, tuple[Signature, str | None]] = dict(self._note.looks)
        self._settled_ns = time.time_ns() - _CLOCK_TICK_NS

    @property
    def stage(self) -> str:
        """The stage that was built into the folder; empty if the store does not know."""
        return self._note.stage

    def require_same_stage(self) -> None:
        """Refuse a folder that holds files of another stage; UsageError."""
        other = self._note.stage or self._stage
        if other == self._stage or not Path(other).exists():  # a stage that was moved is the same stage
            return
        if any(os.path.lexists(f"{self._out}/{path}") for path in self.digests):
            raise UsageError(
                f"{self._out} holds a build of another stage: {other}, not {self._stage}",
                hint="choose another folder with -o, or delete that one",
            )

    def __contains__(self, path: str) -> bool:
        return path in self.digests and self.digest(path) in self.digests[path]

    def digest(self, path: str) -> str | None:
        """Digest of a file, read again only after somebody wrote to it; None if there is none."""
        target = f"{self._out}/{path}"
        try:
            current = signature(os.lstat(target))
        except OSError:
            return None
        if path not in self._read or self._read[path][0] != current:
            self._read[path] = current, digest_of(target)
        return self._read[path][1]

    def begin(self, digests: Mapping[str, str]) -> None:
        """Note the digests of files that are about to be put into place, beside those of our present files."""
        both = {path: [digest] for path, digest in digests.items()}
        for path, before in self.digests.items():
            both[path] = list(dict.fromkeys([*both.get(path, []), *before]))
        self._write(both)

    def keep(self, digests: Mapping[str, str], *, complete: bool = True) -> None:
        """Note that the folder holds these bytes; if they are not `complete`, our other files but the manifest, too."""
        present = {path: [digest] for path, digest in digests.items()}
        if not complete:
            present = {path: old for path, old in self.digests.items() if path != manifest.NAME} | present
        self._write(present)

    def _write(self, digests: dict[str, list[str]]) -> None:
        """Write the note with these digests, and the signatures that can be trusted later."""
        looks = {
            path: (signature, digest)
            for path, (signature, digest) in self._read.items()
            if digest is not None and digest in digests.get(path, ())
            if signature[CTIME] < self._settled_ns  # whoever writes to it later changes its signature
        }
        note = _Note(stage=self._stage, ours=digests, looks=looks)
        if note != self._note:
            self._store.write_note("index", name_of(self._out), note)
        self._note, self.digests = note, digests


def name_of(out: Path) -> str:
    """Name of a folder's note and lock in the store; it does not depend on links in the path."""
    return key_of("out/v1", os.path.realpath(out))


def _moved_here(out: Path, store: Store) -> dict[str, list[str]]:
    """Digests of our files in another folder that received the same manifest from us; none if there is no such folder.

    A manifest alone proves nothing: anybody can write one that lists foreign files.
    """
    data = read_regular(out / manifest.NAME)
    digest = None if data is None else hashlib.sha256(data).hexdigest()
    notes = (store.read_record(_Note, "index", name) for name in (store.notes("index") if digest else ()))
    return next((note.ours for note in notes if note and digest in note.ours.get(manifest.NAME, ())), {})
