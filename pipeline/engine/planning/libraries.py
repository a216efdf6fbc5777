"""Installed distributions that provide imported modules. None of them is imported."""

import functools
import importlib.metadata
import importlib.util
import re
import sys
from collections.abc import Iterable
from pathlib import Path


def versions_of(modules: Iterable[str]) -> dict[str, str]:
    """Versions of the distributions that provide top-level modules, and of all that these require, by name.

    A module that is not installed counts as such: it is an extra, and only what plots or makes data frames needs it.
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
    try:
        return _normal(importlib.metadata.distribution(module).metadata["Name"])
    except importlib.metadata.PackageNotFoundError:
        pass
    spec = importlib.util.find_spec(module)
    places = [*(spec.submodule_search_locations or ())] if spec else []
    folder = str(Path(places[0] if places else str(spec.origin)).parent) if spec else ""
    for distribution in importlib.metadata.distributions(path=[folder]):
        top = (distribution.read_text("top_level.txt") or "").split()
        if module in top or f"\n{module}/" in f"\n{distribution.read_text('RECORD') or ''}":
            return _normal(distribution.metadata["Name"])
    return None


def _normal(name: str) -> str:
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
