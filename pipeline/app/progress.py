"""Progress of a build on stderr, drawn from its stream of events.

Rich is imported only if stderr is a terminal.
"""

import os
import shlex
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Any

Event = dict[str, Any]


def display(verbosity: int) -> "Lines":
    """A progress bar on a terminal, else lines. A negative verbosity shows failures and warnings only."""
    is_terminal = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"
    return Bar() if is_terminal and verbosity == 0 else Lines(verbosity)


class Tally:
    """Counts of a running build and an estimate of the time left, from recorded times of each kind of task."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.total = 0
        self._jobs = 1
        self._left: Counter[str] = Counter()
        self._usual: defaultdict[str, list[float]] = defaultdict(list)

    def add(self, event: Event) -> None:
        """Update the counts after an event."""
        if event["event"] == "begin":
            self.total, self._jobs = len(event["tasks"]), event["jobs"]
            self._left = Counter(event["tasks"].values())
        elif event["event"] == "done":
            self.counts[event["state"]] += 1
            self._left[event["kind"]] -= 1
            if event["usual_seconds"] is not None:
                self._usual[event["kind"]].append(event["usual_seconds"])

    def line(self) -> str:
        """`[412/1003 hit 380 run 31 fail 1]`."""
        done = self.counts.total()
        hit, run, fail = self.counts["cached"], self.counts["executed"], self.counts["failed"]
        return f"[{done}/{self.total} hit {hit} run {run} fail {fail}]"

    def seconds_left(self) -> float | None:
        """Estimated time left [s], or None while nothing is known. Kinds without a recorded time count with the mean of
        the others.
        """
        means = {kind: sum(times) / len(times) for kind, times in self._usual.items()}
        if not means:
            return None
        usual = sum(means.values()) / len(means)
        return sum(count * means.get(kind, usual) for kind, count in self._left.items()) / self._jobs


class Lines:
    """Output for logs and pipes: one line per task that ran."""

    def __init__(self, verbosity: int) -> None:
        self._verbosity = verbosity
        self._stream = sys.stderr  # the original stream: a task in this process replaces sys.stderr
        self._tally = Tally()

    def __enter__(self) -> "Lines":
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def __call__(self, event: Event) -> None:
        """Print a line if the event deserves one at this verbosity."""
        self._tally.add(event)
        if text := self._line(event):
            self._say(text)

    def _line(self, event: Event) -> str | None:
        if event["event"] == "warning":
            return f"warning: {event['text']}"
        if event["event"] == "retry":
            return f"{event['task']} tried again: {event['error'].splitlines()[0]}"
        if event["event"] == "started" and self._verbosity > 0:
            return f"{self._tally.line()} {event['task']} started"
        if event["event"] == "done" and self._is_shown(event["state"]):
            news = f": {event['news']}" if "news" in event else ""
            return f"{self._tally.line()} {event['task']} {event['state']} {event['seconds']:.1f} s{news}"
        return None

    def _is_shown(self, state: str) -> bool:
        return state == "failed" or self._verbosity > 0 or (state == "executed" and self._verbosity == 0)

    def _say(self, text: str) -> None:
        print(text, file=self._stream, flush=True)


class Bar(Lines):
    """A bar with the counts, the last finished task, the estimate, and the last news of a task. Warnings and failures
    remain above it.
    """

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        super().__init__(verbosity=-1)
        self._news = ""
        columns = (BarColumn(bar_width=24), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        console = Console(file=self._stream)
        self._progress = Progress(
            *columns, console=console, transient=True, redirect_stdout=False, redirect_stderr=False
        )
        self._bar = self._progress.add_task("", total=None)

    def __exit__(self, *error: object) -> None:
        self._progress.stop()

    def __call__(self, event: Event) -> None:
        """Redraw the bar after an event."""
        self._progress.start()  # at the first event: a process that ends before leaves the cursor alone
        super().__call__(event)
        if "news" in event:
            self._news = f"  ({event['task']}: {event['news']})"
        done, left = self._tally.counts.total(), self._tally.seconds_left()
        eta = "" if left is None else f"  ETA {int(left) // 60}:{int(left) % 60:02}"
        text = f"{self._tally.line()} {event.get('task', '')}{eta}{self._news}"
        self._progress.update(self._bar, total=self._tally.total, completed=done, description=text)

    def _say(self, text: str) -> None:
        self._progress.console.print(text, markup=False, highlight=False)


class Ending:
    """Lines after the end of a build: every failure with its log and the command that repeats it, then a summary.

    Parameters
    ----------
    again : str
        Stage and options as the user typed them; shown if the task could not be saved to a file.
    """

    def __init__(self, verbosity: int, again: str) -> None:
        self._verbosity, self._again = verbosity, again
        self._bad: dict[str, Event] = {}
        self._end: Event | None = None

    def __call__(self, event: Event) -> None:
        """Keep the event if the ending reports it."""
        if event["event"] == "done" and (event["state"] == "failed" or event.get("differs")):
            self._bad[event["task"]] = event
        elif event["event"] == "done":
            self._bad.pop(event["task"], None)
        elif event["event"] == "end":
            self._end = event

    def show(self) -> None:
        """Print the lines to stderr."""
        alike: dict[object, list[Event]] = {}
        for event in self._bad.values():
            same = (event["error"], event["place"]) if event["state"] == "failed" else event["task"]
            alike.setdefault(same, []).append(event)
        for events in alike.values():
            for line in self._failure(*events) if events[0]["state"] == "failed" else self._difference(events[0]):
                print(line, file=sys.stderr, flush=True)
        for line in self._summary():
            print(line, file=sys.stderr, flush=True)

    def _difference(self, event: Event) -> Iterator[str]:
        outputs = ", ".join(event["differs"])
        yield f"NON-DETERMINISM: {event['task']} (key {event['key'][:12]}) gave other bytes than before: {outputs}"

    def _failure(self, event: Event, *others: Event) -> Iterator[str]:
        """One error, reported once for all tasks that met it: what is wrong, where in the stage, how to mend it, how to
        look closer.
        """
        file, _, prim = (event["place"] or "").partition(": ")
        what, *more = event["error"].splitlines() or ["?"]
        yield f"{file}{': ' if file else ''}error: {what}"
        yield from (f"    {line}" for line in filter(None, [prim]))
        yield from (line if line.startswith("    ") else f"    {line}" for line in more)
        yield f"    task {event['task']} failed (key {event['key'][:12]})"
        if others:
            yield f"    so did, alike: {', '.join(other['task'] for other in others)}"
        yield f"    log: {event['log']}"
        spec = event.get("spec")
        again = f"run-task {shlex.quote(spec)}" if spec else f"build {self._again} --until {event['task']} -j1"
        yield f"    again: pipeline {again}"

    def _summary(self) -> Iterator[str]:
        if self._end is None:
            return
        whole = self._end["summary"]
        if "error" in whole:
            yield f"error: {whole['error']}"
        if self._verbosity < 0:
            return
        counts = ", ".join(f"{whole[state]} {state}" for state in ("executed", "cached", "failed", "skipped"))
        yield f"{counts} in {whole['seconds']:.1f} s; store {self._end['store']} ({human(self._end['store_bytes'])})"
        if self._end["checked"]:
            different = sum(bool(task.get("differs")) for task in whole["tasks"])
            yield f"{len(self._end['checked'])} tasks computed twice, {different} with other bytes"
        if self._end["untouched"]:
            yield f"{whole['out']} was not touched: {self._end['untouched']}"
        if partial := self._end["partial"]:
            count = len(partial["files"])
            whole_one = "a build without TARGET brings the rest and a manifest"
            state = "its manifest still holds" if partial["finished"] else whole_one
            yield f"{count} file{'s' * (count != 1)} of {whole['out']} delivered; {state}"


def human(size: float) -> str:
    """A number of bytes with a unit: 1.23 GB."""
    units = ["bytes", "kB", "MB", "GB", "TB"]
    while size >= 1000 and len(units) > 1:
        size /= 1000
        units.pop(0)
    return f"{size:.3g} {units[0]}"
