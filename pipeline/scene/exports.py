"""Exports that a dataset asks for."""

from pxr import Usd

from pipeline.export_formats import AskedExports
from pipeline.scene.usd.values import need

NOISE = {
    "noise_px": "plen:exports:noise",
    "outliers": "plen:exports:outliers",
    "outlier_px": "plen:exports:outlierReach",
    "missed": "plen:exports:missed",
    "seed": "plen:exports:noiseSeed",
}
"""Attributes of the noise, by field of `exports.noise.Noise`."""


def read_exports(root: Usd.Prim) -> AskedExports:
    """The exports of a PlenDataset."""
    return AskedExports(
        formats=tuple(need(root, "plen:exports")),
        position=need(root, "plen:exports:position"),
        noise={field: need(root, name) for field, name in NOISE.items()},
    )
