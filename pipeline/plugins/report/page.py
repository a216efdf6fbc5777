"""The report of a build: one page that works from disk, in a folder beside the output folder.

It is neither a task nor part of the output folder: it tells when and where tasks ran, and OUT is identical to the byte
wherever it was made. Images that an earlier report holds are not made again: their names are digests.
"""

import hashlib
import shutil
from collections.abc import Callable, Iterator, Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import UsageError
from pipeline.files.jsonfile import Json, read_json
from pipeline.folders import put
from pipeline.plugins.report.optics import optics
from pipeline.plugins.report.parts import ReportedBuild, Scripts, camera_part, target_part
from pipeline.plugins.report.records import CameraPart, History, Page, ToldPart
from pipeline.results.output import open_output
from pipeline.results.records import finished_folder
from pipeline.scene.dataset import CameraEntry
from pipeline.scene.load import Loaded, load

if TYPE_CHECKING:
    from pipeline.plugins.report.report import Told

INDEX = "index.html"
_STAGE = "dataset.usda"
ASSETS = (INDEX, "report.js", "report.css", "LICENSES.txt")
_KEPT_HEADING = "Information"
"""Heading of the section that is kept from an earlier report of the same build: whoever told it is not asked again."""
_MARK = b'<meta name="generator" content="plenoptic-pipeline">'
"""Line of the page by which a folder is recognised as a report of ours."""


def place_of(out: Path) -> Path:
    """Folder of the report of an output folder."""
    out = out.absolute()
    return out.with_name(f"{out.name}.report")


def require_ours(report: Path) -> None:
    """Refuse a folder that holds something else; UsageError."""
    index = report / INDEX
    is_ours = index.is_file() and not index.is_symlink() and _MARK in index.read_bytes()
    is_free = not report.exists() or (report.is_dir() and not any(report.iterdir()))
    if not (is_ours or is_free):
        raise UsageError(f"{report} is there and is no report of ours", hint="choose another folder with -o")


def state_of(out: Path) -> str:
    """Digest of all inputs of a report but its history: the manifest and the scripts of the page."""
    digest = hashlib.sha256((out / "manifest.json").read_bytes())
    for name in ASSETS:
        digest.update(_asset(name))
    return digest.hexdigest()


def is_current(out: Path, report: Path) -> bool:
    """Whether a report was made from the present content of the output folder."""
    made_of = report / "made_of"
    return made_of.is_file() and made_of.read_text(encoding="utf-8") == state_of(out)


def stage_of(out: Path, warn: Callable[[str], None]) -> Loaded | None:
    """The stage in the output folder; None, with a warning, if it does not pass `check`."""
    if not (out / _STAGE).is_file():
        return None
    loaded = load(out / _STAGE)
    if loaded.errors or loaded.dataset is None:
        warn(f"the report has no optics and no 3-D view: {out / _STAGE} does not pass `pipeline check`")
        return None
    return loaded


def write_page(
    out: Path,
    report: Path,
    loaded: Loaded | None,
    history: History | None,
    told: Mapping[str, Mapping[str, "Told"]],
) -> Path:
    """Write the report of an output folder; returns its page.

    Without the stage of the folder there are no optics and no 3-D view. Without a history, that of an earlier report
    stays, as does its information about cameras of which nothing is `told` now, if the folder is unchanged.
    Raises UsageError where there is no finished build or `report` holds something else, and DamagedFile.
    """
    folder, output = finished_folder(out), open_output(out)
    require_ours(report)
    state = state_of(out)
    for name in ("data", "images"):
        (report / name).mkdir(parents=True, exist_ok=True)
    put(report / INDEX, _asset(INDEX))  # first: it marks the folder as ours
    (report / "made_of").unlink(missing_ok=True)
    manifest = read_json(out / "manifest.json")
    scripts = Scripts(report)
    source = ReportedBuild(
        output=output,
        folder=folder,
        points=manifest["points"],
        certificate=manifest["certificate"],
        scripts=scripts,
        told=told,
    )
    told_scripts = {name: dict(_told_scripts(source, name, state)) for name in output.cameras}
    bodies = loaded.dataset.cameras if loaded and loaded.dataset else ()
    entries = {channel.full_name: channel for entry in bodies for channel in entry.in_channels}
    cameras = [
        camera_part(source, camera, _optics(source, entries.get(name), camera.record), told_scripts[name])
        for name, camera in output.cameras.items()
    ]
    kept_history = scripts.keep("history") if history is None else scripts.write("history", history)
    _remove_other_images(report, cameras)
    page = _page(source, manifest, cameras, _targets(source, loaded), kept_history or "")
    scripts.write("page", page)
    for name in ASSETS:
        put(report / name, _asset(name))
    scripts.remove_others()
    put(report / "made_of", state.encode())
    return report / INDEX


def _told_scripts(source: ReportedBuild, camera: str, state: str) -> Iterator[tuple[str, str]]:
    """Headings and scripts of what other plug-ins tell of a camera."""
    for heading in dict.fromkeys([_KEPT_HEADING, *source.told]):
        name = f"{heading.lower()}.{camera}.{state[:16]}"
        if told := source.told.get(heading, {}).get(camera):
            yield heading, source.scripts.write(name, ToldPart(lines=told.lines, drawing=told.drawing))
        elif heading == _KEPT_HEADING and (kept := source.scripts.keep(name)):
            yield heading, kept


def _remove_other_images(report: Path, cameras: list[CameraPart]) -> None:
    pictures = [picture for camera in cameras for picture in camera.pictures]
    pictures += [picture for camera in cameras for view in camera.views for picture in view.pictures]
    used = {Path(picture.path).name for picture in pictures}
    for path in (report / "images").iterdir():
        if path.name not in used:
            shutil.rmtree(path) if path.is_dir() else path.unlink()


def _page(source: ReportedBuild, manifest: Json, cameras: list[CameraPart], targets: Any, history: str) -> Page:
    return Page(
        title=source.output.path.absolute().name,
        stage=manifest["stage"],
        seed=manifest["seeds"]["dataset"],
        frames=source.output.frames,
        bytes=sum(entry["size"] for entry in manifest["files"].values()),
        files=len(manifest["files"]),
        versions=manifest["versions"],
        cameras=tuple(cameras),
        targets=targets,
        history=history,
    )


def _optics(source: ReportedBuild, entry: CameraEntry | None, record: Json) -> str | None:
    """Script of the optical part of a camera."""
    if entry is None:
        return None
    return source.scripts.write(f"optics.{entry.full_name}", optics(entry.camera, entry.full_name, record))


def _targets(source: ReportedBuild, loaded: Loaded | None) -> tuple[Any, ...]:
    loaded_targets = {entry.name: entry.target for entry in loaded.targets} if loaded else {}
    return tuple(
        target_part(source, name, target, loaded_targets.get(name)) for name, target in source.output.targets.items()
    )


def _asset(name: str) -> bytes:
    """A file of the page that ships with this package; `make web` builds them from `web/`."""
    return (resources.files("pipeline.plugins.report") / "assets" / name).read_bytes()
