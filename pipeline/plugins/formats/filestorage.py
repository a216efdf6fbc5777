"""MATLAB files and OpenCV's FileStorage, which several programs read.

All of OpenCV that exports need enters here, when it is used.
"""

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

_HEADER = 116
"""Bytes of the text that a MATLAB 5 file begins with."""


def write_mat(path: Path, values: Mapping[str, Any]) -> None:
    """Write a MATLAB 5 file whose header holds no date; a dict is a struct, a list of texts a cell array."""
    from scipy.io import savemat

    stream = io.BytesIO()
    cells = {name: np.array(value, dtype=object) for name, value in values.items() if isinstance(value, list)}
    savemat(stream, {**values, **cells}, do_compression=True)
    text = "MATLAB 5.0 MAT-file, by plenoptic-pipeline".ljust(_HEADER).encode()
    path.write_bytes(text + stream.getvalue()[_HEADER:])


def yaml_text(remarks: Iterable[str], values: Mapping[str, Any]) -> str:
    """Matrices, numbers and texts as YAML, below remarks."""
    import cv2

    storage = cv2.FileStorage(".yml", cv2.FileStorage_WRITE | cv2.FileStorage_MEMORY)
    storage.writeComment("\n".join(remarks))
    for name, value in values.items():
        storage.write(name, value)
    return storage.releaseAndGetString()


def yaml_real(value: float) -> str:
    """A number that YAML takes for real: not 1e-05, which has no point."""
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")
