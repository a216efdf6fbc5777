"""Light on a rough surface, reflected from facet to facet until it leaves: an own slow twin of the layer of facets.

References
----------
Heitz, Hanika, d'Eon and Dachsbacher, "Multiple-Scattering Microfacet BSDFs with the Smith Model", SIGGRAPH 2016.
"""

import numpy as np

_MOST = 500
"""Reflections after which a walk has lost nothing that counts."""


def albedo(roughness: float, cosine: float, facing: np.ndarray, walks: int, seed: int = 1) -> np.ndarray:
    """Light that comes back from a surface of GGX facets with Schlick's Fresnel term, for each reflectance face on.

    Heights are uniform between 0 and 1, so that the share of the surface that is lower is the height itself; what
    comes back is the same for any other distribution of heights.
    """
    random = np.random.default_rng(seed)
    way = np.tile([-np.sqrt(1 - cosine**2), 0.0, -cosine], (walks, 1))
    height, light, back = np.ones(walks), np.ones((walks, len(facing))), np.zeros(len(facing))
    for _ in range(_MOST):
        chance, slope = random.random(len(way)), _smith(roughness**2, way)
        leaves = (way[:, 2] > 0) & (height ** np.maximum(slope, 0.0) > chance)
        back += light[leaves].sum(axis=0)
        way, height, light, chance, slope = (one[~leaves] for one in (way, height, light, chance, slope))
        if not len(way):
            break
        height = np.minimum(height / chance ** (1 / slope), 1.0)
        facet = _facing_facet(roughness**2, -way, random)
        glance = -np.sum(way * facet, axis=1)
        way = way + 2 * glance[:, None] * facet
        light = light * (facing + (1 - facing) * (1 - np.clip(glance, 0, 1))[:, None] ** 5)
    return back / walks


def _smith(alpha: float, way: np.ndarray) -> np.ndarray:
    """Smith's Lambda, which is negative downwards."""
    z = way[:, 2]
    return 0.5 * (np.sign(z) * np.sqrt(1 + alpha**2 * (1 - z**2) / z**2) - 1)


def _facing_facet(alpha: float, seen: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Normals of facets by their area as it is seen from a direction, above or below the horizon.

    Stretched facets lie evenly in all directions: such a mirror ball sends light evenly into the sky that it shows.
    """
    view = seen * [alpha, alpha, 1.0]
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    z, turn = 1 - random.random(len(view)) * (1 + view[:, 2]), 2 * np.pi * random.random(len(view))
    side = np.sqrt(np.maximum(1 - z**2, 0.0))
    normal = (view + np.stack([side * np.cos(turn), side * np.sin(turn), z], axis=1)) * [alpha, alpha, 1.0]
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))
