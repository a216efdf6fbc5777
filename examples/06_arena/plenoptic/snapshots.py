"""Sources of programs at pinned commits, and GNU Octave with no windows."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

from environments import called

SOURCES = {
    "comsee-research/compote": "7e319c9",
    "comsee-research/libpleno": "48db282",
    "doda42/LFToolbox": "3bf4f55",
    "freerafiki/PlenopticToolbox2.0": "79f2761",
    "sotnousias/plenoptic-camera-calibration": "d41208d",
}
"""Repositories whose sources are needed, and their commits."""
_STUBS = Path(__file__).with_name("octave")


def clone(snapshots: Path, name: str, place: Path) -> bool:
    """Check a repository of `SOURCES` out of OWNER+NAME/repo below `snapshots`, unless that was done; whether it was
    done just now.

    Snapshots lack large files, such as pictures, so git may fail to write some of the tree.
    """
    if (place / "cloned").exists():
        return False
    place.parent.mkdir(parents=True, exist_ok=True)
    called(["git", "clone", "-q", "--no-checkout", snapshots / name.replace("/", "+") / "repo", place])
    called(["git", "-C", place, "read-tree", SOURCES[name]])
    subprocess.run(["git", "-C", place, "checkout-index", "-a", "-f"], check=False, capture_output=True)
    (place / "cloned").write_text(SOURCES[name], encoding="utf-8")
    return True


def replaced(path: Path, old: str, new: str) -> None:
    """Replace what occurs in a file; a source that has changed is an error."""
    text = path.read_text(encoding="utf-8", errors="surrogateescape")
    if old not in text:
        raise ValueError(f"{path} has no {old!r}")
    path.write_text(text.replace(old, new), encoding="utf-8", errors="surrogateescape")


def octave(program: str, result: str, folders: list[Path], task: Path, typed: object = "") -> Any:
    """The value of an expression after a program; dialogs choose all files of `task` that fit, and the keyboard answers
    `typed`.
    """
    paths = "".join(f"addpath('{folder}');" for folder in [*folders, _STUBS])
    words = f"warning('off', 'all'); {paths} {program} printf('FOUND%s', jsonencode({result}));"
    environment = os.environ | {"ARENA_TASK": str(task), "ARENA_INPUT": str(typed)}
    printed = called(["octave-cli", "--norc", "--quiet", "--eval", words], env=environment, cwd=task)
    return json.loads(printed.partition("FOUND")[2])
