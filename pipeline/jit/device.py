"""CUDA devices: the only module that imports CUDA, and that only when a device is asked for.

Kernels for devices are written in Python with the functions of one ray that packets call, too. Here these functions are
bound anew: to CUDA's compiler, to its simulator, or to each other as plain Python.
"""

import contextlib
import functools
import importlib
import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from pipeline.errors import EnvironmentFault
from pipeline.jit.binding import DeviceNames, TypedMath, bound_anew, exact_fma
from pipeline.jit.decorators import _numba

_HOW = "pip install 'plenoptic-pipeline[cuda]', beside an NVIDIA device and its driver; or leave --device out"
_FAULTS = "CudaAPIError", "CudaSupportError", "CudaDriverError"
cuda: Any = DeviceNames()
"""For device kernels: the names of CUDA."""


class DeviceKernel:
    """A function that one thread of a device runs; launched with numbers of blocks and of threads in each.

    Arrays from `resident` and `unfilled` stay where they are; others would travel to the device and back at each
    launch.
    """

    def __init__(self, function: Callable[..., None]) -> None:
        functools.update_wrapper(self, function)
        self.function = function

    def __call__(self, blocks: int, threads: int, *arguments: Any) -> None:
        """Run on the device; the call may return before the kernel has ended. Raises as `faults_of_devices`."""
        with faults_of_devices():
            self._on_device[blocks, threads](*arguments)

    @functools.cached_property
    def _on_device(self) -> Any:
        module = require()
        return module.jit(self.bound(module))

    def bound(self, module: Any) -> Callable[..., None]:
        """The function with what it calls bound to CUDA; to plain Python in the simulator, which runs just that."""
        if is_simulated():
            return bound_anew(self.function, lambda function: function, fma=exact_fma, math=TypedMath(), cuda=module)
        compiled = module.jit(device=True)
        names = {
            "fma": compiled(lambda a, b, c: module.fma(a, b, c)),
            "cuda": module,
            "max": compiled(_larger),
            "min": compiled(_smaller),
        }
        return bound_anew(self.function, compiled, **names)


def _larger(a, b):  # type: ignore[no-untyped-def]
    """The greater of two numbers, the first if one is not a number: Numba's own CUDA lacks `max`, and `min`."""
    return b if b > a else a


def _smaller(a, b):  # type: ignore[no-untyped-def]
    return b if b < a else a


def resident(value: Any) -> Any:
    """Arrays copied to the device, in records, too; numbers stay as they are. The simulator takes NumPy's arrays."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*map(resident, value))
    if isinstance(value, np.ndarray) and not is_simulated():
        with faults_of_devices():
            return require().to_device(np.ascontiguousarray(value))
    return value


def unfilled(shape: int | tuple[int, ...], kind: Any = np.float64) -> Any:
    """An array on the device, not filled."""
    if is_simulated():
        return np.empty(shape, kind)
    with faults_of_devices():
        return require().device_array(shape, kind)


def fetched(array: Any) -> np.ndarray:
    """Copy of an array of the device, taken when all kernels before have ended."""
    if is_simulated():
        return array  # type: ignore[no-any-return]
    with faults_of_devices():
        return array.copy_to_host()  # type: ignore[no-any-return]


@contextlib.contextmanager
def faults_of_devices() -> Iterator[None]:
    """Failures of CUDA as errors that a build knows: MemoryError, or EnvironmentFault."""
    try:
        yield
    except Exception as error:
        if type(error).__name__ not in _FAULTS:  # of Numba's package for CUDA, or of the one in its place
            raise
        if "OUT_OF_MEMORY" in str(error):
            raise MemoryError("the device has too little memory left; fewer workers (-j) take less") from error
        raise EnvironmentFault(f"the device failed: {error}", hint="try again, or leave --device out") from error


def require() -> Any:
    """CUDA, or its simulator where $NUMBA_ENABLE_CUDASIM is 1; EnvironmentFault without device, driver or compiler."""
    _numba()
    package = importlib.import_module("numba.cuda")  # Numba's own, or what the extra `cuda` puts in its place
    if is_simulated():
        return package
    if not package.is_available():
        raise EnvironmentFault("no CUDA device can be used here: there is none, or it has no driver", hint=_HOW)
    try:
        importlib.import_module("numba.cuda.cudadrv.nvvm").NVVM()
    except Exception as error:
        raise EnvironmentFault(f"there is no compiler for CUDA devices: {error}", hint=_HOW) from None
    return package


def device_name() -> str:
    """The device and its compiler: `cuda sm_90, numba-cuda 0.30.4`; part of the keys of what it computes.

    EnvironmentFault, if there is no device that can be used.
    """
    package = require()
    from importlib.metadata import PackageNotFoundError, version

    try:
        compiler = f"numba-cuda {version('numba-cuda')}"
    except PackageNotFoundError:
        compiler = f"numba {version('numba')}"
    if is_simulated():
        return f"cuda simulator, {compiler}"
    with faults_of_devices():  # without a context, which would take memory for a whole build
        major, minor = package.gpus[0].compute_capability
    return f"cuda sm_{major}{minor}, {compiler}"


def require_device(name: str) -> None:
    """EnvironmentFault for a device other than that of a name, under which results are kept, or for none."""
    here = device_name()
    if here != name:
        raise EnvironmentFault(f"this is for {name}, and here is {here}", hint="build anew, with --device or without")


def is_simulated() -> bool:
    """Whether the simulator stands in for a device."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM") == "1"
