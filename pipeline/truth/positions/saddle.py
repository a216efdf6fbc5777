"""The saddle of the noise-free image of a corner.

An infinite X-corner with the edges of the target point lies in its tangent plane. Its image, integrated over the square
of a pixel at a continuous position x, is a smooth function E(x); the saddle is where grad E = 0 and det Hess E < 0. By
Gauss's theorem the derivative of E is the light on one side of the pixel minus that on the opposite side, so a gradient
needs the image along four lines only. Weight, stop and own microlens are those of J.

The corner's coordinates u and v run along its two edges: white where they have equal signs. The bundle is a disc of
triangles on which coordinates are linear, so the two edges cut them exactly; the remaining error of linear
interpolation falls with the square of the triangles' size, because corners of the bundle are corners of triangles, too.
Their motion with x is interpolated by polynomials.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from pipeline.camera.boundary import unit_nodes
from pipeline.camera.frozen_pupils import by_x
from pipeline.camera.integrating.polar_hits import Polar
from pipeline.camera.tracer import Tracer
from pipeline.jit.decorators import inline, kernel
from pipeline.records.shapes import Float64
from pipeline.truth.positions.bundle_map import NONE, BundleMap, Position, TracedGrid, bundle_map, bundle_maps


@kernel
def blend(fields, basis, nodes):
    """Write nodes (a, r, 3): the sum of fields (k, a, r, 3) with weights (k,)."""
    for i in range(nodes.shape[0]):
        for j in range(nodes.shape[1]):
            for c in range(nodes.shape[2]):
                nodes[i, j, c] = 0.0
                for k in range(basis.shape[0]):
                    nodes[i, j, c] += basis[k] * fields[k, i, j, c]


@kernel
def corner_light(nodes, angle, ratio):
    """Integral of weight times (ratio + 1) on white and (ratio - 1) on black, with `ratio` as in `saddle`.

    `nodes` (a, r, 3): per direction and fraction 0, 1 / (r - 1), ..., 1 of the radius, both coordinates and the density
    on the unit disc. `angle` (a,): from each direction to the next.
    """
    directions = nodes.shape[0]
    rings = nodes.shape[1] - 1
    total = 0.0
    for i in range(directions):
        j = i + 1 if i + 1 < directions else 0
        for k in range(rings):
            a, b, c, d = nodes[i, k], nodes[i, k + 1], nodes[j, k + 1], nodes[j, k]
            if (i + k) % 2 == 1:  # Diagonals alternate, otherwise all would lean to one side.
                a, b, c, d = d, c, b, a
            outer = (k + 1.0) * (a[2] + b[2] + c[2]) * (ratio + signed_share(a, b, c))
            inner = k * (a[2] + c[2] + d[2]) * (ratio + signed_share(a, c, d)) if k > 0 else 0.0
            # The ring's sector, of area (2 k + 1) angle / (2 rings^2), is divided in the ratio k + 1 to k.
            total += (outer + inner) / 3.0 * angle[i]
    return total / (2.0 * rings * rings)


@inline
def signed_share(a, b, c):
    """Share of a triangle where u and v have equal signs, minus that where they differ."""
    if (a[0] > 0.0) == (b[0] > 0.0) == (c[0] > 0.0):
        sign = 1.0 if a[0] > 0.0 else -1.0
        return sign * mean_sign(a[1], b[1], c[1])
    # Rotate the corners so that the first one lies alone beyond u = 0.
    if (a[0] > 0.0) == (b[0] > 0.0):
        a, b, c = c, a, b
    elif (a[0] > 0.0) == (c[0] > 0.0):
        a, b, c = b, c, a
    to_b, to_c = a[0] / (a[0] - b[0]), a[0] / (a[0] - c[0])
    at_b, at_c = a[1] + to_b * (b[1] - a[1]), a[1] + to_c * (c[1] - a[1])
    of_first = to_b * to_c * mean_sign(a[1], at_b, at_c)
    # The rest: (b', b, c') and (b, c, c').
    of_rest = (1.0 - to_b) * to_c * mean_sign(at_b, b[1], at_c) + (1.0 - to_c) * mean_sign(b[1], c[1], at_c)
    return (of_first - of_rest) if a[0] > 0.0 else (of_rest - of_first)


@inline
def mean_sign(p, q, r):
    """Mean sign over a triangle of a linear function with these values at its corners."""
    if p > 0.0 and q > 0.0 and r > 0.0:
        return 1.0
    if not (p > 0.0 or q > 0.0 or r > 0.0):
        return -1.0
    if (p > 0.0) == (q > 0.0):
        p, r = r, p
    elif (p > 0.0) == (r > 0.0):
        p, q = q, p
    of_first = p / (p - q) * (p / (p - r))
    return 2.0 * of_first - 1.0 if p > 0.0 else 1.0 - 2.0 * of_first


_DIFFERENCE_PX = 0.05
"""Half the step of finite differences for the Hessian [px]: the image of a corner, integrated over a pixel, bends
little over it."""
_SIDES = np.array([[[1, -1], [1, 1]], [[-1, -1], [-1, 1]], [[-1, 1], [1, 1]], [[-1, -1], [1, -1]]]) / 2
"""Ends of the right, left, lower and upper side of a pixel."""


class CornerImage:
    """The image of a corner by every `step`-th node of a map; `ratio` is (white + black) / (white - black).

    `along`: Gauss-Legendre nodes along each part of a pixel's side.
    """

    def __init__(self, bundle: BundleMap, ratio: float, step: int = 1, along: int = 4) -> None:
        self.bundle = bundle
        self.ratio = ratio
        self.along = unit_nodes(along)
        self.fields = np.ascontiguousarray(bundle.fields[:, ::step, ::step])
        self.angle = bundle.angle_to_next_rad.reshape(-1, step).sum(axis=1)
        self.nodes = np.empty(self.fields.shape[1:])

    def gradient(self, x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
        """Derivative of the light of a pixel by its position, (2,) [sr per px]."""
        right, left, lower, upper = (self._along(x_px + side) for side in _SIDES)
        return np.array([right - left, lower - upper])

    def _at(self, x_px: np.ndarray) -> np.ndarray:
        """Coordinates and density of the nodes at an image position, (a, r, 3)."""
        blend(self.fields, self.bundle.basis(x_px), self.nodes)
        return self.nodes

    def _along(self, ends: np.ndarray) -> float:
        """Integral of the point image along a line of length 1 px."""
        # If the bundle is sharp, the light changes within a short piece of the line: so the line is split at the
        # positions where the first and the last ray cross an edge.
        first, last = (self._extremes(end) for end in ends)
        with np.errstate(divide="ignore", invalid="ignore"):
            cut = first / (first - last)
        cuts = np.sort(np.concatenate([[0.0, 1.0], cut[(cut > 0) & (cut < 1)]]))
        total = 0.0
        for low, high in itertools.pairwise(cuts):
            for node, weight in zip(*self.along, strict=True):
                t = low + (high - low) * node
                light = corner_light(self._at(ends[0] + t * (ends[1] - ends[0])), self.angle, self.ratio)
                total += (high - low) * weight * light
        return total

    def _extremes(self, x_px: np.ndarray) -> np.ndarray:
        """Least and largest coordinates u and v of the nodes at an image position, (4,) [mm]."""
        flat = self._at(x_px)[..., :2].reshape(-1, 2)
        return np.concatenate([flat.min(axis=0), flat.max(axis=0)])


def gradient_of(
    maps: Sequence[tuple[float, BundleMap]], ratio: float, step: int, along: int
) -> Callable[[np.ndarray], np.ndarray]:
    """Gradient of the weighted sum of a corner's images in the wavelengths of a camera's light."""
    images = [(share, CornerImage(bundle, ratio, step, along)) for share, bundle in maps]
    return lambda x_px: np.sum([share * image.gradient(x_px) for share, image in images], axis=0)


def hessian_of(gradient: Callable[[np.ndarray], np.ndarray], x_px: Float64[np.ndarray, "2"]) -> np.ndarray:
    """Symmetrised Jacobian of a gradient, (2, 2), by differences over a small part of a pixel."""
    steps = _DIFFERENCE_PX * np.eye(2)
    rows = np.array([gradient(x_px + step) - gradient(x_px - step) for step in steps])
    return (rows + rows.T) / (4 * _DIFFERENCE_PX)


_LEVELS = ((16, 64), (32, 128), (64, 256), (128, 512))
"""Rings and directions of the triangles of a bundle; the error falls with the square of these numbers."""
_GOOD_PX = 5e-4
"""Error below which no finer level is needed [px]: half of the default claim."""
_ORDERS = (3, 5, 9)
"""Numbers of positions along an axis for the polynomials, each including those before: bundles change nearly linearly
over a pixel, unless another rim begins to cut them there."""
_ALONG = (4, 8, 16, 32)
"""Numbers of nodes along each part of a pixel's side. Where an edge passes a corner of the bundle, or a caustic within
it, light has a kink: the error falls with the third power of the number."""
_CENTRED_PX = 0.25
"""Largest distance of an accepted saddle from the middle of the traced positions [px], within which the polynomials
hold."""
_HALF_PX = 0.5 + _CENTRED_PX
"""Half the span of the traced positions [px]: it includes the sides of a pixel this far off the middle."""
_ROUNDS = 8
"""Most times that positions are traced anew around the saddle before the search is given up."""
_STEPS = 20
"""Most steps of Newton's method between two traces."""
_LONGEST_PX = 1.0
"""Distance after which positions are traced anew [px], and twice the longest step: the map spans a pixel and a half."""
_DONE_PX = 1e-7
"""Step that ends the search [px]: a ten-thousandth of the default claim."""
_START_NODES = Polar(np.arange(17) / 16, 64)
"""Nodes of the bundle of a first guess: the coarsest level suffices."""
_LOOK_PX = 0.25
"""Half the step of finite differences of a first guess [px]: within the traced positions."""
_WIDE_PX = 1.0
"""Standard deviation of a bundle above which its image may have several stationary points [px]; a narrower one is
smoothed by the pixel."""
_SWEEPS = 3
"""Number of alternating searches along both edges: each brings the guess nearer."""
_ROUGH = 0.02
"""Precision of a search along an edge over the standard deviation [1]: Newton's method improves it."""


def corner_plane(plane: Float64[np.ndarray, "4 3"], edges: Float64[np.ndarray, "n 3"]) -> np.ndarray:
    """A tangent plane (4, 3) whose coordinate axes are two edges (2, 3) of its frame."""
    normal = plane[3]
    first, second = np.cross(edges[1], normal), np.cross(normal, edges[0])
    return np.stack([plane[0], first / (first @ edges[0]), second / (second @ edges[1]), normal])


def saddle(
    tracer: Tracer, microlens: int, x_px: Float64[np.ndarray, "2"], plane: Float64[np.ndarray, "4 3"], ratio: float
) -> Position:
    """Find the saddle of a corner, on a plane from `corner_plane`, near the position of J.

    The error is the sum of the differences between two sizes of triangles, degrees of polynomials and numbers of nodes
    along a pixel's side.
    """
    start = _start(tracer, microlens, x_px, plane, ratio)
    if start is None:
        return NONE
    x_px, spread_px = start
    moved = np.inf
    errors = np.full((3, 2), np.nan)
    hessian = np.full((2, 2), np.nan)
    # Indices into the lists of finer and finer approximations, and the last of each list.
    level, degree, along = 0, 0, 1
    finest = len(_LEVELS) - 1, len(_ORDERS) - 1, len(_ALONG) - 1
    while True:
        # Solve grad E = 0 on a map around the saddle, and trace the map anew until the saddle is in its middle.
        for _ in range(_ROUNDS):
            rings, directions = _LEVELS[level]
            nodes = Polar(np.arange(rings + 1) / rings, directions, has_corners=True)
            grid = TracedGrid(x_px, np.full(2, _HALF_PX), _ORDERS[degree])
            maps = bundle_maps(tracer, microlens, plane, grid, nodes)
            if maps is None:
                return NONE
            gradient = gradient_of(maps, ratio, 1, _ALONG[along])
            hessian = hessian_of(gradient, x_px) if np.isnan(hessian).any() else hessian
            solution, hessian = _newton(gradient, x_px, hessian)
            moved = np.hypot(*(solution - x_px))
            x_px = solution
            if not moved > _CENTRED_PX:
                break
        if not moved <= _CENTRED_PX:
            break
        # Solve again with coarser triangles, and then also with coarser polynomials or sides of the pixel, for the
        # error of each: halving the size of triangles leaves a third of the difference.
        assert maps is not None
        coarser_maps = [(share, bundle.coarser()) for share, bundle in maps]
        coarse = _newton(gradient_of(maps, ratio, 2, _ALONG[along]), x_px, hessian)[0]
        coarse_degree = _newton(gradient_of(coarser_maps, ratio, 2, _ALONG[along]), x_px, hessian)[0]
        coarse_side = _newton(gradient_of(maps, ratio, 2, _ALONG[along - 1]), x_px, hessian)[0]
        errors = np.array([(x_px - coarse) / 3, coarse - coarse_degree, coarse - coarse_side])
        # Refine what errs too much, if there is a finer approximation.
        refined = ~(np.hypot(*errors.T) < _GOOD_PX) & (np.array([level, degree, along]) < finest)
        if not refined.any():
            break
        level, degree, along = np.array([level, degree, along]) + refined
    # Accept a saddle near the start, and extrapolate it to vanishing triangles (Richardson).
    near = np.hypot(*(x_px - start[0])) <= max(1.0, spread_px)
    if not (moved <= _CENTRED_PX and near and np.linalg.det(hessian) < 0):
        return NONE
    return Position(x_px + errors[0], float(np.hypot(*errors.T) @ [3, 1, 1]))


def _start(
    tracer: Tracer, microlens: int, x_px: np.ndarray, plane: np.ndarray, ratio: float
) -> tuple[np.ndarray, float] | None:
    """First guess, and the standard deviation of the bundle in the image [px]; None if bundles around J are cut."""
    # With coma J is far off, and a wide image has further stationary points. The guess is where both edges halve the
    # bundle; for a wide bundle, where each edge halves it on the other edge.
    half = np.full(2, _HALF_PX)
    bundle = bundle_map(tracer, microlens, plane, TracedGrid(x_px, half, _ORDERS[0]), _START_NODES)
    if bundle is None:
        return None
    nodes = bundle.at(x_px)
    weight = (nodes[..., 2] * np.linspace(0, 1, nodes.shape[1])).ravel()
    weight = weight / weight.sum()
    hits = nodes[..., :2].reshape(-1, 2)
    # Move so that the median of the hits along each axis lies on its edge.
    px_per_mm = np.linalg.inv(_jacobian(bundle, weight))
    x_px = x_px - px_per_mm @ [_median(values, weight) for values in hits.T]
    spread = float(np.sqrt(weight @ (((hits - weight @ hits) @ px_per_mm.T) ** 2).sum(axis=1)))
    if spread < _WIDE_PX:
        return x_px, spread
    wide = bundle_map(tracer, microlens, plane, TracedGrid(x_px, half + spread, _ORDERS[0]), _START_NODES)
    if wide is None:
        return None
    return _halved(CornerImage(wide, ratio), x_px, px_per_mm, spread), spread


def _halved(image: CornerImage, x_px: np.ndarray, px_per_mm: np.ndarray, spread_px: float) -> np.ndarray:
    """Move along both edges in turn to where the derivative along the other one changes its sign."""
    from scipy.optimize import brentq

    first, second = (px_per_mm / np.linalg.norm(px_per_mm, axis=0)).T
    for along, across in ((first, second), (second, first)) * _SWEEPS:

        def slope(s: float, x: np.ndarray = x_px, along: np.ndarray = along, across: np.ndarray = across) -> float:
            """Derivative of the light along the other edge, s px along this one."""
            return float(image.gradient(x + s * along) @ across)

        reach = 2 * spread_px
        if slope(-reach) * slope(reach) < 0:
            x_px = x_px + brentq(slope, -reach, reach, xtol=_ROUGH * spread_px) * along
    return x_px


def _median(values: np.ndarray, weight: np.ndarray) -> float:
    """Median of values with weights that add up to 1."""
    order = np.argsort(values)
    return float(np.interp(0.5, np.cumsum(weight[order]) - weight[order] / 2, values[order]))


def _jacobian(bundle: BundleMap, weight: np.ndarray) -> np.ndarray:
    """Jacobian of the mean hit by position, (2, 2) [mm per px]; `weight` is that of each node."""
    return by_x(lambda x_px: weight @ bundle.at(x_px)[..., :2].reshape(-1, 2), bundle.x_px, _LOOK_PX)


def _newton(
    gradient_at: Callable[[np.ndarray], np.ndarray], x_px: np.ndarray, hessian: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Position within a pixel where the gradient vanishes, and the updated Hessian; NaN if there is none.

    A quasi-Newton method: each step updates the Hessian by Powell's symmetric Broyden update.
    """
    x = x_px
    gradient = gradient_at(x_px)
    for _ in range(_STEPS):
        if not np.abs(np.linalg.det(hessian)) > 0:
            return np.full(2, np.nan), hessian
        step = -np.linalg.solve(hessian, gradient)
        step *= min(1.0, _LONGEST_PX / 2 / max(np.hypot(*step), 1e-300))
        x = x + step
        before = gradient
        if np.hypot(*step) < _DONE_PX or np.hypot(*(x - x_px)) > _LONGEST_PX:
            break
        gradient = gradient_at(x)
        # Correct the Hessian by the smallest symmetric change that explains the change of the gradient in the step.
        unexplained = gradient - before - hessian @ step
        squared = step @ step
        hessian = hessian + (np.outer(unexplained, step) + np.outer(step, unexplained)) / squared
        hessian -= (unexplained @ step) * np.outer(step, step) / squared**2
    return x, hessian
