"""Drawings that a user asks for by name, as SVG or PDF; other files with that name are not overwritten."""

import os
from pathlib import Path

from pipeline.errors import UsageError

SAYS = "drawn by pipeline"
"""Text in a comment of every drawing, by which it is recognised as replaceable."""


def write_drawing(path: Path, drawing: str | bytes) -> None:
    """Write a drawing, SVG (text without the comment) or PDF (bytes with it); an earlier drawing of ours is
    replaced.

    Raises
    ------
    UsageError
        The name belongs to a link or to a file that is not one of our drawings.
    OSError
        The path cannot be written: it is a folder, or its folder does not exist.
    """
    is_ours = path.is_file() and SAYS.encode() in path.read_bytes()
    if os.path.lexists(path) and not path.is_dir() and not is_ours:
        raise UsageError(f"{path} is there and is no drawing of ours", hint="choose another name, or remove it")
    path.write_bytes(drawing if isinstance(drawing, bytes) else f"{drawing.rstrip()}\n<!-- {SAYS} -->\n".encode())
