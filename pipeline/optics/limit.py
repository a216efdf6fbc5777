"""Limit of the trace on this processor: a refraction at a sphere takes one division and two roots."""

import math
import time

import numpy as np

from pipeline.jit.decorators import kernel
from pipeline.optics.kernels import PACKET

_TURNS = 4000
"""Turns of a run: with a packet of values some milliseconds, long beside a reading of the clock."""
_RUNS = 5
"""Runs, of which the fastest counts: what else the processor does can only slow them."""


@kernel
def divide_and_root(values, turns):
    """One division and two roots per value and turn, in place; values (n,) float64 stay between 1 and 2."""
    for _ in range(turns):
        for i in range(values.shape[0]):
            values[i] = 1.0 + math.sqrt(values[i]) / (1.0 + math.sqrt(1.0 + values[i]))


def crossings_per_second() -> float:
    """Rays times spheres per second that no trace on one core can exceed: the best of a few runs, some milliseconds."""
    values = np.linspace(1.0, 2.0, PACKET)
    divide_and_root(values, 1)
    spent = []
    for _ in range(_RUNS):
        start = time.thread_time()
        divide_and_root(values, _TURNS)
        spent.append(time.thread_time() - start)
    return _TURNS * PACKET / min(spent)
