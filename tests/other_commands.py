"""Commands besides `pipeline` that pages tell to type: what would refuse them, without running any."""

import importlib
import importlib.util
import re
import tomllib
from collections.abc import Callable
from functools import cache

import pytest
from pages import ROOT


def refusal_of_other(words: list[str]) -> str:
    """What is wrong with a command; empty: nothing. A program that nothing here knows is refused."""
    check = _CHECKS.get(words[0])
    return check(words[1:]) if check else f"no test knows {words[0]}"


def _of_pip(words: list[str]) -> str:
    """`pip install 'plenoptic-pipeline[extra]'`"""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found = re.fullmatch(r"install ([\w-]+)\[(\w+)\]", " ".join(words))
    known = found and found[1] == project["name"] and found[2] in project["optional-dependencies"]
    return "" if known else "no extra of this project"


def _of_dask(words: list[str]) -> str:
    """The parser of Dask's own command, which comes with the extra `cluster`."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    if importlib.util.find_spec(name := f"distributed.cli.dask_{words[0]}") is None:
        return f"no verb {words[0]}"
    try:
        importlib.import_module(name).main.make_context(words[0], words[1:])
    except Exception as error:  # click's own
        return f"{type(error).__name__}: {error}"
    return ""


def _of_python(words: list[str]) -> str:
    """A script of the repository, with options that its text has."""
    script = ROOT / words[0]
    if not script.is_file():
        return f"no file {words[0]}"
    said = script.read_text(encoding="utf-8")
    return "; ".join(f"no option {word}" for word in words[1:] if word.startswith("-") and f'"{word}"' not in said)


def _of_make(words: list[str]) -> str:
    return "; ".join(f"no target {word}" for word in words if word not in _targets())


@cache
def _targets() -> set[str]:
    return set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def _of_export(words: list[str]) -> str:
    """A variable that the code reads."""
    name = words[0].partition("=")[0]
    read = any(f'"{name}"' in path.read_text(encoding="utf-8") for path in (ROOT / "pipeline").rglob("*.py"))
    return "" if read else f"nothing reads {name}"


_CHECKS: dict[str, Callable[[list[str]], str]] = {
    "dask": _of_dask,
    "export": _of_export,
    "make": _of_make,
    "pip": _of_pip,
    "python": _of_python,
}
