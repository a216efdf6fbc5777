"""Shapes of arrays at the borders of modules, checked while tests run: in the first calls of a function by each test.

jaxtyping's own import hook decorates every function of a module, and compiled kernels would then be compiled with the
checks. This one decorates what has shapes in its signature once a module has been executed: a kernel is no function any
more by then.
"""

import dataclasses
import functools
import importlib.abc
import inspect
import re
import sys
from collections import Counter
from importlib.machinery import ModuleSpec, SourceFileLoader
from types import FunctionType, ModuleType
from typing import Any

import jaxtyping
from beartype import BeartypeConf, beartype

from pipeline.records import shapes

CHECKED: set[str] = set()
"""Names of the functions that are checked."""
CHECKED_CALLS = 3
"""A loop may call a function thousands of times with the same shapes; to check all took a sixth of the tests' time, and
to check ten a sixteenth more than these."""
_CALLS: Counter[str] = Counter()
_SHAPED = re.compile(rf"\b({'|'.join(shapes.__all__)})\[")
"""Annotations that have a shape, as they print."""


def install() -> None:
    """Check shapes in all modules of the package that are imported from now on."""
    for name in shapes.__all__:
        setattr(shapes, name, getattr(jaxtyping, name))
    sys.meta_path.insert(0, _Finder())


def start_counting_anew() -> None:
    """Another test begins: what it finds must not depend on the tests before it."""
    _CALLS.clear()


class _Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name: str, path: Any, target: Any = None) -> ModuleSpec | None:
        if not name.startswith("pipeline."):
            return None
        others = (finder.find_spec(name, path, target) for finder in sys.meta_path if finder is not self)
        spec = next((found for found in others if found is not None), None)
        if spec is not None and type(spec.loader) is SourceFileLoader:
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    def exec_module(self, module: ModuleType) -> None:
        super().exec_module(module)
        for name, thing in list(vars(module).items()):
            if getattr(thing, "__module__", None) != module.__name__:
                continue
            if isinstance(thing, FunctionType):
                setattr(module, name, _checked(thing))
            elif isinstance(thing, type) and not issubclass(thing, tuple):
                _check_class(thing)


def _check_class(thing: type) -> None:
    for name, member in list(vars(thing).items()):
        if isinstance(member, staticmethod | classmethod):
            setattr(thing, name, type(member)(_checked(member.__func__)))
        elif isinstance(member, FunctionType) and (name == "__init__" or not name.startswith("__")):
            is_record = name == "__init__" and dataclasses.is_dataclass(thing)
            setattr(thing, name, _checked(member, f"{thing.__qualname__}" if is_record else ""))


def _checked(function: FunctionType, record: str = "") -> Any:
    notes = {name: note for name, note in inspect.get_annotations(function).items() if _SHAPED.search(str(note))}
    if not notes:
        return function
    name = f"{function.__module__}.{record or function.__qualname__}"
    CHECKED.add(name)
    # A twin with these annotations alone: mypy checks the other annotations.
    parts = function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__
    twin = functools.wraps(function)(FunctionType(*parts))
    del twin.__wrapped__  # where the others would be found
    twin.__kwdefaults__, twin.__annotations__ = function.__kwdefaults__, notes

    @functools.cache
    def checking() -> Any:
        return jaxtyping.jaxtyped(typechecker=beartype(conf=BeartypeConf(is_pep484_tower=True)))(twin)

    @functools.wraps(twin)
    def first_calls(*args: Any, **kwargs: Any) -> Any:
        if _CALLS[name] >= CHECKED_CALLS:
            return function(*args, **kwargs)
        _CALLS[name] += 1
        return checking()(*args, **kwargs)

    return first_calls
