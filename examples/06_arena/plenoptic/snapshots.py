"""Sources of programs at pinned commits, and GNU Octave with no windows."""

import os
import subprocess
from pathlib import Path

_STUBS = Path(__file__).with_name("octave")
LONGEST_S = 1200
"""Time limit of one program [s]."""


def clone(snapshots: Path, name: str, commit: str, place: Path) -> bool:
    """Check a snapshot out (OWNER+NAME/repo below `snapshots`), unless that was done; whether it was done just now.

    Snapshots lack large files, such as pictures, so git may fail to write some of the tree.
    """
    if (place / "cloned").exists():
        return False
    place.parent.mkdir(parents=True, exist_ok=True)
    git = ["git", "-C", str(place)]
    source = str(snapshots / name / "repo")
    subprocess.run(["git", "clone", "-q", "--no-checkout", source, str(place)], check=True)
    subprocess.run([*git, "read-tree", commit], check=True, capture_output=True)
    subprocess.run([*git, "checkout-index", "-a", "-f"], check=False, capture_output=True)
    (place / "cloned").write_text(commit, encoding="utf-8")
    return True


def replaced(path: Path, old: str, new: str) -> None:
    """Replace what occurs in a file; a source that has changed is an error."""
    text = path.read_text(encoding="utf-8", errors="surrogateescape")
    if old not in text:
        raise ValueError(f"{path} has no {old!r}")
    path.write_text(text.replace(old, new), encoding="utf-8", errors="surrogateescape")


def octave(program: str, folders: list[Path], task: Path, typed: str = "") -> str:
    """What a program says; dialogs choose all files of `task` that fit, and the keyboard answers `typed`."""
    paths = "".join(f"addpath('{folder}');" for folder in [*folders, _STUBS])
    said = subprocess.run(
        ["octave-cli", "--norc", "--quiet", "--eval", f"warning('off', 'all'); {paths} {program}"],
        env=os.environ | {"ARENA_TASK": str(task), "ARENA_INPUT": typed},
        cwd=task,
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
    )
    if said.returncode:
        raise RuntimeError(said.stderr.strip()[-2000:])
    return said.stdout
