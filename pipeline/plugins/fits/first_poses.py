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

_LEAST_POINTS = 4
"""Fewest points of a board from which a pose follows."""
_ASTRAY = 0.05
"""Misfit of a first pose above which points cannot be those of the board, over the extent of its image [1]: a lens that
is off by some percent leaves less."""
_FAR = 10.0
"""Distance of points that spoil a pose, over that of most [1]."""
_RAYS_PX = 1e-3
"""Accuracy of rays [px]: of first poses more is not asked."""


def first_poses(found: Observations, views: Views, dataset: Dataset) -> np.ndarray:
    """Poses of all boards, (v, 4, 4) world_from_target [mm], each by the camera that sees most points of it.

    UsageError: too few points of a board are seen, its ids run mirrored, or no pose fits.
    """
    poses, points, entries = np.empty((len(views.keys), 4, 4)), points_of(dataset), entries_of(dataset)
    for view, (frame, target) in enumerate(views.keys):
        in_view, of = views.of_rows == view, points[target]
        seen_by = {name: np.flatnonzero(in_view & (found.camera == name)) for name in np.unique(found.camera[in_view])}
        entry = entries[max(seen_by, key=lambda name: len(np.unique(found.point_id[seen_by[name]])))]
        rows = seen_by[entry.full_name]
        board, ids = of.position_mm[found.point_id[rows]], found.point_id[rows]
        where = f"{target} in frame {frame} of {entry.full_name}"
        if (count := len(np.unique(ids))) < _LEAST_POINTS:
            hint = f"a pose needs {_LEAST_POINTS}: leave out the frame"
            raise found.error_at(rows[0], f"{where} has {count} point{'s' * (count > 1)}", hint)
        rig = rig_of(dataset, entry)
        camera = ReadyCamera(name=entry.full_name, rig=rig, min_hit_fraction=0.0, accuracy_px=_RAYS_PX)
        rays = camera.rays(*found.x_px[rows].T)
        if rays.microlens is not None and found.microlens is not None:
            rays.direction[(rays.microlens != found.microlens[rows]).any(axis=1)] = np.nan  # those of a neighbour
        try:
            pose, off_px = _pose(camera, rays, board, ids)
        except UsageError as error:
            raise found.error_at(rows[0], f"{where}: {error.message}", error.hint) from None
        extent_px = float(np.ptp(found.x_px[rows], axis=0).max())
        if np.sqrt(np.mean(off_px**2)) > _ASTRAY * extent_px:
            _, mirrored_px = _pose(camera, rays, board * (-1.0, 1.0, 1.0), ids)
            if np.sqrt(np.mean(mirrored_px**2)) < _ASTRAY * extent_px:
                raise found.error_at(rows[0], *_mirrored(where))
            raise found.error_at(rows[0], *_astray(where, ids, off_px))
        facing = np.einsum("ni,ni->n", of.plane_axes[ids, :, 2] @ pose[:3, :3].T, -apply(pose, board))
        if (facing < 0).mean() > 0.5:
            raise found.error_at(rows[0], *_mirrored(where))
        poses[view] = inverse(vision_from_world(dataset, entry)[frame]) @ pose
    return poses


def _mirrored(where: str) -> tuple[str, str]:
    """Error and remedy of a board that would show its back."""
    hint = "CONVENTIONS.md, Targets: ids run from the top left as the viewer sees it"
    return f"{where} would show its back: its ids run mirrored", hint


def _astray(where: str, ids: np.ndarray, off_px: np.ndarray) -> tuple[str, str]:
    """Error and remedy of a pose that does not fit, with the points that do not, if the others do."""
    middle_px = float(np.median(off_px))
    far = np.unique(ids[off_px > _FAR * middle_px])
    what = f"no pose of {where} fits: points are {middle_px:.2g} px off"
    if 0 < len(far) < len(ids) / 4:
        named = ", ".join(map(str, far[:6].tolist()))
        what = f"{what}, but {named} up to {off_px.max():.2g} px"
    return what, "are ids those of the board, row by row from its top left, and all of one frame?"


def _pose(camera: ReadyCamera, rays: PixelRays, board: np.ndarray, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pose vision_from_target whose points (n, 3) are nearest to the rays, and how far off each is, (n,) [px]; 0
    where there is no ray.
    """
    f_px, *_, centre_z_mm = paraxial_pinhole(camera.camera).tolist()
    centre = np.array([0.0, 0.0, centre_z_mm])
    lit = np.isfinite(rays.direction).all(axis=1) & (rays.direction[:, 2] > 0)
    origin, way, board, ids = rays.origin_mm[lit] - centre, rays.direction[lit], board[lit], ids[lit]
    each, first, number = np.unique(ids, return_index=True, return_inverse=True)
    if len(each) < _LEAST_POINTS:
        raise UsageError("no light reaches its positions", hint="are they in pixels of this sensor?")
    far_mm = camera.planes_mm[1] - centre_z_mm
    there = origin + (far_mm - origin[:, 2:]) / way[:, 2:] * way
    slopes = np.stack([np.bincount(number, there[:, axis]) / np.bincount(number) for axis in (0, 1)], axis=1) / far_mm
    points = board[first]
    is_flat = np.ptp(points[:, 2]) < 1e-6 * np.ptp(points[:, :2])
    flag = cv2.SOLVEPNP_IPPE if is_flat else cv2.SOLVEPNP_SQPNP
    flat = points - (0.0, 0.0, points[:, 2].mean()) if is_flat else points
    _, turns, shifts, _ = cv2.solvePnPGeneric(flat, slopes[:, None], np.eye(3), None, flags=flag)

    def off(p: np.ndarray) -> np.ndarray:
        placed = board @ Rotation.from_rotvec(p[:3]).as_matrix().T + p[3:]
        along = np.einsum("ni,ni->n", placed - origin, way)[:, None]
        away = placed - origin - along * way
        return np.asarray(f_px * away / np.abs(along)).ravel()

    best = None
    for turn, shift in zip(turns, shifts, strict=True):
        fit = least_squares(off, np.concatenate([turn.ravel(), shift.ravel()]), x_scale="jac", loss="soft_l1")
        best = fit if best is None or fit.cost < best.cost else best
    if best is None:
        raise UsageError("no pose fits its positions", hint="are they all in one place, or ids not those of the board?")
    pose = rigid(Rotation.from_rotvec(best.x[:3]).as_matrix(), best.x[3:] + centre)
    off_px = np.zeros(len(lit))
    off_px[lit] = np.linalg.norm(off(best.x).reshape(-1, 3), axis=1)
    return pose, off_px
