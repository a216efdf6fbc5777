"""Numba, configured once. The only module that imports it, and that only when a kernel is first called: reading and
planning a dataset imports many modules with kernels and calls none.

Kernels are nogil float64 without fastmath (which would let the compiler assume that NaN does not occur) and without
parallel sums (which would depend on the number of threads).
"""

import ctypes
import functools
import os
import pickle
import threading
from typing import Any

from pipeline.jit.files import cache_folder, held, make_folder, ready
from pipeline.jit.waits import before_compiling
from pipeline.jit.work import calling, loading, work
from pipeline.machine.processor import settings_of_numba

_LOCK = threading.RLock()
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


class Kernel:
    """A function that Numba compiles when it is first called, from Python or from a kernel that is compiled itself."""

    def __init__(self, function: Any, kind: str) -> None:
        functools.update_wrapper(self, function)
        self.name: str = function.__name__
        self.function, self._kind, self._compiled = function, kind, None
        self._home, self._addresses = f"{function.__module__}.{function.__qualname__}", dict[Any, Any]()
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
                    self._compiled = _numba().njit(**options)(self.function)
        return self._compiled

    def address(self, types: Any) -> Any:
        """Address of an opaque function for arguments of these types of Numba, as C would call it."""
        with loading(), _LOCK:
            if types not in self._addresses:
                compiling = _numba().cfunc(self._result(*types), cache=True, error_model="numpy")
                with held(self._home):
                    self._addresses[types] = compiling(self.function)
            return self._addresses[types].address

    @property
    def _result(self) -> Any:
        """Numba's type of what an opaque function returns: a number, if it says so, or nothing."""
        types = _numba().types
        return types.float64 if self.function.__annotations__.get("return") is float else types.none

    def __call__(self, *arguments: Any) -> Any:
        if before_compiling:
            explain = before_compiling.pop()
            if not ready(cache_folder()):
                explain()
        with calling(self.name):
            dispatcher = self._driver.compiled
            if not dispatcher.overloads:
                with loading(), _LOCK, held(self._home):
                    dispatcher.compile(tuple(map(_numba().typeof, arguments)))
            result = dispatcher(*arguments)
            if fault := _thread.__dict__.pop("fault", None):
                raise fault
            return result

    @functools.cached_property
    def _driver(self) -> "Kernel":
        """The kernel for Python; a copy of one that kernels call, which only tests ask for."""
        return self if self._kind == "kernel" else Kernel(self.function, "kernel")

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
    # Settings again, for programs that loaded NumPy before this package.
    places = {"NUMBA_CACHE_DIR": str(make_folder()), "NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator"}
    os.environ.update(settings_of_numba() | places)
    import llvmlite.binding
    import numba
    from numba import extending, types

    numba.config.reload_config()  # for programs that loaded Numba before

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
        module = builder.module
        pointer = ir.IntType(8).as_pointer()
        size = ir.IntType(64)

        def internal(kind: Any, value: Any) -> Any:
            variable = ir.GlobalVariable(module, kind, module.get_unique_name(kernel.name))
            variable.linkage = "internal"
            variable.initializer = ir.Constant(kind, value)
            return variable

        name = bytearray(pickle.dumps((kernel._home, signature.args)))
        slot = internal(pointer, None)
        kept = builder.load(slot)
        start = builder.block
        with builder.if_then(builder.icmp_unsigned("==", kept, ir.Constant(pointer, None)), likely=False):
            find = module.globals.get(_FIND) or ir.Function(
                module, ir.FunctionType(pointer, [pointer, size, pointer]), _FIND
            )
            text = builder.bitcast(internal(ir.ArrayType(ir.IntType(8), len(name)), name), pointer)
            found = builder.call(find, [text, size(len(name)), builder.bitcast(slot, pointer)])
            search = builder.block
        address = builder.phi(pointer)
        address.add_incoming(kept, start)
        address.add_incoming(found, search)
        result = context.get_value_type(signature.return_type)
        function = ir.FunctionType(result, [argument.type for argument in arguments]).as_pointer()
        return builder.call(builder.bitcast(address, function), arguments)

    typed = functools.wraps(kernel.function)(lambda *arguments: kernel._result)
    extending.type_callable(kernel)(lambda context: typed)
    extending.lower_builtin(kernel, types.VarArg(types.Any))(call)
