"""`pipeline verify OUT`: files, contract of the tables, and the certificate with another seed, from the folder alone.

Neither the store nor the original stage is read. It finds accidents and mistakes: whoever forges a folder can forge its
digests, too.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.app.build import project
from pipeline.app.verifying.folder_files import wrong_files
from pipeline.app.verifying.judged_camera import JudgedCamera, Scene, judged_camera, wrong_list
from pipeline.app.verifying.table_contract import broken_contract
from pipeline.app.verifying.visibility_check import wrong_visibilities
from pipeline.camera.rig import Rig
from pipeline.engine.output import manifest
from pipeline.errors import PipelineError, UsageError
from pipeline.files.damaged import DamagedFile
from pipeline.files.tables import Table, read_table
from pipeline.tasks.certificate import certificate, points_seen

STAGE = "dataset.usda"
_STREAM = 0x7E51
"""Random stream of the verification; a build never uses it."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Findings of a verification.

    Attributes
    ----------
    problems : list of str
        Missing, unexpected or altered files, broken contracts, and rows with another visibility.
    cameras : dict
        Camera name -> certificate of the new sample.
    """

    problems: list[str]
    cameras: dict[str, dict[str, Any]] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether no check contradicts the build."""
        return not self.problems and all(found["passed"] is not False for found in self.cameras.values())

    def to_dict(self) -> dict[str, Any]:
        """The verdict as plain data, as `verify --json` prints it."""
        return {"agrees": self.agrees, "problems": self.problems, "cameras": self.cameras}


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check the files of a folder against its manifest, its tables against its stage, and a sample of their rows.

    For the rows drawn with the seed, the certificate of the build is made again with other random rays.

    Parameters
    ----------
    seed : int
        Seed of the drawn rows and of the random rays of the verification.

    Raises
    ------
    UsageError
        The folder holds no finished build.
    """
    out = Path(out)
    listed = manifest.read(out)
    if STAGE not in listed.files:
        why = "its manifest.json is none of a build, or damaged" if listed.data else "it has no manifest.json"
        why = "it is a preview, without truth" if listed.files else why
        raise UsageError(f"{out} holds no finished build: {why}", hint="verify takes the folder of `pipeline build`")
    verdict = Verdict(list(wrong_files(out, listed)))
    try:
        build = project(out / STAGE, out)
    except UsageError as error:
        verdict.problems.append(f"{STAGE} is no stage that could have been built: {error}")
        return verdict
    verdict.problems.extend(wrong_list(build, listed))
    points = listed.points if isinstance(listed.points, dict) else {}
    for name in build.findings["certificate"]:
        try:
            _judge(out, name, judged_camera(build, name), points.get(name), seed, verdict)
        except PipelineError as error:
            verdict.problems.append(f"camera {name}: {error}")
    return verdict


def _judge(out: Path, name: str, camera: JudgedCamera, points: Any, seed: int, verdict: Verdict) -> None:
    """Add the findings about a camera to a verdict; `points` is what the manifest counts."""
    rig = camera.rig(_STREAM + seed)
    tables = list(_tables(out, camera, rig, verdict.problems))
    judged = [(scene.view.targets, table) for scene, table in tables]
    if len(tables) == len(camera.scenes) and points_seen([scene.truth.frame for scene, _ in tables], judged) != points:
        verdict.problems.append(f"camera {name}: the manifest counts other rows or points than its tables have")
    verdict.problems.extend(f"camera {name}, {wrong}" for wrong in wrong_visibilities(rig, tables, seed))
    verdict.cameras[name] = certificate(rig, judged, camera.truth.settings.claim_px, seed)


def _tables(out: Path, camera: JudgedCamera, rig: Rig, problems: list[str]) -> Iterator[tuple[Scene, Table]]:
    """The tables of a camera that keep their contract; of all others the problems are added."""
    for scene in camera.scenes:
        try:
            table = read_table(out / scene.file)
        except (DamagedFile, OSError):
            continue  # `wrong_files` says so
        broken = list(broken_contract(camera, rig, scene, table))
        problems.extend(f"{scene.file}: {problem}" for problem in broken)
        if not broken:
            yield scene, table
