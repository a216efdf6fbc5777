"""Steps of kernel compilation, and the choice of those that a graph needs.

If a kernel is missing all the same, the worker that calls it compiles it.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # processes that compile load no graphs
    from pipeline.engine.planning.graph import Task

STEPS = ("lens", "microlenses", "micro_images", "images", "company", "shapes", "lighting", "search", "sensor")
"""Steps: tracing and quadrature of any lens; tilted and refractive microlenses; micro-images; images of a flat sheet;
images in which one thing may hide another; curved targets; paths of light; the search in position images; the noise of
raw images.
"""
_OF_KIND = {
    "image": "images",
    "white": "images",
    "micro_images": "micro_images",
    "expose": "sensor",
    "fixed_pattern": "sensor",
}
_NOT_FLAT = ("warped", "height-map", "cylinder", "mesh")
_ONE_SHEET = "flat"


def steps_of(tasks: "Iterable[Task]") -> tuple[str, ...]:
    """Names of the steps that these tasks need, in the order of `STEPS`."""
    found = {"lens"}
    for task in tasks:
        kind = task.short_kind.removesuffix("_tile").removesuffix("_pass")
        found.add(_OF_KIND.get(kind, "lens"))
        if task.short_kind == "focus" and _are_bent((task.params["camera"] or task.params["request"])["microlenses"]):
            found.add("microlenses")
        if kind == "truth" and task.params["table"]["settings"]["method"] != "direct":
            found.add("search")
        view = task.params.get("view") or {}
        if kind == "image" and view and not _is_one_sheet(view):
            found.add("company")
        if view.get("lighting"):
            found.add("lighting")
        if any(_kind_of(placed["target"]) in _NOT_FLAT for placed in view.get("targets", ())):
            found.add("shapes")
    return tuple(step for step in STEPS if step in found)


def _are_bent(array: dict[str, Any] | None) -> bool:
    """Whether microlenses are not thin and parallel to the sensor."""
    return array is not None and (array["model"] != "thin" or array["tilt_x_deg"] != 0 or array["tilt_y_deg"] != 0)


def _is_one_sheet(view: dict[str, Any]) -> bool:
    """Whether nothing in a view can hide anything else."""
    kinds = [_kind_of(placed["target"]) for placed in view["targets"]]
    return kinds == [_ONE_SHEET] and not view.get("occluders") and not view.get("lighting")


def _kind_of(target: Any) -> str:
    """The kind of surface that a target has."""
    kind: str = target["surface"]["kind"] if "surface" in target else target["kind"]
    return kind
