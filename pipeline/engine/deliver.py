"""Fill an output folder so that it holds exactly what the records say, touching only what differs.

New files are first written aside, inside the folder; a full disk shows there, while the previous build is still whole.
Then the manifest goes, files are renamed into place, files no longer made go, and the manifest comes last.
"""

import contextlib
import hashlib
import os
import shutil
import socket
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.engine import manifest
from pipeline.engine.digest import key_of
from pipeline.engine.files import copy, digest_of, machine_errors, signature
from pipeline.engine.spec import Record
from pipeline.engine.store import Store
from pipeline.engine.workspace import ABANDONED_S
from pipeline.errors import EnvironmentFault

Source = bytes | tuple[str, str]
"""Where a file comes from: its bytes, or (task name, output name)."""

_ASIDE = ".pipeline-"
_CLOCK_TICK_NS = 20_000_000  # file systems stamp times in ticks: two writes within one cannot be told apart


@dataclass(frozen=True, slots=True, kw_only=True)
class Delivery:
    """What changed in the folder; paths are posix and relative."""

    written: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()


def deliver(
    out: Path,
    files: Mapping[str, Source],
    head: dict[str, Any],
    *,
    records: Mapping[str, Record],
    store: Store,
    warn: Callable[[str], None] = lambda text: None,
) -> Delivery:
    """Make `out` hold `files` and a manifest, and nothing of an earlier build.

    Raises
    ------
    UsageError
        The folder holds a build of another stage.
    EnvironmentFault
        The folder cannot be written, or the disk is full; then the previous build is still whole. Or another machine,
        whose locks do not reach here, changes it at the same time.
    """
    entries = {path: _entry(source, records) for path, source in sorted(files.items())}
    _check_paths(entries)
    keys = {name: record["key"] for name, record in records.items()}
    with store.single_flight(_note_name(out)), machine_errors("write to", out, needed=_bytes(entries.values())):
        folder = _Folder(out, manifest.read_of(out, head.get("stage")), store, warn)
        try:
            return folder.fill(files, entries, manifest.render(head, keys, entries), records)
        except FileNotFoundError as error:
            raise EnvironmentFault(
                f"{out} changed while files were put there: {error.filename} is gone",
                hint="build again; if another machine builds into the same folder, give each its own with -o",
            ) from error


class _Folder:
    """An output folder, and what the store remembers of it: which files are ours, and how they looked when hashed."""

    def __init__(self, out: Path, there: manifest.Manifest, store: Store, warn: Callable[[str], None]) -> None:
        self.out, self.store, self.warn = out, store, warn
        note = store.read_note("index", _note_name(out)) or {}
        self._seen: dict[str, list[Any]] = note.get("seen", {})
        self._seen_before_ns = store.note_time_ns("index", _note_name(out)) - _CLOCK_TICK_NS
        self._manifest = there
        # After a delivery that was cut short there is no manifest; the note still knows which files are ours.
        self._ours = {*self._manifest.files, *filter(manifest.is_plain_path, note.get("ours", []))}

    def fill(
        self,
        files: Mapping[str, Source],
        entries: dict[str, dict[str, Any]],
        new_manifest: bytes,
        records: Mapping[str, Record],
    ) -> Delivery:
        self._remove_old_asides()  # also where nothing else changes: a builder may have died after its last file
        changed = [path for path, entry in entries.items() if self._digest(path) != entry["sha256"]]
        present, foreign = self._present(entries)
        stale = sorted(present & self._ours - entries.keys())
        if foreign:
            shown = ", ".join(foreign[:3]) + (" …" if len(foreign) > 3 else "")
            self.warn(f"{len(foreign)} files in {self.out} are not of this build and stay: {shown}")
        if changed or stale or self._manifest.data != new_manifest:
            self._change(changed, stale, files, new_manifest, records, ours=self._ours | entries.keys())
        self._remember(entries)
        return Delivery(written=tuple(changed), removed=tuple(stale), foreign=tuple(foreign))

    def _change(
        self,
        changed: list[str],
        stale: list[str],
        files: Mapping[str, Source],
        new_manifest: bytes,
        records: Mapping[str, Record],
        *,
        ours: Iterable[str],
    ) -> None:
        self.out.mkdir(parents=True, exist_ok=True)
        aside = self.out / f"{_aside_of_this_machine()}{uuid.uuid4().hex}"
        aside.mkdir()
        try:
            for number, path in enumerate(changed):
                self._write_aside(files[path], aside / str(number), records)
            (aside / manifest.NAME).write_bytes(new_manifest)
            self._write_note({}, ours)
            self._clear_way(self.out / manifest.NAME, is_ours=True)
            for path in stale:
                self._remove(path)
            for number, path in enumerate(changed):
                self._place(aside / str(number), path)
            (aside / manifest.NAME).replace(self.out / manifest.NAME)
        finally:
            shutil.rmtree(aside, ignore_errors=True)

    def _write_aside(self, source: Source, aside: Path, records: Mapping[str, Record]) -> None:
        if isinstance(source, bytes):
            aside.write_bytes(source)
        else:
            copy(self.store.blob(_entry(source, records)["sha256"]), aside)

    def _place(self, aside: Path, path: str) -> None:
        target = self.out / path
        for parent in reversed(target.relative_to(self.out).parents[:-1]):
            folder = self.out / parent
            if folder.is_symlink() or not folder.is_dir():
                self._clear_way(folder, is_ours=False)
                folder.mkdir(exist_ok=True)
        if target.is_symlink() or target.exists():
            # Nobody loses a file with the very same bytes, for example another machine's that builds the same.
            is_ours = path in self._ours or digest_of(target) == digest_of(aside)
            self._clear_way(target, is_ours=is_ours and not target.is_dir())
        aside.replace(target)

    def _clear_way(self, path: Path, *, is_ours: bool) -> None:
        """Remove what is ours; keep what is not under another name."""
        if is_ours and not path.is_dir():
            path.unlink(missing_ok=True)
        elif path.is_symlink() or path.exists():
            kept = next(p for n in range(1, 10_000) if not (p := path.with_name(f"{path.name}.kept{n}")).exists())
            path.rename(kept)
            self.warn(f"{path} was not made by this build and stood in the way; it is now {kept.name}")

    def _remove(self, path: str) -> None:
        (self.out / path).unlink(missing_ok=True)
        for parent in (self.out / path).relative_to(self.out).parents[:-1]:
            try:
                (self.out / parent).rmdir()
            except OSError:  # not empty: somebody else's files, or ours that stay
                return

    def _remove_old_asides(self) -> None:
        for folder in self.out.glob(f"{_ASIDE}*"):
            # We hold the folder's lock, so builders of this machine are dead. Those of others may not know our locks.
            age_s = time.time() - folder.lstat().st_mtime
            if folder.name.startswith(_aside_of_this_machine()) or age_s > ABANDONED_S:
                shutil.rmtree(folder, ignore_errors=True)

    def _present(self, entries: Mapping[str, Any]) -> tuple[set[str], list[str]]:
        """Files that are there, and those of them that neither this nor an earlier build made."""
        if not self.out.is_dir():
            return set(), []
        present = {path for path in _files_below(self.out) if path != manifest.NAME and not path.startswith(_ASIDE)}
        return present, sorted(present - entries.keys() - self._ours)

    def _digest(self, path: str) -> str | None:
        """Digest of a file; read again unless it looks exactly as when it was last hashed."""
        target = f"{self.out}/{path}"
        try:
            facts = os.lstat(target)
        except OSError:
            return None
        seen = self._seen.get(path)
        if seen and seen[0] == signature(facts) and facts.st_ctime_ns < self._seen_before_ns:
            return str(seen[1])
        return digest_of(target)

    def _remember(self, entries: Mapping[str, dict[str, Any]]) -> None:
        seen = {path: [signature(os.lstat(f"{self.out}/{path}")), entry["sha256"]] for path, entry in entries.items()}
        doubtful = any(looks[3] >= self._seen_before_ns for looks, _ in seen.values())
        if doubtful or seen != self._seen:
            self._write_note(seen, entries)

    def _write_note(self, seen: dict[str, list[Any]], ours: Iterable[str]) -> None:
        self.store.write_note("index", _note_name(self.out), {"seen": seen, "ours": sorted(ours)})
        self._seen = seen


def _aside_of_this_machine() -> str:
    return f"{_ASIDE}{socket.gethostname()}-"


def _entry(source: Source, records: Mapping[str, Record]) -> dict[str, Any]:
    if isinstance(source, bytes):
        return {"sha256": hashlib.sha256(source).hexdigest(), "size": len(source)}
    task, output = source
    try:
        entry: dict[str, Any] = records[task]["outputs"][output]
    except KeyError:
        made = sorted(records[task]["outputs"]) if task in records else "nothing"
        raise ValueError(f"task {task!r} was to make {output!r}, but made {made}") from None
    return {"sha256": entry["sha256"], "size": entry["size"]}


def _files_below(out: Path) -> Iterator[str]:
    """Posix paths of everything below a folder that is not a folder itself; links to folders are not followed."""
    todo = [""]
    while todo:
        below = todo.pop()
        with contextlib.suppress(PermissionError), os.scandir(f"{out}/{below}") as found:  # not ours, then
            for entry in found:
                if entry.is_dir(follow_symlinks=False):
                    todo.append(f"{below}{entry.name}/")
                else:
                    yield f"{below}{entry.name}"


def _check_paths(paths: Iterable[str]) -> None:
    names = set(paths)
    for path in names:
        if not manifest.is_plain_path(path) or path == manifest.NAME or path.startswith(_ASIDE):
            raise ValueError(f"a build cannot deliver a file named {path!r}")
        parent = path
        while parent := parent.rpartition("/")[0]:
            if parent in names:
                raise ValueError(f"a build cannot deliver both {parent!r} and {path!r}")


def _bytes(entries: Iterable[Mapping[str, Any]]) -> int:
    return sum(entry["size"] for entry in entries)


def _note_name(out: Path) -> str:
    return key_of("out/v1", str(out.absolute()))
