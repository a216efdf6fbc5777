"""R32: odd places, streams and limits. Each is an error in words with its exit code, or works; never a traceback."""

import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from faults.workbench import STAGE, Row, Workbench

_NOBODY = 54323
_MAIN = "import sys; sys.argv = sys.argv[1:]; from pipeline.__main__ import main; main()"


@dataclass(frozen=True, kw_only=True)
class Case:
    """A command in odd surroundings.

    Attributes
    ----------
    code : int
        Exit code that it must have.
    word : str
        Part of what it must say on stderr, if that can be read.
    shell : str
        Appended to the command, for streams.
    """

    code: int
    word: str = ""
    verb: tuple[str, ...] = ("plan", str(STAGE))
    settings: dict[str, str | None] = field(default_factory=dict)
    shell: str = ""
    limit: tuple[int, int] | None = None


def _cases(place: Path) -> Iterator[Case]:
    odd, stage = os.fsdecode(b"b\xff"), str(STAGE)
    deep = str(place / "/".join(["y" * 200] * 21))
    for out, word in ((f"{place}/{odd}", "not UTF-8"), ("x" * 300, "255 bytes"), (deep, "4096 bytes")):
        for verb in ("plan", "status", "build"):
            yield Case(code=2, word=word, verb=(verb, stage, "-o", out))
    for verb in ("plan", "status", "build"):
        yield Case(code=2, word="files that the stage is made of", verb=(verb, stage, "-o", str(STAGE.parent)))
    for name, word in ((f"{odd}.usda", "not UTF-8"), ("x" * 300 + ".usda", "255 bytes")):
        for verb in ("check", "build", "show"):
            yield Case(code=2, word=word, verb=(verb, name))
    whole = place / "...usda"
    whole.write_text(STAGE.read_text().replace("@../../../stages/", "@"))
    yield Case(code=2, word="name one with -o", verb=("build", str(whole)))
    yield Case(code=5, word="not UTF-8", settings={"PIPELINE_CACHE": f"{place}/{odd}"})
    yield Case(code=5, word="cannot make the store", settings={"PIPELINE_CACHE": "/proc/store"})
    full = Case(code=5, word="cannot write to standard output")
    for verb in (("plan", stage), ("plan", stage, "--json"), ("--version",), ("check", stage, "--json")):
        yield Case(code=full.code, word=full.word, verb=verb, shell=">/dev/full")
        for shell in (">&-", "2>&-", "<&-", "2>/dev/full", "<&- >&- 2>&-"):
            yield Case(code=0, verb=verb, shell=shell)
    yield Case(code=5, word="cannot write events to", verb=("build", stage, "--events", "/dev/full"))
    yield Case(code=5, word="needs 64", limit=(resource.RLIMIT_NOFILE, 12))
    yield Case(code=5, word="address space", limit=(resource.RLIMIT_AS, 1_000_000_000))


def odd_surroundings(bench: Workbench) -> Row:
    row = Row("R32", "odd places, closed and full streams, low limits, no home")
    place = bench.new_place()
    cases = list(_cases(place))
    for number in range(1, len(cases) + 1) if bench.whole else ():
        case = cases[number - 1]
        done = _done(case, place)
        row.tried += 1
        row.failed += done.returncode != 0
        right = done.returncode == case.code and case.word in done.stderr and "Traceback" not in done.stderr
        row.wrong += not right
        row.notes += [] if right else [f"{case.verb} {case.shell} {done.returncode} {done.stderr[-300:]!r}"]
    for error, meanwhile in _homeless(bench, place) if os.geteuid() == 0 else ():
        row.tried += 1
        said = place / "said.txt"
        said.touch()
        said.chmod(0o666)
        row.failed += bench.build_in_fork(place, meanwhile=meanwhile, out="out3", said=said) == 5
        row.wrong += error not in said.read_text()
        row.notes += bench.unexpected()
    shutil.rmtree(place)
    return row


def _homeless(bench: Workbench, place: Path) -> Iterator[tuple[str, Callable[[], None]]]:
    """Nobody: without a home and an entry in passwd, before a store that can only be read."""
    bench.folder.chmod(0o755)
    place.chmod(0o755)
    (place / "store").mkdir()

    def become() -> None:
        for name in ("HOME", "XDG_CACHE_HOME"):
            os.environ.pop(name, None)
        os.setgroups([])
        os.setgid(_NOBODY)
        os.setuid(_NOBODY)

    yield f"user {_NOBODY} has no home", become


def _done(case: Case, place: Path) -> "subprocess.CompletedProcess[str]":
    settings = {**os.environ, "PIPELINE_REPORT": "no", "PIPELINE_CACHE": str(place / "cache"), **case.settings}
    command = [sys.executable, "-c", _MAIN, "pipeline", *case.verb]
    limit = case.limit

    def prepare() -> None:
        if limit is not None:
            resource.setrlimit(limit[0], (limit[1], limit[1]))

    script = ["sh", "-c", f'"$@" {case.shell}', "sh", *command] if case.shell else command
    options = {"capture_output": True, "text": True, "errors": "replace", "check": False}
    return subprocess.run(script, cwd=place, env=settings, preexec_fn=prepare, **options)
