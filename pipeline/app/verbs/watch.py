"""`pipeline watch`: build again whenever a file changes that the stage was read from.

The build is a process of its own, so edited code counts too and nothing of an older reading stays in memory. A change
ends a build that is running: frames that are superseded are dropped, what was finished is in the store.
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
"""Time between two looks at the files [s]: a person hardly notices it, and a look is one `stat` per file."""
_QUIET_S = 0.3
"""Time without a change after which an edit is whole [s]: twice the time between looks."""

Looks = dict[Path, tuple[int, int] | None]


def watch(
    stage: Stage,
    out: Out = None,
    jobs: Jobs = None,
    allow_root: Roots = None,
) -> None:
    """Build, and build again on every edit of the stage, its layers or the code; Ctrl-C ends it."""
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
                    for path in _read_files(events) - looks.keys():  # layers that this build found
                        looks |= _looks({path})
                    time.sleep(_LOOK_S)
            finally:
                _end(process)
            files = set(looks)
            _wait_for_quiet(files)
            note(f"changed: {', '.join(map(_shown, changed[:3]))}{' …' if len(changed) > 3 else ''}")


def _start(arguments: list[str]) -> "subprocess.Popen[bytes]":
    # A group of its own: Ctrl-C is for us, and we say once what becomes of the build.
    return subprocess.Popen(command("pipeline.__main__:main", *arguments), process_group=0)


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End a build; it tidies up, unless that takes longer than a signal to us may take."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(GRACE_S / 2)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _near(stage: Path) -> set[Path]:
    """Files that are looked at as long as no build has said what it reads."""
    code = Path(__file__).parents[2]
    return {stage.resolve(), *stage.resolve().parent.glob("*.usd*"), *code.rglob("*.py")}


def _read_files(events: Path) -> set[Path]:
    """Files that the last build was read from; empty if it did not get that far."""
    try:
        with events.open(encoding="utf-8") as stream:
            first = json.loads(stream.readline())
        return {Path(path).resolve() for path in first["reads"]}
    except (OSError, ValueError, KeyError):
        return set()


def _looks(files: set[Path]) -> Looks:
    """Looks of files: a hint that they may have changed; content decides, in the build."""
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
    """A path as it was typed, as far as it lies below the working directory."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def _wait_for_quiet(files: set[Path]) -> None:
    """Editors write in several steps."""
    last, since = _looks(files), time.monotonic()
    while time.monotonic() - since < _QUIET_S:
        time.sleep(_LOOK_S / 3)
        now = _looks(files)
        if now != last:
            last, since = now, time.monotonic()
