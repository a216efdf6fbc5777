"""Types of values as declared by annotations: checking values, and naming types in messages."""

import collections.abc
import enum
import math
import numbers
import os
import types
import typing
from collections.abc import Iterable
from pathlib import Path
from typing import Any

WRONG = object()
"""Result for a value that does not fit its type."""
_WIDEST = 1 << 63
"""First whole number that does not fit into 64 bits with a sign."""
_LARGEST = 1e12
"""Largest magnitude of lengths, angles and other numbers of a camera: their squares are finite."""
_WORDS = {int: "a whole number", str: "a text", bool: "True or False", Path: "a Path", type(None): "None"}


class Sizes(enum.Enum):
    """Sizes that a number may have; NaN has none."""

    USUAL = f"of at most {_LARGEST:g}"
    OR_INFINITE = f"of at most {_LARGEST:g}, or inf"
    FINITE = "that is finite"

    def hold(self, value: float) -> bool:
        """Whether a number has such a size."""
        if self is Sizes.FINITE:
            return math.isfinite(value)
        return abs(value) <= _LARGEST or (self is Sizes.OR_INFINITE and math.isinf(value))


def held_by(hint: Any, value: Any, sizes: Sizes = Sizes.USUAL) -> Any:
    """A value as stored in a field or argument of this type, or WRONG: sequences become tuples, NumPy numbers those
    of Python.
    """
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        found = (held_by(kind, value, sizes) for kind in kinds)
        return next((one for one in found if one is not WRONG), WRONG)
    if origin is tuple:
        return _tuple(kinds, value, sizes)
    if origin is collections.abc.Callable:
        return value if callable(value) else WRONG
    if origin is collections.abc.Iterable:
        items = value if isinstance(value, list | tuple) else list(value) if _is_many(value) else value
        return _tuple((*kinds, ...), items, sizes)
    if hint is Path:
        return value if isinstance(value, os.PathLike) else WRONG
    if hint is float:
        return _float(value, sizes)
    if hint is int:
        is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
        return int(value) if is_whole and -_WIDEST <= value < _WIDEST else WRONG
    if hint is bool and type(value).__name__ == "bool_":  # NumPy's
        return bool(value)
    return value if isinstance(value, hint) else WRONG


def _is_many(value: Any) -> bool:
    """Whether a value is a sequence; a text counts as one value."""
    return isinstance(value, Iterable) and not isinstance(value, str | bytes) and not hasattr(value, "tolist")


def _float(value: Any, sizes: Sizes) -> Any:
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return WRONG
    try:
        as_float = float(value)
    except OverflowError:
        return WRONG
    if not sizes.hold(as_float):
        return WRONG
    return value if type(value) in (int, float) else as_float


def _tuple(kinds: tuple[Any, ...], value: Any, sizes: Sizes) -> Any:
    items = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(items, list | tuple):
        return WRONG
    kinds = kinds[:1] * len(items) if kinds[-1] is Ellipsis else kinds
    if len(kinds) != len(items):
        return WRONG
    held = tuple(held_by(kind, item, sizes) for kind, item in zip(kinds, items, strict=True))
    if any(item is WRONG for item in held):
        return WRONG
    same = isinstance(value, tuple) and all(a is b for a, b in zip(held, items, strict=True))
    return value if same else held


def in_words(hint: Any, sizes: Sizes = Sizes.USUAL) -> str:
    """A type of a field or argument in words."""
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(in_words(kind, sizes) for kind in kinds)
    if origin is tuple:
        each = in_words(kinds[0], sizes)
        return f"a sequence, each {each}" if kinds[-1] is Ellipsis else f"{len(kinds)} values, each {each}"
    if origin in (collections.abc.Callable, collections.abc.Iterable):
        return "a function" if origin is collections.abc.Callable else f"a list, each {in_words(kinds[0])}"
    if hint is float:
        return f"a number {sizes.value}"
    return _WORDS.get(hint, f"a {hint.__name__}")
