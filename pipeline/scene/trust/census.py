"""Upper bound of the number of prims of a stage, counted before USD composes it.

A prim that references another one twice has its children twice: thirty such prims in a row make a thousand million.
"""

from collections.abc import Iterator
from typing import Any

from pxr import Sdf

_ENOUGH = 10**12
"""Count at which counting stops."""

_Site = tuple[str, str]
"""A prim: root layer of its layer stack, and path."""


def most_prims(root: Sdf.Layer) -> int:
    """Upper bound of the number of prims that a layer composes with the open layers; arcs that lead nowhere count 0."""
    counts: dict[_Site, int] = {}
    todo: list[tuple[_Site, list[_Site] | None]] = [((root.identifier, "/"), None)]
    while todo:
        site, parts = todo.pop()
        if parts is not None:
            counts[site] = min(_ENOUGH, 1 + sum(counts[part] for part in parts))
        elif site not in counts:
            counts[site] = 0  # while unknown: an arc that leads back to itself is a composition error
            parts = list(_parts(site))
            todo += [(site, parts), *((part, None) for part in parts)]
    return counts[root.identifier, "/"]


def _parts(site: _Site) -> Iterator[_Site]:
    """Prims whose children a prim receives, and its own children, in all layers of its stack and all variants."""
    stack, path = site
    names: set[str] = set()
    for layer in _stack_of(stack):
        spec = layer.GetPrimAtPath(path) if path != "/" else layer.pseudoRoot
        if spec is None:
            continue
        names.update(str(child.path) for child in spec.nameChildren)
        if path == "/":
            continue
        for variants in spec.variantSets.values():
            names.update(str(variant.primSpec.path) for variant in variants.variants.values())
        yield from (
            (stack, str(other)) for kind in (spec.inheritPathList, spec.specializesList) for other in _all(kind)
        )
        for arc in (*_all(spec.referenceList), *_all(spec.payloadList)):
            yield from _target(layer, stack, arc)
    yield from ((stack, name) for name in sorted(names))


def _all(arcs: Any) -> list[Any]:
    return list(arcs.GetAppliedItems())


def _target(layer: Sdf.Layer, stack: str, arc: Sdf.Reference | Sdf.Payload) -> Iterator[_Site]:
    to = Sdf.Layer.Find(layer.ComputeAbsolutePath(arc.assetPath)) if arc.assetPath else Sdf.Layer.Find(stack)
    if to is None:
        return
    path = str(arc.primPath) or (f"/{to.defaultPrim.lstrip('/')}" if to.defaultPrim else "")
    if path:
        yield to.identifier, path


def _stack_of(root: str) -> Iterator[Sdf.Layer]:
    """A layer and its open sublayers, each once."""
    todo, seen = [root], set[str]()
    while todo:
        layer = Sdf.Layer.Find(todo.pop())
        if layer is not None and layer.identifier not in seen:
            seen.add(layer.identifier)
            yield layer
            todo += [layer.ComputeAbsolutePath(path) for path in layer.subLayerPaths]
