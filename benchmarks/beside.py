"""The commit that benchmarks compare with, checked out beside this one: its own package, kernels and results.

It runs on the libraries of this Python. Both sides run the same commands, and count processor time, user and system, of
the command and all processes that it started and waited for: other jobs touch that little.
"""

import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BEFORE = "54ef84b"
"""Commit before this project was made fast."""
EXAMPLE_02 = "examples/02_plenoptic/dataset.usda"

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
    """

    name: str
    tree: Path
    home: Path

    def cpu_s(self, *arguments: str, store: str = "store", kernels: str = "kernels") -> float:
        """Processor time of `pipeline` with these arguments, called in the tree [s]."""
        places = {"PIPELINE_CACHE": str(self.home / store), "PIPELINE_JIT_CACHE": str(self.home / kernels)}
        environment = {**os.environ, **places, "PYTHONPATH": str(self.tree)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        command = [sys.executable, "-c", _TIMED, json.dumps([sys.executable, "-P", "-c", _PIPELINE, *arguments])]
        said = subprocess.run(command, cwd=self.tree, env=environment, capture_output=True, text=True, check=True)
        code, took, errors = json.loads(said.stdout)
        if code:
            raise SystemExit(f"{self.name}: pipeline {' '.join(arguments)} ended with {code}: {errors}")
        return float(took)


@contextmanager
def sides(*, now_alone: bool = False) -> Iterator[list[Side]]:
    """The old commit and this working tree, or this one alone, each with empty folders.

    Raises
    ------
    SystemExit
        The repository does not have the old commit.
    """
    with tempfile.TemporaryDirectory() as name:
        trees = {"now": ROOT} if now_alone else {BEFORE: _unpacked(Path(name)), "now": ROOT}
        found = [Side(side, tree, Path(name) / "homes" / side) for side, tree in trees.items()]
        for side in found:
            side.home.mkdir(parents=True)
        yield found


def _unpacked(folder: Path) -> Path:
    """The sources of the old commit."""
    packed = folder / "before.tar"
    if subprocess.run(["git", "-C", str(ROOT), "archive", "-o", str(packed), BEFORE], check=False).returncode:
        raise SystemExit(f"commit {BEFORE} is not here: `git fetch --unshallow` brings it")
    with tarfile.open(packed) as archive:
        archive.extractall(folder / "before", filter="data")
    return folder / "before"
