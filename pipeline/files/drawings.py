"""Drawings under a name that the user chose, as SVG or PDF; foreign files of that name are not overwritten.

A page of PDF 1.4 (ISO 32000-1) holds only filled paths and lines of Helvetica, and equal pages give equal bytes. The
viewer preference `PrintScaling` asks for prints at 100 %.
"""

import os
from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.folders import put

SAYS = "drawn by pipeline"
"""Text in a comment of every drawing that marks it as ours, and replaceable."""
_POINTS_PER_MM = 72 / 25.4
"""Unit of a page: 72 points are an inch."""


def write_drawing(path: Path, drawing: str | bytes) -> None:
    """Write a drawing, SVG text or PDF bytes, in place of one of ours; UsageError if something else is there."""
    is_ours = path.is_file() and SAYS.encode() in path.read_bytes()
    if os.path.lexists(path) and not path.is_dir() and not is_ours:
        raise UsageError(f"{path} is there and is no drawing of ours", hint="choose another name, or remove it")
    put(path, drawing if isinstance(drawing, bytes) else f"{drawing.rstrip()}\n<!-- {SAYS} -->\n".encode())


def pdf_bytes(pages: Sequence[tuple[float, float, str]]) -> bytes:
    """A PDF file of pages: width and height [mm], drawing operators in mm from the lower left; `/F1` is Helvetica."""
    first = 4
    kids = " ".join(f"{first + 2 * i} 0 R" for i in range(len(pages)))
    objects = [
        "<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        f"<< /Type /Pages /Kids [{kids}] /Count {len(pages)} >>",
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    for i, (width_mm, height_mm, operators) in enumerate(pages):
        box = f"0 0 {width_mm * _POINTS_PER_MM:.6f} {height_mm * _POINTS_PER_MM:.6f}"
        resources = "/Resources << /Font << /F1 3 0 R >> >>"
        objects.append(
            f"<< /Type /Page /Parent 2 0 R /MediaBox [{box}] {resources} /Contents {first + 2 * i + 1} 0 R >>"
        )
        content = f"q {_POINTS_PER_MM:.12f} 0 0 {_POINTS_PER_MM:.12f} 0 0 cm\n{operators}\nQ\n"
        objects.append(f"<< /Length {len(content.encode('latin-1', 'replace'))} >>\nstream\n{content}endstream")
    data = f"%PDF-1.4\n% {SAYS}\n".encode()
    offsets = []
    for number, text in enumerate(objects, start=1):
        offsets.append(len(data))
        data += f"{number} 0 obj\n{text}\nendobj\n".encode("latin-1", "replace")
    table = "".join(f"{offset:010d} 00000 n \n" for offset in offsets)
    size = len(objects) + 1
    tail = f"trailer\n<< /Size {size} /Root 1 0 R >>\nstartxref\n{len(data)}\n%%EOF\n"
    return data + f"xref\n0 {size}\n0000000000 65535 f \n{table}{tail}".encode("ascii")
