"""Code of a kind of task, as a part of its keys.

The fingerprint covers the module of the kind and every module that it imports from its own package or from this one,
directly or indirectly, even inside functions. Comments, layout and docstrings do not count; any other edit does.
Modules of other distributions count by the version of their distribution. Nothing is imported to compute it, so a plan
loads neither NumPy nor Numba.

Parsing all modules takes most of a second. The result depends only on the bytes of a source file, so the store keeps it
under their digest and it never becomes outdated.
"""

import ast
import contextlib
import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.engine.digest import key_of
from pipeline.engine.records import Components
from pipeline.engine.store.store import Store
from pipeline.machine.facts import facts


def versions_of(modules: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that provide top-level modules, and of all that these require, by name.

    A module that is not installed is listed as such: it is an extra, and only plots or data frames need it.
    """
    distributions = {module: _distribution(module) for module in set(modules)}
    versions = {module: "not installed" for module, name in distributions.items() if name is None}
    todo = [name for name in distributions.values() if name is not None]
    while todo:
        name = todo.pop()
        if name not in versions:
            versions[name] = installed_version(name)
            todo += _required(name)
    return dict(sorted(versions.items()))


def is_foreign(module: str) -> bool:
    """Whether a top-level module comes from a distribution, not from Python itself."""
    return bool(module) and module not in sys.stdlib_module_names


@functools.cache
def installed_version(name: str) -> str:
    """Version of a distribution when this process first asked: an update may have installed another since."""
    return importlib.metadata.version(name)


@functools.cache
def _distribution(module: str) -> str | None:
    """Name of the distribution that provides a top-level module; None if it is not installed. Most bear the module's
    name; others are found by the files that they list.
    """
    try:
        return _normal(importlib.metadata.distribution(module).metadata["Name"])
    except importlib.metadata.PackageNotFoundError:
        pass
    spec = importlib.util.find_spec(module)
    package_folders = [*(spec.submodule_search_locations or ())] if spec else []
    site_folder = str(Path(package_folders[0] if package_folders else str(spec.origin)).parent) if spec else ""
    for distribution in importlib.metadata.distributions(path=[site_folder]):
        top_level = (distribution.read_text("top_level.txt") or "").split()
        if module in top_level or f"\n{module}/" in f"\n{distribution.read_text('RECORD') or ''}":
            return _normal(distribution.metadata["Name"])
    return None


def _normal(name: str) -> str:
    """Name of a distribution as the packaging specification normalises it."""
    return re.sub(r"[-_.]+", "-", name).lower()


@functools.cache
def _required(name: str) -> tuple[str, ...]:
    """Installed distributions that a distribution requires, without its extras."""
    required = []
    for line in importlib.metadata.requires(name) or ():
        requirement, _, marker = line.partition(";")
        match = re.match(r"[A-Za-z0-9._-]+", requirement)
        if match and "extra" not in marker:
            try:
                installed_version(_normal(match[0]))
            except importlib.metadata.PackageNotFoundError:
                continue  # required only on another system or Python
            required.append(_normal(match[0]))
    return tuple(required)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Module:
    """Facts of one source file that the fingerprint needs, from its syntax tree."""

    digest: str
    is_package: bool
    imports: list[str]
    foreign: list[str]


Modules = dict[str, _Module | None]
"""Modules by the name of their source file; None if there is none."""

Machine = Callable[[Collection[str]], dict[str, str]]
"""Function that returns the facts about a machine on which the bits computed by these libraries depend."""

_first_seen: dict[str, str] = {}
"""Digest of every module's source when this process first read it, which is before a task imports it."""

_MANY = 4000
"""Most modules in the note of the store, about ten times the modules of this package. A note with more holds mainly
outdated sources and is started anew.
"""
_parsed_before: dict[str, _Module] = {}
"""Modules parsed by this process or by earlier ones, by a digest of a module's name and source."""


@contextlib.contextmanager
def cached_parsing(store: Store) -> Iterator[None]:
    """Context in which each source file is parsed only once by all processes that share a store."""
    note = f"code-{_reader()}"
    stored = store.read_record(dict[str, _Module], "index", note) or {}
    _parsed_before.update(stored if len(stored) < _MANY else {})
    before = len(_parsed_before)
    yield
    if len(_parsed_before) > before:
        store.write_note("index", note, _parsed_before)


@functools.cache
def _reader() -> str:
    """Version of the parser: another Python or an edit of this module may read the same source differently."""
    return key_of("reader/v1", [sys.version, hashlib.sha256(Path(__file__).read_bytes()).hexdigest()])


def check_kind(kind: str, packages: tuple[str, ...]) -> None:
    """Refuse kinds outside the accepted packages: a record or a spec must not decide which code is imported."""
    path = kind.replace(":", ".", 1)
    below = any(path.startswith(f"{package}.") for package in packages)
    if not below or not all(part.isidentifier() for part in path.split(".")):
        raise ValueError(f"{kind!r} is not a module below {' or '.join(packages)}")


def module_of(kind: str) -> str:
    """The module of a kind, which is `module:function`, or a module whose function is called `run`."""
    return kind.partition(":")[0]


def code_of(kind: str, visited: Modules | None = None, machine: Machine = facts) -> Components:
    """Components of a key that state the code of a kind of task, without parameters and inputs.

    `visited` are modules already read, shared between calls: kinds import mostly the same ones. `machine` is by default
    this process.
    """
    reached = _reached(kind, {} if visited is None else visited)
    if module_of(kind) not in reached:
        raise ValueError(f"no source file for the task kind {kind!r}")
    libraries = versions_of({name for other in reached.values() for name in other.foreign})
    return Components(
        kind=kind,
        code=key_of("code/v1", {name: other.digest for name, other in reached.items()}),
        # ast.dump differs between minor versions of Python, and so may the libraries' builds.
        libraries={"python": f"{sys.version_info.major}.{sys.version_info.minor}", **libraries},
        machine=machine(libraries),
        params={},
        inputs={},
    )


def edited(kind: str) -> list[str]:
    """Modules that a kind imports and that were edited since this process first read, and maybe ran, them."""
    return sorted(name for name, module in _reached(kind, {}).items() if module.digest != _first_seen[name])


def _reached(kind: str, visited: Modules) -> dict[str, _Module]:
    """The module of a kind, and all modules that it imports, by name; none without a source file."""
    reached: dict[str, _Module] = {}
    todo = [module_of(kind)]
    while todo:
        name = todo.pop()
        if name in reached:
            continue
        if (module := _visited(name, visited)) is not None:
            reached[name] = module
            _first_seen.setdefault(name, module.digest)
            # Importing a.b.c also runs a.b. The top package only lists public names: its edits change no task.
            parts = name.split(".")
            todo += [*module.imports, *(".".join(parts[:n]) for n in range(2, len(parts)))]
    return reached


def _visited(name: str, visited: Modules) -> _Module | None:
    """Facts of a module; None, without a look for files, below one that is no package: most imports are functions."""
    if name not in visited:
        parent, _, _ = name.rpartition(".")
        above = _visited(parent, visited) if parent else None
        visited[name] = _module(name) if above is None or above.is_package else None
    return visited[name]


def _module(name: str) -> _Module | None:
    """Facts of a module's source file; None if there is none. No package is imported."""
    # find_spec("a.b") would import a, so only the top package is looked up.
    top, *rest = name.split(".")
    spec = importlib.util.find_spec(top)
    if spec is None:
        return None
    paths = ["/".join([folder, *rest]) for folder in spec.submodule_search_locations or ()]
    files = [file for path in paths for file in (f"{path}/__init__.py", f"{path}.py")]
    for file in files if files or rest else [str(spec.origin)]:
        try:
            facts = os.stat(file)  # noqa: PTH116 (thousands of them; a Path takes ten times as long)
        except OSError:
            continue
        return _read(file, facts.st_mtime_ns, facts.st_size, name)
    return None


@functools.lru_cache(maxsize=4096)
def _read(path: str, _mtime_ns: int, _size: int, name: str) -> _Module:
    """Facts of a source file, read again only if its time or size has changed."""
    source = Path(path).read_bytes()
    is_package = path.endswith("/__init__.py")
    key = key_of("source/v1", [name, is_package, hashlib.sha256(source).hexdigest()])
    if key not in _parsed_before:
        _parsed_before[key] = _parsed(ast.parse(source, path), name, is_package)
    return _parsed_before[key]


def _parsed(tree: ast.Module, name: str, is_package: bool) -> _Module:
    """Facts of a module from its syntax tree. Changes `tree`: its docstrings are dropped."""
    parent = name if is_package else name.rpartition(".")[0]
    imports = set(_imports(tree, parent))
    # The package of the module, and this one, which an export format of another package imports: their code counts by
    # its text, that of all others by its version.
    own_packages = {name.split(".")[0], __name__.split(".")[0]}
    foreign = {imported.split(".")[0] for imported in imports} - own_packages
    _drop_docstrings(tree)
    text = ast.dump(tree, include_attributes=False)
    return _Module(
        digest=hashlib.sha256(text.encode()).hexdigest(),
        is_package=is_package,
        imports=sorted(imported for imported in imports if imported.split(".")[0] in own_packages),
        foreign=sorted(filter(is_foreign, foreign)),
    )


def _imports(tree: ast.Module, parent: str) -> Iterator[str]:
    """Absolute names that a module imports, those of its TYPE_CHECKING blocks excepted; some may be no modules."""
    for_types = {id(node) for block in ast.walk(tree) if _is_for_types(block) for node in ast.walk(block)}
    for node in ast.walk(tree):
        if id(node) in for_types:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), parent)
            yield base
            # `from base import x` imports a module x or a name x; both are tried.
            yield from (f"{base}.{alias.name}" for alias in node.names)


def _is_for_types(block: ast.AST) -> bool:
    """Whether a block is one that only checkers of types read."""
    return isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"


def _drop_docstrings(tree: ast.Module) -> None:
    for node in ast.walk(tree):
        owner = isinstance(node, ast.Module | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        if owner and ast.get_docstring(node, clean=False) is not None:  # type: ignore[arg-type]
            node.body = node.body[1:] or [ast.Pass()]  # type: ignore[attr-defined]
