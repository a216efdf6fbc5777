"""`pipeline verify OUT`: derive a sample of the ground truth again, from the output folder alone.

Neither the store nor the original stage is read. The folder is not trusted: whatever is wrong in it is a finding.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.app.verifying.handed_in import STAGE, HandedIn, JudgedCamera, Scene, cameras_of
from pipeline.app.verifying.second_look import second_look
from pipeline.app.verifying.table_rules import Rows, UnfitTable, broken_rules, rows_of_scene, wrong_counts
from pipeline.app.verifying.visibility_check import wrong_visibilities
from pipeline.engine.output import manifest
from pipeline.errors import PipelineError, UsageError
from pipeline.tasks.certificate import certificate

_STREAM = 0x7E51
"""Random stream of the verification; a build never uses it."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Findings of a verification.

    Attributes
    ----------
    problems : list of str
        Missing, unexpected or altered files, tables that break a rule, and rows that were derived with other values.
    cameras : dict
        Camera name -> certificate of the new sample.
    looks : dict
        Camera name -> {points, of, rows}: target points whose rows were all derived again, in every column.
    unread : dict
        Files too large to be opened: name -> reason.
    """

    problems: list[str]
    cameras: dict[str, dict[str, Any]] = field(default_factory=dict)
    looks: dict[str, dict[str, int]] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether no check contradicts the build."""
        return not self.problems and all(found["passed"] is not False for found in self.cameras.values())

    def to_dict(self) -> dict[str, Any]:
        """The verdict as plain data, as `verify --json` prints it."""
        return {
            "agrees": self.agrees,
            "problems": self.problems,
            "cameras": self.cameras,
            "derived_again": self.looks,
            "unread": self.unread,
        }


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check the files against the manifest, every row against the stage, and samples of rows against new solutions.

    Files are read in a process with limits, in the format that their names promise. For every row of every table the
    check covers labels, target point, place in the scene, image and cell, ranges of numbers, rho against the blur,
    duplicates, and the counts in comments and manifest. For drawn points all rows are derived again in every column,
    see `second_look`. For drawn rows position and visibility are found with other rules and rays. Other files are not
    derived again.

    Parameters
    ----------
    seed : int
        Seed of the drawn rows and points and of the random rays of the verification.

    Raises
    ------
    UsageError
        The folder holds no finished build, or more than `limits` allow.
    """
    folder = HandedIn(Path(out), manifest.read(Path(out)))
    if STAGE not in folder.manifest.files:
        why = "its manifest.json is none of a build, or damaged" if folder.manifest.data else "it has no manifest.json"
        why = "it is a preview, without truth" if folder.manifest.files else why
        hint = "verify takes the folder that `pipeline build` filled"
        raise UsageError(f"{out} holds no finished build: {why}", hint=hint)
    folder.look()
    verdict = Verdict(folder.problems, unread=folder.unread)
    project = folder.project()
    if project is None:
        return verdict
    folder.require_small_tables(project)
    try:
        cameras = cameras_of(project)
    except PipelineError as error:
        verdict.problems.append(f"{STAGE}: {error}")
        return verdict
    for camera in cameras:
        try:
            _judge(folder, camera, seed, verdict)
        except PipelineError as error:
            verdict.problems.append(f"camera {camera.name}: {error}")
    return verdict


def _judge(folder: HandedIn, camera: JudgedCamera, seed: int, verdict: Verdict) -> None:
    """Add the findings about a camera to a verdict."""
    built, other = camera.rig(), camera.rig(_STREAM + seed)
    scenes: list[tuple[Scene, Rows]] = []
    for scene in folder.tables_of(camera):
        try:
            scenes.append((scene, rows_of_scene(camera, built, scene)))
        except UnfitTable as error:
            verdict.problems.append(error.what)
    for scene, rows in scenes:
        verdict.problems.extend(broken_rules(camera, built, scene, rows))
    verdict.problems.extend(wrong_counts(camera.name, folder.manifest.points, scenes))
    look = second_look(camera, built, scenes, seed)
    verdict.problems.extend(look.problems)
    verdict.looks[camera.name] = {"points": look.points, "of": look.of, "rows": look.rows}
    found = wrong_visibilities(other, [scene for scene, _ in scenes], seed)
    verdict.problems.extend(f"camera {camera.name}, {wrong}" for wrong in found)
    tables = [(scene.view.targets, scene.table) for scene, _ in scenes]
    verdict.cameras[camera.name] = certificate(other, tables, camera.settings.claim_px, seed)
