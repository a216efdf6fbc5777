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

CONTESTANTS = Path(__file__).resolve().parent / "contestants"
_LONGEST_S = 1500
"""Time limit of one contestant [s]."""
AT_ONCE = 2
"""Contestants that run at the same time: one per core of a small machine."""


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


@dataclass(frozen=True, slots=True)
class Missing:
    """A contestant that cannot run here."""

    name: str
    reason: str


def contestants(path: Path = CONTESTANTS / "contestants.toml") -> list[Contestant]:
    """All rows of a table of contestants."""
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    rows = [(kind, row) for kind in ("detector", "calibrator") for row in table.get(kind, ())]
    return [Contestant(kind=kind, **row | {"packages": tuple(row.get("packages", ()))}) for kind, row in rows]


def interpreter(contestant: Contestant, folder: Path) -> Path | Missing:
    """Python in which a contestant runs; contestants with the same packages share a virtual environment."""
    if contestant.system:
        return _of_system(contestant)
    digest = hashlib.sha256("\n".join((sys.version, *contestant.packages)).encode()).hexdigest()[:12]
    place = folder / f"{contestant.packages[0].partition('=')[0]}-{digest}"
    python, done = place / "bin/python", place / "installed"
    if not done.exists():
        shutil.rmtree(place, ignore_errors=True)
        venv.create(place, with_pip=True)
        command = [python, "-m", "pip", "install", "-q", "--no-input", "--disable-pip-version-check"]
        ended = subprocess.run([*command, *contestant.packages], capture_output=True, text=True)
        if ended.returncode:
            said = [line for line in ended.stderr.splitlines() if line.startswith("ERROR")] or ["pip failed"]
            return Missing(contestant.name, f"{' '.join(contestant.packages)} does not install: {said[-1]}")
        done.write_text("\n".join(contestant.packages) + "\n", encoding="utf-8")
    return python


def _of_system(contestant: Contestant) -> Path | Missing:
    assert contestant.system is not None
    python, needs = Path(contestant.system["python"]), contestant.system["needs"]
    try:
        imports = "import numpy" if shutil.which(needs) else f"import numpy, {needs}"
        ended = subprocess.run([python, "-c", imports], capture_output=True, text=True)
        lacks = bool(ended.returncode)
    except OSError:
        lacks = True
    return Missing(contestant.name, f"no {needs} on this machine: {contestant.system['how']}") if lacks else python


def run_all(
    rows: list[Contestant], environments: Path, given: dict[str, Path], out: Path
) -> dict[str, float | Missing]:
    """Let contestants answer what lies in folders, two at a time, each into OUT/PLACE; processor time [s] by name."""
    pythons = {row.name: interpreter(row, environments) for row in rows}
    with ThreadPoolExecutor(max_workers=AT_ONCE) as pool:
        tasks = {
            row.name: pool.submit(run, row, python, given[row.name], out / place_of(row))
            for row in rows
            if isinstance(python := pythons[row.name], Path)
        }
        return {name: tasks[name].result() if name in tasks else missing for name, missing in pythons.items()}


def place_of(contestant: Contestant) -> str:
    """Name of the folder of a contestant's answers."""
    return re.sub(r"\W+", "_", contestant.name)


def run(contestant: Contestant, python: Path, given: Path, out: Path) -> float | Missing:
    """Let a contestant answer all that lies in a folder; returns its processor time [s].

    Who has answered the same before, by the same script and packages, is not asked again.
    """
    asked = _digest(contestant, given)
    if (out / "asked.log").exists() and (out / "asked.log").read_text(encoding="utf-8") == asked:
        return float((out / "cpu_s.log").read_text(encoding="utf-8"))
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command = [python, CONTESTANTS / "exchange.py", CONTESTANTS / contestant.script, given, out]
    try:
        ended = subprocess.run(
            [*command, "--option", contestant.option], capture_output=True, text=True, timeout=_LONGEST_S
        )
    except subprocess.TimeoutExpired:
        return Missing(contestant.name, f"did not end within {_LONGEST_S} s")
    (out / "said.log").write_text(ended.stdout + ended.stderr, encoding="utf-8")
    if ended.returncode:
        last = (ended.stderr.strip().splitlines() or ["no message"])[-1]
        return Missing(contestant.name, f"ended with {ended.returncode}: {last}")
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


def run_script(python: Path, script: Path, *arguments: Path) -> str:
    """Run a script; the last line of its complaint if it fails, else nothing."""
    ended = subprocess.run([python, script, *arguments], capture_output=True, text=True)
    return (ended.stderr.strip().splitlines() or ["no message"])[-1] if ended.returncode else ""
