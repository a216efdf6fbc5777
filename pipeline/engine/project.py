"""What is to be built: a graph, and what of its results goes where. Plain data, so it may come from another process."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.engine.deliver import Source
from pipeline.engine.graph import TASKS, TaskGraph
from pipeline.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Project:
    """A graph, and what of its results goes where.

    Attributes
    ----------
    files : dict
        Posix path below `out` -> bytes, or (task name, output name).
    head : dict
        What the manifest says beside format, tasks and files; `head["stage"]` names the stage without a path of
        this machine.
    findings : dict
        What the head says besides, once the tasks are done: key -> name -> (task, output), the output a JSON file.
    out : Path
        Output folder.
    stage_id : str
        What `plan` compares with: the last build of the same stage into the same folder.
    reads : tuple of Path
        Files that the project was read from: `watch` looks at them.
    places : dict
        Second part of task names, as the camera in `truth/Left/0001` -> where in the stage that stands, for messages.
    """

    graph: TaskGraph
    files: dict[str, Source]
    head: dict[str, Any]
    out: Path
    stage_id: str
    findings: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)
    reads: tuple[Path, ...] = ()
    places: dict[str, str] = field(default_factory=dict)

    def to_plain(self) -> dict[str, Any]:
        """As JSON values."""
        files = {
            path: {"base64": base64.b64encode(source).decode()} if isinstance(source, bytes) else list(source)
            for path, source in self.files.items()
        }
        tasks = [(self.graph[name].name, self.graph[name]) for name in self.graph]
        return {
            "tasks": [[name, task.kind, task.params, task.reads] for name, task in tasks],
            "files": files,
            "head": self.head,
            "findings": self.findings,
            "out": str(self.out),
            "stage_id": self.stage_id,
            "reads": [str(path) for path in self.reads],
            "places": self.places,
        }


def project_from_plain(plain: dict[str, Any], packages: tuple[str, ...] = TASKS) -> Project:
    """The project that `to_plain` wrote; kinds of tasks outside the packages are refused."""
    graph = TaskGraph(packages)
    for name, kind, params, reads in plain["tasks"]:
        graph.add(name, kind, params, reads)
    files: dict[str, Source] = {
        path: base64.b64decode(source["base64"]) if isinstance(source, dict) else (source[0], source[1])
        for path, source in plain["files"].items()
    }
    return Project(
        graph=graph,
        files=files,
        head=plain["head"],
        findings={
            key: {name: (place[0], place[1]) for name, place in named.items()}
            for key, named in plain["findings"].items()
        },
        out=Path(plain["out"]),
        stage_id=plain["stage_id"],
        reads=tuple(Path(path) for path in plain["reads"]),
        places=plain["places"],
    )


def tasks_of(project: Project, target: str) -> list[str]:
    """Tasks meant by a task name or pattern, or by the path of a file below (or in) the output folder."""
    path = Path(target)
    if path.is_absolute() and path.is_relative_to(project.out.absolute()):
        target = path.relative_to(project.out.absolute()).as_posix()
    elif path.is_relative_to(project.out):
        target = path.relative_to(project.out).as_posix()
    source = project.files.get(target)
    if isinstance(source, bytes):
        raise UsageError(f"{target} is written from the stage itself, no task makes it")
    if source is not None:
        return [source[0]]
    try:
        return project.graph.select(target)
    except UsageError:
        if path.is_file():
            hint = "another output folder is named by -o"
            raise UsageError(f"no task makes {target} in the output folder {project.out}", hint=hint) from None
        raise


def selection(project: Project, force: Iterable[str], until: Iterable[str]) -> tuple[TaskGraph, set[str]]:
    """The part of the graph up to some tasks (all of it, if none are named), and the tasks that are forced."""
    forced = {name for target in force for name in tasks_of(project, target)}
    last = [name for target in until for name in tasks_of(project, target)]
    return (project.graph.up_to(last) if last else project.graph), forced
