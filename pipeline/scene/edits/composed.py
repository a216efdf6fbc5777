"""A composed stage as plain data for the store: its text, and the file behind each statement.

The text shows the changes between two builds; the files show their places, even of removed statements.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from pxr import Sdf, Usd

from pipeline.scene.usd.used_layers import used_layers

_ARCS = ("references", "payload", "inheritPaths", "specializes", "variantSelection")
_ROOT = "/"
_FORMAT = 1
"""Version of the plain form: it rises when a field changes, and a record of another version is not read."""

Site = tuple[str, str]
"""File and path of a spec."""


class Arc(NamedTuple):
    """A composition arc: prim on the composed stage, field, and the site of the statement."""

    prim: str
    field: str
    file: str
    path: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Composed:
    """A composed stage as plain data.

    Attributes
    ----------
    text : str
        Text of the flattened stage, without additions.
    sites : dict
        Path of a prim or property -> site of its strongest opinion.
    arcs : dict
        Composition arc -> the assets, paths or variants that it names.
    """

    text: str
    sites: dict[str, Site]
    arcs: dict[Arc, list[str]]

    def to_plain(self) -> dict[str, Any]:
        """The record as JSON values."""
        sites = {path: list(site) for path, site in self.sites.items()}
        return {
            "format": _FORMAT,
            "text": self.text,
            "sites": sites,
            "arcs": [[*arc, names] for arc, names in self.arcs.items()],
        }


def composed_from_plain(plain: dict[str, Any]) -> Composed | None:
    """The record written by `to_plain`; None if another version wrote it."""
    if plain.get("format") != _FORMAT:
        return None
    sites = {path: (site[0], site[1]) for path, site in plain["sites"].items()}
    arcs = {Arc(*arc): names for *arc, names in plain["arcs"]}
    return Composed(text=plain["text"], sites=sites, arcs=arcs)


def composed(stage: Usd.Stage, layer: Sdf.Layer) -> Composed:
    """The record of a stage and its flattened layer."""
    sites: dict[str, Site] = {}
    arcs: dict[Arc, list[str]] = {}
    for used in used_layers(stage):
        if used.subLayerPaths:
            arcs[Arc(_ROOT, "subLayers", used.realPath, _ROOT)] = [f"@{path}@" for path in used.subLayerPaths]
    for prim in stage.TraverseAll():
        path, specs = str(prim.GetPath()), written(prim.GetPrimStack())
        if specs:
            sites[path] = site_of(specs[0])
        for spec in specs:
            arcs |= {Arc(path, field, *site_of(spec)): names for field, names in _arcs(spec)}
        for prop in prim.GetAuthoredProperties():
            if specs := written(prop.GetPropertyStack(Usd.TimeCode.Default())):
                sites[str(prop.GetPath())] = site_of(specs[0])
    return Composed(text=layer.ExportToString(), sites=sites, arcs=arcs)


def written(specs: list[Sdf.Spec]) -> list[Sdf.Spec]:
    """Specs that are written in a file, which the session layer is not."""
    return [spec for spec in specs if spec.layer.realPath]


def site_of(spec: Sdf.Spec) -> Site:
    """Layer and path of a spec."""
    return str(spec.layer.realPath), str(spec.path)


def _arcs(spec: Sdf.PrimSpec) -> Iterator[tuple[str, list[str]]]:
    for field in _ARCS:
        if spec.HasInfo(field):
            value = spec.GetInfo(field)
            if isinstance(value, dict):
                yield field, [f"{name} = {chosen}" for name, chosen in sorted(value.items())]
            else:
                yield field, [_arc_text(item) for item in value.GetAppliedItems()]


def _arc_text(item: Any) -> str:
    if isinstance(item, Sdf.Path):
        return f"<{item}>"
    prim = f"<{item.primPath}>" if item.primPath else ""
    offset = item.layerOffset
    moved = "" if offset.IsIdentity() else f" (offset = {offset.offset:g}; scale = {offset.scale:g})"
    return (f"@{item.assetPath}@" if item.assetPath else "") + prim + moved
