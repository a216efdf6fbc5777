"""An output folder: listing, writing new files aside, moving them into place, and keeping files of others."""

import contextlib
import os
import re
import shutil
import socket
import stat
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.engine.files import digest_of
from pipeline.engine.output import manifest
from pipeline.engine.store.store_folder import ABANDONED_S

ASIDE = ".pipeline-"
_MANY = 3
"""Number of warnings of one kind that are shown one by one; further ones are counted."""
_ASIDE_NAME = re.compile(rf"{re.escape(ASIDE)}(?P<host>.+)-[0-9a-f]{{32}}")


class Folder:
    """A folder that a build fills. Files of others are never removed, nor written to through a link."""

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

    def place(self, aside: Path, path: str, *, is_ours: bool) -> None:
        """Move a file into place, creating folders; what somebody else put there is kept under another name."""
        target, digest = self.out / path, digest_of(aside)
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
    def saying_what_was_kept(self) -> Iterator[None]:
        """Warn at the end, even after an error, of everything that was renamed."""
        try:
            yield
        finally:
            for target, kept in self._kept[:_MANY]:
                self.warn(f"{target} is not as a build delivered it; it is now {kept.name}")
            if more := self._kept[_MANY:]:
                self.warn(
                    f"{len(more)} other files in {self.out} stood in the way as well; they now end in .kept1 or so"
                )
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
    """Posix paths of everything below a folder that is not a folder itself; links to folders are not followed."""
    todo = [""]
    while todo:
        below = todo.pop()
        with contextlib.suppress(PermissionError), os.scandir(f"{out}/{below}") as entries:  # unreadable, so not ours
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    todo.append(f"{below}{entry.name}/")
                else:
                    yield f"{below}{entry.name}"
