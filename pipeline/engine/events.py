"""Events of a build, as a stream of plain dicts; progress, event files and reports read nothing else.

`{"event": "begin", "tasks": {name: kind}}`, then per task `started` and `done` (with the fields of a task's result
`usual_seconds`, and `news` if it has any), `warning` with a text, and `end` with the summary of the build.
"""

import contextlib
import json
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TextIO

from pipeline.engine.files import chosen_place
from pipeline.errors import UsageError

_HEAD = b'{"event": "'

Event = dict[str, Any]
Emit = Callable[[Event], None]


def silent(event: Event) -> None:
    """Ignore an event."""


def warner(on_event: Emit) -> Callable[[str], None]:
    """A function that turns texts into warnings for a listener."""
    return lambda text: on_event({"event": "warning", "text": text})


def fan_out(listeners: Iterable[Emit]) -> Emit:
    """A listener that adds the time to every event and passes it on to several listeners."""
    everyone = list(listeners)

    def emit(event: Event) -> None:
        stamped = {**event, "time": round(time.time(), 3)}
        for listener in everyone:
            listener(stamped)

    return emit


class EventFile:
    """A file with one event per line, each written at once. The first event creates the file.

    Raises
    ------
    UsageError
        The path holds some other file, which would be overwritten.
    """

    def __init__(self, path: Path) -> None:
        if not _HEAD.startswith(_beginning(path)):
            raise UsageError(
                f"{path} exists and is not an event file of a build", hint="give --events a name that is free"
            )
        self._path = path
        self._stream: TextIO | None = None

    def __call__(self, event: Event) -> None:
        """Append an event."""
        with chosen_place("write events to", self._path):
            self._stream = self._stream or self._path.open("w", encoding="utf-8", buffering=1)
            self._stream.write(json.dumps(event, sort_keys=True) + "\n")

    def close(self) -> None:
        """Flush and close."""
        if self._stream is not None:
            with contextlib.suppress(OSError):  # reported when it was written
                self._stream.close()


def _beginning(path: Path) -> bytes:
    """The first bytes of a plain file; empty for a pipe or a terminal, where nothing can be overwritten."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as stream:
            return stream.read(len(_HEAD))
    except OSError:
        return b"it cannot be read, so it may be anything"
