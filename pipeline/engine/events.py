"""Events of a build: the only input of progress, event files and reports."""

import contextlib
import io
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, TextIO

from pipeline.engine.files import chosen_place
from pipeline.engine.records import TaskResult, fields_of
from pipeline.errors import UsageError
from pipeline.records.plain import Json

_HEAD = b'{"event": "'


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that happens in a build, with its time in seconds since 1970."""

    name: ClassVar[str]
    time: float = field(default_factory=lambda: round(time.time(), 3))

    def to_dict(self) -> Json:
        """The event as a line of an event file."""
        return {"event": self.name, **fields_of(self)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Begun(Event):
    """Start of a build: the kind of each task by name, and the number of workers."""

    name: ClassVar[str] = "begin"
    tasks: dict[str, str]
    jobs: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Compiling(Event):
    """Progress of kernel compilation: the share that is done, and the estimated time of the rest [s]."""

    name: ClassVar[str] = "compiling"
    share: float
    seconds_left: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Started(Event):
    """A task was handed to a worker."""

    name: ClassVar[str] = "started"
    task: str
    kind: str
    key: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Retried(Event):
    """A task failed and is tried again."""

    name: ClassVar[str] = "retry"
    task: str
    error: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Done(Event):
    name: ClassVar[str] = "done"
    result: TaskResult

    @property
    def usual_seconds(self) -> float | None:
        """Run time of the task, now or earlier, for estimates [s]."""
        return self.result.made_by.seconds if self.result.made_by else None

    @property
    def peak_bytes(self) -> int | None:
        """Peak memory of the task's process, if it ran now."""
        return self.result.made_by.peak_bytes if self.result.made_by and self.result.state == "executed" else None

    @property
    def news(self) -> str:
        """Message of the task for people; often empty."""
        return self.result.made_by.news if self.result.made_by else ""

    def to_dict(self) -> Json:
        """The event as a line of an event file."""
        facts = {"event": self.name, "time": self.time, "task": self.result.name, **self.result.to_dict()}
        return {**facts, "peak_bytes": self.peak_bytes}


@dataclass(frozen=True, slots=True, kw_only=True)
class Warned(Event):
    """A warning for the user."""

    name: ClassVar[str] = "warning"
    text: str


Emit = Callable[[Event], None]


def silent(event: Event) -> None:
    """Ignore an event."""


def warner(on_event: Emit) -> Callable[[str], None]:
    """A function that sends texts to a listener as warnings."""
    return lambda text: on_event(Warned(text=text))


def fan_out(listeners: Sequence[Emit]) -> Emit:
    """A listener that passes every event on to several listeners."""

    def emit(event: Event) -> None:
        for listener in listeners:
            listener(event)

    return emit


class EventFile:
    """A file with a line per event, created by the first one; UsageError if the path holds some other file."""

    def __init__(self, path: Path) -> None:
        # Nothing can be overwritten in a pipe or on a terminal.
        with chosen_place("write events to", path), path.open("rb") if path.is_file() else io.BytesIO() as stream:
            beginning = stream.read(len(_HEAD))
        if not _HEAD.startswith(beginning):
            raise UsageError(
                f"{path} exists and is not an event file of a build", hint="give --events a name that is free"
            )
        self._path = path
        self._stream: TextIO | None = None

    def __call__(self, event: Event) -> None:
        with chosen_place("write events to", self._path):
            self._stream = self._stream or self._path.open("w", encoding="utf-8", buffering=1)
            self._stream.write(json.dumps(event.to_dict(), sort_keys=True) + "\n")

    def close(self) -> None:
        if self._stream is not None:
            with contextlib.suppress(OSError):  # reported when it was written
                self._stream.close()
