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
    work; and the folders from which pictures may be read.
    """

    def __init__(self, stage: Usd.Stage, taken: list[set[str]], folders: Sequence[Path]) -> None:
        self.answers = dict[tuple[Any, ...], tuple[Any, set[str]]]()
        self.taken, self.folders = taken, folders
        forget = self.answers.clear
        self._listener = Tf.Notice.Register(Usd.Notice.ObjectsChanged, lambda *_: forget(), stage)

    def noting(self, reader: Callable[..., R], *arguments: Any) -> tuple[R, set[str]]:
        """The answer of a reader, and the paths that it read."""
        self.taken.append(taken := set[str]())
        try:
            return reader(*arguments), taken
        finally:
            self.taken.pop()


_NOTES = WeakKeyDictionary[Usd.Stage, Notes]()


def notes_of(stage: Usd.Stage) -> Notes:
    """The notes about a stage, which end with it."""
    if (notes := _NOTES.get(stage)) is None:
        notes = _NOTES[stage] = Notes(stage, [], ())
    return notes


def read_like(stage: Usd.Stage, base: Usd.Stage) -> None:
    """Let a stage be read for the same record as a base stage, and from the same folders."""
    _NOTES[stage] = Notes(stage, notes_of(base).taken, notes_of(base).folders)


def take(prim: Usd.Prim, *properties: str) -> None:
    """Note that the reader at work reads these properties of a prim, or all of it."""
    if taken := notes_of(prim.GetStage()).taken:
        path = str(prim.GetPath())
        taken[-1].update([f"{path}.{name}" for name in properties] or [path])


class Sources(dict[str, set[str]]):
    """Paths of the properties, and of whole prims, from which each part of a record of a stage was read."""

    def __init__(self, stage: Usd.Stage) -> None:
        super().__init__()
        self._notes = notes_of(stage)

    def reading(self, part: str, reader: Callable[..., R], *arguments: Any) -> R:
        """The answer of a reader, which is a part of the record."""
        answer, taken = self._notes.noting(reader, *arguments)
        self.setdefault(part, set()).update(taken)
        return answer


def read_once(reader: F, named: Callable[..., Hashable] | None = None) -> F:
    """Memoise a reader of a stage, or of an object on one. `named`: key of the answer, by default all arguments."""

    @functools.wraps(reader)
    def asked(thing: Usd.Stage | Usd.Object, *arguments: Any) -> Any:
        stage, about = (thing, None) if isinstance(thing, Usd.Stage) else (thing.GetStage(), thing)
        notes = _NOTES.get(stage) or notes_of(stage)
        key = reader, named(thing, *arguments) if named else (about, *arguments)  # does not hold the stage
        if (answered := notes.answers.get(key)) is None:
            answered = notes.answers[key] = notes.noting(reader, thing, *arguments)
        if answered[1] and notes.taken:
            notes.taken[-1].update(answered[1])
        return answered[0]

    return cast(F, asked)
