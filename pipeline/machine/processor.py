"""Level of this processor, and settings that make libraries give the same bits on all processors of a level.

This module loads no library, because libraries read their settings when they are loaded. It imports little else,
either: the command begins with it, and handles signals only afterwards.
"""

import functools
import os
import sys

_NEEDS = {
    "v4": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "v3": {"avx2", "bmi2", "fma"},
    "v2": {"sse4_2", "popcnt"},
}
_BLAS_KERNELS = {"v4": "Haswell", "v3": "Haswell", "v2": "Nehalem"}  # of OpenBLAS; those for AVX-512 differ by vendor

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Numeric libraries must not split sums over threads: their results would depend on the number of cores."""

NUMPY_FEATURES = ("NPY_DISABLE_CPU_FEATURES", "NPY_ENABLE_CPU_FEATURES")
"""Variables that keep NumPy from instructions of the processor; unset, it uses all that it was built for."""

_PRECISION = {"COLOUR_SCIENCE__DEFAULT_FLOAT_DTYPE": "float64", "COLOUR_SCIENCE__DEFAULT_INT_DTYPE": "int64"}
"""Defaults of the library that encodes previews, set explicitly because it reads overrides from the environment."""

_USUAL_CODE = {"DISABLE_JIT": 0, "OPT": 1, "LOOP_VECTORIZE": 1, "SLP_VECTORIZE": 0, "BOUNDSCHECK": 0, "DEBUGINFO": 0}
"""Defaults but for OPT, set explicitly because Numba reads overrides from a file in the working directory, which may be
anybody's.

With OPT = 1 kernels compile sooner, give the same bits, and run as fast as with 3.
"""


TUNING = {"x86-64-v4": "-prefer-256-bit"}
"""LLVM uses only half of the vector width of this level by default, for processors that slow down at full width."""


@functools.cache
def level() -> str:
    """Architecture and, if the system states it, the level of vector instructions: `x86_64-v3`."""
    name = os.uname().machine
    has = _flags()
    version = next((version for version, needs in _NEEDS.items() if needs <= has), None)
    return f"{name}-{version}" if version else name


def compiler_target() -> str | None:
    """LLVM's name for the processors of this level, `x86-64-v3`; None for architectures without levels."""
    name, _, version = level().rpartition("-")
    return f"{name.replace('_', '-')}-{version}" if version in _NEEDS else None


def settings_of_numba() -> dict[str, str]:
    """Compiler settings for any processor of the level, with equal bits, so that all share compiled kernels."""
    target = compiler_target()
    chosen = {"NUMBA_CPU_NAME": target, "NUMBA_CPU_FEATURES": TUNING.get(target, "")} if target else {}
    # SVML is a library by Intel that Numba would use instead of libm if it happened to be installed.
    usual = {f"NUMBA_{name}": str(value) for name, value in _USUAL_CODE.items()}
    # Few rays make few threads, of which numba-cuda would warn at every launch.
    return {**chosen, **usual, "NUMBA_DISABLE_INTEL_SVML": "1", "NUMBA_CUDA_LOW_OCCUPANCY_WARNINGS": "0"}


def settings() -> dict[str, str]:
    """Environment variables of every process that computes."""
    kernels = _BLAS_KERNELS.get(level().rpartition("-")[2])
    libraries = {**ONE_THREAD, **dict.fromkeys(NUMPY_FEATURES, ""), **_PRECISION, **settings_of_numba()}
    return {**libraries, **({"OPENBLAS_CORETYPE": kernels} if kernels else {})}


@functools.cache
def pin() -> bool:
    """Put `settings` into the environment unless NumPy, which reads them only once, is loaded; returns whether that was
    in time.

    The first call decides: the command makes it at its start, a notebook when it first uses `pipeline.build`. If NumPy
    was loaded before, builds compute in worker processes.
    """
    in_time = "numpy" not in sys.modules
    if in_time:
        os.environ.update(settings())
    return in_time


def _flags() -> set[str]:
    """Flags of the first processor, as Linux names them."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as lines:  # noqa: PTH123 (long on big machines)
            return next((set(line.split(":")[1].split()) for line in lines if line.startswith("flags")), set())
    except OSError:
        return set()
