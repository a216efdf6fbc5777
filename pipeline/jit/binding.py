"""Kernels bound anew: the same functions for CUDA's compiler, for its simulator, as plain Python, in single precision.

A kernel is a function whose globals name what it calls. A copy of it has globals of its own, in which other copies, or
other functions, bear these names.
"""

import fractions
import math
import types
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pipeline.jit.decorators import Kernel, fma

Function = Callable[..., Any]


class DeviceNames:
    """For device kernels: the names of CUDA, which they are bound to when they are made."""

    def __getattr__(self, name: str) -> Any:
        raise NotImplementedError(f"cuda.{name} is for device kernels")


class Single:
    """A kernel that others call in single precision: its literals and constants are float32, and so must arguments be.

    Integers and float32 must not meet in it, because Numba makes float64 of both together. `constants` are values for
    those that state how precise float64 is, by name, wherever the kernel or its callees use them.
    """

    def __init__(self, kernel: Kernel, **constants: float) -> None:
        self.kernel = kernel
        self.constants = {name: np.float32(value) for name, value in constants.items()}

    def __call__(self, *arguments: Any) -> Any:
        raise NotImplementedError(f"{self.kernel.name} in single precision is for kernels that are bound anew")


def bound_anew(function: Function, wrap: Callable[[Function], Any], **names: Any) -> Function:
    """A copy of a function whose kernels are copies made in the same way and wrapped, and that uses other `names`: for
    `fma`, `cuda` or `math`, and for names of Python itself such as `max`.
    """
    made: dict[tuple[int, int], Any] = {}

    def called(kernel: Kernel, constants: Mapping[str, Any] | None) -> Any:
        key = id(kernel), id(constants)
        if key not in made:
            made[key] = wrap(copied(kernel.function, constants))
        return made[key]

    def copied(original: Any, constants: Mapping[str, Any] | None) -> Any:
        code, replaced = original.__code__, dict(original.__globals__)
        for name in code.co_names:
            value = replaced.get(name)
            if isinstance(value, Kernel):
                replaced[name] = called(value, constants)
            elif isinstance(value, Single):
                replaced[name] = called(value.kernel, value.constants)
            elif name in names and (name not in replaced or value in (fma, math) or isinstance(value, DeviceNames)):
                replaced[name] = names[name]
            elif constants is not None and name in replaced:
                replaced[name] = constants.get(name, in_single(value))
        if constants is not None:
            code = code.replace(co_consts=tuple(map(in_single, code.co_consts)))
        return types.FunctionType(code, replaced, original.__name__, original.__defaults__)

    result: Function = copied(function, None)
    return result


def in_single(value: Any) -> Any:
    """Numbers and arrays of float64 as float32, in records, too; all else as it is."""
    if isinstance(value, float):
        return np.float32(value)
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.astype(np.float32)
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(in_single, value))
    return value


class TypedMath:
    """`math` whose functions give float32 where they get it, as those of compilers do."""

    def __getattr__(self, name: str) -> Any:
        original = getattr(math, name)

        def typed(*numbers: Any) -> Any:
            value = original(*numbers)
            return np.float32(value) if isinstance(numbers[0], np.float32) else value

        return typed if callable(original) else original


def exact_fma(a: float, b: float, c: float) -> Any:
    """a b + c, rounded once, to float32 where a is one."""
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    exact = fractions.Fraction(float(a)) * fractions.Fraction(float(b)) + fractions.Fraction(float(c))
    if not exact:
        return a * b + c
    if not isinstance(a, np.float32):
        return float(exact)
    # The nearest float32, of two the even one: by way of float64 it would be rounded twice.
    near = np.float32(float(exact))
    around = near, np.nextafter(near, np.float32(-math.inf)), np.nextafter(near, np.float32(math.inf))
    return min(around, key=lambda near: (abs(fractions.Fraction(float(near)) - exact), int(near.view(np.int32)) & 1))
