"""The manifest of an output folder: its files and the tasks that made them. A folder without one is not finished."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.engine.digest import DIGEST
from pipeline.engine.files import nearest_existing, read_regular
from pipeline.engine.records import Blob, fields_of
from pipeline.errors import UsageError
from pipeline.limits import limits

NAME = "manifest.json"
Head = Mapping[str, Any]
"""Facts of a manifest about a build by name, besides its format, tasks and files."""

FORMAT = 1
"""Version of the manifest: it rises when readers of the old one would misread the new one."""
_BYTES_PER_FRAME = 1 << 14
"""Bytes that one frame of one camera may take in a manifest: ten times what its files and tasks need."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """Content of a manifest; empty if none can be read. Its `points` are not interpreted here.

    `data` are the bytes of the file, `files` digests by POSIX path, `tasks` keys by name.
    """

    data: bytes | None = None
    stage: Any = None
    files: dict[str, Blob] = field(default_factory=dict)
    tasks: dict[str, str] = field(default_factory=dict)
    points: Any = None
    has_pictures: bool = True  # members of ensembles have none


def read(out: Path) -> Manifest:
    """The manifest in a folder. A file that is not one of ours, or far too large, counts as none."""
    data = read_regular(out / NAME, limit_bytes=_BYTES_PER_FRAME * limits().frames)
    try:
        parsed = json.loads(data or b"")
        files = {path: Blob(**entry) for path, entry in parsed["files"].items()}
        tasks = parsed["tasks"]
        sound = [DIGEST.fullmatch(blob.sha256) and type(blob.size) is int and blob.size >= 0 for blob in files.values()]
        has_format = parsed["format"] == FORMAT and isinstance(tasks, dict)
        is_valid = has_format and all(sound) and all(map(is_plain_path, files))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        is_valid = False
    if not is_valid:
        return Manifest(data=data)
    return Manifest(
        data=data,
        stage=parsed.get("stage"),
        files=files,
        tasks=tasks,
        points=parsed.get("points"),
        has_pictures=parsed.get("pictures") is not False,
    )


def render(head: Head, tasks: dict[str, str], files: Mapping[str, Blob]) -> bytes:
    """Bytes of a manifest, determined by these facts alone."""
    facts = {"format": FORMAT, **head, "tasks": tasks, "files": {path: fields_of(blob) for path, blob in files.items()}}
    text = json.dumps(facts, indent=1, sort_keys=True, ensure_ascii=False, allow_nan=False)
    return f"{text}\n".encode()


def read_of(out: Path, stage: Any) -> Manifest:
    """The manifest in a folder, for builds of this stage; UsageError if it holds another one, or is no folder."""
    if not (nearest := nearest_existing(out)).is_dir():
        flaw = "is a file" if nearest == out.absolute() else f"would lie below the file {nearest}"
        raise UsageError(f"the output folder {out} {flaw}", hint="choose another folder with -o")
    present = read(out)
    if present.stage is not None and present.stage != stage:
        raise UsageError(
            f"{out} holds a build of another stage: {present.stage!r}, not {stage!r}",
            hint="choose another folder with -o, or delete that one",
        )
    return present


def is_plain_path(path: str) -> bool:
    """Whether a name is a relative POSIX path that stays inside its folder."""
    parts = path.split("/")
    return all(part not in ("", ".", "..") for part in parts) and "\0" not in path and "\\" not in path
