"""Records of a dataset: all that the rest of the pipeline knows of a stage."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, Generic, TypeVar

import numpy as np

from pipeline.camera.focusing.depth_of_field import focused
from pipeline.camera.focusing.focus_request import FocusRequest, group_shift
from pipeline.camera.parts.camera import Camera, Sampling
from pipeline.camera.parts.spectrum import Channel
from pipeline.channel_names import name_with
from pipeline.formats import EXACT
from pipeline.motion import Motion, Shutter
from pipeline.optics.prescription import Prescription
from pipeline.optics.windows import Windows
from pipeline.render.sensor.colours import Colorimetry
from pipeline.render.sensor.response import Irradiation, SensorResponse
from pipeline.render.spectral.prints import Print
from pipeline.targets.mesh import Occluder
from pipeline.targets.target import AnyTarget, Coat
from pipeline.truth.settings import TruthSettings

Matrix = tuple[tuple[float, ...], ...]
"""A 4 x 4 transform as rows of a matrix that acts on column vectors, lengths in mm; rigid unless stated otherwise."""


R = TypeVar("R")
S = TypeVar("S")


@dataclass(frozen=True, slots=True, kw_only=True)
class VariedNumber(Generic[R]):
    """A number of the stage, and what was read with it less a step and plus the step.

    `name`: path of its property, with [i] if that holds several; of a pose, path of the prim and the way it moves.
    """

    name: str
    unit: str
    step: float
    less: R
    more: R

    def mapped(self, function: Callable[[R], S]) -> "VariedNumber[S]":
        """The number with a part, or another form, of both records."""
        less, more = function(self.less), function(self.more)
        return VariedNumber(name=self.name, unit=self.unit, step=self.step, less=less, more=more)


@dataclass(frozen=True, slots=True, kw_only=True)
class LensEntry:
    """A lens without a camera; fields as in `CameraEntry`. `stop_name` is the name of its stop's prim."""

    name: str
    lens_name: str
    index_source: str
    wavelength_nm: float
    prescription: Prescription
    stop_name: str


@dataclass(frozen=True, kw_only=True, repr=False)
class CameraEntry:
    """A camera of the dataset; one whose lens or sensor changes from frame to frame is one camera in each state."""

    #: Path of its prim below the dataset's root with "/" replaced by ".": it appears in every table; of several states
    #: with the first frame that has this one, see `channel_names`
    name: str
    prim_path: str  #: on the composed stage, for messages
    lens_name: str  #: the name that the lens states, or its prim name; for reports only
    index_source: str  #: `printed`, or `catalogue` with the media from the scene to the sensor
    wavelength_nm: Annotated[float, "plen:camera:wavelength"]
    weight: Annotated[str, "plen:camera:weight"]
    footprint: Annotated[str, "plen:truth:footprint"]
    asked: Camera | FocusRequest  #: statement of the stage: a camera, or a request for a focus, which `camera` fulfils
    sampling: Sampling
    truth: TruthSettings
    image_samples: Annotated[int, "plen:image:samples"]  #: rays per pixel of the image, or of the first pass over it
    #: Standard error of pixels until which passes follow, relative to the mean of the image; None: there is one pass
    image_noise: Annotated[float | None, "plen:image:noise"] = None
    bounces: Annotated[int, "plen:image:bounces"] = 2  #: reflections between surfaces in images of a lit dataset
    #: Of position images for method `image`: `tiles` around the points, or `full`
    extent: Annotated[str, "plen:truth:extent"] = "tiles"
    #: Whether rays.exr is delivered even if no method needs it
    delivers_rays: Annotated[bool, "plen:truth:rays"] = False
    blur_derivatives: Annotated[bool, "plen:truth:blurDerivatives"] = False  #: whether blur has derivatives, too
    #: Of further white images, in the order of the stage
    f_numbers: Annotated[tuple[float, ...], "plen:image:fNumbers"] = ()
    diffraction: Annotated[bool, "plen:image:diffraction"] = False  #: whether images show it
    labels: tuple[str, ...] = ()  #: of pixels, in the order of the schema
    channels: tuple[Channel, ...] = ()  #: in the order of the stage; none: its light has the one wavelength
    #: The channel that this entry is the camera in, see `in_channels`; `wavelength_nm` is then the mean one
    channel: Channel | None = None
    #: The channels red, green and blue beside the standard observer, in the light of the dataset and in daylight
    colorimetry: tuple[Colorimetry, ...] = ()
    response: SensorResponse | None = None  #: from photons to digital numbers; None where the stage states none
    irradiation: Irradiation | None = None  #: light of each frame; None: there are no raw images
    shutter: Shutter | None = None  #: when its lines are exposed; None: a frame is an instant
    windows: Windows | None = None  #: those that stand in the world before it; others are parts of the camera
    file: str | None = field(default=None, compare=False)  #: of its definition, for messages
    line: int | None = field(default=None, compare=False)  #: of its definition, for messages

    @cached_property
    def camera(self) -> Camera:
        """The focused camera, in the light of its channel if it has one, behind windows that stand in the world; the
        focus is solved at first use.
        """
        camera = focused(self.asked)
        camera = camera.in_light(self.channel) if self.channel else camera
        return camera.behind(self.windows, self.wavelength_nm) if self.windows else camera

    @cached_property
    def group_shift_mm(self) -> float | None:
        """Shift of its focus groups towards the sensor, solved at first use; None without focus groups."""
        asked = self.asked
        return group_shift(asked) if isinstance(asked, FocusRequest) and asked.focus_groups else None

    @property
    def in_channels(self) -> tuple["CameraEntry", ...]:
        """The camera once for each of its channels; a camera of one wavelength itself."""
        if not self.channels:
            return (self,)
        return tuple(
            replace(self, channel=channel, wavelength_nm=channel.middle.wavelength_nm) for channel in self.channels
        )

    @property
    def full_name(self) -> str:
        """Name with that of the channel, for tasks and certificates."""
        return name_with(self.name, None if self.channel is None else self.channel.name)

    @property
    def folder(self) -> str:
        """Folder of the camera, or of its channel, below that of all cameras or of a frame."""
        return self.name if self.channel is None else f"{self.name}/{self.channel.name}"

    @property
    def parts_file(self) -> str:
        """Layer in the output folder with lens elements and rays, for viewers."""
        return f"cameras/{self.name}/parts.usda"

    def __repr__(self) -> str:
        sensor = self.asked.sensor
        kind = "plenoptic" if self.asked.microlenses else "conventional"
        size = f"{sensor.width_px} x {sensor.height_px} px of {sensor.pitch_mm * 1e3:g} µm"
        return f"<{kind} camera {self.name}: {self.lens_name}, {size}>"

    @property
    def square_px(self) -> float:
        """Edge of the square around a position where the rays of J start [px]: of the fine pixel, or 0 for a point."""
        return 1.0 / self.sampling.supersampling if self.footprint == "pixel" else 0.0


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class TargetEntry:
    """A calibration target, named like its prim; `printed`: spectra of ink and paper, `coat`: what lies on both."""

    name: str
    prim_path: str
    target: AnyTarget
    coat: Coat | None = None
    printed: Print = field(default_factory=Print)

    @property
    def picture_file(self) -> str:
        """Picture of its pattern in the output folder, for viewers."""
        return f"pictures/{self.name}.png"

    def __repr__(self) -> str:
        return f"<target {self.name}: {self.target.kind}, {len(self.target.points().kinds)} points>"


@dataclass(frozen=True, slots=True, kw_only=True)
class OccluderEntry:
    """An occluder of the dataset; with lamps, any shape, with its `Finish` of the plug-in `scenes`."""

    prim_path: str
    occluder: Occluder
    finish: Any = None
    instance: str = ""  #: path of the outermost instance to which it belongs, if it does
    frame: int | None = None  #: the only frame in which it has this shape; None: it keeps its shape


@dataclass(frozen=True, slots=True, kw_only=True)
class LampEntry:
    """A lamp of the dataset: a `Lamp` of the plug-in `scenes`."""

    prim_path: str
    lamp: Any


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureEntry:
    """A picture on a surface or in the sky: its name is a digest of its content, and its colour space (`auto`, `raw` or
    `sRGB`); `encoded` holds the bytes of the file in base 64.
    """

    name: str
    suffix: str
    encoded: str
    space: str

    @property
    def file(self) -> str:
        """Its copy in the output folder, named by its content."""
        return f"pictures/{self.name.partition('-')[0]}{self.suffix}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Motions:
    """Motions before a camera while its shutter is open, in its vision frame: of targets by name, and of occluders and
    lamps by prim path; and its own in the world, world_from_vision. A thing that stands still has none.
    """

    targets: dict[str, Motion]
    things: dict[str, Motion]
    camera: Motion | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Poses at one integer time code: of its cameras (vision frame) and targets by name, of visible occluders (any
    affine transform of the frame of the mesh) and visible lamps by prim path; motions, by cameras with a shutter.
    """

    number: int
    camera_from_world: dict[str, Matrix]
    world_from_target: dict[str, Matrix]
    world_from_occluder: dict[str, Matrix] = field(default_factory=dict)
    world_from_lamp: dict[str, Matrix] = field(default_factory=dict)
    motions: dict[str, Motions] = field(default_factory=dict)

    def vision_from_target(self, camera: str, target: str) -> np.ndarray:
        """Pose of a target in a camera's vision frame, (4, 4) [mm]."""
        return np.array(self.camera_from_world[camera]) @ np.array(self.world_from_target[target])


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestedExports:
    """Names of formats that a stage asks for, in its order; the kind of position of a point (exact, chief, saddle or
    centroid); and fields of `exports.noise.Noise`.
    """

    formats: tuple[str, ...] = ()
    position: str = EXACT
    noise: dict[str, float | int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Dataset:
    """All facts of a stage that a build needs.

    `sources` has the paths of the properties, and of whole prims, from which values were read, by part:
    `cameras/Rig.Camera`, `targets/Board`, `occluders`, `lamps`, `exports`, `poses/cameras/Rig.Camera`,
    `poses/targets/Board`, `poses/occluders`, `poses/lamps`, `derivatives`, and `dataset` for the rest.
    """

    stage_name: str  #: name of the default prim, which identifies the dataset without a path of the machine
    seed: int  #: of all random numbers
    background: float  #: relative radiance where there is neither a target nor an occluder
    cameras: tuple[CameraEntry, ...]
    targets: tuple[TargetEntry, ...]
    frames: tuple[Frame, ...]
    occluders: tuple[OccluderEntry, ...] = ()
    lamps: tuple[LampEntry, ...] = ()  #: with any, everything is lit by them; without, targets glow
    pictures: tuple[PictureEntry, ...] = ()  #: that its prims name, whether lamps light it or not
    exports: RequestedExports = field(default_factory=RequestedExports)
    #: Of the stage, for layers that a build writes for viewers; lengths of all records are in mm
    meters_per_unit: float = 0.001
    up_axis: str = "Y"  #: of the stage, likewise
    sources: dict[str, tuple[str, ...]] = field(default_factory=dict, compare=False)
    #: Numbers by which rows have derivatives, by the prim path of the camera
    varied: dict[str, tuple[VariedNumber["Dataset"], ...]] = field(default_factory=dict)

    def frames_of(self, camera: CameraEntry) -> tuple[Frame, ...]:
        """The frames that a camera sees: those in which its lens and sensor are in that state."""
        return tuple(frame for frame in self.frames if camera.name in frame.camera_from_world)

    def occluders_in(self, frame: Frame) -> Iterator[OccluderEntry]:
        """The visible occluders of a frame, with their shapes there."""
        for entry in self.occluders:
            if entry.prim_path in frame.world_from_occluder and entry.frame in (None, frame.number):
                yield entry

    def __repr__(self) -> str:
        numbers = ", ".join(str(frame.number) for frame in self.frames[:3]) + (", …" if len(self.frames) > 3 else "")
        lines = [f"<dataset {self.stage_name}: {len(self.frames)} frames ({numbers}), seed {self.seed}"]
        lines += [f"  {entry!r}" for entry in (*self.cameras, *self.targets)]
        count = len({entry.prim_path for entry in self.occluders})
        return "\n".join(lines) + (f"\n  {count} occluders>" if count else ">")
