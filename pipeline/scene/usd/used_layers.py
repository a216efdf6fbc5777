"""Layers that a composed stage was read from."""

from pxr import Sdf, Usd


def used_layers(stage: Usd.Stage) -> list[Sdf.Layer]:
    """Layers with a file, the root first, the others in the order of their paths."""
    root = stage.GetRootLayer()
    others = [layer for layer in stage.GetUsedLayers() if not layer.anonymous and layer != root]
    return [root, *sorted(others, key=lambda layer: layer.realPath)]
