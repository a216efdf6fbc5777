"""Stores shared by several users: new files get the access rights of the root folder, whatever the umask.

As with `git init --shared`, whoever may write to the root may write everywhere below it.
"""

import contextlib
import os
import pwd
import shlex
import stat
from dataclasses import dataclass
from pathlib import Path

from pipeline.errors import EnvironmentFault

_FOLDER, _FILE = stat.S_ISGID | 0o777, 0o666
"""Mode bits that folders and files inherit from the root folder."""
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class Rights:
    """Access rights of the root of a store: its mode and group."""

    root: Path
    mode: int
    group: int

    @property
    def is_shared(self) -> bool:
        """Whether others than the owner may write."""
        return bool(self.mode & _OTHERS)

    def give(self, path: Path) -> None:
        """Give a new file or folder of this process the rights of the root; do nothing in a store for one user."""
        if not self.is_shared:
            return
        with contextlib.suppress(OSError):  # made by another user, who has set the rights
            facts = path.stat()
            if facts.st_gid != self.group:
                os.chown(path, -1, self.group)
            path.chmod(self.mode & (_FOLDER if stat.S_ISDIR(facts.st_mode) else _FILE))

    def make_folder(self, folder: Path) -> None:
        """Make a folder below the root, with its parents."""
        missing = []
        while not folder.is_dir() and folder != self.root:
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            new.mkdir(exist_ok=True)
            self.give(new)

    def make_file(self, path: Path) -> None:
        """Make an empty file that others may write to, too, unless it exists."""
        with contextlib.suppress(OSError):
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644))
            self.give(path)

    def require_same_inside(self, names: tuple[str, ...]) -> None:
        """Refuse a store whose folders have other rights than its root.

        Raises
        ------
        EnvironmentFault
            The folders differ; the error states the command that mends them.
        """
        if not os.access(self.root, os.W_OK):
            return
        for folder in (self.root / name for name in names):
            if folder.is_dir() and not os.access(folder, os.R_OK | os.W_OK | os.X_OK):
                root, who = shlex.quote(str(self.root)), "g" if self.mode & stat.S_IWGRP else "a"
                mending = f"chgrp -R {self.group} {root} && find {root} -type d -exec chmod {who}+rwx {{}} +"
                raise EnvironmentFault(
                    f"you may write to the store {self.root}, but not to its folder {folder.name}",
                    hint=f"{_name(folder)}, or root, mends it: {mending}",
                )


def rights_of(root: Path) -> Rights:
    """The access rights for everything in a store."""
    facts = root.stat()
    return Rights(root=root, mode=stat.S_IMODE(facts.st_mode), group=facts.st_gid)


def _name(folder: Path) -> str:
    number = folder.stat().st_uid
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"
