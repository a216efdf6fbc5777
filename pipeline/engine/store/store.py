"""The store: blobs under their digests, and for each key of a task a record of the blobs that it made.

    VERSION                      marks the folder as a store; a folder that is not empty and has no such file is refused
    cas/sha256/ab/<digest>       a blob, mode 0444
    ac/v1/ab/<key>.json          a record, followed by a line with its own digest
    lock/ab/<key>                locked while somebody computes the key
    tmp/                         files being written
    gc.lock                      shared by builders, exclusive for the collector
    logs/  specs/                output of tasks; specs of failed tasks, to repeat them alone
    history/  sources/           per output folder the keys of the last build, and its source
    events/  index/              the events of the last build, the delivered digests, parsed code:
                                 losing them does no harm, but then no file of an output folder counts as ours

Two promises hold. A record returned by `record` has complete blobs. A reader gets the right bytes or a miss, never
wrong bytes, and never an exception because of a damaged entry. Only entries proven wrong are deleted; an entry that is
unreadable at present (no descriptors left, a disk that is not mounted) is a miss and stays.
"""

import contextlib
import hashlib
import os
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pipeline.engine.files import Signature, copy, digest_of, is_no_file, read_regular, signature
from pipeline.engine.records import Blob, Record, Spec, as_json, fields_of, seal, unseal
from pipeline.engine.store.store_folder import StoreFolder
from pipeline.folders import user_cache
from pipeline.records.plain import from_plain

T = TypeVar("T")

_FORMAT = 1
"""Version of the records in the store: it rises when a field changes, and records of other versions are ignored."""


class DamagedBlob(Exception):
    """A blob is missing, does not match its digest, or was written to while in use. Building again repairs it."""

    def __init__(self, digest: str, how: str = "is gone or damaged") -> None:
        super().__init__(f"{digest} {how} in the store")


@dataclass(frozen=True, slots=True, kw_only=True)
class Verified:
    """A verified blob: its path and its signature before it was hashed."""

    digest: str
    path: Path
    signature_before: Signature


def default_root() -> Path:
    """Default folder of the store: $PIPELINE_CACHE, or `store/` in the user's cache folder."""
    chosen = os.environ.get("PIPELINE_CACHE")
    return Path(chosen) if chosen else user_cache() / "store"


class Store(StoreFolder):
    """A store in a folder of a plain file system, by default `default_root()`; many processes may use it at a time.

    `warn` receives one sentence about every damaged entry and every key with two different results. Methods that lead
    to bytes raise `DamagedBlob` if these are missing, altered, or changed while they were used.
    """

    def __init__(self, root: str | Path | None = None, *, warn: Callable[[str], None] = lambda text: None) -> None:
        super().__init__(Path(root or default_root()).absolute(), warn)
        self._verified: dict[str, Signature] = {}

    # Blobs

    def put_file(self, path: Path) -> Blob:
        """Store a file of a task: hash it in chunks, then move it, or copy it if it has other names."""
        facts = path.lstat()
        if not stat.S_ISREG(facts.st_mode):
            raise ValueError(f"{path.name} is not a plain file")
        if facts.st_nlink > 1:  # it could be changed by its other name, and is not ours to move
            aside = self.new_path()
            copy(path, aside)
            path = aside
        digest = digest_of(path)
        if digest is None:
            raise OSError(f"cannot read {path}")
        blob = Blob(sha256=digest, size=path.stat().st_size)
        if not self.is_whole(blob):
            self._keep(path, self.path("blob", digest))
        return blob

    def blob(self, digest: str) -> Path:
        """Verified path of a blob, for reading only."""
        path = self.path("blob", digest)
        with contextlib.suppress(OSError):  # it is not there
            if self.is_whole(Blob(sha256=digest, size=path.lstat().st_size)):
                return path
        raise DamagedBlob(digest)

    def verified(self, digest: str) -> Verified:
        """A blob as returned by `blob`, with its signature for `confirm`."""
        path = self.blob(digest)
        return Verified(digest=digest, path=path, signature_before=self._verified[digest])

    def confirm(self, blobs: Iterable[Verified]) -> None:
        """Hash blobs again and require that nobody has written to them since `verified`."""
        for blob in blobs:
            if digest_of(blob.path) != blob.digest or signature(blob.path.lstat()) != blob.signature_before:
                self._verified.pop(blob.digest, None)
                self.blob(blob.digest)  # deletes it
                raise DamagedBlob(blob.digest, "was written to while it was used")

    def read(self, digest: str) -> bytes:
        """The bytes of a blob; exactly these bytes were hashed."""
        data = read_regular(self.blob(digest))
        if data is None or hashlib.sha256(data).hexdigest() != digest:
            self._verified.pop(digest, None)
            raise DamagedBlob(digest)
        return data

    def copy_blob(self, digest: str, target: Path) -> None:
        """Copy a blob to a new file; the bytes that arrive are hashed."""
        copy(self.blob(digest), target)
        if digest_of(target) != digest:
            self._verified.pop(digest, None)
            raise DamagedBlob(digest)

    def is_whole(self, blob: Blob) -> bool:
        """Whether the store holds exactly these bytes. Anything else under their name is removed."""
        digest = blob.sha256
        path = self._at("blob", digest)
        try:
            facts = os.lstat(path)
        except OSError:
            return False
        current = signature(facts)
        is_plausible = stat.S_ISREG(facts.st_mode) and facts.st_size == blob.size
        if is_plausible and self._verified.get(digest) == current:  # verified by this process, unchanged since
            return True
        actual = digest_of(path) if is_plausible else ""
        if actual == digest:
            self._verified[digest] = current
        elif actual is not None:  # None: unreadable at present, so nothing is known about its bytes
            self._clear(Path(path))
        return actual == digest

    def size(self) -> int:
        """Size of all blobs [bytes]."""
        return sum(facts.st_size for _, facts in self.entries("blob"))

    # Records

    def put_record(self, record: Record) -> Record:
        """Store a record unless its key has one; returns the record that is kept."""
        first = self.record(record.key)
        if first is not None:
            if first.outputs != record.outputs:
                self.warn(f"NON-DETERMINISM: {record.key[:12]} gave other bytes than before; the first ones stay")
            return first
        self._write(self.path("record", record.key), seal({"format": _FORMAT, **fields_of(record)}))
        return record

    def record(self, key: str) -> Record | None:
        """The record of a key if it and all its blobs are intact; else None, a miss."""
        return self.complete(self.peek(key))

    def complete(self, record: Record | None) -> Record | None:
        """A record returned by `peek` if all its blobs are intact, else None; the record stays until they come back."""
        if record is None or not all(map(self.is_whole, record.outputs.values())):
            return None
        with contextlib.suppress(OSError):  # mark it as used: the collector removes the least recently used first
            os.utime(self._at("record", record.key))
        return record

    def peek(self, key: str) -> Record | None:
        """The record of a key, without checking its blobs; for explanations."""
        path = self._at("record", key)
        raw = read_regular(path)
        record = _parse_record(raw, key)
        # Otherwise it is an ordinary miss, or unreadable at present.
        if record is None and (raw is not None or is_no_file(path)):
            self._clear(Path(path))
        return record

    # Notes: helpful, but no result depends on them

    def keep_spec(self, spec: Spec) -> str | None:
        """Save the spec of a task, to repeat it alone; returns its path, or None if it cannot be written."""
        path = self.path("spec", spec.key)
        try:
            self._write(path, as_json(spec) + b"\n")
        except OSError:
            return None
        return str(path)

    def write_note(self, folder: str, name: str, note: Any) -> None:
        """Keep plain data or a record in `history`, `sources`, `events` or `index`; a read-only store skips it."""
        with contextlib.suppress(OSError):
            self._write(self.root / folder / f"{name}.json", seal(note))

    def read_note(self, folder: str, name: str) -> Any:
        """The note that `write_note` kept; None if it is missing or damaged."""
        return unseal(read_regular(self.root / folder / f"{name}.json"))

    def read_record(self, kind: type[T], folder: str, name: str) -> T | None:
        """The note as a record, or as a dict of records; None if it is missing, damaged or of another version."""
        try:
            return from_plain(kind, self.read_note(folder, name))
        except (TypeError, ValueError, AttributeError, KeyError):
            return None

    def notes(self, folder: str) -> list[str]:
        """Names of the notes in a folder of the store, sorted."""
        return sorted(path.stem for path in (self.root / folder).glob("*.json"))


def _parse_record(raw: bytes | None, key: str) -> Record | None:
    """The record in these bytes; None unless checksum, format and key are right."""
    plain = unseal(raw)
    try:
        if plain.pop("format") != _FORMAT:
            return None
        record = from_plain(Record, plain)
        return record if record.key == key and record.is_sound else None
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
