"""Flattening of a stage into one text, so that an output folder explains itself."""

from collections.abc import Iterable

from pxr import Sdf, Usd, UsdUtils

from pipeline.scene.dataset import CameraEntry, TargetEntry
from pipeline.scene.write.for_viewers import show_in_viewers


def flattened(stage: Usd.Stage) -> Sdf.Layer:
    """The composed stage in one layer.

    It names no other file and no folder of the machine: references are composed, and asset values, whose paths
    flattening would make absolute, do not pass the checks. Instances must have been written out (`instances`),
    because flattening would leave their prototypes beside the root.
    """
    # Flattening prints warnings about unknown metadata, which it leaves out.
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    layer = stage.Flatten(addSourceFileComment=False)
    delegate.TakeUncoalescedDiagnostics()
    return layer


def text_for_viewers(
    layer: Sdf.Layer, cameras: Iterable[CameraEntry], targets: Iterable[TargetEntry], kept: Iterable[str] = ()
) -> str:
    """Text of a flattened stage with the additions that viewers need, see `for_viewers`."""
    show_in_viewers(layer, cameras, targets, kept)
    return layer.ExportToString().rstrip("\n") + "\n"
