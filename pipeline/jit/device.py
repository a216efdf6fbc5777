"""CUDA devices: the only module that imports CUDA, and that only when a device is asked for.

Kernels for devices are written in Python with the functions of one ray that packets call, too. Here these functions are
bound anew: to CUDA's compiler, to its simulator, or to each other as plain Python.
"""

import fractions
import functools
import importlib
import math
import os
import types
from collections.abc import Callable
from typing import Any

from pipeline.errors import EnvironmentFault
from pipeline.jit.decorators import Kernel, _numba, fma

_HOW = (
    "pip install 'plenoptic-pipeline[cuda]', on a machine with an NVIDIA device and its driver; or leave --device out"
)


class _Cuda:
    """For device kernels: the names of CUDA, which they are bound to when they are made."""

    def __getattr__(self, name: str) -> Any:
        raise NotImplementedError(f"cuda.{name} is for device kernels")


cuda: Any = _Cuda()


class DeviceKernel:
    """A function that one thread of a device runs; launched with numbers of blocks and of threads in each."""

    def __init__(self, function: Callable[..., None]) -> None:
        functools.update_wrapper(self, function)
        self.function = function

    def __call__(self, blocks: int, threads: int, *arguments: Any) -> None:
        """Run on the device; arrays travel there and back."""
        self._on_device[blocks, threads](*arguments)

    @functools.cached_property
    def _on_device(self) -> Any:
        module = require()
        return module.jit(self.bound(module))

    def bound(self, module: Any) -> Callable[..., None]:
        """The function with what it calls bound to CUDA; to plain Python in the simulator, which runs just that."""
        if is_simulated():
            return bound_anew(self.function, lambda function: function, fma=exact_fma, cuda=module)
        compiled = module.jit(device=True)
        names = {
            "fma": compiled(lambda a, b, c: module.fma(a, b, c)),
            "cuda": module,
            "max": compiled(_greater),
            "min": compiled(_less),
        }
        return bound_anew(self.function, compiled, **names)


def bound_anew(
    function: Callable[..., Any], wrap: Callable[[Callable[..., Any]], Any], **names: Any
) -> Callable[..., Any]:
    """A copy of a function whose kernels are copies made in the same way and wrapped, and that uses other `names`."""
    made: dict[int, Any] = {}

    def copied(original: Any) -> Any:
        replaced = dict(original.__globals__)
        for name in original.__code__.co_names:
            value = replaced.get(name)
            if isinstance(value, Kernel):
                if id(value) not in made:
                    made[id(value)] = wrap(copied(value.function))
                replaced[name] = made[id(value)]
            elif value is fma or isinstance(value, _Cuda) or (name in names and name not in replaced):
                replaced[name] = names[name]
        return types.FunctionType(original.__code__, replaced, original.__name__, original.__defaults__)

    result: Callable[..., Any] = copied(function)
    return result


def _greater(a, b):  # type: ignore[no-untyped-def]
    """The greater of two numbers, the first if one is not a number: Numba's own CUDA lacks `max`, and `min`."""
    return b if b > a else a


def _less(a, b):  # type: ignore[no-untyped-def]
    """The less of two numbers."""
    return b if b < a else a


def plain(kernel: Any) -> Callable[..., Any]:
    """A kernel as plain Python: slow, and with the bits of compiled code where both round once per operation."""
    return bound_anew(kernel.function, lambda function: function, fma=exact_fma, cuda=cuda)


def exact_fma(a: float, b: float, c: float) -> Any:
    """a b + c, rounded once."""
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    exact = fractions.Fraction(float(a)) * fractions.Fraction(float(b)) + fractions.Fraction(float(c))
    return float(exact) if exact else a * b + c


def require() -> Any:
    """CUDA, or its simulator where $NUMBA_ENABLE_CUDASIM is 1.

    Raises
    ------
    EnvironmentFault
        There is no device, no driver, or no compiler for it.
    """
    found = _cuda_of_numba()
    if is_simulated():
        return found
    if not found.is_available():
        raise EnvironmentFault("no CUDA device can be used here: there is none, or it has no driver", hint=_HOW)
    try:
        importlib.import_module("numba.cuda.cudadrv.nvvm").NVVM()
    except Exception as error:
        raise EnvironmentFault(f"there is no compiler for CUDA devices: {error}", hint=_HOW) from None
    return found


def device_name() -> str:
    """The device, and what decides its bits: `cuda sm_90, numba-cuda 0.30.4`; part of the keys of what it computes.

    Raises
    ------
    EnvironmentFault
        There is no device that can be used.
    """
    found = require()
    from importlib.metadata import PackageNotFoundError, version

    try:
        compiler = f"numba-cuda {version('numba-cuda')}"
    except PackageNotFoundError:
        compiler = f"numba {version('numba')}"
    if is_simulated():
        return f"cuda simulator, {compiler}"
    major, minor = found.get_current_device().compute_capability
    return f"cuda sm_{major}{minor}, {compiler}"


def is_simulated() -> bool:
    """Whether the simulator stands in for a device."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"


def _cuda_of_numba() -> Any:
    """Numba's own package for CUDA, or the one that the extra `cuda` puts in its place under the same name."""
    _numba()
    import numba.cuda

    return numba.cuda
