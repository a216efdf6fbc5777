"""Fill an output folder with exactly the files that the records state, touching only those that differ.

New files are first written to a temporary folder inside the output folder and hashed there, so a full disk is noticed
while the previous build is still complete. Then the manifest and obsolete files are removed, the new files are renamed
into place, and the new manifest is written last. Only bytes that we have written are ever removed or replaced: anything
else that is in the way is renamed.

A partial delivery writes some of the files and removes none. It keeps a manifest that agrees with them and removes one
that does not, because the folder is then no longer the build it describes. It never writes a manifest.
"""

import contextlib
import hashlib
import os
import re
import shutil
import socket
import stat
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.engine.files import chosen_place, digest_of, read_regular, reporting_machine_faults
from pipeline.engine.locks import locked
from pipeline.engine.output import manifest
from pipeline.engine.output.our_files import OurFiles, name_of
from pipeline.engine.records import Blob, Record
from pipeline.engine.store.store import Store
from pipeline.engine.store.store_folder import ABANDONED_S
from pipeline.errors import EnvironmentFault

Source = bytes | tuple[str, str]
"""Source of a file: its bytes, or (task name, output name)."""
ASIDE = ".pipeline-"
"""Beginning of the names of temporary folders in an output folder; those of a machine have its name."""
_MANY = 3
"""Number of warnings of one kind that are shown one by one; further ones are counted."""
_ASIDE_NAME = re.compile(rf"{re.escape(ASIDE)}(?P<host>.+)-[0-9a-f]{{32}}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Delivery:
    """Changes that a delivery made in the folder; paths are POSIX and relative.

    `requested` lists the files that a partial delivery wrote or left as they were; it is None after a complete one.
    `finished` states whether the folder has a manifest now.
    """

    written: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    foreign: tuple[str, ...] = ()
    requested: tuple[str, ...] | None = None
    finished: bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """The intended content of an output folder: sources by path, facts of its manifest, and records of the tasks.

    `stage_id` is the identity of the stage, because a folder holds builds of one stage only. Unless the contents are
    `complete`, other files of that stage may stay.
    """

    files: Mapping[str, Source]
    head: manifest.Head
    records: Mapping[str, Record]
    stage_id: str = ""
    complete: bool = True


def deliver(out: Path, contents: Contents, store: Store, warn: Callable[[str], None] = lambda text: None) -> Delivery:
    """Make `out` hold the files and a manifest, and no file of an earlier build of the same stage.

    If the contents are not `complete`, write their files and leave all others alone. UsageError if the folder holds a
    build of another stage. EnvironmentFault if it cannot be written or the disk is full, and DamagedBlob if a result
    vanished from the store after it was made; the previous build is then still complete. EnvironmentFault also if
    another machine changes the folder at the same time: file locks may not work between machines.
    """
    entries = {path: _entry(source, contents.records) for path, source in sorted(contents.files.items())}
    _check_paths(entries)
    with chosen_place("write to", out):
        out.mkdir(parents=True, exist_ok=True)
    # The lock in the store may work between machines; the one of the folder covers builders with other stores.
    flight = store.single_flight(name_of(out), f"fills {out}")
    with flight, locked(out, say=store.say_waiting) as alone, _disk_errors(out, entries):
        old = manifest.read_of(out, contents.head.get("stage"))
        if contents.complete:
            keys = {name: record.key for name, record in contents.records.items()}
            data: bytes | None = manifest.render(contents.head, keys, entries)
        else:
            data = old.data if all(old.files.get(path) == entry for path, entry in entries.items()) else None
        ours = OurFiles(out, store, contents.stage_id)
        ours.require_same_stage()
        folder = Folder(out, warn)
        folder.remove_old_asides(alone=alone)  # even if nothing changes: a builder may have died after its last file
        return _fill(folder, _Goal(contents=contents, entries=entries, manifest=data, store=store), ours)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Goal:
    """Intended contents of a folder with their digests, and the manifest if there is to be one."""

    contents: Contents
    entries: dict[str, Blob]
    manifest: bytes | None
    store: Store

    @property
    def digests(self) -> dict[str, str]:
        """Digests of all files but the manifest."""
        return {path: entry.sha256 for path, entry in self.entries.items()}

    @property
    def note(self) -> dict[str, str]:
        """Digests of all files, including the manifest if one is to be written."""
        if self.manifest is None:
            return self.digests
        return {**self.digests, manifest.NAME: hashlib.sha256(self.manifest).hexdigest()}

    def write(self, path: str, target: Path) -> None:
        source = self.contents.files[path]
        if isinstance(source, bytes):
            target.write_bytes(source)
        else:
            self.store.copy_blob(self.entries[path].sha256, target)


class Folder:
    """A folder that a build fills. Files that are not ours are never removed, nor written to through a link."""

    def __init__(self, out: Path, warn: Callable[[str], None]) -> None:
        self.out, self.warn = out, warn
        self._kept: list[tuple[Path, Path]] = []

    def present(self) -> set[str]:
        """Paths of all files but the manifest; links to folders are not followed."""
        paths = set(_files_below(self.out)) - {manifest.NAME}
        return {path for path in paths if not _ASIDE_NAME.fullmatch(path.partition("/")[0])}

    @contextlib.contextmanager
    def aside(self) -> Iterator[Path]:
        """A temporary folder inside this one for new files; removed at the end."""
        aside = self.out / f"{ASIDE}{socket.gethostname()}-{uuid.uuid4().hex}"
        aside.mkdir()
        try:
            yield aside
        finally:
            shutil.rmtree(aside, ignore_errors=True)

    def remove_old_asides(self, *, alone: bool) -> None:
        """Remove temporary folders of dead builders. A builder that is `alone`, because it holds the folder's lock,
        knows that all other builders of this machine are dead.
        """
        for folder in self.out.glob(f"{ASIDE}*"):
            match = _ASIDE_NAME.fullmatch(folder.name)
            with contextlib.suppress(FileNotFoundError):  # of another machine, which has just finished
                dead = match and alone and match["host"] == socket.gethostname()
                if dead or (match and time.time() - folder.lstat().st_mtime > ABANDONED_S):
                    shutil.rmtree(folder, ignore_errors=True)

    def move_in(self, aside: Path, path: str, *, is_ours: bool) -> None:
        """Move a file into place, creating folders; a foreign file in its way is renamed."""
        target = self.out / path
        digest = digest_of(aside)
        for parent in reversed(target.relative_to(self.out).parents[:-1]):
            if _is_no_folder(self.out / parent):
                self.clear(parent.as_posix(), is_ours=False)
            if not (self.out / parent).is_dir():
                (self.out / parent).mkdir(exist_ok=True)
        # A file with the very same bytes may be replaced: another machine may be delivering the same build.
        self.clear(path, is_ours=is_ours or digest_of(target) == digest, is_same=lambda kept: digest_of(kept) == digest)
        aside.replace(target)

    def clear(self, path: str, *, is_ours: bool, is_same: Callable[[Path], bool] = lambda kept: False) -> None:
        """Free a path: a file of ours is removed, anything else is renamed.

        A file that appeared after the check is removed, too, if it `is_same` as the one to be placed: then another
        machine, which our lock does not reach, has delivered it.
        """
        target = self.out / path
        if is_ours and not target.is_dir():
            target.unlink(missing_ok=True)
        elif os.path.lexists(target):
            names = (target.with_name(f"{target.name}.kept{number}") for number in range(1, 10_000))
            kept = next(name for name in names if not os.path.lexists(name))
            target.rename(kept)
            if is_same(kept):
                kept.unlink()
            else:
                self._kept.append((target, kept))

    @contextlib.contextmanager
    def warning_of_renamed(self) -> Iterator[None]:
        """Context that warns at its end, even after an error, of everything that was renamed."""
        try:
            yield
        finally:
            for target, kept in self._kept[:_MANY]:
                self.warn(f"{target} is not as a build delivered it; it is now {kept.name}")
            if further := len(self._kept[_MANY:]):
                self.warn(f"{further} other files in {self.out} stood in the way as well; they now end in .kept1 or so")
            self._kept.clear()

    def remove(self, path: str) -> None:
        """Remove a file of ours and the folders above it that become empty."""
        (self.out / path).unlink(missing_ok=True)
        for parent in (self.out / path).relative_to(self.out).parents[:-1]:
            try:
                (self.out / parent).rmdir()
            except OSError:  # not empty: it holds files of others, or files that stay
                return


def _is_no_folder(path: Path) -> bool:
    """Whether the path holds something other than a folder, in one call: other processes may create missing folders."""
    try:
        return not stat.S_ISDIR(path.lstat().st_mode)
    except FileNotFoundError:
        return False


def _files_below(out: Path) -> Iterator[str]:
    """POSIX paths of everything below a folder that is not a folder itself; links to folders are not followed."""
    for folder, names, files in os.walk(out):
        links = [name for name in names if Path(folder, name).is_symlink()]
        yield from (os.path.relpath(f"{folder}/{name}", out) for name in files + links)


def _fill(folder: Folder, goal: _Goal, ours: OurFiles) -> Delivery:
    """Change a folder into the goal if it differs, and note its digests."""
    present = folder.present()
    data = read_regular(folder.out / manifest.NAME)
    digests = goal.digests
    is_complete = goal.contents.complete
    # A file that is not present is missing, or lies behind a link to a folder and so outside this one.
    changed = [path for path, digest in digests.items() if path not in present or ours.digest(path) != digest]
    unlisted = sorted(present - digests.keys()) if is_complete else []
    stale = [path for path in unlisted if path in ours]
    foreign = [path for path in unlisted if path not in stale]
    if foreign:
        names = ", ".join(foreign[:3]) + (" …" if len(foreign) > 3 else "")
        folder.warn(f"{len(foreign)} files in {folder.out} are not of this build and stay: {names}")
    if changed or stale or data != goal.manifest:
        _change(folder, ours, goal, changed=changed, stale=stale)
    ours.keep(goal.note, complete=is_complete)
    changes = Delivery(written=tuple(changed), removed=tuple(stale), foreign=tuple(foreign))
    return changes if is_complete else replace(changes, requested=tuple(digests), finished=goal.manifest is not None)


def _change(folder: Folder, ours: OurFiles, goal: _Goal, *, changed: list[str], stale: list[str]) -> None:
    """Write the changed files aside, remove the manifest and stale files, and move the changed files into place."""
    with folder.aside() as aside, folder.warning_of_renamed():
        for number, path in enumerate(changed):
            goal.write(path, aside / str(number))
        if goal.manifest is not None:
            (aside / manifest.NAME).write_bytes(goal.manifest)
        ours.begin(goal.note)
        is_ours = manifest.NAME in ours or _is_begun(folder.out / manifest.NAME, goal)
        folder.clear(manifest.NAME, is_ours=is_ours, is_same=lambda kept: _is_begun(kept, goal))
        for path in stale:
            if path in ours:  # nobody has written to it meanwhile
                folder.remove(path)
        for number, path in enumerate(changed):
            is_ours = path in ours or ours.digest(path) == goal.digests[path]
            folder.move_in(aside / str(number), path, is_ours=is_ours)
        if goal.manifest is not None:
            (aside / manifest.NAME).replace(folder.out / manifest.NAME)


def _is_begun(path: Path, goal: _Goal) -> bool:
    """Whether a file is the intended manifest, or a truncated beginning of it and nothing else."""
    data = read_regular(path)
    return data is not None and (goal.manifest or b"").startswith(data)


@contextlib.contextmanager
def _disk_errors(out: Path, entries: Mapping[str, Blob]) -> Iterator[None]:
    """Turn errors of the disk, or of interference by other processes, into an `EnvironmentFault`."""
    try:
        with reporting_machine_faults(
            "write to", out, least_bytes=lambda: sum(entry.size for entry in entries.values())
        ):
            yield
    except (FileNotFoundError, FileExistsError, NotADirectoryError, IsADirectoryError) as error:
        raise EnvironmentFault(
            f"{out} changed while files were put there: {error.filename}: {error.strerror}",
            hint="build again; if another machine builds into the same folder, give each its own with -o",
        ) from error


def _entry(source: Source, records: Mapping[str, Record]) -> Blob:
    """Digest and size of a file from its source; ValueError if its task did not make it."""
    if isinstance(source, bytes):
        return Blob(sha256=hashlib.sha256(source).hexdigest(), size=len(source))
    task, output = source
    try:
        return records[task].outputs[output]
    except KeyError:
        outputs = sorted(records[task].outputs) if task in records else "nothing"
        raise ValueError(f"task {task!r} was to make {output!r}, but made {outputs}") from None


def _check_paths(paths: Iterable[str]) -> None:
    """Refuse names that no delivery can have, and a file whose name is that of a folder."""
    names = set(paths)
    for path in names:
        if not manifest.is_plain_path(path) or path == manifest.NAME or path.startswith(ASIDE):
            raise ValueError(f"a build cannot deliver a file named {path!r}")
        parent = path
        while parent := parent.rpartition("/")[0]:
            if parent in names:
                raise ValueError(f"a build cannot deliver both {parent!r} and {path!r}")
