"""Maintenance of a store: counting its content, and removing the least recently used results.

No removal can make a result wrong: a removed entry is a miss afterwards, and is computed again.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

from pipeline.engine.files import is_unreadable
from pipeline.engine.locks import locked
from pipeline.engine.output import manifest
from pipeline.engine.output.our_files import OurFiles
from pipeline.engine.store.store import Store
from pipeline.engine.store.store_folder import ABANDONED_S
from pipeline.errors import EnvironmentFault, UsageError

DEFAULT_LIMIT = 50 * 10**9
"""Size beyond which the collector removes the least recently used results [bytes], unless $PIPELINE_CACHE_SIZE is set.
It is a choice: a small part of a present-day disk.
"""
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12}


@dataclass(frozen=True, slots=True, kw_only=True)
class Inventory:
    """Numbers and sizes [bytes] of store entries; pinned blobs belong to builds whose output folders still exist."""

    records: int
    blobs: int
    bytes: int
    pinned_bytes: int
    limit_bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Collected:
    """Entries that a collection removed or would remove, with sizes [bytes]. `busy`: a build kept it from
    removing any.
    """

    records: int
    blobs: int
    bytes: int
    bytes_left: int
    limit_bytes: int
    busy: bool = False


def limit_from_environment() -> int:
    """Limit of the store [bytes]: $PIPELINE_CACHE_SIZE, for example `200G`, or 50 GB."""
    text = os.environ.get("PIPELINE_CACHE_SIZE")
    return DEFAULT_LIMIT if not text else bytes_of(text, "PIPELINE_CACHE_SIZE")


def bytes_of(text: str, setting: str) -> int:
    """Bytes in a setting such as `1.5G`, `500 MB` or `1000`; units are powers of ten."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([kmgt]?)b?\s*", text.lower())
    if match is None:
        raise UsageError(f"{setting}: {text!r} is not a size", hint="write for example 500M or 50G")
    return int(float(match[1]) * _UNITS[match[2]])


def info(store: Store) -> Inventory:
    """Count the content of a store."""
    sizes = {name: facts.st_size for name, facts in store.entries("blob")}
    records = filter(None, map(store.peek, pinned_keys(store)))
    pinned = {blob.sha256 for record in records for blob in record.outputs.values()}
    return Inventory(
        records=sum(1 for _ in store.entries("record")),
        blobs=len(sizes),
        bytes=sum(sizes.values()),
        pinned_bytes=sum(sizes.get(name, 0) for name in pinned),
        limit_bytes=limit_from_environment(),
    )


def collect(store: Store, limit_bytes: int, *, dry_run: bool = False, wait_s: float = 0.0) -> Collected:
    """Remove the least recently used results until the blobs fit into the limit, and all blobs without a record.

    Records are removed before blobs, so a killed collector leaves no record of a missing blob. The order of use comes
    from the times of the record files, which are never compared with a clock. Pinned results are always kept.
    """
    with locked(store.root / "gc.lock", timeout_s=wait_s, doing="collects what is not used") as held:
        if not held and not dry_run:
            return Collected(records=0, blobs=0, bytes=0, bytes_left=store.size(), limit_bytes=limit_bytes, busy=True)
        sizes = {name: facts.st_size for name, facts in store.entries("blob")}
        keys, blobs = _to_keep(store, sizes, limit_bytes)
        drop_records = [name for name, _ in store.entries("record") if name not in keys]
        drop_blobs = [name for name in sizes if name not in blobs]
        freed = sum(sizes[name] for name in drop_blobs)
        if not dry_run:
            _remove(store, drop_records, drop_blobs)
    return Collected(
        records=len(drop_records),
        blobs=len(drop_blobs),
        bytes=freed,
        bytes_left=sum(sizes.values()) - freed,
        limit_bytes=limit_bytes,
    )


def pinned_keys(store: Store) -> set[str]:
    """Keys of the last build of every output folder that still holds its manifest, or a file of a partial delivery."""
    keys: set[str] = set()
    for note in (store.read_note("history", name) for name in store.notes("history")):
        try:
            out = Path(note["out"])
            delivered = OurFiles(out, store).digests
            is_partial = manifest.NAME not in delivered and any((out / path).is_file() for path in delivered)
            if is_partial or (out / manifest.NAME).is_file():
                keys.update(note["keys"].values())
        except (TypeError, KeyError, AttributeError, ValueError):
            continue  # not one of our histories
    return keys


def _to_keep(store: Store, sizes: dict[str, int], limit_bytes: int) -> tuple[set[str], set[str]]:
    """Keys and blobs to keep: the pinned ones, then the most recently used until the limit is reached."""
    pinned = pinned_keys(store)
    by_use = sorted(
        store.entries("record"), key=lambda entry: (entry[0] in pinned, entry[1].st_mtime_ns, entry[0]), reverse=True
    )
    keys: set[str] = set()
    blobs: set[str] = set()
    free_bytes = limit_bytes
    for key, _ in by_use:
        record = store.peek(key)
        if record is None and is_unreadable(path := store.path("record", key)):  # it may refer to any blob
            raise EnvironmentFault(f"cannot read {path}, so nothing was removed", hint="try again, or remove that file")
        if record is None:
            continue
        names = {blob.sha256 for blob in record.outputs.values()}
        needed_bytes = sum(sizes.get(name, 0) for name in names - blobs)
        if key not in pinned and needed_bytes > free_bytes:
            free_bytes = 0  # strictly by use: a small old entry does not outlive a large newer one
            continue
        free_bytes -= needed_bytes
        keys.add(key)
        blobs |= names
    return keys, blobs


def _remove(store: Store, records: list[str], blobs: list[str]) -> None:
    """Remove entries, the files that belong to their records, and leftovers of dead processes."""
    tables = {"record": records, "blob": blobs, "log": records, "spec": records, "lock": records}
    for path in (store.path(table, name) for table, names in tables.items() for name in names):
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise EnvironmentFault(f"cannot remove {path}: {error.strerror}", hint="is the store read-only?") from error
    store.sweep(older_than_s=ABANDONED_S)
