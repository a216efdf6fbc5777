"""Graph of tasks of a dataset, and the list of files that a build delivers.

Params hold exactly what a task reads, in the camera's own frame, so that moving a rig does not affect any ray. Names
appear only in the params of tasks that write them.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from pipeline.camera.focusing.focus_request import FocusRequest, shown_f_number
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.entry_points import plugged_in
from pipeline.graph.adding import add, add_strips, add_tiles
from pipeline.graph.derivatives import add_derivatives
from pipeline.graph.exports import add_exports
from pipeline.graph.frame_tasks import FrameTasks, channel_label, exposure_of, light_of
from pipeline.graph.poses import Things, matrix, poses_at_lines, target_poses, targets_json
from pipeline.graph.settled import camera_task
from pipeline.graph.tiles import bundle_bands, image_bands, microlens_tiles, strips
from pipeline.render.sensor.response import Irradiation
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.scene.usd.problems import blamed_on
from pipeline.targets.target import Target, plain_from_target
from pipeline.tasks.params import cameras, frames, outputs


class DatasetGraph(NamedTuple):
    """All tasks of a dataset, the sources of the files in the output folder, and the certificate of each camera."""

    graph: TaskGraph
    files: dict[str, Source]
    certificates: dict[str, tuple[str, str]]


def graph_of(dataset: Dataset) -> DatasetGraph:
    """The tasks of a dataset, and what its build delivers."""
    made = graph, files, certificates = DatasetGraph(TaskGraph(), {}, {})
    scenes = _scenes(dataset)
    things = scenes.LitThings if scenes and _is_lit(dataset) else Things
    painted, bare = (things(dataset, painted=painted) for painted in (True, False))
    for entry in dataset.targets:
        files[f"targets/{entry.name}.json"] = targets_json(entry)
        if isinstance(entry.target, Target):
            sheet = frames.Sheet(target=plain_from_target(entry.target))
            files[entry.picture_file] = (add(graph, f"sheet/{entry.name}", sheet), frames.SHEET)
    if scenes:
        scenes.add_pictures(graph, files, dataset)
    for camera in dataset.cameras:
        with blamed_on(camera.file, camera.line, camera.prim_path):
            _add_camera(graph, files, camera)
            parts = cameras.Parts(meters_per_unit=dataset.meters_per_unit, up_axis=dataset.up_axis)
            task = add(graph, f"parts/{camera.name}", parts, {"camera": camera_task(graph, camera)})
            files[camera.parts_file] = (task, cameras.PARTS)
            _add_poses(graph, files, dataset, camera)
            for seen in camera.in_channels:
                _add_light(graph, files, seen)
                tasks = FrameTasks(graph, files, dataset, seen, painted, bare)
                for frame in dataset.frames_of(camera):
                    tasks.add(frame)
                certificates[seen.full_name] = (tasks.add_certificate(), "certificate.json")
            add_derivatives(graph, files, dataset, camera)
            _add_colours(graph, files, camera, dataset)
            add_raw(graph, files, camera, dataset)
    for camera in dataset.cameras if scenes else ():  # flow reads a camera in its next state, too
        scenes.add_labels(graph, files, dataset, camera, bare)
    if any(len(frame.camera_from_world) > 1 for frame in dataset.frames):
        files["baselines.csv"] = (_add_baselines(graph, dataset), frames.BASELINES)
    add_exports(graph, files, dataset)
    return made


def _is_lit(dataset: Dataset) -> bool:
    return bool(dataset.lamps) or any(occluder.finish for occluder in dataset.occluders)


def _scenes(dataset: Dataset) -> Any:
    """The plug-in with the tasks of lamps, pictures and labels; None: the dataset has none of these."""
    has_labels = any(camera.labels for camera in dataset.cameras)
    return plugged_in("scene", "tasks") if _is_lit(dataset) or dataset.pictures or has_labels else None


def _add_baselines(graph: TaskGraph, dataset: Dataset) -> str:
    names = [camera.name for camera in dataset.cameras]
    in_frames = []
    for frame in dataset.frames:
        there = frame.camera_from_world
        poses = tuple(matrix(np.array(there[name])) if name in there else None for name in names)
        in_frames.append(frames.RigFrame(number=frame.number, camera_from_world=poses))
    reads = {f"pinhole{i}": f"pinhole/{name}" for i, name in enumerate(names)}
    return add(graph, "baselines", frames.Baselines(cameras=tuple(names), frames=tuple(in_frames)), reads)


def _add_poses(graph: TaskGraph, files: dict[str, Source], dataset: Dataset, entry: CameraEntry) -> None:
    posed = [
        frames.PosedFrame(
            number=frame.number,
            camera_from_world=matrix(np.array(frame.camera_from_world[entry.name])),
            targets={name: matrix(pose) for name, pose in target_poses(dataset, frame, entry.name).items()},
            at_lines=poses_at_lines(dataset, frame, entry),
        )
        for frame in dataset.frames_of(entry)
    ]
    params = frames.FramePoses(camera=entry.name, frames=tuple(posed))
    task = add(graph, f"frame_poses/{entry.name}", params, {"pinhole": f"pinhole/{entry.name}"})
    for frame in dataset.frames_of(entry):
        files[f"frames/{frame.number:04d}/{entry.name}/poses.json"] = (task, frames.poses_file(frame.number))


def _add_camera(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry) -> None:
    name, folder = entry.name, f"cameras/{entry.name}"
    reads = {"camera": camera_task(graph, entry, has_planes=True)}
    pinhole = add(graph, f"pinhole/{name}", cameras.Nothing(), reads)
    if entry.windows and entry.channels:
        reads["alone"] = camera_task(graph, entry, is_alone=True)
    report = add(graph, f"first_order/{name}", labels_of(entry), {**reads, "pinhole": pinhole})
    files[f"{folder}/camera.json"] = (report, "camera.json")
    if entry.shutter:
        files[f"{folder}/{cameras.TIMES}"] = (report, cameras.TIMES)


def _add_light(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry) -> None:
    """The tasks that follow the light of a camera, or of one of its channels: bundles and white images."""
    name, folder, reads = (
        entry.full_name,
        f"cameras/{entry.folder}",
        {"camera": camera_task(graph, entry, is_alone=True)},
    )
    if entry.delivers_rays or entry.truth.searches:
        with_planes = {"camera": camera_task(graph, entry, is_alone=True, has_planes=True)}
        files[f"{folder}/rays.exr"] = (_add_rays(graph, entry, with_planes), "rays.exr")
    files |= _white_files(_add_white(graph, entry, reads, name), f"{folder}/white", f"{folder}/")
    for f_number in entry.f_numbers:
        shown = shown_f_number(f_number)
        stopped = camera_task(graph, entry, is_alone=True, f_number=f_number)
        at = f"{folder}/white/{shown}"
        white = _add_white(graph, entry, {"camera": stopped}, f"{name}/{shown}")
        files |= _white_files(white, at, f"{at}.")


def _add_colours(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry, dataset: Dataset) -> None:
    """The tasks that join the images of the channels of a camera; none for a camera of one wavelength."""
    seen = entry.in_channels if entry.channels else ()
    labels = tuple(label for camera in seen if (label := channel_label(camera)))
    numbers = [frame.number for frame in dataset.frames_of(entry)]
    images = [("white", "", f"cameras/{entry.name}")]
    images += [("image", f"/{frame:04d}", f"frames/{frame:04d}/{entry.name}") for frame in numbers]
    for kind, frame, folder in images if seen else ():
        reads = {f"channel{i}": f"{kind}/{camera.full_name}{frame}" for i, camera in enumerate(seen)}
        params = outputs.ColourImage(name=kind, channels=labels, colorimetry=next(iter(entry.colorimetry), None))
        joined = add(graph, f"colour_image/{entry.name}{frame}", params, reads)
        files |= {f"{folder}/{kind}.{ending}": (joined, f"{kind}.{ending}") for ending in ("exr", "png")}
        if params.is_spectral:
            files[f"{folder}/{outputs.SPECTRAL}"] = (joined, outputs.SPECTRAL)


def _add_white(graph: TaskGraph, entry: CameraEntry, reads: dict[str, str], name: str) -> tuple[str, str | None]:
    """Add the tasks of a camera's white image and, if any, of its tables of micro-images, for the stop as set."""
    exposure, noise, sensor = exposure_of(entry), entry.image_noise, entry.asked.sensor
    is_smooth = entry.asked.microlenses is None and not exposure.diffraction
    if noise is None:
        bands = image_bands(sensor, entry.image_samples)
        parts = [cameras.White(exposure=exposure, rows=rows, is_smooth=is_smooth) for rows in bands]
        tiles = add_tiles(graph, f"white_tile/{name}", parts, reads)
        params = cameras.White(exposure=exposure, tiles=len(tiles), is_smooth=is_smooth)
    else:
        first = [cameras.White(exposure=exposure, rows=rows, is_smooth=is_smooth) for rows in strips(sensor)]
        tiles = add_strips(graph, f"white/{name}", first, reads, noise)
        params = cameras.White(exposure=exposure, tiles=len(first), is_smooth=is_smooth, noise=noise)
    white = add(graph, f"white/{name}", params, {**reads, **tiles})
    return white, _add_micro_images(graph, entry, reads, name) if entry.asked.microlenses else None


def _white_files(tasks: tuple[str, str | None], white_at: str, tables_at: str) -> dict[str, Source]:
    """Files of a white image and of its tables, which begin with `white_at` and `tables_at`."""
    white, tables = tasks
    files: dict[str, Source] = {f"{white_at}.{kind}": (white, f"white.{kind}") for kind in ("exr", "png")}
    if tables is not None:
        files |= {f"{tables_at}{table}": (tables, table) for table in ("micro_images.csv", "micro_image_outlines.csv")}
    return files


def _add_micro_images(graph: TaskGraph, entry: CameraEntry, reads: dict[str, str], name: str) -> str:
    assert entry.asked.microlenses is not None
    count = microlens_tiles(entry.asked.sensor, entry.asked.microlenses)
    parts = [cameras.MicroImagesTile(tile=number, tiles=count) for number in range(count)]
    tiles = add_tiles(graph, f"micro_images_tile/{name}", parts, reads)
    return add(graph, f"micro_images/{name}", cameras.MicroImageTables(tiles=len(tiles)), {**reads, **tiles})


def labels_of(entry: CameraEntry) -> cameras.CameraLabels:
    """Labels of a camera in camera.json, besides its figures."""
    asked, focus = entry.asked, None
    if isinstance(asked, FocusRequest):
        focus = cameras.FocusLabels(
            focus_distance_mm=asked.focus_distance_mm,
            focus_type=None if asked.focus_distance_mm is None else asked.type,
            focus_groups=asked.focus_groups,
            group_shift_mm=entry.group_shift_mm,
            stop_match="microlenses" if asked.match_stop else "none",
        )
    return cameras.CameraLabels(
        circle_of_confusion_px=asked.circle_of_confusion_px,
        lens_name=entry.lens_name,
        index_source=entry.index_source,
        light=light_of(entry),
        focus_request=focus,
        channels=entry.channels,
        shutter=entry.shutter and dataclasses.replace(entry.shutter, instants=1),
        windows=entry.windows if entry.channels else None,
    )


def _add_rays(graph: TaskGraph, entry: CameraEntry, reads: dict[str, str]) -> str:
    parts = [
        cameras.RaysTile(first_row=first, end_row=end, sampling=entry.sampling, square_px=entry.square_px)
        for first, end in bundle_bands(entry.asked.sensor, entry.sampling)
    ]
    tiles = add_tiles(graph, f"rays_tile/{entry.full_name}", parts, reads, least=1)
    params = cameras.JoinedRays(tiles=len(tiles), sampling=entry.sampling, light=light_of(entry))
    return add(graph, f"rays/{entry.full_name}", params, {**reads, **tiles})


def add_raw(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry, dataset: Dataset) -> None:
    """Add the raw images of a camera in all frames, and their fixed pattern, if the stage says how much light falls."""
    name, response, irradiation, sensor = entry.name, entry.response, entry.irradiation, entry.asked.sensor
    if response is None or irradiation is None:
        return
    of_cameras = {"camera": camera_task(graph, entry)}
    seen = {camera.channel.name: camera for camera in entry.in_channels if camera.channel}
    channels = [radiance.channel for radiance in irradiation.channels]
    of_cameras |= {f"camera_{channel}": camera_task(graph, seen[channel]) for channel in channels if channel}
    # Behind microlenses the share is that of the axis everywhere.
    lossy = None if entry.asked.microlenses else _lossy(irradiation)
    if lossy is not None:
        transmission = add(graph, f"transmission/{name}", lossy, of_cameras)
        files[f"cameras/{name}/{outputs.TRANSMISSION}"] = (transmission, outputs.TRANSMISSION)
    for frame in dataset.frames_of(entry):
        params = outputs.Expose(
            camera=name,
            frame=frame.number,
            seed=entry.sampling.seed,
            response=response,
            irradiation=irradiation,
            colorimetry=entry.colorimetry,
        )
        of_channels = [channel for channel in response.channels if channel in seen]
        images = {f"image_{channel}": f"image/{seen[channel].full_name}/{frame.number:04d}" for channel in of_channels}
        images = images or {"image": f"image/{name}/{frame.number:04d}"}
        reads = images | of_cameras | ({"transmission": f"transmission/{name}"} if lossy else {})
        raw = add(graph, f"expose/{name}/{frame.number:04d}", params, reads)
        files |= {
            f"frames/{frame.number:04d}/{name}/{file}": (raw, file)
            for file in (outputs.TIFF, outputs.DNG, outputs.PREVIEW)
        }
    pattern = outputs.PatternMaps(camera=name, shape=(sensor.height_px, sensor.width_px), spread=response.spread)
    files[f"cameras/{name}/{outputs.MAPS}"] = (add(graph, f"fixed_pattern/{name}", pattern), outputs.MAPS)


def _lossy(irradiation: Irradiation) -> outputs.Transmission | None:
    """Losses of an exposure by radiance in the lens; None: there are none."""
    radiances = [radiance for radiance in (irradiation.radiance, *irradiation.channels) if radiance]
    lights = [outputs.LossesOfLight(channel=radiance.channel, of_each=radiance.losses) for radiance in radiances]
    return outputs.Transmission(lights=tuple(lights)) if any(any(light.of_each) for light in lights) else None
