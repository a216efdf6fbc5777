"""The report of a build: notes taken while its tasks run, and the page written from them and the folder."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.engine.events import Begun, Done, Event, Started
from pipeline.engine.output import manifest
from pipeline.engine.output.our_files import OurFiles
from pipeline.engine.store.store import Store
from pipeline.entry_points import offered, plugged_in
from pipeline.errors import PipelineError, warn_once
from pipeline.plugins.report.records import History, TaskRun
from pipeline.results.output import open_output

if TYPE_CHECKING:
    import numpy as np

Pictures = Callable[[int], "Mapping[str, np.ndarray]"]
"""Pictures of a frame by name, (h, w) or (h, w, 3) uint8; none of a frame that has none."""


@dataclass(frozen=True, slots=True)
class Told:
    """Lines, a drawing and pictures that another plug-in tells of a camera: see `Report.tell`."""

    lines: tuple[str, ...]
    drawing: str
    pictures: Pictures


class Report:
    """Listener of one build, which then writes its page; without a build it reports the content of a folder.

    `runs`: runs by task name, in the order in which they ended; times are from the first event.
    `seconds`: time of the last event.
    `told`: what other plug-ins tell, by heading and camera.
    """

    def __init__(self) -> None:
        self.runs: dict[str, TaskRun] = {}
        self.told: dict[str, dict[str, Told]] = {}
        self.seconds, self.workers = 0.0, 1
        self._begun: float | None = None
        self._started: dict[str, float] = {}

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
            kind=task.name.split("/")[0],
            state=task.state,
            start_s=start if ran else None,
            end_s=self.seconds if ran else None,
        )

    def tell(
        self,
        heading: str,
        camera: str,
        lines: Iterable[str],
        drawing: str = "",
        pictures: Pictures = lambda frame: {},
    ) -> None:
        """Add a section about a camera: lines, a drawing as SVG, and pictures that are shown side by side."""
        self.told.setdefault(heading, {})[camera] = Told(tuple(lines), drawing, pictures)

    @property
    def has_run(self) -> bool:
        """Whether a task ran."""
        return any(run.start_s is not None for run in self.runs.values())

    def write(self, out: Path, folder: Path | None = None, *, warn: Callable[[str], None] = warn_once) -> Path:
        """Write the report of a finished build into a folder, by default `OUT.report`; returns its page, `index.html`.

        If no task ran, the history of an earlier report stays, or is made of the records in the store. It raises as
        `write_page`.
        """
        from pipeline.plugins.report.page import place_of, stage_of, write_page  # loads the tracer

        destination = folder or place_of(out)
        loaded = stage_of(out, warn)
        self._collect_sections(out, warn)
        is_told = not self.has_run and (destination / "data/history.js").is_file()
        return write_page(out, destination, loaded, None if is_told else self._history(out), self.told)

    def _collect_sections(self, out: Path, warn: Callable[[str], None]) -> None:
        """Let plug-ins tell about a build; their failure fails no report."""
        stage = Path(OurFiles(out, Store()).stage)
        for name in offered("section") if stage.is_file() else ():
            try:
                plugged_in("section", name)(self, stage, open_output(out))
            except PipelineError as error:
                warn(f"the report has no {name}: {error.message}")

    def write_after_build(self, out: Path, *, warn: Callable[[str], None]) -> Path | None:
        """Write the report of a build that has just ended, unless it exists; its failure fails no build."""
        from pipeline.plugins.report.page import INDEX, is_current, place_of

        folder = place_of(out)
        try:
            if not self.has_run and is_current(out, folder):
                return folder / INDEX
            return self.write(out, warn=warn)
        except PipelineError as error:
            warn(f"no report was written: {error.message}")
        except OSError as error:
            warn(f"no report was written to {folder}: {error.strerror}")
        return None

    def _history(self, out: Path) -> History:
        """History of all tasks of the manifest: from the notes about a build, and from records of the store."""
        store = Store()
        runs = self.runs if self.has_run else {}
        return History(
            tasks=tuple(_run(store, name, key, runs.get(name)) for name, key in manifest.read(out).tasks.items()),
            seconds=self.seconds if self.has_run else None,
            workers=self.workers if self.has_run else None,
        )


def _run(store: Store, name: str, key: str, noted: TaskRun | None) -> TaskRun:
    record = store.peek(key)
    made_by = record.made_by if record else None
    run = noted or TaskRun(name=name, kind=name.split("/")[0], state="made before")
    return replace(run, cpu_s=made_by.cpu_seconds, peak_bytes=made_by.peak_bytes) if made_by else run
