"""A stage that sublayers another one and changes values of its cameras: the original file stays as it is."""

from collections.abc import Mapping
from pathlib import Path

from pxr import Sdf


def write_overlay(stage: Path, path: Path, cameras: list[str], values: Mapping[str, str | int]) -> Path:
    """Write a layer over `stage` that sets tokens and integers on the camera prims at the given paths; returns `path`.

    Metadata of a stage, its units and frames for example, count in the root layer only, so they are repeated.
    """
    base = Sdf.Layer.FindOrOpen(str(stage.resolve()))
    layer = Sdf.Layer.CreateNew(str(path))
    for key in base.pseudoRoot.ListInfoKeys():
        if key not in ("subLayers", "subLayerOffsets"):
            layer.pseudoRoot.SetInfo(key, base.pseudoRoot.GetInfo(key))
    layer.subLayerPaths.append(str(stage.resolve()))
    for camera in cameras:
        prim = Sdf.CreatePrimInLayer(layer, camera)
        for name, value in values.items():
            kind = Sdf.ValueTypeNames.Int if isinstance(value, int) else Sdf.ValueTypeNames.Token
            spec = Sdf.AttributeSpec(prim, name, kind, Sdf.VariabilityUniform)
            spec.default = value
    layer.Save()
    return path
