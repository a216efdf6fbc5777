"""What the paper says about its two figures, held against each setting."""

import itertools
from dataclasses import dataclass

import numpy as np
from bars import SETTINGS, Bar, bars, lengths, mapped, mean_and_error, reference
from cost import Cost
from reading import found_and_outliers
from results import Results, detected
from sampling import SAMPLINGS
from windows import METHODS, NO_FILTER, PLAIN, SINGLE, VARIANTS, Variant

GAIN_PX, GAIN_SHARE = 0.0028, 0.016
"""The paper: what 320 x 320 samples gain over 128 x 128, in pixels and in detected corners."""
APART_PX = 0.016
"""The paper: the means of its two methods differ by less than this."""
AGREES = "half-pixel", "independent"
"""The only setting in which no sentence fails."""
YES, IN_SIGN, NO = "yes", "in sign", "no"
_BOOTSTRAPS = 400
_FEW, _MEDIUM, _MANY = 64**2, 128**2, 320**2


def gains(results: Results, sampling: str, mapping: str, few: int, many: int) -> tuple[float, float, float, float]:
    """What more samples gain, mean over K of the bars of `image`: pixels and its error, share and its error.

    Errors by drawing the corners again, with repetition.
    """
    s, where = SAMPLINGS.index(sampling), [list(results.samples).index(count) for count in (few, many)]
    k10 = reference(results, sampling, mapping)
    apart = np.array(
        [
            [lengths(mapped(results.x_px[s, 0, i, j], int(k), mapping), k10) for j in where]
            for i, k in enumerate(results.ks)
        ]
    )
    status = results.status[s, 0][:, where]
    random = np.random.default_rng(1)

    def gain(rows: np.ndarray) -> tuple[float, float]:
        means, shares = _mean(apart[..., rows]), detected(status[..., rows])
        return float(_mean(means[:, 0] - means[:, 1])), float(np.mean(shares[:, 1] - shares[:, 0]))

    n = status.shape[-1]
    again = np.array([gain(random.integers(0, n, n)) for _ in range(_BOOTSTRAPS)]).std(axis=0)
    pixels, share = gain(np.arange(n))
    return pixels, float(again[0]), share, float(again[1])


def _mean(values: np.ndarray) -> np.ndarray:
    """Mean over the last axis of what is there; NaN of nothing."""
    finite = ~np.isnan(values)
    with np.errstate(invalid="ignore"):
        return np.where(finite, values, 0.0).sum(axis=-1) / finite.sum(axis=-1)


def largest_difference_px(all_bars: list[Bar], sampling: str, mapping: str) -> float:
    """Largest difference of the means of the paper's two methods, against K = 10 as in the paper."""
    means = [[b.k10_px for b in _chosen(all_bars, method, sampling, mapping)] for method in METHODS]
    apart = np.abs(np.diff(means, axis=0))
    return float(apart[~np.isnan(apart)].max(initial=0.0))


def own_rays_difference_px(results: Results, mapping: str) -> float:
    """The same with independent rays of its own for `two-plane`, up to 128 x 128 samples."""
    k10, apart = reference(results, "independent", mapping), []
    for (i, k), j in itertools.product(enumerate(results.ks), range(results.other_px.shape[1])):
        both = results.x_px[SAMPLINGS.index("independent"), 0, i, j], results.other_px[i, j]
        image, two_plane = (mean_and_error(lengths(mapped(x, int(k), mapping), k10))[0] for x in both)
        apart.append(abs(image - two_plane))
    finite = ~np.isnan(apart)
    return float(np.max(apart, where=finite, initial=0.0))


@dataclass(frozen=True, slots=True)
class Verdict:
    """A sentence of the paper in one setting: what is observed, and whether the sentence holds.

    `holds`: YES; IN_SIGN, the trend is there, its size or reach is another; NO.
    """

    observed: str
    holds: str


def judged(
    results: Results, settings: tuple[tuple[str, str], ...] = SETTINGS
) -> dict[tuple[str, str], dict[str, Verdict]]:
    """Per setting, sentence by sentence."""
    all_bars = bars(results)
    return {(m, s): _judged(results, _chosen(all_bars, "image", s, m), m, s, all_bars) for m, s in settings}


def by_threshold(results: Results) -> dict[Variant, dict[str, Verdict]]:
    """The same in the setting that agrees, with other thresholds of the filters, and without these."""
    variants = [variant for variant in VARIANTS if variant.precision == PLAIN.precision]
    return {variant: judged(results.by(variant), (AGREES,))[AGREES] for variant in variants}


def _judged(results: Results, image: list[Bar], mapping: str, sampling: str, all_bars: list[Bar]) -> dict[str, Verdict]:
    samples = [int(n) for n in results.samples]
    few, medium, many = (n if n in samples else samples[-1] for n in (_FEW, _MEDIUM, _MANY))
    lines = [[b for b in image if b.samples == n] for n in samples if n >= medium]
    more, coarse = gains(results, sampling, mapping, medium, many), gains(results, sampling, mapping, few, medium)
    apart = largest_difference_px(all_bars, sampling, mapping)
    observed = f"{apart:.4f} px"
    if sampling == "independent":
        own = own_rays_difference_px(results, mapping)
        observed, apart = f"{observed}; {own:.4f} px with rays of their own", max(apart, own)
    mean, share = (
        " ".join(cells) for cells in zip(*((f"{b.k10_px:.4f}", f"{b.detected:.0%}") for b in lines[-1]), strict=True)
    )
    falls, rises = [_falls(line) for line in lines], [line[-1].detected > line[0].detected for line in lines]
    worse = coarse[0] > GAIN_PX / 2 or coarse[2] > GAIN_SHARE
    return {
        "error and variance fall with K": Verdict(mean, _all_or_last(falls)),
        "detected corners rise with K": Verdict(share, _all_or_last(rises)),
        f"320² gains {GAIN_PX} px over 128²": Verdict(f"{more[0]:+.4f} ± {more[1]:.4f} px", _alike(*more[:2], GAIN_PX)),
        f"320² gains {GAIN_SHARE:.1%} of the corners over 128²": Verdict(
            f"{more[2]:+.1%} ± {more[3]:.1%}", _alike(*more[2:], GAIN_SHARE)
        ),
        "64² is visibly worse than 128²": Verdict(
            f"{coarse[0]:+.4f} ± {coarse[1]:.4f} px, {coarse[2]:+.1%} ± {coarse[3]:.1%} corners", YES if worse else NO
        ),
        f"the methods' means are within {APART_PX} px": Verdict(observed, YES if apart < APART_PX else NO),
    }


def further(plenoptic: Results, conventional: Results, cost: Cost) -> dict[str, Verdict]:
    """What else the paper says: of thresholds, of conventional cameras, of single precision, of time."""
    usual, (alike,) = judged(plenoptic, (AGREES,))[AGREES], judged(conventional, (AGREES,)).values()
    kept = [set(failing(other)) <= set(failing(usual)) for other in by_threshold(plenoptic).values()]
    harmed = failing(alike)
    planes, samples = cost.planes.cpu_s / cost.board.cpu_s, plenoptic.samples[[0, -1]]
    less = samples * cost.planes.cpu_s / cost.search.cpu_s
    return {
        "the conclusions hold for other thresholds": Verdict(
            f"all of them with {sum(kept)} of {len(kept)} others", _by_majority(float(np.mean(kept)))
        ),
        "thresholds mainly regulate the number of outliers": _outliers(plenoptic),
        "conventional cameras are alike": Verdict(
            f"without microlenses fail: {'; '.join(harmed) or 'none'}", NO if harmed else YES
        ),
        **_single_precision(plenoptic),
        "`two-plane` is faster from more than two images": Verdict(
            f"J_near and J_far together cost {planes:.2f} J of a board", YES if planes < 2 else NO
        ),
        "the search takes orders of magnitude less time": Verdict(
            " and ".join(
                f"{times:.0f} times less than {np.sqrt(n):.0f}² rays" for times, n in zip(less, samples, strict=True)
            ),
            YES if less[0] > 100 else NO,
        ),
    }


def failing(sentences: dict[str, Verdict]) -> list[str]:
    """Sentences that do not hold."""
    return [name for name, verdict in sentences.items() if verdict.holds == NO]


def _outliers(results: Results) -> Verdict:
    """From the strictest to the loosest lambda_d, and without a filter: positions found, and outliers among them."""
    limits = sorted(variant.lambda_d for variant in VARIANTS)
    variants = Variant(lambda_d=limits[0]), Variant(lambda_d=limits[-1]), NO_FILTER
    accepted, outliers = np.array([found_and_outliers(results.by(variant), 0) for variant in variants]).T
    shares = outliers / np.maximum(accepted, 1)
    observed = (
        f"λ_d = {limits[0]:g} to {limits[-1]:g} finds {accepted[0]} to {accepted[1]} positions, {shares[0]:.0%} to"
        f" {shares[1]:.0%} of them outliers; no filter {accepted[2]}, {shares[2]:.0%}"
    )
    more = shares[1:] / max(shares[0], 1e-9)
    return Verdict(
        observed, YES if more[0] > accepted[1] / accepted[0] else IN_SIGN if more[1] > accepted[2] / accepted[0] else NO
    )


def _single_precision(results: Results) -> dict[str, Verdict]:
    rays, sums = results.traced_px.mean(axis=1)[:2], [values.mean() for values in moved_by_sums_px(results)]
    apart = [largest_difference_px(bars(results.by(v)), *reversed(AGREES)) for v in (PLAIN, SINGLE)]
    return {
        "single precision harms `two-plane` more": Verdict(
            f"rays move `image` by {rays[0]:.0e} px, `two-plane` by {rays[1]:.0e} px;"
            f" running sums by {sums[0]:.4f} and {sums[1]:.4f} px",
            _by_majority(float(np.mean([rays[1] > 1.5 * rays[0], sums[1] > 1.5 * sums[0]]))),
        ),
        "single precision moves the methods' means apart": Verdict(
            f"by {apart[1]:.4f} px, where double precision has {apart[0]:.4f} px; running sums of independent rays",
            YES if apart[1] > 2 * apart[0] else NO,
        ),
    }


def moved_by_sums_px(results: Results) -> list[np.ndarray]:
    """What running sums in float32 move positions by the most samples by, of each method: all that both find."""
    independent = SAMPLINGS.index("independent")
    apart = [
        lengths(results.by(SINGLE).x_px[independent, m, :, -1], results.x_px[independent, m, :, -1])
        for m in range(len(METHODS))
    ]
    return [values[~np.isnan(values)] for values in apart]


def _by_majority(share: float) -> str:
    return YES if share == 1 else IN_SIGN if share >= 0.5 else NO


def _all_or_last(holds: list[bool]) -> str:
    """Whether something holds from 128 x 128 samples on, or for the most of them at least."""
    return YES if all(holds) else IN_SIGN if holds[-1] else NO


def _falls(line: list[Bar]) -> bool:
    """Whether means halve at least before the last, none rises by more than two standard errors, and errors fall."""
    mean, error = (np.array([getattr(b, name) for b in line]) for name in ("k10_px", "k10_sem_px"))
    steady = np.diff(mean) < 2 * np.hypot(error[1:], error[:-1])
    return bool(mean[-2] < mean[0] / 2 and steady.all() and error[-2] < error[0])


def _alike(gain: float, error: float, said: float) -> str:
    """Within a factor of two, because the paper's stop, pixels and poses are unknown; or a gain at least."""
    return YES if said / 2 <= gain <= said * 2 else IN_SIGN if gain > 2 * error and gain > said / 20 else NO


def _chosen(all_bars: list[Bar], method: str, sampling: str, mapping: str) -> list[Bar]:
    return [b for b in all_bars if (b.method, b.sampling, b.mapping) == (method, sampling, mapping)]
