"""Progress of a build on stderr, drawn from its stream of events.

Rich is imported only if stderr is a terminal.
"""

import os
import shlex
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator

from pipeline.engine.events import Begun, Compiling, Done, Event, Retried, Started, Warned
from pipeline.engine.records import TaskResult
from pipeline.engine.running.result import Ended, Result
from pipeline.machine.process import Stderr
from pipeline.spelling import for_terminals, human


def display(verbosity: int) -> "Lines":
    """A progress bar on a terminal, else lines. A negative verbosity shows failures and warnings only."""
    is_terminal = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    return Bar() if is_terminal and verbosity == 0 else Lines(verbosity)


class Lines:
    """Output for logs and pipes: one line per task that ran."""

    def __init__(self, verbosity: int) -> None:
        self._verbosity = verbosity
        self._stream = sys.stderr  # the original stream: a task in this process replaces sys.stderr
        self._counts: Counter[str] = Counter()
        self._left: Counter[str] = Counter()
        self._total, self._jobs = 0, 1
        self._timed: Counter[str] = Counter()
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._has_told = False

    def __enter__(self) -> "Lines":
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def __call__(self, event: Event) -> None:
        """Print a line if the event is shown at this verbosity."""
        if isinstance(event, Begun):
            self._total = len(event.tasks)
            self._jobs = event.jobs
            self._left = Counter(event.tasks.values())
        elif isinstance(event, Done):
            self._counts[event.result.state] += 1
            self._left[event.result.kind] -= 1
            if event.usual_seconds is not None:
                self._timed[event.result.kind] += 1
                self._seconds[event.result.kind] += event.usual_seconds
        if text := self._line(event):
            self._say(text)

    def _tally(self) -> str:
        """`[412/1003 hit 380 run 31 fail 1]`."""
        hit, run, fail = self._counts["cached"], self._counts["executed"], self._counts["failed"]
        return f"[{self._counts.total()}/{self._total} hit {hit} run {run} fail {fail}]"

    def _seconds_left(self) -> float | None:
        """Remaining time from recorded times by kind of task [s], for other kinds from the mean; None without any."""
        means = {kind: self._seconds[kind] / count for kind, count in self._timed.items()}
        if not means:
            return None
        usual = sum(means.values()) / len(means)
        return sum(count * means.get(kind, usual) for kind, count in self._left.items()) / self._jobs

    def _line(self, event: Event) -> str | None:
        """The line about an event; None if it is not shown at this verbosity."""
        match event:
            case Warned():
                return f"warning: {event.text}"
            case Compiling() if self._verbosity >= 0 and not self._has_told:
                self._has_told = True
                return f"compiling kernels, once per version: about {event.seconds_left:.0f} s"
            case Retried():
                return f"{event.task} tried again: {event.error.splitlines()[0]}"
            case Started() if self._verbosity > 0:
                return f"{self._tally()} {event.task} started"
            case Done() if self._is_shown(event.result.state):
                task = event.result
                news = f": {event.news}" if event.news else ""
                return f"{self._tally()} {task.name} {task.state} {task.seconds:.1f} s{news}"
        return None

    def _is_shown(self, state: str) -> bool:
        return state == "failed" or self._verbosity > 0 or (state == "executed" and self._verbosity == 0)

    def _say(self, text: str) -> None:
        print(text, file=self._stream, flush=True)


class Bar(Lines):
    """A bar with counts, the last finished task, the remaining time and news; warnings and failures remain above."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
        from rich.table import Column

        super().__init__(verbosity=-1)
        self._news = ""
        remaining_width = Column(ratio=1, no_wrap=True)  # after bar and time, even on a narrow terminal
        text = TextColumn("{task.description}", markup=False, table_column=remaining_width)
        columns = (BarColumn(bar_width=12), text, TimeElapsedColumn())
        console = Console(file=Stderr(draws=True) if isinstance(self._stream, Stderr) else self._stream)
        self._progress = Progress(
            *columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False, expand=True
        )
        self._bar = self._progress.add_task("", total=None)

    def __exit__(self, *error: object) -> None:
        self._progress.stop()

    def __call__(self, event: Event) -> None:
        """Redraw the bar after an event."""
        self._progress.start()  # at the first event: a process that ends before leaves the cursor alone
        super().__call__(event)
        if isinstance(event, Compiling):
            text = f"{event.seconds_left:.0f} s left: compiling kernels, once per version"
            self._progress.update(self._bar, total=1.0, completed=event.share, description=text)
            return
        if isinstance(event, Done) and event.news:
            self._news = f"  ({event.result.name}: {event.news})"
        name = event.result.name if isinstance(event, Done) else event.task if isinstance(event, Started) else ""
        seconds_left = self._seconds_left()
        eta = "" if seconds_left is None else f"  ETA {int(seconds_left) // 60}:{int(seconds_left) % 60:02}"
        text = for_terminals(f"{self._tally()} {name}{eta}{self._news}")
        self._progress.update(self._bar, total=self._total, completed=self._counts.total(), description=text)

    def _say(self, text: str) -> None:
        self._progress.console.print(for_terminals(text), markup=False, highlight=False)


class Ending:
    """Lines after a build: every failure with its log and the command that repeats it, then a summary.

    `arguments` are stage and options as the user typed them, for the command that builds a failed task once more; a
    task that could be saved to a file is repeated by `run-task`.
    """

    def __init__(self, verbosity: int, arguments: str) -> None:
        self._verbosity = verbosity
        self._arguments = arguments
        self._bad: dict[str, TaskResult] = {}
        self._result: Result | None = None

    def __call__(self, event: Event) -> None:
        """Keep the event if the ending reports it."""
        if isinstance(event, Done):
            self._bad.pop(event.result.name, None)
            if event.result.state == "failed" or event.result.differs:
                self._bad[event.result.name] = event.result
        elif isinstance(event, Ended):
            self._result = event.result

    def show(self) -> None:
        """Print the lines to stderr."""
        groups: dict[object, list[TaskResult]] = {}  # tasks with the same error
        for task in self._bad.values():
            error = (task.error, task.place) if task.state == "failed" else task.name
            groups.setdefault(error, []).append(task)
        failures = (line for tasks in groups.values() for line in self._failure(*tasks))
        for line in (*failures, *self._summary()):
            print(line, file=sys.stderr, flush=True)

    def _failure(self, task: TaskResult, *further: TaskResult) -> Iterator[str]:
        """Lines of one error, once for all tasks that met it: message, location in the stage, remedy, next step."""
        if task.state != "failed":
            outputs = ", ".join(task.differs)
            yield f"NON-DETERMINISM: {task.name} (key {str(task.key)[:12]}) gave other bytes than before: {outputs}"
            return
        file, _, prim = (task.place or "").partition(": ")
        message, *more = (task.error or "").splitlines() or ["?"]
        yield f"{file}{': ' if file else ''}error: {message}"
        yield from (f"    {line}" for line in filter(None, [prim]))
        yield from (line if line.startswith("    ") else f"    {line}" for line in more)
        yield f"    task {task.name} failed (key {str(task.key)[:12]})"
        if further:
            yield f"    so did, alike: {', '.join(other.name for other in further)}"
        yield from [f"    log: {task.log}"] if task.log else []
        build_again = f"build {self._arguments} --until {task.name} -j1"
        command = f"run-task {shlex.quote(task.spec)}" if task.spec else build_again
        yield f"    again: pipeline {command}"

    def _summary(self) -> Iterator[str]:
        """Lines about the build: error, counts and times, and the state of its output folder."""
        result = self._result
        if result is None:
            return
        if result.error is not None:
            yield f"error: {result.error}"
        if self._verbosity < 0:
            return
        counts = ", ".join(f"{result.count(state)} {state}" for state in ("executed", "cached", "failed", "skipped"))
        yield f"{counts} in {result.seconds:.1f} s; store {result.store} ({human(result.store_bytes)})"
        if result.checked:
            yield f"{len(result.checked)} tasks computed twice, {len(result.different)} with other bytes"
        if result.untouched:
            yield f"{result.out} was not touched: {result.untouched}"
        if result.requested is not None:
            count = len(result.requested)
            advice = "a build without TARGET brings the rest and a manifest"
            state = "its manifest still holds" if result.is_finished else advice
            yield f"{count} file{'s' * (count != 1)} of {result.out} delivered; {state}"
