"""Numba, configured once. The only module that imports it, and that only when a kernel is first called: reading and
planning a dataset imports many modules with kernels and calls none.

Kernels are nogil float64 without fastmath (which would let the compiler assume that NaN does not occur) and without
parallel sums (which would depend on the number of threads).
"""

import ast
import contextlib
import ctypes
import functools
import hashlib
import os
import pickle
import re
import sys
import threading
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pipeline.folders import user_cache
from pipeline.jit.files import is_whole, locked, no_full_disk, open_folder, seal
from pipeline.jit.waits import before_compiling
from pipeline.jit.work import calling, loading, work
from pipeline.machine.processor import level, settings_of_numba

_LOCK = threading.RLock()
_TOLD = "PIPELINE_KERNEL_SOURCES"
_PACKAGE = Path(__file__).resolve().parents[1]
_DECORATED = re.compile(rb"^@(kernel|opaque|unit|inline)$", re.MULTILINE)
_OF_KIND: dict[str, dict[str, Any]] = {
    "kernel": {"cache": True, "no_cfunc_wrapper": True},
    "unit": {"no_cpython_wrapper": True, "no_cfunc_wrapper": True},
    "inline": {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True},
}
"""Options of Numba beside those for all. Only what Python, or a kernel by its address, calls is kept for the next
process: it contains the rest.
"""
_opaque: "dict[str, Kernel]" = {}
"""Opaque functions of the modules that this process has imported: with each kernel, all that it calls."""
_thread = threading.local()
"""`fault`: what kept this thread from compiling a function that it came to."""


def cache_folder() -> Path:
    """Folder of compiled kernels: $PIPELINE_JIT_CACHE, or `jit/` in the user's cache folder.

    Keyed by all sources that kernels reach: a callee in another file may change, or a constant, which is compiled in.
    Numba compares times of sources, too, so that a copy of this package has kernels of its own. Where the folder of
    another user lies under the same name, ours is named after us: code of others is not run.
    """
    home = os.environ.get("PIPELINE_JIT_CACHE")
    folder = (Path(home) if home else user_cache() / "jit") / _digest_of_this()
    with contextlib.suppress(OSError):
        if folder.lstat().st_uid not in (os.geteuid(), 0):
            return folder.with_name(f"{folder.name}-{os.geteuid()}")
    return folder


@functools.cache
def _digest_of_this() -> str:
    """Digest of our sources, which processes that we start are told: to compare bytes takes a tenth of the time."""
    sources = _digest_of(_PACKAGE.rglob("*.py"))
    told, _, digest = os.environ.get(_TOLD, "").partition(" ")
    if told != sources:
        digest = _digest_of(_reached())[:16]
        os.environ[_TOLD] = f"{sources} {digest}"
    return digest


def _digest_of(paths: Iterable[Path]) -> str:
    """Digest of files, with their places and times, and of what compiles them."""
    from importlib.metadata import version

    compilers = " ".join(f"{name} {version(name)}" for name in ("numba", "llvmlite"))
    digest = hashlib.sha256(f"{sys.version} {level()} {compilers}".encode())
    for path in sorted(paths):
        body = path.read_bytes()
        digest.update(f"\0{path} {path.stat().st_mtime_ns} {len(body)}\0".encode() + body)
    return digest.hexdigest()


def _reached(package: Path = _PACKAGE) -> set[Path]:
    """Files with kernels, and those from whose modules their globals may come."""
    reached: set[Path] = set()
    todo = [path for path in package.rglob("*.py") if _DECORATED.search(path.read_bytes())]
    while todo:
        path = todo.pop()
        if path not in reached and path.is_file():
            reached.add(path)
            todo += _imported(ast.parse(path.read_bytes()), package)
    return reached


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
        self.function, self._kind, self._compiled = function, kind, None
        self.folder, self._home = Path(), f"{function.__module__}.{function.__qualname__}-{kind}"
        self._sealed, self._addresses = 0, dict[Any, int]()
        if kind == "opaque":
            _opaque[self._home] = self
            if _numba.cache_info().currsize:  # a module that comes later
                _make_callable(self)

    @property
    def compiled(self) -> Any:
        """Numba's dispatcher of the function."""
        if self._compiled is None:
            with loading(), _LOCK:  # workers with several threads: one dispatcher, one compilation
                if self._compiled is None:
                    options = {"nogil": True, "error_model": "numpy", **_OF_KIND[self._kind]}
                    with self._kept() if self._kind == "kernel" else contextlib.nullcontext():
                        self._compiled = _numba().njit(**options)(self.function)
        return self._compiled

    def address(self, types: Any) -> int:
        """Address of an opaque function for arguments of these types of Numba, as C would call it."""
        with loading(), _LOCK, no_full_disk(cache_folder()):
            if types not in self._addresses:
                numba = _numba()
                with self._kept(), locked(self.folder):
                    code = numba.cfunc(self._result(*types), cache=True, error_model="numpy")(self.function)
                    if not code.cache_hits:
                        seal(self.folder)
                self._addresses[types] = code.address
            return self._addresses[types]

    @property
    def _result(self) -> Any:
        """Numba's type of what an opaque function returns: a number, if it says so, or nothing."""
        types = _numba().types
        return types.float64 if self.function.__annotations__.get("return") is float else types.none

    @contextlib.contextmanager
    def _kept(self) -> Iterator[None]:
        """Open the folder of the code; Numba asks for it when it makes a function that it may keep."""
        self.folder = open_folder(cache_folder() / self._home)
        config = _numba().config
        usual, config.CACHE_DIR = config.CACHE_DIR, str(self.folder)
        try:
            yield
        finally:
            config.CACHE_DIR = usual

    def __call__(self, *arguments: Any) -> Any:
        while before_compiling and self._compiled is None and not is_whole(cache_folder() / self._home):
            before_compiling.pop()()
        with calling(self.name):
            driver = self._driver
            dispatcher = driver.compiled
            if not dispatcher.overloads:
                with loading(), _LOCK, no_full_disk(cache_folder()), locked(driver.folder):
                    dispatcher.compile(tuple(map(_numba().typeof, arguments)))
                    driver._seal()
            result = dispatcher(*arguments)
            if fault := _thread.__dict__.pop("fault", None):
                raise fault
            driver._seal()  # types were new
            return result

    @functools.cached_property
    def _driver(self) -> "Kernel":
        """The kernel for Python; a copy of one that kernels call, which only tests ask for."""
        return self if self._kind == "kernel" else Kernel(self.function, "kernel")

    def _seal(self) -> None:
        """Close the folder of the code if Numba has put more there."""
        known = len(self.compiled.overloads)
        if known != self._sealed:
            self._sealed = known
            if self.compiled.stats.cache_misses:
                seal(self.folder)

    def count(self, rays: int, surfaces: int) -> None:
        """Note that calls of this kernel, in this thread, have started so many rays through so many surfaces."""
        done = work().kernels[self.name]
        done.rays += rays
        done.crossings += rays * surfaces


def kernel(function: Any) -> Any:
    """Compile a driver: a function that loops over many rays or pixels, called from Python."""
    return Kernel(function, "kernel")


def opaque(function: Any) -> Any:
    """Compile, once it runs, a function that kernels call for many rays. It allocates nothing, and returns nothing or,
    if its annotation says so, a float.

    Kernels call it by its address, and neither contain it nor wait for it: what no ray comes to is never compiled.
    """
    return Kernel(function, "opaque")


def unit(function: Any) -> Any:
    """Compile a function that kernels call once for many rays, or for arrays that they work in."""
    return Kernel(function, "unit")


def inline(function: Any) -> Any:
    """Compile a function that LLVM inlines into the loops of kernels."""
    return Kernel(function, "inline")


def fma(a: float, b: float, c: float) -> float:
    """For kernels: a b + c, rounded once. The same bits everywhere; slow on machines without the instruction."""
    raise NotImplementedError("fma is for kernels")


def borrowed(value: Any) -> Any:
    """For drivers: their arrays, alone or in tuples, without a count of users, because the caller keeps them.

    Numba counts users wherever a kernel takes an array out of a record, and an atomic step for each vector took three
    quarters of the time of lit scenes. Such an array must not be returned.
    """
    return value


@functools.cache
def _numba() -> Any:
    os.environ.update(settings_of_numba())  # again, for programs that loaded NumPy before this package
    import llvmlite.binding
    import numba
    from numba import extending, types

    class KernelType(types.Dispatcher):
        """Type of a kernel that another one calls. It is compiled for numbers, and not once more for 0 and 1."""

        def __init__(self, kernel: Kernel) -> None:
            super().__init__(kernel.compiled)

        def get_call_type(self, context: Any, arguments: Any, keywords: Any) -> Any:
            return super().get_call_type(context, tuple(map(types.unliteral, arguments)), keywords)

    def type_of(kernel: Kernel, context: Any) -> Any:
        return None if kernel._kind == "opaque" else KernelType(kernel)

    extending.typeof_impl.register(Kernel)(type_of)
    for kernel in _opaque.values():
        _make_callable(kernel)
    llvmlite.binding.add_symbol(_FIND, ctypes.cast(_find, ctypes.c_void_p).value)

    extending.register_model(KernelType)(extending.models.OpaqueModel)
    single, double = types.float32, types.float64
    extending.type_callable(fma)(lambda context: lambda a, b, c: single if a == b == c == single else double)
    for kind in (single, double):
        extending.lower_builtin(fma, kind, kind, kind)(
            lambda context, builder, signature, arguments: builder.fma(*arguments)
        )

    def uncounted(context: Any, builder: Any, kind: Any, value: Any) -> Any:
        if isinstance(kind, types.Array):
            array = context.make_helper(builder, kind, value)
            array.meminfo = array.meminfo.type(None)  # the null pointer: nobody to count for
            return array._getvalue()
        if isinstance(kind, types.BaseTuple):
            parts: Any = kind
            for k, part in enumerate(parts):
                inner = uncounted(context, builder, part, builder.extract_value(value, k))
                value = builder.insert_value(value, inner, k)
        return value

    extending.type_callable(borrowed)(lambda context: lambda value: value)
    extending.lower_builtin(borrowed, types.Any)(
        lambda context, builder, signature, arguments: uncounted(context, builder, signature.args[0], arguments[0])
    )
    return numba


_FIND = "pipeline_find_kernel"
"""Symbol by which compiled code calls `_find`."""


@ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
def _find(name: int, size: int, slot: int) -> int:
    """For compiled code: the address of the function that it has come to, which it finds in the slot from now on.

    No exception passes compiled code. After one it goes on with a function that does nothing, and the kernel that
    Python called raises it.
    """
    try:
        kernel, types = pickle.loads(ctypes.string_at(name, size))
        address = _opaque[kernel].address(types)
        ctypes.c_void_p.from_address(slot).value = address
    except BaseException as error:
        _thread.fault = error
        address = ctypes.cast(_nothing, ctypes.c_void_p).value or 0
    return address


@ctypes.CFUNCTYPE(None)
def _nothing() -> None:
    """Callers clear their own arguments: it does for any."""


def _make_callable(kernel: Kernel) -> None:
    """Let kernels call an opaque one: through a slot with its address, which is empty at first."""
    from llvmlite import ir
    from numba import extending, types

    def call(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer, size, module = ir.IntType(8).as_pointer(), ir.IntType(64), builder.module

        def variable(kind: Any, value: Any) -> Any:
            made = ir.GlobalVariable(module, kind, module.get_unique_name(kernel.name))
            made.linkage, made.initializer = "internal", ir.Constant(kind, value)
            return made

        name = bytearray(pickle.dumps((kernel._home, signature.args)))
        slot = variable(pointer, None)
        known, before = builder.load(slot), builder.block
        with builder.if_then(builder.icmp_unsigned("==", known, ir.Constant(pointer, None)), likely=False):
            find = module.globals.get(_FIND) or ir.Function(
                module, ir.FunctionType(pointer, [pointer, size, pointer]), _FIND
            )
            text = builder.bitcast(variable(ir.ArrayType(ir.IntType(8), len(name)), name), pointer)
            found, after = builder.call(find, [text, size(len(name)), builder.bitcast(slot, pointer)]), builder.block
        address = builder.phi(pointer)
        address.add_incoming(known, before)
        address.add_incoming(found, after)
        result = context.get_value_type(signature.return_type)
        function = ir.FunctionType(result, [argument.type for argument in arguments]).as_pointer()
        return builder.call(builder.bitcast(address, function), arguments)

    typed = functools.wraps(kernel.function)(lambda *arguments: kernel._result)
    extending.type_callable(kernel)(lambda context: typed)
    extending.lower_builtin(kernel, types.VarArg(types.Any))(call)
