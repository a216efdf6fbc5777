"""`pipeline verify OUT`: derive a sample of a build's ground truth again, from the output folder alone.

Neither the store nor the original stage is read, and the folder is not trusted: what it holds becomes findings.
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
"""Random numbers of the judges are none of those of the build."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Findings of a verification.

    Attributes
    ----------
    problems : list of str
        Files that are lost, odd or altered, tables that break a rule, and rows that were derived otherwise.
    cameras : dict
        Camera name -> certificate of the new sample.
    looks : dict
        Camera name -> {points, of, rows}: target points of which all rows were derived again in every column.
    unread : dict
        Files that were too large to be opened: name -> reason.
    """

    problems: list[str]
    cameras: dict[str, dict[str, Any]] = field(default_factory=dict)
    looks: dict[str, dict[str, int]] = field(default_factory=dict)
    unread: dict[str, str] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether nothing speaks against the build."""
        return not self.problems and all(found["passed"] is not False for found in self.cameras.values())

    def to_dict(self) -> dict[str, Any]:
        """Plain data, as `verify --json` prints it."""
        return {
            "agrees": self.agrees,
            "problems": self.problems,
            "cameras": self.cameras,
            "derived_again": self.looks,
            "unread": self.unread,
        }


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check files against the manifest, every row against the stage, and samples of rows against fresh solutions.

    Files are read as what their names say they are, in a process with limits. Every row of every table: its labels,
    target point and place in the scene, image and cell, the ranges of its numbers, rho against the blur, that it is
    there once, and that comments and manifest count it. Of drawn points all rows in every column, see `second_look`. Of
    drawn rows position and visibility by other rules and rays. Other files are not derived again.

    Parameters
    ----------
    seed : int
        Which rows and points are drawn, and the random rays of those who judge.

    Raises
    ------
    UsageError
        The folder holds no finished build, or more than `limits` allow.
    """
    folder = HandedIn(Path(out), manifest.read(Path(out)))
    if STAGE not in folder.manifest.files:
        why = "its manifest.json is none of a build, or damaged" if folder.manifest.data else "it has no manifest.json"
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
    """Add what is found about a camera to a verdict."""
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
