"""Diffraction of rays: places on the sensor moved by random numbers that are distributed as an aperture spreads light.

Kernels only; vision frame, mm. `diffraction` is a `camera.tracing.records.Diffraction`.
"""

import math

from pipeline.jit.decorators import inline, unit


@unit
def spread(diffraction, microlens, x, y, choice, along_x, along_y):
    """Move sensor positions x and y in place, by three random numbers each."""
    for i in range(x.shape[0]):
        x[i], y[i] = moved(diffraction, microlens, x[i], y[i], choice[i], along_x[i], along_y[i])


@inline
def moved(diffraction, microlens, x, y, choice, along_x, along_y):
    """A sensor position moved by three random numbers.

    Between the nodes of a grid the picture of one of the four around is taken, the nearer one the more often.
    """
    if microlens >= 0:
        picture = diffraction.of_microlens[microlens]
    else:
        nodes = round(math.sqrt(diffraction.edge_mm.shape[0]))
        column, rest = _node(x / diffraction.node_mm[0], nodes, choice)
        row, _ = _node(y / diffraction.node_mm[1], nodes, rest)
        picture = row * nodes + column
    edge, rows = diffraction.edge_mm[picture], diffraction.rows[picture]
    row, up = _drawn(rows, along_y)
    _, across = _drawn(diffraction.cells[picture, row], along_x)
    return x - edge * (across - 0.5 * rows.shape[0]), y - edge * (up - 0.5 * rows.shape[0])


@inline
def _node(position, nodes, choice):
    """One of the two nodes around a place that is counted from the middle one, and a random number that is left."""
    from_first = min(max(position + 0.5 * (nodes - 1), 0.0), nodes - 1.0)
    low = min(int(from_first), max(nodes - 2, 0))
    part = from_first - low
    if choice < part:
        return low + 1, choice / part
    return low, (choice - part) / (1.0 - part)


@inline
def _drawn(upto, share):
    """The cell in which a cumulative sum passes a share, and the place where it does, counted from the first cell."""
    low, high = 0, upto.shape[0] - 1
    while low < high:
        middle = (low + high) // 2
        if upto[middle] > share:
            high = middle
        else:
            low = middle + 1
    before = upto[low - 1] if low > 0 else 0.0
    return low, low + min((share - before) / (upto[low] - before), 1.0)
