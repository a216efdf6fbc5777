"""The tasks of a camera in its frames: image, position images, truth, and the certificate of all frames."""

import re
from dataclasses import replace
from typing import cast

import numpy as np

from pipeline.camera.parts.spectrum import Slices, alone
from pipeline.engine.output.deliver import Source
from pipeline.engine.planning.graph import Task, TaskGraph
from pipeline.frames import apply
from pipeline.graph.adding import add, add_strips, add_tiles
from pipeline.graph.poses import Things, matrix, target_poses
from pipeline.graph.settled import camera_task
from pipeline.graph.tiles import image_bands, point_tiles, strips
from pipeline.motion import Shutter
from pipeline.records.plain import Shared, to_plain
from pipeline.scene.dataset import CameraEntry, Dataset, Frame, TargetEntry
from pipeline.tasks.params import cameras, frames
from pipeline.truth.planes import plane_name


def exposure_of(entry: CameraEntry) -> cameras.Exposure:
    """The rays of every image of a camera."""
    return cameras.Exposure(
        samples=entry.image_samples,
        seed=entry.sampling.seed,
        weight=entry.weight,
        wavelength_nm=entry.wavelength_nm,
        channel=channel_label(entry),
        diffraction=entry.diffraction,
    )


def channel_label(entry: CameraEntry) -> cameras.ChannelLabel | None:
    """The label of the channel of a camera, for images and tables."""
    if entry.channel is None:
        return None
    nodes = entry.channel.nodes
    return cameras.ChannelLabel(
        name=entry.channel.name,
        wavelengths_nm=tuple(node.wavelength_nm for node in nodes),
        shares=tuple(node.weight for node in nodes),
    )


def light_of(entry: CameraEntry) -> cameras.BundleLight:
    """The light of a camera's bundles."""
    return cameras.BundleLight(weight=entry.weight, footprint=entry.footprint, wavelength_nm=entry.wavelength_nm)


def lights_of(entry: CameraEntry) -> tuple[Slices, ...]:
    """The light of each wavelength of a camera's images."""
    return entry.channel.slices if entry.channel else (alone(entry.wavelength_nm),)


def frame_of(task: Task, field: str | None) -> int | None:
    """Number of the frame to which a task, or a field of its parameters, belongs; None if it belongs to all."""
    kind = task.product
    kinds = ("image", "labels", "truth", "derivatives", "positions", "colour_image", "expose")
    parts = task.name.split("/")
    if kind in kinds and len(parts) > 2 and parts[2].isdigit():  # white images belong to no frame
        return int(parts[2])
    match = re.match(r"params\.frames\[(\d+)\]", field or "")
    return int(task.params["frames"][int(match[1])]["number"]) if match else None


def shutter_in(entry: CameraEntry, frame: Frame, *, in_world: bool = False) -> Shutter | None:
    """The shutter of a camera before which, or with which `in_world`, something moves; else a frame is a still."""
    motions = frame.motions.get(entry.name)
    moves = motions and (motions.targets or motions.things or (in_world and motions.camera))
    return entry.shutter if moves else None


class FrameTasks:
    """Maker of the tasks of one camera, frame by frame; tasks common to all frames are made once.

    `files` receives the source of each file in the output folder; `painted` and `bare` are all targets and
    occluders of the dataset, with and without colours.
    """

    def __init__(
        self,
        graph: TaskGraph,
        files: dict[str, Source],
        dataset: Dataset,
        entry: CameraEntry,
        painted: Things,
        bare: Things,
    ) -> None:
        self.graph, self.files, self.dataset, self.entry = graph, files, dataset, entry
        self.painted, self.bare = painted, bare
        # Instants are those of images alone.
        self._lines = entry.shutter and replace(entry.shutter, instants=1)
        self._table = frames.TruthTable(
            frame=0,
            camera=entry.name,
            settings=entry.truth.effective,
            light=light_of(entry),
            index_source=entry.index_source,
            seed=entry.sampling.seed,
            samples=entry.sampling.samples if entry.truth.searches else None,
            channel=channel_label(entry),
            shutter=self._lines,
        )
        self._exposure, self._bands = exposure_of(entry), image_bands(entry.asked.sensor, entry.image_samples)
        self._colours = tuple(target.printed.colours(target.target, lights_of(entry)) for target in dataset.targets)
        self._reads = {"camera": camera_task(graph, entry)}
        sizes = {target.name: len(target.target.points().kinds) for target in dataset.targets}
        self._points = point_tiles(sizes, is_plenoptic=entry.asked.microlenses is not None)
        self._judged: list[frames.JudgedFrame] = []

    def add(self, frame: Frame) -> None:
        """Add the tasks of a frame."""
        name, folder = f"{self.entry.full_name}/{frame.number:04d}", f"frames/{frame.number:04d}/{self.entry.folder}"
        poses = target_poses(self.dataset, frame, self.entry.name)
        image = self._add_image(name, self._painted(frame), shutter_in(self.entry, frame))
        truth = self._add_truth(name, folder, frame, poses)
        self.files[f"{folder}/image.exr"] = (image, "image.exr")
        self.files[f"{folder}/image.png"] = (image, "image.png")
        self.files[f"{folder}/correspondences.csv"] = (truth, "correspondences.csv")

    def add_certificate(self) -> str:
        """Add the task that judges all frames added so far; returns its name."""
        params = frames.Certificate(
            frames=tuple(self._judged),
            claim_px=self.entry.truth.claim_px,
            square_px=self.entry.square_px,
            seed=self.entry.sampling.seed,
            shutter=self._lines,
        )
        truths = {
            f"frame{n}": f"truth/{self.entry.full_name}/{n:04d}" for n in (frame.number for frame in self._judged)
        }
        return add(self.graph, f"certificate/{self.entry.full_name}", params, {**self._reads, **truths})

    def _add_image(self, name: str, view: frames.PaintedView, shutter: Shutter | None) -> str:
        if self.entry.image_noise is not None:
            return self._add_image_in_strips(name, view, shutter, self.entry.image_noise)
        camera, exposure = self.entry.full_name, self._exposure
        parts = [self.painted.IMAGE(exposure=exposure, view=view, rows=rows, shutter=shutter) for rows in self._bands]
        # The rays that leave the camera are the same in every frame: frames share them.
        together, reads = f"image/{camera}", {**self._reads, **self.painted.reads}
        of_tiles = {**reads, "white": f"white_tile/{camera}/"}
        tiles = add_tiles(self.graph, f"image_tile/{name}", parts, of_tiles, together)
        still = {"view": None} if tiles else {"view": view, "shutter": shutter}
        params = self.painted.IMAGE(exposure=exposure, tiles=len(tiles), **still)
        reads = {**self._reads, **tiles} if tiles else {**reads, "white": f"white/{camera}"}
        return add(self.graph, f"image/{name}", params, reads, None if tiles else together)

    def _add_image_in_strips(self, name: str, view: frames.PaintedView, shutter: Shutter | None, noise: float) -> str:
        exposure, camera, bands = self._exposure, self.entry.full_name, strips(self.entry.asked.sensor)
        parts = [self.painted.IMAGE(exposure=exposure, view=view, rows=rows, shutter=shutter) for rows in bands]
        reads = {**self._reads, "white": f"white_first/{camera}/", **self.painted.reads}
        of_strips = add_strips(self.graph, f"image/{name}", parts, reads, noise)
        whites = {f"white{strip}": f"white_strip/{camera}/{strip:04d}" for strip in range(len(parts))}
        params = self.painted.IMAGE(exposure=exposure, tiles=len(parts), view=None, noise=noise)
        return add(self.graph, f"image/{name}", params, {**self._reads, **whites, **of_strips})

    def _painted(self, frame: Frame) -> frames.PaintedView:
        view = self.painted.view(frame, self.entry, self._colours)
        return cast(frames.PaintedView, Shared(to_plain(view)))  # of many tiles

    def _add_truth(self, name: str, folder: str, frame: Frame, poses: dict[str, np.ndarray]) -> str:
        motions = frame.motions.get(self.entry.name)
        targets = self.bare.targets(poses, motions)
        self._judged.append(frames.JudgedFrame(number=frame.number, targets=targets))
        # Only the saddle of a blurred corner depends on colours.
        if "saddle" in self.entry.truth.column_sets:
            targets = self.painted.targets(poses, motions)
        view = frames.PlacedView(targets=targets, occluders=self.bare.occluders(frame, self.entry.name))
        table = replace(self._table, frame=frame.number)
        reads = dict(self._reads)
        if self.entry.truth.searches:
            reads["rays"] = rays = f"rays/{self.entry.full_name}"
            reads |= {role: tile for role, tile in self.graph[rays].reads.items() if role.startswith("tile")}
            if self.entry.asked.microlenses:
                reads["micro_images"] = f"micro_images/{self.entry.full_name}"
        if self.entry.truth.method == "image":
            reads["positions"] = self._add_positions(name, folder, poses)
        square_px = self.entry.square_px
        parts = [
            frames.Truth(table=table, view=view, square_px=square_px, points=points)
            for points in self._points
            if not self.entry.truth.searches  # a search in position images is a single task
        ]
        tiles = add_tiles(self.graph, f"truth_tile/{name}", parts, reads)
        params = frames.Truth(table=table, tiles=len(tiles), view=None if tiles else view, square_px=square_px)
        return add(self.graph, f"truth/{name}", params, {**reads, **tiles})

    def _add_positions(self, name: str, folder: str, poses: dict[str, np.ndarray]) -> str:
        entry = self.entry
        planes = [plane for target in self.dataset.targets for plane in _tangent_planes(target, poses[target.name])]
        params = frames.Positions(
            planes=tuple(planes),
            extent=entry.extent,
            sampling=entry.sampling,
            light=light_of(entry),
            square_px=entry.square_px,
        )
        positions = add(self.graph, f"positions/{name}", params, self._reads)
        self.files[f"{folder}/positions.exr"] = (positions, "positions.exr")
        return positions


def _tangent_planes(entry: TargetEntry, vision_from_target: np.ndarray) -> list[frames.PlaneAsked]:
    """Every tangent plane of a target, including those that face away."""
    points = entry.target.points()
    return [
        frames.PlaneAsked(
            name=plane_name(entry.name, number, len(points.frames)),
            vision_from_target=matrix(vision_from_target @ plane.target_from_plane),
            points_mm=apply(vision_from_target, points.position_mm[plane.members]).tolist(),
        )
        for number, plane in enumerate(points.planes())
    ]
