"""Ctrl-C, SIGTERM and SIGHUP: orderly and immediate ends of a build.

The first Ctrl-C lets running tasks finish; if none runs (waiting, compiling, delivering), it stops the build at once. A
second Ctrl-C, SIGTERM and SIGHUP always stop at once. Stopping raises an exception, so that everything is tidied up.
The exception can be lost (a library that calls us from C drops it) or delayed (a long call of C blocks the main
thread). So the signal also wakes a thread, which ends the process after `GRACE_S`. That is safe: nothing half done is
visible in the store.
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
"""Time to tidy up after a signal that stops at once [s]."""

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_TRY_AGAIN_S = 0.05
"""Time between two checks whether a signal took effect [s]: short beside `GRACE_S`, long beside the cost of a check."""


class Stopped(BaseException):
    """Stop now. Not an Exception, so that no task can swallow it."""


class Interrupts:
    """While this context is open, signals are recorded, and the driver loop asks for them.

    Signals that this process was told to ignore, as by `nohup`, are ignored.

    Attributes
    ----------
    signal : int or None
        The first signal that arrived; None before.
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
        """Exit code by the convention of shells: 130, 143 or 129; None if no signal arrived."""
        return None if self.signal is None else 128 + self.signal

    def __enter__(self) -> "Interrupts":
        if _is_main():  # Python allows signal handlers in the main thread only
            self._watch()
            for number in SIGNALS:
                if signal.getsignal(number) is not signal.SIG_IGN:
                    self._undo.callback(signal.signal, number, signal.signal(number, self._arrived))
        return self

    def __exit__(self, *error: object) -> None:
        self._undo.close()

    def stoppable(self, work: Callable[[], object]) -> None:
        """Do work that signals may stop at once. Before and after it they are only recorded, so tidying up is not
        interrupted.
        """
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
        """Note a `Stopped` that C code dropped; Python calls this hook for such exceptions."""
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
            os.close(writing)  # this ends the thread
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
        """Raise a lost `Stopped` again, and end the process when the time is up; do nothing if the context has
        closed.
        """
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
"""Open contexts of the main thread, innermost last."""


def impatient() -> contextlib.AbstractContextManager[None]:
    """A context in which Ctrl-C stops at once: no task runs whose result would be lost."""
    return _patience(False)


def patient() -> contextlib.AbstractContextManager[None]:
    """A context in which Ctrl-C is only recorded for the driver loop, because tasks are running."""
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
    """End this process at once, without any cleanup."""
    with contextlib.suppress(OSError):
        show_cursor = b"\x1b[?25h" if os.isatty(2) else b""
        os.write(2, show_cursor + b"interrupted: ended at once; what was finished is in the store\n")
    os._exit(code)
