"""Numba, configured once. The only module that imports it, and that only when a kernel is first called: reading and
planning a dataset imports many modules with kernels and calls none.

Kernels are nogil float64 without fastmath (which would let the compiler assume that NaN does not occur) and without
parallel sums (which would depend on the number of threads).
"""

import ast
import contextlib
import functools
import hashlib
import os
import re
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.folders import user_cache
from pipeline.jit.work import calling, loading, work
from pipeline.machine.processor import settings_of_numba

_LOCK = threading.RLock()
_TOLD = "PIPELINE_KERNEL_SOURCES"
_PACKAGE = Path(__file__).resolve().parents[1]
_DECORATED = re.compile(rb"^@(kernel|unit|inline|buffers)$", re.MULTILINE)


def cache_folder() -> Path:
    """Folder of compiled kernels: $PIPELINE_JIT_CACHE, or `jit/` in the user's cache folder.

    Keyed by a digest of all sources that kernels reach: a callee in another file may change, or a constant, which is
    compiled in, or how all are compiled. Where that of another user lies under the same name, ours is named after us:
    code of others is not run.
    """
    home = os.environ.get("PIPELINE_JIT_CACHE")
    folder = (Path(home) if home else user_cache() / "jit") / _digest_of_this()
    return folder if _may_be_ours(folder) else folder.with_name(f"{folder.name}-{os.geteuid()}")


def _may_be_ours(folder: Path) -> bool:
    try:
        return folder.lstat().st_uid in (os.geteuid(), 0)
    except OSError:
        return True


@functools.cache
def _digest_of_this() -> str:
    """Digest of our sources, which processes that we start are told: to compare bytes takes a tenth of the time."""
    sources = _digest_of_bytes()
    told, _, digest = os.environ.get(_TOLD, "").partition(" ")
    if told != sources:
        digest = _source_digest()
        os.environ[_TOLD] = f"{sources} {digest}"
    return digest


def _digest_of_bytes(package: Path = _PACKAGE) -> str:
    """Digest of all sources with their remarks, and of the Python that reads them."""
    bytes_of = hashlib.sha256(sys.version.encode())
    for path in sorted(package.rglob("*.py")):
        body = path.read_bytes()
        bytes_of.update(f"\0{path.relative_to(package)} {len(body)}\0".encode() + body)
    return bytes_of.hexdigest()[:32]


def _source_digest(package: Path = _PACKAGE) -> str:
    found: dict[Path, str] = {}
    todo = [path for path in package.rglob("*.py") if _DECORATED.search(path.read_bytes())]
    todo.append(package / "jit" / "compiler.py")
    while todo:
        path = todo.pop()
        if path not in found and path.is_file():
            tree = ast.parse(path.read_bytes())
            found[path] = ast.dump(tree)
            todo += _imported(tree, package)
    texts = [f"{path.relative_to(package)} {found[path]}" for path in sorted(found)]
    return hashlib.sha256("\n".join(texts).encode()).hexdigest()[:16]


def _imported(tree: ast.Module, package: Path) -> list[Path]:
    """Files of the modules that a module's globals may come from, and some that are not there."""
    names = []
    for node in tree.body:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    places = [package.parent / name.replace(".", "/") for name in names if name.startswith("pipeline.")]
    return [file for place in places for file in (place.with_suffix(".py"), place / "__init__.py")]


class Kernel:
    """A function that Numba compiles when it is first called, from Python or from a kernel that is compiled itself."""

    def __init__(self, function: Any, kind: str) -> None:
        functools.update_wrapper(self, function)
        self.name: str = function.__name__
        self._function, self._kind, self._compiled = function, kind, None

    @property
    def function(self) -> Any:
        """The function in Python."""
        return self._function

    @property
    def compiled(self) -> Any:
        """Numba's dispatcher of the function."""
        if self._compiled is None:
            with loading(), _LOCK:  # workers with several threads: one dispatcher, one compilation
                self._compiled = self._compiled or self._dispatcher()
        return self._compiled

    def _dispatcher(self) -> Any:
        numba = _numba()
        from pipeline.jit.cache import KernelCache
        from pipeline.jit.compiler import OPTIONS, take_any_number

        dispatcher = numba.njit(nogil=True, error_model="numpy", **OPTIONS[self._kind])(self._function)
        take_any_number(dispatcher)
        if self._kind in ("kernel", "unit"):
            dispatcher._cache = KernelCache(
                self._function, cache_folder(), self._kind
            )  # where `cache=True` puts Numba's own
            dispatcher._compile_for_args = _timed(dispatcher._compile_for_args, dispatcher._cache.end_turns)
        return dispatcher

    def __call__(self, *arguments: Any) -> Any:
        with calling(self.name):
            return self._callable(*arguments)

    @functools.cached_property
    def _callable(self) -> Any:
        """The function for Python; a copy of one that kernels call, which only tests ask for."""
        return self.compiled if self._kind == "kernel" else Kernel(self._function, "kernel").compiled

    def count(self, rays: int, surfaces: int) -> None:
        """Note that calls of this kernel, in this thread, have started so many rays through so many surfaces."""
        done = work().kernels[self.name]
        done.rays += rays
        done.crossings += rays * surfaces


def _timed(compile_for_arguments: Any, end: Callable[[], None]) -> Any:
    """The same function of Numba, which loads or compiles code when types are new; its time is tallied."""
    from pipeline.jit.compiler import remembering

    def timed(*arguments: Any, **more: Any) -> Any:
        with loading(), remembering(), contextlib.ExitStack() as last:
            last.callback(end)
            return compile_for_arguments(*arguments, **more)

    return timed


def kernel(function: Any) -> Any:
    """Compile a driver: a function that loops over many rays or pixels, called from Python."""
    return Kernel(function, "kernel")


def unit(function: Any) -> Any:
    """Compile a function that kernels call once for many rays: machine code of its own. It makes no arrays."""
    return Kernel(function, "unit")


def inline(function: Any) -> Any:
    """Compile a function that LLVM inlines into the loops of kernels. It makes no arrays, and returns none."""
    return Kernel(function, "inline")


def buffers(function: Any) -> Any:
    """Compile a function that makes arrays for kernels."""
    return Kernel(function, "buffers")


def fma(a: float, b: float, c: float) -> float:
    """For kernels: a b + c, rounded once. The same bits everywhere; slow on machines without the instruction."""
    raise NotImplementedError("fma is for kernels")


@functools.cache
def _numba() -> Any:
    os.environ.update(settings_of_numba())  # again, for programs that loaded NumPy before this package
    import numba.extending

    from pipeline.jit.compiler import DriverCompiler

    DriverCompiler.digest = _digest_of_this()
    numba.extending.typeof_impl.register(Kernel, lambda value, context: numba.types.Dispatcher(value.compiled))
    single, double = numba.float32, numba.float64
    numba.extending.type_callable(fma)(lambda context: lambda a, b, c: single if a == b == c == single else double)
    for kind in (single, double):
        numba.extending.lower_builtin(fma, kind, kind, kind)(
            lambda context, builder, signature, arguments: builder.fma(*arguments)
        )
    return numba
