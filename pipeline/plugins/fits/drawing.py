"""A picture of a fit: the residual field, residuals by distance, and the entrance pupil over the field."""

from typing import Any

import numpy as np

from pipeline.fits.fitting import Fit
from pipeline.plugins.fits.result import FittedCamera, by_distance
from pipeline.results.notebook import figure, svg_of

_WIDTH_IN, _BELOW_IN, _WORDS_IN = 10.0, 3.2, 0.6
"""Width of the picture, and heights of the two plots and of words [inch]."""
_NEAR, _FAR, _DARK = "#1f5fa8", "#c0392b", "#333333"
"""Colours: of the near and of the far plane, of positions."""
_LONGEST = 0.9
"""Length of the longest line over the distance of two positions of the grid [1]: lines do not touch."""
_MARKED = 50
"""Most points that are joined by a line: more are a scatter, as rays of a lens with displaced surfaces are."""


def picture(camera: FittedCamera, fit: Fit) -> str:
    """The picture of one of the fits of a camera as the text of an SVG file; UsageError: matplotlib is missing."""
    wide, high = camera.field.size_px
    tall_in = _WIDTH_IN * high / wide + _WORDS_IN
    sheet = figure(_WIDTH_IN, tall_in + _BELOW_IN)
    above, below = sheet.add_gridspec(2, 1, height_ratios=(tall_in, _BELOW_IN))
    residuals = sheet.add_subplot(above)
    curves, pupil = below.subgridspec(1, 2).subplots()
    sheet.suptitle(f"{camera.name}: {fit.model.consumer}. rms {fit.rms_px:.2e} px, largest {fit.max_px:.2e} px")
    _draw_residuals(residuals, camera, fit)
    distances = by_distance(fit, camera.field)
    per_m = np.array([1e3 / row["z_mm"] for row in distances])
    for name, words, colour in (("rms_px", "rms", _NEAR), ("max_px", "largest", _FAR)):
        _draw_curve(curves, per_m, np.array([row[name] for row in distances]), colour, words)
    curves.set(xlabel="1 / z [1/m]", ylabel="[px]", title="residual at other distances")
    curves.legend()
    _draw_curve(pupil, camera.pupil.angle_deg, camera.pupil.z_mm, _NEAR)
    pupil.set(xlabel="angle [°]", ylabel="vision z [mm]", title="entrance pupil: where rays pass the axis")
    return svg_of(sheet)


def _draw_residuals(axes: Any, camera: FittedCamera, fit: Fit) -> None:
    """The residual field: a line from each position of the image, as many times longer as the title says."""
    (wide, high), starts = camera.field.size_px, camera.field.x_px
    scale = _LONGEST * np.diff(np.unique(starts[:, 0]))[0] / (fit.max_px or 1.0)
    for residuals, colour, z_mm in zip(fit.residual_px, (_NEAR, _FAR), camera.field.planes_mm, strict=True):
        ends = starts + scale * residuals
        x, y = np.stack([starts, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2).T
        axes.plot(x, y, color=colour, linewidth=0.8, label=f"on the plane {z_mm:.4g} mm", clip_on=False)
    axes.plot(*starts.T, ".", color=_DARK, markersize=2, clip_on=False)
    axes.set(xlim=(-0.5, wide - 0.5), ylim=(high - 0.5, -0.5), aspect="equal", xlabel="x [px]", ylabel="y [px]")
    axes.set_title(f"model minus ray; the longest line is {fit.max_px:.2e} px", fontsize="medium", loc="left", pad=16)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.01), ncols=2, fontsize="small")


def _draw_curve(axes: Any, x: np.ndarray, y: np.ndarray, colour: str, words: str | None = None) -> None:
    axes.plot(x, y, "." if len(x) > _MARKED else ".-", color=colour, label=words)
