"""Numbers that change with time: at which times they bend, end and are greatest, in whatever form USD has them.

A spline is an animation curve, of knots with straight, curved or level pieces between them. USD lists no time samples
of it, and all times here are those of the stage, after the offsets of layers.
"""

import itertools
import math
from collections.abc import Iterable, Iterator

import numpy as np
from pxr import Gf, Ts, Usd

from pipeline.motion import NODES, node_shares, node_times
from pipeline.scene.usd.values import UnreadableValue

_MOST_LOOPS = 100
"""Most repetitions of a spline during one exposure [1]: a motion is kept by its pieces, and each has some."""
_RIGHT = 1e-12
"""Error of what is interpolated in a piece of a curve, as a share of its largest value [1]."""
_MOST_PIECES = 32
"""Most pieces of a curve in an exposure [1]: beside an upright tangent no polynomial is right; else a few are."""
_LOOKS = 16
"""Slopes of a curved piece between which an extreme value is searched: a cubic has two at most."""
_HELD = (Ts.ExtrapHeld, Ts.ExtrapValueBlock)


def bends(attributes: Iterable[Usd.Attribute], first: float, last: float) -> set[float]:
    """Time codes between which attributes are smooth, and as polynomials of few nodes have them; some may lie outside
    of the time that is asked for.
    """
    found = set[float]()
    for attribute in attributes:
        if attribute.HasSpline():
            found.update(_bends(attribute, first, last))
        else:
            found.update(attribute.GetTimeSamples())
    return found


def extent(attribute: Usd.Attribute) -> tuple[float, float] | None:
    """First and last time code up to which an attribute changes, without end where a spline goes on; None if it does
    not change.
    """
    if not attribute.HasSpline():
        times = attribute.GetTimeSamples()
        return (times[0], times[-1]) if len(times) > 1 else None
    spline, knots = attribute.GetSpline(), list(attribute.GetSpline().GetKnots())
    goes_on = [end.mode not in _HELD for end in (spline.GetPreExtrapolation(), spline.GetPostExtrapolation())]
    if not knots or (len(knots) < 2 and not any(goes_on)):
        return None
    return -math.inf if goes_on[0] else knots[0], math.inf if goes_on[1] else knots[-1]


def written_times(attribute: Usd.Attribute, ends: tuple[float, float]) -> Iterator[Usd.TimeCode]:
    """Times of the samples of an attribute, or between which all values of its spline lie: knots, from both sides,
    extremes of its curves, and where it goes on beyond them, as far as both ends of the time that is asked for.
    """
    yield from map(Usd.TimeCode, attribute.GetTimeSamples())
    if not attribute.HasSpline():
        return
    spline = attribute.GetSpline()
    knots = spline.GetKnots()
    for time in knots:
        yield from (Usd.TimeCode.PreTime(time), Usd.TimeCode(time))
    for start, end in _curved(knots):
        yield from map(Usd.TimeCode, _extremes(spline, start, end))
    reached = extent(attribute) or (0.0, 0.0)
    yield from (Usd.TimeCode(time) for time, at in zip(ends, reached, strict=True) if math.isinf(at))


def shifted(spline: Ts.Spline, by: float) -> Ts.Spline:
    """A spline with another number added to all its values."""
    moved = Ts.Spline(spline)
    for knot in spline.GetKnots().values():
        knot.SetValue(knot.GetValue() + by)
        if knot.IsDualValued():
            knot.SetPreValue(knot.GetPreValue() + by)
        moved.SetKnot(knot)
    return moved


def _bends(attribute: Usd.Attribute, first: float, last: float) -> Iterator[float]:
    spline = attribute.GetSpline()
    knots = list(spline.GetKnots())
    if spline.HasExtrapolatingLoops() and last - first > _MOST_LOOPS * (knots[-1] - knots[0]):
        message = f'"{attribute.GetName()}" repeats its spline more than {_MOST_LOOPS} times while a shutter is open'
        raise UnreadableValue(message, attribute, "write the repetitions that are meant as knots", "spline")
    baked = spline.GetKnotsWithLoopsBaked(Gf.Interval(first, last))
    yield from baked
    for start, end in _curved(baked):
        if first < end and start < last:
            yield from _halved(spline, max(first, start), min(last, end))


def _curved(knots: Ts.KnotMap) -> list[tuple[float, float]]:
    times = list(knots)
    return [pair for pair in itertools.pairwise(times) if knots[pair[0]].GetNextInterpolation() == Ts.InterpCurve]


def _halved(spline: Ts.Spline, start: float, end: float) -> Iterator[float]:
    """Edges of pieces of a curve in which its values at the nodes of a motion tell all others; the worst is halved."""
    pieces = [(_off(spline, start, end), start, end)]
    while len(pieces) < _MOST_PIECES and (worst := max(pieces))[0] > _RIGHT:
        pieces.remove(worst)
        _, first, last = worst
        middle = (first + last) / 2
        pieces += [(_off(spline, a, b), a, b) for a, b in ((first, middle), (middle, last))]
    yield from (first for _, first, _ in pieces)


def _off(spline: Ts.Spline, start: float, end: float) -> float:
    """Error of what is interpolated between nodes, as a share of the largest value."""
    edges = np.array([start, end])
    nodes = node_times(edges, NODES)[0]
    between = (nodes[:-1] + nodes[1:]) / 2
    values = np.array([*map(spline.Eval, nodes[:-1].tolist()), spline.EvalPreValue(end)])
    _, share = node_shares(edges, NODES, between)
    return float(np.abs(share @ values - list(map(spline.Eval, between.tolist()))).max() / np.abs(values).max())


def _extremes(spline: Ts.Spline, start: float, end: float) -> Iterator[float]:
    """Times at which the slope of a curved piece changes its sign."""
    times = np.linspace(start, end, _LOOKS + 1).tolist()
    for low, high in itertools.pairwise(times):
        rises = spline.EvalDerivative(low) > 0
        if rises != (spline.EvalPreDerivative(high) > 0):
            while low < (middle := (low + high) / 2) < high:
                low, high = (middle, high) if (spline.EvalDerivative(middle) > 0) == rises else (low, middle)
            yield low
