"""The most prims that a stage can be composed of, counted before USD composes it.

A prim that references another one twice has its children twice: thirty such prims in a row are a thousand million.
"""

from collections.abc import Iterator
from typing import Any

from pxr import Sdf

_ENOUGH = 10**12
"""No count goes on beyond this."""

_Site = tuple[str, str]
"""A prim: root of its layer stack, and path."""


def most_prims(root: Sdf.Layer) -> int:
    """An upper bound of the prims that a layer composes with layers that are open; arcs that lead nowhere count 0."""
    counts: dict[_Site, int] = {}
    todo: list[tuple[_Site, list[_Site] | None]] = [((root.identifier, "/"), None)]
    while todo:
        site, parts = todo.pop()
        if parts is not None:
            counts[site] = min(_ENOUGH, 1 + sum(counts[part] for part in parts))
        elif site not in counts:
            counts[site] = 0  # as long as it is not known: what leads back to itself is an error of composition
            parts = list(_parts(site))
            todo += [(site, parts), *((part, None) for part in parts)]
    return counts[root.identifier, "/"]


def _parts(site: _Site) -> Iterator[_Site]:
    """Prims whose children a prim has, and its own, in all layers of its stack and in all variants."""
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
    """A layer and its sublayers, as far as they are open, each once."""
    todo, seen = [root], set[str]()
    while todo:
        layer = Sdf.Layer.Find(todo.pop())
        if layer is not None and layer.identifier not in seen:
            seen.add(layer.identifier)
            yield layer
            todo += [layer.ComputeAbsolutePath(path) for path in layer.subLayerPaths]
