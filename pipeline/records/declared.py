"""Checks that records and arguments have the declared types and ranges, before anything is computed with them.

Stages are judged by `check`; these checks are for people who write records or call functions in a notebook.
"""

import dataclasses
import functools
import inspect
import math
import reprlib
import typing
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

from pipeline.errors import PipelineError
from pipeline.records.kinds import WRONG, Sizes, held_by, in_words

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
