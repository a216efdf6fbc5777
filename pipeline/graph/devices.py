"""Tasks that run on a chosen device, and the effect on their keys."""

import dataclasses

from pipeline.engine.options import BuildOptions
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.engine.project import Project
from pipeline.engine.records import Params
from pipeline.errors import UsageError

DEVICES = ("cuda",)
BUNDLES, IMAGES = ("rays_tile",), ("white", "white_tile", "white_pass", "image", "image_tile", "image_pass")
"""Kinds of tasks whose rays a device can trace: bundles of position images in float64, those of images in float32."""


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

    return _replaced(project, device_name())


def _replaced(project: Project, name: str) -> Project:
    graph = TaskGraph(project.graph.packages)
    for task in (project.graph[task] for task in project.graph):
        graph.add(task.name, task.kind, _on(name, task), task.reads, task.together)
    return dataclasses.replace(project, graph=graph)


def _on(device: str, task: Task) -> Params:
    """Parameters of a task with the device, if it can use one.

    White images that are smooth cannot: they are by quadrature.
    """
    if task.short_kind in BUNDLES:
        return {**task.params, "device": device}
    if task.short_kind in IMAGES and not task.params.get("is_smooth"):
        return {**task.params, "exposure": {**task.params["exposure"], "device": device}}
    return task.params
