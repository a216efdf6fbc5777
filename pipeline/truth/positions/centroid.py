"""The centroid of the noise-free image of a disc, the quantity that dot detectors estimate.

A disc lies about the target point in its tangent plane. With h(x, q) the hit of node q of the bundle at x, and D its
weight, the image of the disc is E(x) = integral of D over the nodes whose hit lies on the disc. For each node h is
inverted for the image positions that see the disc, so the integrals of E and of x E become smooth ones over the disc y:

    integral over q and y of D(x, q) / |det dh/dx| (and of x times that), x being where h(x, q) = y.

The sharp edges of image and disc are gone, and few points suffice. A dark disc on white has the same centroid of
missing light, as long as the white around it is uniform.
"""

import numpy as np

from pipeline.camera.boundary import even_angles, unit_nodes, unit_vectors
from pipeline.camera.integrating.polar_hits import Polar
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.records.shapes import Float64
from pipeline.truth.positions.bundle_map import NONE, BundleMap, Position, TracedGrid, bundle_map

_ROUGH, _FINE = (4, 6, 48, 3, 12), (5, 8, 96, 4, 16)
"""Orders of two accuracies: traced positions along an axis, rings and directions of the bundle, rings and directions of
the disc. Rings matter most: for an f/2 lens four err by 4e-3 px, equally for all discs, eight by 6e-5."""
_LOOK_PX = 0.5
"""Half the size of the first traced box [px]: derivatives over a pixel give the approximate size of the disc."""
_SLACK, _LARGER = 1.05, 1.1
"""Size of a traced box over that of the estimated disc, and of the largest disc for which the box is accepted [1]:
polynomials hold slightly beyond their nodes."""
_BOXES = 4
"""Most boxes; each is estimated from the one before."""
_STEPS = 12
"""Most steps to the position from which a node sees a point: the Jacobian is kept, so each reduces the error by a
constant large factor."""
_DONE_PX = 1e-7
"""Step that ends the search [px]: a ten-thousandth of the default claim."""
_DIFFERENCE = 1e-4
"""Half the step of finite differences over half the size of the box [1]: for polynomials of low degree the error is
about its square."""


def centroid(
    rig: Rig, cell: int, x_px: Float64[np.ndarray, "2"], plane: Float64[np.ndarray, "4 3"], radius_mm: float
) -> Position:
    """Centroid of the image of a disc about the origin of a plane (4, 3), near the image position of its centre.

    The error is the difference of two integrals; there is none unless the complete disc is visible.
    """
    parts = []
    for share, tracer in rig.tracer.lights:
        images = _disc_images(rig, tracer, cell, x_px, plane, radius_mm)
        if images is None:
            return NONE
        parts.append([(share * light, x) for light, x in images])
    # The mean over the wavelengths, each weighed by its share of the light, by both accuracies.
    rough, fine = (_mean(list(level)) for level in zip(*parts, strict=True))
    return Position(fine, float(np.hypot(*(fine - rough))))


def _mean(parts: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Weighted mean of positions (2,), counted from the first one."""
    weight = sum(weight for weight, _ in parts)
    first = parts[0][1]
    return first + sum((weight * (x - first) for weight, x in parts), np.zeros(2)) / weight


def _disc_images(
    rig: Rig, tracer: Tracer, cell: int, x_px: np.ndarray, plane: np.ndarray, radius_mm: float
) -> list[tuple[float, np.ndarray]] | None:
    """Light and centroid of the disc's image in one wavelength, rough and fine; None if it is incomplete."""
    microlens = int(rig.microlens(np.array([cell]))[0])
    images = []
    # Estimate the image of the disc's edge from a small box around the start.
    small_grid = TracedGrid(x_px, np.full(2, _LOOK_PX), 3)
    small_map = bundle_map(tracer, microlens, plane, small_grid, Polar(np.array([0.5, 1.0]), 16))
    if small_map is None:
        return None
    positions = _linear(small_map, radius_mm * unit_vectors(even_angles(16)))
    for order, rings, directions, *disc in (_ROUGH, _FINE):
        # Trace a box that holds the image of the disc by every node.
        shares, weight = unit_nodes(rings)
        for _ in range(_BOXES):
            low, high = positions.min(axis=(0, 1, 2)), positions.max(axis=(0, 1, 2))
            half = (high - low) / 2
            grid = TracedGrid((low + high) / 2, _SLACK * half, order)
            disc_map = bundle_map(tracer, microlens, plane, grid, Polar(shares, directions))
            if disc_map is None:
                return None
            positions = _positions_seeing(disc_map, radius_mm * unit_vectors(even_angles(64)))[0]
            # The box was an estimate; polynomials hold only a little beyond it.
            if (np.abs(positions - disc_map.x_px) <= _LARGER * half).all():
                break
        else:
            return None
        # Integrate over bundle and disc, if the image is complete.
        rim = positions.reshape(-1, 2)
        if not (rig.in_image(rim) & rig.in_cell(rim, np.full(len(rim), cell))).all():
            return None
        images.append(_light_and_centroid(disc_map, shares * weight, radius_mm, disc))
    return images


def _light_and_centroid(
    disc_map: BundleMap, ring_weight: np.ndarray, radius_mm: float, disc: list[int]
) -> tuple[float, np.ndarray]:
    """Light and centroid (2,) [px] of the image of a disc: the integral at the top of the module, by quadrature.

    `ring_weight`: weight of each ring of the bundle, (r,). `disc`: numbers of rings and directions of the disc.
    """
    rings, directions = disc
    shares, weight = unit_nodes(rings)
    points = radius_mm * (shares[:, None, None] * unit_vectors(even_angles(directions))).reshape(-1, 2)
    x, density, area = _positions_seeing(disc_map, points)
    light = density * area * np.repeat(shares * weight, directions) * ring_weight[:, None]
    # Directions of the bundle, and of the disc, represent equal angles.
    total = light.sum() / (len(light) * directions)
    return float(total), np.einsum("arm,armi->i", light, x) / light.sum()


def _linear(bundle: BundleMap, points_mm: np.ndarray) -> np.ndarray:
    """Image positions (a, r, m, 2) from which nodes see points (m, 2) of the plane, linearised about the middle."""
    middle = np.broadcast_to(bundle.x_px, (*bundle.fields.shape[1:3], 1, 2))
    apart_mm = points_mm - _fields(bundle, middle)[..., :2]
    return bundle.x_px + np.einsum("armij,armj->armi", np.linalg.inv(_jacobian(bundle, middle)), apart_mm)


def _positions_seeing(bundle: BundleMap, points_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (a, r, m, 2) [px] from which nodes see points (m, 2) of the plane; density and px^2 per mm^2 there.

    Newton's method with the Jacobian of the middle, from the linear guess.
    """
    middle = np.broadcast_to(bundle.x_px, (*bundle.fields.shape[1:3], 1, 2))
    inverse = np.linalg.inv(_jacobian(bundle, middle))
    x = _linear(bundle, points_mm)
    for _ in range(_STEPS):
        step = np.einsum("armij,armj->armi", inverse, points_mm - _fields(bundle, x)[..., :2])
        x = x + step
        if not np.abs(step).max() > _DONE_PX:
            break
    area = 1 / np.abs(np.linalg.det(_jacobian(bundle, x)))
    return x, _fields(bundle, x)[..., 2], area


def _fields(bundle: BundleMap, x_px: np.ndarray) -> np.ndarray:
    """Coordinates and density (a, r, m, 3) of nodes, each at its own positions (a, r, m, 2)."""
    return bundle.basis(x_px) @ bundle.fields.transpose(1, 2, 0, 3)


def _jacobian(bundle: BundleMap, x_px: np.ndarray) -> np.ndarray:
    """Jacobian of the coordinates by position, (a, r, m, 2, 2) [mm per px]."""
    columns = []
    for axis in np.eye(2) * _DIFFERENCE * bundle.half_px:
        change = _fields(bundle, x_px + axis) - _fields(bundle, x_px - axis)
        columns.append(change[..., :2] / (2 * np.hypot(*axis)))
    return np.stack(columns, axis=-1)
