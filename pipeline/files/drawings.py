"""Drawings that a person asks for by name, SVG and PDF: whatever else has that name stays."""

import os
from pathlib import Path

from pipeline.errors import UsageError

SAYS = "drawn by pipeline"
"""In a comment of every drawing: by this it is known to be replaceable."""


def write_drawing(path: Path, drawing: str | bytes) -> None:
    """Write a drawing, SVG as text without the comment or PDF as bytes with it; one of ours may be replaced.

    Raises
    ------
    UsageError
        A file that is no drawing of ours, or a link, has the name.
    OSError
        Nothing can be written there: a folder, no folder around it.
    """
    is_ours = path.is_file() and SAYS.encode() in path.read_bytes()
    if os.path.lexists(path) and not path.is_dir() and not is_ours:
        raise UsageError(f"{path} is there and is no drawing of ours", hint="choose another name, or remove it")
    path.write_bytes(drawing if isinstance(drawing, bytes) else f"{drawing.rstrip()}\n<!-- {SAYS} -->\n".encode())
