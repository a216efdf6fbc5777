"""The file of a layer before USD opens it: its size, whether text is UTF-8, whether a package is what it claims."""

import os
import zipfile
from collections.abc import Iterator
from pathlib import Path

from pipeline.limits import how_to_raise, limits
from pipeline.scene.problems import Problem, shown_path


def check_layer_file(file: Path) -> Iterator[Problem]:
    """Problems of size, and of the members of a package."""
    size, most = file.stat().st_size, limits().layer_bytes
    if size > most:
        yield _problem(
            file, "file-size", f"{size:,} bytes; a layer may have {most:,}", how_to_raise("layer_bytes", size)
        )
    elif file.suffix.lower() == ".usdz":
        yield from _check_package(file)
    else:
        yield from _check_text(file, file.read_bytes())


def real_path(path: str | Path) -> Path:
    """The absolute path with links followed; of a link that leads to itself as far as it goes."""
    return Path(os.path.realpath(path))


def is_plain_file(path: str | Path) -> bool:
    """Whether there is a file, links followed; False also for a name that the file system cannot hold."""
    try:
        return Path(path).is_file()
    except OSError:
        return False


def _check_text(file: Path, data: bytes, member: str = "") -> Iterator[Problem]:
    """USD reads text in any encoding, and Python then stumbles over it."""
    try:
        if data.startswith(b"#usda"):
            data.decode()
    except UnicodeDecodeError as error:
        line = 1 if member else data.count(b"\n", 0, error.start) + 1
        message = f"{member}byte {data[error.start]:#04x} is not UTF-8"
        hint = "save the file as UTF-8; in ISO 8859-1, for example, letters with accents are other bytes"
        yield _problem(file, "encoding", message, hint, line)


def _check_package(file: Path) -> Iterator[Problem]:
    """A usdz is a zip archive whose members are stored, not compressed; it cannot hold more bytes than it has."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
            texts = {one.filename: archive.read(one) for one in members if _is_plain(one)}
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError) as error:
        yield _problem(file, "package", f"not a readable usdz package ({error})")
        return
    for member in members:
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or not parts[0] or ":" in parts[0]:
            yield _problem(file, "package", f"member {member.filename!r} leads outside of the package")
        if not _is_plain(member):
            yield _problem(file, "package", f"member {member.filename!r} is compressed or encrypted")
    if sum(member.file_size for member in members) > file.stat().st_size:
        yield _problem(file, "package", "its members claim more bytes than the file has")
    for name, data in texts.items():
        yield from _check_text(file, data, f"member {name!r}: ")


def _is_plain(member: zipfile.ZipInfo) -> bool:
    return member.compress_type == zipfile.ZIP_STORED and not member.flag_bits & 1


def _problem(file: Path, code: str, message: str, hint: str | None = None, line: int = 1) -> Problem:
    return Problem(code=code, message=message, file=shown_path(file), line=line, hint=hint)
