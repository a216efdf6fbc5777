"""Facts about this machine on which the bits of results depend, as its libraries state them. They enter every key.

`processor.pin` sets everything that a process can choose, equally on all processors of a level. The rest is stated
here: settings that a library read when it was loaded, or when the process started. Memory is here as well; it decides
how many tasks run at a time, and no bits.
"""

import contextlib
import ctypes
import functools
import json
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Collection
from pathlib import Path

from pipeline.machine.processor import NUMPY_FEATURES, level, pin, settings

_CORE_OF = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")
"""Functions of OpenBLAS that name its kernels; their names depend on how it was built."""


_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv.pop(1)); from {0} import {1}; {1}()"
"""Program of a process that calls function {1} of module {0}; its first argument is our `sys.path`."""


def command(function: str, *arguments: str) -> list[str]:
    """Command line of a process that calls `module:name`, a parameterless function of ours, with these `sys.argv`.

    It finds the same modules as this process. `-P` keeps it from importing out of the working directory, where a user's
    json.py would replace Python's.
    """
    return [sys.executable, "-P", "-c", _BOOT.format(*function.split(":")), json.dumps(sys.path), *arguments]


def facts(libraries: Collection[str]) -> dict[str, str]:
    """Facts about this process: `level` and `libc`, and `numpy` if it is among the libraries.

    For example `x86_64-v3`, `glibc 2.36` and `OpenBLAS Haswell`, and any variables that select other code.
    """
    libc = " ".join(platform.libc_ver()).strip() or platform.system()
    stated = {"level": level(), "libc": _with_settings(libc, ("GLIBC_TUNABLES",))}
    if "numpy" in libraries:
        pin()  # `_blas` loads NumPy
        stated["numpy"] = _with_settings(_blas(), NUMPY_FEATURES)
    return stated


def facts_of_workers(libraries: Collection[str]) -> dict[str, str]:
    """Facts about the processes that this one starts. They may differ if NumPy was loaded here before `pin`."""
    return facts(libraries) if pin() or "numpy" not in libraries else _facts_of_new_process()


def print_facts() -> None:
    """Print all facts; entry point of the process that `facts_of_workers` starts."""
    print(json.dumps(facts({"numpy"})))


@functools.cache
def _facts_of_new_process() -> dict[str, str]:
    environment = {**os.environ, **settings()}
    done = subprocess.run(
        command("pipeline.machine.facts:print_facts"), capture_output=True, check=True, env=environment
    )
    answer: dict[str, str] = json.loads(done.stdout)
    return answer


def _with_settings(name: str, variables: Collection[str]) -> str:
    """A name with those environment variables that are set, as `glibc 2.36, GLIBC_TUNABLES=…`."""
    chosen = [f"{variable}={os.environ[variable]}" for variable in variables if os.environ.get(variable)]
    return ", ".join([name, *chosen])


@functools.cache
def _blas() -> str:
    """Name and kernels of NumPy's own OpenBLAS, else of the BLAS that NumPy was built with."""
    import numpy as np

    for path in Path(np.__file__).parent.with_name("numpy.libs").glob("*openblas*"):
        library = ctypes.CDLL(str(path))
        for symbol in _CORE_OF:
            if core := getattr(library, symbol, None):
                core.restype = ctypes.c_char_p
                return f"OpenBLAS {core().decode()}"
    return str(np.show_config("dicts")["Build Dependencies"]["blas"]["name"])  # type: ignore[index, call-overload]


_CGROUP = Path("/sys/fs/cgroup")


def reset_peak() -> None:
    """Reset the counter of `peak_bytes`, where the system can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets VmHWM; see proc(5)


def peak_bytes() -> int:
    """Largest resident size of this process so far [bytes]."""
    peak = _bytes_in(Path("/proc/self/status"), "VmHWM")
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit if peak is None else peak


def available_bytes() -> int | None:
    """Available memory [bytes]: the system's estimate, or the smaller limit of a container; None if unknown."""
    available = _bytes_in(Path("/proc/meminfo"), "MemAvailable")
    try:
        limit, used = (int((_CGROUP / name).read_text()) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):  # no container, or one without a limit ("max")
        return available
    free = max(0, limit - used)
    return free if available is None else min(free, available)


def _bytes_in(path: Path, name: str) -> int | None:
    """A figure of a file of /proc, which has lines such as `VmHWM: 1234 kB` [bytes]; None without it."""
    try:
        lines = path.read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:")), None)
