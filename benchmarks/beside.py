"""The commit that benchmarks compare with, checked out beside this one: its own package, kernels and results.

It runs on the libraries of this Python. Both sides run the same commands, and count processor time, user and system, of
the command and all processes that it started and waited for: other jobs touch that little.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BEFORE = "54ef84b"
"""Commit before this project was made fast."""
EXAMPLE_02 = "examples/02_plenoptic/dataset.usda"
_NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?")

_PIPELINE = "from pipeline.cli import main; main()"
_TIMED = "import json, resource, subprocess, sys; done = subprocess.run(json.loads(sys.argv[1]), capture_output=True); \
used = resource.getrusage(resource.RUSAGE_CHILDREN); \
print(json.dumps([done.returncode, used.ru_utime + used.ru_stime, done.stderr.decode()[-2000:]]))"


@dataclass(frozen=True, slots=True)
class Side:
    """A tree of sources, and a folder for what it keeps.

    Attributes
    ----------
    name : str
    tree, home : Path
    kernels : str
        Folder of the compiled kernels in `home`; empty for that of the user.
    """

    name: str
    tree: Path
    home: Path
    kernels: str = "kernels"

    def printed(self, script: str, *arguments: str) -> list[str]:
        """Lines that the tree's own benchmark of this name prints."""
        command = [sys.executable, str(self.tree / "benchmarks" / script), *arguments]
        environment = self._environment("store", self.kernels)
        said = subprocess.run(command, cwd=self.home, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        return said.stdout.splitlines()

    def _environment(self, store: str, kernels: str) -> dict[str, str]:
        places = {"PIPELINE_REPORT": "no", "PIPELINE_CACHE": str(self.home / store)}
        if kernels:
            places["PIPELINE_JIT_CACHE"] = str(self.home / kernels)
        environment = {**os.environ, **places, "PYTHONPATH": str(self.tree)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        return environment

    def run(self, code: str, *, kernels: str) -> list[str]:
        """Lines that Python code prints, called in the tree."""
        environment, command = self._environment("store", kernels), [sys.executable, "-P", "-c", code]
        said = subprocess.run(command, cwd=self.tree, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        return said.stdout.splitlines()

    def cpu_s(self, *arguments: str, store: str = "store", kernels: str = "") -> float:
        """Processor time of `pipeline` with these arguments, called in the tree [s]."""
        environment = self._environment(store, kernels or self.kernels)
        command = [sys.executable, "-c", _TIMED, json.dumps([sys.executable, "-P", "-c", _PIPELINE, *arguments])]
        said = subprocess.run(command, cwd=self.tree, env=environment, capture_output=True, text=True, check=True)
        code, took, errors = json.loads(said.stdout)
        if code:
            raise SystemExit(f"{self.name}: pipeline {' '.join(arguments)} ended with {code}: {errors}")
        return float(took)


@contextmanager
def sides(before: str = BEFORE, *, now_alone: bool = False) -> Iterator[list[Side]]:
    """An old commit and this working tree, each with empty folders; or this one alone, with the kernels of its user.

    Raises
    ------
    SystemExit
        The repository does not have the old commit.
    """
    with tempfile.TemporaryDirectory() as name:
        trees = {"now": ROOT} if now_alone else {before: _unpacked(before, Path(name)), "now": ROOT}
        kernels = "" if now_alone else "kernels"
        found = [Side(side, tree, Path(name) / "homes" / side, kernels) for side, tree in trees.items()]
        for side in found:
            side.home.mkdir(parents=True)
        yield found


def tell_ratios(script: str, lines: list[str], *arguments: str) -> None:
    """Print what the old commit's benchmark of this name tells, and now over before for lines that both have."""
    with sides() as (old, _):
        before = old.printed(script, *arguments)
    print(f"before, commit {BEFORE}:", *before, "now over before:", sep="\n")
    for line in ratios(before, lines):
        print(line)


def ratios(before: list[str], now: list[str]) -> list[str]:
    """Lines that both have but for their numbers, with ratios of these, now over before, in their places.

    Numbers that are the same stay: they are sizes, not findings. So do those that are 0 before.
    """
    found = []
    there = {kind: [line for line in before if _kind(line) == kind] for kind in map(_kind, before)}
    for line in now:
        other = there.get(_kind(line), [])
        if other and _NUMBER.search(line):
            found.append(_ratios(other.pop(0), line))
    return found


def _ratios(before: str, now: str) -> str:
    """A line with ratios of its numbers to those of another, which is the same but for them."""
    texts, numbers = _NUMBER.findall(now), map(float, _NUMBER.findall(before))
    told = iter(
        text if old in (float(text), 0.0) else f"{float(text) / old:.2f}x"
        for text, old in zip(texts, numbers, strict=True)
    )
    return _NUMBER.sub(lambda _: next(told), now)


def _kind(line: str) -> str:
    """A line without its numbers, and blanks, which depend on how long they are."""
    return _NUMBER.sub("", line).replace(" ", "")


def _unpacked(commit: str, folder: Path) -> Path:
    """The sources of a commit."""
    packed = folder / "before.zip"
    if subprocess.run(["git", "-C", str(ROOT), "archive", "-o", str(packed), commit], check=False).returncode:
        raise SystemExit(f"commit {commit} is not here: `git fetch --unshallow` brings it")
    shutil.unpack_archive(packed, folder / "before")
    return folder / "before"
