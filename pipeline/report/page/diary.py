"""Listener of a build that notes when its tasks began and ended, for the timeline of the report."""

from pipeline.engine.events import Begun, Done, Event, Started
from pipeline.report.page.records import TaskRun


class Diary:
    """Notes about the tasks of one build.

    `runs`: runs by task name, in the order in which they ended; times are from the first event.
    `seconds`: time of the last event.
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
        if self._begun is None:
            self._begun = event.time
        self.seconds = event.time - self._begun
        match event:
            case Begun():
                self.workers = event.jobs
            case Started():
                self._started[event.task] = self.seconds
            case Done():
                self._note(event)

    def _note(self, event: Done) -> None:
        task = event.result
        ran = task.state in ("executed", "failed")
        start = self._started.get(task.name)
        if ran and start is not None and task.seconds:
            start = max(start, self.seconds - task.seconds)  # it may have waited for a worker
        self.runs[task.name] = TaskRun(
            name=task.name,
            kind=task.kind,
            state=task.state,
            start_s=start if ran else None,
            end_s=self.seconds if ran else None,
            cpu_s=None,
            peak_bytes=event.peak_bytes,
        )
