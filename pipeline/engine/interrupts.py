"""Ctrl-C once: submit nothing more and let running tasks end. Twice, or SIGTERM: stop at once."""

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any


class Stopped(BaseException):
    """Stop now. Not an Exception, so that no task can swallow it."""


class Interrupts:
    """While this context is open, signals become facts that the driver loop asks for.

    Attributes
    ----------
    signal : int or None
        What arrived first; None as long as nobody wants to stop.
    """

    def __init__(self, notice: Callable[[str], None] = lambda text: None) -> None:
        self.signal: int | None = None
        self._may_stop = False
        self._notice = notice
        self._before: dict[int, Any] = {}

    @property
    def exit_code(self) -> int | None:
        """130 or 143 by the custom of shells; None if nothing arrived."""
        return None if self.signal is None else 128 + self.signal

    def __enter__(self) -> "Interrupts":
        if threading.current_thread() is threading.main_thread():  # Python allows handlers nowhere else
            for number in (signal.SIGINT, signal.SIGTERM):
                self._before[number] = signal.signal(number, self._arrived)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def stoppable(self, work: Callable[[], None]) -> None:
        """Do work that signals may stop at once. Before and after it they are only recorded: tidying up is not cut."""
        try:
            try:
                self._may_stop = True
                work()
            finally:
                self._may_stop = False
        except Stopped:
            pass

    def _arrived(self, number: int, frame: FrameType | None) -> None:
        again = self.signal is not None
        self.signal = self.signal or number
        if again or number == signal.SIGTERM:
            if self._may_stop:
                raise Stopped
            return
        self._notice("interrupted: running tasks may end; press Ctrl-C again to stop them")
