"""The spread of light by the apertures of a camera, for images: pictures from which rays are drawn.

Each picture is the image of a point by diffraction at the traced pupil, as if the pupil had no aberrations; what those
do follows from the rays. Without microlenses pictures are made at the nodes of a grid over the sensor, because pupils
change over the field; behind microlenses for the middle microlens of each type.
"""

import numpy as np

from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing.records import Diffraction
from pipeline.camera.tracing.sampling_bounds import NO_MICROLENS
from pipeline.camera.wave.spread import intensity
from pipeline.camera.wave.wavefront import View, aperture
from pipeline.records.shapes import Float64

Middle = tuple[float, float, int]
"""A position on the sensor, vision frame [mm], and the row of the microlens whose light it gets."""
NODES = 5
"""Nodes along an axis of the sensor: between them the vignetted pupils of camera lenses change by a few percent."""
_CELLS, _PER_WIDTH = 160, 8
"""Cells of a picture along an axis, and how many of them wavelength over the pupil's width takes: it ends behind the
ninth dark ring, with 2 percent of the light beyond it, and a cell blurs less than a hundredth of the contrast."""
_PUPIL = 64
"""Cells of a pupil along an axis: the image of its edge repeats itself 64 widths away, far beyond the picture."""


def spread_of(tracer: Tracer, wavelength_nm: float, middles: tuple[Middle, ...]) -> Diffraction:
    """The spread of the apertures of a camera in light of one wavelength.

    `middles`: one for each type of microlens; none without microlenses.
    """
    if middles and tracer.lattice is not None:
        views = [View(np.array([x, y]), row, np.inf) for x, y, row in middles]
        return _of_views(tracer, wavelength_nm, views, np.ones(2), tracer.lattice.type.astype(np.int64))
    sensor = tracer.camera.sensor
    extent = np.abs([sensor.offset_x_mm, sensor.offset_y_mm]) + np.array(sensor.size_mm) / 2
    node_mm, places = 2 * extent / (NODES - 1), np.arange(NODES) - (NODES - 1) / 2
    at = [np.array([x, y]) * node_mm for y in places for x in places]
    views = [View(position, NO_MICROLENS, np.inf) for position in at]
    return _of_views(tracer, wavelength_nm, views, node_mm, np.zeros(0, np.int64))


def _of_views(
    tracer: Tracer, wavelength_nm: float, views: list[View], node_mm: np.ndarray, of_microlens: np.ndarray
) -> Diffraction:
    pictures, edges = [], []
    for view in views:
        picture, edge = _picture(tracer, wavelength_nm, view)
        pictures.append(picture)
        edges.append(edge)
    rows = np.cumsum(np.stack(pictures).sum(axis=2), axis=1)
    cells = np.cumsum(pictures, axis=2)
    rows, cells = (np.ascontiguousarray(sums / sums[..., -1:]) for sums in (rows, cells))
    return Diffraction(rows, cells, np.array(edges), node_mm, of_microlens)


def _picture(tracer: Tracer, wavelength_nm: float, view: View) -> tuple[Float64[np.ndarray, "n n"], float]:
    """Light in the cells of a picture, and their edge [mm]; of a place that is dark all light in the middle."""
    front = aperture(tracer, view, wavelength_nm, _PUPIL)
    if front is None:
        picture = np.full((_CELLS, _CELLS), 1e-12)
        picture[_CELLS // 2, _CELLS // 2] = 1.0
        return picture, tracer.camera.sensor.pitch_mm * 1e-6
    edge = front.wavelength_mm / ((_PUPIL - 2) * front.step) / _PER_WIDTH
    middles = (np.arange(_CELLS) - (_CELLS - 1) / 2) * edge
    light = intensity(front, middles, middles) * edge**2
    # What falls beyond the picture is an even veil over it: it takes contrast away as it does in truth.
    return light + max(1 - light.sum(), 0.0) / light.size, edge
