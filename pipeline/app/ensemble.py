"""`pipeline ensemble`: cameras as they may be built, drawn by the tolerances of a dataset, and their spread.

Each member is a layer over the dataset, which an ordinary build reads; unaffected results come from the store.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app.build import build_with, default_out, run_together
from pipeline.app.pages.ending import certificate_lines, failed
from pipeline.app.stages import sound
from pipeline.engine.files import chosen_place
from pipeline.engine.options import BuildOptions
from pipeline.engine.running.result import Result
from pipeline.errors import PipelineError, UsageError
from pipeline.files.jsonfile import Json, write_json
from pipeline.files.tables import write_table
from pipeline.results.output import open_output
from pipeline.results.spread import Figures, figures, rows
from pipeline.scene.load import require_dataset
from pipeline.scene.tolerances import DrawnNumber, layer_of_member
from pipeline.scene.usd.problems import Problem, StageError, shown_path
from pipeline.scene.usd.roots import allowed_roots, real_path

NOMINAL = "nominal"
"""Folder of the build of the dataset itself."""
_TOGETHER = 50
"""Most builds whose tasks run together: their graphs are in memory."""
Run = Callable[[Path, Path, BuildOptions], Result]
RunTogether = Callable[[Mapping[Path, Path], BuildOptions], Result]


class MemberError(PipelineError):
    """A member of an ensemble that could not be built."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ensemble:
    """A built ensemble: its folder, the numbers drawn for each member, certificates of members and of the nominal
    camera, and for each camera the figures and the table of rows.
    """

    out: Path
    numbers: dict[str, list[DrawnNumber]]
    certificates: dict[str, Json]
    figures: dict[str, Figures]
    tables: dict[str, dict[str, np.ndarray]]

    @property
    def refuted(self) -> list[str]:
        """A line about each certificate that cannot show the claimed accuracy."""
        return [
            f"{name}: {certificate_lines({camera: judged})[0]}"
            for name, certificates in self.certificates.items()
            for camera, judged in certificates.items()
            if failed({camera: judged})
        ]

    def to_dict(self) -> Json:
        """Content of ensemble.json."""
        verdicts = {
            name: {camera: judged["passed"] for camera, judged in certificates.items()}
            for name, certificates in self.certificates.items()
        }
        units = {number.name: {"unit": number.unit} for number in next(iter(self.numbers.values()))}
        cameras = {camera: its_figures.to_dict() for camera, its_figures in self.figures.items()}
        return {"members": verdicts, "numbers": units, "cameras": cameras}


def folder_of(stage: Path) -> Path:
    """Default folder of an ensemble: that of the build, with a suffix."""
    build = default_out(stage)
    return build.with_name(f"{build.name}.ensemble")


def ensemble(
    stage: Path,
    out: Path,
    count: int,
    options: BuildOptions,
    run: Run = build_with,
    together: RunTogether = run_together,
) -> Ensemble:
    """Build the nominal camera and `count` members (2 at least) below a folder, and write their spread.

    Tasks of many members run `together`; then each member is built from the store, or reports which task has failed.
    Raises StageError: the dataset or a member does not pass `check`; UsageError: the folder has further members;
    MemberError: a build failed.
    """
    dataset = require_dataset(sound(stage, options.allow_roots), stage)
    roots = (*allowed_roots(stage, options.allow_roots)[:1], *options.allow_roots)  # a member may lie in no project
    options = replace(options, allow_roots=roots)
    names = [f"member_{number:04d}" for number in range(1, count + 1)]
    if foreign := sorted({path.stem for path in out.glob("member_[0-9]*")} - {*names}):
        hint = "remove them and their layers, or choose another folder by --out"
        raise UsageError(f"{out} has members of a larger ensemble: {foreign[0]} to {foreign[-1]}", hint=hint)
    layers = {name: out / f"{name}.usda" for name in names}
    texts = {}
    numbers = {}
    for member, (name, layer) in enumerate(layers.items(), 1):
        texts[name], numbers[name] = layer_of_member(stage, member, layer)
    if not numbers[names[0]]:
        raise _no_tolerance(stage)
    with chosen_place("write", out):
        out.mkdir(parents=True, exist_ok=True)
        for name, layer in layers.items():
            layer.write_text(texts[name], encoding="utf-8")
    for layer in layers.values():
        sound(layer, roots)  # all of them before the first is built
    stages = {NOMINAL: stage, **layers}
    certificates = {}
    for number, (name, path) in enumerate(stages.items()):
        if number % _TOGETHER == 0:
            batch = list(stages.items())[number : number + _TOGETHER]
            if together({path: out / name for name, path in batch}, options).interrupted:
                raise MemberError("the ensemble was interrupted", hint="the same command goes on from here")
        result = run(path, out / name, options)
        if result.exit_code:
            raise MemberError(f"{name} was not built: {path}", hint="mend it; the others are in the store")
        certificates[name] = result.certificate or {}
    nominal, *members = (open_output(out / name) for name in (NOMINAL, *names))
    built = Ensemble(
        out=out,
        numbers=numbers,
        certificates=certificates,
        figures={camera: figures(camera, nominal, members) for camera in nominal.cameras},
        tables={camera: rows(camera, nominal, members) for camera in nominal.cameras},
    )
    _write(built, {"stage": stage.name, "seed": dataset.seed})
    return built


def _no_tolerance(stage: Path) -> StageError:
    hint = "add a PlenTolerance: docs/as_built.md"
    file = shown_path(real_path(stage))
    return StageError(
        [Problem(code="no-tolerance", message="the stage has no tolerance", file=file, line=1, hint=hint)]
    )


def _write(built: Ensemble, head: Json) -> None:
    """Write ensemble.json, errors.csv with a row per member, and a table of rows per camera."""
    errors: dict[str, list[Any]] = {"member": list(built.numbers)}
    for i, number in enumerate(next(iter(built.numbers.values()))):
        errors[number.name] = [numbers[i].error for numbers in built.numbers.values()]
    with chosen_place("write", built.out):
        write_json(built.out / "ensemble.json", {**head, **built.to_dict()})
        write_table(built.out / "errors.csv", ["errors of the numbers of each member, in their units"], errors)
        (built.out / "correspondences").mkdir(exist_ok=True)
        for camera, table in built.tables.items():
            remarks = (
                f"rows of the ground truth over {len(built.numbers)} cameras as built: camera {camera}",
                "members: how many of them have the row; x_px, y_px: that of the nominal camera",
                "empty: moments of rows that not all of them have",
            )
            write_table(built.out / "correspondences" / f"{camera}.csv", remarks, table)


def summary(built: Ensemble) -> list[str]:
    """The figures of each camera, and the spread of its rows, as lines for a terminal.

    Figures that do not vary are left out: they have no correlation. The correlations are the lower triangle.
    """
    text = []
    count = len(built.numbers)
    for camera, spread in built.figures.items():
        varying = [i for i in range(len(spread.names)) if not np.isnan(spread.correlation[i, i])]
        text.append(f"{camera}: {count} members")
        head = "".join(f"{number:6d}" for number in range(1, len(varying) + 1))
        text.append(f"{'':27}{'nominal':>14}{'mean':>14}{'deviation':>11}{head}  correlation")
        for number, i in enumerate(varying, 1):
            correlations = "".join(f"{spread.correlation[i, j]:6.2f}" for j in varying[:number])
            cells = f"{spread.nominal[i]:14.6g}{spread.mean[i]:14.6g}{spread.deviation[i]:11.2g}"
            text.append(f"  {number:2d} {spread.names[i]:22}{cells}{correlations}")
        table = built.tables[camera]
        in_all = table["members"] == count
        spread_px = np.hypot(table["deviation_x_px"], table["deviation_y_px"])[in_all]
        if len(spread_px):
            deviation = f"deviation {np.median(spread_px):.2g} px in the middle, {spread_px.max():.2g} px at most"
            text.append(f"  rows: {len(in_all)}, of all members {np.count_nonzero(in_all)}: {deviation}")
    return text
