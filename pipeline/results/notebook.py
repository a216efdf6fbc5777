"""Records on screens: Matplotlib figures, the only door to that library, and HTML tables for notebooks."""

import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from pipeline.errors import UsageError

_INSTALL = 'python -m pip install "plenoptic-pipeline[plot]"'


def axes(width_in: float, height_in: float) -> Any:
    """Empty axes in a new figure of this size [inch], which notebooks show below the cell.

    Raises UsageError: Matplotlib is not installed.
    """
    require_plots()
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width_in, height_in), layout="constrained").add_subplot()


def figure(width_in: float, height_in: float) -> Any:
    """An empty figure of this size [inch] for `svg_of`, which no notebook shows; raises as `axes`."""
    require_plots()
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def svg_of(figure: Any) -> str:
    """A figure as the text of an SVG file without a date; its words remain text."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "plenoptic-pipeline"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


def require_plots() -> None:
    """UsageError if Matplotlib is not installed."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise UsageError("matplotlib is not installed, and plots need it", hint=_INSTALL) from None


def html_table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """A table with a heading; numbers have six digits, and all text is escaped."""
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(_text(cell))}</td>' for cell in row)}</tr>" for row in rows)
    title = f'<caption style="text-align:left">{escape(caption)}</caption>' if caption else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _text(cell: object) -> str:
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
