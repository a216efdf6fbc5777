"""Tasks that run on a chosen device, and the effect on their keys."""

import dataclasses

from pipeline.engine.options import BuildOptions
from pipeline.engine.planning.graph import TaskGraph
from pipeline.engine.project import Project
from pipeline.errors import UsageError

DEVICES = ("cuda",)
KINDS = ("rays_tile",)
"""Kinds of tasks that can run on a device: the bundles of position images."""


def on_device(project: Project, options: BuildOptions) -> Project:
    """The same project with the chosen device for tasks that can run there; its name is one of their params, so it
    enters their keys.

    Raises
    ------
    UsageError
        No device has that name, no task can run there, or other options exclude a device.
    EnvironmentFault
        The device cannot be used on this machine.
    """
    if options.device not in DEVICES:
        raise UsageError(f'there is no device "{options.device}"', hint=f"--device takes {', '.join(DEVICES)}")
    if options.untrusted or options.engine:
        other = "--untrusted" if options.untrusted else "--engine"
        raise UsageError(f"--device does not go with {other}", hint="leave one out")
    if not any(project.graph[name].short_kind in KINDS for name in project.graph):
        raise UsageError(
            "nothing in this stage runs on a device",
            hint="position images do: of the methods moments and two-plane, and of a camera with plen:truth:rays",
        )
    from pipeline.jit.device import device_name

    return _replaced(project, device_name())


def _replaced(project: Project, name: str) -> Project:
    graph = TaskGraph(project.graph.packages)
    for task in (project.graph[task] for task in project.graph):
        params = {**task.params, "device": name} if task.short_kind in KINDS else task.params
        graph.add(task.name, task.kind, params, task.reads, task.together)
    return dataclasses.replace(project, graph=graph)
