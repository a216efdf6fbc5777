"""Lamps made ready for the kernels, in one light."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.records.plain import from_plain
from pipeline.records.shapes import Float64, Num
from pipeline.render.lighting.dome_kernels import Dome
from pipeline.render.lighting.lamp_kernels import AXIS_X, CENTRE, COLUMNS, KINDS, Lamps
from pipeline.render.lighting.records import Lamp, PlacedLamp
from pipeline.render.lighting.shape_kernels import Glow

_EVEN = 0.5
"""Part of the choices of a lamp that does not ask how bright it is [1]: estimates may be wrong behind walls."""
_FLOOR = 0.05
"""Part of the directions towards a sky that does not ask how bright it is there [1]."""


def lamps_of(
    placed: Sequence[PlacedLamp],
    sky: Dome,
    raised: Float64[np.ndarray, "3"],
    shining: tuple[Glow, float],
    background: float,
) -> Lamps:
    """The lamps of a view.

    `sky`: from `sky_of`, in any light.
    `raised`: weights of red, green and blue in the light, from `spectra.weights_of_rgb`.
    `shining`: surfaces that shine, as `shapes.glow_of` finds them.
    """
    corners = shining[0].shapes.corners.reshape(-1, 3)
    # The middle of what is lit decides how often each lamp is asked.
    middle_mm = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) if len(corners) else np.zeros(3)
    table, light = np.zeros((len(placed), COLUMNS)), np.zeros(len(placed))
    for k, entry in enumerate(placed):
        lamp, pose = from_plain(Lamp, entry.lamp), np.array(entry.vision_from_lamp, float)
        radiance, area = float(raised @ np.array(lamp.radiance)), lamp.area
        table[k, : AXIS_X - 3] = KINDS.index(lamp.kind), radiance, 0.0, area, *lamp.size
        table[k, CENTRE : CENTRE + 3] = pose[:3, 3]
        table[k, AXIS_X:] = pose[:3, :3].T.ravel()
        light[k] = radiance * _seen(lamp.kind, area, float(np.linalg.norm(pose[:3, 3] - middle_mm)))
    chance = _chances(np.append(light, _of_glow(*shining, middle_mm)) if shining[1] > 0 else light)
    table[:, 2] = chance[: len(table)]
    return Lamps(table, sky._replace(raised=raised), background, _asked(shining[0], float(chance[len(table) :].sum())))


def _chances(light: Float64[np.ndarray, "k"]) -> np.ndarray:
    """Probabilities with which sources of light are asked, (k,), by the irradiance that each may give."""
    known = light / light.sum() if light.sum() > 0 else np.full(len(light), 1 / max(1, len(light)))
    return np.asarray(_EVEN / max(1, len(light)) + (1 - _EVEN) * known)


def _of_glow(glow: Glow, power_mm2: float, middle_mm: np.ndarray) -> float:
    """Irradiance that surfaces which shine may give, about, as `_seen` says it of lamps."""
    places = glow.shapes.corners[glow.triangle].mean(axis=(0, 1))
    area = float(1.0 / glow.per_mm2[glow.triangle].mean())
    return power_mm2 / (4 * float(np.sum((places - middle_mm) ** 2)) + area)


def _asked(glow: Glow, chance: float) -> Glow:
    """The same surfaces, asked with a probability."""
    return glow._replace(chance=chance, per_mm2=chance * glow.per_mm2)


def _seen(kind: str, area: float, distance_mm: float) -> float:
    """Solid angle of a lamp from far away, about; for a parallel beam, whose `radiance` is an irradiance, 1."""
    if kind in ("distant", "dome"):
        return area or 1.0
    return area / (4 * distance_mm**2 + area)


def sky_of(
    placed: Sequence[PlacedLamp], pictures: Mapping[str, Num[np.ndarray, "h w c"]], raised: Float64[np.ndarray, "3"]
) -> Dome:
    """The picture of the textured dome with the tables from which directions are drawn, by how bright it is in a light;
    linear interpolation spreads a texel over its neighbours, so the tables know the brightest of them.
    """
    name = next((entry.lamp["texture"] for entry in placed if entry.lamp["texture"]), None)
    if name is None:
        return Dome(np.zeros((0, 0, 4), np.float32), raised, np.zeros(1), np.zeros((0, 1)))
    picture = np.array(pictures[name], np.float32)
    texels, height = picture[..., :3].astype(float) @ raised, len(picture)
    rows = np.pad(texels, ((1, 1), (0, 0)), mode="edge")
    taller = np.max([rows[:-2], rows[1:-1], rows[2:]], axis=0)
    most = np.max([np.roll(taller, 1, axis=1), taller, np.roll(taller, -1, axis=1)], axis=0)
    sine = np.sin((np.arange(height) + 0.5) * np.pi / height)[:, None]
    share = (most + _FLOOR * most.mean() + 1e-12) * sine
    columns = np.concatenate([np.zeros((height, 1)), np.cumsum(share, axis=1)], axis=1)
    whole = columns[:, -1:]
    rows = np.concatenate([[0.0], np.cumsum(whole[:, 0])])
    return Dome(picture, raised, rows / rows[-1], columns / whole)
