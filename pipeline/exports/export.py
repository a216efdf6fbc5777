"""A build into the files of other programs: one folder per format, each with a side-car export.json."""

import shutil
import tempfile
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from pipeline.export_formats import EXACT, FORMATS, Cameras, Format, folder_of
from pipeline.exports.errors import ExportError
from pipeline.exports.gathering import POSITIONS, Around, chosen, gather
from pipeline.exports.material import Material, Scene
from pipeline.exports.noise import Noise, with_noise
from pipeline.exports.seen.stated_sight import Sight
from pipeline.exports.writing import write_format
from pipeline.results.output import Output
from pipeline.spelling import did_you_mean


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A choice of what is exported.

    Attributes
    ----------
    only : tuple of str
        Names of cameras and targets; all cameras where it names none, likewise targets.
    position : str
        Kind of position of a point: a key of `POSITIONS`.
    noise : Noise
    """

    only: tuple[str, ...] = ()
    position: str = EXACT
    noise: Noise = field(default_factory=Noise)

    def __post_init__(self) -> None:
        if self.position not in POSITIONS:
            hint = did_you_mean(self.position, POSITIONS) or f"positions: {', '.join(POSITIONS)}"
            raise ExportError(f"there is no position {self.position!r}", hint=hint)


@lru_cache(maxsize=4)
def sight_of(out: Path, name: str) -> Sight:
    """A camera of the stage that was built, made ready; the last four are kept, because formats share them."""
    from pipeline.results.opening import ready  # loads USD and the tracer, which few formats need

    return ready(out, name)


@lru_cache(maxsize=1)
def scene_of(out: Path) -> Scene:
    """Targets and other things before the cameras of a build."""
    from pipeline.results import opening  # as above

    return opening.scene_of(out)


def format_of(name: str) -> Format:
    """The format of a name.

    Raises
    ------
    ExportError
        There is none.
    """
    if name not in FORMATS:
        hint = did_you_mean(name, FORMATS) or f"formats: {', '.join(FORMATS)}"
        raise ExportError(f"there is no export format {name!r}", hint=hint)
    return FORMATS[name]


def export(output: Output, formats: list[str], folder: Path, request: Request | None = None) -> list[Path]:
    """Write a build in several formats, each into a folder of its name; all or nothing of a format.

    Parameters
    ----------
    formats : list of str
        Names, as `opencv`, or with a position other than that of the request, as `opencv:saddle`.

    Returns
    -------
    list of Path
        The folders.

    Raises
    ------
    ExportError
        A format is unknown, or cannot hold this build, or its folder is there.
    """
    asked = _asked(formats, folder, request or Request())
    around = Around(sight=lambda name: sight_of(output.path, name), scene=lambda: scene_of(output.path))
    materials = {
        one: with_noise(chosen(gather(output, one.position, around), one.only), one.noise) for _, one in asked.values()
    }
    for place, (name, one) in asked.items():
        _require_kind(name, format_of(name), materials[one])
        if place.exists():
            raise ExportError(f"{place} exists", hint="remove it, or choose another folder with -o")
    for place, (name, one) in asked.items():
        _write(name, materials[one], place, one)
    return list(asked)


def _asked(formats: list[str], folder: Path, request: Request) -> dict[Path, tuple[str, Request]]:
    """Folder of each format, its name and what it takes: `opencv:saddle` means positions of saddles."""
    found = {}
    for item in formats:
        name, _, position = item.partition(":")
        format_of(name)
        one = replace(request, position=position) if position else request
        found[folder / folder_of(name, one.position)] = name, one
    return found


def _write(name: str, material: Material, place: Path, request: Request) -> None:
    """Write a format aside, then put it into its place."""
    place.parent.mkdir(parents=True, exist_ok=True)
    aside = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=place.parent))
    try:
        aside.chmod(0o755)
        write_format(name, material, aside, request.position, request.noise)
        aside.rename(place)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _require_kind(name: str, wanted: Format, material: Material) -> None:
    """Refuse cameras that a format does not know."""
    odd = [camera for camera in material.cameras if not wanted.takes(camera.built.is_plenoptic)]
    if odd:
        others = [other for other, one in FORMATS.items() if one.takes(odd[0].built.is_plenoptic)]
        is_array = wanted.cameras is Cameras.PLENOPTIC
        what = "a microlens array, and {} has none" if is_array else "one position per point, and {} is plenoptic"
        hint = f"formats for it: {', '.join(others)}"
        if len(odd) < len(material.cameras):
            hint += "; or choose cameras with --only"
        raise ExportError(f"{name} expects {what.format(odd[0].name)}", hint=hint)
