"""The tasks of a camera in its frames: image, position images, truth, and the certificate of all frames."""

import re
from typing import Any

import numpy as np

from pipeline.engine.deliver import Source
from pipeline.engine.digest import Shared
from pipeline.engine.graph import Task, TaskGraph
from pipeline.frames import apply
from pipeline.records import from_plain, to_plain
from pipeline.scene.dataset import CameraEntry, Dataset, Frame, TargetEntry
from pipeline.tasks.frame_poses import name_of
from pipeline.tasks.poses import target_poses
from pipeline.tasks.things import Things, matrix
from pipeline.tasks.tiles import Bands, image_bands, point_tiles
from pipeline.truth.on_points import plane_name
from pipeline.truth.settings import OF_SEARCH, TruthSettings

KIND = "pipeline.tasks."


def image_params(entry: CameraEntry) -> dict[str, Any]:
    """Params that every image of a camera reads."""
    return {
        "samples": entry.image_samples,
        "seed": entry.sampling.seed,
        "weight": entry.weight,
        "wavelength_nm": entry.wavelength_nm,
    }


def add_tiles(
    graph: TaskGraph,
    name: str,
    params: dict[str, Any],
    reads: dict[str, str],
    rows: Bands,
    together: str | None = None,
) -> dict[str, str]:
    """Tasks of tiles, each with its rows in the params; role and name of each. One tile alone is no task.

    Tiles with the same rows share work with those of other calls that say the same `together`. A name in `reads` that
    ends with a slash stands for tiles: each reads the one of its own rows.
    """
    kind = f"{KIND}{name.partition('/')[0]}"
    return {
        f"tile{number}": graph.add(
            f"{name}/{number:04d}",
            kind,
            {**params, "rows": list(some)},
            {role: f"{source}{number:04d}" if source.endswith("/") else source for role, source in reads.items()},
            f"{together}/{number}" if together else None,
        )
        for number, some in enumerate(rows if len(rows) > 1 else [])
    }


def frame_of(task: Task, field: str | None) -> int | None:
    """Number of the frame that a task, or a field of its parameters, belongs to; None if to all."""
    if task.short_kind.removesuffix("_tile") in ("image", "truth", "positions"):
        return int(task.name.split("/")[2])
    match = re.match(r"params\.frames\[(\d+)\]", field or "")
    return int(task.params["frames"][int(match[1])]["number"]) if match else None


class FrameTasks:
    """Adds the tasks of one camera to a graph, frame by frame; what all frames have in common is made once.

    Parameters
    ----------
    files : dict
        Gets what of the outputs lies where in the output folder.
    painted, bare : Things
        All targets and occluders of the dataset, with and without colours.
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
        self.settings = from_plain(TruthSettings, entry.truth)
        self._image = {**image_params(entry), "background": dataset.background}
        self._truth = _truth_params(entry, self.settings)
        self._reads = {"camera": f"focus/{entry.name}"}
        sizes = {target.name: len(target.target.points().kinds) for target in dataset.targets}
        self._points = point_tiles(sizes, is_plenoptic=entry.asked.microlenses is not None)
        self._judged: list[dict[str, Any]] = []
        self._posed: list[dict[str, Any]] = []

    def add(self, frame: Frame) -> None:
        """Add the tasks of a frame."""
        name, folder = f"{self.entry.name}/{frame.number:04d}", f"frames/{frame.number:04d}/{self.entry.name}"
        poses = target_poses(self.dataset, frame, self.entry.name)
        targets = {target: matrix(pose) for target, pose in poses.items()}
        camera_from_world = frame.camera_from_world[self.entry.name]
        self._posed.append({"number": frame.number, "camera_from_world": camera_from_world, "targets": targets})
        image = self._add_image(name, self._image_params(frame, poses))
        truth = self._add_truth(name, folder, frame, poses)
        self.files[f"{folder}/image.exr"] = (image, "image.exr")
        self.files[f"{folder}/image.png"] = (image, "image.png")
        self.files[f"{folder}/correspondences.csv"] = (truth, "correspondences.csv")

    def add_poses(self) -> None:
        """Add the task that writes the poses of all frames added so far."""
        name = self.entry.name
        params = {"camera": name, "frames": to_plain(self._posed)}
        task = self.graph.add(f"frame_poses/{name}", f"{KIND}frame_poses", params, {"pinhole": f"pinhole/{name}"})
        for number in (frame["number"] for frame in self._posed):
            self.files[f"frames/{number:04d}/{name}/poses.json"] = (task, name_of(number))

    def add_certificate(self) -> str:
        """Add the task that judges all frames added so far; gives its name."""
        params: dict[str, Any] = {"claim_px": self.settings.claim_px, "square_px": self.entry.square_px}
        params |= {"frames": self._judged, "seed": self.entry.sampling.seed}
        truths = {f"frame{n}": f"truth/{self.entry.name}/{n:04d}" for n in (frame["number"] for frame in self._judged)}
        return self.graph.add(f"certificate/{self.entry.name}", f"{KIND}certificate", params, {**self._reads, **truths})

    def _add_image(self, name: str, params: dict[str, Any]) -> str:
        rows = image_bands(self.entry.asked.sensor, self.entry.image_samples)
        together: str | None = f"image/{self.entry.name}"  # what leaves the camera is the same in every frame
        white = {"white": f"white_tile/{self.entry.name}/"}
        tiles = add_tiles(self.graph, f"image_tile/{name}", params, {**self._reads, **white}, rows, together)
        if tiles:
            params, together = {key: params[key] for key in image_params(self.entry)}, None
        params, reads = {**params, "tiles": len(tiles)}, tiles or {"white": f"white/{self.entry.name}"}
        return self.graph.add(f"image/{name}", f"{KIND}image", params, {**self._reads, **reads}, together)

    def _image_params(self, frame: Frame, poses: dict[str, np.ndarray]) -> dict[str, Any]:
        targets = self.painted.targets(poses)
        for target in targets:
            del target["name"]  # an image does not know it
        return {**self._image, "targets": targets, "occluders": self.painted.occluders(frame, self.entry.name)}

    def _add_truth(self, name: str, folder: str, frame: Frame, poses: dict[str, np.ndarray]) -> str:
        targets = self.bare.targets(poses)
        self._judged.append({"number": frame.number, "targets": targets})
        # The saddle of a corner that is not sharp is the only position that a colour moves.
        if "saddle" in self.settings.column_sets:
            targets = self.painted.targets(poses)
        occluders = self.bare.occluders(frame, self.entry.name)
        params = {**self._truth, "frame": frame.number, "targets": targets, "occluders": occluders}
        reads = dict(self._reads)
        if self.settings.searches:
            reads["rays"] = f"rays/{self.entry.name}"
            if self.entry.asked.microlenses:
                reads["micro_images"] = f"micro_images/{self.entry.name}"
        if self.settings.method == "image":
            reads["positions"] = self._add_positions(name, folder, poses)
        tiles = self._add_truth_tiles(name, params, reads)
        if tiles:
            params = {key: params[key] for key in ("frame", "camera", "truth", "labels")}
        params = {**params, "tiles": len(tiles)}
        return self.graph.add(f"truth/{name}", f"{KIND}truth", params, {**reads, **tiles})

    def _add_truth_tiles(self, name: str, params: dict[str, Any], reads: dict[str, str]) -> dict[str, str]:
        """Tasks that solve some points each; role and name of each. Searches in position images are one task."""
        some = self._points if not self.settings.searches else []
        return {
            f"tile{number}": self.graph.add(
                f"truth_tile/{name}/{number:04d}", f"{KIND}truth_tile", {**params, "points": points}, reads
            )
            for number, points in enumerate(some if len(some) > 1 else [])
        }

    def _add_positions(self, name: str, folder: str, poses: dict[str, np.ndarray]) -> str:
        entry = self.entry
        planes = [plane for target in self.dataset.targets for plane in _tangent_planes(target, poses[target.name])]
        light = {"weight": entry.weight, "footprint": entry.footprint, "wavelength_nm": entry.wavelength_nm}
        light["square_px"] = entry.square_px
        params = {"planes": planes, "extent": entry.extent, **to_plain(entry.sampling), **light}
        positions = self.graph.add(f"positions/{name}", f"{KIND}positions", params, self._reads)
        self.files[f"{folder}/positions.exr"] = (positions, "positions.exr")
        return positions


def _truth_params(entry: CameraEntry, settings: TruthSettings) -> dict[str, Any]:
    """Params that `truth` reads in every frame; without position images none of their search."""
    labels = {
        "weight": entry.weight,
        "wavelength_nm": entry.wavelength_nm,
        "index_source": entry.index_source,
        "footprint": entry.footprint,
        "stop": entry.camera.prescription.stop.aperture,
        "seed": entry.sampling.seed,
    }
    truth = to_plain(entry.truth)
    if settings.searches:
        labels["samples"] = entry.sampling.samples
    else:
        truth = {name: value for name, value in truth.items() if name not in OF_SEARCH}
    return {"camera": entry.name, "truth": Shared(truth), "square_px": entry.square_px, "labels": Shared(labels)}


def _tangent_planes(entry: TargetEntry, vision_from_target: np.ndarray) -> list[dict[str, Any]]:
    """Name, pose and points (vision frame) of every tangent plane of a target; those that face away are named alike."""
    points = entry.target.points()
    return [
        {
            "name": plane_name(entry.name, number, len(points.frames)),
            "vision_from_target": matrix(vision_from_target @ plane.target_from_plane),
            "points_mm": apply(vision_from_target, points.position_mm[plane.members]).tolist(),
        }
        for number, plane in enumerate(points.planes())
    ]
