"""`pipeline watch`: build again whenever a file of the stage changes.

The build runs in a process of its own, so edited code takes effect and nothing of an earlier reading stays in memory. A
change ends a running build. Its finished tasks are in the store; the others would be out of date.
"""

import json
import subprocess
import tempfile
import time
from pathlib import Path

from pipeline.app.verbs.terminal import Jobs, Out, Roots, Stage, note
from pipeline.engine.interrupts import GRACE_S, Interrupts
from pipeline.errors import Exit, Interrupted
from pipeline.machine.another_python import command

_LOOK_S = 0.15
"""Time between two looks at the files [s]: a delay that a person hardly notices; a look is one `stat` per file."""
_QUIET_S = 0.3
"""Time without a change after which an edit counts as complete [s]: twice the time between looks."""

Looks = dict[Path, tuple[int, int] | None]


def watch(
    stage: Stage,
    out: Out = None,
    jobs: Jobs = None,
    allow_root: Roots = None,
) -> None:
    """Build now, and again after every edit of the stage, its layers or the code. Ctrl-C ends it."""
    arguments = ["build", str(stage), *(["-o", str(out)] if out else []), *(["-j", str(jobs)] if jobs else [])]
    arguments += [f"--allow-root={root}" for root in allow_root or ()]
    with Interrupts() as interrupts:
        interrupts.stoppable(lambda: _build_on_every_edit(stage, arguments))
    raise Interrupted(interrupts.exit_code or Exit.INTERRUPTED)


def _build_on_every_edit(stage: Path, arguments: list[str]) -> None:
    files = _near(stage)
    with tempfile.TemporaryDirectory() as folder:
        events = Path(folder) / "events.jsonl"
        while True:
            looks = _looks(files)
            process = _start([*arguments, "--events", str(events)])
            try:
                while not (changed := _changed(looks)):
                    for path in _read_files(events) - looks.keys():  # layers that this build has read
                        looks |= _looks({path})
                    time.sleep(_LOOK_S)
            finally:
                _end(process)
            files = set(looks)
            _wait_for_quiet(files)
            note(f"changed: {', '.join(map(_shown, changed[:3]))}{' …' if len(changed) > 3 else ''}")


def _start(arguments: list[str]) -> "subprocess.Popen[bytes]":
    # A process group of its own: Ctrl-C reaches only this process, which ends the build and reports it once.
    return subprocess.Popen(command("pipeline.__main__:main", *arguments), process_group=0)


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End a build. It gets half of our own grace time to tidy up, then it is killed."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(GRACE_S / 2)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _near(stage: Path) -> set[Path]:
    """Files to look at until a build has reported the files that it reads."""
    code = Path(__file__).parents[2]
    return {stage.resolve(), *stage.resolve().parent.glob("*.usd*"), *code.rglob("*.py")}


def _read_files(events: Path) -> set[Path]:
    """Files that the last build has read; empty if it ended before it reported them."""
    try:
        with events.open(encoding="utf-8") as stream:
            first = json.loads(stream.readline())
        return {Path(path).resolve() for path in first["reads"]}
    except (OSError, ValueError, KeyError):
        return set()


def _looks(files: set[Path]) -> Looks:
    """Time and size of files: a difference means that a file may have changed; the build compares the content."""
    found: Looks = {}
    for path in sorted(files):
        try:
            facts = path.stat()
            found[path] = (facts.st_mtime_ns, facts.st_size)
        except OSError:
            found[path] = None
    return found


def _changed(before: Looks) -> list[Path]:
    now = _looks(set(before))
    return [path for path, look in before.items() if now[path] != look]


def _shown(path: Path) -> str:
    """A path relative to the working directory if it lies below it."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def _wait_for_quiet(files: set[Path]) -> None:
    """Wait until the files stop changing: editors write in several steps."""
    last, since = _looks(files), time.monotonic()
    while time.monotonic() - since < _QUIET_S:
        time.sleep(_LOOK_S / 3)
        now = _looks(files)
        if now != last:
            last, since = now, time.monotonic()
