"""Results of NumPy that depend on the code that it and its BLAS have chosen for this processor."""

import ctypes
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.lib.introspect import opt_func_info

from pipeline.machine.facts import ARGUMENTS, FUNCTIONS, fact, spread

_CORE_OF = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")


def of_loops() -> str:
    """Results of elementary functions and sums, for which NumPy has loops with several kinds of vector instructions."""
    chosen = opt_func_info(func_name="^(sin|add)$", signature="float64")
    names = {loop["current"] for loops in chosen.values() for loop in loops.values()}
    with np.errstate(all="ignore"):
        return fact(" ".join(sorted(names)), (result.tobytes() for result in (*_functions(), *_sums())))


def of_blas() -> str:
    """Results of linear algebra, whose sums have another order in each kernel of a BLAS."""
    return fact(_blas(), (np.asarray(result).tobytes() for result in (*_products(), *_solutions())))


def _functions() -> Iterator[np.ndarray]:
    for name, ends in FUNCTIONS.items():
        function = getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}.get(name, name))
        x = np.array(spread(ARGUMENTS, *ends))
        # Whole, with a stride, too short for a vector, and in single precision.
        yield from (function(part) for part in (x, x[::3], x[:3], x.astype(np.float32)))
    x, y = np.array(spread(ARGUMENTS, 0.01, 3.0)), np.array(spread(ARGUMENTS, 3.0, -2.0))
    yield from (function(x, y) for function in (np.power, np.arctan2, np.hypot, np.divide))


def _sums() -> Iterator[np.ndarray]:
    x = np.array(spread(ARGUMENTS, -3.0, 3.1))
    table, cubes = x.reshape(-1, 3), x.reshape(-1, 3, 3)
    for axis in (0, 1):
        yield from (function(table, axis=axis) for function in (np.sum, np.mean, np.var, np.cumsum, np.prod))
    yield from (part.sum() for part in (x, x[1:], x[::7]))
    yield from (np.linalg.norm(table, axis=1), np.cross(table, table[::-1]))
    yield np.einsum("ni,ni->n", table, table[::-1])
    yield np.einsum("nij,nj->ni", cubes, table[: len(cubes)])
    yield np.einsum("k,kac->ac", x[:24], x[:720].reshape(24, 6, 5))


def _products() -> Iterator[np.ndarray]:
    x = np.array(spread(4096, -3.0, 3.1))
    for n in (1, 2, 3, 4, 7, 8, 16, 31, 64):
        square, tall = x[: n * n].reshape(n, n), x[: 40 * n].reshape(40, n)
        yield from (square @ square, square @ square.T, tall @ square, tall @ square.T, tall.T @ tall)
        yield from (square @ x[:n], x[:n] @ square, tall @ x[:n], x[:40] @ tall)
    yield from (x[:n] @ x[1 : n + 1] for n in (1, 2, 3, 5, 9, 17, *range(33, 4000, 331)))


def _solutions() -> Iterator[np.ndarray]:
    x = np.array(spread(4096, -3.0, 3.1))
    for n in (2, 3, 6):
        several, tall = x[: 40 * n * n].reshape(40, n, n) + 4.0 * np.eye(n), x[: 20 * n].reshape(20, n)
        yield from (several @ several, np.linalg.inv(several), np.linalg.det(several))
        yield np.linalg.solve(several, x[: 40 * n].reshape(40, n, 1))
        yield np.linalg.eigvalsh(several + several.transpose(0, 2, 1))
        yield from (np.linalg.pinv(tall), np.linalg.lstsq(tall, x[:20], rcond=None)[0])


def _blas() -> str:
    """Name of the BLAS: `OpenBLAS Haswell` for the library that comes with NumPy, else the one that NumPy was built
    with.
    """
    for path in Path(np.__file__).parent.with_name("numpy.libs").glob("*openblas*"):
        library = ctypes.CDLL(str(path))
        for symbol in _CORE_OF:
            if core := getattr(library, symbol, None):
                core.restype = ctypes.c_char_p
                return f"OpenBLAS {core().decode()}"
    return str(np.show_config("dicts")["Build Dependencies"]["blas"]["name"])  # type: ignore[index, call-overload]
