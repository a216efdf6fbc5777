"""Images of points by diffraction: lines for a terminal, and a drawing with pictures and curves, as SVG."""

import base64
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pipeline.camera.figures.point_images import PointImage
from pipeline.files import svg as svg_file
from pipeline.files.png import png_bytes

_WIDTH_PX, _ROW_PX, _EDGE_PX, _MARGIN_PX = 1080, 300, 240, 30
"""Width of the drawing, height of a row, edge of a picture, blank edge [px]: a page of a browser."""
_PLOT_PX = 420, 200
"""Width and height of the axes of the curves [px]."""
_GAMMA = 0.4
"""Power of the light that is shown as grey [1]: rings a hundred times fainter than the middle are seen."""
_CURVES = (
    ("perfect", "#9a9a9a", "", "same aperture, no aberrations"),
    ("geometric", "#d08a1e", "2 3", "rays alone"),
    ("sagittal", "#1f5fa8", "6 3", "sagittal"),
    ("tangential", "#c0392b", "", "tangential"),
)
"""Name, colour, dashes and words of each curve, the most important one on top."""

_LEGEND_PX = (0, 80, 150, 235)
"""Places of the words about curves [px], as wide as those are."""


def lines(images: Sequence[PointImage], pitch_mm: float) -> list[str]:
    """A table of several images, and what its columns are."""
    nyquist = 1 / (2 * pitch_mm)
    head = ("place", "position", "object", "Airy radius", "wavefront", "Strehl", "MTF", "saddle")
    under = ("", "px", "mm", "um    px", "rms    PV", "", f"at {nyquist / 2:.0f}   at {nyquist:.0f}", "px")
    rows = [head, under, *(_row(image, pitch_mm) for image in images)]
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
    """The drawing as the text of an SVG file: a row for each image, which comes with words about its light."""
    items = [svg_file.words(title, (_MARGIN_PX, 24), font_size=14)]
    for number, (light, image) in enumerate(images):
        top = 40 + number * _ROW_PX
        items += [*_photograph(image, (_MARGIN_PX, top), pitch_mm), *_curves(image, (330, top + 10), pitch_mm)]
        items += _words(light, image, (800, top + 14), pitch_mm)
    height = 50 + len(images) * _ROW_PX
    return svg_file.document((_WIDTH_PX, height), *items, font_family="sans-serif", font_size=11)


def _photograph(image: PointImage, at: svg_file.Point, pitch_mm: float) -> list[str]:
    """The picture, the first dark ring of the Airy pattern, and the edges of a pixel."""
    grey = np.round(255 * (1 - image.picture**_GAMMA)).astype(np.uint8)
    data = "data:image/png;base64," + base64.b64encode(png_bytes(grey)).decode()
    x, y, scale = *at, _EDGE_PX / image.picture_um
    middle, half = (x + _EDGE_PX / 2, y + _EDGE_PX / 2), 500 * pitch_mm * scale
    box = {"x": x, "y": y, "width": _EDGE_PX, "height": _EDGE_PX}
    place = {"cx": middle[0], "cy": middle[1]}
    items = [
        svg_file.element("image", href=data, image_rendering="pixelated", **box),
        svg_file.element("rect", fill="none", stroke="#888888", **box),
        svg_file.element(
            "circle", r=image.airy_radius_um * scale, fill="none", stroke="#c0392b", stroke_dasharray="3 3", **place
        ),
    ]
    if half < _EDGE_PX / 2:
        corners = [(middle[0] + i * half, middle[1] + j * half) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        items.append(svg_file.area(corners, fill="none", stroke="#1f5fa8"))
    under = f"{image.picture_um:.1f} µm; blue: a pixel; red: Airy disc"
    return [*items, svg_file.words(under, (x, y + _EDGE_PX + 16))]


def _curves(image: PointImage, at: svg_file.Point, pitch_mm: float) -> list[str]:
    (left, top), (width, height), last = at, _PLOT_PX, float(image.per_mm[-1])

    def place(per_mm: float, value: float) -> svg_file.Point:
        return left + width * per_mm / last, top + height * (1 - value)

    items = [svg_file.area([place(0, 0), place(last, 0), place(last, 1), place(0, 1)], fill="none", stroke="#888888")]
    for name, colour, dashes, _ in _CURVES:
        points = [place(*pair) for pair in zip(image.per_mm.tolist(), getattr(image, name).tolist(), strict=True)]
        items.append(svg_file.line(points, stroke=colour, stroke_width=1.5, stroke_dasharray=dashes))
    nyquist = 1 / (2 * pitch_mm)
    if nyquist < last:
        items.append(svg_file.line([place(nyquist, 0), place(nyquist, 1)], stroke="#27803d", stroke_dasharray="1 3"))
        items.append(svg_file.words("Nyquist", (place(nyquist, 1)[0] + 3, top + 12), fill="#27803d"))
    ends = [(value, f"{value:g}") for value in (0, 0.5, 1)]
    items += [svg_file.words(text, (left - 6, place(0, v)[1] + 4), text_anchor="end") for v, text in ends]
    for share, after in pairwise((0.0, 0.25, 0.5, 0.75, 1.0, 1.25)):
        text = f"{share * last:.0f}" + (" per mm" if after > 1 else "")
        items.append(svg_file.words(text, (left + width * share, top + height + 16), text_anchor="middle"))
    for number, (_, colour, dashes, words) in enumerate(_CURVES[::-1]):
        x, y = left + _LEGEND_PX[number], top + height + 36
        items.append(svg_file.line([(x, y - 4), (x + 18, y - 4)], stroke=colour, stroke_dasharray=dashes))
        items.append(svg_file.words(words, (x + 22, y)))
    return items


def _words(light: str, image: PointImage, at: svg_file.Point, pitch_mm: float) -> list[str]:
    where = "infinity" if math.isinf(image.object_mm) else f"{image.object_mm:.1f} mm"
    texts = (
        f"{image.place}, ({image.x_px[0]:.1f}, {image.x_px[1]:.1f}) px",
        f"object at {where}, {light}",
        f"aperture {image.numerical_aperture:.4f} = F/{1 / (2 * image.numerical_aperture):.2f}",
        f"Airy radius {image.airy_radius_um:.2f} µm = {image.airy_radius_um / (1e3 * pitch_mm):.2f} px",
        f"wavefront {image.rms_waves:.3f} waves rms, {image.extent_waves:.2f} PV",
        f"Strehl ratio {image.strehl_ratio:.3f}",
        f"saddle moves by {_shift(image)} px",
    )
    return [svg_file.words(text, (at[0], at[1] + 18 * i)) for i, text in enumerate(texts)]
