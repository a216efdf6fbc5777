"""First poses of boards from observed positions and the rays that the stage has for them.

Each position has a ray. The mean ray of a point is nearly that of a pinhole in the entrance pupil, from which OpenCV
finds a pose, or two; then the pose is the one whose points are nearest to all rays, which behind microlenses tell the
distance, too.
"""

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.camera.figures.equivalent_pinhole import paraxial_pinhole
from pipeline.errors import UsageError
from pipeline.frames import apply, inverse, rigid
from pipeline.plugins.fits.observations import Observations
from pipeline.plugins.fits.predicted_rows import Views, entries_of, points_of, rig_of, vision_from_world
from pipeline.results.answers import PixelRays
from pipeline.results.ready_camera import ReadyCamera
from pipeline.scene.dataset import Dataset
from pipeline.targets.points import TargetPoints

_LEAST_POINTS = 4
"""Fewest points of a board from which a pose follows."""
_ASTRAY = 0.05
"""Misfit of a first pose above which points cannot be those of the board, over the extent of its image [1]: a lens that
is off by some percent leaves less."""
_FAR = 10.0
"""Distance of points that spoil a pose, over that of most [1]."""
_RAYS_PX = 1e-3
"""Accuracy of rays [px]: of first poses more is not asked."""


def first_poses(observations: Observations, views: Views, dataset: Dataset) -> np.ndarray:
    """Poses of all boards, (v, 4, 4) world_from_target [mm], each by the camera that sees most points of it.

    UsageError: too few points of a board are seen, its ids run mirrored, or no pose fits.
    """
    poses = np.empty((len(views.keys), 4, 4))
    entries = entries_of(dataset)
    for view, (frame, target) in enumerate(views.keys):
        in_view = views.of_rows == view
        rows_of = {
            name: np.flatnonzero(in_view & (observations.camera == name))
            for name in np.unique(observations.camera[in_view]).tolist()
        }
        entry = entries[max(rows_of, key=lambda name: len(np.unique(observations.point_id[rows_of[name]])))]
        rig, name = rig_of(dataset, entry), entry.full_name
        camera = ReadyCamera(name=name, rig=rig, min_hit_fraction=0.0, accuracy_px=_RAYS_PX)
        board = f"{target} in frame {frame} of {name}"
        pose = _first_pose(observations, rows_of[name], camera, points_of(dataset)[target], board)
        poses[view] = inverse(vision_from_world(dataset, entry)[frame]) @ pose
    return poses


def _first_pose(
    observations: Observations, rows: np.ndarray, camera: ReadyCamera, points: TargetPoints, board: str
) -> np.ndarray:
    """The pose of a board, vision_from_target, by the rows of a camera; `board` is its name for errors, which are those
    of `first_poses`.
    """
    ids, x_px = observations.point_id[rows], observations.x_px[rows]
    if (count := len(np.unique(ids))) < _LEAST_POINTS:
        hint = f"a pose needs {_LEAST_POINTS}: leave out the frame"
        raise observations.error_at(rows[0], f"{board} has {count} point{'s' * (count > 1)}", hint)
    rays = camera.rays(*x_px.T)
    if rays.microlens is not None and observations.microlens is not None:
        is_of_neighbour = (rays.microlens != observations.microlens[rows]).any(axis=1)
        rays.direction[is_of_neighbour] = np.nan
    points_mm, extent_px = points.position_mm[ids], float(np.ptp(x_px, axis=0).max())
    try:
        pose, distance_px = _nearest_pose(camera, rays, points_mm, ids)
    except UsageError as error:
        raise observations.error_at(rows[0], f"{board}: {error.message}", error.hint) from None
    if np.sqrt(np.mean(distance_px**2)) > _ASTRAY * extent_px:
        raise observations.error_at(rows[0], *_astray(board, ids, distance_px))
    normals = points.plane_axes[ids, :, 2] @ pose[:3, :3].T
    if (np.einsum("ni,ni->n", normals, -apply(pose, points_mm)) < 0).mean() > 0.5:
        hint = "CONVENTIONS.md, Targets: ids run from the top left as the viewer sees it"
        raise observations.error_at(rows[0], f"{board} would show its back: its ids run mirrored", hint)
    return pose


def _astray(board: str, ids: np.ndarray, distance_px: np.ndarray) -> tuple[str, str]:
    """Error and remedy of a pose that does not fit, with the points that do not, if the others do."""
    median_px = float(np.median(distance_px))
    outliers = np.unique(ids[distance_px > _FAR * median_px])
    message = f"no pose of {board} fits: points are {median_px:.2g} px off"
    if 0 < len(outliers) < len(ids) / 4:
        listed = ", ".join(map(str, outliers[:6].tolist()))
        message = f"{message}, but {listed} up to {distance_px.max():.2g} px"
    return message, "are ids those of the board, row by row from its top left, and all of one frame?"


def _nearest_pose(
    camera: ReadyCamera, rays: PixelRays, points_mm: np.ndarray, ids: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The pose vision_from_target whose points (n, 3) are nearest to the rays, and the distance of each from its own,
    (n,) [px]; 0 where there is no ray.
    """
    f_px, *_, centre_z_mm = paraxial_pinhole(camera.camera).tolist()
    centre_mm, far_z_mm = np.array([0.0, 0.0, centre_z_mm]), camera.planes_mm[1]
    far_mm = rays.at_distance(far_z_mm)
    is_lit = np.isfinite(far_mm).all(axis=1)
    origin_mm, direction = rays.origin_mm[is_lit] - centre_mm, rays.direction[is_lit]
    lit_points_mm = points_mm[is_lit]
    point_ids, first_rows, point = np.unique(ids[is_lit], return_index=True, return_inverse=True)
    if len(point_ids) < _LEAST_POINTS:
        raise UsageError("no light reaches its positions", hint="are they in pixels of this sensor?")
    # The mean ray of each point crosses a far plane where a pinhole in the centre would send it.
    mean_mm = [np.bincount(point, far_mm[is_lit, axis]) / np.bincount(point) for axis in (0, 1)]
    slopes = np.stack(mean_mm, axis=1) / (far_z_mm - centre_z_mm)
    candidates = _pinhole_poses(lit_points_mm[first_rows], slopes)

    def distances_px(pose: np.ndarray) -> np.ndarray:
        """Distances from points to rays, as seen from their origins, (3 k,)."""
        placed_mm = lit_points_mm @ Rotation.from_rotvec(pose[:3]).as_matrix().T + pose[3:]
        along_mm = np.einsum("ni,ni->n", placed_mm - origin_mm, direction)[:, None]
        across_mm = placed_mm - origin_mm - along_mm * direction
        return np.asarray(f_px * across_mm / np.abs(along_mm)).ravel()

    fits = [least_squares(distances_px, candidate, x_scale="jac", loss="soft_l1") for candidate in candidates]
    if not fits:
        raise UsageError(
            "no pose fits its positions", hint="are they in one place or on one line, or ids not those of the board?"
        )
    best = min(fits, key=lambda fit: fit.cost)
    distance_px = np.zeros(len(is_lit))
    distance_px[is_lit] = np.linalg.norm(distances_px(best.x).reshape(-1, 3), axis=1)
    return rigid(Rotation.from_rotvec(best.x[:3]).as_matrix(), best.x[3:] + centre_mm), distance_px


def _pinhole_poses(points_mm: np.ndarray, slopes: np.ndarray) -> list[np.ndarray]:
    """Poses of points (n, 3) before a pinhole that sees them at slopes to its axis (n, 2), a turn and a shift each; of
    a flat board either tilt.
    """
    is_flat = np.ptp(points_mm[:, 2]) < 1e-6 * np.ptp(points_mm[:, :2])
    method = cv2.SOLVEPNP_IPPE if is_flat else cv2.SOLVEPNP_EPNP  # SQPNP refuses narrow fields
    at_zero_mm = points_mm - (0.0, 0.0, points_mm[:, 2].mean()) if is_flat else points_mm  # IPPE asks for z = 0
    _, turns, shifts, _ = cv2.solvePnPGeneric(at_zero_mm, slopes[:, None], np.eye(3), None, flags=method)
    poses = [np.concatenate([turn.ravel(), shift.ravel()]) for turn, shift in zip(turns, shifts, strict=True)]
    return [pose for pose in poses if np.isfinite(pose).all()]  # points on a line have none
