"""Try one hostile value: check the stage, build what the check accepts, and look for what must never be."""

import math
import re
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from hostile.pictures import lay_pictures
from hostile.scenes import SCENES
from hostile.values import Attempt

from pipeline.app.build import project_from
from pipeline.engine.options import ALONE
from pipeline.engine.running import session
from pipeline.engine.store.store import Store
from pipeline.errors import PipelineError
from pipeline.files.exr import read_exr
from pipeline.files.jsonfile import read_json
from pipeline.files.tables import read_table
from pipeline.limits import MOST_SAMPLES
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.load import Loaded, load

CHECK_S, BUILD_S = 10.0, 60.0
"""Processor time that the check of a stage may take, and a build of a small scene [s]."""
MOST_RAYS = 1e8
"""Stages that ask for more rays are not built: they may take long, and `check` says how long."""
_PYTHONS_OWN = re.compile(r"^[A-Za-z]+(Error|Exception|Interrupt|Warning)\b", re.MULTILINE)
"""The last line of a traceback that no error of ours ends: those carry the name of their module."""


def write(attempt: Attempt, folder: Path) -> Path:
    """The stage of an attempt, as a file."""
    path = folder / "dataset.usda"
    lay_pictures(folder)
    if attempt.type_name == "above":
        (folder / "whole.usda").write_text(
            SCENES[attempt.scene].stage().GetRootLayer().ExportToString(), encoding="utf-8"
        )
    path.write_bytes(attempt.text().encode("utf-8", "surrogatepass"))
    return path


def check(attempt: Attempt, folder: Path, wrong: list[str]) -> Loaded | None:
    """Ask `pipeline check` about the stage of an attempt: what it holds, or None if it has errors. Harm is added to
    `wrong`.
    """
    path, start = write(attempt, folder), time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            loaded = load(path, look=True)
    except Exception:  # any error is counted as wrong, and the other attempts go on
        wrong.append(f"{attempt}\n{traceback.format_exc(limit=-4)}")
        return None
    if time.process_time() - start > CHECK_S:
        wrong.append(f"{attempt}: the check took {time.process_time() - start:.1f} s")
    for problem in loaded.problems:
        shown = str(problem)
        if not (problem.file and problem.line) or not shown.replace("\n", "").isprintable() or len(shown) > 5000:
            wrong.append(f"{attempt}: {shown[:300]}")
    return None if loaded.errors else loaded


def _most_rays(camera: CameraEntry, frames: int) -> float:
    """Rays of all images of a camera, white ones included, and of its position images."""
    pixels = float(camera.asked.sensor.width_px) * camera.asked.sensor.height_px
    samples = float(camera.image_samples)
    if camera.image_noise is not None:
        samples = max(samples, min(MOST_SAMPLES, 0.25 / camera.image_noise**2))
    of_positions = camera.sampling.supersampling**2 * camera.sampling.samples if camera.truth.searches else 0
    return pixels * (samples * (1 + len(camera.f_numbers) + frames) + of_positions)


def build(attempt: Attempt, loaded: Loaded, folder: Path, wrong: list[str]) -> None:
    """Build what the check accepted, and read every file that comes out."""
    dataset = loaded.dataset
    if dataset is None or sum(_most_rays(camera, len(dataset.frames)) for camera in dataset.cameras) > MOST_RAYS:
        return
    out, start = folder / "out", time.process_time()
    try:
        project = project_from(loaded, write(attempt, folder), out)
        result = session.build(project, ALONE, store=Store(folder / "store"))
    except PipelineError:
        return
    except Exception:  # as above
        wrong.append(f"{attempt}\n{traceback.format_exc(limit=-6)}")
        return
    if time.process_time() - start > BUILD_S:
        wrong.append(f"{attempt}: the build took {time.process_time() - start:.1f} s")
    failed = [task for task in result.tasks if task.state == "failed"]
    wrong += [f"{attempt}: task {task.name}: {task.error}" for task in failed if _PYTHONS_OWN.search(str(task.error))]
    for file in sorted(path for path in out.rglob("*") if path.is_file()) if not failed else ():
        wrong += [f"{attempt}: {file.relative_to(out)}: {details}" for details in non_finite(file)]


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
