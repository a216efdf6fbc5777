"""Results of builds, and the event that ends one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from pipeline.engine.events import Event
from pipeline.engine.output.deliver import Delivery
from pipeline.engine.records import TaskResult
from pipeline.errors import Exit, PipelineError
from pipeline.records.plain import Json


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The result of a build; `to_dict()` is the content of `build --json`.

    `out`: output folder, absolute.
    `seconds`: wall time of the whole build.
    `certificate`, `points`: findings of tasks for the head of the manifest; None if no manifest was written.
    `store`, `store_bytes`: the folder of the store, and the size of its whole content.
    `delivery`: changes in the output folder; None if it was not touched, see `untouched`.
    `interrupted`: whether Ctrl-C ended the build.
    `error`: the reason why the output folder could not be filled although all tasks are done.
    `checked`: tasks that ran a second time to compare their bytes.
    """

    stage: Any
    out: Path
    seconds: float
    certificate: Any
    points: Any
    tasks: tuple[TaskResult, ...]
    store: Path
    store_bytes: int
    delivery: Delivery | None = None
    interrupted: bool = False
    error: PipelineError | None = None
    checked: tuple[str, ...] = ()

    def count(self, state: str) -> int:
        return sum(task.state == state for task in self.tasks)

    @property
    def executed(self) -> int:
        """Tasks that ran now."""
        return self.count("executed")

    @property
    def failed(self) -> int:
        """Tasks that failed now."""
        return self.count("failed")

    @property
    def failures(self) -> tuple[TaskResult, ...]:
        return tuple(task for task in self.tasks if task.state == "failed")

    @property
    def different(self) -> tuple[TaskResult, ...]:
        """Tasks whose bytes differ from earlier ones with the same key."""
        return tuple(task for task in self.tasks if task.differs)

    @property
    def exit_code(self) -> int:
        """Exit code of the command, see `errors.Exit`."""
        if self.interrupted:
            return Exit.INTERRUPTED
        if any(task.machine for task in self.failures):
            return Exit.MACHINE
        if self.error is not None:
            return self.error.exit_code
        if self.failures:
            return Exit.FAILED
        return Exit.OTHER_BYTES if self.different else Exit.DONE

    @property
    def untouched(self) -> str | None:
        """The reason why the output folder was not touched, with a remedy; None if it was touched."""
        if self.delivery is not None or self.error is not None:
            return None
        if self.interrupted:
            return "the build was interrupted; build again, and it goes on from here"
        if self.failures:
            return "files come when every task is done; mend what failed and build again"
        return "only results in the store were asked for; `pipeline build STAGE FILE` delivers a file"

    @property
    def requested(self) -> tuple[str, ...] | None:
        """Files of a partial delivery; None if the delivery was complete, or did not happen."""
        return self.delivery.requested if self.delivery is not None else None

    @property
    def is_finished(self) -> bool:
        """Whether the output folder has a manifest that agrees with its files."""
        return self.delivery is not None and self.delivery.finished

    def to_dict(self) -> Json:
        """Plain data, as in `build --json`."""
        counts = {state: self.count(state) for state in ("executed", "cached", "failed", "skipped")}
        head = {"stage": self.stage, "out": str(self.out), **counts, "seconds": round(self.seconds, 3)}
        facts = {**head, "certificate": self.certificate, "points": self.points}
        facts["tasks"] = [task.to_dict() for task in self.tasks]
        if self.requested is not None:
            facts["files"] = list(self.requested)
        return facts if self.error is None else {**facts, "error": str(self.error)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended(Event):
    name: ClassVar[str] = "end"
    result: Result

    def to_dict(self) -> Json:
        """The event as a line of an event file."""
        return {"event": self.name, "time": self.time, "summary": self.result.to_dict()}
