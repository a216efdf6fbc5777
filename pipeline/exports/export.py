"""A build into the files of other programs: one folder per format, each with a side-car export.json."""

import shutil
import tempfile
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from pipeline.built.output import Output
from pipeline.exports.conventions import CONVENTIONS, Cameras, Convention
from pipeline.exports.conversion import converted
from pipeline.exports.errors import ExportError
from pipeline.exports.formats import WRITERS
from pipeline.exports.gathering import POSITIONS, chosen, gather
from pipeline.exports.material import Material
from pipeline.exports.noise import Noise, with_noise
from pipeline.files.jsonfile import write_json
from pipeline.spelling import did_you_mean

SIDE_CAR = "export.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """A choice of what is exported.

    Attributes
    ----------
    only : tuple of str
        Names of cameras and targets; all cameras where it names none, likewise targets.
    position : str
        Which position of a point: a key of `POSITIONS`.
    noise : Noise
    """

    only: tuple[str, ...] = ()
    position: str = "exact"
    noise: Noise = field(default_factory=Noise)

    def __post_init__(self) -> None:
        if self.position not in POSITIONS:
            hint = did_you_mean(self.position, POSITIONS) or f"positions: {', '.join(POSITIONS)}"
            raise ExportError(f"there is no position {self.position!r}", hint=hint)


def convention_of(name: str) -> Convention:
    """The convention of a format.

    Raises
    ------
    ExportError
        There is no such format.
    """
    if name not in CONVENTIONS:
        hint = did_you_mean(name, CONVENTIONS) or f"formats: {', '.join(CONVENTIONS)}"
        raise ExportError(f"there is no export format {name!r}", hint=hint)
    return CONVENTIONS[name]


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
    materials = {
        one: with_noise(chosen(gather(output, one.position), one.only), one.noise) for _, one in asked.values()
    }
    for place, (name, one) in asked.items():
        _require_kind(name, convention_of(name), materials[one])
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
        convention_of(name)
        one = replace(request, position=position) if position else request
        found[folder / (name if one.position == "exact" else f"{name}-{one.position}")] = name, one
    return found


def _write(name: str, material: Material, place: Path, request: Request) -> None:
    """Write a format aside, then put it into its place."""
    convention = convention_of(name)
    place.parent.mkdir(parents=True, exist_ok=True)
    aside = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=place.parent))
    try:
        aside.chmod(0o755)
        WRITERS[name](converted(material, convention), aside)
        files = sorted(path.relative_to(aside).as_posix() for path in aside.rglob("*") if path.is_file())
        noise = None if request.noise.is_none else request.noise.to_dict()
        said = {"stage": material.stage, "format": name, "position": request.position, "noise": noise}
        write_json(aside / SIDE_CAR, {**said, "conventions": _plain(convention), "files": files})
        aside.rename(place)
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def _plain(convention: Convention) -> dict[str, str]:
    return {name: str(value) for name, value in asdict(convention).items()}


def _require_kind(name: str, convention: Convention, material: Material) -> None:
    """Refuse cameras that a format does not know."""
    if convention.cameras is Cameras.ANY:
        return
    wants = convention.cameras is Cameras.PLENOPTIC
    odd = [camera.name for camera in material.cameras if camera.built.is_plenoptic is not wants]
    if odd:
        others = [other for other, one in CONVENTIONS.items() if one.cameras not in (convention.cameras,)]
        what = "a microlens array, and {} has none" if wants else "one position per point, and {} is plenoptic"
        hint = f"formats for it: {', '.join(others)}"
        if len(odd) < len(material.cameras):
            hint += "; or choose cameras with --only"
        raise ExportError(f"{name} expects {what.format(odd[0])}", hint=hint)
