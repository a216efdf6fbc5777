"""Tables as NumPy record arrays, and as pandas where that is installed."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.errors import UsageError
from pipeline.files.tables import Table

if TYPE_CHECKING:
    import pandas

_INSTALL = 'python -m pip install "plenoptic-pipeline[frames]"'
MICROLENS = frozenset({"microlens_k", "microlens_l", "microlens_type"})
"""Columns that a conventional camera has no values for."""
_TEXTS = frozenset({"camera", "channel", "second_camera", "target", "method"})
_COUNTS = MICROLENS | {"frame", "point_id", "complete"}


def rows_of(table: Table, without: frozenset[str] = frozenset()) -> np.recarray:
    """A table as a record array: text, int64, and float64 that is NaN where a cell is empty.

    Parameters
    ----------
    without : frozenset of str
        Columns to leave out.
    """
    columns = {name: _column(table, name) for name in table.columns if name not in without}
    return np.rec.fromarrays(list(columns.values()), dtype=[(name, column.dtype) for name, column in columns.items()])


def joined(parts: Sequence[np.recarray]) -> np.recarray:
    """Rows of several tables with the same columns.

    Raises
    ------
    UsageError
        Columns differ, as those of a plenoptic and a conventional camera do.
    """
    names = {part.dtype.names for part in parts}
    if len(names) > 1:
        raise UsageError(
            "tables of plenoptic and conventional cameras have different columns",
            hint="take those of one camera: output.cameras[NAME].correspondences",
        )
    return np.concatenate(parts).view(np.recarray) if parts else np.recarray(0, dtype=[])


def as_pandas(rows: np.ndarray) -> "pandas.DataFrame":
    """Rows as a data frame.

    Raises
    ------
    UsageError
        pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise UsageError("pandas is not installed", hint=_INSTALL) from None
    return pandas.DataFrame({name: rows[name] for name in rows.dtype.names or ()})


def write_parquet(path: Path, rows: np.ndarray, remarks: Sequence[str]) -> None:
    """Write rows as Parquet; its metadata hold the remarks, `attrs` of the data frame.

    Raises
    ------
    UsageError
        pandas or pyarrow is not installed.
    """
    frame = as_pandas(rows)
    frame.attrs["remarks"] = list(remarks)
    try:
        frame.to_parquet(path, engine="pyarrow", index=False)
    except ImportError:
        raise UsageError("pyarrow is not installed", hint=_INSTALL) from None


def _column(table: Table, name: str) -> np.ndarray:
    if name in _TEXTS:
        return np.array(table.columns[name], dtype=str)
    if name not in _COUNTS:
        return table.numbers(name)
    cells: list[Any] = table.columns[name]
    return np.array(cells, dtype=np.int64)
