"""Readers of a stage: memoised until the stage changes, and with a record of the properties that they read.

The memory belongs to a stage and ends with it, so the answer of a reader depends on its arguments alone.
"""

import functools
from collections.abc import Callable, Hashable, Sequence
from pathlib import Path
from typing import Any, TypeVar, cast
from weakref import WeakKeyDictionary

from pxr import Tf, Usd

F = TypeVar("F", bound=Callable[..., Any])
R = TypeVar("R")


class Notes:
    """Memory of a stage: answers of its readers, each with the paths that it read; a set of paths for each reader at
    work, the innermost last; and the folders from which pictures may be read.
    """

    def __init__(self, stage: Usd.Stage, paths_read: list[set[str]], folders: Sequence[Path]) -> None:
        self.answers = dict[tuple[Any, ...], tuple[Any, set[str]]]()
        self.paths_read = paths_read
        self.folders = folders
        forget = self.answers.clear
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, lambda *_: forget(), stage)

    def noting(self, reader: Callable[..., R], *arguments: Any) -> tuple[R, set[str]]:
        """The answer of a reader, and the paths that it read."""
        self.paths_read.append(paths := set[str]())
        try:
            return reader(*arguments), paths
        finally:
            self.paths_read.pop()


_NOTES = WeakKeyDictionary[Usd.Stage, Notes]()


def notes_of(stage: Usd.Stage) -> Notes:
    """The notes about a stage, which end with it."""
    if (notes := _NOTES.get(stage)) is None:
        notes = _NOTES[stage] = Notes(stage, [], ())
    return notes


def read_like(stage: Usd.Stage, base: Usd.Stage) -> None:
    """Let a stage be read for the same record as a base stage, and from the same folders."""
    _NOTES[stage] = Notes(stage, notes_of(base).paths_read, notes_of(base).folders)


def note_read(prim: Usd.Prim, *properties: str) -> None:
    """Note that the reader at work reads these properties of a prim, or all of it."""
    if paths_read := notes_of(prim.GetStage()).paths_read:
        path = str(prim.GetPath())
        paths_read[-1].update([f"{path}.{name}" for name in properties] or [path])


class Sources(dict[str, set[str]]):
    """Paths of the properties, and of whole prims, from which each part of a record of a stage was read."""

    def __init__(self, stage: Usd.Stage) -> None:
        super().__init__()
        self._notes = notes_of(stage)

    def reading(self, part: str, reader: Callable[..., R], *arguments: Any) -> R:
        """The answer of a reader, which is a part of the record."""
        answer, paths = self._notes.noting(reader, *arguments)
        self.setdefault(part, set()).update(paths)
        return answer


def read_once(reader: F, named: Callable[..., Hashable] | None = None) -> F:
    """Memoise a reader of a stage, or of an object on one. `named`: key of the answer, by default all arguments."""

    @functools.wraps(reader)
    def memoised(thing: Usd.Stage | Usd.Object, *arguments: Any) -> Any:
        """The reader's answer. What it was read from counts as read by the reader at work, too."""
        stage, owner = (thing, None) if type(thing) is Usd.Stage else (thing.GetStage(), thing)
        notes = _NOTES.get(stage) or notes_of(stage)
        key = reader, named(thing, *arguments) if named else (owner, *arguments)  # does not hold the stage
        if (noted := notes.answers.get(key)) is None:
            noted = notes.answers[key] = notes.noting(reader, thing, *arguments)
        answer, paths = noted
        if paths and notes.paths_read:
            notes.paths_read[-1].update(paths)
        return answer

    return cast(F, memoised)
