"""Records as notebooks show them: axes of matplotlib, which enters here alone, and tables as HTML."""

from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from pipeline.errors import UsageError

_INSTALL = 'python -m pip install "plenoptic-pipeline[plot]"'


def axes(width_in: float, height_in: float, *, rows: int = 1, columns: int = 1) -> Any:
    """Empty axes in a figure of their own, which notebooks show below the cell.

    `width_in`, `height_in`: size of the figure [inch].
    `rows`, `columns`: size of a grid of axes, which then are an array (rows, columns) with common scales.
    Raises UsageError: matplotlib is not installed.
    """
    try:
        from matplotlib import pyplot
    except ImportError:
        raise UsageError("matplotlib is not installed, and plots need it", hint=_INSTALL) from None
    figure = pyplot.figure(figsize=(width_in, height_in), layout="constrained")
    if rows == columns == 1:
        return figure.add_subplot()
    return figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)


def html_table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """A table with a heading; numbers have six digits, and all texts are escaped."""
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(_shown(cell))}</td>' for cell in row)}</tr>" for row in rows)
    title = f'<caption style="text-align:left">{escape(caption)}</caption>' if caption else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _shown(cell: object) -> str:
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
