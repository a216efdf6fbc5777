"""A fit to a real camera as lines for a terminal, and as maps of its residuals."""

from collections.abc import Iterator

import numpy as np

from pipeline.plugins.fits.twin import Twin
from pipeline.results.notebook import figure, svg_of

_LEAST_PART = 0.05
"""Part of a direction below which a number is not named [1]."""
_WIDTH_IN, _WORDS_IN = 9.0, 0.9
"""Width of the map of a camera, and height of its words [inch]."""
_LONGEST = 0.06
"""Length of a residual of five sigma over the width of the image [1]: lines of noise hardly touch."""


def page(twin: Twin) -> Iterator[str]:
    """Lines for a terminal."""
    seen, solution = twin.observations, twin.solution
    cameras, views = len(np.unique(seen.camera)), len(twin.views.keys)
    yield f"{len(seen)} positions ({seen.kinds}) of {cameras} camera{'s' * (cameras > 1)} in {views} views"
    state = "converged" if solution.converged else "NOT CONVERGED"
    yield f"{state} after {solution.steps} steps: {solution.ending}"
    everything = twin.group("all", np.ones(len(seen), bool))
    yield f"chi squared {everything.chi2:.6g}, expected {everything.expected:.6g}"
    yield ""
    yield f"{'number':44} {'before':>13} {'after':>13} {'deviation':>10} {'prior':>10} {'told':>6}"
    for number, by, deviation, told, bound in zip(
        twin.stage.numbers, solution.by, solution.deviation, solution.told, solution.at_bound, strict=True
    ):
        prior = f"{number.deviation:10.3g}" if np.isfinite(number.deviation) else f"{'none':>10}"
        if number.prior is not None and number.prior.distribution == "uniform":
            prior = f"{'±' + format(number.reach, '.3g'):>10}"
        shown = f"{deviation:10.3g}" if np.isfinite(deviation) else f"{'open':>10}"
        end = "  at its bound" if bound else ""
        name = number.name if len(number.name) <= 44 else f"…{number.name[-43:]}"
        yield f"{name:44} {number.before:13.8g} {number.before + by:13.8g} {shown} {prior} {told:6.1%}{end}"
    for name in twin.stage.fixed:
        yield f"{name}: fixed, its tolerance has no width"
    for direction in solution.open_directions:
        parts = [
            f"{number.name} {part:+.3g}"
            for number, part in zip(twin.stage.numbers, direction, strict=True)
            if abs(part) > _LEAST_PART
        ]
        held = "not moved" if len(solution.unmoved) else "held by tolerances"
        yield f"open: the rows do not tell {', '.join(parts)}, together; {held}"
    yield ""
    yield "chi squared over what noise leaves"
    for kind, groups in twin.groups.items():
        parts = [f"{each.name}: {each.chi2 / each.expected:.3f}" for each in groups if each.expected > 0]
        yield f"  by {kind:7} {'; '.join(parts)}"
    yield from (f"  note: {each}" for each in twin.untold)
    yield from (f"  DOUBT: {each}" for each in twin.doubts)


def residual_maps(twin: Twin) -> str:
    """The residual of each position, predicted minus observed, over the image of each camera, as SVG."""
    sizes, seen = twin.sizes_px, twin.observations
    names = np.unique(seen.camera).tolist()
    heights = [_WIDTH_IN * sizes[name][1] / sizes[name][0] + _WORDS_IN for name in names]
    shown = figure(_WIDTH_IN, sum(heights))
    panels = shown.subplots(len(names), 1, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
    for name, axes in zip(names, panels, strict=True):
        rows = (seen.camera == name) & np.isfinite(twin.solution.residual_px[:, 0])
        wide, high = sizes[name]
        times = _LONGEST * wide / (5 * float(np.median(seen.sigma_px[rows])))
        starts = seen.x_px[rows]
        ends = starts + times * twin.solution.residual_px[rows]
        x, y = np.stack([starts, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2).T
        axes.plot(x, y, color="#c0392b", linewidth=0.8)
        axes.plot(*starts.T, ".", color="#333333", markersize=2)
        axes.set(xlim=(-0.5, wide - 0.5), ylim=(high - 0.5, -0.5), aspect="equal", xlabel="x [px]", ylabel="y [px]")
        rms_px = float(np.sqrt(np.mean(twin.solution.residual_px[rows] ** 2)))
        axes.set_title(f"{name}: predicted minus observed, {times:.3g} times; {rms_px:.3g} px rms", fontsize="medium")
    return svg_of(shown)
