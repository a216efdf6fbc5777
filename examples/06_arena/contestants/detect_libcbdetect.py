"""libcbdetect of Geiger et al. in its C++ form."""

import numpy as np
from libCBDetect import Checkerboard


def detect(image, board, option):
    """Corners (n, 2) of an image, whether they form a board or not."""
    seeker = Checkerboard()
    seeker.array_norm_to_image(image / 255, *image.shape)
    seeker.find_corners()
    u, v = np.zeros(seeker.number_of_corners), np.zeros(seeker.number_of_corners)
    seeker.get_corners(u, v)
    return {"xy": np.stack([u, v], axis=1)}
