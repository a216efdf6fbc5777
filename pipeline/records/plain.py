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
    kind = type(record)
    if kind is float and record == record:
        return record + 0.0
    if kind in _PLAIN:
        return record
    if kind is tuple or kind is list:
        return _list(record)
    if names := _names(kind):  # type: ignore[arg-type]  # a type can be hashed
        return {name: to_plain(getattr(record, name)) for name in names}
    return _rare(record)


_PLAIN = frozenset({type(None), bool, int, str, Shared})
"""Types whose values are plain already."""


def _list(items: list[Any] | tuple[Any, ...]) -> list[Any]:
    """Items as plain values. Most are rows of numbers, which one loop converts; a sum is NaN if one of them is."""
    if {*map(type, items)} == {float} and not math.isnan(sum(items)):
        return [item + 0.0 for item in items]
    return [to_plain(item) for item in items]


@functools.cache
def _names(kind: type) -> tuple[str, ...]:
    """Names of the fields of a type of records; none for other types."""
    return tuple(field.name for field in dataclasses.fields(kind)) if dataclasses.is_dataclass(kind) else ()


def _rare(record: Any) -> Any:
    """A value of a type derived from a plain one, a dict, or a record without fields."""
    if isinstance(record, bool | int | str | Shared):
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
        return {}
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
