"""What the paper says about its two figures, held against each setting."""

import itertools
from dataclasses import dataclass

import numpy as np
from bars import SETTINGS, Bar, bars, lengths, mapped, mean_and_error, reference
from results import Results, detected
from sampling import SAMPLINGS
from windows import METHODS

GAIN_PX, GAIN_SHARE = 0.0028, 0.016
"""The paper: what 320 x 320 samples gain over 128 x 128, in pixels and in detected corners."""
APART_PX = 0.016
"""The paper: the means of its two methods differ by less than this."""
YES, IN_SIGN, NO = "yes", "in sign", "no"
_BOOTSTRAPS = 400
_FEW, _SOME, _MANY = 64**2, 128**2, 320**2


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
    there = ~np.isnan(values)
    with np.errstate(invalid="ignore"):
        return np.where(there, values, 0.0).sum(axis=-1) / there.sum(axis=-1)


def largest_difference_px(all_bars: list[Bar], sampling: str, mapping: str) -> float:
    """Largest difference of the means of the paper's two methods, against K = 10 as in the paper."""
    means = {m: {(b.k, b.samples): b.k10_px for b in _of(all_bars, m, sampling, mapping)} for m in METHODS}
    return max(abs(value - means["two-plane"][key]) for key, value in means["image"].items() if not np.isnan(value))


def own_rays_difference_px(results: Results, mapping: str) -> float:
    """The same with independent rays of its own for `two-plane`, up to 128 x 128 samples."""
    k10, apart = reference(results, "independent", mapping), []
    for (i, k), j in itertools.product(enumerate(results.ks), range(results.other_px.shape[1])):
        both = results.x_px[SAMPLINGS.index("independent"), 0, i, j], results.other_px[i, j]
        image, two_plane = (mean_and_error(lengths(mapped(x, int(k), mapping), k10))[0] for x in both)
        apart.append(abs(image - two_plane))
    return float(np.nanmax(apart))


@dataclass(frozen=True, slots=True)
class Verdict:
    """A sentence of the paper in one setting: what is seen, and whether the sentence holds.

    `holds`: YES; IN_SIGN, the trend is there, its size or reach is another; NO.
    """

    seen: str
    holds: str


def judged(results: Results) -> dict[tuple[str, str], dict[str, Verdict]]:
    """Per setting, sentence by sentence."""
    all_bars = bars(results)
    return {(m, s): _judged(results, _of(all_bars, "image", s, m), m, s, all_bars) for m, s in SETTINGS}


def _judged(results: Results, image: list[Bar], mapping: str, sampling: str, all_bars: list[Bar]) -> dict[str, Verdict]:
    samples = [int(n) for n in results.samples]
    few, some, many = (n if n in samples else samples[-1] for n in (_FEW, _SOME, _MANY))
    lines = [[b for b in image if b.samples == n] for n in samples if n >= some]
    more, coarse = gains(results, sampling, mapping, some, many), gains(results, sampling, mapping, few, some)
    apart = largest_difference_px(all_bars, sampling, mapping)
    seen = f"{apart:.4f} px"
    if sampling == "independent":
        own = own_rays_difference_px(results, mapping)
        seen, apart = f"{seen}; {own:.4f} px with rays of their own", max(apart, own)
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
        f"the methods' means are within {APART_PX} px": Verdict(seen, YES if apart < APART_PX else NO),
    }


def _all_or_last(holds: list[bool]) -> str:
    """Whether something holds from 128 x 128 samples on, or for the most of them at least."""
    return YES if all(holds) else IN_SIGN if holds[-1] else NO


def _falls(line: list[Bar]) -> bool:
    """Whether means halve at least before the last, none rises by more than two standard errors, and errors fall."""
    mean, error = (np.array([getattr(b, name) for b in line]) for name in ("k10_px", "k10_sem_px"))
    steady = np.diff(mean) < 2 * np.hypot(error[1:], error[:-1])
    return bool(mean[-2] < mean[0] / 2 and steady.all() and error[-2] < error[0])


def _alike(seen: float, error: float, said: float) -> str:
    """Within a factor of two, because the paper's stop, pixels and poses are unknown; or a gain at least."""
    return YES if said / 2 <= seen <= said * 2 else IN_SIGN if seen > 2 * error and seen > said / 20 else NO


def _of(all_bars: list[Bar], method: str, sampling: str, mapping: str) -> list[Bar]:
    return [b for b in all_bars if (b.method, b.sampling, b.mapping) == (method, sampling, mapping)]
