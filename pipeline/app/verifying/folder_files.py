"""Files of an output folder: are they those of its manifest, and do their readers open them?"""

import hashlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.engine.output.manifest import NAME, Manifest
from pipeline.engine.records import Blob
from pipeline.files.damaged import DamagedFile
from pipeline.files.exr import read_exr
from pipeline.files.jsonfile import read_json
from pipeline.files.png import read_png
from pipeline.files.tables import read_table
from pipeline.files.tiff import read_tiff
from pipeline.spelling import printable

_Reader = Callable[[Path], object]
_READERS: dict[str, _Reader] = {".exr": read_exr, ".png": read_png, ".json": read_json, ".csv": read_table}
_READERS |= dict.fromkeys((".tiff", ".dng"), read_tiff)
_OF_OTHERS = re.compile(r"exports/|pictures/[0-9a-f]{16}\.\w+$")
"""Files in the formats of other programs, and pictures that the stage is read with: our readers do not open them."""


def wrong_files(out: Path, manifest: Manifest) -> Iterator[str]:
    """Descriptions of missing, altered, damaged and unexpected files."""
    there = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()}
    for name in sorted(there - manifest.files.keys() - {NAME}):
        yield f"{printable(name)} is not in the manifest"
    for name, entry in sorted(manifest.files.items()):
        reader = None if _OF_OTHERS.match(name) else _READERS.get(Path(name).suffix)
        if fault := _fault(out / name, entry, reader):
            yield f"{printable(name)} {fault}"


def _fault(path: Path, entry: Blob, reader: _Reader | None) -> str | None:
    """Fault of a file: other bytes than its entry says, or content that its reader does not open; None without one."""
    try:
        size = path.stat().st_size
        if size != entry.size:
            return f"is not as it was built: {size:,} bytes, not {entry.size:,}"
        with path.open("rb") as stream:
            if hashlib.file_digest(stream, "sha256").hexdigest() != entry.sha256:
                return "is not as it was built: its bytes differ"
        if reader:
            reader(path)
    except FileNotFoundError:
        return "is lost"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    except DamagedFile as error:
        return f"cannot be read: {error.reason}"
    return None
