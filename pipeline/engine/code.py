"""What the code of a task kind contributes to its keys.

The fingerprint covers the module of the kind and every module of its own package which that imports, directly or not,
inside functions too. Comments, layout and docstrings do not count; any other edit does. Modules of other distributions
that are reached this way count by the versions of these distributions. Nothing is imported for it, so a plan starts
neither NumPy nor Numba.
"""

import ast
import functools
import hashlib
import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.engine.digest import key_of
from pipeline.engine.libraries import is_foreign, machine, versions_of


class UnknownKind(ValueError):
    """A module name that is not a task kind: outside the accepted packages, or without a source file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Module:
    """What one source file says, read by its syntax tree."""

    digest: str
    imports: tuple[str, ...]
    foreign: tuple[str, ...]
    version: Any


def check_kind(kind: str, packages: tuple[str, ...]) -> None:
    """Refuse module names outside the accepted packages: a record or a spec must not choose what gets imported."""
    below = any(kind.startswith(f"{package}.") for package in packages)
    if not below or not all(part.isidentifier() for part in kind.split(".")):
        raise UnknownKind(f"{kind!r} is not a module below {' or '.join(packages)}")


def code_of(kind: str) -> dict[str, Any]:
    """Components of a key that stand for the code: version, fingerprint, libraries, machine.

    Parameters
    ----------
    kind : str
        Module name. The module may say `VERSION = 2` as a literal, to run again although its code is the same.
    """
    own = _module(kind)
    if own is None:
        raise UnknownKind(f"no source file for the task kind {kind!r}")
    reached = _reached(kind)
    foreign = {name for module in reached.values() for name in module.foreign}
    return {
        "version": own.version,
        "code": _digest(reached),
        # ast.dump differs between minor versions of Python, and so may the libraries' builds.
        "libraries": {"python": f"{sys.version_info.major}.{sys.version_info.minor}", **versions_of(foreign)},
        "machine": machine(),
    }


def fingerprint(kind: str) -> str:
    """Hex digest of the code that the module `kind` can reach inside its own top package."""
    return _digest(_reached(kind))


def _digest(reached: dict[str, _Module]) -> str:
    return key_of("code/v1", {name: module.digest for name, module in reached.items()})


def _reached(kind: str) -> dict[str, _Module]:
    seen: dict[str, _Module] = {}
    todo = [kind]
    while todo:
        name = todo.pop()
        if name not in seen and (module := _module(name)) is not None:
            seen[name] = module
            todo += [*module.imports, *_parents(name)]
    return seen


def _parents(name: str) -> Iterator[str]:
    # Importing a.b.c runs a.b too. The top package only lists what is public: its edits change no task.
    parts = name.split(".")
    return (".".join(parts[:n]) for n in range(2, len(parts)))


def _module(name: str) -> _Module | None:
    path = _source(name)
    if path is None:
        return None
    facts = path.stat()
    return _read(path, facts.st_mtime_ns, facts.st_size, name)


def _source(name: str) -> Path | None:
    # find_spec("a.b") would import a, so only the top package is looked up.
    top, *rest = name.split(".")
    spec = importlib.util.find_spec(top)
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        path = Path(folder, *rest)
        for file in (path / "__init__.py", path.with_suffix(".py")):
            if file.is_file():
                return file
    return None


@functools.lru_cache(maxsize=4096)
def _read(path: Path, _mtime_ns: int, _size: int, name: str) -> _Module:
    tree = ast.parse(path.read_bytes(), str(path))
    parent = name if path.name == "__init__.py" else name.rpartition(".")[0]
    top = name.split(".")[0]
    found = set(_imports(tree, parent))
    foreign = {name.split(".")[0] for name in found} - {top}
    version = _version(tree)
    _drop_docstrings(tree)
    text = ast.dump(tree, include_attributes=False)
    return _Module(
        digest=hashlib.sha256(text.encode()).hexdigest(),
        imports=tuple(sorted(name for name in found if name.split(".")[0] == top)),
        foreign=tuple(sorted(filter(is_foreign, foreign))),
        version=version,
    )


def _imports(tree: ast.Module, parent: str) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = parent.split(".")
                above = parts[: len(parts) - node.level + 1]
                base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            # `from base import x` imports a module x or a name x; both are tried.
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _version(tree: ast.Module) -> Any:
    for node in tree.body:
        if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["VERSION"]:
            return ast.literal_eval(node.value)
    return 1


def _drop_docstrings(tree: ast.Module) -> None:
    for node in ast.walk(tree):
        owner = isinstance(node, ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        if owner and ast.get_docstring(node, clean=False) is not None:  # type: ignore[arg-type]
            node.body = node.body[1:] or [ast.Pass()]  # type: ignore[attr-defined]
