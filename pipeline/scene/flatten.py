"""The composed stage as one text, so that a built folder explains itself."""

from pxr import Usd, UsdUtils


def flattened(stage: Usd.Stage) -> str:
    """Text of the composed stage in one layer.

    It names no other file and no folder of the machine: references are composed in, and asset values, whose paths
    flattening would make absolute, do not pass the checks.
    """
    # Flattening warns on stderr of metadata that it does not know and leaves out.
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    layer = stage.Flatten(addSourceFileComment=False)
    delegate.TakeUncoalescedDiagnostics()
    return layer.ExportToString().rstrip("\n") + "\n"
