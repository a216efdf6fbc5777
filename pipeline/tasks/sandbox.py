"""Reading a stage that nobody vouches for: in a process of its own, with little time, memory and nothing to write.

Only JSON comes back. The checks of the asset roots run before USD opens a file, see `scene.prescan`.
"""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pipeline.engine.project import Project, project_from_plain
from pipeline.errors import UsageError
from pipeline.processor import settings

MEMORY_BYTES = 4 * 2**30
CPU_S = 120
WALL_S = 300
ANSWER_BYTES = 512 * 2**20

_BOOT = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from pipeline.tasks.sandbox import main; main()"


def project_of_untrusted(path: Path, out: Path | None, allow_roots: Iterable[str | Path]) -> Project:
    """The project of a stage, read in the sandbox.

    Raises
    ------
    UsageError
        The stage does not pass `check`, or reading it took more than is allowed.
    """
    answer = _ask({"path": str(path), "out": str(out) if out else None, "allow_roots": _texts(allow_roots)})
    if "error" in answer:
        raise UsageError(answer["error"])
    return project_from_plain(answer["project"])


def problems_of_untrusted(path: Path, allow_roots: Iterable[str | Path]) -> list[dict[str, Any]]:
    """What `check` finds, read in the sandbox: fields of `Problem`, and its `text`."""
    problems: list[dict[str, Any]] = _ask({"path": str(path), "check": True, "allow_roots": _texts(allow_roots)})[
        "problems"
    ]
    return problems


def main() -> None:
    """The process in the sandbox: one question as the second argument, one answer on stdout."""
    question = json.loads(sys.argv[2])
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever prints must not end up in the answer
    for limit, value in (
        (resource.RLIMIT_AS, MEMORY_BYTES),
        (resource.RLIMIT_CPU, CPU_S),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(limit, (value, value))
    json.dump(_answer(question), answers)
    answers.close()


def _answer(question: dict[str, Any]) -> dict[str, Any]:
    from pipeline.scene.load import load
    from pipeline.scene.problems import StageError
    from pipeline.tasks.build import project_from

    path, out = Path(question["path"]), question["out"] if question.get("out") else None
    loaded = load(path, question["allow_roots"], look=bool(question.get("check")))
    if question.get("check"):
        return {"problems": [{**problem.to_dict(), "text": str(problem)} for problem in loaded.problems]}
    try:
        return {"project": project_from(loaded, path, out).to_plain()}
    except StageError as error:
        return {"error": str(error)}


def _ask(question: dict[str, Any]) -> dict[str, Any]:
    try:
        done = subprocess.run(
            [sys.executable, "-c", _BOOT, json.dumps(sys.path), json.dumps(question)],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=WALL_S,
            env={**os.environ, **settings()},
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise UsageError(f"{question['path']}: reading it took longer than {WALL_S} s", hint=_HINT) from None
    if done.returncode != 0 or len(done.stdout) > ANSWER_BYTES:
        last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        raise UsageError(f"{question['path']}: reading it ended with: {last[0]}", hint=_HINT)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


_HINT = f"--untrusted allows {MEMORY_BYTES // 2**30} GiB and {CPU_S} s of computing; see docs/limits.md"


def _texts(paths: Iterable[str | Path]) -> list[str]:
    return [str(path) for path in paths]
