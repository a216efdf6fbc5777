"""Graph of tasks of a dataset, and the list of files that a build delivers: what all products plan.

Params hold exactly what a task reads, in the camera's own frame, so that moving a rig does not affect any ray. Names
appear only in the params of tasks that write them.
"""

from typing import Any, NamedTuple

from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import TaskGraph
from pipeline.entry_points import plugged_in
from pipeline.products.camera.plan import plan_cameras
from pipeline.products.certificate.plan import plan_certificates
from pipeline.products.colours.plan import plan_colours
from pipeline.products.derivatives.plan import plan_derivatives
from pipeline.products.draft import Draft
from pipeline.products.export import plan_exports
from pipeline.products.images.plan import plan_images, plan_white_images
from pipeline.products.micro_images.plan import plan_micro_images
from pipeline.products.parts.plan import plan_parts
from pipeline.products.poses.plan import plan_poses
from pipeline.products.positions.plan import plan_positions
from pipeline.products.raw.plan import plan_raw_images
from pipeline.products.rays.plan import plan_rays
from pipeline.products.sheet import plan_targets
from pipeline.products.things import Things
from pipeline.products.truth.plan import plan_truth
from pipeline.scene.dataset import Dataset

PRODUCTS = (
    plan_targets,
    plan_cameras,
    plan_parts,
    plan_poses,
    plan_rays,
    plan_white_images,
    plan_micro_images,
    plan_images,
    plan_positions,
    plan_truth,
    plan_certificates,
    plan_derivatives,
    plan_colours,
    plan_raw_images,
)
"""Plans of all products; each comes after those whose tasks its own read."""


class DatasetGraph(NamedTuple):
    """All tasks of a dataset, the sources of the files in the output folder, and the certificate of each camera."""

    graph: TaskGraph
    files: dict[str, Source]
    certificates: dict[str, tuple[str, str]]


def graph_of(dataset: Dataset) -> DatasetGraph:
    """The tasks of a dataset, and what its build delivers."""
    scenes = _scenes(dataset)
    things = scenes.LitThings if scenes and _is_lit(dataset) else Things
    painted, bare = (things(dataset, painted=painted) for painted in (True, False))
    made = graph, files, certificates = DatasetGraph(TaskGraph(), {}, {})
    draft = Draft(dataset, graph, files, certificates, painted, bare)
    before, after = ([scenes.plan_pictures], [scenes.plan_labels]) if scenes else ([], [])
    for plan in (*before, *PRODUCTS, *after, plan_exports):
        plan(draft)
    return made


def _is_lit(dataset: Dataset) -> bool:
    return bool(dataset.lamps) or any(occluder.finish for occluder in dataset.occluders)


def _scenes(dataset: Dataset) -> Any:
    """The plug-in with the tasks of lamps, pictures and labels; None: the dataset has none of these."""
    has_labels = any(camera.labels for camera in dataset.cameras)
    return plugged_in("scene", "tasks") if _is_lit(dataset) or dataset.pictures or has_labels else None
