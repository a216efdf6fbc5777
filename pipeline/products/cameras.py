"""Common parts of several kinds of tasks: reading a focused camera and making its tracer."""

import dataclasses
import functools
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.camera.figures.equivalent_pinhole import Pinhole
from pipeline.camera.micro_images.centres import MicroImages, micro_images
from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.files.jsonfile import read_json
from pipeline.files.npy import StackedRows
from pipeline.products.light import Exposure
from pipeline.records.plain import from_plain
from pipeline.truth.grid.ray_grid import image_from_fine

Inputs = dict[str, dict[str, Path]]
"""Role -> output name -> file in the store."""

FOCUSED, PINHOLE = "focused.json", "pinhole.json"
_POSITIONS_AT_ONCE = 1 << 16
"""Positions in a piece: the four arrays of `Stretch` take 48 bytes for each, 3 MiB in all."""
_PICTURE_ROWS = 512
"""Rows that become a picture at once: the formula takes some hundred bytes per pixel."""
_CACHED = 4
"""Cameras that a process keeps ready: tasks of one camera share its outlines, microlenses and reference bundle."""


def light_file(image: str) -> str:
    """Name of the array (h, w) float32 that an image task leaves beside `image`.exr, for tasks that read its light."""
    return f"{image}.light.npy"


def focused_camera(inputs: Inputs, role: str = "camera") -> Camera:
    """The camera that a task `camera` hands on."""
    return from_plain(Camera, read_json(inputs[role][FOCUSED]))


def pinhole_of(inputs: Inputs, role: str = "pinhole") -> Pinhole | None:
    """The pinhole written by the task `pinhole`; None if there is none."""
    plain = read_json(inputs[role][PINHOLE])
    return None if plain is None else from_plain(Pinhole, plain)


def tracer_alone(inputs: Inputs, seed: int) -> Tracer:
    """The tracer of the focused camera, without its micro-images."""
    return _tracer(_text(inputs), seed)


def _text(inputs: Inputs) -> str:
    return inputs["camera"][FOCUSED].read_text(encoding="utf-8")


def imaged_rig(inputs: Inputs, exposure: Exposure) -> Rig:
    """The focused camera made ready for images."""
    diffraction_nm = exposure.wavelength_nm if exposure.diffraction else None
    rig = rig_of(inputs, exposure.seed)
    return dataclasses.replace(rig, diffraction_nm=diffraction_nm, device=exposure.device)


def rig_of(inputs: Inputs, seed: int, square_px: float = 0.0) -> Rig:
    """The focused camera with its micro-images; `square_px` is the edge of the square on which the rays of J start."""
    text = _text(inputs)
    tracer = _tracer(text, seed)
    return Rig(tracer, _images(text, seed) if tracer.camera.microlenses else None, square_px)


@functools.lru_cache(maxsize=_CACHED)
def _tracer(camera: str, seed: int) -> Tracer:
    """The tracer of a camera by the text of focused.json: two texts are equal only if all of their numbers are."""
    return Tracer(from_plain(Camera, json.loads(camera)), seed)


@functools.lru_cache(maxsize=_CACHED)
def _images(camera: str, seed: int) -> MicroImages:
    return micro_images(_tracer(camera, seed))


def in_bands(height: int, picture: Callable[[int, int], np.ndarray]) -> np.ndarray:
    """A picture, (h, w, 3), of which some rows are made at a time."""
    ends = [*range(0, height, _PICTURE_ROWS), height]
    return np.concatenate([picture(first, end) for first, end in pairwise(ends)])


def stacked(inputs: Inputs, tiles: int, name: str) -> np.ndarray:
    """Arrays written by tiles, one below the other."""
    rows = StackedRows([inputs[f"tile{number}"][name] for number in range(tiles)])
    return rows.rows(0, rows.shape[0])


@dataclass(frozen=True, slots=True)
class Stretch:
    """Some positions of the fine grid, row by row: indices from the first of the band, (n,); columns and rows of the
    grid, (n, 2); points of the sensor, vision frame, (n, 3); and the microlens in whose cell each lies, (n,).
    """

    index: np.ndarray
    pixels: np.ndarray
    positions_mm: np.ndarray
    microlens: np.ndarray


def stretches(rig: Rig, supersampling: int, first_row: int, end_row: int) -> Iterator[Stretch]:
    """A band of rows of the fine grid, in pieces that fit into memory."""
    width = rig.tracer.camera.sensor.width_px * supersampling
    count = (end_row - first_row) * width
    for first in range(0, count, _POSITIONS_AT_ONCE):
        index = np.arange(first, min(first + _POSITIONS_AT_ONCE, count))
        pixels = np.stack([index % width, index // width + first_row], axis=1)
        positions = rig.tracer.positions_mm(*image_from_fine(pixels.T, supersampling))
        yield Stretch(index, pixels, positions, rig.microlens_at(positions))
