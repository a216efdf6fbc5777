"""The ChESS detector of chess-corners: it states a covariance of every corner, and looks for no board."""

import numpy as np
from chess_corners import Detector

DETECTOR = Detector()


def detect(image, board, option):
    """Corners (n, 2) of an image, and their stated covariances (n, 2, 2)."""
    found = DETECTOR.detect(np.ascontiguousarray(image))
    return {"xy": np.asarray(found.xy, float), "covariance": np.asarray(found.position_covariance, float)}
