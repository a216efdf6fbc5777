"""Compiled code for Numba: a file for each kernel and types, named by all that decides what is in it.

Numba's own cache believes whatever it finds: a file that lost its end breaks every build for ever, and one that
somebody else wrote is executed. This one does for a dispatcher what `numba.core.caching.FunctionCache` does.
"""

import hashlib
import pickle
import sys
from pathlib import Path
from typing import Any

import numba
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from pipeline.jit import files, turns
from pipeline.jit.compiler import load_unit, units_of

used: set[str] = set()
"""Names of files that this process has read or written."""


class KernelCache:
    """The compiled code of a kernel, in a folder for all kernels of the same sources.

    `kind` is that of `jit.compiler.OPTIONS`: one function may be a unit for kernels, and a driver for Python.
    """

    def __init__(self, function: Any, folder: Path, kind: str = "kernel") -> None:
        self._function, self._folder = function, folder
        self._name = f"{function.__module__}.{function.__qualname__}-{kind}"
        files.make_folder(folder)

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """Compiled code for types of arguments; None if it has to be compiled, which no other process does then."""
        rtsys.initialize(target)  # all that code needs to run; `target.refresh()` would load all that could be compiled
        path = self._path(signature, target.codegen())
        data = files.read(path)
        if data is None:
            turns.take(path)
            data = files.read(path)
        if data is None:
            return None
        turns.end(path)
        try:
            units, parts = pickle.loads(data)
            for unit in units:
                load_unit(unit)
            compiled = CompileResult._rebuild(target, *parts)
        except Exception as error:  # whole, but written by something that calls itself as this one
            files.discard(path, f"cannot be used ({type(error).__name__}: {error})")
            return None
        used.add(path.name)
        self._name_unit(compiled)
        return compiled

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep compiled code.

        Raises
        ------
        EnvironmentFault
            The disk is full.
        """
        if compiled.lifted or compiled.library.has_dynamic_globals:
            raise TypeError(f"{self._name} holds addresses of this process, so its compiled code cannot be kept")
        path = self._path(signature, compiled.codegen)
        units = tuple(units_of(compiled.library))
        files.write(path, dumps((units, compiled._reduce())))
        turns.end(path)
        used.add(path.name)
        self._name_unit(compiled)

    def _name_unit(self, compiled: Any) -> None:
        name = self._function.__module__, self._function.__qualname__
        compiled.library.unit = *name, compiled.signature.args, compiled.fndesc.llvm_func_name

    def end_turns(self) -> None:
        """Let other processes compile what this one has not."""
        turns.end_all(self._folder)

    def flush(self) -> None:
        """Nothing kept is ever stale: other sources have another folder."""

    def _path(self, signature: Any, codegen: Any) -> Path:
        types, _ = normalize_signature(signature)
        decides = repr((self._name, str(types), codegen.magic_tuple(), numba.__version__, sys.version))
        return self._folder / f"{self._name}-{hashlib.sha256(decides.encode()).hexdigest()[:32]}"
