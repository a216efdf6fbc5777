"""Product exports/: the delivered folder in the formats of other programs that a stage asks for, a task for each."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.channel_names import name_with
from pipeline.engine.digest import key_of
from pipeline.exports.noise import Noise
from pipeline.exports.writer_code import code_of_writer, require_code
from pipeline.formats import Reads, folder_of, format_of

if TYPE_CHECKING:
    from pipeline.products.draft import Draft
    from pipeline.scene.dataset import CameraEntry


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """An export of one format.

    `code`: digest of the code that writes the format, which no import of the task names.
    `stage`: name of the dataset, which the files mention.
    `cameras`: names of those that the format can describe.
    `written`: digest of the files that are written from the stage itself.
    """

    format: str
    code: str
    position: str
    noise: Noise
    stage: str
    cameras: tuple[str, ...]
    written: str


def plan_exports(draft: "Draft") -> None:
    """Add the exports of a dataset, after all other tasks."""
    dataset = draft.dataset
    graph = draft.graph
    written = {path: source.decode() for path, source in draft.files.items() if isinstance(source, bytes)}
    makers = {source[0] for source in draft.files.values() if not isinstance(source, bytes)}
    reads = {name: name for name in graph if name in makers or not graph.readers(name)}
    for name in dataset.exports.formats:
        export_format = format_of(name)
        cameras = {
            name_with(camera.name, channel or None): camera
            for camera in sorted(dataset.cameras, key=lambda camera: camera.name)
            if export_format.takes(_is_plenoptic(camera))
            for channel in [channel.name for channel in camera.channels] or [""]
        }
        noise = Noise(**dataset.exports.noise)  # type: ignore[arg-type]  # scene knows no Noise
        params = Export(
            format=name,
            code=code_of_writer(name),
            position=dataset.exports.position,
            noise=noise if Reads.CORNERS in export_format.reads else Noise(),
            stage=f"</{dataset.stage_name}>",
            cameras=tuple(cameras),
            written=key_of("written/v1", written),
        )
        folder = folder_of(name, dataset.exports.position)
        task = draft.add(f"export/{folder}", params, reads, after_delivery=True)
        plenoptic = {full_name: _is_plenoptic(camera) for full_name, camera in cameras.items()}
        numbers = {name: [frame.number for frame in dataset.frames_of(camera)] for name, camera in cameras.items()}
        for path in export_format.paths(plenoptic, numbers, len(dataset.targets)):
            draft.files[f"exports/{folder}/{path}"] = (task, path)


def _is_plenoptic(camera: "CameraEntry") -> bool:
    return camera.asked.microlenses is not None


def export(params: Export, folder: Path, out: Path) -> None:
    """Write the files of the format, and export.json, as `pipeline export` does."""
    from pipeline.exports.export import Request, write_export  # a plan opens no folder
    from pipeline.results.output import open_output

    require_code(params.format, params.code)
    output = replace(open_output(folder), stage=params.stage)
    request = Request(only=params.cameras, position=params.position, noise=params.noise)
    write_export(output, params.format, out, request)
