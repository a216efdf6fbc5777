"""Ctrl-C, SIGTERM and SIGHUP: what they end, and in what time.

Ctrl-C once lets running tasks end, and where none runs (waiting, compiling, delivering) it stops at once. Ctrl-C twice,
SIGTERM and SIGHUP stop at once everywhere. Stopping is an exception, so that things are tidied up. Where it is lost (a
library calls us from C and drops it), or never comes (a long call of C holds the main thread up), a thread that the
signal wakes by itself ends the process after `GRACE_S`: nothing half done is visible in the store.
"""

import contextlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

GRACE_S = 2.0
"""For tidying up after a signal that stops at once [s]."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_TRY_AGAIN_S = 0.05
"""Time between two looks whether a signal was heard [s]: short beside `GRACE_S`, and long beside the cost of a look."""


class Stopped(BaseException):
    """Stop now. Not an Exception, so that no task can swallow it."""


class Interrupts:
    """While this context is open, signals become facts that the driver loop asks for.

    Signals that this process was told to ignore, as by `nohup`, are ignored.

    Attributes
    ----------
    signal : int or None
        What arrived first; None as long as nobody wants to stop.
    """

    def __init__(self, notice: Callable[[str], None] = lambda text: None) -> None:
        self.signal: int | None = None
        self.is_patient = False
        self._may_stop = False
        self._is_lost = False
        self._notice = notice
        self._undo = contextlib.ExitStack()

    @property
    def exit_code(self) -> int | None:
        """130, 143 or 129 by the custom of shells; None if nothing arrived."""
        return None if self.signal is None else 128 + self.signal

    def __enter__(self) -> "Interrupts":
        if _is_main():  # Python allows handlers nowhere else
            self._watch()
            for number in SIGNALS:
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._undo.callback(signal.signal, number, signal.signal(number, self._arrived))
        return self

    def __exit__(self, *error: object) -> None:
        self._undo.close()

    def stoppable(self, work: Callable[[], object]) -> None:
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
        is_first = self.signal is None
        self.signal = self.signal or number
        if is_first and number == signal.SIGINT and self.is_patient:
            self._notice("interrupted: running tasks may end; press Ctrl-C again to stop them")
        elif self._may_stop:
            self._may_stop = False  # once is enough, unless it is lost
            raise Stopped

    def _lost(self, what: Any) -> None:
        """Python's hook for exceptions that C dropped."""
        if isinstance(what.exc_value, Stopped):
            self._may_stop = self._is_lost = True
        else:
            sys.__unraisablehook__(what)

    def _watch(self) -> None:
        """Start the thread that signals wake, through a pipe that the kernel's handler writes to."""
        reading, writing = os.pipe()
        os.set_blocking(writing, False)
        thread = threading.Thread(target=self._watching, args=(reading, threading.get_ident()), daemon=True)
        before, hook, outer = signal.set_wakeup_fd(writing, warn_on_full_buffer=False), sys.unraisablehook, _open[:]
        sys.unraisablehook, _open[:] = self._lost, [self]
        thread.start()

        def end() -> None:
            sys.unraisablehook, _open[:] = hook, outer
            signal.set_wakeup_fd(before)
            os.close(writing)  # which ends the thread
            thread.join()
            os.close(reading)

        self._undo.callback(end)

    def _watching(self, reading: int, main: int) -> None:
        arrived = 0
        while number := int.from_bytes(os.read(reading, 1)):
            arrived += number in SIGNALS
            if arrived and not (arrived == 1 and number == signal.SIGINT and self.is_patient):
                self._end_soon(reading, main, number)
                return

    def _end_soon(self, reading: int, main: int, number: int) -> None:
        """Raise what was lost again, and end the process once the time is up; nothing if this was closed before."""
        end = time.monotonic() + GRACE_S
        os.set_blocking(reading, False)
        while time.monotonic() < end:
            time.sleep(_TRY_AGAIN_S)
            with contextlib.suppress(BlockingIOError):
                if not os.read(reading, 64):
                    return
            if self._is_lost:
                self._is_lost = False
                signal.pthread_kill(main, number)
        _end(128 + (self.signal or number))


_open: list[Interrupts] = []
"""The innermost one that is open in the main thread."""


def impatient() -> contextlib.AbstractContextManager[None]:
    """Within this one Ctrl-C stops at once: nothing runs whose result would be lost."""
    return _patience(False)


def patient() -> contextlib.AbstractContextManager[None]:
    """Within this one Ctrl-C is a wish, for the driver loop to grant: tasks run."""
    return _patience(True)


@contextlib.contextmanager
def _patience(is_patient: bool) -> Iterator[None]:
    interrupts = _open[0] if _open and _is_main() else None
    if interrupts is None:
        yield
        return
    before, interrupts.is_patient = interrupts.is_patient, is_patient
    try:
        yield
    finally:
        interrupts.is_patient = before


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


def _end(code: int) -> None:
    """End this process without a word to anybody in it."""
    with contextlib.suppress(OSError):
        show_cursor = b"\x1b[?25h" if os.isatty(2) else b""
        os.write(2, show_cursor + b"interrupted: ended at once; what was finished is in the store\n")
    os._exit(code)
