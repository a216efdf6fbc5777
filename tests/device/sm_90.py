"""Kernels of devices compiled for sm_90 without one, and what the assembler says about them.

Needs NVVM and ptxas: a CUDA toolkit under $CUDA_HOME or /usr/local. Numba asks the driver which device there is as soon
as a function of the device calls another one; here it is told.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pipeline.jit.decorators import _numba


@dataclass(frozen=True, slots=True, kw_only=True)
class Assembled:
    """Registers of a thread, bytes that spill, bytes of shared memory of a block."""

    registers: int
    spilled: int
    shared: int


class _Hopper:
    compute_capability = (9, 0)


def assembled(function: Callable[[Any], Any], arguments: tuple[Any, ...], folder: Path) -> Assembled:
    """What a kernel takes; `function` gets Numba's CUDA, and skips aloud where tools are missing."""
    toolkit = _toolkit()
    assembler = shutil.which("ptxas") or (toolkit and shutil.which("ptxas", path=str(toolkit / "bin")))
    if toolkit is None or assembler is None:
        pytest.skip("NOT TESTED: nothing compiles for devices here; a CUDA toolkit with NVVM and ptxas does")
    os.environ.setdefault("CUDA_HOME", str(toolkit))
    numba = _numba()
    from numba import cuda

    for module in list(sys.modules.values()):
        if getattr(module, "__name__", "").startswith(("numba.cuda", "numba_cuda")) and hasattr(
            module, "get_current_device"
        ):
            module.get_current_device = lambda: _Hopper
    types = numba.void(*(numba.typeof(argument) for argument in arguments))
    text, _ = cuda.compile(function(cuda), types, cc=(9, 0), device=False, abi="numba")
    source = folder / "kernel.ptx"
    source.write_text(text if isinstance(text, str) else text.decode())
    command = [assembler, "-arch=sm_90", "-v", str(source), "-o", str(folder / "kernel.cubin")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "Unsupported .version" in done.stderr:
        pytest.skip("NOT TESTED: ptxas is older than NVVM; put one of the same release into PATH")
    assert done.returncode == 0, done.stderr
    told = done.stderr
    numbers = {key: [int(n) for n in re.findall(pattern, told)] for key, pattern in _PATTERNS.items()}
    assert numbers["registers"], told
    return Assembled(
        registers=max(numbers["registers"]), spilled=sum(numbers["spilled"]), shared=max([*numbers["shared"], 0])
    )


_PATTERNS = {
    "registers": r"Used (\d+) registers",
    "spilled": r"(\d+) bytes spill (?:stores|loads)",
    "shared": r"(\d+) bytes smem",
}


def _toolkit() -> Path | None:
    """A CUDA toolkit with NVVM."""
    named = [Path(os.environ[name]) for name in ("CUDA_HOME", "CUDA_PATH") if name in os.environ]
    places = [*named, *sorted(Path("/usr/local").glob("cuda*"), reverse=True)]
    return next((place for place in places if any(place.glob("nvvm/libdevice/libdevice*.bc"))), None)
