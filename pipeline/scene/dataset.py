"""A dataset as frozen records: what the rest of the pipeline knows of a stage."""

from dataclasses import dataclass, field
from functools import cached_property

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import FocusRequest
from pipeline.camera.parts.camera import Camera, Sampling
from pipeline.optics.prescription import Prescription
from pipeline.render.sensor.irradiation import Irradiation
from pipeline.render.sensor.response import SensorResponse
from pipeline.targets.occluder import Occluder
from pipeline.targets.target import AnyTarget

Matrix = tuple[tuple[float, ...], ...]
"""A 4 x 4 transform, rigid unless said otherwise, rows of a matrix that acts on column vectors, lengths in mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LensEntry:
    """A lens alone; the fields mean what they mean in `CameraEntry`."""

    name: str
    lens_name: str
    index_source: str
    wavelength_nm: float
    prescription: Prescription


@dataclass(frozen=True, kw_only=True, repr=False)
class CameraEntry:
    """A camera of the dataset.

    Attributes
    ----------
    name : str
        Path of the camera prim below the dataset's root with "/" replaced by ".": it stands in every table.
    prim_path : str
        Of the camera on the composed stage, for messages.
    file, line : str or None, int or None
        Where it is written, for messages.
    lens_name : str
        `plen:name` of the lens, or its prim name; for reports only.
    index_source : str
        Where the refractive indices come from: `printed`, or `catalogue` with the media from the scene to the sensor.
    asked : Camera or FocusRequest
        What the stage says: a camera, or what it shall have in focus; `camera` is the one that does it.
    truth : dict
        Fields of `truth.TruthSettings` (a dict, because scene and truth are strangers).
    image_samples : int
        Rays per pixel of the image.
    extent : str
        Of position images by method `image`: `tiles` around the points, or `full`.
    delivers_rays : bool
        Whether rays.exr is wanted, also where no method needs it.
    f_numbers : tuple of float
        Of further white images, in the order of the stage.
    response : SensorResponse or None
        How the sensor turns photons into digital numbers, where it says so.
    irradiation : Irradiation or None
        Light of each frame; None: there are no raw images.
    """

    name: str
    prim_path: str
    lens_name: str
    index_source: str
    wavelength_nm: float
    weight: str
    footprint: str
    asked: Camera | FocusRequest
    sampling: Sampling
    truth: dict[str, str | float | None]
    image_samples: int
    extent: str = "tiles"
    delivers_rays: bool = False
    f_numbers: tuple[float, ...] = ()
    response: SensorResponse | None = None
    irradiation: Irradiation | None = None
    file: str | None = field(default=None, compare=False)
    line: int | None = field(default=None, compare=False)

    @cached_property
    def camera(self) -> Camera:
        """The camera, focused and ready to trace; solved when it is first asked for."""
        return focused(self.asked)

    def __repr__(self) -> str:
        sensor, kind = self.asked.sensor, "plenoptic" if self.asked.microlenses else "conventional"
        size = f"{sensor.width_px} x {sensor.height_px} px of {sensor.pitch_mm * 1e3:g} µm"
        return f"<{kind} camera {self.name}: {self.lens_name}, {size}>"

    @property
    def square_px(self) -> float:
        """Edge of the square around a position that the rays of J start on: the fine pixel's, or 0 for its centre."""
        return 1.0 / self.sampling.supersampling if self.footprint == "pixel" else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TargetEntry:
    """A calibration target of the dataset; `name` is its prim's name."""

    name: str
    prim_path: str
    target: AnyTarget

    def __repr__(self) -> str:
        return f"<target {self.name}: {self.target.kind}, {len(self.target.points().kinds)} points>"


@dataclass(frozen=True, slots=True, kw_only=True)
class OccluderEntry:
    """An occluder of the dataset."""

    prim_path: str
    occluder: Occluder


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Poses at one integer time code.

    Attributes
    ----------
    camera_from_world : dict
        Per camera name, vision frame.
    world_from_target : dict
        Per target name, target frame.
    world_from_occluder : dict
        Per path of an occluder's prim that is visible, the mesh's own frame; any affine transform.
    """

    number: int
    camera_from_world: dict[str, Matrix]
    world_from_target: dict[str, Matrix]
    world_from_occluder: dict[str, Matrix] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Dataset:
    """All that a build needs to know of a stage.

    Attributes
    ----------
    stage_name : str
        Name of the default prim: it tells datasets apart without a path of the machine.
    seed : int
        Of all random numbers.
    background : float
        Radiance where neither a target nor an occluder is, relative.
    """

    stage_name: str
    seed: int
    background: float
    cameras: tuple[CameraEntry, ...]
    targets: tuple[TargetEntry, ...]
    frames: tuple[Frame, ...]
    occluders: tuple[OccluderEntry, ...] = ()

    def __repr__(self) -> str:
        numbers = ", ".join(str(frame.number) for frame in self.frames[:3]) + (", …" if len(self.frames) > 3 else "")
        lines = [f"<dataset {self.stage_name}: {len(self.frames)} frames ({numbers}), seed {self.seed}"]
        lines += [f"  {entry!r}" for entry in (*self.cameras, *self.targets)]
        return "\n".join(lines) + (f"\n  {len(self.occluders)} occluders>" if self.occluders else ">")
