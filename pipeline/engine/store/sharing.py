"""A store of several users: what is made in it gets the rights of its root folder, whatever the umask of its maker.

As `git init --shared`: whoever may write to the root may write everywhere in it.
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
"""Bits of the root folder's rights that folders and files in it take over."""
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@dataclass(frozen=True, slots=True, kw_only=True)
class Rights:
    """Mode and group of the root of a store."""

    root: Path
    mode: int
    group: int

    @property
    def is_shared(self) -> bool:
        """Whether others than the owner may write."""
        return bool(self.mode & _OTHERS)

    def give(self, path: Path) -> None:
        """Give a file or folder that this process made the rights of the root. In a store for one user, nothing."""
        if not self.is_shared:
            return
        with contextlib.suppress(OSError):  # somebody else's, who has given them
            facts = path.stat()
            if facts.st_gid != self.group:
                os.chown(path, -1, self.group)
            path.chmod(self.mode & (_FOLDER if stat.S_ISDIR(facts.st_mode) else _FILE))

    def make_folder(self, folder: Path) -> None:
        """Make a folder below the root, and those above it."""
        missing = []
        while not folder.is_dir() and folder != self.root:
            missing.append(folder)
            folder = folder.parent
        for new in reversed(missing):
            new.mkdir(exist_ok=True)
            self.give(new)

    def make_file(self, path: Path) -> None:
        """Make an empty file, if nothing is there, in which others may write, too."""
        with contextlib.suppress(OSError):
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644))
            self.give(path)

    def require_same_inside(self, names: tuple[str, ...]) -> None:
        """Refuse a store whose folders were made when its root had other rights.

        Raises
        ------
        EnvironmentFault
            With the command that mends it.
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
    """The rights that everything in a store gets."""
    facts = root.stat()
    return Rights(root=root, mode=stat.S_IMODE(facts.st_mode), group=facts.st_gid)


def _name(folder: Path) -> str:
    number = folder.stat().st_uid
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return f"user {number}"
