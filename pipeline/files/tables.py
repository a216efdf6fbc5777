"""Text tables: '#' comment lines, one header row, rows; CSV that any spreadsheet and NumPy can read.

An empty cell means "unknown", never 0.
"""

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.damaged import DamagedFile

_LARGEST = 2**53
"""Number from which floats skip whole ones [1]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table as text."""

    path: Path
    comments: tuple[str, ...]  # the lines before the header, without "# "
    # Cells as written, in the order of the file; "" where a value is unknown
    columns: dict[str, list[str]]

    def line(self, row: int) -> int:
        """Line of a row in its file, of cells without line feeds."""
        return len(self.comments) + 2 + row

    def numbers(self, name: str) -> np.ndarray:
        """A column as (rows,) float64, NaN where the cell is empty. Raises DamagedFile: a cell is no number."""
        values = np.full(len(self.columns[name]), math.nan)
        for row, cell in enumerate(self.columns[name]):
            try:
                values[row] = float(cell or math.nan)
            except ValueError:
                raise DamagedFile(self.path, f"{name} is {cell!r}, no number", line=self.line(row)) from None
        return values

    def whole_numbers(self, name: str) -> np.ndarray:
        """A column as (rows,) int64. Raises DamagedFile: a cell is no whole number, or empty."""
        values = self.numbers(name)
        is_whole = (values == np.round(values)) & (np.abs(values) < _LARGEST)
        if not is_whole.all():
            row = int(is_whole.argmin())
            cell = self.columns[name][row]
            raise DamagedFile(self.path, f"{name} is {cell!r}, no whole number", line=self.line(row))
        return values.astype(np.int64)


def write_table(
    path: str | Path, header_lines: Iterable[str], columns: Mapping[str, Sequence[Any] | np.ndarray]
) -> None:
    """Write columns of equal length, UTF-8, lines ending in a line feed.

    Header lines become comments. Floats are written by `repr`, so that they read back exactly; None, NaN and "" leave
    the cell empty; booleans become 1 and 0; text is quoted only if it must be.
    """
    comments = [f"# {line}".rstrip() for line in header_lines]
    if broken := [line for line in comments if "\n" in line or "\r" in line]:
        raise ValueError(f"a comment of a table must be one line: {broken[0]!r}")
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) != 1:
        raise ValueError(f"a table needs columns of one length, not {lengths}")
    cells = [_cells(column) for column in columns.values()]
    if len(cells) == 1:  # a lone empty cell would be a blank line, which readers skip
        cells = [[cell or '""' for cell in cells[0]]]
    lines = [*comments, ",".join(map(_quoted, columns)), *map(",".join, zip(*cells, strict=True)), ""]
    Path(path).write_bytes("\n".join(lines).encode())


def read_table(path: str | Path) -> Table:
    """Read a table that `write_table` wrote.

    Raises DamagedFile: it has no header, a column name occurs twice, a row is too short or too long, or it is not UTF-8
        text that ends in a line feed.
    """
    try:
        text = Path(path).read_bytes().decode()
    except UnicodeDecodeError as error:
        raise DamagedFile(path, f"not a text file in UTF-8 ({error})") from error
    if not text.endswith("\n"):
        raise DamagedFile(path, "the last line is cut off")
    lines = list(io.StringIO(text, newline="\n"))
    comment_count = next((i for i, line in enumerate(lines) if not line.startswith("#")), len(lines))
    comments = tuple(line[1:].strip() for line in lines[:comment_count])
    reader = csv.reader(lines[comment_count:], strict=True)
    rows: list[list[str]] = []
    try:
        for row in reader:
            if rows and len(row) != len(rows[0]):
                line = comment_count + reader.line_num
                raise DamagedFile(path, f"{len(row)} cells where the header has {len(rows[0])}", line=line)
            rows.append(row)
    except csv.Error as error:
        raise DamagedFile(path, str(error), line=comment_count + reader.line_num) from error
    if not rows or not rows[0]:
        raise DamagedFile(path, "no header row")
    names, *body = rows
    if len(set(names)) < len(names):
        raise DamagedFile(path, "two columns of one name", line=comment_count + 1)
    return Table(
        path=Path(path), comments=comments, columns={name: [row[i] for row in body] for i, name in enumerate(names)}
    )


def _cells(column: Sequence[Any] | np.ndarray) -> list[str]:
    """Cells of a column; a column of one kind, as nearly all are, is converted without inspecting each value."""
    values = column.tolist() if isinstance(column, np.ndarray) else list(column)
    kinds = set(map(type, values))
    if kinds <= {float, np.float64}:
        return [float.__repr__(value) if value == value else "" for value in values]
    if kinds <= {int, np.int64}:
        return list(map(str, values))
    if kinds == {str} and _is_bare("".join(values)):
        return values
    return [_cell(value) for value in values]


def _cell(value: Any) -> str:
    """A value as a cell; empty if it is unknown."""
    if value is None:
        return ""
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, float | np.floating):
        number = float(value)
        return repr(number) if number == number else ""
    if isinstance(value, bool | np.bool_ | int | np.integer):
        return str(int(value))
    raise TypeError(f"a table cannot hold a {type(value).__name__}")


def _is_bare(text: str) -> bool:
    """Whether no part of a text has to be quoted."""
    return not any(mark in text for mark in ',"\n\r#') and text.split() in ([], [text])


def _quoted(text: str) -> str:
    """A text, in quotes if a reader would take it for something else."""
    if any(mark in text for mark in ',"\n\r') or text.startswith("#") or text != text.strip():
        return '"' + text.replace('"', '""') + '"'
    return text
