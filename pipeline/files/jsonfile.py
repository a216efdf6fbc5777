"""JSON files for people: indented by two spaces, keys in the order of the author."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.damaged import DamagedFile
from pipeline.records.plain import Json as Json

_WORDS = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def write_json(path: str | Path, obj: Any) -> None:
    """Write plain values, UTF-8, with a final line feed.

    Floats are written by `repr`; infinities as the strings "inf" and "-inf", which `float` reads, because JSON has no
    word for them. NaN, and types other than plain ones and arrays, are refused; the error names their location.
    """
    Path(path).write_bytes(json_bytes(obj))


def json_bytes(obj: Any) -> bytes:
    """The text that `write_json` writes, as bytes."""
    return (_text(obj, "\n", ("$",)) + "\n").encode()


def _text(value: Any, newline: str, location: tuple[str, ...]) -> str:
    """JSON text with a line per item, but lists of plain values, such as the row of a matrix, on one line.

    `newline` has the indentation of the value; `location` is its path in the file, for errors.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, float):
        if math.isnan(value):
            raise ValueError(f"{''.join(location)}: NaN has no place in a JSON file")
        return f'"{float(value)!r}"' if math.isinf(value) else float.__repr__(value)
    if value is None or isinstance(value, bool | int | str):
        return _WORDS.encode(value)
    row = isinstance(value, list | tuple) and all(type(item) is float for item in value)
    if row and all(map(math.isfinite, value)):
        # Rows of matrices, thousands of them: ten times as fast as the loop below
        return f"[{', '.join(map(repr, value))}]"
    deeper = newline + "  "
    if isinstance(value, dict) and all(isinstance(name, str) for name in value):
        items = [
            f"{_WORDS.encode(name)}: {_text(item, deeper, (*location, '.', name))}" for name, item in value.items()
        ]
        return f"{{{deeper}{f',{deeper}'.join(items)}{newline}}}" if items else "{}"
    if isinstance(value, list | tuple):
        items = [_text(item, deeper, (*location, f"[{i}]")) for i, item in enumerate(value)]
        plain = not any(isinstance(item, dict | list | tuple | np.ndarray) for item in value)
        return f"[{', '.join(items)}]" if plain else f"[{deeper}{f',{deeper}'.join(items)}{newline}]"
    name = type(value).__name__
    raise TypeError(f"{''.join(location)}: JSON cannot hold a {name} (or a dict with keys that are not text)")


def read_json(path: str | Path) -> Any:
    """Read a JSON file. Infinities remain the strings that `write_json` made of them.

    Raises DamagedFile: it is not JSON in UTF-8; bare NaN and Infinity are not JSON.
    """
    try:
        return json.loads(Path(path).read_bytes().decode(), parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise DamagedFile(path, f"not JSON ({error.msg})", line=error.lineno) from error
    except ValueError as error:
        raise DamagedFile(path, f"not JSON ({error})") from error
    except RecursionError as error:
        raise DamagedFile(path, "JSON nested too deeply") from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON value")
