"""Animated attributes: times of knots, bends and ends, and the range of values.

A spline, USD's animation curve, has knots with straight, curved or level pieces between them, and no time samples. All
times are those of the stage, after the offsets of layers.
"""

import itertools
import math
from collections.abc import Iterable

import numpy as np
from pxr import Gf, Ts, Usd

from pipeline.motion import NODES, node_shares, node_times
from pipeline.scene.usd.values import UnreadableValue

_MOST_LOOPS = 100
"""Most repetitions of a spline during one exposure [1]: a motion is kept by its pieces, and each has some."""
_HALVINGS = 10
"""Most halvings of a curve: where its tangent is upright, no polynomial follows it."""
_ACCURACY = 1e-12
"""Error of the polynomials of a motion over the largest value of a curve [1], doubled with each halving: steep curves
are rounded more, and shorter pieces last for less time."""
_SAMPLES = 64
"""Values of a curve that are checked [1]: between them its extreme is missed by 1e-4 of its height."""


def bends(attributes: Iterable[Usd.Attribute], first: float, last: float) -> set[float]:
    """Time codes between which attributes are smooth, complete from `first` to `last`."""
    codes = set[float]()
    for attribute in attributes:
        codes.update(attribute.GetTimeSamples())
        if not attribute.HasSpline():
            continue
        spline = attribute.GetSpline()
        knots = list(spline.GetKnots())
        if spline.HasExtrapolatingLoops() and last - first > _MOST_LOOPS * (knots[-1] - knots[0]):
            loops = f"repeats its spline more than {_MOST_LOOPS} times while a shutter is open"
            raise UnreadableValue(
                f'"{attribute.GetName()}" {loops}', attribute, "write the repetitions that are meant as knots", "spline"
            )
        baked = spline.GetKnotsWithLoopsBaked(Gf.Interval(first, last))
        codes.update(baked)
        for start, end in _curved(baked):
            codes.update(_pieces(spline, max(first, start), min(last, end)) if first < end and start < last else ())
    return codes


def _pieces(spline: Ts.Spline, start: float, end: float, halvings: int = _HALVINGS) -> list[float]:
    """Starts of pieces of a curve on which the polynomial through the nodes of a motion follows it.

    The curve is halved, at most `halvings` times, until the polynomial agrees with it in the middle between the nodes.
    """
    edges = np.array([start, end])
    # Every other time is a node of the polynomial; those between test it. The end is that of this piece, before a jump.
    times = node_times(edges, 2 * NODES - 1)[0]
    values = np.array([*map(spline.Eval, times[:-1].tolist()), spline.EvalPreValue(end)])
    error = np.abs(node_shares(edges, NODES, times[1::2])[1] @ values[::2] - values[1::2]).max()
    if not halvings or not error > _ACCURACY * 2 ** (_HALVINGS - halvings) * np.abs(values).max():
        return [start]
    middle = (start + end) / 2
    return [*_pieces(spline, start, middle, halvings - 1), *_pieces(spline, middle, end, halvings - 1)]


def extent(attribute: Usd.Attribute) -> tuple[float, float] | None:
    """First and last time code between which an attribute changes, infinite for loops and slopes; None: it holds."""
    spline = attribute.GetSpline()
    times = list(spline.GetKnots()) if attribute.HasSpline() else attribute.GetTimeSamples()
    before, after = (end.mode != Ts.ExtrapHeld for end in (spline.GetPreExtrapolation(), spline.GetPostExtrapolation()))
    if len(times) < 2 and not (times and (before or after)):
        return None
    return -math.inf if before else times[0], math.inf if after else times[-1]


def written_times(attribute: Usd.Attribute) -> list[Usd.TimeCode]:
    """Times of the samples of an attribute, or of the knots of its spline, from both sides, and of extremes between."""
    spline = attribute.GetSpline()
    knots, extremes = spline.GetKnots(), list[float]()
    for start, end in _curved(knots):
        samples = np.linspace(start, end, _SAMPLES)[:-1].tolist()
        extremes += [min(samples, key=spline.Eval), max(samples, key=spline.Eval)]
    return [*map(Usd.TimeCode, [*attribute.GetTimeSamples(), *knots, *extremes]), *map(Usd.TimeCode.PreTime, knots)]


def _curved(knots: Ts.KnotMap) -> list[tuple[float, float]]:
    """Neighbouring knots with a curve between them, by their times."""
    pairs = itertools.pairwise(knots)
    return [pair for pair in pairs if knots[pair[0]].GetNextInterpolation() == Ts.InterpCurve]
