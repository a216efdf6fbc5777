"""Conversion of frozen dataclasses to plain JSON values and back. Only plain values are passed between processes."""

import base64
import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")
Json = dict[str, Any]
"""A JSON object as `json` reads it; docs/outputs.md describes the keys of our files."""


class Shared(dict[str, Any]):
    """A plain part of many records, encoded once and never copied. Nobody may change it."""

    encoded: bytes | None = None

    def once(self, encode: Callable[[Json], bytes]) -> bytes:
        """Cached bytes of the dict, always encoded by the same function."""
        if self.encoded is None:
            self.encoded = encode(self)
        return self.encoded


class ByContent:
    """A record with arrays, equal to another if their plain values are equal."""

    def __eq__(self, other: object) -> bool:
        return self is other or (type(self) is type(other) and bool(to_plain(self) == to_plain(other)))

    __hash__ = object.__hash__


_PLAIN = (bool, int, str, Shared, type(None))
"""Types whose values are plain already."""


def to_plain(record: Any) -> Any:
    """A record as dicts, lists, numbers, strings and None; an array as its bytes. -0.0 becomes 0.0; NaN is refused."""
    if hasattr(record, "__array_interface__"):  # NumPy itself would take longer to load than most work of the engine
        if (record != record).any():
            raise ValueError("a record cannot hold NaN")
        values = record + record.dtype.type(0)
        return {
            "bytes": base64.b64encode(values.tobytes()).decode(),
            "dtype": values.dtype.str,
            "shape": list(values.shape),
        }
    if isinstance(record, float):
        if math.isnan(record):
            raise ValueError("a record cannot hold NaN")
        return float(record) + 0.0
    if isinstance(record, _PLAIN):
        return record
    if isinstance(record, tuple | list):
        if {*map(type, record)} == {float} and not math.isnan(sum(record)):  # rows of numbers, of which none is NaN
            return [item + 0.0 for item in record]
        return [to_plain(item) for item in record]
    if isinstance(record, dict):
        return {str(name): to_plain(item) for name, item in record.items()}
    return {name: to_plain(getattr(record, name)) for name in _hints(type(record))}  # type: ignore[arg-type]


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    if not dataclasses.is_dataclass(cls):
        raise TypeError(f"a record cannot hold a {cls.__name__}")
    hints = typing.get_type_hints(cls)
    return {field.name: hints[field.name] for field in dataclasses.fields(cls)}


def from_plain(kind: type[T], plain: Any) -> T:
    """The record written by `to_plain`; unknown fields raise KeyError, missing ones TypeError."""
    hint: Any = kind
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        is_none = plain is None and type(None) in args
        return None if is_none else from_plain(next(a for a in args if a is not type(None)), plain)  # type: ignore
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints = _hints(hint)
        return hint(**{name: from_plain(hints[name], item) for name, item in plain.items()})  # type: ignore
    value = plain
    if origin is tuple:
        item_hints = args[:1] * len(plain) if args[-1] is ... else args
        value = tuple(from_plain(item_hint, item) for item_hint, item in zip(item_hints, plain, strict=True))
    elif origin is dict:
        value = {name: from_plain(args[1], item) for name, item in plain.items()}
    elif isinstance(plain, dict) and "bytes" in plain:
        import numpy as np  # see above

        value = np.frombuffer(base64.b64decode(plain["bytes"]), plain["dtype"]).reshape(plain["shape"])
    elif hint is float:
        value = float(plain)
    return typing.cast(T, value)
