"""One key, one sequence of bytes: builds whose BLAS, libm, NumPy and Numba choose other code for the processor."""

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from faults.workbench import STAGE, Row, Workbench, entries

from pipeline.engine.store.store import Store

PLENOPTIC = STAGE.parents[1] / "tiny_plenoptic/dataset.usda"

_COMMAND = "from pipeline.cli import main; main()"
# NumPy is loaded before our settings can reach it; builds run in workers, which get the settings at their start.
_PROGRAM = "import numpy; from pipeline.cli import main; main()"
# The same, and this process computes itself, as a worker of a cluster does: only what NumPy states can tell it apart.
_UNTOLD = """
import numpy
from pipeline.machine import facts
from pipeline.engine.running import driver
facts.pin = driver.pin = lambda: True
from pipeline.cli import main
main()
"""
_NO_FMA = "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"  # as glibc spells it since 2.33, and before


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """A program in an environment, and whether its keys must be those of the command in its own."""

    program: str
    environment: dict[str, str] = field(default_factory=dict)
    alike: bool = False


def other_numerics(bench: Workbench) -> Row:
    """All tasks of tiny builds: a key that is met again has the same bytes, other bytes have another key."""
    row = Row("R29", "other BLAS, libm, NumPy or Numba: equal bytes or other keys")
    stages = (STAGE, PLENOPTIC) if bench.whole else (STAGE,)
    right = _results(bench, Elsewhere(_COMMAND), stages) if bench.whole else _of(bench.folder / "right")
    known, equal, other = dict(right), 0, 0
    for place in _places() if bench.whole else _few():
        found = _results(bench, place, stages)
        row.tried += 1
        row.wrong += sum(known.setdefault(key, outputs) != outputs for key, outputs in found.items()) + (not found)
        row.wrong += place.alike and found.keys() != right.keys()
        equal += len(found.keys() & right.keys())
        other += len(found.keys() - right.keys())
    row.wrong += other == 0  # then the two machines were taken for one
    row.notes.append(f"{equal} tasks equal, {other} under other keys")
    return row


def _few() -> Iterator[Elsewhere]:
    yield Elsewhere(_COMMAND, {"OPENBLAS_CORETYPE": "SkylakeX", "NUMBA_CPU_NAME": "generic"}, alike=True)
    yield Elsewhere(_UNTOLD, {"OPENBLAS_CORETYPE": "Nehalem"})


def _places() -> Iterator[Elsewhere]:
    for kernels in ("Haswell", "Zen", "SkylakeX", "Sandybridge", "Nehalem", "Prescott"):
        yield Elsewhere(_COMMAND, {"OPENBLAS_CORETYPE": kernels}, alike=True)
    for kernels in ("Haswell", "Sandybridge", "Nehalem", "Prescott"):  # those that every processor of level v3 can run
        yield Elsewhere(_UNTOLD, {"OPENBLAS_CORETYPE": kernels})
    yield Elsewhere(_PROGRAM, {"OPENBLAS_CORETYPE": "Nehalem"}, alike=True)
    for processor in ("generic", "skylake-avx512", "znver3"):
        yield Elsewhere(_COMMAND, {"NUMBA_CPU_NAME": processor}, alike=True)
    yield Elsewhere(_COMMAND, {"GLIBC_TUNABLES": _NO_FMA})
    for features in _numpys():
        yield Elsewhere(_COMMAND, {"NPY_DISABLE_CPU_FEATURES": features}, alike=True)


def _numpys() -> list[str]:
    """What the installed NumPy can be forbidden, one after the other."""
    code = "import numpy._core._multiarray_umath as loops; print(*loops.__cpu_dispatch__)"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()


def _results(bench: Workbench, where: Elsewhere, stages: tuple[Path, ...]) -> dict[str, dict[str, str]]:
    """Digests of the outputs of every key; empty if a build failed."""
    place = bench.new_place()
    for stage in stages:
        settings = {**os.environ, "PIPELINE_REPORT": "no", "PIPELINE_CACHE": str(place / "store"), **where.environment}
        out = place / stage.parent.name
        command = [sys.executable, "-c", where.program, "build", str(stage), "-j1", "-o", str(out)]
        done = subprocess.run(command, env=settings, capture_output=True, text=True, check=False)
        if done.returncode:
            print(done.stderr, file=sys.stderr)
            return {}
    return _of(place)


def _of(place: Path) -> dict[str, dict[str, str]]:
    store = Store(place / "store")
    keys = [path.stem for path in entries(place) if (place / "store" / "ac") in path.parents]
    records = {key: store.record(key) for key in keys}
    return {
        key: {name: entry.sha256 for name, entry in record.outputs.items()}
        for key, record in records.items()
        if record is not None
    }
