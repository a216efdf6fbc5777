"""Axes of matplotlib for plots of records. All of matplotlib enters here, and only when something is plotted."""

from typing import Any

from pipeline.errors import UsageError

_INSTALL = 'python -m pip install "plenoptic-pipeline[plot]"'


def axes(width_in: float, height_in: float, *, rows: int = 1, columns: int = 1) -> Any:
    """Empty axes in a figure of their own, which notebooks show below the cell.

    Parameters
    ----------
    width_in, height_in : float
        Size of the figure [inch].
    rows, columns : int
        Size of a grid of axes, which then are an array (rows, columns) with common scales.

    Raises
    ------
    UsageError
        matplotlib is not installed.
    """
    try:
        from matplotlib import pyplot
    except ImportError:
        raise UsageError("matplotlib is not installed, and plots need it", hint=_INSTALL) from None
    figure = pyplot.figure(figsize=(width_in, height_in), layout="constrained")
    if rows == columns == 1:
        return figure.add_subplot()
    return figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
