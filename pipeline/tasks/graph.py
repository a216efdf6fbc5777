"""From a dataset to its graph of tasks, and to the list of files that a build delivers.

Params hold exactly what a task reads, in the camera's own frame, so that moving a rig touches no ray. Names stand only
in the params of the tasks that write them.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.camera.camera import Camera
from pipeline.camera.request import FocusRequest, group_shift, solved
from pipeline.camera.stop import shown_f_number
from pipeline.engine.deliver import Source
from pipeline.engine.graph import TaskGraph
from pipeline.frames import apply
from pipeline.records import from_plain, to_plain
from pipeline.scene.dataset import CameraEntry, Dataset, Frame, TargetEntry
from pipeline.tasks.poses import poses_json, targets_json, vision_from_target
from pipeline.tasks.rays_tile import tile_rows
from pipeline.tasks.things import Things, matrix
from pipeline.truth.on_points import plane_name
from pipeline.truth.settings import TruthSettings

_KIND = "pipeline.tasks."


def graph_of(dataset: Dataset) -> tuple[TaskGraph, dict[str, Source], dict[str, tuple[str, str]]]:
    """All tasks of a dataset, what of their outputs lies where in the output folder, and each camera's certificate."""
    graph, files, certificates = TaskGraph(), dict[str, Source](), dict[str, tuple[str, str]]()
    things = {painted: Things(dataset, painted=painted) for painted in (True, False)}
    for entry in dataset.targets:
        files[f"targets/{entry.name}.json"] = targets_json(entry)
    for camera in dataset.cameras:
        _add_camera(graph, files, camera)
        for frame in dataset.frames:
            _add_frame(graph, files, dataset, camera, frame, things)
        certificates[camera.name] = (_add_certificate(graph, camera, dataset.frames, things[False]), "certificate.json")
    return graph, files, certificates


def _add_camera(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry) -> None:
    name, folder = entry.name, f"cameras/{entry.name}"
    asked = "request" if isinstance(entry.camera, FocusRequest) else "camera"
    plain = to_plain(_nameless(entry.camera))
    planes = {field: plain.pop(field) for field in ("near_mm", "far_mm", "circle_of_confusion_px")}
    reads = {"camera": graph.add(f"focus/{name}", f"{_KIND}focus", {asked: plain})}
    settled = {**reads, "planes": graph.add(f"planes/{name}", f"{_KIND}planes", planes, reads)}
    params = {"labels": labels_of(entry), "circle_of_confusion_px": planes["circle_of_confusion_px"]}
    report = graph.add(f"first_order/{name}", f"{_KIND}first_order", params, settled)
    if entry.truth["method"] != "direct":
        files[f"{folder}/rays.exr"] = (_add_rays(graph, entry, settled), "rays.exr")
    files[f"{folder}/camera.json"] = (report, "camera.json")
    _add_white(graph, files, entry, reads, name, f"{folder}/white", f"{folder}/")
    for f_number in entry.f_numbers:
        shown = shown_f_number(f_number)
        stopped = graph.add(f"stop/{name}/{shown}", f"{_KIND}stop", {"f_number": f_number}, reads)
        at = f"{folder}/white/{shown}"
        _add_white(graph, files, entry, {"camera": stopped}, f"{name}/{shown}", at, f"{at}.")


def _add_white(
    graph: TaskGraph,
    files: dict[str, Source],
    entry: CameraEntry,
    reads: dict[str, str],
    name: str,
    white_at: str,
    tables_at: str,
) -> None:
    """The white image and the micro-images of a camera with its stop as set."""
    white = graph.add(f"white/{name}", f"{_KIND}white", _image_params(entry), reads)
    files[f"{white_at}.exr"] = (white, "white.exr")
    files[f"{white_at}.png"] = (white, "white.png")
    if entry.camera.microlenses:
        tables = graph.add(f"micro_images/{name}", f"{_KIND}micro_images", {}, reads)
        for table in ("micro_images.csv", "micro_image_outlines.csv"):
            files[f"{tables_at}{table}"] = (tables, table)


def _nameless(camera: Camera | FocusRequest) -> Camera | FocusRequest:
    """The same camera with the groups of its lens numbered: what they are called bends no ray."""
    groups = camera.prescription.groups
    numbered = tuple(dataclasses.replace(group, name=str(number)) for number, group in enumerate(groups))
    nameless = dataclasses.replace(camera, prescription=dataclasses.replace(camera.prescription, groups=numbered))
    if isinstance(nameless, Camera):
        return nameless
    numbers = {group.name: str(number) for number, group in enumerate(groups)}
    return dataclasses.replace(nameless, focus_groups=tuple(sorted(numbers[name] for name in nameless.focus_groups)))


def labels_of(entry: CameraEntry) -> dict[str, Any]:
    """What camera.json says of a camera besides its figures."""
    names = ("lens_name", "index_source", "weight", "footprint", "wavelength_nm")
    labels = {key: getattr(entry, key) for key in names}
    asked = entry.camera
    if isinstance(asked, FocusRequest):
        labels["focus_request"] = {
            "focus_distance_mm": asked.focus_distance_mm,
            "focus_type": None if asked.focus_distance_mm is None else asked.type,
            "focus_groups": list(asked.focus_groups),
            "group_shift_mm": group_shift(asked) if asked.focus_groups else None,
            "stop_match": "microlenses" if asked.match_stop else "none",
        }
    return labels


def _add_rays(graph: TaskGraph, entry: CameraEntry, reads: dict[str, str]) -> str:
    """The tile tasks of a camera and the task that joins them; returns its name."""
    sensor, sampling = entry.camera.sensor, to_plain(entry.sampling)
    rows = tile_rows(sensor.width_px, sensor.height_px, entry.sampling.supersampling, entry.sampling.samples)
    tiles = {
        f"tile{number}": graph.add(
            f"rays_tile/{entry.name}/{number:04d}",
            f"{_KIND}rays_tile",
            {"first_row": first, "end_row": end, **sampling, "square_px": entry.square_px},
            reads,
        )
        for number, (first, end) in enumerate(rows)
    }
    light = {"weight": entry.weight, "footprint": entry.footprint, "wavelength_nm": entry.wavelength_nm}
    params = {"tiles": len(tiles), **sampling, **light}
    return graph.add(f"rays/{entry.name}", f"{_KIND}rays", params, {**reads, **tiles})


def _image_params(entry: CameraEntry) -> dict[str, Any]:
    return {
        "samples": entry.image_samples,
        "seed": entry.sampling.seed,
        "weight": entry.weight,
        "wavelength_nm": entry.wavelength_nm,
    }


def _add_frame(
    graph: TaskGraph,
    files: dict[str, Source],
    dataset: Dataset,
    entry: CameraEntry,
    frame: Frame,
    things: dict[bool, Things],
) -> None:
    """The tasks of a camera in a frame."""
    name, folder = f"{entry.name}/{frame.number:04d}", f"frames/{frame.number:04d}/{entry.name}"
    reads = {"camera": f"focus/{entry.name}"}
    poses = {target.name: vision_from_target(frame, entry.name, target.name) for target in dataset.targets}
    image = graph.add(f"image/{name}", f"{_KIND}image", _frame_image_params(dataset, entry, frame, things[True]), reads)
    truth_reads = dict(reads)
    if entry.truth["method"] != "direct":
        truth_reads["rays"] = f"rays/{entry.name}"
        if entry.camera.microlenses:
            truth_reads["micro_images"] = f"micro_images/{entry.name}"
    if entry.truth["method"] == "image":
        planes = [plane for target in dataset.targets for plane in _tangent_planes(target, poses[target.name])]
        light = {"weight": entry.weight, "footprint": entry.footprint, "wavelength_nm": entry.wavelength_nm}
        light["square_px"] = entry.square_px
        params = {"planes": planes, "extent": entry.extent, **to_plain(entry.sampling), **light}
        truth_reads["positions"] = graph.add(f"positions/{name}", f"{_KIND}positions", params, reads)
        files[f"{folder}/positions.exr"] = (truth_reads["positions"], "positions.exr")
    needs_paint = "saddle" in from_plain(TruthSettings, entry.truth).column_sets
    params = _truth_params(entry, frame, things[needs_paint])
    truth = graph.add(f"truth/{name}", f"{_KIND}truth", params, truth_reads)
    files[f"{folder}/poses.json"] = poses_json(frame, entry.name, poses)
    files[f"{folder}/image.exr"] = (image, "image.exr")
    files[f"{folder}/image.png"] = (image, "image.png")
    files[f"{folder}/correspondences.csv"] = (truth, "correspondences.csv")


def _frame_image_params(dataset: Dataset, entry: CameraEntry, frame: Frame, things: Things) -> dict[str, Any]:
    targets = [{key: target[key] for key in target if key != "name"} for target in things.targets(frame, entry.name)]
    occluders = things.occluders(frame, entry.name)
    return {**_image_params(entry), "targets": targets, "background": dataset.background, "occluders": occluders}


def _tangent_planes(entry: TargetEntry, vision_from_target: np.ndarray) -> list[dict[str, Any]]:
    """Name, pose and points (vision frame) of every tangent plane of a target; those that face away are named alike."""
    points = entry.target.points()
    return [
        {
            "name": plane_name(entry.name, number, len(points.frames)),
            "vision_from_target": matrix(vision_from_target @ plane.target_from_plane),
            "points_mm": apply(vision_from_target, points.position_mm[plane.members]).tolist(),
        }
        for number, plane in enumerate(points.planes())
    ]


def _add_certificate(graph: TaskGraph, entry: CameraEntry, frames: Sequence[Frame], things: Things) -> str:
    posed = [{"number": frame.number, "targets": things.targets(frame, entry.name)} for frame in frames]
    reads = {f"frame{frame.number}": f"truth/{entry.name}/{frame.number:04d}" for frame in frames}
    claim_px = from_plain(TruthSettings, entry.truth).claim_px
    judged = {"claim_px": claim_px, "square_px": entry.square_px}
    params = {"frames": posed, **judged, "seed": entry.sampling.seed}
    return graph.add(
        f"certificate/{entry.name}", f"{_KIND}certificate", params, {"camera": f"focus/{entry.name}", **reads}
    )


def _truth_params(entry: CameraEntry, frame: Frame, things: Things) -> dict[str, Any]:
    labels = {
        "weight": entry.weight,
        "wavelength_nm": entry.wavelength_nm,
        "index_source": entry.index_source,
        "footprint": entry.footprint,
        "stop": solved(entry.camera).prescription.stop.aperture,
        "seed": entry.sampling.seed,
    }
    if entry.truth["method"] != "direct":
        labels["samples"] = entry.sampling.samples
    return {
        "frame": frame.number,
        "camera": entry.name,
        "targets": things.targets(frame, entry.name),
        "occluders": things.occluders(frame, entry.name),
        "truth": to_plain(entry.truth),
        "square_px": entry.square_px,
        "labels": labels,
    }
