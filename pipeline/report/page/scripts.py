"""Scripts that carry the data of the page: a page from disk may load scripts, and nothing else."""

import json
from pathlib import Path
from typing import Any

from pipeline.records.plain import to_plain

_FUNCTION = "plenopticReport"
"""Name of the function that a script calls with its name and its data."""


class Scripts:
    """The scripts of one report, below `data/`."""

    def __init__(self, report: Path) -> None:
        self.report = report
        self.written: set[str] = set()

    def write(self, name: str, record: Any) -> str:
        """Write a record; returns the path of its script below the report."""
        place = f"data/{name}.js"
        text = json.dumps(to_plain(record), separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        replace(self.report / place, f"{_FUNCTION}({json.dumps(name)},{text});\n".encode())
        self.written.add(place)
        return place

    def keep(self, name: str) -> str | None:
        """Path of a script of an earlier report that is still true; None if there is none."""
        place = f"data/{name}.js"
        if not (self.report / place).is_file():
            return None
        self.written.add(place)
        return place

    def remove_others(self) -> None:
        """Remove scripts that this report does not have."""
        for path in (self.report / "data").glob("*.js"):
            if f"data/{path.name}" not in self.written:
                path.unlink()


def replace(path: Path, content: bytes) -> None:
    """Write a file aside and put it into place, unless it is there already."""
    if path.is_file() and path.read_bytes() == content:
        return
    aside = path.with_name(f"{path.name}.new")
    aside.write_bytes(content)
    aside.replace(path)
