"""Checks of groups of a lens: they must be children of a lens and name surfaces that one mount can hold."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.scene.read.media import ordered_surfaces
from pipeline.scene.read.prims import lens_groups
from pipeline.scene.usd.problems import Problem, did_you_mean
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import read


def check_place(group: Usd.Prim) -> Iterator[Problem]:
    """A problem if a PlenLensGroup is not a child of a lens, so that no lens would read it."""
    if not group.GetParent().IsA("PlenLens"):
        message = "a PlenLensGroup must be a direct child of a PlenLens, and this one is not"
        yield problem(group, "misplaced-group", message, hint="groups hold surfaces of their lens, and no groups")


def check_groups(lens: Usd.Prim) -> Iterator[Problem]:
    """Problems of the groups of a PlenLens: unknown surfaces, gaps, and surfaces that two groups hold."""
    order = [prim.GetName() for prim in ordered_surfaces(lens)]
    holder: dict[str, str] = {}
    for group in lens_groups(lens):
        attribute = group.GetAttribute("plen:surfaces")
        names = list(read(group, "plen:surfaces") or ())
        unknown = [name for name in names if name not in order]
        for name in unknown:
            message, hint = f'"{name}" is no surface of the lens', did_you_mean(name, order)
            yield problem(attribute, "group-surfaces", message, hint=hint)
        if not names and attribute.HasAuthoredValue():
            yield problem(attribute, "group-surfaces", "the group holds no surface", hint="name some, or remove it")
        if names and not unknown and names != _stretch(order, names):
            message = f"{', '.join(names)} do not follow one another in the order of the lens"
            yield problem(attribute, "group-surfaces", message, hint=f"its order: {', '.join(order)}")
        for name in names:
            if holder.setdefault(name, group.GetName()) != group.GetName():
                message = f'"{name}" belongs to the groups "{holder[name]}" and "{group.GetName()}"'
                yield problem(attribute, "group-surfaces", message, hint="a surface belongs to one group or to none")


def _stretch(order: list[str], names: list[str]) -> list[str]:
    first = order.index(names[0])
    return order[first : first + len(names)]
