"""The tasks of exports that a stage asks for: one per format, reading results as `pipeline export` reads a folder."""

import json

from pipeline.channel_names import name_with
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.exports.noise import Noise
from pipeline.exports.writer_code import code_of_writer
from pipeline.formats import Format, Reads, folder_of, format_of
from pipeline.graph.adding import add
from pipeline.graph.poses import Things, target_poses
from pipeline.graph.settled import camera_task
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.tasks.params.frames import PlacedView
from pipeline.tasks.params.outputs import Export, SeenFrame, SightedCamera


def add_exports(graph: TaskGraph, files: dict[str, Source], dataset: Dataset, bare: Things) -> None:
    """Add the exports of a dataset, after the tasks of all `files`, which receives theirs; `bare` has no colours."""
    asked = dataset.exports
    for name in asked.formats:
        wanted = format_of(name)
        cameras = [camera for camera in dataset.cameras if wanted.takes(_is_plenoptic(camera))]
        read = _Read(graph, files, cameras, wanted)
        sights = read.sights() if Reads.RAYS in wanted.reads else {}
        noisy = Reads.CORNERS in wanted.reads
        params = Export(
            format=name,
            code=code_of_writer(name),
            position=asked.position,
            noise=Noise(**asked.noise) if noisy else Noise(),  # type: ignore[arg-type]  # scene knows no Noise
            stage=f"</{dataset.stage_name}>",
            files=read.places(dataset),
            records=read.targets() if noisy else {},
            numbers={seen.full_name: _numbers(dataset, camera) for camera in cameras for seen in camera.in_channels},
            sights=sights,
            views=_views(dataset, cameras, bare) if Reads.SCENE in wanted.reads else (),
        )
        folder = folder_of(name, asked.position)
        task = add(graph, f"export/{folder}", params, read.roles)
        for path in wanted.paths(_named(cameras), params.numbers, len(dataset.targets)):
            files[f"exports/{folder}/{path}"] = (task, path)


class _Read:
    """Results that a format reads of a build; `roles` has the task of each role."""

    def __init__(self, graph: TaskGraph, files: dict[str, Source], cameras: list[CameraEntry], wanted: Format) -> None:
        self.graph, self.files, self.cameras, self.wanted = graph, files, cameras, wanted
        self.roles = dict[str, str]()
        self._known = dict[str, str]()

    def places(self, dataset: Dataset) -> dict[str, tuple[str, str]]:
        """Path in the output folder -> role and output, of every file that the format reads."""
        places = dict[str, tuple[str, str]]()
        for path in [path for camera in self.cameras for path in self._paths(camera, _numbers(dataset, camera))]:
            source = self.files[path]
            assert not isinstance(source, bytes)
            places[path] = self._role(source[0]), source[1]
        return places

    def targets(self) -> dict[str, object]:
        """Content of the files of all targets, which no task makes."""
        named = {path: source for path, source in self.files.items() if path.startswith("targets/")}
        return {path: json.loads(source) for path, source in named.items() if isinstance(source, bytes)}

    def sights(self) -> dict[str, SightedCamera]:
        """The cameras whose rays are read, as `pipeline.ready` makes them ready."""
        return {seen.full_name: self._sighted(seen) for camera in self.cameras for seen in camera.in_channels}

    def _sighted(self, seen: CameraEntry) -> SightedCamera:
        return SightedCamera(
            camera_role=self._role(camera_task(self.graph, seen, has_planes=True)),
            seed=seen.sampling.seed,
            square_px=seen.square_px,
            min_hit_fraction=seen.truth.min_hit_fraction,
            accuracy_px=seen.truth.aim_px,
        )

    def _paths(self, camera: CameraEntry, numbers: tuple[int, ...]) -> list[str]:
        reads, paths = self.wanted.reads, [f"cameras/{camera.name}/camera.json"]
        if Reads.CORNERS in reads:
            paths += [f"frames/{number:04d}/{camera.name}/poses.json" for number in numbers]
        for seen in camera.in_channels:
            paths += [f"cameras/{seen.folder}/micro_images.csv"] if _is_plenoptic(camera) else []
            paths += [f"cameras/{seen.folder}/white.exr"] if Reads.IMAGES in reads else []
            for number in numbers:
                frame = f"frames/{number:04d}/{seen.folder}"
                paths += [f"{frame}/correspondences.csv"] if Reads.CORNERS in reads else []
                paths += [f"{frame}/image.exr"] if Reads.IMAGES in reads else []
        return paths

    def _role(self, task: str) -> str:
        """Role of a task whose outputs are read; names are no part of the key."""
        if task not in self._known:
            self._known[task] = f"input{len(self._known)}"
            self.roles[self._known[task]] = task
        return self._known[task]


def _is_plenoptic(camera: CameraEntry) -> bool:
    return camera.asked.microlenses is not None


def _numbers(dataset: Dataset, camera: CameraEntry) -> tuple[int, ...]:
    return tuple(frame.number for frame in dataset.frames_of(camera))


def _named(cameras: list[CameraEntry]) -> dict[str, bool]:
    """The cameras as an opened build lists them, and whether each is plenoptic."""
    return {
        name_with(camera.name, channel or None): _is_plenoptic(camera)
        for camera in sorted(cameras, key=lambda camera: camera.name)
        for channel in [channel.name for channel in camera.channels] or [""]
    }


def _views(dataset: Dataset, cameras: list[CameraEntry], bare: Things) -> tuple[SeenFrame, ...]:
    return tuple(
        SeenFrame(
            camera=camera.name,
            number=frame.number,
            view=PlacedView(
                targets=bare.targets(target_poses(dataset, frame, camera.name)),
                occluders=bare.occluders(frame, camera.name),
            ),
        )
        for camera in cameras
        for frame in dataset.frames_of(camera)
    )
