"""Suggestions for a name that matches no task and no file."""

import operator
import re
from collections.abc import Callable, Iterable

from pipeline.spelling import nearest

_MOST = 6
"""Number of names in one hint: they fit into one line of a terminal."""


def unpadded(name: str) -> str:
    """A name or path without leading zeros in its numbers, so that `truth/2` and `truth/0002` are equal."""
    return re.sub(r"(?<![^/])0+(?=\d+(/|$))", "", name)


def hint(target: str, tasks: Iterable[str], files: Iterable[str]) -> str:
    """A hint for a name that matches nothing: names that it abbreviates, names that it misspells, or what else there
    is.

    Names are compared part by part, as slashes divide them: `image/1` lacks the camera of `image/Rig.Camera/0001`.
    Numbers do not count as misspelt: frame 9 is not near frame 1.
    """
    parts, kinds = unpadded(target).split("/"), sorted({task.split("/")[0] for task in tasks})
    names = [(name.split("/"), unpadded(name).split("/")) for name in (*tasks, *files)]
    if lacking := _beginnings(parts, names, operator.eq):
        return _there_are(lacking)
    words = {word for _, plain in names for word in plain if not word.isdecimal()}
    near = {part: nearest(part, words) for part in parts}

    def is_alike(ours: str, theirs: str) -> bool:
        return theirs in (ours, near[ours]) or theirs.endswith(f".{ours}")

    if misspelt := _beginnings(parts, names, is_alike):
        return f"did you mean {misspelt[0]!r}?" if len(misspelt) == 1 else _there_are(misspelt)
    for depth in range(len(parts), 0, -1):
        if beside := sorted({"/".join(name[: depth + 1]) for name, plain in names if plain[:depth] == parts[:depth]}):
            return _there_are(beside)
    return f"`pipeline graph` shows the tasks; their names begin with {', '.join(kinds)}"


def _beginnings(
    parts: list[str], names: list[tuple[list[str], list[str]]], same: Callable[[str, str], bool]
) -> list[str]:
    """Beginnings of names that contain all parts in their order, possibly with others between them."""
    beginnings = set()
    for name, plain in names:
        at = 0
        for part in parts:
            while at < len(plain) and not same(part, plain[at]):
                at += 1
            at += 1
        if at <= len(name):
            beginnings.add("/".join(name[:at]))
    return sorted(beginnings)


def _there_are(names: list[str]) -> str:
    listed = f"{', '.join(names[:_MOST])}{' …' if len(names) > _MOST else ''}"
    return f"there {'is' if len(names) == 1 else 'are'} {listed}"
