"""Read an untrusted stage in a confined process, which cannot write files and may crash.

The process answers in JSON. It may read the folders of the stage, the library and the installation only. The checks of
asset roots (`scene.trust.prescan`) run there too, because some kernels have no Landlock.
"""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.confine.process import Bounds, Ended, Guards, ask
from pipeline.engine.output.manifest import is_plain_path
from pipeline.engine.project import Project, project_from_plain
from pipeline.errors import UsageError
from pipeline.jit.files import say
from pipeline.roots import allowed_roots, readable_for
from pipeline.spelling import printable

BOUNDS = Bounds()


def project_of_untrusted(
    path: Path,
    out: Path,
    allow_roots: Iterable[str | Path],
    *,
    preview: bool = False,
    warn: Callable[[str], None] = say,
) -> Project:
    """The project of a stage, read in the sandbox. Guards that are not in force cause a warning.

    Raises
    ------
    UsageError
        The stage does not pass `check`, or reading it exceeded the limits.
    """
    try:
        told, guards = _ask(path, allow_roots, check=False, preview=preview)
        if "error" in told:
            raise UsageError(_shown(told["error"]))
        project = project_from_plain(told["project"])
    except Ended as error:
        raise UsageError(_problem(error, path)["text"]) from None
    except (KeyError, TypeError, ValueError, AttributeError):
        raise UsageError(f"{path}: reading it gave no project") from None
    if not (guards.landlock and guards.seccomp):
        warn(f"{path} was read without some guards of --untrusted: {guards}")
    # A stage that takes over the process must not choose where files are written.
    if not all(map(is_plain_path, project.files)):
        raise UsageError(f"{path}: it names files outside of the output folder")
    stage_id = f"{path.resolve()}{' preview' if preview else ''}"
    return replace(project, out=out, stage_id=stage_id)


def problems_of_untrusted(path: Path, allow_roots: Iterable[str | Path]) -> tuple[list[dict[str, Any]], Guards]:
    """Problems that `check` finds in the sandbox (the fields of `Problem` and its `text`), and the guards in force."""
    try:
        told, guards = _ask(path, allow_roots, check=True)
        return [{**row, "text": _shown(str(row["text"]))} for row in told["problems"]], guards
    except Ended as error:
        return [_problem(error, path)], error.guards


def answer(question: dict[str, Any], guards: Guards) -> dict[str, Any]:
    """The answer that the sandbox computes: `problems`, the `project`, or an `error` with the reason why there is
    none.
    """
    from pipeline.app.build import project_from
    from pipeline.scene.load import load
    from pipeline.scene.usd.problems import StageError

    path = Path(question["path"])
    loaded = load(path, question["allow_roots"], look=question["check"], guards=guards)
    if question["check"]:
        return {"problems": [_row(problem) for problem in loaded.problems]}
    try:
        return {"project": project_from(loaded, path, Path(), preview=question["preview"]).to_plain()}
    except StageError as error:
        return {"error": str(error)}


def _ask(path: Path, allow_roots: Iterable[str | Path], *, check: bool, preview: bool = False) -> tuple[Any, Guards]:
    roots = list(map(str, allow_roots))
    question = {"path": str(path), "check": check, "preview": preview, "allow_roots": roots}
    return ask("pipeline.app.sandbox:answer", question, readable_for(allowed_roots(path, roots)), BOUNDS)


def _problem(error: Ended, path: Path) -> dict[str, Any]:
    from pipeline.scene.trust.trial import unreadable

    hint = f"--untrusted allows {BOUNDS.memory_bytes // 2**30} GiB and {BOUNDS.cpu_s:g} s of computing"
    return _row(replace(unreadable(error, path), hint=f"{hint}; see docs/limits.md"))


def _row(problem: Any) -> dict[str, Any]:
    return {**problem.to_dict(), "text": str(problem)}


def _shown(text: str) -> str:
    """A text from the sandbox, made safe for a terminal: a stage may have taken over that process."""
    return "\n".join(map(printable, text.split("\n")))
