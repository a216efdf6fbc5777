"""A camera whose lens or sensor changes while its shutter is open. CONVENTIONS.md, Time, has the law."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.parts.camera import Camera
from pipeline.camera.tracer import Tracer
from pipeline.motion import node_shares, node_times
from pipeline.records.plain import from_plain, to_plain
from pipeline.records.shapes import Float64

INSTANTS = 128
"""Steps between instants of a frame at which there are tracers of images and labels [1]: making one takes longer than
tracing a line, and a pull that moves the image by a pixel moves it by less than a hundredth from one to the next."""
_KEPT = 32
"""Instants whose tracers are kept: more than one line sees by default."""
PIECES, STATES = 6, 3
"""Pieces of a frame at least, and states of a piece [1]: begin, middle and end. Where a pull moves the image by a fifth
of its radius, a parabola through these errs by 1e-6 of that radius; where a rim begins to cut, by 6e-4 px behind
microlenses and an iris that closes by two thirds."""


def state_times(edges_s: Float64[np.ndarray, "m"]) -> np.ndarray:
    """Times of the states in all pieces between edges, (m - 1, states)."""
    return node_times(edges_s, STATES)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraInTime:
    """States of a focused camera at `state_times`, those of one piece after those of another, after the time code of a
    frame; in each piece it changes smoothly.
    """

    edges_s: tuple[float, ...]
    states: tuple[Camera, ...]

    def shares(self, times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """Shares of all states in what is interpolated at times, (n, states): 0 of those in other pieces."""
        piece, share = node_shares(np.array(self.edges_s), STATES, times_s)
        result = np.zeros((len(piece), len(self.states)))
        np.put_along_axis(result, STATES * piece[:, None] + np.arange(STATES), share, axis=1)
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedInTime:
    """The same as a stage states it: cameras, or requests for a focus."""

    edges_s: tuple[float, ...]
    states: tuple[Camera | FocusRequest, ...]

    def settled(self, settle: Callable[[Camera | FocusRequest], Camera]) -> CameraInTime:
        """The camera that does what is asked."""
        return CameraInTime(edges_s=self.edges_s, states=tuple(map(settle, self.states)))


class TracersInTime:
    """Tracers of a camera in its states, and between them, each made when it is asked for."""

    def __init__(self, camera: CameraInTime, seed: int) -> None:
        self.camera, self.seed = camera, seed
        self._in_state, self._between = functools.cache(self._of_state), functools.lru_cache(_KEPT)(self._of_instant)

    def __getitem__(self, state: int) -> Tracer:
        return self._in_state(state)

    def at(self, time_s: float) -> Tracer:
        """That of the camera at the instant next to a time, all of whose numbers are interpolated."""
        return self._between(float(self.instants_s(np.array([time_s]))[0]))

    def instants_s(self, times_s: Float64[np.ndarray, "n"]) -> np.ndarray:
        """The instants next to times, (n,)."""
        first_s, end_s = self.camera.edges_s[0], self.camera.edges_s[-1]
        step_s = (end_s - first_s) / INSTANTS
        return first_s + step_s * np.rint((times_s - first_s) / step_s)

    def _of_state(self, state: int) -> Tracer:
        return Tracer(self.camera.states[state], self.seed)

    def _of_instant(self, time_s: float) -> Tracer:
        shares = self.camera.shares(np.array([time_s]))[0]
        used = np.flatnonzero(shares)
        plain = _mean([to_plain(self.camera.states[state]) for state in used], shares[used])
        return Tracer(from_plain(Camera, plain), self.seed)


def _mean(values: Sequence[Any], shares: np.ndarray) -> Any:
    """Mean of plain records of one form, number by number; what is no number is that of the first."""
    first = values[0]
    if isinstance(first, dict):
        return {name: _mean([value[name] for value in values], shares) for name in first}
    if isinstance(first, list):
        return [_mean(items, shares) for items in zip(*values, strict=True)]
    # Numbers that are the same in all states stay so to the bit.
    if isinstance(first, float) and values.count(first) < len(values):
        return float(shares @ np.array(values))
    return first
