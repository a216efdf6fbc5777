"""Projects: a graph and the destination of its results."""

from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from pipeline.engine.options import BuildOptions
from pipeline.engine.output.deliver import Source
from pipeline.engine.output.manifest import Head
from pipeline.engine.planning.graph import TaskGraph, names_like, unpadded
from pipeline.errors import UsageError


@dataclass(frozen=True, slots=True, kw_only=True)
class Project:
    """A graph and the destination of its results.

    `files`: POSIX path below the output folder `out` -> bytes, or (task name, output name).
    `head`: further facts for the manifest, beside format, tasks and files; `head["stage"]` names the stage without a
    path of this machine.
    `stage_id`: identity of the stage. `plan` compares with the last build of the same stage into the same folder.
    `findings`: facts that are added to the head when the tasks are done: key -> name -> (task, output), a JSON file.
    `reads`: files from which the project was read; the output folder must not hold them.
    `places`: second part of task names, such as the camera in `truth/Left/0001` -> its location in the stage.
    `source`: plain data from which the project was read; the store keeps it for `app.why`, unless it is None.
    """

    graph: TaskGraph
    files: dict[str, Source]
    head: Head
    out: Path
    stage_id: str
    findings: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)
    reads: tuple[Path, ...] = ()
    places: dict[str, str] = field(default_factory=dict)
    source: Any = None


def files_of(project: Project, target: str) -> list[str]:
    """Files of the output folder that match a target; for tasks, all files that they make, possibly none."""
    return _matches(project, target)[0]


def tasks_of(project: Project, target: str) -> list[str]:
    """Tasks that match a target; UsageError if none does, or if the target is a file written from the stage itself."""
    files, tasks = _matches(project, target)
    if not tasks:
        raise UsageError(f"{files[0]} is written from the stage itself, no task makes it")
    return tasks


def selection(project: Project, options: BuildOptions) -> tuple[TaskGraph, set[str]]:
    """The part of the graph up to the named tasks, and the forced tasks; all of the graph if none is named, or one that
    reads the finished output folder.
    """
    forced = {name for target in options.force for name in tasks_of(project, target)}
    last = {name for target in options.until for name in tasks_of(project, target)}
    for target in options.targets:
        last.update(_matches(project, target)[1])  # none for a file that no task makes
    is_part = (last or options.targets) and not any(project.graph[name].after_delivery for name in last)
    return (project.graph.up_to(last) if is_part else project.graph), forced


def _matches(project: Project, target: str) -> tuple[list[str], list[str]]:
    """Files and tasks that match a target; UsageError if nothing does.

    A target is the path of a file or folder in the output folder; a name, beginning or pattern of tasks; or a pattern
    of files. Zeros before a frame number may be left out.
    """
    target_path = Path(target)
    out = project.out.absolute() if target_path.is_absolute() else project.out
    path = (target_path.relative_to(out) if target_path.is_relative_to(out) else target_path).as_posix()
    files = [name for name in project.files if f"{unpadded(name)}/".startswith(f"{unpadded(path)}/")]
    if not files:
        try:
            tasks = project.graph.select(target)
        except UsageError:
            files = [name for name in project.files if fnmatchcase(name, path)]
            if not files:
                raise _no_match(project, target, path) from None
        else:
            makers = set(tasks)
            return [name for name in project.files if maker_of(project, name) in makers], tasks
    distinct_makers = dict.fromkeys(maker_of(project, name) for name in files)
    return files, [name for name in distinct_makers if name is not None]


def maker_of(project: Project, file: str) -> str | None:
    """The task that makes a file; None if it is written from the stage itself."""
    source = project.files[file]
    return None if isinstance(source, bytes) else source[0]


def _no_match(project: Project, target: str, path: str) -> UsageError:
    if Path(target).is_file():
        hint = "another output folder is named by -o"
        return UsageError(f"no task makes {target} in the output folder {project.out}", hint=hint)
    hint = names_like(path, [*project.graph, *project.files])
    return UsageError(f"neither a task nor a file is named {target!r}", hint=hint)
