"""The regular array that fits the micro-images of an image best: pitch, turn and the microlens in the middle."""

import math

import numpy as np

from pipeline.exports.cameras import ArrayFit, ExportCamera, MicroImages
from pipeline.exports.conventions import Convention, ImageAxes

_ALONG_RAD = {"hexagonal": 0.0, "square": 0.0, "hexagonal-columns": math.pi / 6}
"""Direction of the first basis vector of an array that is not turned, from +x towards +y of the sensor frame [rad]."""


def in_image(camera: ExportCamera) -> np.ndarray:
    """Whether micro-images of a camera, in our conventions, have their centre in the image, (n,) bool."""
    images = camera.micro_images
    assert images is not None
    inside = (images.centres >= 0) & (images.centres <= np.array(camera.size_px) - 1)
    return np.asarray(inside.all(axis=1))


def array_fit(camera: ExportCamera, stated: MicroImages, convention: Convention) -> ArrayFit:
    """Least squares through the centres in the image.

    Parameters
    ----------
    camera : ExportCamera
        A camera in our conventions.
    stated : MicroImages
        The same, with its centres as the format counts them.
    """
    rows, images = in_image(camera), camera.micro_images
    assert images is not None
    numbers = images.microlenses[rows]
    middle = (np.array(camera.size_px) - 1) / 2
    nearest = int(np.linalg.norm(images.centres[rows] - middle, axis=1).argmin())
    steps = np.column_stack([numbers - numbers[nearest], np.ones(len(numbers))])
    along, across, centre = np.linalg.lstsq(steps, stated.centres[rows], rcond=None)[0]
    if convention.axes is ImageAxes.Y_X:
        along, across = along[::-1], across[::-1]
    upwards = 1 if convention.axes is ImageAxes.X_UP else -1
    turn = upwards * math.atan2(along[1], along[0]) + _ALONG_RAD[_layout(camera)]
    return ArrayFit(
        layout=_layout(camera),
        centre=centre,
        pitch_px=float(np.hypot(*along)),
        cross_pitch_px=float(np.hypot(*across)),
        turn_rad=turn,
        type=int(stated.types[rows][nearest]),
    )


def _layout(camera: ExportCamera) -> str:
    found: str = camera.built.record["mla"]["layout"]
    return found
