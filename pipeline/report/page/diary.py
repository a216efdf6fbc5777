"""Listener of a build that notes when its tasks began and ended, for the timeline of the report."""

from pipeline.engine.events import Event
from pipeline.report.page.records import TaskRun


class Diary:
    """Notes about the tasks of one build.

    Attributes
    ----------
    runs : dict of str to TaskRun
        Runs by task name, in the order in which they ended; times are from the first event.
    seconds : float
        Time of the last event.
    workers : int
    """

    def __init__(self) -> None:
        self.runs: dict[str, TaskRun] = {}
        self.seconds, self.workers = 0.0, 1
        self._begun: float | None = None
        self._started: dict[str, float] = {}

    @property
    def has_run(self) -> bool:
        """Whether a task ran."""
        return any(run.start_s is not None for run in self.runs.values())

    def __call__(self, event: Event) -> None:
        """Note an event, which has the `time` that `fan_out` adds."""
        if self._begun is None:
            self._begun = event["time"]
        self.seconds = event["time"] - self._begun
        if event["event"] == "begin":
            self.workers = event["jobs"]
        elif event["event"] == "started":
            self._started[event["task"]] = self.seconds
        elif event["event"] == "done":
            self._note(event)

    def _note(self, event: Event) -> None:
        ran = event["state"] in ("executed", "failed")
        start = self._started.get(event["task"])
        if ran and start is not None and event.get("seconds"):
            start = max(start, self.seconds - event["seconds"])  # it may have waited for a worker
        self.runs[event["task"]] = TaskRun(
            name=event["task"],
            kind=event["kind"],
            state=event["state"],
            start_s=start if ran else None,
            end_s=self.seconds if ran else None,
            cpu_s=None,
            peak_bytes=event.get("peak_bytes"),
        )
