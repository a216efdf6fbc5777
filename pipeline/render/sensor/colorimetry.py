"""Colours that a sensor of red, green and blue channels sees, as other programs want to know them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pipeline.render.spectral.nodes import Table

DAYLIGHT = "D65"
"""Light that raw converters expect a camera to be calibrated in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Colorimetry:
    """A sensor beside the standard observer.

    `illuminant`: light of the scene, by its name in `spectra.illuminant`.
    `xyz_from_rgb`: CIE 1931 X, Y and Z of relative irradiances of red, green and blue; white has Y = 1, and 1 in each
        channel.
    `counted`: what red, green and blue count of white, in a unit that is the same for all lights of a sensor.
    """

    illuminant: str
    xyz_from_rgb: tuple[tuple[float, ...], ...]
    counted: tuple[float, ...]

    @property
    def chromaticities(self) -> tuple[float, ...]:
        """x and y of red, green, blue and white: the same matrix in the words of OpenEXR."""
        xyz = np.array([*zip(*self.xyz_from_rgb, strict=True), np.sum(self.xyz_from_rgb, axis=1)])
        return tuple((xyz[:, :2] / xyz.sum(axis=1, keepdims=True)).ravel().tolist())


def colorimetry(responses: Sequence[tuple["Table", bool]], illuminant: str) -> Colorimetry | None:
    """The matrix of the responses of red, green and blue that is right for white and, in least squares, best for a
    ColorChecker; None if they do not see three colours of what people see. Beside each response is whether it counts
    photons, or energy.
    """
    from pipeline.render.spectral import spectra

    nm = np.arange(spectra.VISIBLE_NM[0], spectra.VISIBLE_NM[1] + 1.0)
    power = np.interp(nm, *spectra.illuminant(illuminant), left=0.0, right=0.0)
    counted = power * [
        np.interp(nm, *table, left=0.0, right=0.0) * (nm if counts_photons else 1.0)
        for table, counts_photons in responses
    ]
    patches, observer = spectra.patches_and_observer(nm)
    seen = observer * power
    if not (counted.any(axis=1).all() and seen.any()):
        return None
    xyz, white = patches @ seen.T / seen[1].sum(), seen.sum(axis=1) / seen[1].sum()
    red, green, blue = ((patches @ curve / curve.sum())[:, None] for curve in counted)
    # White fixes the sum of the columns: red and blue count by how they differ from green.
    (by_red, by_blue), *_ = np.linalg.lstsq(np.hstack([red, blue]) - green, xyz - green * white, rcond=None)
    matrix = np.column_stack([by_red, white - by_red - by_blue, by_blue]).round(9)
    if abs(np.linalg.det(matrix)) < 1e-6:  # two channels see alike
        return None
    of_white = tuple((counted.sum(axis=1) / seen[1].sum()).tolist())
    return Colorimetry(illuminant=illuminant, xyz_from_rgb=tuple(map(tuple, matrix.tolist())), counted=of_white)
