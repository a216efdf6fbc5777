"""NumPy's own files: arrays between tasks, and archives for users."""

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from tokenize import TokenError
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy

from pipeline.files.damaged import DamagedFile

_HEADER_BYTES = 4096
"""Longest header of a file [bytes]: that of a plain array has 128. NumPy parses it as Python."""


def write_npy(path: str | Path, array: np.ndarray) -> None:
    """Write an array of numbers. `np.save` would report a full disk only by the number of bytes written."""
    rows_first = np.ascontiguousarray(array)
    with Path(path).open("wb") as stream:
        npy.write_array_header_1_0(stream, npy.header_data_from_array_1_0(rows_first))
        stream.write(rows_first.data)


def write_npz(path: Path, remarks: Iterable[str], arrays: Mapping[str, Any]) -> None:
    """Write arrays without pickles, after remarks; `np.load` opens them."""
    with path.open("wb") as stream:
        np.savez(stream, remarks=np.array(tuple(remarks)), **arrays)


def append_npy(path: Path, rows: np.ndarray, count: Callable[[], int]) -> None:
    """Append rows to a file whose array will have `count()` rows in the end; the first call creates it."""
    if not path.exists():
        head = {"descr": npy.dtype_to_descr(rows.dtype), "fortran_order": False, "shape": (count(), *rows.shape[1:])}
        with path.open("wb") as stream:
            npy.write_array_header_1_0(stream, head)
    with path.open("ab") as stream:
        stream.write(np.ascontiguousarray(rows).data)


def read_npy(path: str | Path) -> np.ndarray:
    """Read an array of numbers. The size in the header is compared with that of the file before memory is allocated.

    Raises DamagedFile: it is not an .npy file, holds objects (which would be a pickle), or has not as many bytes as its
        header states.
    """
    with Path(path).open("rb") as stream:
        _header(stream, Path(path))
    return np.load(path, allow_pickle=False)  # type: ignore[no-any-return]


class StackedRows:
    """Arrays in files of `write_npy`, alike but for their number of rows, read as one; raises as `read_npy`."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = paths
        shapes = []
        for path in paths:
            with path.open("rb") as stream:
                shapes.append(_header(stream, path)[0])
        self._edges = np.cumsum([0, *(shape[0] for shape in shapes)]).tolist()
        self.shape = int(self._edges[-1]), *shapes[0][1:]

    def rows(self, first: int, end: int) -> np.ndarray:
        """The rows [first, end) of the stack."""
        pieces = []
        for path, above, below in zip(self._paths, self._edges, self._edges[1:], strict=False):
            low = max(first, above)
            high = min(end, below)
            if low < high:
                pieces.append(np.asarray(np.load(path, mmap_mode="r"))[low - above : high - above])
        return np.concatenate(pieces)


def _header(stream: BinaryIO, path: Path) -> tuple[tuple[int, ...], np.dtype]:
    """Shape and type; the stream is then at the first number."""
    try:
        version = npy.read_magic(stream)
        read_header = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}[version]
        shape, _, dtype = read_header(stream, max_header_size=_HEADER_BYTES)
    except (ValueError, KeyError, OSError, SyntaxError, TypeError, TokenError) as error:
        raise DamagedFile(path, f"not a readable .npy file ({error})") from error
    if dtype.hasobject:
        raise DamagedFile(path, "it holds objects, not numbers")
    promised = math.prod(shape) * dtype.itemsize
    actual = path.stat().st_size - stream.tell()
    if min(shape, default=0) < 0 or promised != actual:
        raise DamagedFile(path, f"its header promises {promised} bytes, and there are {actual}")
    return shape, dtype
