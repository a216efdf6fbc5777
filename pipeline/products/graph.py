"""Graph of tasks of a dataset, and the list of files that a build delivers: what all products plan.

Params hold exactly what a task reads, in the camera's own frame, so that moving a rig does not affect any ray. Names
appear only in the params of tasks that write them.
"""

from pipeline.engine.planning.graph import TaskGraph
from pipeline.entry_points import offered, plugged_in
from pipeline.products.camera.plan import plan_cameras
from pipeline.products.certificate.plan import plan_certificates
from pipeline.products.colours.plan import plan_colours
from pipeline.products.derivatives.plan import plan_derivatives
from pipeline.products.draft import Draft
from pipeline.products.export import plan_exports
from pipeline.products.images.plan import plan_images, plan_white_images
from pipeline.products.micro_images.plan import plan_micro_images
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
"""Plans of the products of the core, in an order in which tasks come after those that they read; plug-ins have more."""


def graph_of(dataset: Dataset) -> Draft:
    """The tasks of a dataset, and what its build delivers."""
    is_lit = dataset.lamps or any(occluder.finish for occluder in dataset.occluders)
    things = plugged_in("scene", "things") if is_lit else Things
    painted, bare = (things(dataset, painted=painted) for painted in (True, False))
    draft = Draft(TaskGraph(), {}, {}, dataset, painted, bare)
    plugged = [plugged_in("product", name) for name in sorted(offered("product"))]
    for plan in (*PRODUCTS, *plugged, plan_exports):
        plan(draft)
    return draft
