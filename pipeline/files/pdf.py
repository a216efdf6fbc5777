"""Vector pages as PDF 1.4: filled paths and lines of Helvetica, nothing else. The same pages give the same bytes.

Format: ISO 32000-1. The viewer preference `PrintScaling` asks for prints at 100 %.
"""

from collections.abc import Sequence
from pathlib import Path

from pipeline.files.drawings import SAYS, write_drawing

_POINTS_PER_MM = 72 / 25.4
"""Unit of a page: 72 points are an inch."""


def pdf_bytes(pages: Sequence[tuple[float, float, str]]) -> bytes:
    """A PDF file.

    Parameters
    ----------
    pages : sequence of (float, float, str)
        Width and height [mm], and drawing operators in millimetres from the lower left corner; `/F1` is Helvetica.
    """
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
    return _file(objects)


def write_pdf(path: Path, pages: Sequence[tuple[float, float, str]]) -> None:
    """Write `pdf_bytes`."""
    write_drawing(path, pdf_bytes(pages))


def _file(objects: list[str]) -> bytes:
    data, places = f"%PDF-1.4\n% {SAYS}\n".encode(), []
    for number, text in enumerate(objects, start=1):
        places.append(len(data))
        data += f"{number} 0 obj\n{text}\nendobj\n".encode("latin-1", "replace")
    table = "".join(f"{place:010d} 00000 n \n" for place in places)
    size = len(objects) + 1
    tail = f"trailer\n<< /Size {size} /Root 1 0 R >>\nstartxref\n{len(data)}\n%%EOF\n"
    return data + f"xref\n0 {size}\n0000000000 65535 f \n{table}{tail}".encode("ascii")
