"""An output folder to be verified: its files compared with its manifest, its stage and tables read into records.

The folder is not trusted. Its stage is read from a copy in the sandbox; of its other files only the tables are parsed.
"""

import dataclasses
import functools
import hashlib
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.app.sandbox import project_of_untrusted
from pipeline.app.verifying.readable import is_of_stage, unreadable
from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import solved
from pipeline.camera.parts.camera import Camera, Sampling
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.channel_names import body_and_channel
from pipeline.engine.output.foreign import ForeignFolder, Unfit
from pipeline.engine.output.manifest import Manifest
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.project import Project
from pipeline.errors import UsageError
from pipeline.files.damaged import DamagedFile
from pipeline.files.tables import Table, table_of
from pipeline.limits import how_to_raise, limits
from pipeline.records.plain import from_plain
from pipeline.spelling import printable
from pipeline.tasks.params.cameras import Focus, InChannel, Planes
from pipeline.tasks.params.placed import View
from pipeline.tasks.params.rays import Rays
from pipeline.tasks.params.truth import Truth, TruthTable, TruthTile
from pipeline.truth.settings import TruthSettings

STAGE = "dataset.usda"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One frame of one camera: the inputs of its task `truth`, and the table in the folder.

    Attributes
    ----------
    file : str
        Path of the table in the folder.
    truth : TruthTable
        Parameters of the task `truth`, from the stage.
    view : View
        The view of the same task, with targets in the order of the table.
    table : Table
    """

    file: str
    truth: TruthTable
    view: View
    table: Table

    @property
    def number(self) -> int:
        """Time code."""
        return self.truth.frame


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedCamera:
    """A camera of the stage.

    Attributes
    ----------
    sampling : Sampling or None
        Sampling of its position images; None for method `direct`, which has none.
    tables : dict
        Path of its table in the folder and the stage's part of `Scene`, by frame.
    """

    name: str
    camera: Camera
    seed: int
    settings: TruthSettings
    square_px: float
    sampling: Sampling | None
    tables: dict[int, tuple[str, TruthTable, View]]

    def rig(self, stream: int = 0) -> Rig:
        """The camera ready to trace, with the random numbers of the build (stream 0) or with others."""
        tracer = Tracer(self.camera, self.seed ^ stream)
        return Rig.of(tracer, self.square_px)


@dataclass(slots=True)
class HandedIn:
    """The folder.

    Attributes
    ----------
    problems : list of str
        Problems of its files.
    unread : dict
        Files too large to be opened: name -> reason.
    """

    root: Path
    manifest: Manifest
    problems: list[str] = field(default_factory=list)
    unread: dict[str, str] = field(default_factory=dict)

    def look(self) -> None:
        """Compare every file with the manifest, and try to read the files that other programs read."""
        size = sum(entry["size"] for entry in self.manifest.files.values())
        if size > limits().folder_bytes:
            raise UsageError(
                f"{self.root} holds {size:,} bytes by its manifest, more than the limit of {limits().folder_bytes:,}",
                hint=how_to_raise("folder_bytes", size),
            )
        folder = ForeignFolder(self.root)
        for name, entry in sorted(self.manifest.files.items()):
            try:
                folder.require_whole(name, entry["size"], entry["sha256"])
            except Unfit as reason:
                self._add(f"{name} {reason}")
        damaged, self.unread = unreadable(self.root, self.manifest.files)
        for name, why in damaged.items():
            self._add(f"{name} cannot be read: {why}")

    def project(self) -> Project | None:
        """Project of the folder's stage. If it cannot be read: None, and a problem is added."""
        folder, named = ForeignFolder(self.root), sorted(filter(is_of_stage, self.manifest.files))
        try:
            pictures = tuple((name, folder.read(name, limits().picture_bytes)) for name in named)
            project = _project(folder.read(STAGE, limits().layer_bytes), pictures)
        except Unfit as reason:
            self._add(f"{STAGE} {reason}")
            return None
        except UsageError as error:
            self._add(f"{STAGE} is no stage that could have been built: {error}")
            return None
        self.problems += [f"the manifest lists no {name}" for name in project.files if name not in self.manifest.files]
        for name, source in project.files.items():
            listed = self.manifest.files.get(name)
            if listed and isinstance(source, bytes) and hashlib.sha256(source).hexdigest() != listed["sha256"]:
                self._add(f"{name} is not what a build of the stage writes")
        return project

    def tables_of(self, camera: JudgedCamera) -> list[Scene]:
        """The readable tables of a camera; each unreadable one adds a problem."""
        scenes, folder, left = [], ForeignFolder(self.root), limits().table_bytes
        for file, truth, view in camera.tables.values():
            try:
                data = folder.read(file, left)
                table, left = table_of(file, data), left - len(data)
            except Unfit as reason:
                self._add(f"{file} {reason}")
            except DamagedFile as error:
                self._add(error.what)
            else:
                scenes.append(Scene(file=file, truth=truth, view=view, table=table))
        return scenes

    def require_small_tables(self, project: Project) -> None:
        """Refuse the tables if together they exceed the memory, before the first one is read."""
        names = [name for name in project.files if name.endswith("/correspondences.csv")]
        size = sum(self.manifest.files[name]["size"] for name in names if name in self.manifest.files)
        if size > limits().table_bytes:
            raise UsageError(
                f"the tables of {self.root} hold {size:,} bytes, more than the limit of {limits().table_bytes:,}",
                hint=how_to_raise("table_bytes", size),
            )

    def _add(self, problem: str) -> None:
        """Add a problem as safe text: names of files may hold anything, even escape sequences of terminals."""
        problem = "\n".join(map(printable, problem.splitlines()))
        if problem not in self.problems:
            self.problems.append(problem)


def cameras_of(project: Project) -> list[JudgedCamera]:
    """All cameras of a project, with the parameters of its tasks."""
    names = project.findings["certificate"]
    return [_camera(project, name) for name in names]


def _camera(project: Project, name: str) -> JudgedCamera:
    graph = project.graph
    truths = {one: from_plain(Truth, graph[one].params) for one in graph if one.startswith(f"truth/{name}/")}
    first = next(iter(truths.values()))
    settings, sampling = first.table.settings, None
    if settings.searches:
        sampling = from_plain(Rays, graph[f"rays/{name}"].params).sampling
    file_of = {source[0]: path for path, source in project.files.items() if not isinstance(source, bytes)}
    return JudgedCamera(
        name=name,
        camera=_camera_of(graph, name),
        seed=first.table.labels.seed,
        settings=settings,
        square_px=first.square_px,
        sampling=sampling,
        tables={one.table.frame: (file_of[task], one.table, _view_of(graph, task)) for task, one in truths.items()},
    )


def _camera_of(graph: TaskGraph, name: str) -> Camera:
    """The camera that the tasks `focus`, `planes` and, of a channel, `channel` would make."""
    body, channel = body_and_channel(name)
    asked = from_plain(Focus, graph[f"focus/{body}"].params), from_plain(Planes, graph[f"planes/{body}"].params)
    camera = _focused(*asked)
    return camera.in_light(from_plain(InChannel, graph[f"channel/{name}"].params).channel) if channel else camera


def _view_of(graph: TaskGraph, truth: str) -> View:
    """The view of a task `truth`, or of its tiles if it has any; targets by name."""
    own = from_plain(Truth, graph[truth].params).view
    view = own or from_plain(TruthTile, graph[graph[truth].reads["tile0"]].params).view
    return dataclasses.replace(view, targets=tuple(sorted(view.targets, key=lambda entry: entry.name)))


def _focused(focus: Focus, planes: Planes) -> Camera:
    """The camera that the tasks `focus` and `planes` would compute."""
    return focused(dataclasses.replace(solved(focus.asked), **dataclasses.asdict(planes)))


@functools.lru_cache(maxsize=1)
def _project(stage: bytes, pictures: tuple[tuple[str, bytes], ...]) -> Project:
    """The project of a stage that stands with its pictures in an empty folder, so that it finds no other file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder).resolve() / STAGE
        for name, content in ((STAGE, stage), *pictures):
            (path.parent / name).parent.mkdir(exist_ok=True)
            (path.parent / name).write_bytes(content)
        try:
            return project_of_untrusted(path, Path(folder), ())
        except UsageError as error:
            raise UsageError(error.what.replace(f"{path.parent}/", ""), hint=error.hint) from None
