"""OpenCV: calibrateCameraExtended with 5, 8 and 14 coefficients, fisheye.calibrate, and calibrateMultiview."""

import cv2
import numpy as np

FLAGS = {
    "brown": 0,
    "rational": cv2.CALIB_RATIONAL_MODEL,
    "thin-prism-tilted": cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 500, 1e-12)
UNDISTORT = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-12)


def calibrate(case, option):
    """Calibrate by one of the functions."""
    points = [board["object_mm"].astype(np.float32) for board in case["boards"]]
    images = [board["image_px"].astype(np.float32) for board in case["boards"]]
    size, query = tuple(map(int, case["size_px"])), case["query_px"]
    if option == "fisheye":
        return _fisheye(points, images, size, query, float(case["focal_guess_px"]))
    if option == "multiview":
        return _multiview(case, size, query)
    rms, matrix, bend, turns, shifts, sigma, _, _ = cv2.calibrateCameraExtended(
        points, images, size, None, None, flags=FLAGS[option], criteria=STOP
    )
    values = np.concatenate([matrix[[0, 1, 0, 1], [0, 1, 2, 2]], bend.ravel()])
    return {
        "slopes": cv2.undistortPoints(query[:, None], matrix, bend, criteria=UNDISTORT),
        "rms_px": rms,
        "poses": _poses(turns, shifts),
        "values": values[:4],
        "sigmas": sigma.ravel()[:4],
    }


def _fisheye(points, images, size, query, focal_px):
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | cv2.CALIB_USE_INTRINSIC_GUESS
    guess = np.array([[focal_px, 0, size[0] / 2], [0, focal_px, size[1] / 2], [0, 0, 1.0]])
    points, images = ([one[None].astype(np.float64) for one in some] for some in (points, images))
    rms, matrix, bend, turns, shifts = cv2.fisheye.calibrate(
        points, images, size, guess, np.zeros(4), flags=flags, criteria=STOP
    )
    return {
        "slopes": cv2.fisheye.undistortPoints(query[:, None], matrix, bend),
        "rms_px": rms,
        "poses": _poses(turns, shifts),
    }


def _multiview(case, size, query):
    """Two cameras: this one and a second of the same kind, whose positions the case holds, too."""
    every, views = np.unique(case["point"]), np.unique(case["view"])
    at = np.array([case["object_mm"][case["point"] == point][0] for point in every])
    # Metres, as OpenCV 5.0 wants them; a point that was not seen has negative coordinates.
    objects = [(at / 1000).astype(np.float32) for _ in views]
    images, mask = [], np.ones((2, len(views)), np.uint8)
    for camera, start in enumerate(("", "second_")):
        seen = np.full((len(views), len(every), 2), -1.0, np.float32)
        rows = np.searchsorted(views, case[f"{start}view"]), np.searchsorted(every, case[f"{start}point"])
        seen[rows] = case[f"{start}image_px"]
        mask[camera] = (seen[..., 0] > -1).all(axis=1)
        images.append(list(seen))
    rms, matrices, bends, *_ = cv2.calibrateMultiview(
        objects, images, [size, size], mask, np.zeros(2, np.uint8),
        [np.eye(3), np.eye(3)], [np.zeros(5), np.zeros(5)],
        [np.eye(3), np.eye(3)], [np.zeros((3, 1)), np.zeros((3, 1))],
    )  # fmt: skip
    return {"slopes": cv2.undistortPoints(query[:, None], matrices[0], bends[0], criteria=UNDISTORT), "rms_px": rms}


def _poses(turns, shifts):
    pairs = zip(turns, shifts, strict=True)
    return np.array([np.column_stack([cv2.Rodrigues(turn)[0], np.ravel(shift)]) for turn, shift in pairs])
