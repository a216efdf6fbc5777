"""The command with toy tasks: a stage is a JSON file with the arguments of `toy.project`, and its problems.

python toy_command.py FOLDER_WITH_TOYKIT VERB ...
"""

import json
import sys
import time
import types
from dataclasses import dataclass
from pathlib import Path

if __name__ == "__main__":
    sys.path[:0] = [sys.argv.pop(1), str(Path(__file__).parents[1])]

from engine import toy

from pipeline.__main__ import main
from pipeline.engine.events import silent
from pipeline.engine.options import Caller
from pipeline.engine.planning import graph
from pipeline.engine.running import session
from pipeline.errors import UsageError

PACKAGES = ("toykit.tasks",)


@dataclass(frozen=True)
class Problem:
    severity: str
    text: str

    def __str__(self) -> str:
        return f"stage:1: {self.severity}: {self.text}"

    @property
    def is_error(self) -> bool:
        return self.severity == "error"

    def to_dict(self) -> dict[str, str]:
        return {"severity": self.severity, "message": self.text}


def load(path, allow_roots=(), *, look=False):
    if not path.exists():
        raise UsageError(f"{path} does not exist")
    facts = json.loads(path.read_text())
    problems = [Problem(*problem) for problem in facts.get("problems", [])]
    return types.SimpleNamespace(dataset=None, cameras=(), problems=problems, flattened="")


def project(path, out=None, allow_roots=(), preview=False):
    """A project, if the stage has no errors."""
    errors = [str(problem) for problem in load(path).problems if problem.is_error]
    if errors:
        raise UsageError("\n".join(errors))
    facts = json.loads(path.read_text())
    if facts.get("bug"):
        raise ZeroDivisionError("an unexpected thing")
    return toy.project(out or Path("build") / path.stem, **facts.get("project", {}))


def build_with(path, out, options, on_event=silent):
    caller = Caller(on_event=on_event, prepare=compiling if Path("compiling").exists() else None)
    return session.build(project(path, out, options.allow_roots), options, caller=caller)


def compiling():
    """Stands for Numba: a minute of short calls."""
    Path("ran-compiling").touch()
    for _ in range(600):
        time.sleep(0.1)


def fakes() -> dict[str, types.ModuleType]:
    """What the command imports of other rooms."""
    modules = {}
    rooms = {"app.build": (project, build_with), "scene.load": (load,)}
    for name, functions in {f"pipeline.{room}": functions for room, functions in rooms.items()}.items():
        modules[name] = types.ModuleType(name)
        for function in functions:
            setattr(modules[name], function.__name__, function)
    return modules


if __name__ == "__main__":
    sys.modules.update(fakes())
    graph.PACKAGES = PACKAGES
    sys.argv[0] = "pipeline"
    main()
