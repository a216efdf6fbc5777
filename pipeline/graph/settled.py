"""Cameras as tasks read them: settled when the graph is made, each the parameter of one task `camera`."""

from dataclasses import replace

from pipeline.camera.focusing.focus_request import shown_f_number, stopped_down
from pipeline.camera.parts.camera import Camera
from pipeline.engine.planning.graph import TaskGraph
from pipeline.graph.adding import KINDS, add
from pipeline.optics.windows import MARK
from pipeline.scene.dataset import CameraEntry


def settled(entry: CameraEntry) -> Camera:
    """The camera of an entry without what no ray depends on: names of lens groups, the circle of confusion, and planes
    of J_near and J_far.
    """
    lens = entry.camera.prescription
    groups = tuple(
        group if group.name.startswith(MARK) else replace(group, name=str(number))
        for number, group in enumerate(lens.groups)
    )
    prescription = replace(lens, groups=groups) if groups else lens
    return replace(entry.camera, prescription=prescription, near_mm=None, far_mm=None, circle_of_confusion_px=1.0)


def camera_task(
    graph: TaskGraph,
    entry: CameraEntry,
    *,
    is_alone: bool = False,
    has_planes: bool = False,
    f_number: float | None = None,
) -> str:
    """The task that hands on a camera, added at its first use.

    The camera is in the channel of the entry, and behind windows that stand in the world unless `is_alone`. With
    `has_planes` it has its planes of J_near and J_far; with an `f_number` its stop is set to that.
    """
    entry = replace(entry, windows=None) if is_alone and entry.windows else entry
    name = f"camera/{entry.full_name}" + "/windows" * bool(entry.windows)
    if has_planes:
        near_far = {"near_mm": entry.camera.near_mm, "far_mm": entry.camera.far_mm}
        params, name = {**graph[camera_task(graph, entry)].params, **near_far}, f"{name}/planes"
        return name if name in graph else graph.add(name, KINDS["camera"], params)
    if f_number is not None:
        return add(graph, f"{name}/{shown_f_number(f_number)}", stopped_down(settled(entry), f_number))
    return name if name in graph else add(graph, name, settled(entry))
