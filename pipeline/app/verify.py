"""`pipeline verify OUT`: digests, the list of files, and the certificate with another seed, from the folder alone.

Neither the store nor the original stage is read. It finds accidents and mistakes: whoever forges a folder can forge its
digests, too.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.app.build import project
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.engine.output import manifest
from pipeline.engine.output.manifest import Manifest
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.project import Project
from pipeline.engine.records import Blob
from pipeline.errors import PipelineError, UsageError
from pipeline.files.jsonfile import Json
from pipeline.files.tables import read_table
from pipeline.products.certificate.make import judged
from pipeline.products.truth.params import Truth
from pipeline.products.variants import without_pictures
from pipeline.products.views import PlacedTarget
from pipeline.records.plain import from_plain
from pipeline.spelling import printable

_STAGE = "dataset.usda"
_STREAM = 0x7E51
"""Random stream of the verification, which no build uses."""


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
        """Plain data, as in `verify --json`."""
        return {"agrees": self.agrees, "problems": self.problems, "cameras": self.cameras}


def verify(out: str | Path, seed: int = 1) -> Verdict:
    """Check the files of a folder against its manifest and its stage, and a sample of the rows of its tables.

    The certificate of the build is repeated for rows drawn with the seed, by other random rays. UsageError if the
    folder holds no finished build.
    """
    out = Path(out)
    listed = manifest.read(out)
    if _STAGE not in listed.files:
        reason = "its manifest.json is none of a build, or damaged" if listed.data else "it has no manifest.json"
        reason = "it is a preview, without truth" if listed.files else reason
        raise UsageError(f"{out} holds no finished build: {reason}", hint="verify takes the folder of `pipeline build`")
    verdict = Verdict(list(wrong_files(out, listed)))
    try:
        build = project(out / _STAGE, out)
    except UsageError as error:
        verdict.problems.append(f"{_STAGE} is no stage that could have been built: {error}")
        return verdict
    verdict.problems.extend(_wrong_list(build if listed.has_pictures else without_pictures(build), listed))
    for name in build.findings["certificate"]:
        try:
            verdict.cameras[name] = _certificate(out, build, name, seed)
        except (PipelineError, OSError, ValueError, LookupError) as error:  # of a table that is not as it was built
            verdict.problems.append(f"camera {name} cannot be judged by its tables: {error}")
    return verdict


def wrong_files(out: Path, listed: Manifest) -> Iterator[str]:
    """Descriptions of missing, altered and unexpected files."""
    in_folder = {path.relative_to(out).as_posix() for path in out.rglob("*") if not path.is_dir()}
    for name in sorted(in_folder - listed.files.keys() - {manifest.NAME}):
        yield f"{printable(name)} is not in the manifest"
    for name, entry in sorted(listed.files.items()):
        if fault := _fault(out / name, entry):
            yield f"{printable(name)} {fault}"


def _fault(path: Path, entry: Blob) -> str | None:
    """Fault of a file whose bytes differ from its entry; None without one."""
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


def _certificate(out: Path, build: Project, name: str, seed: int) -> Json:
    """The certificate of a camera, for rows and random rays that the seed selects."""
    graph = build.graph
    truths = {task: from_plain(Truth, graph[task].params) for task in graph if task.startswith(f"truth/{name}/")}
    first = next(iter(truths.values()))
    camera = from_plain(Camera, graph[graph[f"certificate/{name}"].reads["camera"]].params)
    rig = Rig.of(Tracer(camera, first.table.seed ^ (_STREAM + seed)), first.square_px)
    file_of = {source[0]: path for path, source in build.files.items() if not isinstance(source, bytes)}
    tables = [(_targets(graph, task, truth), read_table(out / file_of[task])) for task, truth in truths.items()]
    return judged(rig, tables, first.table.shutter, first.table.settings.claim_px, seed)


def _targets(graph: TaskGraph, task: str, truth: Truth) -> tuple[PlacedTarget, ...]:
    """Targets of a camera's task `truth`, or of its tiles if it has any, by name."""
    view = truth.view or from_plain(Truth, graph[graph[task].reads["tile0"]].params).view
    assert view is not None
    return tuple(sorted(view.targets, key=lambda entry: entry.name))
