"""Cameras as an export describes them: a pinhole, micro-images, the regular array and mesh through these, rays."""

from dataclasses import dataclass, field

import numpy as np

from pipeline.exports.micro_images import GridMesh, MicroImages
from pipeline.exports.sights import CameraRays
from pipeline.formats import ExportError
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
    mesh : GridMesh or None
        The regular mesh through them; None for a conventional camera, and before the conversion.
    pose : StatedPose or None
        Pose from another camera, for formats that state one; None for others, and before the conversion.
    rays : CameraRays
    built : BuiltCamera
        Everything else that the build says, in our conventions.
    """

    name: str
    size_px: tuple[int, int]
    pitch_mm: float
    pinhole: BuiltPinhole | None
    axis: np.ndarray
    micro_images: MicroImages | None = field(repr=False)
    rays: CameraRays = field(repr=False)
    built: BuiltCamera = field(repr=False)
    row_pinhole: BuiltPinhole | None = None
    mesh: GridMesh | None = None
    pose: StatedPose | None = None

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
