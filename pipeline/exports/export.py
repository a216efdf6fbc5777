"""A build into the files of other programs: one folder per format, each with a side-car export.json."""

import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.exports.conversion import write_format
from pipeline.exports.gathering import POSITIONS, chosen, gather
from pipeline.exports.material import Material
from pipeline.exports.noise import Noise, with_noise
from pipeline.formats import EXACT, SIDE_CAR, Cameras, ExportError, Format, folder_of, format_of, loadable
from pipeline.results.answers import SeenScene
from pipeline.results.output import Output
from pipeline.spelling import did_you_mean

if TYPE_CHECKING:
    from pipeline.results.ready_camera import ReadyCamera


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A choice of what is exported.

    `only`: names of cameras and targets; all cameras where it names none, likewise targets.
    `position`: kind of position of a point: a key of `POSITIONS`.
    """

    only: tuple[str, ...] = ()
    position: str = EXACT
    noise: Noise = field(default_factory=Noise)
    replace: bool = False  # folders of ours that are there

    def __post_init__(self) -> None:
        if self.position not in POSITIONS:
            hint = did_you_mean(self.position, POSITIONS) or f"positions: {', '.join(POSITIONS)}"
            raise ExportError(f"there is no position {self.position!r}", hint=hint)


def sight_of(out: Path, name: str) -> "ReadyCamera":
    """A camera of the stage that was built, made ready."""
    from pipeline.results.opening import ready  # loads USD and the tracer, which few formats need

    return ready(out, name)


def scene_of(out: Path) -> SeenScene:
    """Targets and other things before the cameras of a build."""
    from pipeline.results import opening  # as above

    return opening.scene_of(out)


def export(output: Output, formats: list[str], folder: Path, request: Request | None = None) -> list[Path]:
    """Write a build in several formats, each into a folder of its name, which are returned; all or nothing of a format.

    `formats`: names, as `opencv`, or with a position other than that of the request, as `opencv:saddle`.
    Raises ExportError: a format is unknown, or cannot hold this build, or its folder is there and not to be replaced.
    """
    requests = _requests(formats, folder, request or Request())
    materials = _materials(output, {request for _, request in requests.values()})
    for destination, (name, request) in requests.items():
        _require_kind(name, format_of(name), materials[request])
        if destination.exists() and not (request.replace and (destination / SIDE_CAR).exists()):
            message = f"{destination} exists{', and is no export' if request.replace else ''}"
            hint = "remove it, replace an export with --replace, or choose another folder with -o"
            raise ExportError(message, hint=hint)
    for destination, (name, request) in requests.items():
        _write(name, materials[request], destination, request)
    return list(requests)


def write_export(output: Output, name: str, folder: Path, request: Request) -> None:
    """Write a build in one format into an empty folder; raises as `export`."""
    write_format(name, _materials(output, [request])[request], folder, request.position, request.noise)


def _materials(output: Output, requests: Iterable[Request]) -> dict[Request, Material]:
    """The material from which each request is written."""
    # They share cameras, but not with another call: the folder may have been built again
    sight = lru_cache(maxsize=4)(partial(sight_of, output.path))
    scene = lru_cache(maxsize=1)(partial(scene_of, output.path))
    return {
        request: with_noise(chosen(gather(output, sight, scene, request.position), request.only), request.noise)
        for request in requests
    }


def _requests(formats: list[str], folder: Path, request: Request) -> dict[Path, tuple[str, Request]]:
    """Folder of each format -> its name and request: `opencv:saddle` requests positions of saddles."""
    requests = {}
    for item in formats:
        name, _, position = item.partition(":")
        format_of(name)  # an unknown one is refused at once
        own_request = replace(request, position=position) if position else request
        requests[folder / folder_of(name, own_request.position)] = name, own_request
    return requests


def _write(name: str, material: Material, destination: Path, request: Request) -> None:
    """Write a format aside, then move it to its destination."""
    destination.parent.mkdir(parents=True, exist_ok=True)
    aside = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=destination.parent))
    try:
        aside.chmod(0o755)
        write_format(name, material, aside, request.position, request.noise)
        if destination.exists():  # it is to be replaced
            shutil.rmtree(destination)
        aside.rename(destination)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _require_kind(name: str, export_format: Format, material: Material) -> None:
    """Refuse cameras that a format does not know."""
    unsuitable = [camera for camera in material.cameras if not export_format.takes(camera.built.is_plenoptic)]
    if unsuitable:
        suitable = [other for other, record in loadable().items() if record.takes(unsuitable[0].built.is_plenoptic)]
        camera = unsuitable[0].name
        expected = f"one position per point, and {camera} is plenoptic"
        if export_format.cameras is Cameras.PLENOPTIC:
            expected = f"a microlens array, and {camera} has none"
        hint = f"formats for it: {', '.join(suitable)}"
        if len(unsuitable) < len(material.cameras):
            hint += "; or choose cameras with --only"
        raise ExportError(f"{name} expects {expected}", hint=hint)
