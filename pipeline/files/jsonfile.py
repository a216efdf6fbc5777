"""JSON files that people read: two spaces, keys in the order of the author."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.damaged import DamagedFile


def write_json(path: str | Path, obj: Any) -> None:
    """Write plain values, UTF-8, with a final line feed.

    Parameters
    ----------
    path : path
        File to write.
    obj : dict, list, tuple, array, str, number, bool or None
        Floats are written by `repr`; infinities as the strings "inf" and "-inf", which `float` reads, because JSON
        has no word for them; NaN and other types are refused with the place where they stand.
    """
    Path(path).write_bytes(json_bytes(obj))


def json_bytes(obj: Any) -> bytes:
    """What `write_json` writes."""
    return (_text(_plain(obj, "$"), "\n") + "\n").encode()


def _text(value: Any, newline: str) -> str:
    """JSON text with a line per item, but lists of plain values, such as the row of a matrix, on one line."""
    deeper = newline + "  "
    if isinstance(value, dict) and value:
        items = [f"{_word(name)}: {_text(item, deeper)}" for name, item in value.items()]
        return "{" + deeper + f",{deeper}".join(items) + newline + "}"
    if isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        return "[" + deeper + f",{deeper}".join(_text(item, deeper) for item in value) + newline + "]"
    return _word(value)


def _word(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_json(path: str | Path) -> Any:
    """Read a JSON file. Infinities stay the strings that `write_json` made of them.

    Raises
    ------
    DamagedFile
        If it is not JSON in UTF-8; bare NaN and Infinity are not JSON.
    """
    try:
        return json.loads(Path(path).read_bytes().decode(), parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise DamagedFile(path, f"not JSON ({error.msg})", line=error.lineno) from error
    except ValueError as error:
        raise DamagedFile(path, f"not JSON ({error})") from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON value")


def _plain(value: Any, where: str) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return _plain_float(value, where)
    if isinstance(value, list | tuple):
        return [_plain(item, f"{where}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: _plain(item, f"{where}.{key}") for key, item in value.items()}
    raise TypeError(f"{where}: JSON cannot hold a {type(value).__name__} (or a dict with keys that are not text)")


def _plain_float(value: float, where: str) -> float | str:
    if math.isnan(value):
        raise ValueError(f"{where}: NaN has no place in a JSON file")
    return repr(float(value)) if math.isinf(value) else float(value)
