"""Light fields of plenoptic images: a view per micro-image offset, with a pixel per microlens.

A view (v, u) holds the light at the same offset from the centre of every micro-image. Rows of a hexagonal array are
shifted by half a micro-image every other time: there a pixel is the mean of its two neighbours, so that views have
square grids of columns and rows. Views of a white scene are beside them: image over white has no vignetting.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.exports.material import ExportCamera, Material
from pipeline.files.exr import read_exr
from pipeline.files.npy import write_npz
from pipeline.formats import Cameras, ExportError, Format, Microlenses, Origin, Reads

FORMAT = Format(
    consumer="light-field code in Python; NumPy",
    note="views (v, u, row, column), the top row first",
    source="CONVENTIONS.md; columns and rows as in libpleno, pleno/geometry/mesh.cpp",
    cameras=Cameras.PLENOPTIC,
    reads=frozenset({Reads.CORNERS, Reads.IMAGES}),
    files=("<camera>/<frame>.lightfield.npz",),
    origin=Origin.ZERO,
    microlenses=Microlenses.MICRO_IMAGE_GRID,
)

_SHIFTED = {"square": None, "hexagonal": 1, "hexagonal-columns": 0}
"""Axis of a grid (row, column) along which every other line is shifted."""


def write(material: Material, folder: Path) -> None:
    """Write an npz per camera and frame."""
    for camera in material.cameras:
        (folder / camera.name).mkdir()
        grid = _Grid(camera)
        white = camera.built.white_path
        for view in camera.built.views:
            if view.image_path is None:
                raise ExportError(f"the build has no image.exr of {camera.name} in frame {view.frame}")
            arrays: dict[str, Any] = {"views": grid.views(view.image_path)}
            if white is not None:
                arrays["white"] = grid.views(white)
            arrays |= {"offsets_px": grid.steps, "centres": grid.centres}
            write_npz(folder / camera.name / f"{view.frame:04d}.lightfield.npz", material.remarks, arrays)


class _Grid:
    """Micro-images by row and column, and where their light is sampled; the format counts pixels as we do."""

    def __init__(self, camera: ExportCamera) -> None:
        images, mesh = camera.array
        assert camera.built.micro_images is not None
        self.shifted = _SHIFTED[mesh.layout]
        column, row = images.microlenses.T
        self.centres = np.full((mesh.rows, mesh.columns, 2), np.nan)  # NaN where there is no micro-image
        self.centres[row, column] = images.centres
        reach = int(np.floor(camera.built.micro_images.radius_px.min()))
        if reach < 1:
            raise ExportError(f"micro-images of {camera.name} are smaller than three pixels, and have no views")
        self.steps = np.arange(-reach, reach + 1)  # offsets of the views from the centres, along x and along y [px]

    def views(self, path: Path) -> np.ndarray:
        """Views of an image, (v, u, rows, columns) float32, with a last axis of channels if it has several."""
        part = next(iter(read_exr(path).values()))  # of a white image: the light of all microlenses
        pixels = [np.asarray(channel, float) for _, channel in sorted(part.channels.items())]
        stack = np.stack([self._view(pixels, x, y) for y in self.steps.tolist() for x in self.steps.tolist()])
        count = len(self.steps)
        views = stack.reshape(count, count, *stack.shape[1:]).astype(np.float32)
        return views[..., 0] if len(pixels) == 1 else views

    def _view(self, pixels: list[np.ndarray], x_px: int, y_px: int) -> np.ndarray:
        """A view (rows, columns, channels)."""
        from scipy.ndimage import map_coordinates

        rows_and_columns = np.moveaxis((self.centres + np.array([x_px, y_px]))[..., ::-1], -1, 0)
        # Linear between the centres of pixels, NaN outside of them
        parts = [map_coordinates(channel, rows_and_columns, order=1, cval=np.nan) for channel in pixels]
        view = np.stack(parts, axis=-1)
        return view if self.shifted is None else _unshifted(view, self.shifted)


def _unshifted(view: np.ndarray, axis: int) -> np.ndarray:
    """A view whose lines 0, 2, … lie half a step farther along an axis, resampled as the mean of two neighbours."""
    lines = np.moveaxis(view, axis, 1)
    straight = lines.copy()
    previous = np.concatenate([np.full_like(lines[0::2, :1], np.nan), lines[0::2, :-1]], axis=1)
    straight[0::2] = (previous + lines[0::2]) / 2
    return np.moveaxis(straight, 1, axis)
