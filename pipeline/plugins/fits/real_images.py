"""Images of a real camera: found for a fit, and shown beside those of its twin."""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from pipeline.channel_names import body_and_channel
from pipeline.errors import UsageError
from pipeline.files.exr import read_exr
from pipeline.files.tiff import read_tiff
from pipeline.results.output import Output
from pipeline.results.records import BuiltView
from pipeline.scene.dataset import Dataset
from pipeline.scene.usd.roots import OUTSIDE_HINT, allowed_roots, is_inside, real_path

Images = Mapping[str, Mapping[str, str]]
"""Files of images, relative to the layer of a fit, by camera and by frame."""
_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm")
"""Files that are images; others in the folder are left alone."""
_OF_CHANNEL = {"blue": 0, "green": 1, "red": 2}
"""Place of a channel in OpenCV's order."""
SPAN = 0.2
"""Difference that is shown black or white, over the range of the real images [1]."""


def found_images(folders: Sequence[str], dataset: Dataset, layer: Path) -> Images:
    """Find the images of real cameras, `[CAMERA=]FOLDER` each; the frame is the last number in the name of a file.

    Raises UsageError: no such camera or frame, an image of another size, two of a frame, or a file that a build of
    `layer` may not read.
    """
    sizes_px = {camera.name: camera.camera.sensor.size_px for camera in dataset.cameras}
    frames, roots = {frame.number for frame in dataset.frames}, allowed_roots(layer)
    images: dict[str, dict[str, str]] = {}
    for option in folders:
        camera, _, folder = option.rpartition("=")
        camera = camera or (next(iter(sizes_px)) if len(sizes_px) == 1 else "")
        if camera not in sizes_px:
            hint = f"say --images CAMERA=FOLDER; cameras: {', '.join(sizes_px)}"
            raise UsageError(f"--images {option} names no camera of the dataset", hint=hint)
        files = sorted(file for file in Path(folder).glob("*") if file.suffix.lower() in _SUFFIXES)
        if not files:
            raise UsageError(f"{folder} is no folder with images", hint=f"they end in {', '.join(_SUFFIXES)}")
        of_camera = images.setdefault(camera, {})
        for file in files:
            digits = re.findall(r"\d+", file.stem)
            frame = int(digits[-1]) if digits else None
            if frame not in frames:
                names = "no frame" if frame is None else f"frame {frame}, which the dataset does not have"
                raise UsageError(f"{file} names {names}", hint="the frame is the last number in the name of an image")
            if not is_inside(file, roots):
                raise UsageError(f"a build of {layer} may not read {file}", hint=OUTSIDE_HINT)
            relative = os.path.relpath(real_path(file), real_path(layer).parent)
            if (other := of_camera.setdefault(str(frame), relative)) != relative:
                raise UsageError(f"{file} and {other} are both of frame {frame}", hint="leave one out")
            _pixels(file, None, sizes_px[camera])
    return images


def _pixels(file: Path, channel: str | None, size_px: tuple[int, int]) -> np.ndarray:
    """Numbers of an image, (h, w): of one channel, or the mean of all; UsageError: no image, or one of another size."""
    pixels = cv2.imread(str(file), cv2.IMREAD_UNCHANGED) if file.is_file() else None
    if pixels is None:
        raise UsageError(f"{file} is no image that can be read")
    if pixels.shape[1::-1] != tuple(size_px):
        own_size, size = ("{} x {}".format(*pair) for pair in (pixels.shape[1::-1], size_px))
        hint = "give images as the sensor has them, neither cropped, scaled nor turned"
        raise UsageError(f"{file} is {own_size} px, the images of the camera are {size} px", hint=hint)
    if pixels.ndim == 2:
        return pixels.astype(float)
    return pixels[..., _OF_CHANNEL[channel]].astype(float) if channel in _OF_CHANNEL else pixels.mean(axis=2)


@dataclass(frozen=True, kw_only=True)
class SideBySide:
    """Images of a real camera and of its twin by frame, with the twin's brought to the real ones' scale: by one gain
    and one offset for all frames, which the exposure of a real camera leaves open.

    `observed_px`: positions of each frame, (n, 2). Images are compared within their convex hull: around a real board
    are things that the twin has not.
    """

    files: Mapping[int, Path]
    views: Mapping[int, BuiltView]
    observed_px: Mapping[int, np.ndarray]

    @classmethod
    def of(cls, output: Output, camera: str, files: Mapping[int, Path], observed_px: Mapping[int, np.ndarray]) -> Self:
        """Those of the frames that have positions and that a build has images of."""
        views = {view.frame: view for view in output.cameras[camera].views if view.image_path is not None}
        compared = sorted(views.keys() & files.keys() & observed_px.keys())
        return cls(files={frame: files[frame] for frame in compared}, views=views, observed_px=observed_px)

    def _pair(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Real image, and that of the twin: raw where both are, else its light."""
        view = self.views[frame]
        body, channel = body_and_channel(view.camera)
        real = _pixels(self.files[frame], channel, view.size_px)
        assert view.image_path is not None
        raw = view.image_path.parent.parent / body / "raw.tiff"
        if raw.is_file():
            return real, read_tiff(raw)[0].astype(float)
        return real, np.mean(list(read_exr(view.image_path)["image"].channels.values()), axis=0)

    @cached_property
    def _sums(self) -> dict[int, tuple[np.ndarray, float, float]]:
        """Mean products (3, 3) of the numbers of the real image, of its twin and of 1, and both ends of the former, by
        frame, in the convex hull of the positions.
        """
        sums = {}
        for frame in self.files:
            real, twin = self._pair(frame)
            mask = np.zeros(real.shape, np.uint8)
            cv2.fillConvexPoly(mask, cv2.convexHull(np.rint(self.observed_px[frame]).astype(np.int32)), 1)
            inside = mask > 0
            columns = np.stack([real[inside], twin[inside], np.ones(inside.sum())])
            sums[frame] = (columns @ columns.T / inside.sum(), real[inside].min(), real[inside].max())
        return sums

    @cached_property
    def scale(self) -> np.ndarray:
        """Gain and offset that bring the twin's images nearest to the real ones, (2,)."""
        products = np.mean([products for products, *_ in self._sums.values()], axis=0)
        return np.linalg.lstsq(products[1:, 1:], products[1:, 0], rcond=None)[0]  # the normal equations

    @property
    def _ends(self) -> tuple[float, float]:
        """Least number of the real images, and their range, above 0."""
        _, lows, highs = zip(*self._sums.values(), strict=True)
        return min(lows), max(max(highs) - min(lows), np.finfo(float).tiny)

    @property
    def lines(self) -> list[str]:
        """Lines about all frames."""
        gain, offset = self.scale
        difference = np.array([1.0, -gain, -offset])  # of a real image, its twin and 1
        mean_square = {frame: difference @ products @ difference for frame, (products, *_) in self._sums.items()}
        rms = {frame: np.sqrt(max(value, 0.0)) / self._ends[1] for frame, value in mean_square.items()}
        return [
            f"real images beside the twin's, which are times {gain:.6g} plus {offset:.6g}: nearest over all frames,"
            " between the outermost positions",
            f"real minus twin: grey is none, black and white are {SPAN:.0%} of the range of the real images",
            "rms by frame, over that range: " + "; ".join(f"{frame}: {value:.2%}" for frame, value in rms.items()),
        ]

    def pictures(self, frame: int) -> dict[str, np.ndarray]:
        """Pictures of a frame by name, (h, w) uint8: both images on one scale, and their difference."""
        if frame not in self.files:
            return {}
        (real, twin), (gain, offset), (low, span) = self._pair(frame), self.scale, self._ends
        twin = gain * twin + offset
        shades = {
            "real": (real - low) / span,
            "twin": (twin - low) / span,
            "real minus twin": 0.5 + (real - twin) / (2 * SPAN * span),
        }
        return {name: np.rint(255 * np.clip(shade, 0, 1)).astype(np.uint8) for name, shade in shades.items()}
