"""Ctrl-C during a build. SIGTERM and SIGHUP end the process at once: the store never shows unfinished work."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_SHOW_CURSOR = b"\x1b[?25h"
"""Escape sequence for a terminal whose cursor a progress bar has hidden."""


class Interrupts:
    """Context that catches the first Ctrl-C; further ones go to the previous handler.

    For a command that is the operating system, which ends the process; in a notebook it is Python. A Ctrl-C that this
    process was told to ignore, as behind a shell's `&`, is ignored. `arrived` tells whether Ctrl-C was pressed. While
    `is_patient`, it is only noted, because running tasks may finish.
    """

    def __init__(self, notice: Callable[[str], None] = lambda text: None) -> None:
        self.arrived = self.is_patient = False
        self._may_stop = self._has_stopped = False
        self._notice = notice
        self._restore = contextlib.ExitStack()

    def __enter__(self) -> "Interrupts":
        previous = signal.getsignal(signal.SIGINT)
        # Python allows signal handlers in the main thread only.
        if previous is not signal.SIG_IGN and threading.current_thread() is threading.main_thread():
            self._restore.callback(signal.signal, signal.SIGINT, previous)
            signal.signal(signal.SIGINT, self._answer)
        return self

    def __exit__(self, *error: object) -> None:
        # Nothing is left to restore after the first Ctrl-C.
        self._restore.close()

    @contextlib.contextmanager
    def stopping(self) -> Iterator[None]:
        """Context that Ctrl-C ends at once unless tasks are running. Outside it Ctrl-C is only noted."""
        try:
            self._may_stop, self._has_stopped = True, False
            yield
        except KeyboardInterrupt:
            if not self.arrived:  # not by us
                raise
        except Exception:
            if not self._has_stopped:  # else it is what a library, such as Numba, makes of our KeyboardInterrupt
                raise
        finally:
            self._may_stop = False

    def _answer(self, number: int, frame: FrameType | None) -> None:
        """Handle the first Ctrl-C: note it, restore the previous handler, and stop work that may be stopped."""
        self.arrived = True
        self._restore.close()
        if sys.__stderr__ is not None and sys.__stderr__.isatty():
            os.write(sys.__stderr__.fileno(), _SHOW_CURSOR)  # the next Ctrl-C leaves no time for it
        if self.is_patient:
            self._notice("interrupted: running tasks may end; press Ctrl-C again to stop them")
        elif self._may_stop:
            self._has_stopped = True
            raise KeyboardInterrupt
