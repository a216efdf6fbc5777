"""Pure functions whose last results a process keeps: tasks and seeds of one camera ask for the same outlines."""

import dataclasses
import functools
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[..., Any])
_KEPT = 8
"""Results that are kept per function: more than a camera has planes to be asked for, and few enough to hold."""


def once(function: F) -> F:
    """Keep the last results of a function of numbers, arrays and frozen records; nobody may change what it gives.

    Arguments are equal only if all bytes of their arrays are.
    """
    kept: dict[Hashable, Any] = {}

    @functools.wraps(function)
    def called(*args: Any) -> Any:
        key = _frozen(args)
        found = kept.pop(key) if key in kept else function(*args)
        kept[key] = found  # as the youngest
        for oldest in list(kept)[:-_KEPT]:
            kept.pop(oldest, None)
        return found

    return called  # type: ignore[return-value]


def _frozen(value: Any) -> Hashable:
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, tuple):
        return tuple(map(_frozen, value))
    if dataclasses.is_dataclass(value):
        return tuple(_frozen(getattr(value, field.name)) for field in dataclasses.fields(value))
    return float(value).hex() if isinstance(value, float) else value
