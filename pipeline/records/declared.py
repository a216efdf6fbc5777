"""Checks that records and arguments have the declared types and ranges, before anything is computed with them.

Stages are judged by `check`; these checks are for people who write records or call functions in a notebook. attrs or
msgspec would check types, too, and not in words, nor sizes: a number of a camera is at most 1e12, inf in some fields.
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

Check = Callable[[Any], Any]
"""Gives a value as a field stores it, or WRONG."""
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
    """A value as a field of this type stores it, or WRONG: sequences become tuples, NumPy's numbers those of Python."""
    return _check(hint, sizes)(value)


@functools.cache  # records are made by the thousand, and taking an annotation apart costs more than checking a value
def _check(hint: Any, sizes: Sizes) -> Check:
    """The check of a type, as a function that gives a value as stored, or WRONG."""
    origin, kinds = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return functools.partial(_any, [_check(kind, sizes) for kind in kinds])
    if origin is tuple:
        is_open = kinds[-1] is Ellipsis
        return functools.partial(_tuple, [_check(kind, sizes) for kind in kinds if kind is not Ellipsis], is_open)
    if origin is collections.abc.Iterable:
        return functools.partial(_items, _check(kinds[0], sizes))
    if origin is collections.abc.Callable:
        return lambda value: value if callable(value) else WRONG
    if hint is float:
        return functools.partial(_float, sizes)
    if hint in (int, bool):
        return _int if hint is int else _bool
    of_type = os.PathLike if hint is Path else hint
    return lambda value: value if isinstance(value, of_type) else WRONG


def _any(checks: list[Check], value: Any) -> Any:
    for check in checks:
        if (held := check(value)) is not WRONG:
            return held
    return WRONG


def _items(check: Check, value: Any) -> Any:
    """Items of an iterable; a text counts as one value."""
    is_one = isinstance(value, str | bytes) or hasattr(value, "tolist") or not isinstance(value, Iterable)
    return _tuple([check], True, value if is_one or isinstance(value, list | tuple) else list(value))


def _tuple(checks: list[Check], is_open: bool, value: Any) -> Any:
    """Items of a sequence, each of a type of its own, or any number of them of one type."""
    items = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(items, list | tuple) or not (is_open or len(items) == len(checks)):
        return WRONG
    held = tuple(map(checks[0], items)) if is_open else tuple(c(item) for c, item in zip(checks, items, strict=True))
    if any(item is WRONG for item in held):
        return WRONG
    same = isinstance(value, tuple) and all(map(operator.is_, held, items))
    return value if same else held


def _float(sizes: Sizes, value: Any) -> Any:
    kind = type(value)
    if kind is not float and (kind is bool or not isinstance(value, numbers.Real)):
        return WRONG
    try:
        as_float = float(value)
    except OverflowError:
        return WRONG
    if not sizes.hold(as_float):
        return WRONG
    return value if kind is float or kind is int else as_float


def _int(value: Any) -> Any:
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    return int(value) if is_whole and -_WIDEST <= value < _WIDEST else WRONG


def _bool(value: Any) -> Any:
    """A flag, also one of NumPy, whose type has one of two names by its version; nothing imports NumPy for that."""
    return bool(value) if type(value).__name__ in ("bool", "bool_") else WRONG


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


F = TypeVar("F", bound=Callable[..., Any])


def settle(
    record: object, error: type[PipelineError], infinite: Iterable[str] = (), finite: Iterable[str] = ()
) -> None:
    """Refuse values that the fields of a frozen record are not declared to hold; lists and arrays become tuples.

    Numbers of NumPy become Python's. NaN and what is larger than 1e12 is no number; infinity is one in the fields
    `infinite`, and whatever is finite in the fields `finite`: coefficients of high powers of small heights are huge.

    Raises PipelineError: a field has a wrong value; the error has the given type.
    """
    for name, hint in _fields(type(record)):  # type: ignore[arg-type]  # a type can be hashed
        value = getattr(record, name)
        sizes = Sizes.OR_INFINITE if name in infinite else Sizes.FINITE if name in finite else Sizes.USUAL
        held = held_by(hint, value, sizes)
        if held is WRONG:
            what = f"{type(record).__name__}: {name} is {reprlib.repr(value)}"
            raise error(what, hint=f"it has to be {in_words(hint, sizes)}")
        if held is not value:
            object.__setattr__(record, name, held)


def arguments_settled(error: type[PipelineError]) -> Callable[[F], F]:
    """Decorate a public function, so that it refuses arguments of other types than it declares."""

    def decorate(function: F) -> F:
        signature, hints = inspect.signature(function), typing.get_type_hints(function)

        @functools.wraps(function)
        def asked(*positional: Any, **named: Any) -> Any:
            bound = signature.bind(*positional, **named)
            for name, value in bound.arguments.items():
                if signature.parameters[name].kind is inspect.Parameter.VAR_KEYWORD:
                    continue  # checked by the record that they become
                bound.arguments[name] = held_by(hints[name], value)
                if bound.arguments[name] is WRONG:
                    what = f"{function.__name__}: {name} is {reprlib.repr(value)}"
                    raise error(what, hint=f"it has to be {in_words(hints[name])}")
            return function(*bound.args, **bound.kwargs)

        return typing.cast(F, asked)

    return decorate


def number(
    name: str, value: Any, error: type[PipelineError], least: float = -math.inf, most: float = math.inf
) -> float:
    """A finite number within bounds, given as an argument.

    Raises PipelineError: the argument is wrong; the error has the given type.
    """
    return _within(name, float, value, error, least, most)


def whole(name: str, value: Any, error: type[PipelineError], least: int, most: int) -> int:
    """A whole number within bounds, given as an argument; raises as `number`."""
    return int(_within(name, int, value, error, least, most))


def _within(name: str, kind: Any, value: Any, error: type[PipelineError], least: float, most: float) -> Any:
    held = held_by(kind, value)
    if held is not WRONG and least <= held <= most:
        return held
    raise error(f"{name} is {reprlib.repr(value)}", hint=f"it has to be {in_words(kind)}{_bounds(least, most)}")


def _bounds(least: float, most: float) -> str:
    if math.isinf(most):
        return "" if math.isinf(least) else f", at least {least:g}"
    return f", from {least:.10g} to {most:.10g}"


@functools.cache
def _fields(cls: type) -> tuple[tuple[str, Any], ...]:
    hints = typing.get_type_hints(cls)
    return tuple((field.name, hints[field.name]) for field in dataclasses.fields(cls))
