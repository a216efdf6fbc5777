"""Compilers of the three kinds of kernels: what Numba does for each, and what it is spared.

A driver is compiled as Numba does it. A unit is machine code under a name that is the same in every process, and other
code calls it by that name: it is declared in its callers, not copied into them. An inline function is kept as LLVM's
intermediate code for the functions that call it, neither optimised nor made machine code by itself. Units and inline
functions make no arrays, and count no references to them.
"""

import importlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core import typed_passes, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.postproc import PostProcessor
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack
from numba.core.transforms import canonicalize_cfg
from numba.core.typed_passes import NoPythonBackend

_UNUSED = {
    untyped_passes.WithLifting,
    untyped_passes.InlineClosureLikes,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.DeadBranchPrune,
    untyped_passes.RewriteDynamicRaises,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.InlineInlinables,
    untyped_passes.FindLiterallyCalls,
    untyped_passes.LiteralUnroll,
    untyped_passes.LiteralPropagationSubPipelinePass,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
    typed_passes.AnnotateTypes,
    typed_passes.DumpParforDiagnostics,
}
"""Passes for closures, whole arrays, code that writes code, exceptions and reports. After each all is analysed anew."""
_make_function = importlib.import_module("numba._dynfunc").make_function
Unit = tuple[str, str, tuple[Any, ...], str]
"""Module and name of a unit, types of its arguments, and the name of its code."""


class _Machine(JITCodeLibrary):
    """Code that becomes machine code. LLVM's passes go over it once, where Numba lets them go three times."""

    def add_llvm_module(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        self._final_module.link_in(module)

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)

    def finalize(self) -> None:
        found = _with_headers(self._linking_libraries)
        for header in found:
            if isinstance(header, _Header):
                self._reload_init.update(header._reload_init)
                self._final_module.link_in(header.own_module, preserve=True)
        self._linking_libraries = [library for library in found if not isinstance(library, _Header)]
        super().finalize()


class _Header(JITCodeLibrary):
    """Code to be compiled into others."""

    def add_llvm_module(self, module: Any) -> None:
        self._final_module.link_in(module)

    def finalize(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"
        self._finalized = True

    @property
    def own_module(self) -> Any:
        """The code, without that of other headers that it calls."""
        self._ensure_finalized()
        return self._final_module

    def _get_module_for_linking(self) -> Any:
        """The code with all that it calls, for compilers of others: these link what they call themselves, no more."""
        if self._shared_module is None:
            whole = self.own_module.clone()
            for library in _with_headers(self._linking_libraries):
                own = library.own_module if isinstance(library, _Header) else library._get_module_for_linking()
                whole.link_in(own, preserve=True)
            self._shared_module = whole
        return self._shared_module


def _with_headers(libraries: Iterable[JITCodeLibrary]) -> list[JITCodeLibrary]:
    """Libraries, and those that the headers among them call, each once."""
    found: dict[JITCodeLibrary, None] = {}
    waiting = list(libraries)
    while waiting:
        library = waiting.pop(0)
        if library not in found:
            found[library] = None
            waiting += library._linking_libraries if isinstance(library, _Header) else []
    return list(found)


@register_pass(mutates_CFG=True, analysis_only=False)
class _HeaderBackend(NoPythonBackend):
    """End of the compilation of an inline function: callers find it, Python does not."""

    _name = "header_backend"

    def run_pass(self, state: Any) -> bool:
        lowered, library = state["cr"], state.library
        if not state.flags.nrt and state.targetctx.data_model_manager[state.return_type].contains_nrt_meminfo():
            raise TypeError(
                f"{state.func_id.func_qualname} is inline and counts no references: it cannot return arrays"
            )
        module, name = lowered.fndesc.lookup_module(), state.func_id.func_name
        entry = _make_function(module, name, "", 0, lowered.env, (library,))
        state.targetctx.insert_user_function(entry, lowered.fndesc, [library])
        state["cr"] = lowered._replace(cfunc=entry)
        return super().run_pass(state)


@register_pass(mutates_CFG=True, analysis_only=False)
class _UnitBackend(NoPythonBackend):
    """End of the compilation of a unit: nothing of it is copied into callers."""

    _name = "unit_backend"

    def run_pass(self, state: Any) -> bool:
        state.library._shared_module = llvm.parse_assembly("")
        return super().run_pass(state)


class DriverCompiler(CompilerBase):
    """Compiler of functions that Python calls."""

    backend: type[NoPythonBackend] = NoPythonBackend
    library: type[JITCodeLibrary] = _Machine
    digest = ""

    def define_pipelines(self) -> list[Any]:
        """Numba's passes without those for what kernels do not do, and with the backend of this kind."""
        self.state.func_id.unique_id = f"{self.backend.__name__}{self.digest}"  # a unit may be a driver, too
        self.state.library = self.library(self.state.targetctx.codegen(), self.state.func_id.func_name)
        self.state.library.enable_object_caching()
        manager = PassManager(self.backend._name)
        for step, text in DefaultPassBuilder.define_nopython_pipeline(self.state).passes:
            if step not in _UNUSED:
                manager.add_pass(self.backend if step is NoPythonBackend else step, text)
        manager.finalize()
        manager._ENFORCING = False  # to analyse all anew after each pass; the last one does
        return [manager]


class UnitCompiler(DriverCompiler):
    """Compiler of functions that kernels call by name."""

    backend = _UnitBackend


class InlineCompiler(DriverCompiler):
    """Compiler of functions that become part of those that call them."""

    backend, library = _HeaderBackend, _Header

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags.no_compile = True


_WRAPPED = {"no_cpython_wrapper": False, "no_cfunc_wrapper": True}
_BARE = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
OPTIONS: dict[str, dict[str, Any]] = {
    "kernel": {"pipeline_class": DriverCompiler, **_WRAPPED},
    "unit": {"pipeline_class": UnitCompiler, "_nrt": False, **_BARE},
    "inline": {"pipeline_class": InlineCompiler, "_nrt": False, "forceinline": True, **_BARE},
    "buffers": {"pipeline_class": InlineCompiler, **_BARE},
}
"""Options of Numba for each kind of kernel. Drivers alone hold arrays and count references to them."""


_known: dict[Any, Any] = {}
"""What functions give for types of arguments, as our compilations found it."""


@contextmanager
def remembering() -> Iterator[None]:
    """Remember what functions give while our kernels are compiled; compilations of others go on as Numba does them.

    Numba looks at all its overloads of + at each +, and again when it makes code of it: two fifths of the time that a
    compilation takes. It finds five times where variables live, and uses what it finds last.
    """
    context = cpu_target.typing_context
    with global_compiler_lock:
        if "_resolve_user_function_type" in vars(context):  # a kernel is compiled because another one is
            yield
            return
        resolve, call_type, post_process = (
            context._resolve_user_function_type,
            types.BaseFunction.get_call_type,
            PostProcessor.run,
        )

        def found(function: Any, context: Any, *given: Any) -> Any:
            return _once(lambda function, *given: call_type(function, context, *given), function, given)

        def run(step: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
            if emit_dels or step.func_ir.is_generator:
                post_process(step, emit_dels, extend_lifetimes)
            else:
                step.func_ir.blocks = canonicalize_cfg(step.func_ir.blocks)

        context._resolve_user_function_type = lambda function, *given: _once(resolve, function, given)
        types.BaseFunction.get_call_type = found  # type: ignore[method-assign, assignment]
        PostProcessor.run = run  # type: ignore[method-assign, assignment]
        try:
            yield
        finally:
            PostProcessor.run = post_process  # type: ignore[method-assign]
            types.BaseFunction.get_call_type = call_type  # type: ignore[method-assign]
            del context._resolve_user_function_type


def _once(find: Any, function: Any, given: tuple[Any, ...]) -> Any:
    """The answer of a function of Numba; found once for the same arguments."""
    flags, (arguments, keywords, *more) = ConfigStack.top_or_none(), given
    key = function, tuple(arguments), flags is not None and flags.nrt
    if isinstance(function, types.Dispatcher) or keywords or more or flags is None or not _is_hashable(key):
        return find(function, *given)
    if key not in _known:
        _known[key] = find(function, *given)
    return _known[key]


def _is_hashable(key: Any) -> bool:
    """Whether a key holds no slice of constants."""
    try:
        hash(key)
    except TypeError:
        return False
    return True


def take_any_number(dispatcher: Any) -> None:
    """Let a function be compiled for numbers and not once more for 0 and -1."""
    template = dispatcher.get_call_template
    dispatcher.get_call_template = lambda arguments, keywords: template(
        [types.unliteral(argument) for argument in arguments], keywords
    )


def units_of(library: Any) -> Iterator[Unit]:
    """Units that the code of a library calls."""
    for other in dict.fromkeys(library._linking_libraries):
        if hasattr(other, "unit"):
            yield other.unit
        else:
            yield from units_of(other)


def load_unit(unit: Unit) -> None:
    """Make sure that code which calls a unit can be loaded: a name without code would end the process.

    Raises
    ------
    LookupError
        The unit has code of another name.
    """
    module, name, arguments, symbol = unit
    dispatcher = getattr(importlib.import_module(module), name).compiled
    dispatcher.compile(arguments)
    if dispatcher.overloads[arguments].fndesc.llvm_func_name != symbol:
        raise LookupError(f"there is no {symbol}")
