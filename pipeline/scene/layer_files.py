"""Is the file of a layer of a sane size, and a package what it claims to be? Asked before USD opens it."""

import zipfile
from collections.abc import Iterator
from pathlib import Path

from pipeline.scene.problems import Problem, shown_path

MAX_LAYER_BYTES = 256 * 2**20


def check_layer_file(file: Path) -> Iterator[Problem]:
    """Problems of size, and of the members of a package."""
    size = file.stat().st_size
    if size > MAX_LAYER_BYTES:
        yield _problem(file, "file-size", f"{size:,} bytes; a layer may have {MAX_LAYER_BYTES:,}")
    elif file.suffix.lower() == ".usdz":
        yield from _check_package(file)


def _check_package(file: Path) -> Iterator[Problem]:
    """A usdz is a zip archive whose members are stored, not compressed; it cannot hold more bytes than it has."""
    try:
        with zipfile.ZipFile(file) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        yield _problem(file, "package", f"not a readable usdz package ({error})")
        return
    for member in members:
        parts = member.filename.replace("\\", "/").split("/")
        if ".." in parts or not parts[0] or ":" in parts[0]:
            yield _problem(file, "package", f"member {member.filename!r} leads outside of the package")
        if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 1:
            yield _problem(file, "package", f"member {member.filename!r} is compressed or encrypted")
    if sum(member.file_size for member in members) > file.stat().st_size:
        yield _problem(file, "package", "its members claim more bytes than the file has")


def _problem(file: Path, code: str, message: str) -> Problem:
    return Problem(code=code, message=message, file=shown_path(file), line=1)
