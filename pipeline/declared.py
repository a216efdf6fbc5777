"""Values of the kinds that a record or a function declares, asked before anything is computed with them.

A stage is judged by `check`; whoever writes records or calls functions in a notebook meets this.
"""

import collections.abc
import dataclasses
import enum
import functools
import inspect
import math
import numbers
import os
import reprlib
import types
import typing
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import PipelineError

F = TypeVar("F", bound=Callable[..., Any])

_WRONG = object()
_WIDEST = 1 << 63
_LARGEST = 1e12
"""Magnitude of lengths, of angles and of anything else that a camera has: their squares are finite."""
_WORDS = {int: "a whole number", str: "a text", bool: "True or False", Path: "a Path", type(None): "None"}


class Sizes(enum.Enum):
    """Sizes that a number may have; NaN has none."""

    USUAL = f"of at most {_LARGEST:g}"
    OR_INFINITE = f"of at most {_LARGEST:g}, or inf"
    FINITE = "that is finite"

    def hold(self, value: float) -> bool:
        """Whether a number is of such a size."""
        if self is Sizes.FINITE:
            return math.isfinite(value)
        return abs(value) <= _LARGEST or (self is Sizes.OR_INFINITE and math.isinf(value))


def settle(
    record: object, error: type[PipelineError], infinite: Iterable[str] = (), finite: Iterable[str] = ()
) -> None:
    """Refuse what the fields of a frozen record are not declared to hold; lists and arrays become tuples.

    Numbers of NumPy become Python's. NaN and what is larger than 1e12 is no number; infinity is one in the fields
    `infinite`, and whatever is finite in the fields `finite`: coefficients of high powers of small heights are huge.

    Raises
    ------
    PipelineError
        Of the given type; it names the field.
    """
    for name, hint in _fields(type(record)):  # type: ignore[arg-type]  # a type can be hashed
        value = getattr(record, name)
        sizes = Sizes.OR_INFINITE if name in infinite else Sizes.FINITE if name in finite else Sizes.USUAL
        held = _settled(hint, value, sizes)
        if held is _WRONG:
            what = f"{type(record).__name__}: {name} is {reprlib.repr(value)}"
            raise error(what, hint=f"it has to be {_in_words(hint, sizes)}")
        if held is not value:
            object.__setattr__(record, name, held)


def arguments_settled(error: type[PipelineError]) -> Callable[[F], F]:
    """Decorate a function that others call, so that it refuses arguments of other kinds than it declares."""

    def decorate(function: F) -> F:
        signature, hints = inspect.signature(function), typing.get_type_hints(function)

        @functools.wraps(function)
        def asked(*positional: Any, **named: Any) -> Any:
            bound = signature.bind(*positional, **named)
            for name, value in bound.arguments.items():
                if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD:
                    continue  # judged by the record that they become
                bound.arguments[name] = _settled(hints[name], value)
                if bound.arguments[name] is _WRONG:
                    what = f"{function.__name__}: {name} is {reprlib.repr(value)}"
                    raise error(what, hint=f"it has to be {_in_words(hints[name])}")
            return function(*bound.args, **bound.kwargs)

        return typing.cast(F, asked)

    return decorate


def number(
    name: str, value: Any, error: type[PipelineError], least: float = -math.inf, most: float = math.inf
) -> float:
    """A finite number within bounds, handed in as an argument.

    Raises
    ------
    PipelineError
        Of the given type; it names the argument.
    """
    return _within(name, float, value, error, least, most)


def whole(name: str, value: Any, error: type[PipelineError], least: int, most: int) -> int:
    """A whole number within bounds, handed in as an argument; raises as `number`."""
    return int(_within(name, int, value, error, least, most))


def _within(name: str, kind: Any, value: Any, error: type[PipelineError], least: float, most: float) -> Any:
    held = _settled(kind, value)
    if held is not _WRONG and least <= held <= most:
        return held
    raise error(f"{name} is {reprlib.repr(value)}", hint=f"it has to be {_in_words(kind)}{_bounds(least, most)}")


def _bounds(least: float, most: float) -> str:
    if math.isinf(most):
        return "" if math.isinf(least) else f", at least {least:g}"
    return f", from {least:.10g} to {most:.10g}"


@functools.cache
def _fields(cls: type) -> tuple[tuple[str, Any], ...]:
    hints = typing.get_type_hints(cls)
    return tuple((field.name, hints[field.name]) for field in dataclasses.fields(cls))


def _settled(hint: Any, value: Any, sizes: Sizes = Sizes.USUAL) -> Any:
    """A value as a field of that type holds it, or _WRONG."""
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        found = (_settled(kind, value, sizes) for kind in kinds)
        return next((one for one in found if one is not _WRONG), _WRONG)
    if origin is tuple:
        return _tuple(kinds, value, sizes)
    if origin is collections.abc.Callable:
        return value if callable(value) else _WRONG
    if origin is collections.abc.Iterable:
        items = value if isinstance(value, list | tuple) else list(value) if _is_many(value) else value
        return _tuple((*kinds, ...), items, sizes)
    if hint is Path:
        return value if isinstance(value, os.PathLike) else _WRONG
    if hint is float:
        return _float(value, sizes)
    if hint is int:
        is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
        return int(value) if is_whole and -_WIDEST <= value < _WIDEST else _WRONG
    if hint is bool and type(value).__name__ == "bool_":  # NumPy's
        return bool(value)
    return value if isinstance(value, hint) else _WRONG


def _is_many(value: Any) -> bool:
    """Whether it can be walked through; one text is one value, though it can."""
    return isinstance(value, Iterable) and not isinstance(value, str | bytes) and not hasattr(value, "tolist")


def _float(value: Any, sizes: Sizes) -> Any:
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        return _WRONG
    try:
        as_float = float(value)
    except OverflowError:
        return _WRONG
    if not sizes.hold(as_float):
        return _WRONG
    return value if type(value) in (int, float) else as_float


def _tuple(kinds: tuple[Any, ...], value: Any, sizes: Sizes) -> Any:
    items = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(items, list | tuple):
        return _WRONG
    kinds = kinds[:1] * len(items) if kinds[-1] is Ellipsis else kinds
    if len(kinds) != len(items):
        return _WRONG
    held = tuple(_settled(kind, item, sizes) for kind, item in zip(kinds, items, strict=True))
    if any(item is _WRONG for item in held):
        return _WRONG
    same = isinstance(value, tuple) and all(a is b for a, b in zip(held, items, strict=True))
    return value if same else held


def _in_words(hint: Any, sizes: Sizes = Sizes.USUAL) -> str:
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_in_words(kind, sizes) for kind in kinds)
    if origin is tuple:
        each = _in_words(kinds[0], sizes)
        return f"a sequence, each {each}" if kinds[-1] is Ellipsis else f"{len(kinds)} values, each {each}"
    if origin in (collections.abc.Callable, collections.abc.Iterable):
        return "a function" if origin is collections.abc.Callable else f"a list, each {_in_words(kinds[0])}"
    if hint is float:
        return f"a number {sizes.value}"
    return _WORDS.get(hint, f"a {hint.__name__}")
