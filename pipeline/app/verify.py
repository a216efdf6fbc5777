"""`pipeline verify OUT`: digests, the list of files, and the certificate with another seed, from the folder alone.

Neither the store nor the original stage is read. It finds accidents and mistakes: whoever forges a folder can forge its
digests, too.
"""

import dataclasses
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.app.build import project
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import solved
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
from pipeline.files.jsonfile import Json
from pipeline.files.tables import read_table
from pipeline.graph.variants import without_pictures
from pipeline.records.plain import from_plain
from pipeline.spelling import printable
from pipeline.tasks.certificate import certificate
from pipeline.tasks.params.cameras import AskedCamera, BehindWindows, Planes
from pipeline.tasks.params.frames import PlacedTarget, Truth, TruthTable

_STAGE = "dataset.usda"
_STREAM = 0x7E51
"""Random stream of the verification; a build never uses it."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Findings about files, and by name of the camera the certificate of the new sample."""

    problems: list[str]
    cameras: dict[str, Json] = field(default_factory=dict)

    @property
    def agrees(self) -> bool:
        """Whether no check contradicts the build."""
        return not self.problems and all(judged["passed"] is not False for judged in self.cameras.values())

    def to_dict(self) -> Json:
        """The verdict as plain data, as `verify --json` prints it."""
        return {"agrees": self.agrees, "problems": self.problems, "cameras": self.cameras}


@dataclass(frozen=True, slots=True, kw_only=True)
class _JudgedCamera:
    """A camera of the stage; the file of each of its tables has the targets of its frame, in the table's order."""

    camera: Camera
    square_px: float
    truth: TruthTable  # settings that all of its tables share
    tables: dict[str, tuple[PlacedTarget, ...]]


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check the files of a folder against its manifest and its stage, and a sample of the rows of its tables.

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
    for name in build.findings["certificate"]:
        try:
            verdict.cameras[name] = _certificate(out, _judged_camera(build, name), seed)
        except (PipelineError, OSError, ValueError, LookupError) as error:  # of a table that is not as it was built
            verdict.problems.append(f"camera {name} cannot be judged by its tables: {error}")
    return verdict


def wrong_files(out: Path, listed: Manifest) -> Iterator[str]:
    """Descriptions of missing, altered and unexpected files."""
    there = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()}
    for name in sorted(there - listed.files.keys() - {manifest.NAME}):
        yield f"{printable(name)} is not in the manifest"
    for name, entry in sorted(listed.files.items()):
        if fault := _fault(out / name, entry):
            yield f"{printable(name)} {fault}"


def _fault(path: Path, entry: Blob) -> str | None:
    """Fault of a file: other bytes than its entry says; None without one."""
    try:
        size = path.stat().st_size
        if size != entry.size:
            return f"is not as it was built: {size:,} bytes, not {entry.size:,}"
        with path.open("rb") as stream:
            is_same = hashlib.file_digest(stream, "sha256").hexdigest() == entry.sha256
    except FileNotFoundError:
        return "is lost"
    except OSError as error:
        return f"cannot be read ({error.strerror})"
    return None if is_same else "is not as it was built: its bytes differ"


def _wrong_list(build: Project, listed: Manifest) -> Iterator[str]:
    """Differences between the names in a manifest and those of the files that a build of the stage writes."""
    for name in sorted(build.files.keys() - listed.files.keys()):
        yield f"the manifest lists no {name}"
    for name in sorted(listed.files.keys() - build.files.keys()):
        yield f"{printable(name)} is no file of a build of the stage"


def _certificate(out: Path, judged: _JudgedCamera, seed: int) -> Json:
    """The certificate of a camera, for rows and by random rays that the seed draws."""
    tracer = Tracer(judged.camera, judged.truth.seed ^ (_STREAM + seed))
    rig = Rig.of(tracer, judged.square_px)
    tables = [(targets, read_table(out / file)) for file, targets in judged.tables.items()]
    return certificate(rig, tables, judged.truth.shutter, judged.truth.settings.claim_px, seed)


def _judged_camera(build: Project, name: str) -> _JudgedCamera:
    """A camera of a project, with the parameters of its tasks."""
    graph = build.graph
    truths = {task: from_plain(Truth, graph[task].params) for task in graph if task.startswith(f"truth/{name}/")}
    first = next(iter(truths.values()))
    file_of = {source[0]: path for path, source in build.files.items() if not isinstance(source, bytes)}
    return _JudgedCamera(
        camera=_camera(graph, name),
        square_px=first.square_px,
        truth=first.table,
        tables={file_of[task]: _targets(graph, task, truth) for task, truth in truths.items()},
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


def _targets(graph: TaskGraph, task: str, truth: Truth) -> tuple[PlacedTarget, ...]:
    """Targets before a task `truth`, or before its tiles if it has any, by name."""
    view = truth.view or from_plain(Truth, graph[graph[task].reads["tile0"]].params).view
    assert view is not None
    return tuple(sorted(view.targets, key=lambda entry: entry.name))
