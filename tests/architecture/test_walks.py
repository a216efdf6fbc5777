"""The walks in CONTRIBUTING.md name functions that are there, and its sheet of numbers is about this house."""

import importlib
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def resolved(name: str) -> object:
    """What a dotted name below the package means."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(["pipeline", *parts[:end]]))
        except ModuleNotFoundError:
            continue
        for part in parts[end:]:
            found = getattr(found, part)
        return found
    raise AssertionError(name)


def test_the_walks_pass_functions_that_are_there():
    walks = PAGE.partition("## Two walks")[2].partition("\n## ")[0]
    names = [name for name in re.findall(r"`([a-z_]+(?:\.\w+)+)`", walks) if not name.endswith(".usda")]
    assert len(names) > 30
    assert len(set(names)) == len(names), "each function once"
    assert all(callable(resolved(name)) for name in names)


def test_the_sheet_names_every_room():
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        import house
    finally:
        sys.path.remove(str(ROOT / "docs"))
    told = set(re.findall(r"^\| `([^`]+)` \| \d", PAGE, re.MULTILINE))
    assert told == {module.room for module in house.modules()}
