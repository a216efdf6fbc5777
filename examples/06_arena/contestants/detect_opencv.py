"""OpenCV: findChessboardCorners with cornerSubPix, findChessboardCornersSB, ChArUco, AprilTags by the aruco module."""

import cv2
import numpy as np

STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 40, 0.001)
HALF_WINDOW_PX = (5, 5)


def detect(image, board, option):
    """Corners (n, 2) of an image; (0, 0) is the centre of the top-left pixel, as OpenCV has it."""
    return {"xy": np.asarray(globals()[f"_{option}"](image, board), float).reshape(-1, 2)}


def _classic(image, board):
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(image, (board["columns"], board["rows"]), flags=flags)
    return cv2.cornerSubPix(image, corners, HALF_WINDOW_PX, (-1, -1), STOP) if found else []


def _sb(image, board):
    flags = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(image, (board["columns"], board["rows"]), flags=flags)
    return corners if found else []


def _charuco(image, board):
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
    size = (board["columns"] + 1, board["rows"] + 1)
    layout = cv2.aruco.CharucoBoard(size, board["square_mm"], board["marker_mm"], tags)
    corners, *_ = cv2.aruco.CharucoDetector(layout).detectBoard(image)
    return [] if corners is None else corners


def _apriltag(image, board):
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    found, _, _ = cv2.aruco.ArucoDetector(tags, settings).detectMarkers(image)
    return np.concatenate(found, axis=1) if len(found) else []
