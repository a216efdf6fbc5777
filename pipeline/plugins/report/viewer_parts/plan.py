"""Plan of the parts of cameras, for viewers."""

from pipeline.plugins.report.viewer_parts.params import PARTS, Parts
from pipeline.products.draft import Draft


def plan_parts(draft: Draft) -> None:
    """Add the parts of all cameras."""
    params = Parts(meters_per_unit=draft.dataset.meters_per_unit, up_axis=draft.dataset.up_axis)
    for camera in draft.dataset.cameras:
        task = draft.add(f"parts/{camera.name}", params, {"camera": draft.camera(camera)})
        draft.files[camera.parts_file] = (task, PARTS)
