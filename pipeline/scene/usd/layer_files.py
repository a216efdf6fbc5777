"""Files that a stage names, inspected before anything reads them: of layers exactly the bytes that USD will get.

A name may lead to another file a moment later. So a file is opened once, and the open file is checked and read.
"""

import io
import os
import stat
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Ar

from pipeline.limits import how_to_raise, limits
from pipeline.roots import real_path
from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.usda_lines import MOST_NESTED, TextMap, map_of

_OPEN_FILES = Path("/proc/self/fd")


@dataclass(slots=True)
class LayerFile:
    """An opened file, with its content if a stage may read it.

    Attributes
    ----------
    real : Path
        Path of the open file, links followed.
    is_plain : bool
        Whether it is a plain file, not a FIFO, folder or device.
    data : bytes
        Its content; empty if it is not plain, lies outside the roots, or is too large.
    problems : list of Problem
        Problems of size, encoding and nesting, and of the members of a package.
    texts : dict
        Maps of the text, or of the texts in the package; keys as `Sdf.Layer.realPath`.
    """

    real: Path
    is_plain: bool
    data: bytes = b""
    problems: list[Problem] = field(default_factory=list)
    texts: dict[str, TextMap] = field(default_factory=dict)

    @property
    def is_package(self) -> bool:
        """Whether its bytes are those of a usdz."""
        return self.data[:2] == b"PK"

    @property
    def is_binary(self) -> bool:
        """Whether it holds offsets by which USD reads it: a wrong one may crash USD."""
        return self.data[:8] == b"PXR-USDC" or self.is_package


def read_file(path: str, roots: Iterable[Path], limit: str = "layer_bytes") -> LayerFile:
    """Open and read a file that lies below one of the roots and is no larger than a limit. Anything else is not opened.

    Raises
    ------
    OSError
    """
    with _anchored(path) as (place, real, status):
        found = LayerFile(real, stat.S_ISREG(status.st_mode))
        if not found.is_plain or not any(real.is_relative_to(root) for root in roots):
            return found
        most = getattr(limits(), limit)
        with place.open("rb") as stream:
            found.data = stream.read(most + 1) if status.st_size <= most else b""
    size = max(status.st_size, len(found.data))
    if size > most:
        what = f"{size:,} bytes; a {limit.removesuffix('_bytes')} may have {most:,}"
        found.problems = [_problem(path, "file-size", what, how_to_raise(limit, size))]
    return found


def read_layer_file(path: str, roots: Iterable[Path]) -> LayerFile:
    """The file of a layer, with the problems of its content."""
    found = read_file(path, roots)
    if found.problems:
        return found
    if path.lower().endswith(".usdz"):
        found.problems = list(_check_package(found, path))
    else:
        found.problems = list(_check_text(found, path, path, found.data))
    return found


@contextmanager
def _anchored(path: str) -> Iterator[tuple[Path, Path, os.stat_result]]:
    """A path that keeps leading to the same file, its real path and its status; the file itself is not opened."""
    if not hasattr(os, "O_PATH") or not _OPEN_FILES.is_dir():
        yield Path(path), real_path(path), Path(path).stat()
        return
    anchor = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        place = _OPEN_FILES / str(anchor)
        yield place, place.readlink(), os.fstat(anchor)
    finally:
        os.close(anchor)


def is_plain_file(path: str | Path) -> bool:
    """Whether the path leads to a plain file, links followed; False for names that the file system cannot hold."""
    try:
        return Path(path).is_file()
    except OSError:
        return False


def _check_text(found: LayerFile, path: str, key: str, data: bytes, member: str = "") -> Iterator[Problem]:
    """Problems of a text: USD accepts any encoding but Python does not, and too deep nesting crashes USD."""
    try:
        if data.startswith(b"#usda"):
            data.decode()
    except UnicodeDecodeError as error:
        line = 1 if member else data.count(b"\n", 0, error.start) + 1
        message = f"{member}byte {data[error.start]:#04x} is not UTF-8"
        hint = "save the file as UTF-8; in ISO 8859-1, for example, letters with accents are other bytes"
        yield _problem(path, "encoding", message, hint, line)
        return
    found.texts[key] = text = map_of(data)
    if text.too_deep:
        message = f"{member}brackets are nested more than {MOST_NESTED} deep"
        hint = "write prims side by side: USD itself crashes on texts that are nested too deep"
        yield _problem(path, "too-deep", message, hint, 1 if member else text.too_deep)


def _check_package(found: LayerFile, path: str) -> Iterator[Problem]:
    """Problems of a usdz: its members must be stored without compression, and cannot be larger than the archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(found.data)) as archive:
            members = archive.infolist()
            contents = {one.filename: archive.read(one) for one in members if _is_plain(one)}
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, EOFError) as error:
        yield _problem(path, "package", f"not a readable usdz package ({error})")
        return
    for member in members:
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or not parts[0] or ":" in parts[0]:
            yield _problem(path, "package", f"member {member.filename!r} leads outside of the package")
        if not _is_plain(member):
            yield _problem(path, "package", f"member {member.filename!r} is compressed or encrypted")
    if sum(member.file_size for member in members) > len(found.data):
        yield _problem(path, "package", "its members claim more bytes than the file has")
    for name, data in contents.items():
        key = Ar.JoinPackageRelativePath([path, name])
        yield from _check_text(found, path, key, data, f"member {name!r}: ")
        # The first member is the default layer of the package
        found.texts.setdefault(path, found.texts.get(key, TextMap()))


def _is_plain(member: zipfile.ZipInfo) -> bool:
    return member.compress_type == zipfile.ZIP_STORED and not member.flag_bits & 1


def _problem(file: str, code: str, message: str, hint: str | None = None, line: int = 1) -> Problem:
    return Problem(code=code, message=message, file=shown_path(file), line=line, hint=hint)
