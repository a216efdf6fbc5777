"""Layers that a composed stage was read from."""

from pxr import Ar, Sdf, Tf, Usd


def used_layers(stage: Usd.Stage) -> list[Sdf.Layer]:
    """Layers with a file, the root first, the others in the order of their paths."""
    root = stage.GetRootLayer()
    others = [layer for layer in stage.GetUsedLayers() if not layer.anonymous and layer != root]
    return [root, *sorted(others, key=lambda layer: layer.realPath)]


def file_of(identifier: str) -> str:
    """The file of a layer identifier: without format arguments, and for a member its package. Empty if malformed."""
    try:
        path, _ = Sdf.Layer.SplitIdentifier(identifier)
    except Tf.ErrorException:
        return ""
    return str(Ar.SplitPackageRelativePathOuter(path)[0])
