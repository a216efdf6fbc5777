"""`pipeline verify OUT`: derive a sample of a build's ground truth again, from the output folder alone.

The stage is OUT/dataset.usda, the rows are those of its tables; neither the store nor the original stage is read.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.camera.micro_images import micro_images
from pipeline.camera.tracer import Tracer
from pipeline.engine import manifest
from pipeline.engine.files import digest_of
from pipeline.errors import UsageError
from pipeline.files.tables import read_table
from pipeline.frames import apply
from pipeline.records import from_plain
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.scene.load import load, require_dataset
from pipeline.target.target import target_from_plain
from pipeline.tasks.certificate import certificate
from pipeline.tasks.poses import target_poses
from pipeline.tasks.things import Things
from pipeline.tasks.visibility_check import Scene, wrong_visibilities
from pipeline.truth.settings import TruthSettings
from pipeline.truth.solve import Rig

STAGE = "dataset.usda"
_SAME_MM = 1e-6
"""Points in a table against those of the stage: text keeps every digit, matrices are multiplied in another order."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a verification found.

    Attributes
    ----------
    problems : list of str
        Files that are lost or altered, and tables whose points are not where the stage has them, or not as visible.
    cameras : dict
        Camera name -> certificate of the new sample.
    """

    problems: list[str]
    cameras: dict[str, dict[str, Any]]

    @property
    def agrees(self) -> bool:
        """Whether nothing speaks against the build."""
        return not self.problems and all(found["passed"] is not False for found in self.cameras.values())

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as `verify --json` prints it."""
        return {"agrees": self.agrees, "problems": self.problems, "cameras": self.cameras}


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check files against the manifest, points against the stage, a sample of rows against fresh solutions and rays.

    Parameters
    ----------
    seed : int
        Which rows are drawn, and their random rays.

    Raises
    ------
    UsageError
        The folder holds no finished build.
    """
    out = Path(out)
    listed = manifest.read(out).files
    if STAGE not in listed:
        raise UsageError(f"{out} holds no finished build", hint="verify takes the folder that `pipeline build` filled")
    changed = [name for name, entry in listed.items() if not _is_whole(out / name, entry["sha256"])]
    problems = [f"{name} is lost or not as it was built" for name in changed]
    dataset = require_dataset(load(out / STAGE, ()), out / STAGE)
    cameras = {}
    for entry in dataset.cameras:
        scenes = _scenes(dataset, entry, out)
        tracer = Tracer(entry.camera, dataset.seed + seed)
        rig = Rig(tracer, micro_images(tracer) if tracer.camera.microlenses else None, entry.square_px)
        problems += _misplaced(entry, scenes)
        problems += [f"camera {entry.name}, {wrong}" for wrong in wrong_visibilities(rig, scenes, seed)]
        cameras[entry.name] = _judged(entry, rig, scenes, seed)
    return Verdict(problems, cameras)


def _is_whole(file: Path, digest: str) -> bool:
    try:
        return digest_of(file) == digest
    except OSError:
        return False


def _scenes(dataset: Dataset, entry: CameraEntry, out: Path) -> list[Scene]:
    """What the stage has in each frame, and the table that the build made of it."""
    things = Things(dataset, painted=False)
    return [
        (
            frame.number,
            things.targets(target_poses(dataset, frame, entry.name)),
            things.occluders(frame, entry.name),
            read_table(out / f"frames/{frame.number:04d}/{entry.name}/correspondences.csv"),
        )
        for frame in dataset.frames
    ]


def _judged(entry: CameraEntry, rig: Rig, scenes: list[Scene], seed: int) -> dict[str, Any]:
    claim_px = from_plain(TruthSettings, entry.truth).claim_px
    return certificate(rig, [(targets, table) for _, targets, _, table in scenes], claim_px, seed)


def _misplaced(entry: CameraEntry, scenes: list[Scene]) -> list[str]:
    """Tables whose target points are not where the stage puts them."""
    found = []
    for number, targets, _, table in scenes:
        names, point = np.array(table.columns["target"]), table.numbers("point_id").astype(int)
        stated = np.stack([table.numbers(f"camera_{axis}_mm") for axis in "xyz"], axis=1)
        for target in targets:
            points, here = target_from_plain(target["target"]).points().position_mm, names == target["name"]
            where = apply(np.array(target["vision_from_target"]), points)
            if not np.abs(where[point[here]] - stated[here]).max(initial=0.0) < _SAME_MM:
                found.append(
                    f"frame {number}, camera {entry.name}: points of {target['name']} are not where they stand"
                )
    return found
