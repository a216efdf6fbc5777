"""Conversion of frozen dataclasses to plain JSON values and back. Only plain values are passed between processes."""

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class Shared(dict[str, Any]):
    """A plain part of many records: it is not copied, and its encoding is made once. Nobody may change it."""

    made: bytes | None = None

    def once(self, make: Callable[[dict[str, Any]], bytes]) -> bytes:
        """Bytes made from the dict, always by the same function, cached."""
        if self.made is None:
            self.made = make(self)
        return self.made


def to_plain(record: Any) -> Any:
    """A record as dicts, lists, numbers, strings and None. -0.0 becomes 0.0; NaN is refused."""
    if record is None or isinstance(record, bool | int | str | Shared):
        return record
    if isinstance(record, float):
        if math.isnan(record):
            raise ValueError("a record cannot hold NaN")
        return float(record) + 0.0
    if isinstance(record, tuple | list):
        return [to_plain(item) for item in record]
    if isinstance(record, dict):
        return {str(name): to_plain(item) for name, item in record.items()}
    if dataclasses.is_dataclass(record) and not isinstance(record, type):
        return {f.name: to_plain(getattr(record, f.name)) for f in dataclasses.fields(record)}
    raise TypeError(f"a record cannot hold a {type(record).__name__}")


def from_plain(cls: type[T], plain: Any) -> T:
    """The record written by `to_plain`; unknown or missing fields raise TypeError."""
    return _value(cls, plain)


@functools.cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _value(hint: Any, plain: Any) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if plain is None and type(None) in args:
            return None
        return _value(next(a for a in args if a is not type(None)), plain)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        hints = _hints(hint)
        return hint(**{name: _value(hints[name], item) for name, item in plain.items()})
    if origin is tuple:
        item_hints = args[:1] * len(plain) if args[-1] is Ellipsis else args
        return tuple(_value(h, p) for h, p in zip(item_hints, plain, strict=True))
    if origin is dict:
        return {name: _value(args[1], item) for name, item in plain.items()}
    return float(plain) if hint is float else plain
