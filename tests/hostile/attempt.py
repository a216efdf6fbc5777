"""Try one hostile value: check the stage, build what the check accepts, and look for what must never be."""

import math
import re
import resource
import time
import traceback
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from hostile.pictures import lay_pictures
from hostile.values import Attempt

from pipeline.app.build import project_from
from pipeline.engine.options import ALONE
from pipeline.engine.running import session
from pipeline.engine.store.store import Store
from pipeline.errors import PipelineError
from pipeline.files.exr import read_exr
from pipeline.files.jsonfile import read_json
from pipeline.files.tables import read_table
from pipeline.scene.check.budgets import rays_of
from pipeline.scene.load import Loaded, load

CHECK_S = 10.0
CHECK_BYTES = 2**30
BUILD_S = 60.0
SLOW_RAYS_PER_S = 2e6
"""A stage may ask for many rays, within the limit: 16,777,216 of each pixel were traced at 8e6 rays/s."""
_PYTHONS_OWN = re.compile(r"^[A-Za-z]+(Error|Exception|Interrupt|Warning)\b", re.MULTILINE)
"""The last line of a traceback that no error of ours ends: those carry the name of their module."""


@dataclass
class Tally:
    """What became of all that was tried."""

    tried: int = 0
    refused: int = 0
    accepted: int = 0
    built: int = 0
    failed_clearly: int = 0
    wrong: dict[str, list[str]] = field(default_factory=dict)
    slowest: tuple[float, str] = (0.0, "")
    ends: set[str] = field(default_factory=set)

    def blame(self, what: str, attempt: Attempt | str, details: str) -> None:
        """Something that must not be."""
        self.wrong.setdefault(what, []).append(f"{attempt}\n{details}")

    def __str__(self) -> str:
        kinds = ("traceback", "hang", "memory", "place", "warning", "non-finite")
        bad = ", ".join(f"{len(self.wrong.get(kind, []))} {kind}" for kind in kinds)
        ends = "".join(f"\n    {text}" for text in sorted(self.ends))
        became = f"{self.built} built, {self.failed_clearly} failed"
        values = f"{self.tried} hostile values: {self.refused} refused, {self.accepted} accepted; of these {became}"
        return f"{values}\n    slowest check {self.slowest[0]:.1f} s: {self.slowest[1]}\n    wrong: {bad}{ends}"


def write(attempt: Attempt, folder: Path) -> Path:
    """The stage of an attempt, as a file."""
    path = folder / "dataset.usda"
    lay_pictures(folder)
    path.write_bytes(attempt.text().encode("utf-8", "surrogatepass"))
    return path


def check(attempt: Attempt, folder: Path, tally: Tally) -> Loaded | None:
    """Ask `pipeline check` about the stage of an attempt: what it holds, or None if it has errors."""
    path = write(attempt, folder)
    before_s, before_bytes = time.process_time(), _peak_bytes()
    tally.tried += 1
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            loaded = load(path, look=True)
        texts = [str(one) for one in loaded.problems]
    except Exception:  # any error is counted as wrong, and the other attempts go on
        tally.blame("traceback", attempt, traceback.format_exc(limit=-4))
        return None
    for warning in said:
        tally.blame("warning", attempt, str(warning))
    seconds = time.process_time() - before_s
    tally.slowest = max(tally.slowest, (seconds, str(attempt)))
    if seconds > CHECK_S:
        tally.blame("hang", attempt, f"{seconds:.1f} s")
    if _peak_bytes() - before_bytes > CHECK_BYTES:
        tally.blame("memory", attempt, f"{(_peak_bytes() - before_bytes) / 2**30:.1f} GiB")
    for one, shown in zip(loaded.problems, texts, strict=True):
        if not (one.file and one.line) or not shown.replace("\n", "").isprintable() or len(shown) > 5000:
            tally.blame("place", attempt, shown[:300])
    tally.refused += bool(loaded.errors)
    tally.accepted += not loaded.errors
    return None if loaded.errors else loaded


def build_s(loaded: Loaded) -> float:
    """Computing time that a build may take: that of any small scene, and of the rays that this one asks for."""
    if loaded.dataset is None:
        return BUILD_S
    rays = [sum(rays_of(camera, len(loaded.dataset.frames))) for camera in loaded.dataset.cameras]
    return BUILD_S + sum(rays) / SLOW_RAYS_PER_S


def build(attempt: Attempt, loaded: Loaded, folder: Path, tally: Tally) -> None:
    """Build what the check accepted, and read every file that comes out."""
    if loaded.dataset is None:
        return
    out, start = folder / "out", time.process_time()
    try:
        project = project_from(loaded, write(attempt, folder), out)
        result = session.build(project, ALONE, store=Store(folder / "store"))
    except PipelineError as error:
        tally.failed_clearly += 1
        tally.ends.add(str(error).split("\n")[0][:100])
        return
    except Exception:  # as above
        tally.blame("traceback", attempt, traceback.format_exc(limit=-6))
        return
    if time.process_time() - start > build_s(loaded):
        tally.blame("hang", attempt, f"build {time.process_time() - start:.1f} s")
    failed = [task for task in result.tasks if task.state == "failed"]
    for task in failed:
        if _PYTHONS_OWN.search(str(task.error)):
            tally.blame("traceback", attempt, f"task {task.name}: {task.error}")
        else:
            tally.ends.add(next(line for line in reversed(str(task.error).split("\n")) if "hint:" not in line)[:100])
    tally.failed_clearly += bool(failed)
    if not failed:
        tally.built += 1
        for file in sorted(path for path in out.rglob("*") if path.is_file()):
            for details in non_finite(file):
                tally.blame("non-finite", attempt, f"{file.relative_to(out)}: {details}")


def non_finite(file: Path) -> list[str]:
    """What in a file of the output folder is infinite or no number although its description names no such thing."""
    if file.parent.name == "pictures":
        return []  # as the stage has them
    if file.suffix == ".exr":
        return [
            f"{part.name}.{name} {bad}" for part in read_exr(file).values() for name, bad in _bad_channels(file, part)
        ]
    if file.suffix == ".csv":
        columns = read_table(file).columns
        return [name for name, cells in columns.items() if {"inf", "-inf", "nan"} & {cell.lower() for cell in cells}]
    if file.suffix == ".json" and file.name != "camera.json":
        return [where for where in _infinities(read_json(file), "$") if "depth" not in where]
    return []


def _bad_channels(file: Path, part: Any) -> list[tuple[str, str]]:
    found = []
    for name, pixels in part.channels.items():
        dark = file.name in ("rays.exr", "positions.exr") or "microlens" in name or part.name not in ("image", "rgba")
        if np.isinf(pixels).any():
            found.append((name, "is infinite somewhere"))
        if np.isnan(pixels).any() and not dark:
            found.append((name, "is NaN somewhere"))
    return found


def _infinities(value: Any, where: str) -> list[str]:
    if isinstance(value, dict):
        return [one for key, item in value.items() for one in _infinities(item, f"{where}.{key}")]
    if isinstance(value, list):
        return [one for item in value for one in _infinities(item, where)]
    bad = value in ("inf", "-inf", "nan") or (isinstance(value, float) and not math.isfinite(value))
    return [where] if bad else []


def _peak_bytes() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
