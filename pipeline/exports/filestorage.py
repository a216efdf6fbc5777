"""Text of OpenCV's FileStorage, YAML and XML: what several consumers read."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

_KINDS = {"f8": "d", "f4": "f", "i4": "i"}


def yaml_text(remarks: Iterable[str], values: Mapping[str, Any]) -> str:
    """Matrices, numbers and texts as FileStorage YAML.

    Parameters
    ----------
    values : mapping of str to array, int, float or str
        Arrays are matrices of two dimensions, or three for one with channels, of float64, float32 or int32.
    """
    lines = ["%YAML:1.0", *(f"# {line}" for line in remarks), "---"]
    for name, value in values.items():
        lines += _matrix(name, value) if isinstance(value, np.ndarray) else [f"{name}: {_scalar(value)}"]
    return "\n".join([*lines, ""])


def xml_text(name: str, values: Mapping[str, Any]) -> str:
    """Numbers, and tuples of numbers, below one node of FileStorage XML; it has no place for remarks."""
    lines = ['<?xml version="1.0"?>', "<opencv_storage>", f"<{name}>"]
    for key, value in values.items():
        many = isinstance(value, tuple | list | np.ndarray)
        cells = [real(one) if isinstance(one, float) else str(int(one)) for one in (value if many else [value])]
        lines.append(f"  <{key}>{' '.join(cells)}</{key}>")
    return "\n".join([*lines, f"</{name}>", "</opencv_storage>", ""])


def real(value: float) -> str:
    """A number that parses as real: its reader refuses integers."""
    text = repr(float(value))
    return text if any(mark in text for mark in ".en") else f"{text}."


def _matrix(name: str, value: np.ndarray) -> list[str]:
    kind = _KINDS[value.dtype.str[1:]]
    channels = value.shape[2] if value.ndim == 3 else 1
    numbers = value.ravel().tolist()
    cells = [real(float(number)) for number in numbers] if kind != "i" else list(map(str, numbers))
    rows = [", ".join(cells[start : start + 4]) for start in range(0, len(cells), 4)]
    data = ",\n       ".join(rows)
    return [
        f"{name}: !!opencv-matrix",
        f"   rows: {value.shape[0]}",
        f"   cols: {value.shape[1]}",
        f"   dt: {kind}" if channels == 1 else f'   dt: "{channels}{kind}"',
        f"   data: [ {data} ]",
    ]


def _scalar(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    return real(value) if isinstance(value, float) else str(int(value))
