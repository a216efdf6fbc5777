"""Cameras as an export describes them: a pinhole, micro-images, the regular array and mesh through these."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pipeline.exports.errors import ExportError
from pipeline.exports.seen.stated_sight import Sight, StatedSight
from pipeline.results.records import BuiltCamera, BuiltPinhole


@dataclass(frozen=True, slots=True, kw_only=True)
class StatedPose:
    """A pose as a format states it: in its direction, its form of rotation and its unit.

    Attributes
    ----------
    rotation : array
        (3,), (4,) or (3, 3), as the convention says.
    translation : (3,) float64
    """

    rotation: np.ndarray
    translation: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImages:
    """Micro-images of a plenoptic camera, a row each.

    Attributes
    ----------
    microlenses : (n, 2) int64
    types : (n,) int64
    centres : (n, 2) float64
        Image positions: the real ray through the centre of the stop and the vertex.
    focal_lengths_mm : (types,) float64
    own_types : (types,) int64
        Our number of each type: where it stands in camera.json.
    """

    microlenses: np.ndarray
    types: np.ndarray
    centres: np.ndarray
    focal_lengths_mm: np.ndarray
    own_types: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class ArrayFit:
    """The regular array through the micro-images of an image.

    Attributes
    ----------
    layout : str
        Layout as in camera.json.
    centre : (2,) float64
        Image position of the micro-image nearest to the middle of the image.
    pitch_px, cross_pitch_px : float
        Lengths of the basis vectors of CONVENTIONS.md, Microlens lattice.
    turn_rad : float
        Anticlockwise as seen, from an array that is not turned.
    type : int
        Type of the micro-image at the centre.
    """

    layout: str
    centre: np.ndarray
    pitch_px: float
    cross_pitch_px: float
    turn_rad: float
    type: int


@dataclass(frozen=True, slots=True, kw_only=True)
class GridMesh:
    """A regular mesh of micro-image centres: the node of column c and row r is origin + turned (x(c, r), y(c, r)).

    Attributes
    ----------
    layout : str
        `square`, `hexagonal` or `hexagonal-columns`.
    columns, rows : int
    pitch_px : tuple of float
        Along x and along y.
    angle_rad : float
        Rotation from +x towards +y.
    origin : (2,) float64
        An image position.
    """

    layout: str
    columns: int
    rows: int
    pitch_px: tuple[float, float]
    angle_rad: float
    origin: np.ndarray

    @property
    def step_px(self) -> tuple[float, float]:
        """Distance of columns and of rows: lines of a hexagonal mesh stand closer than its pitch."""
        closer = math.sqrt(3) / 2
        across = closer if self.layout == "hexagonal-columns" else 1
        down = closer if self.layout == "hexagonal" else 1
        return self.pitch_px[0] * across, self.pitch_px[1] * down

    def place(self, x_px: float, y_px: float) -> np.ndarray:
        """Image position of a place that counts from the origin along the axes of the mesh, (2,)."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return np.array([[cos, -sin], [sin, cos]]) @ [x_px, y_px] + self.origin


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportCamera:
    """A camera with its equivalent pinhole.

    Attributes
    ----------
    size_px : tuple of int
    pinhole : BuiltPinhole or None
        The equivalent pinhole with distortion; after the conversion that of the rows, if the format asks for it. None
        where none fits.
    row_pinhole : BuiltPinhole or None
        That of the rows; None where they determine none, and behind microlenses.
    axis : (2,) float64
        Image position of the optical axis.
    micro_images : MicroImages or None
        None for a conventional camera.
    array : ArrayFit or None
        Array of a plenoptic camera; None for another one, and before the conversion.
    mesh : GridMesh or None
        Mesh for formats that count micro-images by column and row; None for others, and before the conversion.
    pose : StatedPose or None
        Pose from another camera, for formats that state one; None for others, and before the conversion.
    sight : callable
        Makes the camera ready: its rays and projections, in our conventions.
    stated : StatedSight or None
        The same in those of a format; None before the conversion.
    built : BuiltCamera
        Everything else that the build says, in our conventions.
    """

    name: str
    size_px: tuple[int, int]
    pitch_mm: float
    pinhole: BuiltPinhole | None
    axis: np.ndarray
    micro_images: MicroImages | None = field(repr=False)
    built: BuiltCamera = field(repr=False)
    row_pinhole: BuiltPinhole | None = None
    array: ArrayFit | None = None
    mesh: GridMesh | None = None
    pose: StatedPose | None = None
    sight: Callable[[], Sight] | None = field(default=None, repr=False)
    stated: StatedSight | None = field(default=None, repr=False)

    @property
    def rays(self) -> StatedSight:
        """Its rays as the format counts them."""
        assert self.stated is not None
        return self.stated

    @property
    def model(self) -> BuiltPinhole:
        """The pinhole, of formats that cannot do without one.

        Raises
        ------
        ExportError
            None fits.
        """
        if self.pinhole is None:
            raise ExportError(
                f"no pinhole fits {self.name}, and this format describes a camera by one",
                hint="camera.json says how much of the image has light; choose other cameras with --only",
            )
        return self.pinhole
