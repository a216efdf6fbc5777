"""Visibility: the share of a bundle's weight that reaches the surface at its target point unobstructed.

J ignores obstacles: it uses all rays that leave the camera. Rows whose share is 0 do not exist.
"""

from typing import NamedTuple

import numpy as np

from pipeline.camera.parts.camera import REPLICAS
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.camera.tracing import bundle_kernels
from pipeline.camera.tracing.records import Leaving, Samples, Squares, no_diffraction
from pipeline.camera.tracing.sobol import sobol_bits
from pipeline.records.shapes import Float64, Int64
from pipeline.render.surroundings import Surroundings
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import LEAVING, LEVELS, LOOK_RAYS, MOST_RAYS, RAYS

METHOD = (
    f"share of the leaving weight that comes to the surface at the point unhindered, by {LOOK_RAYS} random rays,"
    f" {RAYS} where it is partly hidden, up to {MOST_RAYS} until {LEAVING} leave; 1 without a ray where nothing stands"
    " before the tangent plane"
)
"""Description of the method for headers."""
_STREAM = 0x0CC1
"""Change of the seed, so that random numbers differ from those of images."""
_RAYS_PER_CHUNK = 1 << 19
"""Rays that are traced together: 64 bytes each, 32 MiB."""


class PointBundles(NamedTuple):
    """Bundles towards target points: microlenses or NO_MICROLENS, positions, and tangent planes there."""

    microlens: np.ndarray
    x_px: np.ndarray
    planes: np.ndarray

    def only(self, rows: np.ndarray) -> "PointBundles":
        """The bundles of these rows."""
        return PointBundles(*(part[rows] for part in self))


def visible_rows(rows: Correspondences, share: Float64[np.ndarray, "n"]) -> tuple[Correspondences, np.ndarray]:
    """The rows that are not hidden, with counts of the hidden ones, and their visibility, (m,)."""
    kept = share != 0  # NaN (unknown) does not mean hidden
    visible = rows.only(kept).recounted(
        dropped_hidden=int(np.sum(~kept)),
        partly_hidden=int(np.sum((share > 0) & (share < 1))),
        rows=int(np.sum(kept)),
    )
    return visible, share[kept]


def visibility(
    rig: Rig,
    surroundings: Surroundings,
    target: int,
    microlens: Int64[np.ndarray, "n"],
    x_px: Float64[np.ndarray, "n 2"],
    planes: Float64[np.ndarray, "n 4 3"],
) -> tuple[np.ndarray, np.ndarray]:
    """Visible share of the bundles at image positions, and its standard error, (n,) each.

    If nothing lies in front of the tangent plane the share is 1, and no ray is traced. `target` is the index of the
    target to which the points belong; `planes` are the tangent planes of each row's point.
    """
    share = np.ones(len(x_px))
    error = np.zeros(len(x_px))
    leaving_rays = np.zeros(len(x_px), np.int64)
    bundles = PointBundles(microlens, x_px, planes)
    rows = np.flatnonzero(surroundings.may_hide(planes[:, 0], planes[:, 3]))
    for rays in LEVELS:
        # Trace this many rays of each row, batch by batch.
        rows_at_once = max(1, _RAYS_PER_CHUNK // rays)
        for first in range(0, len(rows), rows_at_once):
            batch = rows[first : first + rows_at_once]
            measured = shares(rig, surroundings, target, bundles.only(batch), rays)
            share[batch], error[batch], leaving_rays[batch] = measured
        # Go on with rows of too few leaving rays, and up to `RAYS` with partly hidden ones.
        is_partly_hidden = (share[rows] > 0) & (share[rows] < 1)
        rows = rows[(leaving_rays[rows] < LEAVING) | (rays < RAYS) & is_partly_hidden]
    return share, error


def shares(
    rig: Rig, surroundings: Surroundings, target: int, bundles: PointBundles, rays: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Visible share of the light of each row, its standard error, and the number of rays that leave, (n,) each.

    `rays`: for each row; fewer rays are the first ones of more. NaN where none leaves.
    """
    # Sum the weights of the rays that leave and of those that arrive, for each row and replica.
    leaving, arriving = np.zeros((2, len(bundles.x_px), REPLICAS))
    count = np.zeros(len(bundles.x_px), np.int64)
    for light in rig.tracer.lights:
        random_rays = _random_rays(light.tracer, rig.square_px, bundles, rays)
        owner = random_rays.owner
        row = owner // REPLICAS
        count += np.bincount(row, minlength=len(count))
        planes = bundles.planes[row]
        hidden = surroundings.hides(target, planes[:, 0], planes[:, 3], random_rays.origin, random_rays.direction)
        weight = random_rays.share
        leaving += light.share * np.bincount(owner, weight, leaving.size).reshape(leaving.shape)
        arriving += light.share * np.bincount(owner, weight * ~hidden, leaving.size).reshape(leaving.shape)
    # The spread of the replicas is the standard error.
    with np.errstate(invalid="ignore"):
        share = arriving.sum(axis=1) / leaving.sum(axis=1)
        error = np.std(arriving / leaving, axis=1, ddof=1) / np.sqrt(REPLICAS)
    return share, error, count


def _random_rays(tracer: Tracer, square_px: float, bundles: PointBundles, rays: int) -> Leaving:
    """`rays` random rays of each bundle that leave the camera; the strata are replicas instead of microlenses.

    The owner of a ray is its bundle times REPLICAS, plus its replica.
    """
    strata = np.repeat(bundles.microlens[:, None], REPLICAS, axis=1)
    bits = sobol_bits(rays // REPLICAS)
    samples = Samples(bits, tracer.seed ^ _STREAM, square_px * tracer.camera.sensor.pitch_mm)
    x_px = bundles.x_px
    counts = np.full_like(strata, rays // REPLICAS)
    squares = Squares(np.rint(x_px).astype(np.int64), tracer.positions_mm(*x_px.T), strata, counts, 0 * counts)
    leaving = Leaving.empty(len(x_px) * rays)
    count = bundle_kernels.image_rays(tracer.arrays, samples, squares, no_diffraction(), leaving)
    bundle_kernels.image_rays.count(len(x_px) * rays, len(tracer.table))
    return leaving.first(count)
