"""The stage of an output folder, as `verify` needs it: which files a build of it writes, and its cameras and tables."""

import dataclasses
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import solved
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.channel_names import body_and_channel
from pipeline.engine.output.manifest import Manifest
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.project import Project
from pipeline.records.plain import from_plain
from pipeline.spelling import printable
from pipeline.tasks.params.cameras import AskedCamera, InChannel, JoinedRays, Planes
from pipeline.tasks.params.placed import PlacedView
from pipeline.tasks.params.truth import Truth, TruthTable, TruthTile


@dataclass(frozen=True, slots=True)
class Scene:
    """One frame of one camera: its table in the folder, and what the stage says of it, targets in the table's order."""

    file: str
    truth: TruthTable
    view: PlacedView


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedCamera:
    """A camera of the stage.

    Attributes
    ----------
    supersampling : int or None
        K of its position images; None for method `direct`, which has none.
    """

    camera: Camera
    square_px: float
    supersampling: int | None
    scenes: tuple[Scene, ...]

    @property
    def truth(self) -> TruthTable:
        """Settings and labels that all of its tables share."""
        return self.scenes[0].truth

    def rig(self, stream: int) -> Rig:
        """The camera ready to trace, with a stream of random numbers other than the build's, 0."""
        return Rig.of(Tracer(self.camera, self.truth.labels.seed ^ stream), self.square_px)


def wrong_list(project: Project, manifest: Manifest) -> Iterator[str]:
    """Differences between the files of a manifest and those that a build of the stage writes."""
    for name in sorted(project.files.keys() - manifest.files.keys()):
        yield f"the manifest lists no {name}"
    for name in sorted(manifest.files.keys() - project.files.keys()):
        yield f"{printable(name)} is no file of a build of the stage"
    for name in sorted(project.files.keys() & manifest.files.keys()):
        source = project.files[name]
        if isinstance(source, bytes) and hashlib.sha256(source).hexdigest() != manifest.files[name].sha256:
            yield f"{name} is not what a build of the stage writes"


def judged_camera(project: Project, name: str) -> JudgedCamera:
    """A camera of a project, with the parameters of its tasks."""
    graph = project.graph
    truths = {task: from_plain(Truth, graph[task].params) for task in graph if task.startswith(f"truth/{name}/")}
    first = next(iter(truths.values()))
    rays = from_plain(JoinedRays, graph[f"rays/{name}"].params) if first.table.settings.searches else None
    file_of = {source[0]: path for path, source in project.files.items() if not isinstance(source, bytes)}
    return JudgedCamera(
        camera=_camera(graph, name),
        square_px=first.square_px,
        supersampling=rays.sampling.supersampling if rays else None,
        scenes=tuple(Scene(file_of[task], truth.table, _view(graph, task)) for task, truth in truths.items()),
    )


def _camera(graph: TaskGraph, name: str) -> Camera:
    """The camera that the tasks `focus`, `planes` and, of a channel, `channel` would make."""
    body, channel = body_and_channel(name)
    focus = from_plain(AskedCamera, graph[f"focus/{body}"].params)
    planes = from_plain(Planes, graph[f"planes/{body}"].params)
    camera = focused(dataclasses.replace(solved(focus.asked), **dataclasses.asdict(planes)))
    return camera.in_light(from_plain(InChannel, graph[f"channel/{name}"].params).channel) if channel else camera


def _view(graph: TaskGraph, truth: str) -> PlacedView:
    """The view of a task `truth`, or of its tiles if it has any; targets by name."""
    own = from_plain(Truth, graph[truth].params).view
    view = own or from_plain(TruthTile, graph[graph[truth].reads["tile0"]].params).view
    return dataclasses.replace(view, targets=tuple(sorted(view.targets, key=lambda entry: entry.name)))
