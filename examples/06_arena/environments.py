"""The contestants, each with an interpreter of its own; one that does not install is missing, with the reason."""

import hashlib
import re
import shutil
import subprocess
import sys
import tomllib
import venv
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CONTESTANTS = Path(__file__).resolve().parent / "contestants"
LONGEST_S = 1500
"""Time limit of one program [s]."""
AT_ONCE = 2
"""Contestants that run at the same time: one per core of a small machine."""


class Failed(Exception):
    """A program that does not run here, or fails; its reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contestant:
    """A row of contestants.toml: `board` of detectors, `packages` or `system` as said there."""

    kind: str
    name: str
    script: str
    option: str = ""
    board: str = ""
    packages: tuple[str, ...] = ()
    system: dict[str, str] | None = None


def contestants() -> list[Contestant]:
    """All rows of contestants.toml."""
    table = tomllib.loads((CONTESTANTS / "contestants.toml").read_text(encoding="utf-8"))
    return [
        Contestant(kind=kind, **row | {"packages": tuple(row.get("packages", ()))})
        for kind, rows in table.items()
        for row in rows
    ]


def called(command: list[object], **options: Any) -> str:
    """What a program prints; Failed with the line of its complaint that says most."""
    words = [str(word) for word in command]
    try:
        ended = subprocess.run(words, capture_output=True, text=True, **{"timeout": LONGEST_S} | options)
    except (subprocess.TimeoutExpired, OSError) as error:
        raise Failed(str(error)[:300]) from error
    if ended.returncode:
        uncoloured = re.sub(r"\x1b\[[\d;]*m", "", ended.stderr or ended.stdout)
        lines = [line for line in uncoloured.splitlines() if line.strip()]
        first = [line for line in lines if line.startswith("error:")]  # Octave's comes before its stack, others' last
        raise Failed(f"ended with {ended.returncode}: {(first or lines[-1:] or ['no message'])[0][:300]}")
    return ended.stdout


def interpreter(contestant: Contestant, folder: Path) -> Path:
    """Python in which a contestant runs."""
    if contestant.system is None:
        return installed(contestant.packages, folder)
    python, needs = Path(contestant.system["python"] or sys.executable), contestant.system["needs"]
    try:
        called([python, "-c", "import numpy" if shutil.which(needs) else f"import numpy, {needs}"])
    except Failed as error:
        raise Failed(f"no {needs} on this machine: {contestant.system['how']}") from error
    return python


def installed(packages: tuple[str, ...], folder: Path, *options: str) -> Path:
    """Python of a virtual environment that has packages; who wants the same ones shares it."""
    digest = hashlib.sha256("\n".join((sys.version, *packages)).encode()).hexdigest()[:12]
    place = folder / f"{packages[0].partition('=')[0]}-{digest}"
    python, done = place / "bin/python", place / "installed"
    if not done.exists():
        shutil.rmtree(place, ignore_errors=True)
        # Links, because a copied interpreter may be busy while another thread starts a program.
        venv.create(place, with_pip=True, symlinks=True)
        install = [python, "-m", "pip", "install", "-q", "--no-input", "--disable-pip-version-check"]
        called([*install, *options, *packages])
        done.write_text("\n".join(packages) + "\n", encoding="utf-8")
    return python


def run_all(
    rows: list[Contestant], environments: Path, given: dict[str, Path], out: Path
) -> tuple[dict[str, float], dict[str, str]]:
    """Let contestants answer what lies in folders, two at a time, each into OUT/PLACE.

    Processor time [s] of who answered, by name, and why others did not. Environments are made one after the other.
    """
    took, missing, tasks = {}, {}, {}
    with ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
        for row in rows:
            try:
                python = interpreter(row, environments)
                tasks[row.name] = pool.submit(run, row, python, given[row.name], out / place_of(row))
            except Failed as error:
                missing[row.name] = str(error)
        for name, task in tasks.items():
            try:
                took[name] = task.result()
            except Failed as error:
                missing[name] = str(error)
    return took, missing


def place_of(contestant: Contestant) -> str:
    """Name of the folder of a contestant's answers."""
    return re.sub(r"\W+", "_", contestant.name)


def run(contestant: Contestant, python: Path, given: Path, out: Path) -> float:
    """Let a contestant answer all that lies in a folder; returns its processor time [s].

    Who has answered the same before, by the same script and packages, is not asked again.
    """
    asked = _digest(contestant, given)
    if not (out / "asked.log").exists() or (out / "asked.log").read_text(encoding="utf-8") != asked:
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        command = [python, CONTESTANTS / "exchange.py", CONTESTANTS / contestant.script, given, out, contestant.option]
        (out / "said.log").write_text(called(command), encoding="utf-8")
        (out / "asked.log").write_text(asked, encoding="utf-8")
    took = float((out / "cpu_s.log").read_text(encoding="utf-8"))
    print(f"  {contestant.name}: {took:.0f} s of processor time", flush=True)
    return took


def _digest(contestant: Contestant, given: Path) -> str:
    digest = hashlib.sha256(repr((contestant.packages, contestant.option)).encode())
    digest.update((CONTESTANTS / contestant.script).read_bytes())
    for path in sorted(path for path in given.rglob("*") if path.is_file()):
        digest.update(path.relative_to(given).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()
