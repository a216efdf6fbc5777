"""The tasks of exports that a stage asks for: one per format, which reads the delivered folder."""

from pipeline.channel_names import name_with
from pipeline.engine.digest import key_of
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.exports.noise import Noise
from pipeline.exports.writer_code import code_of_writer
from pipeline.formats import Reads, folder_of, format_of
from pipeline.graph.adding import KINDS
from pipeline.records.plain import to_plain
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.tasks.params.outputs import Export


def add_exports(graph: TaskGraph, files: dict[str, Source], dataset: Dataset) -> None:
    """Add the exports of a dataset, after all other tasks; `files`, those of all of these, receives theirs."""
    asked = dataset.exports
    written = {path: source.decode() for path, source in files.items() if isinstance(source, bytes)}
    makers = {source[0] for source in files.values() if not isinstance(source, bytes)}
    reads = {name: name for name in graph if name in makers or not graph.readers(name)}
    for name in asked.formats:
        wanted = format_of(name)
        cameras = sorted(
            (camera for camera in dataset.cameras if wanted.takes(_is_plenoptic(camera))), key=lambda each: each.name
        )
        named = {
            name_with(camera.name, channel or None): camera
            for camera in cameras
            for channel in [channel.name for channel in camera.channels] or [""]
        }
        params = Export(
            format=name,
            code=code_of_writer(name),
            position=asked.position,
            noise=Noise(**asked.noise) if Reads.CORNERS in wanted.reads else Noise(),  # type: ignore[arg-type]  # scene knows no Noise
            stage=f"</{dataset.stage_name}>",
            cameras=tuple(named),
            written=key_of("written/v1", written),
        )
        folder = folder_of(name, asked.position)
        task = Task(
            name=f"export/{folder}", kind=KINDS["export"], params=to_plain(params), reads=reads, after_delivery=True
        )
        graph.put(task)
        plenoptic = {full_name: _is_plenoptic(camera) for full_name, camera in named.items()}
        numbers = {
            full_name: tuple(frame.number for frame in dataset.frames_of(camera)) for full_name, camera in named.items()
        }
        for path in wanted.paths(plenoptic, numbers, len(dataset.targets)):
            files[f"exports/{folder}/{path}"] = (task.name, path)


def _is_plenoptic(camera: CameraEntry) -> bool:
    return camera.asked.microlenses is not None
