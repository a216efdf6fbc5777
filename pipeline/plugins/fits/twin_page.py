"""A fit to a real camera as lines for a terminal and the report, and as maps of its residuals.

Both are made of its document, the content of fitted.json.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.plugins.fits.twin import Group, region_of
from pipeline.records.plain import Json
from pipeline.results.notebook import figure, svg_of

_LEAST_COMPONENT = 0.05
"""Component of a direction, over the largest, up to which a number is not named [1]."""
_WIDTH_IN, _WORDS_IN = 9.0, 0.9
"""Width of the map of a camera, and height of its words [inch]."""
_ACROSS = 4
"""Maps of frames side by side."""
_LONGEST = 0.06
"""Length of a residual of five sigma over the width of the image [1]: lines of noise hardly touch."""
_RED, _DARK = "#c0392b", "#333333"


def page(fit: Json) -> Iterator[str]:
    """Lines about the document of a fit."""
    rows = fit["rows"]
    cameras, views = len(set(rows["camera"])), fit["views"]
    of_views = f" in {views} view{'s' * (views > 1)}" if views else ""  # white images alone show no board
    yield f"{len(rows['camera'])} positions ({fit['position']}) of {cameras} camera{'s' * (cameras > 1)}{of_views}"
    state = "converged" if fit["converged"] else "NOT CONVERGED"
    yield f"{state} after {fit['steps']} step{'s' * (fit['steps'] > 1)}: {fit['ending']}"
    chi2, expected = sum(rows["chi2"]), sum(rows["expected"])
    times = f": errors are {(chi2 / expected) ** 0.5:.3g} times sigma" if expected > 0 else ""
    yield f"chi squared {chi2:.6g}, expected {expected:.6g}{times}"
    yield ""
    yield f"{'number':44} {'before':>13} {'after':>13} {'deviation':>10} {'prior':>10} {'share':>6}"
    for number in fit["numbers"]:
        deviation = "open" if number["deviation"] is None else f"{number['deviation']:.3g}"
        prior = "none" if number["prior"] is None else f"{number['prior']:.3g}"
        if number["prior"] is None and number["reach"] is not None:
            prior = f"±{number['reach']:.3g}"
        bound = "  at its bound" if number["at_bound"] else ""
        values = f"{number['before']:13.8g} {number['after']:13.8g}"
        yield f"{_short(number['name'])} {values} {deviation:>10} {prior:>10} {number['information_share']:6.1%}{bound}"
    for name in fit["fixed"]:
        yield f"{name}: fixed, its tolerance has no width"
    units = {number["name"]: number["unit"] for number in fit["numbers"]}
    for direction in fit["open"]:
        held = "held by tolerances" if fit["open_are_held"] else "not moved"
        steps = [*_open_steps(direction, units)]
        yield f"open: no row changes with {'these steps together' if len(steps) > 1 else 'this step'}; {held}"
        yield from steps
    yield ""
    yield "chi squared over what noise leaves"
    for kind, groups in fit["chi2"].items():
        ratios = [
            f"{group['name']}: {group['chi2'] / group['expected']:.3f}" for group in groups if group["expected"] > 0
        ]
        yield f"  by {kind:7} {'; '.join(ratios)}"
    yield from (f"  note: {note}" for note in fit["notes"])
    yield from (f"  DOUBT: {doubt}" for doubt in fit["doubts"])


def _open_steps(direction: Json, units: dict[str, str]) -> Iterator[str]:
    """Lines about steps of numbers that together change no row, in their units, the one that rows would show best
    first; a number that hardly moves has none.
    """
    size = {name: round(abs(part["component"]), 6) for name, part in direction.items()}  # equal ones keep their order
    least = _LEAST_COMPONENT * max(size.values())
    named = sorted((name for name in size if size[name] > least), key=lambda name: -size[name])
    sign = 1 if direction[named[0]]["step"] > 0 else -1
    for name in named:
        unit = units[name].removesuffix("none")
        yield f"  {_short(name)} {sign * direction[name]['step']:+13.3g} {unit}".rstrip()


def _short(name: str) -> str:
    """The end of a name, in a column."""
    return f"{name if len(name) <= 44 else f'…{name[-43:]}':44}"


def residual_maps(fit: Json, only: str | None = None) -> str:
    """The residual of each position, predicted minus observed, over the image of each camera, as SVG: of all frames,
    with chi squared of each region over what noise leaves, and of each frame. `only`: the camera that is drawn.
    """
    names = [only] if only else sorted(set(fit["rows"]["camera"]))
    cameras = [_Residuals(fit, name) for name in names]
    heights = [sum(camera.heights_in) for camera in cameras]
    drawing = figure(_WIDTH_IN, sum(heights))
    parts = drawing.subfigures(len(cameras), 1, squeeze=False, height_ratios=heights)[:, 0]
    for camera, part in zip(cameras, parts, strict=True):
        camera.draw(part)
    return svg_of(drawing)


class _Residuals:
    """The residuals of a camera, and their maps."""

    def __init__(self, fit: Json, name: str) -> None:
        rows = {key: np.array(fit["rows"][key]) for key in ("camera", "x_px", "sigma_px", "chi2", "expected")}
        residual_px = np.array(fit["rows"]["residual_px"], float)
        frame = np.array(["white image" if n is None else f"frame {n}" for n in fit["rows"]["frame"]])
        is_of_camera = rows["camera"] == name
        kept = is_of_camera & np.isfinite(residual_px[:, 0])
        self._name, self._size_px = name, np.array(fit["sizes_px"][name])
        self._x_px = rows["x_px"][kept]
        self._residual_px = residual_px[kept]
        self._frame = frame[kept]
        self._chi2, self._expected = rows["chi2"][kept], rows["expected"][kept]
        self._times = _LONGEST * self._size_px[0] / (5 * float(np.median(rows["sigma_px"][is_of_camera])))
        self._frames = list(dict.fromkeys(self._frame.tolist()))

    @property
    def heights_in(self) -> list[float]:
        """Heights of the map of all frames, and of each line of those of the frames [inch]."""
        shape, lines = self._size_px[1] / self._size_px[0], -(-len(self._frames) // _ACROSS)
        return [_WIDTH_IN * shape + _WORDS_IN, *[_WIDTH_IN / _ACROSS * shape + _WORDS_IN / 2] * lines]

    def draw(self, figure: Any) -> None:
        """Draw them: the map of all frames, and below it those of the frames."""
        grid = figure.add_gridspec(len(self.heights_in), _ACROSS, height_ratios=self.heights_in)
        axes = figure.add_subplot(grid[0, :])
        self._map(axes, np.ones(len(self._frame), bool))
        rms_px = float(np.sqrt(np.mean(self._residual_px**2))) if len(self._residual_px) else np.nan
        title = f"{self._name}: predicted minus observed, {self._times:.3g} times; {rms_px:.3g} px rms"
        axes.set_title(f"{title}; χ² over what noise leaves", fontsize="medium")
        axes.set(xlabel="x [px]", ylabel="y [px]")
        self._regions(axes)
        for i, frame in enumerate(self._frames):
            axes = figure.add_subplot(grid[1 + i // _ACROSS, i % _ACROSS])
            rows = self._frame == frame
            self._map(axes, rows)
            group = self._group(rows)
            axes.set_title(f"{frame}: {_times_expected(group)}", fontsize="small", color=_colour(group))
            axes.set(xticks=[], yticks=[])

    def _map(self, axes: Any, rows: np.ndarray) -> None:
        """Draw a line from each position, as many times longer than its residual as the title says."""
        starts = self._x_px[rows]
        ends = starts + self._times * self._residual_px[rows]
        x, y = np.stack([starts, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2).T
        axes.plot(x, y, color=_RED, linewidth=0.8)
        axes.plot(*starts.T, ".", color=_DARK, markersize=2)
        wide, high = self._size_px
        axes.set(xlim=(-0.5, wide - 0.5), ylim=(high - 0.5, -0.5), aspect="equal")

    def _regions(self, axes: Any) -> None:
        """Draw the borders of regions, and in each chi squared over what noise leaves."""
        region, (wide, high) = region_of(self._x_px, self._size_px), self._size_px / 3
        for i in np.unique(region).tolist():
            group, (row, column) = self._group(region == i), divmod(i, 3)
            corner_px = (column * wide + 0.02 * wide, row * high + 0.02 * wide)
            axes.text(*corner_px, _times_expected(group), va="top", fontsize="small", color=_colour(group))
        for draw_line, step in ((axes.axvline, wide), (axes.axhline, high)):
            for third in (1, 2):
                draw_line(third * step - 0.5, color="#bbbbbb", linewidth=0.6, zorder=0)

    def _group(self, rows: np.ndarray) -> Group:
        sums = {"chi2": float(self._chi2[rows].sum()), "expected": float(self._expected[rows].sum())}
        return Group(name="", rows=int(rows.sum()), **sums)


def _times_expected(group: Group) -> str:
    return f"χ² {group.chi2 / group.expected:.2f}" if group.expected > 0 else "χ² –"


def _colour(group: Group) -> str:
    return _RED if group.is_doubted else _DARK
