"""A fit to a real camera in the report of its twin's build."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.channel_names import body_and_channel
from pipeline.engine.files import digest_of
from pipeline.errors import UsageError
from pipeline.files.damaged import DamagedFile
from pipeline.files.jsonfile import read_json
from pipeline.plugins.fits.real_images import SideBySide
from pipeline.plugins.fits.twin import MADE_BY
from pipeline.plugins.fits.twin_page import page, residual_maps
from pipeline.results.output import Output
from pipeline.scene.usd.roots import OUTSIDE_HINT, allowed_roots, is_inside


def tell(report: Any, stage: Path, output: Output) -> None:
    """Tell a report what `pipeline calibrate` found, if the stage is a layer that it wrote.

    Raises UsageError or DamagedFile: a file beside the layer, or an image, cannot be read.
    """
    beside = stage.with_suffix(".json")
    fit = read_json(beside) if beside.is_file() else None
    if not isinstance(fit, dict) or fit.get("made_by") != MADE_BY:
        return
    try:
        lines = [*page(fit)]
        if fit["layer_sha256"] != digest_of(stage):
            lines.insert(0, f"{stage.name} was edited after the fit: what follows is of the layer that was fitted")
        for camera in sorted(output.cameras.keys() & {*fit["rows"]["camera"]}):
            _tell_camera(report, stage, output, camera, fit, lines)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DamagedFile(beside, f"no fit of {MADE_BY} ({error!r})") from error


def _tell_camera(report: Any, stage: Path, output: Output, camera: str, fit: Any, lines: list[str]) -> None:
    """Tell a report about a camera: the lines of the fit, those about its images, the maps, and the images."""
    names = fit["images"].get(body_and_channel(camera)[0], {})
    files = {int(frame): stage.parent / name for frame, name in names.items()}
    for file in files.values():
        if not is_inside(file, allowed_roots(stage)):
            raise UsageError(f"the report may not read {file}", hint=OUTSIDE_HINT)
    pairs = SideBySide.of(output, camera, files, _observed_px(fit["rows"], camera))
    remarks = ["", *pairs.lines] if pairs.files else []
    if without := sorted(files.keys() - pairs.observed_px.keys()):
        remarks.append(f"real images of frames without positions are not shown: {', '.join(map(str, without))}")
    drawing = ""
    try:
        drawing = residual_maps(fit, camera)
    except UsageError as error:  # matplotlib is not installed
        remarks += ["", f"no maps: {error.message}"]
    report.tell("Twin", camera, [*lines, *remarks], drawing, pairs.pictures)


def _observed_px(rows: Any, camera: str) -> dict[int, np.ndarray]:
    """Positions of points in the images of a camera, by frame, (n, 2)."""
    frames, x_px = np.array(rows["frame"], float), np.array(rows["x_px"])  # the frame of a centre is NaN
    frames[np.array(rows["camera"]) != camera] = np.nan
    return {int(frame): x_px[frames == frame] for frame in np.unique(frames[np.isfinite(frames)])}
