"""Checks of parts merged from two references: USD lays the second over the first and removes nothing."""

from collections.abc import Iterator

from pxr import Pcp, Sdf, Usd

from pipeline.scene.usd.problems import Problem, shown_path
from pipeline.scene.usd.source_locations import problem

_LINKS = {
    "PlenLens": "plen:camera:lens",
    "PlenMicrolensArray": "plen:camera:microlenses",
    "PlenSensor": "plen:camera:sensor",
    "PlenTarget": "plen:targets",
}
"""Types of parts, and the relationships that name them."""
_TOLD = 4
"""Number of names in one message: a lens keeps dozens, and a few suffice to recognise their file."""


def check_merged(prim: Usd.Prim) -> Iterator[Problem]:
    """A problem if two independent files define a part and something of the weaker one remains.

    Files that build on each other, and opinions of the stage itself, are no problem.
    """
    link = next((link for name, link in _LINKS.items() if prim.IsA(name)), None)
    index = prim.GetPrimIndex() if link else None
    if not index or not index.rootNode:
        return
    first, *others = _origins(index.rootNode) or [None]
    for other in others:
        kept = _names(other) - _names(first)
        if rest := sorted(name for name in kept if name.split(".")[0] not in kept or "." not in name):
            told = f"{', '.join(rest[:_TOLD])}{f' and {len(rest) - _TOLD} more' if len(rest) > _TOLD else ''}"
            message = f'"{prim.GetName()}" is {_file(first)} laid over {_file(other)}, of which it keeps {told}'
            hint = f"a reference replaces nothing: define another prim beside it, and name that one in {link}"
            yield problem(prim, "merged", message, hint=hint)


def _origins(node: Pcp.NodeRef) -> list[Pcp.NodeRef]:
    """Nodes that define a part without building on another definition, strongest first."""
    found = [origin for child in node.children for origin in _origins(child)]
    return found or [node] * any(spec.typeName for spec in _specs(node) if spec.specifier == Sdf.SpecifierDef)


def _specs(node: Pcp.NodeRef) -> list[Sdf.PrimSpec]:
    specs = [layer.GetPrimAtPath(node.path) for layer in node.layerStack.layers]
    return [spec for spec in specs if spec]


def _names(node: Pcp.NodeRef) -> set[str]:
    """Properties of a part, and its children with theirs, relative to it."""
    names: set[str] = set()
    for spec in _specs(node):
        names |= {prop.name for prop in spec.properties if prop.name.startswith("plen:")}
        for child in spec.nameChildren:
            names.add(child.name)
            names |= {f"{child.name}.{prop.name}" for prop in child.properties if prop.name.startswith("plen:")}
    return names


def _file(node: Pcp.NodeRef) -> str:
    return shown_path(node.layerStack.layers[0].realPath)
