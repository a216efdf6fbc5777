"""Shift of the saddle of a corner's image by diffraction.

The corner is infinite, of four sectors, black and white, with its edges along x and y of the image, and its image is
that of one point everywhere: E is the spread of a point, integrated over the square of a pixel, folded with the corner.
Its derivative along x is the light of the spread in the pixel's column above a place less that below, and vanishes
where both are equal; likewise along y.
"""

import numpy as np

from pipeline.camera.wave.spread import whole_image
from pipeline.camera.wave.wavefront import Wavefront
from pipeline.records.shapes import Float64

_STEPS = 60
"""Steps of the search at most; each leaves a part of the miss that is as small as the spread is symmetric."""
_DONE = 1e-9
"""Step that ends the search, over a pixel's edge [1]."""
_SOFT = 1 / 16
"""Softness of the sides of a pixel over its edge [1]: rays are single points, and sums over them must change slowly."""


def saddle_of_light(front: Wavefront, pitch_mm: float) -> np.ndarray:
    """Saddle in the image by diffraction, from where the mean of the rays puts the corner, (2,) [mm]; vision frame."""
    x_mm, image = whole_image(front)
    light = image / image.sum()
    return _saddle(lambda x, y: y(x_mm) @ light @ x(x_mm), pitch_mm)


def saddle_of_rays(front: Wavefront, pitch_mm: float) -> np.ndarray:
    """Saddle in the image by geometry, likewise, (2,) [mm]."""
    lit = front.share > 0
    spots, weight = front.crossings_mm[lit], front.share[lit] / front.share.sum()
    return _saddle(lambda x, y: np.sum(weight * x(spots[:, 0]) * y(spots[:, 1])), pitch_mm)


class _Window:
    """Functions of a pixel about a place along an axis: its square, and what lies on which side of the place."""

    def __init__(self, place: float, edge_mm: float) -> None:
        self.place, self.edge_mm = place, edge_mm

    def inside(self, x: Float64[np.ndarray, "n"]) -> np.ndarray:
        """1 within the pixel, 0 outside, with soft sides."""
        return np.clip((self.edge_mm / 2 - np.abs(x - self.place)) / (_SOFT * self.edge_mm) + 0.5, 0.0, 1.0)

    def side(self, x: Float64[np.ndarray, "n"]) -> np.ndarray:
        """The part of the pixel on the far side of the edge through x less that on the near side."""
        return np.clip(2 * (self.place - x) / self.edge_mm, -1.0, 1.0)


def _saddle(light_of, edge_mm: float) -> np.ndarray:  # type: ignore[no-untyped-def]
    """The place at which both derivatives vanish; `light_of` folds the spread with two functions, of x and of y."""
    place = np.zeros(2)
    for _ in range(_STEPS):
        x, y = _Window(place[0], edge_mm), _Window(place[1], edge_mm)
        bend = light_of(x.inside, y.inside) * 2 / edge_mm
        move = np.array([light_of(x.side, y.inside), light_of(x.inside, y.side)]) / bend
        move = np.clip(move, -edge_mm, edge_mm)
        place = place - move
        if np.abs(move).max() < _DONE * edge_mm:
            break
    return place
