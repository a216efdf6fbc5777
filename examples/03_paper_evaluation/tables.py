"""The tables that evaluate.py prints, as Markdown."""

from collections.abc import Iterable

import claims
import numpy as np
import precision
import reading
from bars import SETTINGS, Bar, bars, lengths, mean_and_error
from cost import PAPER_MIN, Cost
from results import Results, detected
from sampling import SAMPLINGS
from windows import METHODS, NO_FILTER, PLAIN, SINGLE, Variant


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    head = list(head)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def report(plenoptic: Results, conventional: Results, cost: Cost) -> str:
    """Everything, under headings."""
    parts = ["# Without microlenses", *_of_camera(conventional), "# The paper's camera", *_of_camera(plenoptic)]
    sentences = claims.further(plenoptic, conventional, cost)
    parts += [
        "# What else the paper says",
        table(["", ""], [[name, _cell_of_verdict(v)] for name, v in sentences.items()]),
    ]
    parts += ["## Other thresholds", _thresholds(plenoptic), "## Without microlenses", _conventional(conventional)]
    parts += ["## Single precision of the rays", _traced(plenoptic, conventional)]
    parts += ["## Single precision of the sums", _summed(plenoptic), "## Cost", _cost(cost)]
    return "\n\n".join(parts) + "\n"


def _of_camera(results: Results) -> list[str]:
    all_bars = bars(results)
    parts = [_about(results), "## Does a setting say what the paper says?", _verdict(results)]
    for mapping, sampling in SETTINGS:
        for method in METHODS:
            chosen = [b for b in all_bars if (b.method, b.mapping, b.sampling) == (method, mapping, sampling)]
            parts += [f"## {method}, mapping {mapping}, rays {sampling}", _bars(chosen, results)]
    parts += ["## The printed mapping alone", _printed(results), "## Without noise", _without_noise(results)]
    parts += ["## lambda_d = 0.15 and noise", _noise(results)]
    return [*parts, "## direct", _direct(all_bars, results)]


def _about(results: Results) -> str:
    sigma = np.hypot(*results.truth_sigma_px.T).max()
    edge = f"; of {np.mean(results.hit_fraction < 0.999):.0%} the stop cuts the bundle"
    low, middle, high = np.percentile(results.blur_px, (5, 50, 95))
    near = results.x_px[SAMPLINGS.index("independent"), :, :, 0]
    lost, moved = np.sum(np.isnan(near) != np.isnan(results.wide_px)), np.nanmax(np.abs(near - results.wide_px))
    return (
        f"{len(results.blur_px)} corners of {results.exist}, known to {sigma:.1g} px; blur per axis {middle:.2f} px"
        f" ({low:.2f} to {high:.2f}){'' if results.is_conventional else edge}\n\n"
        f"Windows that reach twice as far find or lose {lost // 2} of {near[..., 0].size} positions, and move none by"
        f" more than {moved:.1g} px.\n\n"
        "Cells: mean difference from K = 10 and its standard error; from the truth; detected (no quad holds the corner,"
        " no room for 4 x 4, lengths, angles)"
    )


def _verdict(results: Results) -> str:
    judged = claims.judged(results)
    names = list(next(iter(judged.values())))
    rows = [[name, *(_cell_of_verdict(judged[setting][name]) for setting in SETTINGS)] for name in names]
    return table(["the paper says", *(f"{mapping}, {sampling}" for mapping, sampling in SETTINGS)], rows)


def _cell_of_verdict(verdict: claims.Verdict) -> str:
    return f"{verdict.holds}: {verdict.observed}"


def _bars(chosen: list[Bar], results: Results) -> str:
    """K by samples: against K = 10, against the truth, detected."""
    by = {(b.k, b.samples): b for b in chosen}
    rows = [[str(k), *(_cell(by[int(k), int(n)]) for n in results.samples)] for k in results.ks]
    return table(["K", *(f"{int(np.sqrt(n))}²" for n in results.samples)], rows)


def _cell(b: Bar) -> str:
    return (
        f"{_pm(b.k10_px, b.k10_sem_px)}; {_pm(b.mean_px, b.sem_px)}; {b.detected:.0%}"
        f" ({b.no_quad}, {b.window}, {b.lengths}, {b.angles})"
    )


def _pm(mean: float, error: float) -> str:
    return "–" if np.isnan(mean) else f"{mean:.4f}" if np.isnan(error) else f"{mean:.4f} ± {error:.4f}"


def _printed(results: Results) -> str:
    law = reading.printed_trend_px(results.ks.astype(float))
    bar_of_k = {
        b.k: b
        for b in bars(results)
        if (b.method, b.mapping, b.sampling, b.samples) == ("image", "printed", "ours", results.samples[-1])
    }
    rows = [
        [str(k), f"{expected:.4f}", _pm(bar_of_k[int(k)].k10_px, bar_of_k[int(k)].k10_sem_px)]
        for k, expected in zip(results.ks, law, strict=True)
    ]
    return table(["K", "closed form, px", "ours, px"], rows)


def _without_noise(results: Results) -> str:
    rows = [
        [str(k), f"{share:.0%}", f"{median:.1e}", _pm(mean, error)]
        for k, share, median, mean, error in reading.without_noise(results)
    ]
    return table(["K", "detected", "median, px", "mean, px"], rows)


def _noise(results: Results) -> str:
    rows = [
        [f"{low:g} to {high:g}", str(cases), f"{share:.0%}", f"{ideal:.0%}"]
        for low, high, cases, share, ideal in reading.noise_law(results)
    ]
    return table(["rays / (K sigma / 0.03)²", "cases", "detected", "ideal grid"], rows)


def _direct(all_bars: list[Bar], results: Results) -> str:
    rows = [
        [f"{accuracy:g} px", f"{np.nanmax(lengths(x, results.truth_px)):.1e} px", f"{np.isfinite(x[:, 0]).mean():.0%}"]
        for accuracy, x in zip(results.accuracies_px, results.direct_px, strict=True)
    ]
    (judge,) = (b for b in all_bars if b.method == "direct")
    sigma = np.sqrt(np.mean(np.sum(results.judged_sigma_px**2, axis=1)))
    said = (
        f"Random rays move the truth by {judge.mean_px:.1e} px in the mean; their own standard error is {sigma:.1e} px."
    )
    return table(["wanted", "largest difference from the truth", "detected"], rows) + "\n\n" + said


SHARP_PX = 1.0
"""Blur up to which a corner counts as in focus [px]."""


def _thresholds(results: Results) -> str:
    """By thresholds: corners found with few samples and with many, outliers, and sentences of the paper that fail."""
    i, j, rows = [0, len(results.ks) // 2 - 1, -1], [0, -1], []
    usual = {PLAIN: claims.judged(results, (claims.AGREES,))[claims.AGREES]}
    for variant, sentences in (usual | claims.by_threshold(results)).items():
        variant_results = results.by(variant)
        shares = detected(variant_results.status[SAMPLINGS.index("independent"), 0])
        shares_found = [" ".join(f"{share:.0%}" for share in shares[i, n]) for n in j]
        far = ["{1} of {0}".format(*reading.found_and_outliers(variant_results, n)) for n in j]
        rows.append([*_limits(variant), *shares_found, *far, "; ".join(claims.failing(sentences)) or "none"])
    few, many = (f"{int(np.sqrt(n))}²" for n in results.samples[j])
    ks = ", ".join(f"{k}" for k in results.ks[i])
    head = [f"found at K = {ks}, {few}", many, f"beyond {reading.OUTLIER_PX} px, {few}", many, "fails"]
    return table(["λ_d", "λ_α", *head], rows)


def _limits(variant: Variant) -> tuple[str, str]:
    return ("none", "none") if variant == NO_FILTER else (f"{variant.lambda_d:g}", f"{variant.lambda_alpha_deg:g}°")


def _conventional(results: Results) -> str:
    """By K: share found of corners in focus, and of the others, and the mean difference from the truth of all found."""
    sharp = results.blur_px < SHARP_PX
    chosen = [(s, m, j) for s, m, j in ((0, 0, 0), (0, 0, 1), (0, 0, -1), (1, 0, 0), (1, 0, -1), (1, 1, -1))]
    rows = []
    for i, k in enumerate(results.ks):
        cells = []
        for s, m, j in chosen:
            shares = (f"{detected(results.status[s, m, i, j, focused]):.0%}" for focused in (sharp, ~sharp))
            error = mean_and_error(lengths(results.x_px[s, m, i, j], results.truth_px))
            cells.append(f"{' '.join(shares)}; {_pm(*error)}")
        rows.append([str(k), *cells])
    head = (f"{METHODS[m]}, {SAMPLINGS[s]}, {np.sqrt(results.samples[j]):.0f}²" for s, m, j in chosen)
    return f"{sharp.sum()} corners in focus, {(~sharp).sum()} others\n\n" + table(["K", *head], rows)


def _traced(*cameras: Results) -> str:
    """By distance: what float32 moves J by where it traces rays, and that in steps of the finest grid."""
    rows = []
    for results in cameras:
        name = "no microlenses" if results.is_conventional else "microlenses"
        for distance_mm in np.unique(results.distance_mm):
            moved = results.traced_px[:, results.distance_mm == distance_mm]
            rms, k = np.sqrt(np.mean(moved**2, axis=1)), results.ks[-1]
            steps = f"{k * moved.max():.1e}"
            rows.append([name, f"{distance_mm:g}", str(moved.shape[1]), *(f"{value:.1e}" for value in rms), steps])
    head = ["camera", "distance, mm", "corners", *(f"{variant}, px" for variant in precision.WAYS)]
    return table([*head, f"largest, steps at K = {cameras[0].ks[-1]}"], rows)


def _summed(results: Results) -> str:
    """By K and samples: what running sums in float32 move positions by, `image` and `two-plane`; shares found."""
    single, independent = results.by(SINGLE), SAMPLINGS.index("independent")
    rows = []
    for i, k in enumerate(results.ks):
        cells = []
        for j in range(len(results.samples)):
            moved = lengths(single.x_px[independent, :, i, j], results.x_px[independent, :, i, j])
            shares = detected(single.status[independent, :, i, j])
            means = " ".join(f"{mean_and_error(one)[0]:.4f}" for one in moved)
            cells.append(f"{means}; {shares[0]:.0%} {shares[1]:.0%}")
        rows.append([str(k), *cells])
    gains = [_gains(name, one) for name, one in (("double precision", results), ("running sums", single))]
    head = ["sums", "from K = 10, px", "from the truth, px"]
    return table(["K", *(f"{int(np.sqrt(n))}²" for n in results.samples)], rows) + "\n\n" + table(head, gains)


def _gains(name: str, results: Results) -> list[str]:
    """What the most samples gain over the second fewest: from the reference, and from the truth; means over K."""
    mapping, sampling = claims.AGREES
    pixels, error, *_ = claims.gains(results, sampling, mapping, *map(int, results.samples[[1, -1]]))
    x_px = results.x_px[SAMPLINGS.index(sampling), 0][:, [1, -1]]
    mean = np.array([[mean_and_error(one)[0] for one in lengths(x, results.truth_px)] for x in x_px]).mean(axis=0)
    return [name, f"{pixels:+.4f} ± {error:.4f}", f"{mean[0] - mean[1]:+.4f}"]


def _cost(cost: Cost) -> str:
    """The paper's law and our times by K and samples, then `direct`."""
    rows = []
    for k, samples in ((1, 64**2), (1, 320**2), (4, 64**2), (4, 128**2), (10, 320**2)):
        positions = cost.pixels * k**2
        law_s = positions * samples * PAPER_MIN * 60
        times = law_s, positions * samples * cost.planes.cpu_s, positions * cost.search.cpu_s
        rows.append([f"K = {k}, {int(np.sqrt(samples))}²", f"{positions * samples:.1e}", *map(_duration, times)])
    for claim_px, count, rays, spent in cost.direct:
        name = f"`direct` to {claim_px:g} px, {cost.poses} poses, {count} rows"
        rows.append([name, f"{rays:.1e}", "", _duration(spent.cpu_s), ""])
    clock = [1e9 * spent.wall_s for spent in (cost.planes, cost.board)]
    return "\n\n".join(
        [
            f"{cost.processor}. A ray of J_near and J_far takes {1e9 * cost.planes.cpu_s:.0f} ns of a core,"
            f" of J on a board {1e9 * cost.board.cpu_s:.0f} ns; by the clock {clock[0]:.0f} and {clock[1]:.0f} ns."
            f" `direct` took {_duration(cost.direct[0][3].wall_s)} by the clock.",
            table(["", "rays", "the paper's law, two Titan X", "here, one core", "search of a pose"], rows),
        ]
    )


def _duration(seconds: float) -> str:
    """Two digits, in the unit that suits."""
    units = ((86400.0, 86400.0, "d"), (3600.0, 3600.0, "h"), (60.0, 60.0, "min"), (0.0, 1.0, "s"))
    per, unit = next((per, unit) for least, per, unit in units if seconds >= 2 * least)
    return f"{seconds / per:.2g} {unit}"
