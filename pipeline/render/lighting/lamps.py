"""Lamps made ready for the kernels, at one wavelength."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.records.plain import from_plain
from pipeline.records.shapes import Float64, Num
from pipeline.render.lighting.dome_kernels import Dome
from pipeline.render.lighting.lamp_kernels import AXIS_X, CENTRE, COLUMNS, KINDS, Lamps
from pipeline.render.lighting.records import Lamp, PlacedLamp

_EVEN = 0.5
"""Part of the choices of a lamp that does not ask how bright it is [1]: estimates may be wrong behind walls."""
_FLOOR = 0.05
"""Part of the directions towards a sky that does not ask how bright it is there [1]."""


def lamps_of(
    placed: Sequence[PlacedLamp],
    pictures: Mapping[str, Num[np.ndarray, "h w c"]],
    raised: Float64[np.ndarray, "3"],
    middle_mm: Float64[np.ndarray, "3"],
    background: float,
) -> Lamps:
    """The lamps of a view.

    Parameters
    ----------
    pictures : mapping
        Linear pictures of domes, by name.
    raised : (3,) float64
        Weights of red, green and blue at the wavelength, from `spectra.weights_of_rgb`.
    middle_mm : (3,) float64
        Middle of what is lit, vision frame: it decides how often each lamp is asked.
    """
    table, light, dome = np.zeros((len(placed), COLUMNS)), np.zeros(len(placed)), _sky(np.zeros((0, 0)))
    for k, entry in enumerate(placed):
        lamp, pose = from_plain(Lamp, entry.lamp), np.array(entry.vision_from_lamp, float)
        radiance, area = float(raised @ np.array(lamp.radiance)), lamp.area
        table[k, : AXIS_X - 3] = KINDS.index(lamp.kind), radiance, 0.0, area, *lamp.size
        table[k, CENTRE : CENTRE + 3] = pose[:3, 3]
        table[k, AXIS_X:] = pose[:3, :3].T.ravel()
        if lamp.texture:
            dome = _sky(np.asarray(pictures[lamp.texture], float)[..., :3] @ raised)
        light[k] = radiance * _seen(lamp.kind, area, float(np.linalg.norm(pose[:3, 3] - middle_mm)))
    known = light / light.sum() if light.sum() > 0 else np.full(len(light), 1 / max(1, len(light)))
    table[:, 2] = _EVEN / max(1, len(light)) + (1 - _EVEN) * known
    return Lamps(table, dome, background)


def _seen(kind: str, area: float, distance_mm: float) -> float:
    """Solid angle of a lamp from far away, about; for a parallel beam, whose `radiance` is an irradiance, 1."""
    if kind in ("distant", "dome"):
        return area or 1.0
    return area / (4 * distance_mm**2 + area)


def _sky(texels: Float64[np.ndarray, "h w"]) -> Dome:
    """A picture with the tables from which directions are drawn; linear interpolation spreads a texel over its
    neighbours, so the tables know the brightest of them.
    """
    height = len(texels)
    if not texels.size:
        return Dome(texels, np.zeros(1), np.zeros((0, 1)))
    rows = np.pad(texels, ((1, 1), (0, 0)), mode="edge")
    taller = np.max([rows[:-2], rows[1:-1], rows[2:]], axis=0)
    most = np.max([np.roll(taller, 1, axis=1), taller, np.roll(taller, -1, axis=1)], axis=0)
    sine = np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None]
    share = (most + _FLOOR * most.mean() + 1e-12) * sine
    columns = np.concatenate([np.zeros((height, 1)), np.cumsum(share, axis=1)], axis=1)
    whole = columns[:, -1:]
    rows = np.concatenate([[0.0], np.cumsum(whole[:, 0])])
    return Dome(np.ascontiguousarray(texels), rows / rows[-1], columns / whole)
