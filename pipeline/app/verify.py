"""`pipeline verify OUT`: files, contract of the tables, and the certificate with another seed, from the folder alone.

Neither the store nor the original stage is read. It finds accidents and mistakes: whoever forges a folder can forge its
digests, too.
"""

import dataclasses
import functools
import hashlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.app.build import project
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import solved
from pipeline.camera.in_time import CameraInTime
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.spectrum import Channel
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.channel_names import body_and_channel
from pipeline.engine.output import manifest
from pipeline.engine.output.manifest import Manifest
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.project import Project
from pipeline.engine.records import Blob
from pipeline.errors import PipelineError, UsageError
from pipeline.files.damaged import DamagedFile
from pipeline.files.exr import read_exr
from pipeline.files.jsonfile import Json, read_json
from pipeline.files.png import read_png
from pipeline.files.tables import Table, read_table
from pipeline.files.tiff import read_tiff
from pipeline.graph.variants import without_pictures
from pipeline.records.plain import from_plain
from pipeline.spelling import printable
from pipeline.targets.target import target_from_plain
from pipeline.tasks.artefacts.surroundings import SurroundingsInTime
from pipeline.tasks.artefacts.truth_table import CHANNEL, column_order, header_of
from pipeline.tasks.camera import camera_in_time
from pipeline.tasks.certificate import certificate, planes_of, points_seen, rows_of
from pipeline.tasks.params.cameras import AskedCamera, BehindWindows, InTime, JoinedRays, Planes
from pipeline.tasks.params.frames import PlacedView, Truth, TruthTable
from pipeline.truth.judging import sample

_STAGE = "dataset.usda"
_STREAM = 0x7E51
"""Random stream of the verification; a build never uses it."""
_SAME_SHARE = 0.02
"""Tolerance of the visibility [1]: a thousand rays may be wrong by some thousandths at an edge."""
_TEXT = ("camera", CHANNEL, "target", "method")
_Reader = Callable[[Path], object]
_READERS: dict[str, _Reader] = {".exr": read_exr, ".png": read_png, ".json": read_json, ".csv": read_table}
_READERS |= dict.fromkeys((".tiff", ".dng"), read_tiff)
_OF_OTHERS = re.compile(r"exports/|pictures/[0-9a-f]{16}\.\w+$")
"""Files in the formats of other programs, and pictures that the stage is read with: our readers do not open them."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Findings about files, contracts and rows, and by name of the camera the certificate of the new sample."""

    problems: list[str]
    cameras: dict[str, Json] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether no check contradicts the build."""
        return not self.problems and all(judged["passed"] is not False for judged in self.cameras.values())

    def to_dict(self) -> Json:
        """The verdict as plain data, as `verify --json` prints it."""
        return {"agrees": self.agrees, "problems": self.problems, "cameras": self.cameras}


@dataclass(frozen=True, slots=True)
class _FrameTable:
    """The table of one frame in the folder, and what the stage says of it: targets in the table's order."""

    file: str
    truth: TruthTable
    view: PlacedView


@dataclass(frozen=True, slots=True, kw_only=True)
class _JudgedCamera:
    """A camera of the stage and its tables; `supersampling` is the K of its position images, None without any."""

    camera: Camera
    in_time: CameraInTime | None
    square_px: float
    supersampling: int | None
    tables: tuple[_FrameTable, ...]

    @property
    def truth(self) -> TruthTable:
        """Settings and labels that all of its tables share."""
        return self.tables[0].truth


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check the files of a folder against its manifest, its tables against its stage, and a sample of their rows.

    For the rows drawn with the seed, the certificate of the build is made again with other random rays. UsageError, if
    the folder holds no finished build.
    """
    out = Path(out)
    listed = manifest.read(out)
    if _STAGE not in listed.files:
        why = "its manifest.json is none of a build, or damaged" if listed.data else "it has no manifest.json"
        why = "it is a preview, without truth" if listed.files else why
        raise UsageError(f"{out} holds no finished build: {why}", hint="verify takes the folder of `pipeline build`")
    verdict = Verdict(list(wrong_files(out, listed)))
    try:
        build = project(out / _STAGE, out)
    except UsageError as error:
        verdict.problems.append(f"{_STAGE} is no stage that could have been built: {error}")
        return verdict
    verdict.problems.extend(_wrong_list(build if listed.has_pictures else without_pictures(build), listed))
    points = listed.points if isinstance(listed.points, dict) else {}
    for name in build.findings["certificate"]:
        try:
            _judge(out, name, points.get(name), _judged_camera(build, name), seed, verdict)
        except PipelineError as error:
            verdict.problems.append(f"camera {name}: {error}")
    return verdict


def wrong_files(out: Path, listed: Manifest) -> Iterator[str]:
    """Descriptions of missing, altered, damaged and unexpected files."""
    there = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()}
    for name in sorted(there - listed.files.keys() - {manifest.NAME}):
        yield f"{printable(name)} is not in the manifest"
    for name, entry in sorted(listed.files.items()):
        reader = None if _OF_OTHERS.match(name) else _READERS.get(Path(name).suffix)
        if fault := _fault(out / name, entry, reader):
            yield f"{printable(name)} {fault}"


def _fault(path: Path, entry: Blob, reader: _Reader | None) -> str | None:
    """Fault of a file: other bytes than its entry says, or content that its reader does not open; None without one."""
    try:
        size = path.stat().st_size
        if size != entry.size:
            return f"is not as it was built: {size:,} bytes, not {entry.size:,}"
        with path.open("rb") as stream:
            if hashlib.file_digest(stream, "sha256").hexdigest() != entry.sha256:
                return "is not as it was built: its bytes differ"
        if reader:
            reader(path)
    except FileNotFoundError:
        return "is lost"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    except DamagedFile as error:
        return f"cannot be read: {error.reason}"
    return None


def _wrong_list(build: Project, listed: Manifest) -> Iterator[str]:
    """Differences between the files of a manifest and those that a build of the stage writes."""
    for name in sorted(build.files.keys() - listed.files.keys()):
        yield f"the manifest lists no {name}"
    for name in sorted(listed.files.keys() - build.files.keys()):
        yield f"{printable(name)} is no file of a build of the stage"
    for name in sorted(build.files.keys() & listed.files.keys()):
        source = build.files[name]
        if isinstance(source, bytes) and hashlib.sha256(source).hexdigest() != listed.files[name].sha256:
            yield f"{name} is not what a build of the stage writes"


def _judge(out: Path, name: str, points: Any, camera: _JudgedCamera, seed: int, verdict: Verdict) -> None:
    """Add the findings about a camera to a verdict; `points` is what the manifest counts."""
    tracer = Tracer(camera.camera, camera.truth.seed ^ (_STREAM + seed))
    rig = Rig.of(tracer, camera.square_px, camera.in_time)
    tables = list(_kept_tables(out, camera, rig, verdict.problems))
    judged = [(frame.view.targets, table) for frame, table in tables]
    if len(tables) == len(camera.tables) and points_seen([frame.truth.frame for frame, _ in tables], judged) != points:
        verdict.problems.append(f"camera {name}: the manifest counts other rows or points than its tables have")
    verdict.problems.extend(f"camera {name}, {wrong}" for wrong in _wrong_visibilities(rig, tables, seed))
    verdict.cameras[name] = certificate(rig, judged, camera.truth.shutter, camera.truth.settings.claim_px, seed)


def _judged_camera(build: Project, name: str) -> _JudgedCamera:
    """A camera of a project, with the parameters of its tasks."""
    graph = build.graph
    truths = {task: from_plain(Truth, graph[task].params) for task in graph if task.startswith(f"truth/{name}/")}
    first = next(iter(truths.values()))
    rays = from_plain(JoinedRays, graph[f"rays/{name}"].params) if first.table.settings.searches else None
    file_of = {source[0]: path for path, source in build.files.items() if not isinstance(source, bytes)}
    return _JudgedCamera(
        camera=_camera(graph, name),
        in_time=camera_in_time(from_plain(InTime, graph[states].params))
        if (states := f"in_time/{name}") in graph
        else None,
        square_px=first.square_px,
        supersampling=rays.sampling.supersampling if rays else None,
        tables=tuple(_FrameTable(file_of[task], truth.table, _view(graph, task)) for task, truth in truths.items()),
    )


def _camera(graph: TaskGraph, name: str) -> Camera:
    """The camera that the tasks `focus`, `planes`, `windows` if any and, of a channel, `channel` would make."""
    body, channel = body_and_channel(name)
    focus = from_plain(AskedCamera, graph[f"focus/{body}"].params)
    planes = from_plain(Planes, graph[f"planes/{body}"].params)
    camera = focused(dataclasses.replace(solved(focus.asked), **dataclasses.asdict(planes)))
    if channel:
        camera = camera.in_light(from_plain(Channel, graph[f"channel/{name}"].params))
    if f"windows/{name}" not in graph:
        return camera
    before = from_plain(BehindWindows, graph[f"windows/{name}"].params)
    return camera.behind(before.windows, before.wavelength_nm)


def _view(graph: TaskGraph, task: str) -> PlacedView:
    """The view of a task `truth`, or of its tiles if it has any; targets by name."""
    truth = from_plain(Truth, graph[task].params)
    view = truth.view or from_plain(Truth, graph[graph[task].reads["tile0"]].params).view
    assert view is not None
    return dataclasses.replace(view, targets=tuple(sorted(view.targets, key=lambda entry: entry.name)))


def _kept_tables(
    out: Path, camera: _JudgedCamera, rig: Rig, problems: list[str]
) -> Iterator[tuple[_FrameTable, Table]]:
    """The tables of a camera that keep their contract; of all others the problems are added."""
    for frame in camera.tables:
        try:
            table = read_table(out / frame.file)
        except (DamagedFile, OSError):
            continue  # `wrong_files` says so
        broken = list(_broken_contract(camera, rig, frame, table))
        problems.extend(f"{frame.file}: {problem}" for problem in broken)
        if not broken:
            yield frame, table


def _broken_contract(camera: _JudgedCamera, rig: Rig, frame: _FrameTable, table: Table) -> Iterator[str]:
    """Breaches of docs/outputs.md by a table; if there are none, its rows can be judged."""
    head = header_of(frame.truth, camera.supersampling, camera.camera)
    if [line.strip() for line in head] != list(table.comments[: len(head)]):
        yield "its comments are not those of the stage"
    columns = column_order(frame.truth)
    if list(table.columns) != columns:
        yield f"its columns are not {', '.join(columns)}"
        return
    try:
        values = {name: table.numbers(name) for name in columns if name not in _TEXT}
    except ValueError as error:
        yield str(error)
        return
    if not np.isfinite([values["x_px"], values["y_px"]]).all():
        yield "rows without a position"
    for names, labels in _labels(rig, frame):
        rows = zip(*(table.columns[name] for name in names), strict=True)
        unknown = [number for number, row in enumerate(rows, 1) if row not in labels]
        if unknown:
            yield f"{len(unknown)} rows, first row {unknown[0]}, have {', '.join(names)} that the stage has not"


def _labels(rig: Rig, frame: _FrameTable) -> Iterator[tuple[tuple[str, ...], set[tuple[str, ...]]]]:
    """Columns that say what a row belongs to, and all cells that the stage has for them."""
    yield ("frame", "camera"), {(str(frame.truth.frame), frame.truth.camera)}
    if channel := frame.truth.channel:
        yield (CHANNEL,), {(channel.name,)}
    counts = {entry.name: len(target_from_plain(entry.target).points().kinds) for entry in frame.view.targets}
    yield ("target", "point_id"), {(name, str(point)) for name, count in counts.items() for point in range(count)}
    lattice = rig.tracer.lattice
    cells = [[""]] * 3 if lattice is None else [lattice.k.tolist(), lattice.l.tolist(), lattice.type.tolist()]
    yield ("microlens_k", "microlens_l", "microlens_type"), set(zip(*(map(str, cell) for cell in cells), strict=True))


def _wrong_visibilities(rig: Rig, tables: list[tuple[_FrameTable, Table]], seed: int) -> list[str]:
    """Faults in the visibility of up to `judging.ROWS` rows of a camera, determined again with other rays."""
    faults, first = [], 0
    drawn = sample(np.zeros(sum(len(table.columns["visibility"]) for _, table in tables), bool), seed)
    for frame, table in tables:
        targets = frame.view.targets
        shutter = frame.truth.shutter
        in_time = SurroundingsInTime.of(frame.view, shutter, rig)
        names = np.array(table.columns["target"], str)
        for number, of_target in enumerate(rows_of(rig, targets, table, shutter)):
            here = drawn[(drawn >= first) & (drawn < first + len(of_target.cell))] - first
            first, rows = first + len(of_target.cell), of_target.only(here)
            stated, point = (
                table.numbers(column)[names == targets[number].name][here] for column in ("visibility", "point_id")
            )
            on = functools.partial(planes_of(rig, targets[number], shutter).at, point.astype(int))
            share = in_time.visibility(rig, number, rows.cell, rows.x_px, on)
            wrong = ~np.isclose(share, stated, rtol=0, atol=_SAME_SHARE, equal_nan=True)
            if wrong.any():
                worst = f"{stated[wrong][0]:.3g} in place of {share[wrong][0]:.3g}"
                which = f"{int(wrong.sum())} of {len(here)} rows of {targets[number].name}"
                faults.append(f"frame {frame.truth.frame}: {which} state another visibility, {worst}")
    return faults
