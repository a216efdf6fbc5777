"""Differences between two composed layers, and undoing some of them."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from pxr import Sdf

from pipeline.scene.usd.values import plain

_SAYS_NOTHING = {"documentation", "comment", "customData", "customLayerData", "fallbackPrimTypes", "assetInfo"}
"""Metadata that does not affect a build."""


class Change(NamedTuple):
    """A property or prim that was changed, added or removed; with `field`, metadata of a prim or of the layer."""

    path: Sdf.Path
    field: str | None = None


def layer_of(text: str) -> Sdf.Layer:
    """A new layer with this text."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.ImportFromString(text)
    return layer


def changes(old: Sdf.Layer, new: Sdf.Layer, at: Sdf.Path = Sdf.Path.absoluteRootPath) -> Iterator[Change]:
    """All changes at and below a prim that both layers have; an added or removed prim is one change."""
    before, now = old.GetPrimAtPath(at), new.GetPrimAtPath(at)
    for field in sorted(_fields(before) | _fields(now)):
        if before.GetInfo(field) != now.GetInfo(field):
            yield Change(at, field)
    for name in sorted({*before.properties.keys(), *now.properties.keys()}):
        path = at.AppendProperty(name)
        if _content(old.GetPropertyAtPath(path)) != _content(new.GetPropertyAtPath(path)):
            yield Change(path)
    for name in sorted({*before.nameChildren.keys(), *now.nameChildren.keys()}):
        if name in before.nameChildren and name in now.nameChildren:
            yield from changes(old, new, at.AppendChild(name))
        else:
            yield Change(at.AppendChild(name))


def undone(new: Sdf.Layer, old: Sdf.Layer, taken_back: Iterable[Change]) -> Sdf.Layer:
    """A copy of the new layer with some changes undone."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(new)
    for path, field in taken_back:
        was, now = old.GetObjectAtPath(path), layer.GetObjectAtPath(path)
        if field is None:
            _remove(layer, path)
            if was:
                Sdf.CopySpec(old, path, layer, path)
        elif was and was.HasInfo(field):
            now.SetInfo(field, was.GetInfo(field))
        else:
            now.ClearInfo(field)
    return layer


Values = dict[tuple[str | None, float | None], Any]
"""(metadata or None, time or None) -> plain value."""


def values_of(spec: Sdf.Spec | None) -> Values:
    """All values of a property, by field and time; empty if there is no property."""
    values: Values = {}
    for field, value in _content(spec).items():
        if field == "timeSamples":
            values |= {(None, time): _plain(sample) for time, sample in value.items()}
        else:
            values[None if field in ("default", "targetPaths") else field, None] = _plain(value)
    return values


def metadata_of(spec: Sdf.Spec | None, field: str) -> Any:
    """Metadata of a prim or a layer as plain values; None if it is not set."""
    return _plain(spec.GetInfo(field)) if spec and spec.HasInfo(field) else None


def _remove(layer: Sdf.Layer, path: Sdf.Path) -> None:
    spec = layer.GetObjectAtPath(path)
    if isinstance(spec, Sdf.PropertySpec):
        spec.owner.RemoveProperty(spec)
    elif spec:
        del spec.nameParent.nameChildren[path.name]


def _fields(spec: Sdf.PrimSpec) -> set[str]:
    return set(spec.ListInfoKeys()) - _SAYS_NOTHING


def _content(spec: Sdf.PropertySpec | None) -> dict[str, Any]:
    """Fields of a property."""
    return {} if not spec else {field: spec.GetInfo(field) for field in _fields(spec)}


def _plain(value: Any) -> Any:
    """A value as Python's own: arrays as lists, vectors as tuples, paths as `<path>`."""
    if hasattr(value, "GetAppliedItems"):
        return [f"<{item}>" if isinstance(item, Sdf.Path) else str(item) for item in value.GetAppliedItems()]
    if type(value).__module__ == "pxr.Vt":
        return [plain(item) for item in value]
    try:
        return plain(value)
    except TypeError:
        return str(value)
