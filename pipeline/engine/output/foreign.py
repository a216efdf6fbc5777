"""Plain files of an untrusted folder: anything else in it is a finding and is never waited for."""

import hashlib
import os
import stat
from collections.abc import Iterator
from pathlib import Path

_CHUNK = 1 << 20
"""Size of one read [bytes], 1 MiB: files of any size are compared in little memory."""
_LOOK = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFLNK: "a link",
    stat.S_IFIFO: "a FIFO",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


class Unfit(Exception):
    """The entry is not a complete, plain, readable file of its folder; the text says why, without its name."""


class ForeignFolder:
    """Reader of files below a folder that somebody may be changing.

    Links are not followed, only plain files are opened, and never more bytes are read than were asked for. So no FIFO,
    device or growing file can block us.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)

    def read(self, name: str, most: int) -> bytes:
        """All bytes of a file that has at most `most` bytes.

        Raises
        ------
        Unfit
            It is anything else.
        """
        handle = self.open(name)
        try:
            size = os.fstat(handle).st_size
            if size > most:
                raise Unfit(f"holds {size:,} bytes, more than the {most:,} that are read")
            return b"".join(_pieces(handle, size))
        finally:
            os.close(handle)

    def require_whole(self, name: str, size: int, sha256: str) -> None:
        """Compare a file with its size and digest in the manifest.

        Raises
        ------
        Unfit
            It is not a plain file, or holds other bytes.
        """
        handle = self.open(name)
        try:
            there = os.fstat(handle).st_size
            if there != size:
                raise Unfit(f"is not as it was built: {there:,} bytes, not {size:,}")
            digest = hashlib.sha256()
            for piece in _pieces(handle, size):
                digest.update(piece)
        finally:
            os.close(handle)
        if digest.hexdigest() != sha256:
            raise Unfit("is not as it was built: its bytes differ")

    def open(self, name: str) -> int:
        """Descriptor of a plain file, for reading.

        Raises
        ------
        Unfit
            It is anything else.
        """
        *folders, last = name.split("/")
        at = None
        try:
            at = os.open(self.root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
            for folder in folders:
                above, at = at, _entered(folder, at)
                os.close(above)
            return _opened(last, at)
        except FileNotFoundError:
            raise Unfit("is lost") from None
        except (OSError, ValueError) as error:  # ValueError: a name that no file system accepts
            reason = error.strerror if isinstance(error, OSError) else "no file system accepts such a name"
            raise Unfit(f"cannot be read ({reason})") from None
        finally:
            if at is not None:
                os.close(at)


def _entered(name: str, above: int) -> int:
    kind = stat.S_IFMT(os.stat(name, dir_fd=above, follow_symlinks=False).st_mode)
    if kind != stat.S_IFDIR:
        raise Unfit(f"lies below {_KINDS.get(kind, 'a file')} instead of a folder")
    return os.open(name, _LOOK | os.O_DIRECTORY, dir_fd=above)


def _opened(name: str, folder: int) -> int:
    # Examined before it is opened, because opening some devices has effects.
    _require_file(os.stat(name, dir_fd=folder, follow_symlinks=False))
    handle = os.open(name, _LOOK, dir_fd=folder)
    try:
        _require_file(os.fstat(handle))
    except Unfit:
        os.close(handle)
        raise
    return handle


def _require_file(facts: os.stat_result) -> None:
    if not stat.S_ISREG(facts.st_mode):
        raise Unfit(f"is {_KINDS.get(stat.S_IFMT(facts.st_mode), 'something else')} instead of a file")


def _pieces(handle: int, size: int) -> Iterator[bytes]:
    """The first `size` bytes of a file in pieces; fewer if it ends before."""
    try:
        while size > 0 and (piece := os.read(handle, min(size, _CHUNK))):
            size -= len(piece)
            yield piece
    except OSError as error:
        raise Unfit(f"cannot be read ({error.strerror})") from None
