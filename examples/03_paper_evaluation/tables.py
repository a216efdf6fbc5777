"""The tables that evaluate.py prints, as Markdown."""

from collections.abc import Iterable

import claims
import numpy as np
import reading
from bars import SETTINGS, Bar, bars, lengths
from results import Results
from sampling import SAMPLINGS
from windows import METHODS


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    head = list(head)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows))


def report(results: Results) -> str:
    """Everything, under headings."""
    all_bars = bars(results)
    parts = [_about(results), "## Does a setting say what the paper says?", _verdict(results)]
    for mapping, sampling in SETTINGS:
        for method in METHODS:
            chosen = [b for b in all_bars if (b.method, b.mapping, b.sampling) == (method, mapping, sampling)]
            parts += [f"## {method}, mapping {mapping}, rays {sampling}", _bars(chosen, results)]
    parts += ["## The printed mapping alone", _printed(results), "## Without noise", _without_noise(results)]
    parts += ["## lambda_d = 0.15 and noise", _noise(results), "## moments", _moments(all_bars, results)]
    return "\n\n".join([*parts, "## direct", _direct(all_bars, results)]) + "\n"


def _about(results: Results) -> str:
    sigma = np.hypot(*results.truth_sigma_px.T).max()
    edge = np.mean(results.hit_fraction < 0.999)
    low, middle, high = np.percentile(results.blur_px, (5, 50, 95))
    near = results.x_px[SAMPLINGS.index("independent"), :, :, 0]
    lost, moved = np.sum(np.isnan(near) != np.isnan(results.wide_px)), np.nanmax(np.abs(near - results.wide_px))
    return (
        f"{len(results.blur_px)} corners of {results.exist}, known to {sigma:.1g} px; blur per axis {middle:.2f} px"
        f" ({low:.2f} to {high:.2f}); of {edge:.0%} the stop cuts the bundle\n\n"
        f"Windows that reach twice as far find or lose {lost // 2} of {near[..., 0].size} positions, and move none by"
        f" more than {moved:.1g} px.\n\n"
        "Cells: mean difference from K = 10 and its standard error; from the truth; detected (no quad holds the corner,"
        " no room for 4 x 4, lengths, angles)"
    )


def _verdict(results: Results) -> str:
    judged = claims.judged(results)
    names = list(next(iter(judged.values())))
    rows = [[name, *(_seen(judged[setting][name]) for setting in SETTINGS)] for name in names]
    return table(["the paper says", *(f"{mapping}, {sampling}" for mapping, sampling in SETTINGS)], rows)


def _seen(verdict: claims.Verdict) -> str:
    return f"{verdict.holds}: {verdict.seen}"


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
    return "–" if np.isnan(mean) else f"{mean:.4f} ± {error:.4f}"


def _printed(results: Results) -> str:
    law = reading.printed_trend_px(results.ks.astype(float))
    seen = {
        b.k: b
        for b in bars(results)
        if (b.method, b.mapping, b.sampling, b.samples) == ("image", "printed", "ours", results.samples[-1])
    }
    rows = [
        [str(k), f"{expected:.4f}", _pm(seen[int(k)].k10_px, seen[int(k)].k10_sem_px)]
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


def _moments(all_bars: list[Bar], results: Results) -> str:
    by = {(b.k, b.samples): b for b in all_bars if b.method == "moments"}
    rows = []
    for i, k in enumerate(results.ks):
        kept = np.mean(results.moments_kept[i], axis=1)
        cells = [by[int(k), int(n)] for n in results.moments_samples]
        rows.append(
            [
                str(k),
                *(f"{b.mean_px:.1e}; {b.detected:.0%}, kept {share:.0%}" for b, share in zip(cells, kept, strict=True)),
            ]
        )
    return table(["K", *(f"{int(np.sqrt(n))}²" for n in results.moments_samples)], rows)


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
