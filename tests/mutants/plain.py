"""Kernels as plain Python, for tests of few rays: a plugin for pytest, `-p mutants.plain`.

A mistake in a kernel is judged without compiling anything. Plain Python differs from compiled code where it raises
errors: a square root of a negative number, an index beyond an array. So only a failed assertion counts, and only of a
test that passes without the mistake in the same way; what raises anything else, or takes long, says nothing.
"""

import fractions
import functools
import math
import os
import signal
import time
import types
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mutants.mutations import JITTED

import pipeline.jit.decorators

ALL_S, EACH_S = 40.0, 5.0
"""Computing time that all tests together may take, each of them, and what it needs."""
_begun = time.process_time()


class TooLong(BaseException):
    """A test has used up its time: nothing in it may take that for an answer."""


def fma(a: float, b: float, c: float) -> float:
    """a b + c, rounded once."""
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    exact = fractions.Fraction(float(a)) * fractions.Fraction(float(b)) + fractions.Fraction(float(c))
    return np.float64(exact)


def plain(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function itself; numbers are NumPy's, whose divisions by zero are infinite."""
    if function.__globals__.get("math") is math:
        function.__globals__["math"] = _libm()

    @functools.wraps(function)
    def called(*arguments: Any) -> Any:
        return function(*(np.float64(value) if type(value) is float else value for value in arguments))

    called.count = lambda rays, surfaces: None  # type: ignore[attr-defined]  # a tally of work, and no result
    return called


@functools.cache
def _libm() -> types.SimpleNamespace:
    """Python's `math` with NaN and infinity where it raises an error."""

    def quiet(function: Callable[..., float]) -> Callable[..., float]:
        def called(*arguments: float) -> float:
            try:
                return function(*arguments)
            except ValueError:
                return math.nan
            except OverflowError:
                return math.inf

        return called

    functions = ("sqrt", "acos", "asin", "log", "exp", "pow", "fmod", "tan")
    return types.SimpleNamespace(**vars(math) | {name: quiet(getattr(math, name)) for name in functions})


for decorator in JITTED:  # before any module of kernels is imported
    setattr(pipeline.jit.decorators, decorator, plain)
pipeline.jit.decorators.fma = fma


def _end(signal_number: int, frame: Any) -> None:
    raise TooLong


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Make what a test needs, but not for long: a mistake may make it endless."""
    with _not_for_long():
        yield


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Run a test, but not for long; the first whose assertion fails is written down, and ends the run."""
    try:
        with _not_for_long():
            yield
    except AssertionError:
        Path(os.environ["PLAIN_REFUTED"]).write_text(item.nodeid, encoding="utf-8")
        item.session.shouldstop = "one refutation is enough"
        raise


@contextmanager
def _not_for_long() -> Iterator[None]:
    """Skip a test whose time is up: no verdict, compiled kernels judge the mistake."""
    if time.process_time() - _begun > ALL_S:
        pytest.skip("NOT JUDGED in plain Python: the tests before it have taken all of the time")
    signal.signal(signal.SIGPROF, _end)
    signal.setitimer(signal.ITIMER_PROF, EACH_S)
    try:
        with np.errstate(all="ignore"):
            yield
    except TooLong:
        pytest.skip("NOT JUDGED in plain Python: it takes too long there")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
