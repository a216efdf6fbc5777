"""Checks that records and arguments have the declared types and ranges, before anything is computed with them.

`check` judges stages; these checks are for people who write records or call functions in a notebook. attrs or msgspec
would check types, too, but not in words, and not magnitudes: a number of a camera is at most 1e12, inf in some fields.
"""

import collections.abc
import dataclasses
import enum
import functools
import inspect
import math
import numbers
import operator
import os
import reprlib
import types
import typing
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from pipeline.errors import PipelineError

_WRONG = object()
"""Result of a check for a value that does not fit its type."""
_WIDEST = 1 << 63
"""Smallest positive integer beyond a signed 64-bit number."""
_LARGEST = 1e12
"""Largest magnitude of lengths, angles and other numbers of a camera: their squares are finite."""
_UNIONS = (typing.Union, types.UnionType)
_WORDS = {int: "a whole number", str: "a text", bool: "True or False", Path: "a Path", type(None): "None"}


class Sizes(enum.Enum):
    """Admissible magnitudes of a number; NaN has none."""

    USUAL = f"of at most {_LARGEST:g}"
    OR_INFINITE = f"of at most {_LARGEST:g}, or inf"
    FINITE = "that is finite"

    def hold(self, value: float) -> bool:
        if self is Sizes.FINITE:
            return math.isfinite(value)
        return abs(value) <= _LARGEST or (self is Sizes.OR_INFINITE and math.isinf(value))


@functools.cache  # records are made by the thousand, and taking an annotation apart costs more than checking a value
def _check(hint: Any, sizes: Sizes = Sizes.USUAL) -> Callable[[Any], Any]:
    """Converter of values to the stored form of an annotated type.

    It makes sequences tuples and NumPy's numbers those of Python, and returns _WRONG for a value of another type.
    """
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in _UNIONS:
        return functools.partial(_any, [_check(kind, sizes) for kind in kinds])
    if origin is tuple:
        return functools.partial(_tuple, [_check(k, sizes) for k in kinds if k is not ...], is_open=kinds[-1] is ...)
    if origin is collections.abc.Iterable:
        return functools.partial(_items, _check(kinds[0], sizes))
    if origin is collections.abc.Callable:
        return lambda value: value if callable(value) else _WRONG
    if hint is float:
        return functools.partial(_float, sizes)
    if hint is int:
        return _int
    if hint is bool:  # also one of NumPy, whose type has one of two names by its version; nothing imports it for that
        return lambda value: bool(value) if type(value).__name__ in ("bool", "bool_") else _WRONG
    accepted = os.PathLike if hint is Path else hint
    return lambda value: value if isinstance(value, accepted) else _WRONG


def _any(checks: list[Callable[[Any], Any]], value: Any) -> Any:
    """The value as the first of several types that it fits."""
    return next((converted for check in checks if (converted := check(value)) is not _WRONG), _WRONG)


def _items(check: Callable[[Any], Any], value: Any) -> Any:
    """Items of an iterable; a text counts as one value."""
    is_single = isinstance(value, str | bytes) or hasattr(value, "tolist") or not isinstance(value, Iterable)
    return _tuple([check], value if is_single else list(value), is_open=True)


def _tuple(checks: list[Callable[[Any], Any]], value: Any, *, is_open: bool) -> Any:
    """Items of a sequence: each of its own type, or, if it is open, any number of one type."""
    items = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(items, list | tuple) or not (is_open or len(items) == len(checks)):
        return _WRONG
    checks = checks * len(items) if is_open else checks
    converted = tuple(check(item) for check, item in zip(checks, items, strict=True))
    if any(item is _WRONG for item in converted):
        return _WRONG
    return value if isinstance(value, tuple) and all(map(operator.is_, converted, items)) else converted


def _float(sizes: Sizes, value: Any) -> Any:
    """A real number of an admissible size; whole ones of Python stay int."""
    kind = type(value)
    if kind is not float and (kind is bool or not isinstance(value, numbers.Real)):
        return _WRONG
    try:
        as_float = float(value)
    except OverflowError:
        return _WRONG
    if not sizes.hold(as_float):
        return _WRONG
    return value if kind is float or kind is int else as_float


def _int(value: Any) -> Any:
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    return int(value) if is_whole and -_WIDEST <= value < _WIDEST else _WRONG


def _in_words(hint: Any, sizes: Sizes = Sizes.USUAL) -> str:
    """An annotated type as hints for people name it."""
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in _UNIONS:
        return " or ".join(_in_words(kind, sizes) for kind in kinds)
    if origin is tuple:
        each = _in_words(kinds[0], sizes)
        return f"a sequence, each {each}" if kinds[-1] is ... else f"{len(kinds)} values, each {each}"
    if origin in (collections.abc.Callable, collections.abc.Iterable):
        return "a function" if origin is collections.abc.Callable else f"a list, each {_in_words(kinds[0])}"
    if hint is float:
        return f"a number {sizes.value}"
    return _WORDS.get(hint, f"a {hint.__name__}")


F = TypeVar("F", bound=Callable[..., Any])


def settle(
    record: object, error: type[PipelineError], infinite: Iterable[str] = (), finite: Iterable[str] = ()
) -> None:
    """Refuse values that do not fit the declared fields of a frozen record; lists and arrays become tuples.

    NumPy's numbers become Python's. NaN and magnitudes above 1e12 are refused. Fields in `infinite` also accept
    infinity, those in `finite` any finite number: coefficients of high powers of small heights are huge. Raises an
    error of the given type.
    """
    kind: Any = type(record)
    for name, hint, sizes, check in _checked_fields(kind, tuple(infinite), tuple(finite)):
        value = getattr(record, name)
        converted = check(value)
        if converted is _WRONG:
            message = f"{type(record).__name__}: {name} is {reprlib.repr(value)}"
            raise error(message, hint=f"it has to be {_in_words(hint, sizes)}")
        if converted is not value:
            object.__setattr__(record, name, converted)


@functools.cache
def _checked_fields(
    record: type, infinite: tuple[str, ...], finite: tuple[str, ...]
) -> list[tuple[str, Any, Sizes, Callable[[Any], Any]]]:
    """Name, annotation, sizes and check of each field of a type of record."""
    sizes = dict.fromkeys(finite, Sizes.FINITE) | dict.fromkeys(infinite, Sizes.OR_INFINITE)
    fields = [(name, hint, sizes.get(name, Sizes.USUAL)) for name, hint in _fields(record)]
    return [(*field, _check(*field[1:])) for field in fields]


def arguments_settled(error: type[PipelineError]) -> Callable[[F], F]:
    """Decorate a public function so that it refuses arguments that do not fit its annotations."""

    def decorate(function: F) -> F:
        signature = inspect.signature(function)
        hints = typing.get_type_hints(function)

        @functools.wraps(function)
        def checked(*positional: Any, **named: Any) -> Any:
            bound = signature.bind(*positional, **named)
            for name, value in bound.arguments.items():
                if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD:
                    continue  # checked by the record that they become
                bound.arguments[name] = _check(hints[name])(value)
                if bound.arguments[name] is _WRONG:
                    message = f"{function.__name__}: {name} is {reprlib.repr(value)}"
                    raise error(message, hint=f"it has to be {_in_words(hints[name])}")
            return function(*bound.args, **bound.kwargs)

        return typing.cast(F, checked)

    return decorate


def number(
    name: str, value: Any, error: type[PipelineError], least: float = -math.inf, most: float = math.inf
) -> float:
    """A finite number within bounds, given as an argument; raises an error of the given type."""
    return float(_within(name, float, value, error, (least, most)))


def integer(name: str, value: Any, error: type[PipelineError], least: int, most: int) -> int:
    """A whole number within bounds, given as an argument; raises as `number`."""
    return int(_within(name, int, value, error, (least, most)))


def _within(name: str, kind: Any, value: Any, error: type[PipelineError], bounds: tuple[float, float]) -> Any:
    """A number of a kind, int or float, between two bounds."""
    least, most = bounds
    converted = _check(kind)(value)
    if converted is not _WRONG and least <= converted <= most:
        return converted
    limits = f", from {least:.10g} to {most:.10g}" if math.isfinite(most) else f", at least {least:g}"
    hint = f"it has to be {_in_words(kind)}{limits if math.isfinite(least) else ''}"
    raise error(f"{name} is {reprlib.repr(value)}", hint=hint)


def attributes_of(cls: type) -> dict[str, str]:
    """Stage attribute that sets each annotated field of a record."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items() if typing.get_origin(hint) is typing.Annotated}


@functools.cache
def _fields(cls: type) -> tuple[tuple[str, Any], ...]:
    """Name and annotation of each field of a record."""
    hints = typing.get_type_hints(cls)
    return tuple((field.name, hints[field.name]) for field in dataclasses.fields(cls))
