"""Spots of a camera for notebooks: as numbers, as an SVG picture, and as a plot."""

from dataclasses import dataclass, field
from typing import Any

from pipeline.camera.parts.camera import Camera
from pipeline.notebook.axes import axes as new_axes
from pipeline.report import svg
from pipeline.report.page.records import Spot
from pipeline.report.page.spots import field_bundles, spots

_CELL_PX, _HEAD_PX = 150, 40
"""Edge of a spot's square in the picture, and the height of the words above it [px]."""
_CELL_IN = 2.2
"""Edge of a spot's axes in a plot [inch]: four of them fill the width of a page."""
_LEAST_PX = 0.6
"""Least half width of a square [px]: the outline of the pixel is seen in it."""
_INK, _PIXEL = "#2f7fe0", "#e8702a"


@dataclass(frozen=True, slots=True, kw_only=True)
class SpotDiagram:
    """Spots from the centre to the corner of the image, at the ends and in the middle of the depth of field.

    Attributes
    ----------
    name : str
        Name of the camera.
    spots : tuple of Spot
        Rays of one image position where they cross a plane of the scene, as displacements in the image [px].
    """

    name: str
    spots: tuple[Spot, ...] = field(repr=False)

    @property
    def rows(self) -> list[list[Spot]]:
        """The spots of each distance, from the centre to the corner."""
        distances = dict.fromkeys(one.distance_mm for one in self.spots)
        return [[one for one in self.spots if one.distance_mm == distance] for distance in distances]

    @property
    def reach_px(self) -> float:
        """Half width of the squares in which all spots are drawn [px]."""
        parts = (value for one in self.spots for value in (*one.dx_px, *one.dy_px) if value is not None)
        return 1.1 * max(_LEAST_PX, *map(abs, parts), 0.0)

    def plot(self) -> Any:
        """Plot all spots at one scale, with the square of a pixel; returns the axes, a row per distance.

        Raises
        ------
        UsageError
            matplotlib is not installed.
        """
        rows, reach = self.rows, self.reach_px
        width, height = len(rows[0]), len(rows)
        sheets = new_axes(_CELL_IN * width, _CELL_IN * height + 0.4, rows=height, columns=width)
        for line, row in zip(sheets, rows, strict=True):
            for sheet, spot in zip(line, row, strict=True):
                _plot(sheet, spot, reach)
        return sheets

    def _repr_svg_(self) -> str:
        """The picture, for a notebook."""
        rows = self.rows
        cells = [_cell(spot, (i, j), self.reach_px) for j, row in enumerate(rows) for i, spot in enumerate(row)]
        size = (float(_CELL_PX * len(rows[0])), float((_CELL_PX + _HEAD_PX) * len(rows)))
        return svg.document(size, *(item for cell in cells for item in cell))


def spot_diagram(camera: Camera, name: str) -> SpotDiagram:
    """Trace the spots of a focused camera."""
    return SpotDiagram(name=name, spots=spots(camera, field_bundles(camera)))


def _words(spot: Spot) -> tuple[str, str]:
    size = "no light" if spot.rms_px is None else f"{spot.rms_px:.3g} px rms"
    return spot.place, f"{spot.distance_mm:.5g} mm: {size}"


def _plot(sheet: Any, spot: Spot, reach_px: float) -> None:
    sheet.plot(spot.dx_px, spot.dy_px, ".", color=_INK, markersize=2)
    sheet.plot([-0.5, 0.5, 0.5, -0.5, -0.5], [-0.5, -0.5, 0.5, 0.5, -0.5], color=_PIXEL, linewidth=0.8)
    sheet.set(aspect="equal", xlim=(-reach_px, reach_px), ylim=(reach_px, -reach_px))
    sheet.set_title("\n".join(_words(spot)), fontsize=8)


def _cell(spot: Spot, at: tuple[int, int], reach_px: float) -> list[str]:
    """Elements of a spot in its column and row."""
    left, top, scale = at[0] * _CELL_PX, at[1] * (_CELL_PX + _HEAD_PX), _CELL_PX / 2 / reach_px
    middle = left + _CELL_PX / 2, top + _HEAD_PX + _CELL_PX / 2
    pairs = zip(spot.dx_px, spot.dy_px, strict=True)
    dots = [(middle[0] + dx * scale, middle[1] + dy * scale) for dx, dy in pairs if dx is not None and dy is not None]
    round_ends: dict[str, str | float] = {
        "stroke": _INK,
        "stroke_width": 2.0,
        "stroke_linecap": "round",
    }  # a line of no length is a dot
    shown = svg.path([step for dot in dots for step in (("M", (dot,)), ("L", (dot,)))], fill="none", **round_ends)
    style = {"font_family": "sans-serif", "font_size": "10"}
    lines = [svg.words(text, (left + 4, top + 14 + 14 * i), **style) for i, text in enumerate(_words(spot))]
    corners = [(middle[0] + x * scale / 2, middle[1] + y * scale / 2) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    frame = svg.element(
        "rect", x=left + 2, y=top + _HEAD_PX, width=_CELL_PX - 4, height=_CELL_PX - 2, fill="none", stroke="#dddddd"
    )
    return [*lines, frame, svg.area(corners, fill="none", stroke=_PIXEL), shown]
