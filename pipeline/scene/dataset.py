"""A dataset as frozen records: what the rest of the pipeline knows of a stage."""

from dataclasses import dataclass

from pipeline.camera.camera import Camera, Sampling
from pipeline.camera.request import FocusRequest
from pipeline.optics.prescription import Prescription
from pipeline.target.target import AnyTarget

Matrix = tuple[tuple[float, ...], ...]
"""A 4 x 4 rigid transform, rows of a matrix that acts on column vectors, lengths in mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LensEntry:
    """A lens alone; the fields mean what they mean in `CameraEntry`."""

    name: str
    lens_name: str
    index_source: str
    wavelength_nm: float
    prescription: Prescription


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraEntry:
    """A camera of the dataset.

    Attributes
    ----------
    name : str
        Path of the camera prim below the dataset's root with "/" replaced by ".": it stands in every table.
    prim_path : str
        Of the camera on the composed stage, for messages.
    lens_name : str
        `plen:name` of the lens, or its prim name; for reports only.
    index_source : str
        Where the refractive indices come from: `printed`, or `catalogue` with the media from the scene to the sensor.
    truth : dict
        Fields of `truth.TruthSettings` (a dict, because scene and truth are strangers).
    image_samples : int
        Rays per pixel of the image.
    extent : str
        Of position images by method `image`: `tiles` around the points, or `full`.
    """

    name: str
    prim_path: str
    lens_name: str
    index_source: str
    wavelength_nm: float
    weight: str
    footprint: str
    camera: Camera | FocusRequest
    sampling: Sampling
    truth: dict[str, str | float | None]
    image_samples: int
    extent: str = "tiles"

    @property
    def square_px(self) -> float:
        """Edge of the square around a position that the rays of J start on: the fine pixel's, or 0 for its centre."""
        return 1.0 / self.sampling.supersampling if self.footprint == "pixel" else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetEntry:
    """A calibration target of the dataset; `name` is its prim's name."""

    name: str
    prim_path: str
    target: AnyTarget


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Poses at one integer time code.

    Attributes
    ----------
    camera_from_world : dict
        Per camera name, vision frame.
    world_from_target : dict
        Per target name, target frame.
    """

    number: int
    camera_from_world: dict[str, Matrix]
    world_from_target: dict[str, Matrix]


@dataclass(frozen=True, slots=True, kw_only=True)
class Dataset:
    """All that a build needs to know of a stage.

    Attributes
    ----------
    stage_name : str
        Name of the default prim: it tells datasets apart without a path of the machine.
    seed : int
        Of all random numbers.
    background : float
        Radiance of everything that is not a target, relative.
    """

    stage_name: str
    seed: int
    background: float
    cameras: tuple[CameraEntry, ...]
    targets: tuple[TargetEntry, ...]
    frames: tuple[Frame, ...]
