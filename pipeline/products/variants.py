"""Variants of a build: previews, which are images only, a quarter of the size and with few samples; builds without
pictures; and tasks on a chosen device. Previews and devices have keys of their own, and previews a folder of their own.
"""

import dataclasses
import math
from pathlib import Path

from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.parts.camera import Camera
from pipeline.engine.options import BuildOptions
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.engine.project import Project, maker_of
from pipeline.engine.records import Params
from pipeline.errors import UsageError
from pipeline.formats import Reads, format_of
from pipeline.products.images.params import Rendering
from pipeline.products.rays.params import RaysTile
from pipeline.scene.dataset import CameraEntry, Dataset

SHRINK = 4
"""Pixels along each axis that become one in a preview: a sixteenth of the rays, and details remain recognisable."""
SAMPLES = 16
"""Most rays per pixel and microlens: noise of about one 8-bit step on a pixel that an edge crosses."""


def preview_of(dataset: Dataset) -> Dataset:
    """The dataset with few, large pixels on the same sensors, and few samples."""
    return dataclasses.replace(dataset, cameras=tuple(map(_small, dataset.cameras)))


def _small(entry: CameraEntry) -> CameraEntry:
    return dataclasses.replace(
        entry,
        asked=_coarse(entry.asked),
        image_samples=min(SAMPLES, entry.image_samples),
        image_noise=None,
        f_numbers=(),
        labels=(),
    )


def _coarse(camera: Camera | FocusRequest) -> Camera | FocusRequest:
    """The camera with pixels four times as wide, about the centre; its sensor may be up to three old pixels larger."""
    sensor = camera.sensor
    coarse = dataclasses.replace(
        sensor,
        width_px=math.ceil(sensor.width_px / SHRINK),
        height_px=math.ceil(sensor.height_px / SHRINK),
        pitch_mm=sensor.pitch_mm * SHRINK,
    )
    return dataclasses.replace(camera, sensor=coarse)


def only_images(project: Project) -> Project:
    """The part of a project that makes pictures to look at: `image.png` and `white.png`."""
    files = {path: source for path, source in project.files.items() if path.endswith(("/image.png", "/white.png"))}
    tasks = {source[0] for source in files.values() if not isinstance(source, bytes)}
    return dataclasses.replace(
        project,
        graph=project.graph.up_to(tasks),
        files=files,
        findings={},
        source=None,
        stage_id=f"{project.stage_id} preview",
    )


def without_pictures(project: Project) -> Project:
    """The part of a project that makes tables and records: no image, label or map of rays of a camera, and no export
    that reads one.
    """
    exports = {name: project.graph[name] for name in project.graph if project.graph[name].after_delivery}
    left_out = {name for name, task in exports.items() if Reads.IMAGES in format_of(task.params["format"]).reads}
    kept_exports = exports.keys() - left_out
    files = {
        path: source
        for path, source in project.files.items()
        if not (path.startswith(("cameras/", "frames/")) and path.endswith(PICTURES))
        and maker_of(project, path) not in left_out
    }
    makers = {source[0] for source in files.values() if not isinstance(source, bytes)}
    makers |= {task for outputs in project.findings.values() for task, _ in outputs.values()}
    graph = project.graph.up_to(makers - kept_exports)
    for name in sorted(kept_exports):
        reads = {role: source for role, source in exports[name].reads.items() if source in graph}
        graph.put(dataclasses.replace(exports[name], reads=reads))
    return dataclasses.replace(project, graph=graph, files=files, head={**project.head, "pictures": False})


def folder_of(out: Path) -> Path:
    """Output folder of the preview beside that of the dataset: `build/02_plenoptic.preview`."""
    return out.with_name(f"{out.name}.preview")


PICTURES = (".exr", ".png", ".tiff", ".dng")
"""Ends of the names of files with a value per pixel."""
DEVICES = ("cuda",)
"""Devices that can trace rays: bundles of position images in float64, images in float32."""


def on_device(project: Project, options: BuildOptions) -> Project:
    """The same project with the chosen device for tasks that can run there; its name is one of their params, so it
    enters their keys.

    Raises UsageError: no device has that name, or other options exclude a device.
    Raises EnvironmentFault: the device cannot be used on this machine.
    """
    if options.device not in DEVICES:
        raise UsageError(f'there is no device "{options.device}"', hint=f"--device takes {', '.join(DEVICES)}")
    if options.engine:
        raise UsageError("--device does not go with --engine", hint="leave one out")
    from pipeline.jit.device import device_name

    device = device_name()
    graph = TaskGraph(project.graph.packages)
    for task in map(project.graph.__getitem__, project.graph):
        graph.put(dataclasses.replace(task, params=_on(device, task)))
    return dataclasses.replace(project, graph=graph)


def _on(device: str, task: Task) -> Params:
    """Parameters of a task with the device, if it can use one: not of smooth white images, made by quadrature."""
    record = task.record or object
    if issubclass(record, RaysTile):
        return {**task.params, "device": device}
    if issubclass(record, Rendering) and not task.params.get("is_smooth"):
        return {**task.params, "exposure": {**task.params["exposure"], "device": device}}
    return task.params
