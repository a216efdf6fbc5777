"""Search for target points in a position image: the paper's quad search with its two filters, and its naive search.
(CITATION.cff names the paper.)

In a quad with the corner o and steps e_i, e_j the search solves p = J(o) + s (J(o + e_i) - J(o)) + t (J(o + e_j) -
J(o)) for (s, t).

Position images are in the target frame. `cell` labels the micro-image of every position; a conventional image is one
cell. Positions are indices (column, row) of the fine grid.
"""

import math
from typing import NamedTuple

import numpy as np

from pipeline.jit.decorators import inline, kernel

ACCEPTED, WINDOW, LENGTHS, ANGLES = range(4)
"""Results for a quad that contains a point. WINDOW: some of the 16 values are missing or in another micro-image."""

COLUMN, ROW, DISTANCE, BY_COLUMN, BY_ROW, S, T, SOLUTION = 0, 1, 2, 3, 5, 7, 8, 9
"""Columns of solutions: position, distance of J there from the point, derivatives of J along column (2) and row (2),
s and t, fractions of the steps e_i and e_j from the nearest corner; the last one is their number."""


class Filter(NamedTuple):
    """The paper's filters of quads: largest deviations of lengths [1] and angles [rad]."""

    is_used: bool
    lambda_d: float  # of the distances of neighbours from their mean, over that mean
    lambda_alpha: float  # of the angles between steps along columns and along rows


@inline
def _holds(a, b, c, d, px, py):
    """Whether a quadrilateral contains the point. Of two quads with a common edge only one does (even-odd rule)."""
    inside = False
    for p, q in ((a, b), (b, c), (c, d), (d, a)):
        if (p[1] > py) != (q[1] > py) and px < (q[0] - p[0]) * (py - p[1]) / (q[1] - p[1]) + p[0]:
            inside = not inside
    return inside


@inline
def _window_in_cell(image, cell, column, row):
    """Whether the 4 x 4 positions around the quad at (column, row) exist, hold values and lie in one cell."""
    if column < 1 or row < 1 or column + 2 >= image.shape[1] or row + 2 >= image.shape[0]:
        return False
    for j in range(row - 1, row + 3):
        for i in range(column - 1, column + 3):
            if cell[j, i] != cell[row, column] or math.isnan(image[j, i, 0]):
                return False
    return True


@inline
def _lengths_ok(image, oi, oj, ei, ej, limit):
    """Whether all 12 distances of neighbours in each direction deviate from their mean by at most `limit` [1]."""
    for along_i in (True, False):
        total = 0.0
        for is_test in (False, True):  # first sum all lengths, then test each against their mean
            mean = total / 12.0
            for a in range(-1, 2):
                for b in range(-1, 3):
                    i, j = (a, b) if along_i else (b, a)
                    k, l = (a + 1, b) if along_i else (b, a + 1)
                    p, q = image[oj + j * ej, oi + i * ei], image[oj + l * ej, oi + k * ei]
                    length = math.hypot(p[0] - q[0], p[1] - q[1])
                    if not is_test:
                        total += length
                    elif not abs(1.0 - length / mean) < limit:
                        return False
    return True


@inline
def _angles_ok(image, oi, oj, ei, ej, limit):
    """Whether all 9 angles between the two steps deviate from their mean by at most `limit` [rad]."""
    total = 0.0
    for is_test in (False, True):  # first sum all angles, then test each against their mean
        mean = total / 9.0
        for a in range(-1, 2):
            for b in range(-1, 2):
                p = image[oj + b * ej, oi + a * ei]
                q = image[oj + b * ej, oi + (a + 1) * ei]
                r = image[oj + (b + 1) * ej, oi + a * ei]
                ux, uy, vx, vy = q[0] - p[0], q[1] - p[1], r[0] - p[0], r[1] - p[1]
                angle = abs(math.atan2(ux * vy - uy * vx, ux * vx + uy * vy))
                if not is_test:
                    total += angle
                elif not abs(angle - mean) < limit:
                    return False
    return True


@kernel
def quads_that_hold(image, cell, points, quads):
    """List the quads that contain a point. Returns their number, and fills `quads` up to its length.

    `image` (h, w, 2) is in the target frame, `cell` (h, w) the label of the micro-image, negative: none. Of `quads` (n,
    3) are written: point, column and row of the quad's top-left position.
    """
    count = 0
    for j in range(image.shape[0] - 1):
        for i in range(image.shape[1] - 1):
            label = cell[j, i]
            if label < 0 or cell[j, i + 1] != label or cell[j + 1, i] != label or cell[j + 1, i + 1] != label:
                continue
            a, b, c, d = image[j, i], image[j, i + 1], image[j + 1, i + 1], image[j + 1, i]
            low_x, high_x = min(a[0], b[0], c[0], d[0]), max(a[0], b[0], c[0], d[0])
            low_y, high_y = min(a[1], b[1], c[1], d[1]), max(a[1], b[1], c[1], d[1])
            if math.isnan(a[0] + b[0] + c[0] + d[0]):
                continue
            for p in range(points.shape[0]):
                x, y = points[p, 0], points[p, 1]
                if x < low_x or x > high_x or y < low_y or y > high_y or not _holds(a, b, c, d, x, y):
                    continue
                if count < quads.shape[0]:
                    quads[count, 0], quads[count, 1], quads[count, 2] = p, i, j
                count += 1
    return count


@kernel
def solve_quads(image, cell, points, quads, limits, status, solutions):
    """Filter quads and solve p = J(o) + s (J(o + e_i) - J(o)) + t (J(o + e_j) - J(o)) in each.

    Writes `status` (n,): ACCEPTED or the reason for the rejection, and `solutions` (n, SOLUTION).
    """
    for n in range(quads.shape[0]):
        p, i, j = quads[n]
        x = points[p, 0]
        y = points[p, 1]
        # Take the corner whose value is nearest to the point as the corner o, with steps e_i and e_j into the quad.
        oi, oj, best = i, j, np.inf
        for dj in range(2):
            for di in range(2):
                q = image[j + dj, i + di]
                distance = math.hypot(q[0] - x, q[1] - y)
                if distance < best:
                    oi, oj, best = i + di, j + dj, distance
        ei, ej = (1 if oi == i else -1), (1 if oj == j else -1)
        status[n] = ACCEPTED
        # Apply the paper's filters to the quad and its surroundings.
        if limits.is_used:
            if not _window_in_cell(image, cell, i, j):
                status[n] = WINDOW
                continue
            if not _lengths_ok(image, oi, oj, ei, ej, limits.lambda_d):
                status[n] = LENGTHS
                continue
            if not _angles_ok(image, oi, oj, ei, ej, limits.lambda_alpha):
                status[n] = ANGLES
                continue
        # Solve the two linear equations for (s, t) by Cramer's rule.
        o, a, b = image[oj, oi], image[oj, oi + ei], image[oj + ej, oi]
        ax, ay, bx, by = a[0] - o[0], a[1] - o[1], b[0] - o[0], b[1] - o[1]
        determinant = ax * by - ay * bx
        s = ((x - o[0]) * by - (y - o[1]) * bx) / determinant
        t = (ax * (y - o[1]) - ay * (x - o[0])) / determinant
        solutions[n, COLUMN], solutions[n, ROW], solutions[n, DISTANCE] = oi + s * ei, oj + t * ej, best
        solutions[n, BY_COLUMN], solutions[n, BY_COLUMN + 1] = ax * ei, ay * ei
        solutions[n, BY_ROW], solutions[n, BY_ROW + 1] = bx * ej, by * ej
        solutions[n, S], solutions[n, T] = s, t


@kernel
def nearest_positions(image, cell, points, best, position):
    """The paper's naive search: per point and cell the position with the nearest value.

    Updates `best` (p, c), the distance of the nearest value [mm], and `position` (p, c, 2), its column and row.
    """
    for j in range(image.shape[0]):
        for i in range(image.shape[1]):
            label = cell[j, i]
            if label < 0 or math.isnan(image[j, i, 0]):
                continue
            for p in range(points.shape[0]):
                distance = math.hypot(image[j, i, 0] - points[p, 0], image[j, i, 1] - points[p, 1])
                if distance < best[p, label]:
                    best[p, label] = distance
                    position[p, label, 0], position[p, label, 1] = i, j
