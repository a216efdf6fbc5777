"""Point images by diffraction: lines for a terminal, and a drawing with pictures and curves."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.camera.figures.point_images import PointImage
from pipeline.results.notebook import figure, svg_of

_WIDTH_IN, _ROW_IN = 11.0, 2.9
"""Width of the drawing and height of a row [inch]: a page of a browser."""
_GAMMA = 0.4
"""Gamma of the displayed light [1]: rings a hundred times fainter than the centre are visible."""
_CURVES = (
    ("perfect", "#9a9a9a", "-", "same aperture, no aberrations"),
    ("geometric", "#d08a1e", ":", "rays alone"),
    ("sagittal", "#1f5fa8", "--", "sagittal"),
    ("tangential", "#c0392b", "-", "tangential"),
)
"""Attribute of PointImage, colour, dashes and caption of each curve, the most important one drawn last, on top."""


def lines(images: Sequence[PointImage], pitch_mm: float) -> list[str]:
    """A table of several point images, and a legend of its columns."""
    nyquist_per_mm = 1 / (2 * pitch_mm)
    head = ("place", "position", "object", "Airy radius", "wavefront", "Strehl", "MTF", "saddle")
    frequencies = f"at {nyquist_per_mm / 2:.0f}   at {nyquist_per_mm:.0f}"
    units = ("", "px", "mm", "um    px", "rms    PV", "", frequencies, "px")
    rows = [head, units, *(_row(image, pitch_mm) for image in images)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    table = ["  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    light = f"images of points by diffraction at {images[0].wavelength_nm:.1f} nm"
    notes = (
        "wavefront in wavelengths, without piston and tilt; MTF tangential/sagittal, without the pixel, at half of the",
        "pixels' Nyquist frequency and at it, per mm; saddle: its shift from that of geometry, which is in the truth",
    )
    return [light, *table, *notes]


def _row(image: PointImage, pitch_mm: float) -> tuple[str, ...]:
    x, y = image.x_px
    transfers = (image.at(share / (2 * pitch_mm)) for share in (0.5, 1.0))
    object_mm = "infinity" if math.isinf(image.object_mm) else f"{image.object_mm:.1f}"
    return (
        image.place,
        f"({x:.1f}, {y:.1f})",
        object_mm,
        f"{image.airy_radius_um:.2f}  {image.airy_radius_um / (1e3 * pitch_mm):.2f}",
        f"{image.rms_waves:.3f}  {image.extent_waves:.2f}",
        f"{image.strehl_ratio:.3f}",
        "  ".join(f"{tangential:.2f}/{sagittal:.2f}" for tangential, sagittal in transfers),
        _shift(image),
    )


def _shift(image: PointImage) -> str:
    """Shift of the saddle; adding 0 takes the sign of a rounded zero."""
    x, y = np.round(image.saddle_shift_px, 4) + 0.0
    return f"({x:+.4f}, {y:+.4f})"


def drawing(images: Sequence[tuple[str, PointImage]], title: str, pitch_mm: float) -> str:
    """The drawing as the text of an SVG file: a row for each image, captioned with its light.

    Raises UsageError: Matplotlib is not installed.
    """
    page = figure(_WIDTH_IN, 0.4 + _ROW_IN * len(images))
    page.suptitle(title, fontsize=11, x=0.01, ha="left")
    cells = page.subplots(len(images), 3, squeeze=False, width_ratios=(1, 1.7, 1))
    for (light, image), (photograph, curves, words) in zip(images, cells, strict=True):
        _draw_photograph(photograph, image, pitch_mm)
        _draw_curves(curves, image, pitch_mm)
        words.axis("off")
        words.text(0, 1, "\n".join(_words(light, image, pitch_mm)), va="top", fontsize=8, linespacing=1.6)
    return svg_of(page)


def _draw_photograph(axes: Any, image: PointImage, pitch_mm: float) -> None:
    """The picture, the first dark ring of the Airy pattern, and the edges of a pixel."""
    edge = image.picture_um / 2
    half = 500 * pitch_mm
    turn = np.linspace(0, 2 * np.pi, 100)
    extent = (-edge, edge, edge, -edge)
    axes.imshow(1 - image.picture**_GAMMA, cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="nearest")
    axes.plot(image.airy_radius_um * np.cos(turn), image.airy_radius_um * np.sin(turn), ":", color="#c0392b")
    axes.plot([-half, half, half, -half, -half], [-half, -half, half, half, -half], color="#1f5fa8", linewidth=1)
    axes.set(xlim=(-edge, edge), ylim=(edge, -edge), xticks=(), yticks=())
    axes.set_xlabel(f"{image.picture_um:.1f} µm; blue: a pixel; red: Airy disc", fontsize=8)


def _draw_curves(axes: Any, image: PointImage, pitch_mm: float) -> None:
    """Modulation transfer functions, with the Nyquist frequency of the pixels."""
    for attribute, colour, dashes, words in _CURVES:
        axes.plot(image.per_mm, getattr(image, attribute), dashes, color=colour, label=words, linewidth=1.2)
    last = float(image.per_mm[-1])
    nyquist_per_mm = 1 / (2 * pitch_mm)
    if nyquist_per_mm < last:
        axes.axvline(nyquist_per_mm, color="#27803d", linestyle=":", label="Nyquist frequency of the pixels")
    axes.set(xlim=(0, last), ylim=(0, 1))
    axes.set_xlabel("line pairs per mm", fontsize=8)
    axes.set_ylabel("MTF", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.legend(fontsize=7)


def _words(light: str, image: PointImage, pitch_mm: float) -> tuple[str, ...]:
    """Figures of an image beside its picture."""
    where = "infinity" if math.isinf(image.object_mm) else f"{image.object_mm:.1f} mm"
    return (
        f"{image.place}, ({image.x_px[0]:.1f}, {image.x_px[1]:.1f}) px",
        f"object at {where}, {light}",
        f"aperture {image.numerical_aperture:.4f} = F/{1 / (2 * image.numerical_aperture):.2f}",
        f"Airy radius {image.airy_radius_um:.2f} µm = {image.airy_radius_um / (1e3 * pitch_mm):.2f} px",
        f"wavefront {image.rms_waves:.3f} waves rms, {image.extent_waves:.2f} PV",
        f"Strehl ratio {image.strehl_ratio:.3f}",
        f"saddle moves by {_shift(image)} px",
    )
