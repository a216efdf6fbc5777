"""Row R34: output folders that somebody doctored, and what `verify` makes of them."""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from faults.doctored import ENTRIES, LIES, MANIFESTS, ODDITIES, STAGES, damaged_files, odd_files, signed
from faults.workbench import STAGE, Row, Workbench

from pipeline.app.sandbox import project_of_untrusted
from pipeline.app.verifying.verify import verify
from pipeline.engine.options import ALONE
from pipeline.engine.running.session import build
from pipeline.engine.store.store import Store
from pipeline.errors import PipelineError

_LONGEST_S = 300
"""A verification that takes longer hangs; one takes some seconds."""
_SHORT = (
    ("sigma_x_px", "rows dropped", "correspondences.csv: FIFO", "image.exr: one bit, signed", "half a character"),
    (".exr: cut, signed", "export.json: FIFO"),
)
"""Some of the cases of each folder, for the tests: each ends the name of one."""

Case = tuple[str, Callable[[Path, random.Random], object]]


class Hung(BaseException):
    """A verification took too long."""


def doctored_folders(bench: Workbench) -> Row:
    """Every lie, odd file and broken manifest is a finding: none agrees, ends in a traceback, or hangs."""
    row = Row("R34", "doctored output folders, and odd things in them: what verify says")
    folders = [bench.folder / "right/out", _with_pictures(bench), *([_plenoptic(bench)] if bench.whole else [])]
    ends: Counter[str] = Counter(agreed=0, tracebacks=0, hung=0)
    for number, right in enumerate(folders):
        row.wrong += _end(right) != "agreed"
        cases = list(_of_others(right) if number == 1 else _cases(right, has_microlenses=number > 1))
        few = () if bench.whole else _SHORT[number]
        for what, doctor in [next(one for one in cases if one[0].endswith(end)) for end in few] or cases:
            end = _doctored(bench, right, doctor)
            ends[end] += 1
            row.tried += 1
            row.notes += [] if end in ("found", "refused") else [f"{what}: {end}"]
    row.failed = ends["found"] + ends["refused"]
    row.wrong += ends["agreed"]
    row.bad += ends["tracebacks"] + ends["hung"]
    row.notes.append(", ".join(f"{count} {end}" for end, count in sorted(ends.items())))
    return row


def _cases(right: Path, *, has_microlenses: bool) -> Iterator[Case]:
    """Name of what is wrong, and how it is put there; all but the lies once, for the folder without microlenses."""
    yield from ((what, lie) for what, lie in LIES.items() if has_microlenses or not what.startswith("microlens"))
    if has_microlenses:
        return
    for name, what in odd_files(right):
        yield f"{name}: {what}", lambda out, chance, name=name, what=what: ODDITIES[what](out / name)
    for name, what, doctor in damaged_files(right):
        yield f"{name}: {what}, signed", doctor
    for what, stage in STAGES.items():
        yield f"a stage of {what}", signed("dataset.usda", lambda data, stage=stage: stage)
    for what, data in MANIFESTS.items():
        yield f"a manifest: {what}", lambda out, chance, data=data: _manifest(out).write_bytes(data)
    for what, change in ENTRIES.items():
        yield f"an entry: {what}", lambda out, chance, change=change: _change(_manifest(out), change)


def _of_others(right: Path) -> Iterator[Case]:
    """The same of files that are not ours: exports with every oddity, and pictures with digests that fit, too."""
    for name, what in odd_files(right):
        if name.startswith(("exports/", "pictures/")):
            yield f"{name}: {what}", lambda out, chance, name=name, what=what: ODDITIES[what](out / name)
    for name, what, doctor in damaged_files(right):
        if name.startswith("pictures/"):
            yield f"{name}: {what}, signed", doctor


def _doctored(bench: Workbench, right: Path, doctor: Callable[[Path, random.Random], object]) -> str:
    out = bench.new_place() / "out"
    shutil.copytree(right, out, symlinks=True)
    for path in out.rglob("*"):
        path.chmod(0o755 if path.is_dir() else 0o644)
    doctor(out, bench.chance)
    end = _end(out)
    shutil.rmtree(out.parent)
    return end


def _end(out: Path) -> str:
    """What became of a verification."""

    def give_up(*_: object) -> None:
        raise Hung

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(_LONGEST_S)
    try:
        with contextlib.redirect_stdout(None):
            return "agreed" if verify(out).agrees else "found"
    except PipelineError:
        return "refused"
    except Hung:
        return "hung"
    except Exception:  # the command would say: this is a bug of ours
        return "tracebacks"
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _manifest(out: Path) -> Path:
    return out / "manifest.json"


def _change(path: Path, change: Callable[[dict], object]) -> None:
    parsed = json.loads(path.read_text(encoding="utf-8"))
    change(parsed)
    path.write_text(json.dumps(parsed), encoding="utf-8")


def _with_pictures(bench: Workbench) -> Path:
    """A finished build below a sky that is an OpenEXR file, with exports; USD writes its stage in another process."""
    place = bench.new_place()
    code = (
        "import sys; from pathlib import Path; from hostile.attempt import write; from hostile.values import Attempt\n"
    )
    code += "formats = Attempt('sky', '', 'plen:exports', 'token[]', ['npz', 'opencv'])\n"
    code += "sky = Attempt('sky', 'Lamp', 'inputs:texture:file', 'asset', './grey.exr', formats)\n"
    code += "write(sky, Path(sys.argv[1]))"
    paths = os.pathsep.join(filter(None, sys.path))
    subprocess.run([sys.executable, "-c", code, str(place)], check=True, env={**os.environ, "PYTHONPATH": paths})
    return _built(place / "dataset.usda", place)


def _plenoptic(bench: Workbench) -> Path:
    """A finished build of the camera with microlenses."""
    return _built(STAGE.parents[1] / "tiny_plenoptic/dataset.usda", bench.new_place())


def _built(stage: Path, place: Path) -> Path:
    project = project_of_untrusted(stage, place / "out", ())
    build(project, ALONE, store=Store(place / "store"))
    return place / "out"
