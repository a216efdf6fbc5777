"""Records on screens: figures of matplotlib, which enters here alone, and tables as HTML for notebooks."""

import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

from pipeline.errors import UsageError

_INSTALL = 'python -m pip install "plenoptic-pipeline[plot]"'


def axes(width_in: float, height_in: float) -> Any:
    """Empty axes in a figure of their own of that size [inch], which notebooks show below the cell.

    Raises UsageError: matplotlib is not installed.
    """
    require_plots()
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width_in, height_in), layout="constrained").add_subplot()


def figure(width_in: float, height_in: float) -> Any:
    """An empty figure of that size [inch] for `svg_of`, which no notebook shows; UsageError as of `axes`."""
    require_plots()
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in), layout="constrained")


def svg_of(figure: Any) -> str:
    """A figure as the text of an SVG file: its words stay words, and no date is in it."""
    import matplotlib

    stream = io.StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "plenoptic-pipeline"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return stream.getvalue()


def require_plots() -> None:
    """UsageError if matplotlib is not installed."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise UsageError("matplotlib is not installed, and plots need it", hint=_INSTALL) from None


def html_table(columns: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """A table with a heading; numbers have six digits, and all texts are escaped."""
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(_shown(cell))}</td>' for cell in row)}</tr>" for row in rows)
    title = f'<caption style="text-align:left">{escape(caption)}</caption>' if caption else ""
    return f"<table>{title}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _shown(cell: object) -> str:
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
