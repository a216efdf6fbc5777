"""A graph of a dataset while it is drafted: what the plans of products add tasks to, and what they share."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from pipeline.camera.focusing.focus_request import f_number_in_name, stopped_down
from pipeline.camera.parts.camera import Camera
from pipeline.camera.parts.spectrum import Slices, alone
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.motion import Shutter
from pipeline.optics.windows import MARK
from pipeline.products.light import BundleLight, ChannelLabel, Exposure
from pipeline.products.things import Things
from pipeline.records.plain import to_plain
from pipeline.scene.dataset import CameraEntry, Dataset, Frame
from pipeline.scene.usd.problems import blamed_on

_CAMERA = "pipeline.products.camera.make:camera"
"""Kind of the tasks that hand on a camera; their parameter is the camera itself."""


class Draft(NamedTuple):
    """All tasks of a dataset so far, the sources of the files in the output folder, and the certificate of each camera.

    `painted` and `bare` are all targets and occluders of the dataset, with and without colours.
    """

    graph: TaskGraph
    files: dict[str, Source]
    certificates: dict[str, tuple[str, str]]
    dataset: Dataset
    painted: Things
    bare: Things

    @property
    def entries(self) -> Iterator[CameraEntry]:
        """Each camera, or each of its channels."""
        return (entry for camera in self.dataset.cameras for entry in camera.in_channels)

    @property
    def frames(self) -> Iterator[tuple[CameraEntry, Frame]]:
        """Each camera, or each of its channels, in each of its frames."""
        return ((entry, frame) for entry in self.entries for frame in self.dataset.frames_of(entry))

    def add(
        self,
        name: str,
        params: Any,
        reads: Mapping[str, str] | None = None,
        together: str | None = None,
        *,
        after_delivery: bool = False,
    ) -> str:
        """Add a task and return its name, which begins with that of the function that does its work.

        This is in the module of its params, or where that is called `params`, in the module `make` beside it, unless
        the params name its home as `MODULE`.
        """
        module = type(params).__module__
        home = getattr(params, "MODULE", None) or re.sub(r"\.params$", ".make", module)
        task = Task(
            name=name,
            kind=f"{home}:{name.partition('/')[0]}",
            params=to_plain(params),
            reads=dict(reads or {}),
            together=together,
            after_delivery=after_delivery,
            record=type(params),
        )
        return self.graph.put(task)

    def add_tiles(
        self,
        name: str,
        params: Sequence[Any],
        reads: Mapping[str, str],
        together: str | None = None,
        *,
        least: int = 2,
    ) -> dict[str, str]:
        """Add tile tasks, one for each of the params; role and name of each. Fewer than `least` tiles need no tasks.

        Tiles with the same number share work with those of other calls with the same `together`. A name in `reads` that
        ends with a slash stands for tiles: each tile reads the one with its own number.
        """
        return {
            f"tile{number}": self.add(
                f"{name}/{number:04d}",
                tile,
                {role: f"{source}{number:04d}" if source.endswith("/") else source for role, source in reads.items()},
                f"{together}/{number}" if together else None,
            )
            for number, tile in enumerate(params if len(params) >= least else [])
        }

    def add_camera(self, name: str, camera: Camera) -> str:
        """Add a task that hands on a camera."""
        return self.graph.add(name, _CAMERA, to_plain(camera))

    def camera(
        self, entry: CameraEntry, *, is_alone: bool = False, has_planes: bool = False, f_number: float | None = None
    ) -> str:
        """Name of the task that hands on the camera of an entry; the first call adds it.

        The camera is in the light of the entry's channel, if it has one.

        `is_alone`: leave out the windows that stand in the world before the camera.
        `has_planes`: keep its planes of J_near and J_far, which tasks that do not need them should not depend on.
        `f_number`: set its stop to that; not together with `has_planes`, because the name would not tell.
        """
        # `entry.camera` is composed when it is asked for, with the windows that the entry has then.
        entry = replace(entry, windows=None) if is_alone and entry.windows else entry
        # The name tells the variants apart: behind windows, with planes, or at an F-number.
        variant = "planes" if has_planes else "" if f_number is None else f_number_in_name(f_number)
        name = "/".join(filter(None, ["camera", entry.full_name, "windows" * bool(entry.windows), variant]))
        if name in self.graph:
            return name
        # Compose the camera; what is wrong with it is reported at its prim.
        with blamed_on(entry.file, entry.line, entry.prim_path):
            camera = settled(entry)
            if has_planes:
                camera = replace(camera, near_mm=entry.camera.near_mm, far_mm=entry.camera.far_mm)
            if f_number is not None:
                camera = stopped_down(camera, f_number)
        return self.add_camera(name, camera)

    def stops(self, entry: CameraEntry) -> "Iterator[Stop]":
        """All stops at which white images of a camera are asked for."""
        folder = f"cameras/{entry.folder}"
        yield Stop(entry.full_name, self.camera(entry, is_alone=True), f"{folder}/white", f"{folder}/")
        for f_number in entry.f_numbers:
            text = f_number_in_name(f_number)
            camera = self.camera(entry, is_alone=True, f_number=f_number)
            yield Stop(f"{entry.full_name}/{text}", camera, f"{folder}/white/{text}", f"{folder}/white/{text}.")


class Stop(NamedTuple):
    """A camera with its stop as set, or at an F-number: name, the task of the camera, and how the names of the files of
    its white image, and of its tables of micro-images, begin.
    """

    name: str
    camera: str
    white: str
    tables: str


def settled(entry: CameraEntry) -> Camera:
    """The camera of an entry without what no ray depends on: names of lens groups, the circle of confusion, and planes
    of J_near and J_far.
    """
    camera = entry.camera
    lens = camera.prescription
    groups = tuple(
        group if group.name.startswith(MARK) else replace(group, name=str(number))
        for number, group in enumerate(lens.groups)
    )
    prescription = replace(lens, groups=groups) if groups else lens
    return replace(camera, prescription=prescription, near_mm=None, far_mm=None, circle_of_confusion_px=1.0)


def exposure_of(entry: CameraEntry) -> Exposure:
    """The rays of every image of a camera."""
    return Exposure(
        samples=entry.image_samples,
        seed=entry.sampling.seed,
        weight=entry.weight,
        wavelength_nm=entry.wavelength_nm,
        channel=channel_label(entry),
        diffraction=entry.diffraction,
    )


def channel_label(entry: CameraEntry) -> ChannelLabel | None:
    """The label of the channel of a camera, for images and tables."""
    if entry.channel is None:
        return None
    nodes = entry.channel.nodes
    return ChannelLabel(
        name=entry.channel.name,
        wavelengths_nm=tuple(node.wavelength_nm for node in nodes),
        shares=tuple(node.weight for node in nodes),
    )


def light_of(entry: CameraEntry) -> BundleLight:
    """The light of a camera's bundles."""
    return BundleLight(weight=entry.weight, footprint=entry.footprint, wavelength_nm=entry.wavelength_nm)


def lights_of(entry: CameraEntry) -> tuple[Slices, ...]:
    """The light of each wavelength of a camera's images."""
    return entry.channel.slices if entry.channel else (alone(entry.wavelength_nm),)


def shutter_in(entry: CameraEntry, frame: Frame, *, in_world: bool = False) -> Shutter | None:
    """The shutter of a camera before which, or with which `in_world`, something moves; else a frame is a still."""
    motions = frame.motions.get(entry.name)
    moves = motions and (motions.targets or motions.things or (in_world and motions.camera))
    return entry.shutter if moves else None
