"""Values that are written on a stage. A build keeps them, so that a later plan can name the edits since."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd

from pipeline.edits import Edit
from pipeline.scene.usd.opening import open_stage
from pipeline.scene.usd.problems import shown_path, specs, written_at
from pipeline.scene.usd.usda_lines import line_of, line_of_metadata, text_map
from pipeline.scene.usd.values import plain

_SAYS_NOTHING = {
    *("documentation", "comment", "customData", "customLayerData", "fallbackPrimTypes", "assetInfo"),
    *("custom", "variability", "typeName"),
}
"""Metadata without effect on a build, and metadata that `written_on` has elsewhere."""
_VALUES = ("default", "targetPaths", "connectionPaths")
_ARCS = ("references", "payload", "inheritPaths", "specializes", "variantSelection", "subLayers")
"""Composition arcs: all changes in other files that follow from one are one edit."""

Written = dict[str, Any]
"""JSON values: of `/A` its type, of `/A.x` and `/A.x@3` a default value and a time sample, of `/A|field` metadata."""


def written_on(stage: Usd.Stage, layer: Sdf.Layer) -> Written:
    """Everything that is written on a stage; `layer` is the flattened stage, without additions."""
    written: Written = {}
    # The composed values of all prims and properties.
    paths = list[Sdf.Path]()
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        spec = layer.GetObjectAtPath(path)
        if path.IsPrimPath():
            written[str(path)] = spec.typeName or "a prim without a type"
        for field in set(spec.ListInfoKeys()) - _SAYS_NOTHING if spec else ():  # there is none of a target's path
            value = spec.GetInfo(field)
            if field == "timeSamples":
                written |= {f"{path}@{time!r}": _json(sample) for time, sample in value.items()}
            else:
                written[str(path) if field in _VALUES else f"{path}|{field}"] = _json(value)
    # Composition arcs, which the flattened stage no longer has.
    written["/|subLayers"] = [f"@{path}@" for path in stage.GetRootLayer().subLayerPaths]
    for prim in stage.TraverseAll():
        for spec in reversed(prim.GetPrimStack()):  # the strongest counts
            arcs = [field for field in _ARCS if spec.layer.realPath and spec.HasInfo(field)]
            written |= {f"{prim.GetPath()}|{field}": _json(spec.GetInfo(field)) for field in arcs}
    return written


def edits_between(old: Written, new: Written, file: Path) -> list[Edit]:
    """Edits between two states of a stage, the outermost first; `file` is in the new state."""
    stage, _ = open_stage(file)
    changed = []
    for key in [key for key in old.keys() | new.keys() if old.get(key) != new.get(key)]:
        path, _, field = key.partition("|")
        path, _, time = path.partition("@")
        time_code = float(time) if time else None
        changed.append(Edit(at=path, field=field or None, time=time_code, old=old.get(key), new=new.get(key)))
    # Leave out the edits that follow from one that came before: of a prim that came or went, or of an arc.
    edits: list[Edit] = []
    causes: list[tuple[str, str | None]] = []  # prims that came or went; arcs, with the file that names them
    for edit in sorted(changed, key=_order):
        named_file, line = _written_at(stage, edit)
        if any(is_below(edit.at, cause) and named_file != file_of_arc for cause, file_of_arc in causes):
            continue
        if _is_cause(edit):
            causes.append((edit.at, named_file if edit.field else None))
        edits.append(replace(edit, file=named_file, line=line))
    return edits


def _is_cause(edit: Edit) -> bool:
    """Whether other edits may follow from this one: that of an arc, or of a prim that came or went."""
    return edit.field in _ARCS if edit.field else "." not in edit.at and None in (edit.old, edit.new)


def _order(edit: Edit) -> tuple[bool, str, bool, str, float]:
    """Sort key: prims and arcs first, an arc before the prims that come with it; samples by their time."""
    return not _is_cause(edit), edit.at, edit.field is None, edit.field or "", edit.time or 0.0


def _written_at(stage: Usd.Stage, edit: Edit) -> tuple[str | None, int | None]:
    """File and line of an edit; for a removed statement those of the prim that held it."""
    if edit.at == "/":
        root = stage.GetRootLayer().realPath
        return shown_path(root), line_of_metadata(root, edit.field or "")
    edited = stage.GetObjectAtPath(edit.at)
    if not edited:
        holder = Sdf.Path(edit.at).GetPrimPath()
        while not stage.GetPrimAtPath(holder):
            holder = holder.GetParentPath()
        return written_at(stage.GetPrimAtPath(holder))
    for spec in specs(edited):
        if edit.field and spec.layer.realPath and spec.HasInfo(edit.field):
            file = spec.layer.realPath
            assets = [text_map(file).assets.get(asset) for asset in re.findall("@([^@]+)@", str(edit.new))]
            return shown_path(file), assets[0] if len(assets) == 1 and assets[0] else line_of(file, str(spec.path))
    return written_at(edited, edit.time)


def is_below(path: str, above: str) -> bool:
    """Whether a path is that of a prim, or of a prim or property below it."""
    return above in ("/", path) or path.startswith((f"{above}/", f"{above}."))


def _json(value: Any) -> Any:
    """A value as JSON has it: arrays and vectors as lists, paths as `<path>`, assets as `@asset@`."""
    if hasattr(value, "GetAppliedItems"):
        items = [_json(item) for item in value.GetAppliedItems()]
        return items[0] if len(items) == 1 else items
    if isinstance(value, Sdf.Reference | Sdf.Payload):
        prim = f"<{value.primPath}>" if value.primPath else ""
        offset = "" if value.layerOffset.IsIdentity() else f" {value.layerOffset}"
        return f"@{value.assetPath}@{prim}{offset}"
    if isinstance(value, Sdf.Path | Sdf.AssetPath):
        return f"<{value}>" if isinstance(value, Sdf.Path) else f"@{value.path}@"
    try:
        return json.loads(json.dumps(plain(value)))
    except TypeError:
        return str(value)
