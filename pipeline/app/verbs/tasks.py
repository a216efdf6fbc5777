"""Verbs for single tasks: `pipeline run-task`, `logs`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.app.progress import human
from pipeline.app.verbs.options import Target, project_of
from pipeline.app.verbs.terminal import RUNNING, Json, Out, Roots, Stage, note, option, say, say_json
from pipeline.errors import Exit

if TYPE_CHECKING:
    from pipeline.engine.records import Reply


def run_task(
    specs: Annotated[
        list[Path], typer.Argument(metavar="SPEC.json", help="Written by `plan --specs`, or after a failure.")
    ],
    force: Annotated[bool, option(RUNNING, "--force", "-f", help="Compute even if the result exists.")] = False,
    as_json: Json = False,
) -> None:
    """Run single tasks from their files in this process, to repeat a failure or as jobs of a batch system."""
    from pipeline.app.build import TASKS
    from pipeline.engine.interrupts import Interrupts
    from pipeline.engine.running.run_task import run_task as run
    from pipeline.engine.store.store import Store

    store = Store(warn=note)
    replies: list[Reply] = []
    with Interrupts() as interrupts, interrupts.stopping():
        replies += (run(path, store, TASKS, force=force) for path in specs)
    if interrupts.arrived:
        note("interrupted")
        raise typer.Exit(Exit.INTERRUPTED)
    for reply in replies:
        if reply.state == "failed":
            note(f"error: task {reply.name} failed")
            log = Path(reply.log) if reply.log else None
            note(log.read_text(encoding="utf-8", errors="replace") if log and log.is_file() else reply.error)
            if reply.damaged:
                note("    hint: its inputs are no longer in the store: build again, or plan --specs again")
        elif not as_json:
            say(f"{reply.name} {reply.state} {reply.seconds:.1f} s")
        if reply.differs:
            note(f"NON-DETERMINISM: {reply.name} gave other bytes than before: {', '.join(reply.differs)}")
    if as_json:
        say_json({"tasks": [_facts(reply) for reply in replies]})
    raise typer.Exit(_exit_code(replies))


def logs(
    stage: Stage,
    target: Target,
    out: Out = None,
    as_json: Json = False,
    allow_root: Roots = None,
) -> None:
    """Print the log of the last run of a task, its time, its memory and its host."""
    from pipeline.engine.running.notes import logs_of

    project = project_of(stage, out, allow_root)
    tasks = logs_of(project, target)
    if as_json:
        say_json({"tasks": [asdict(task) for task in tasks]})
        return
    for task in tasks:
        facts = [task.state, f"key {task.key[:12]}" if task.key else ""]
        if made := task.made_by:
            facts += [f"{made.seconds:.2f} s on {made.host}, {made.when}", human(made.peak_bytes)]
        say(f"== {task.name}: {', '.join(filter(None, facts))}")
        if task.log:
            say(Path(task.log).read_text(encoding="utf-8", errors="replace").rstrip("\n"))
        elif task.key:
            say("   (it printed nothing)")
        else:
            say(f"   no build into {project.out} has met it; -o names another folder")
        if task.spec:
            say(f"   again: pipeline run-task {task.spec}")


def _facts(reply: "Reply") -> dict[str, Any]:
    outputs = asdict(reply.record)["outputs"] if reply.record else None
    facts = {"name": reply.name, "state": reply.state, "seconds": reply.seconds, "log": reply.log}
    return {**facts, "error": reply.error or None, "outputs": outputs, "differs": list(reply.differs)}


def _exit_code(replies: "list[Reply]") -> int:
    if any(reply.machine for reply in replies):
        return Exit.MACHINE
    if any(reply.state == "failed" for reply in replies):
        return Exit.FAILED
    return Exit.OTHER_BYTES if any(reply.differs for reply in replies) else Exit.DONE
