"""The store: bytes under their digest, and records of which bytes the task with a key made.

    VERSION                      says that the folder is a store: one that holds anything and does not say so is refused
    below                        path of another store, whose results count as ours: see `writable`
    cas/sha256/ab/<digest>       a blob, mode 0444
    ac/v1/ab/<key>.json          a record, followed by a line with its own digest
    lock/ab/<key>                locked while somebody computes the key
    tmp/                         files being written
    quarantine/                  what failed verification or stood in the way, for a person to look at
    gc.lock                      shared by builders, exclusive for the collector
    logs/  specs/                what tasks printed; tasks that failed, to be repeated alone
    history/  sources/           per output folder the keys of the last build, and what it was made of
    events/  index/              the events of the last build, the bytes that we put there, what code says:
                                 without them nothing is wrong, but no file of an output folder is known to be ours

Two promises: a record that `record` gives has complete blobs, and a reader gets the right bytes or a miss, never wrong
bytes and never an exception because an entry is damaged. Only what was seen to be wrong goes to quarantine; what cannot
be read just now (no descriptors left, a disk that is away) is a miss and stays where it is.
"""

import contextlib
import hashlib
import json
import os
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.engine.digest import DIGEST
from pipeline.engine.files import (
    Signature,
    copy,
    digest_of,
    is_no_file,
    machine_errors,
    read_regular,
    signature,
)
from pipeline.engine.store.sealed import seal, unseal
from pipeline.engine.store.store_folder import StoreFolder
from pipeline.engine.store.structure import is_folder, is_store
from pipeline.user_cache import user_cache

_BELOW = "below"
_FORMAT = 1
"""Version of records in the store: it rises when a field changes, and a record of another version is not taken."""
_COSTS = ("seconds", "cpu_seconds", "loading_seconds", "peak_bytes", "calls", "rays", "crossings")

Entry = dict[str, Any]


class DamagedBlob(Exception):
    """A blob is gone, is not what its name says, or was written to while it was used; building again heals it."""

    def __init__(self, digest: str, how: str = "is gone or damaged") -> None:
        super().__init__(f"{digest} {how} in the store")


@dataclass(frozen=True, slots=True, kw_only=True)
class Verified:
    """A blob that was hashed, and how it looked before."""

    digest: str
    path: Path
    looks: Signature


def default_root() -> Path:
    """$PIPELINE_CACHE, or `store/` in the user's cache folder."""
    chosen = os.environ.get("PIPELINE_CACHE")
    return Path(chosen) if chosen else user_cache() / "store"


def writable(store: "Store") -> "Store":
    """The store, or, where it may only be read, a private one that reads it too and keeps what is new."""
    if os.access(store.root, os.W_OK):
        return store
    name = hashlib.sha256(os.fsencode(store.root)).hexdigest()[:16]
    private = user_cache() / "above" / name
    with machine_errors("make a store for", private):
        above = Store(private, warn=store.warn)
        above.put_above(store.root)
    store.warn(f"the store {store.root} may only be read; what is new goes to {private}")
    return Store(private, warn=store.warn)


class Store(StoreFolder):
    """A store on a plain file system; many processes may use one at the same time.

    Parameters
    ----------
    root : Path, optional
        Its folder; default `default_root()`.
    warn : callable, optional
        Gets one sentence about every damaged entry and every key that gave two results.
    """

    def __init__(
        self,
        root: str | Path | None = None,
        *,
        warn: Callable[[str], None] = lambda text: None,
        above: tuple[str, ...] = (),
    ) -> None:
        super().__init__(Path(root or default_root()).absolute(), warn)
        self._verified: dict[str, Signature] = {}
        self._below = self._open_below((*above, os.path.realpath(self.root)))

    def _open_below(self, above: tuple[str, ...]) -> "Store | None":
        """The store whose results count as ours, if there is one and it is another one."""
        named = os.fsdecode(read_regular(self.root / _BELOW) or b"")
        if not named or not is_folder(Path(named)):  # none, or away just now
            return None
        if os.path.realpath(named) == above[-1]:
            self._quarantine(self.root / _BELOW)
            return None
        if os.path.realpath(named) in above or not is_store(Path(named)):
            self.warn(f"{self.root / _BELOW} names {named}, which is no store below this one; it is left out")
            return None
        return Store(named, warn=self.warn, above=above)

    def put_above(self, root: Path) -> None:
        """Let the results of another store count as ours, from the next time that this one is opened."""
        self._write(self.root / _BELOW, os.fsencode(root))

    # Blobs

    def put_bytes(self, data: bytes) -> Entry:
        """Keep bytes; gives {"sha256", "size"}, which is how everybody else names them."""
        digest = hashlib.sha256(data).hexdigest()
        entry = {"sha256": digest, "size": len(data)}
        if not self.is_whole(entry):
            self._write(self.path("blob", digest), data)
        return entry

    def put_file(self, path: Path) -> Entry:
        """Take a file that a task wrote on this file system. It is hashed in pieces and moved, or copied if shared."""
        facts = path.lstat()
        if not stat.S_ISREG(facts.st_mode):
            raise ValueError(f"{path.name} is not a plain file")
        if facts.st_nlink > 1:  # another name could still change it, and what it names is not ours to move
            aside = self.new_path()
            copy(path, aside)
            path = aside
        digest = digest_of(path)
        if digest is None:
            raise OSError(f"cannot read {path}")
        entry = {"sha256": digest, "size": path.stat().st_size}
        if not self.is_whole(entry):
            self._keep(path, self.path("blob", digest))
        return entry

    def blob(self, digest: str) -> Path:
        """Verified path of a blob, for reading only.

        Raises
        ------
        DamagedBlob
        """
        path = self.path("blob", digest)
        with contextlib.suppress(OSError):  # not here
            if self._holds({"sha256": digest, "size": path.lstat().st_size}):
                return path
        if self._below is not None:
            return self._below.blob(digest)
        raise DamagedBlob(digest)

    def verified(self, digest: str) -> "Verified":
        """A blob as `blob` gives it, and how it looked: for `confirm`.

        Raises
        ------
        DamagedBlob
        """
        path = self.blob(digest)
        return Verified(digest=digest, path=path, looks=self._looks_of(digest))

    def confirm(self, blobs: Iterable["Verified"]) -> None:
        """Hash blobs once more, and require that nobody wrote to them since they looked like this.

        Raises
        ------
        DamagedBlob
            Whoever has used their bytes meanwhile may have used others.
        """
        for blob in blobs:
            if digest_of(blob.path) != blob.digest or signature(blob.path.lstat()) != blob.looks:
                self._forget(blob.digest)
                self.blob(blob.digest)
                raise DamagedBlob(blob.digest, "was written to while it was used")

    def read(self, digest: str) -> bytes:
        """The bytes of a blob; what is hashed is what is given.

        Raises
        ------
        DamagedBlob
        """
        data = read_regular(self.blob(digest))
        if data is None or hashlib.sha256(data).hexdigest() != digest:
            self._forget(digest)
            raise DamagedBlob(digest)
        return data

    def copy_blob(self, digest: str, target: Path) -> None:
        """Copy a blob to a new file; the bytes that arrive are hashed.

        Raises
        ------
        DamagedBlob
        """
        copy(self.blob(digest), target)
        if digest_of(target) != digest:
            self._forget(digest)
            raise DamagedBlob(digest)

    def _looks_of(self, digest: str) -> Signature:
        if digest in self._verified or self._below is None:
            return self._verified.get(digest, [])
        return self._below._looks_of(digest)

    def _forget(self, digest: str) -> None:
        """Look at a blob anew the next time, however it looks."""
        self._verified.pop(digest, None)
        if self._below is not None:
            self._below._forget(digest)

    def is_whole(self, entry: Entry) -> bool:
        """Whether the store holds exactly these bytes; anything else under their name goes to quarantine."""
        return self._holds(entry) or (self._below is not None and self._below.is_whole(entry))

    def _holds(self, entry: Entry) -> bool:
        digest = entry["sha256"]
        path = self._at("blob", digest)
        try:
            facts = os.lstat(path)
        except OSError:
            return False
        now = signature(facts)
        regular = stat.S_ISREG(facts.st_mode) and facts.st_size == entry["size"]
        if regular and self._verified.get(digest) == now:  # hashed before by this process, not written to since
            return True
        found = digest_of(path) if regular else ""
        if found == digest:
            self._verified[digest] = now
        elif found is not None:  # None says nothing about its bytes: they cannot be read just now
            self._quarantine(Path(path))
        return found == digest

    def size(self) -> int:
        """Bytes of all blobs."""
        return sum(facts.st_size for _, facts in self.entries("blob"))

    # Records

    def put_record(self, key: str, record: dict[str, Any]) -> dict[str, Any]:
        """Keep the first record of a key; gives the record that is kept."""
        kept = self.record(key)
        if kept is not None:
            if kept["outputs"] != record["outputs"]:
                self.counts["nondeterministic"] += 1
                self.warn(f"NON-DETERMINISM: {key[:12]} gave other bytes than before; the first ones stay")
            return kept
        sealed = seal({**record, "key": key, "format": _FORMAT})
        self._write(self.path("record", key), sealed)
        parsed: dict[str, Any] = unseal(sealed)
        return parsed

    def record(self, key: str) -> dict[str, Any] | None:
        """The record of a key, if it and all its blobs are whole; else None, which is a miss."""
        return self.complete(key, self.peek(key))

    def complete(self, key: str, record: dict[str, Any] | None) -> dict[str, Any] | None:
        """The record that `peek` gave for a key, if all its blobs are whole; else None: it waits for them."""
        if record is None or not all(self.is_whole(entry) for entry in record["outputs"].values()):
            return None
        with contextlib.suppress(OSError):  # in use: what was unused longest is collected first
            os.utime(self._at("record", key))
        return record

    def peek(self, key: str) -> dict[str, Any] | None:
        """The record of a key without a look at its blobs: for explanations."""
        path = self._at("record", key)
        raw = read_regular(path)
        record = _parse_record(raw, key)
        if record is None:
            if raw is not None or is_no_file(path):  # else an ordinary miss, or it cannot be read just now
                self._quarantine(Path(path))
            return self._below.peek(key) if self._below is not None else None
        return record

    def give_up(self, key: str) -> None:
        """Move a record whose blobs are gone to quarantine, unless a store below, maybe away just now, had them."""
        if not os.path.lexists(self.root / _BELOW):
            self._quarantine(self.path("record", key))

    # Files that are hints or help, never the truth

    def keep_spec(self, key: str, spec: dict[str, Any]) -> str | None:
        """Write a task down so that it can be repeated alone; gives the path, None if it cannot be written."""
        path = self.path("spec", key)
        try:
            self._write(path, json.dumps(spec, sort_keys=True).encode() + b"\n")
        except OSError:
            return None
        return str(path)

    def write_note(self, folder: str, name: str, note: Any) -> None:
        """Keep plain data in `history`, `sources`, `events` or `index`. A store that cannot be written goes without."""
        with contextlib.suppress(OSError):
            self._write(self.root / folder / f"{name}.json", seal(note))

    def read_note(self, folder: str, name: str) -> Any:
        """The note that `write_note` kept; None if it is not there or damaged."""
        note = unseal(read_regular(self.root / folder / f"{name}.json"))
        return self._below.read_note(folder, name) if note is None and self._below is not None else note

    def read_facts(self, folder: str, name: str) -> dict[str, Any]:
        """The same for a note that is a dict; empty if there is none."""
        note = self.read_note(folder, name)
        return note if isinstance(note, dict) else {}

    def notes(self, folder: str) -> list[str]:
        """Names of all notes in a folder."""
        return sorted(path.stem for path in (self.root / folder).glob("*.json"))


def _tells_costs(facts: dict[str, Any]) -> bool:
    """Whether what is told of a run, or of one of its kernels, are numbers."""
    return all(isinstance(facts.get(name, 0), int | float) for name in _COSTS)


def _parse_record(raw: bytes | None, key: str) -> dict[str, Any] | None:
    """Bytes as a record; None unless checksum, format and key are right."""
    record = unseal(raw)
    try:
        whole = record["format"] == _FORMAT and record["key"] == key
        entries, made_by = record["outputs"].values(), record["made_by"]
        whole = whole and all(DIGEST.fullmatch(e["sha256"]) and isinstance(e["size"], int) for e in entries)
        whole = whole and _tells_costs(made_by) and all(map(_tells_costs, made_by.get("kernels", {}).values()))
    except (KeyError, TypeError, AttributeError):
        return None
    return record if whole else None
