"""Scripts that people run by hand explain themselves and refuse what they do not know, before they do anything."""

import ast
import contextlib
import io
import runpy
import sys
import time
import types
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("benchmarks", "docs", "examples", "schemas", "tests/device", "tests/faults", "tests/mutants")
NOT_INSTALLED = {"dask_jobqueue": types.SimpleNamespace(SLURMCluster=None)}
"""Libraries that only an example asks for."""
MOST_S = 1.0
"""Processor time in which a script refuses an option: none took more than 0.1 s."""


def scripts() -> list[Path]:
    """All modules of these folders that do something when they are run."""
    found = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))
    return [path for path in found if '__name__ == "__main__"' in path.read_text(encoding="utf-8")]


def siblings(script: Path) -> set[str]:
    """Names of the modules beside a script, which it imports by these names."""
    return {path.stem for path in script.parent.glob("*.py")}


def run(script: Path, *arguments: str) -> tuple[object, str]:
    """Exit code, and all that was printed, of a script in this process."""
    printed = io.StringIO()
    # Scripts of two folders may import modules of one name.
    others = {name: sys.modules.pop(name) for name in siblings(script) if name in sys.modules}
    sys.modules.update(NOT_INSTALLED)  # `mock.patch.dict` would take away what else is imported meanwhile
    loaded = set(sys.modules)
    paths = [str(script.parent), str(ROOT / "tests"), *sys.path]
    try:
        with (
            mock.patch.object(sys, "argv", [str(script), *arguments]),
            mock.patch.object(sys, "path", paths),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
        ):
            runpy.run_path(str(script), run_name="__main__")
    except SystemExit as end:
        return end.code, printed.getvalue()
    finally:
        for name in NOT_INSTALLED:
            del sys.modules[name]
        for name in (set(sys.modules) - loaded) & siblings(script):
            del sys.modules[name]
        sys.modules.update(others)
    return None, printed.getvalue()


def test_every_script_prints_help_and_refuses_an_option_that_it_does_not_know() -> None:
    """The second time all is imported: what takes long then has begun its work."""
    wrong = []
    for script in scripts():
        for argument, code, text in (("--help", 0, "usage: "), ("--no-such-option", 2, "error: ")):
            start = time.process_time()
            ended, printed = run(script, argument)
            took_s = time.process_time() - start
            if ended != code or text not in printed:
                wrong.append(f"{script.relative_to(ROOT)} {argument}: ends with {ended}, prints {printed[-200:]!r}")
        if took_s > MOST_S:
            wrong.append(f"{script.relative_to(ROOT)} {argument}: works for {took_s:.1f} s")
    assert not wrong, "\n".join(wrong)


def test_nothing_reads_the_command_line_by_hand() -> None:
    kept = {"benchmarks/kept.py"}  # writes the arguments of a benchmark beside its results
    wrong = set()
    for path in (path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        if "argv" not in (text := path.read_text(encoding="utf-8")):
            continue  # most: to parse all takes seconds
        nodes = ast.walk(ast.parse(text))
        if any(isinstance(node, ast.Attribute) and ast.unparse(node) == "sys.argv" for node in nodes):
            wrong.add(path.relative_to(ROOT).as_posix())
    assert wrong - kept == set()
