"""Facts about this machine on which the bits of results depend: the results of its libraries for difficult numbers.

A version only tells what was built. Which code libm, NumPy or OpenBLAS chose for this processor, also because of
environment variables, shows in the last bits of results; so results are measured. Names are added for the reader,
and because a sample may miss rare differences.
"""

import functools
import hashlib
import json
import math
import os
import platform
import struct
import subprocess
from collections.abc import Collection, Iterable

from pipeline.machine.another_python import command
from pipeline.machine.processor import level, pin, settings

FUNCTIONS = {
    "sin": (-10.0, 10.0),
    "cos": (-10.0, 10.0),
    "tan": (-1.5, 1.5),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
    "atan": (-10.0, 10.0),
    "exp": (-10.0, 10.0),
    "expm1": (-1.0, 1.0),
    "log": (0.01, 100.0),
    "log1p": (-0.9, 3.0),
    "log2": (0.01, 100.0),
    "log10": (0.01, 100.0),
    "sinh": (-3.0, 3.0),
    "cosh": (-3.0, 3.0),
    "tanh": (-3.0, 3.0),
    "sqrt": (0.0, 100.0),
}
"""Functions of one number by their names in C, each with an interval in which it is defined."""

ARGUMENTS = 999
"""Arguments for each function: glibc with FMA and without differs for about one in a thousand; a multiple of 9."""

_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
"""Golden ratio: its multiples modulo 1 never repeat and are evenly distributed."""


def facts(libraries: Collection[str]) -> dict[str, str]:
    """Facts about the numerics of this process: level and libm, and numpy and blas if NumPy is among the libraries.

    Returns
    -------
    dict of str
        The level, and a name and a digest of results for each of the others: `OpenBLAS Haswell, results 62f5b263`.
    """
    found = {"level": level(), "libm": _libm()}
    return {**found, **_numpy_and_blas()} if "numpy" in libraries else found


def facts_of_workers(libraries: Collection[str]) -> dict[str, str]:
    """The facts for processes that this one starts. They may differ if NumPy was loaded here before `pin`."""
    return facts(libraries) if pin() or "numpy" not in libraries else _asked()


def tell() -> None:
    """Print all facts, as the process of `facts_of_workers`."""
    print(json.dumps(facts({"numpy"})))


@functools.cache
def _asked() -> dict[str, str]:
    done = subprocess.run(
        command("pipeline.machine.facts:tell"), capture_output=True, check=True, env={**os.environ, **settings()}
    )
    answer: dict[str, str] = json.loads(done.stdout)
    return answer


@functools.cache
def _libm() -> str:
    """C's elementary functions: Python's, and those that Numba's kernels call."""
    numbers = [*spread(ARGUMENTS, 0.0, 1.0), 5e-324 * 3, 2.2e-308 / 3]  # the last two are 0 if something set that
    for name, ends in FUNCTIONS.items():
        numbers += map(getattr(math, name), spread(ARGUMENTS, *ends))
    bases, powers = spread(ARGUMENTS, 0.01, 100.0), spread(ARGUMENTS, 3.0, -2.0)
    numbers += [function(x, y) for function in (math.pow, math.atan2) for x, y in zip(bases, powers, strict=True)]
    name = " ".join(platform.libc_ver()).strip() or platform.system()
    return fact(name, [struct.pack(f"<{len(numbers)}d", *numbers)])


@functools.cache
def _numpy_and_blas() -> dict[str, str]:
    pin()  # the further facts load NumPy
    from pipeline.machine.numerics import of_blas, of_loops

    return {"numpy": of_loops(), "blas": of_blas()}


def spread(count: int, first: float, last: float) -> list[float]:
    """Numbers in an interval with long mantissas, from arithmetic that is the same on every processor."""
    return [first + (last - first) * (k * _GOLDEN % 1.0) for k in range(1, count + 1)]


def fact(name: str, results: Iterable[bytes]) -> str:
    """A name, and a digest of results."""
    return f"{name}, results {hashlib.sha256(b''.join(results)).hexdigest()[:8]}"
