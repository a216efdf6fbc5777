"""From a dataset to its graph of tasks, and to the list of files that a build delivers.

Params hold exactly what a task reads, in the camera's own frame, so that moving a rig touches no ray. Names stand only
in the params of the tasks that write them.
"""

import dataclasses
from typing import Any

from pipeline.camera.camera import Camera
from pipeline.camera.request import FocusRequest, group_shift
from pipeline.camera.stop import shown_f_number
from pipeline.engine.deliver import Source
from pipeline.engine.graph import TaskGraph
from pipeline.records import from_plain, to_plain
from pipeline.scene.dataset import CameraEntry, Dataset
from pipeline.scene.problems import blamed_on
from pipeline.tasks.baselines import BASELINES
from pipeline.tasks.frame_tasks import KIND, FrameTasks, add_tiles, image_params
from pipeline.tasks.poses import targets_json
from pipeline.tasks.things import Things
from pipeline.tasks.tiles import bundle_bands, image_bands, microlens_tiles
from pipeline.truth.settings import TruthSettings


def graph_of(dataset: Dataset) -> tuple[TaskGraph, dict[str, Source], dict[str, tuple[str, str]]]:
    """All tasks of a dataset, what of their outputs lies where in the output folder, and each camera's certificate."""
    graph, files, certificates = TaskGraph(), dict[str, Source](), dict[str, tuple[str, str]]()
    painted, bare = (Things(dataset, painted=painted) for painted in (True, False))
    for entry in dataset.targets:
        files[f"targets/{entry.name}.json"] = targets_json(entry)
    for camera in dataset.cameras:
        with blamed_on(camera.file, camera.line, camera.prim_path):
            _add_camera(graph, files, camera)
            tasks = FrameTasks(graph, files, dataset, camera, painted, bare)
            for frame in dataset.frames:
                tasks.add(frame)
            tasks.add_poses()
            certificates[camera.name] = (tasks.add_certificate(), "certificate.json")
    if len(dataset.cameras) > 1:
        files["baselines.csv"] = (_add_baselines(graph, dataset), BASELINES)
    return graph, files, certificates


def _add_baselines(graph: TaskGraph, dataset: Dataset) -> str:
    """The task that says how the cameras stand to each other; gives its name."""
    names = [camera.name for camera in dataset.cameras]
    frames = [
        {"number": frame.number, "camera_from_world": [frame.camera_from_world[name] for name in names]}
        for frame in dataset.frames
    ]
    reads = {f"pinhole{i}": f"pinhole/{name}" for i, name in enumerate(names)}
    return graph.add("baselines", f"{KIND}baselines", {"cameras": names, "frames": to_plain(frames)}, reads)


def _add_camera(graph: TaskGraph, files: dict[str, Source], entry: CameraEntry) -> None:
    name, folder = entry.name, f"cameras/{entry.name}"
    asked = "request" if isinstance(entry.asked, FocusRequest) else "camera"
    plain = to_plain(_nameless(entry.asked))
    planes = {field: plain.pop(field) for field in ("near_mm", "far_mm", "circle_of_confusion_px")}
    reads = {"camera": graph.add(f"focus/{name}", f"{KIND}focus", {asked: plain})}
    settled = {**reads, "planes": graph.add(f"planes/{name}", f"{KIND}planes", planes, reads)}
    pinhole = graph.add(f"pinhole/{name}", f"{KIND}pinhole", {}, settled)
    params = {"labels": labels_of(entry), "circle_of_confusion_px": planes["circle_of_confusion_px"]}
    report = graph.add(f"first_order/{name}", f"{KIND}first_order", params, {**settled, "pinhole": pinhole})
    if entry.delivers_rays or from_plain(TruthSettings, entry.truth).searches:
        files[f"{folder}/rays.exr"] = (_add_rays(graph, entry, settled), "rays.exr")
    files[f"{folder}/camera.json"] = (report, "camera.json")
    _add_white(graph, files, entry, reads, name, f"{folder}/white", f"{folder}/")
    for f_number in entry.f_numbers:
        shown = shown_f_number(f_number)
        stopped = graph.add(f"stop/{name}/{shown}", f"{KIND}stop", {"f_number": f_number}, reads)
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
    params = image_params(entry)
    tiles = add_tiles(graph, f"white_tile/{name}", params, reads, image_bands(entry.asked.sensor, entry.image_samples))
    white = graph.add(f"white/{name}", f"{KIND}white", {**params, "tiles": len(tiles)}, {**reads, **tiles})
    files[f"{white_at}.exr"] = (white, "white.exr")
    files[f"{white_at}.png"] = (white, "white.png")
    if entry.asked.microlenses:
        tables = _add_micro_images(graph, entry, reads, name)
        for table in ("micro_images.csv", "micro_image_outlines.csv"):
            files[f"{tables_at}{table}"] = (tables, table)


def _add_micro_images(graph: TaskGraph, entry: CameraEntry, reads: dict[str, str], name: str) -> str:
    """The task of the tables of micro-images, with its tiles; gives its name."""
    assert entry.asked.microlenses is not None
    count = microlens_tiles(entry.asked.sensor, entry.asked.microlenses)
    tiles = {
        f"tile{number}": graph.add(
            f"micro_images_tile/{name}/{number:04d}",
            f"{KIND}micro_images_tile",
            {"tile": number, "tiles": count},
            reads,
        )
        for number in range(count if count > 1 else 0)
    }
    return graph.add(f"micro_images/{name}", f"{KIND}micro_images", {"tiles": len(tiles)}, {**reads, **tiles})


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
    """Labels of a camera in camera.json, besides its figures."""
    names = ("lens_name", "index_source", "weight", "footprint", "wavelength_nm")
    labels = {key: getattr(entry, key) for key in names}
    asked = entry.asked
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
    sampling = to_plain(entry.sampling)
    tiles = {
        f"tile{number}": graph.add(
            f"rays_tile/{entry.name}/{number:04d}",
            f"{KIND}rays_tile",
            {"first_row": first, "end_row": end, **sampling, "square_px": entry.square_px},
            reads,
        )
        for number, (first, end) in enumerate(bundle_bands(entry.asked.sensor, entry.sampling))
    }
    light = {"weight": entry.weight, "footprint": entry.footprint, "wavelength_nm": entry.wavelength_nm}
    params = {"tiles": len(tiles), **sampling, **light}
    return graph.add(f"rays/{entry.name}", f"{KIND}rays", params, {**reads, **tiles})
