"""Cameras, views, tables and targets of a build as parts of the page; tables have the very numbers of the files.

Data are scripts: a page from disk may load scripts, and nothing else. Images are copies of small PNGs, tiles of large
ones, named by their digests: those that a report already holds are not made again.
"""

import base64
import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.channel_names import body_and_channel, folder_of
from pipeline.files.png import png_bytes, png_size, read_png, write_png
from pipeline.folders import put
from pipeline.frames import apply
from pipeline.plugins.report.records import (
    CameraPart,
    Histogram,
    MicroImageData,
    Picture,
    Residuals,
    TableData,
    TargetPart,
    View,
)
from pipeline.plugins.report.shapes import matrix
from pipeline.records.plain import to_plain
from pipeline.results.output import Output
from pipeline.results.records import BuiltCamera, BuiltFolder, BuiltPinhole, BuiltTarget, BuiltView
from pipeline.results.spots import drawn
from pipeline.targets.preview import preview_faces
from pipeline.targets.target import AnyTarget, Target

if TYPE_CHECKING:
    from pipeline.plugins.report.report import Told

_FARTHEST_PX = 1e12
"""Principal distance in the 3-D view for a lens that no pinhole fits [px]: its pyramid shrinks to the axis."""

_FUNCTION = "plenopticReport"
"""Name of the function that a script calls with its name and its data."""
_WHOLE_PX = 2048
"""Longest edge of an image that stays one file: browsers decode it in a few hundredths of a second."""
_TILE_PX = 512
"""Edge of a tile: a screen shows a dozen, and an image of 12 megapixels has about sixty on all levels."""
_NAME = 16
"""Hexadecimal digits of a digest in a name: at 64 bits, thousands of images never collide by chance."""
_BINS = 40
"""Bins of a histogram."""
_POINTS = 4000
"""Most points of a map: more make a blot, and a large file."""


class Scripts:
    """The scripts of one report, below `data/`."""

    def __init__(self, report: Path) -> None:
        self.report = report
        self.written: set[str] = set()

    def write(self, name: str, record: Any) -> str:
        """Write a record; returns the path of its script below the report."""
        path = f"data/{name}.js"
        text = json.dumps(to_plain(record), separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        put(self.report / path, f"{_FUNCTION}({json.dumps(name)},{text});\n".encode())
        self.written.add(path)
        return path

    def keep(self, name: str) -> str | None:
        """Path of a script of an earlier report that is still valid; None if there is none."""
        path = f"data/{name}.js"
        if not (self.report / path).is_file():
            return None
        self.written.add(path)
        return path

    def remove_others(self) -> None:
        for path in (self.report / "data").glob("*.js"):
            if f"data/{path.name}" not in self.written:
                path.unlink()


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedBuild:
    """A build and the destination of its report; `points` and `certificate` are the manifest's."""

    output: Output
    folder: BuiltFolder
    points: Mapping[str, Any]
    certificate: Mapping[str, Any]
    scripts: Scripts
    told: Mapping[str, Mapping[str, "Told"]]  # by heading and camera

    @property
    def report(self) -> Path:
        return self.scripts.report


def camera_part(source: ReportedBuild, camera: BuiltCamera, optics: str | None, told: dict[str, str]) -> CameraPart:
    """A camera with its views; writes the scripts of its tables, and puts its images into the report."""
    record = camera.record
    width, height = camera.size_px
    certificate = source.certificate.get(camera.name)
    return CameraPart(
        name=camera.name,
        kind="plenoptic" if camera.is_plenoptic else "conventional",
        lens=record["lens"]["name"],
        width_px=width,
        height_px=height,
        principal_distance_px=float(record["principal_distance_px"]) if record["pinhole"] else _FARTHEST_PX,
        certificate=certificate,
        optics=optics,
        micro_images=_micro_images(source, camera),
        told=told,
        pictures=_pictures(source, f"cameras/{folder_of(camera.name)}", ("white",)),
        views=tuple(_view(source, camera, view) for view in camera.views),
        residuals=residuals(camera, certificate),
    )


def _micro_images(source: ReportedBuild, camera: BuiltCamera) -> str | None:
    images, outlines = camera.micro_images, camera.micro_image_outlines
    if images is None or outlines is None:
        return None
    return source.scripts.write(f"micro_images.{camera.name}", micro_image_data(images, outlines))


def _view(source: ReportedBuild, camera: BuiltCamera, view: BuiltView) -> View:
    """A view; writes the script of its table, and puts the images of its channel and of its body into the report."""
    folder = f"frames/{view.frame:04d}/{folder_of(camera.name)}"
    facts = source.points[camera.name]
    visible = next(row["seen"] for row in facts["frames"] if row["frame"] == view.frame)
    body = f"frames/{view.frame:04d}/{body_and_channel(camera.name)[0]}"
    pictures = _pictures(source, folder, ("image", "raw", "labels"))
    if body != folder:
        pictures += _pictures(source, body, ("image", "raw", "labels"), "all channels: ")
    for heading, cameras in source.told.items():
        if told := cameras.get(camera.name):
            others = told.pictures(view.frame).items()
            pictures += tuple(told_picture(pixels, kind, heading, source.report) for kind, pixels in others)
    poses = view.poses
    return View(
        frame=view.frame,
        rows=len(view.correspondences),
        seen=sum(visible.values()),
        of=sum(facts["of"].values()),
        data=source.scripts.write(f"rows.{camera.name}.{view.frame:04d}", table_data(view.correspondences)),
        pictures=pictures,
        camera_from_world=matrix(poses.camera_from_world),
        camera_from_target={name: matrix(pose) for name, pose in poses.camera_from_target.items()},
    )


def _pictures(source: ReportedBuild, folder: str, kinds: tuple[str, ...], before: str = "") -> tuple[Picture, ...]:
    files = [(kind, f"{folder}/{kind}.png") for kind in kinds if source.folder.file(f"{folder}/{kind}.png")]
    return tuple(picture_of(source.folder, file, f"{before}{kind}", source.report) for kind, file in files)


def target_part(source: ReportedBuild, name: str, target: BuiltTarget, loaded: AnyTarget | None) -> TargetPart:
    """A target with its faces and its picture; without those for a mesh, and where the stage could not be read."""
    part = TargetPart(
        name=name, kind=target.kind, points=len(target.points_mm), corners_mm=(), faces=(), places=(), picture=""
    )
    picture = source.folder.file(f"pictures/{name}.png")
    if not isinstance(loaded, Target) or picture is None:
        return part
    faces = preview_faces(loaded)
    return dataclasses.replace(
        part,
        corners_mm=tuple(map(tuple, np.round(faces.points_mm, 4).tolist())),
        faces=tuple(map(tuple, faces.faces.tolist())),
        places=tuple(map(tuple, faces.sheet.tolist())),
        picture=f"data:image/png;base64,{base64.b64encode(picture.read_bytes()).decode()}",
    )


_OUTER = "light_"
"""Prefix of the columns of the outline of all light."""


def table_data(rows: np.recarray) -> TableData:
    """All columns of a table; constant columns are stated once."""
    columns = {name: _plain(rows[name]) for name in rows.dtype.names or ()}
    same = {name: cells[0] for name, cells in columns.items() if len(cells) > 1 and len(set(cells)) == 1}
    return TableData(
        rows=len(rows), same=same, columns={name: cells for name, cells in columns.items() if name not in same}
    )


def micro_image_data(images: np.recarray, outlines: np.recarray) -> MicroImageData:
    """Lit micro-images, with the outline of all of their light."""
    names = [name for name in outlines.dtype.names or () if name.startswith(_OUTER)]
    row_of = {key: row for row, key in enumerate(_keys(images))}
    lit = images[[row_of[key] for key in _keys(outlines)]].view(np.recarray)
    return MicroImageData(
        k=tuple(lit.microlens_k.tolist()),
        l=tuple(lit.microlens_l.tolist()),
        type=tuple(lit.microlens_type.tolist()),
        centre_x_px=drawn(lit.centre_x_px),
        centre_y_px=drawn(lit.centre_y_px),
        outline_x_px=drawn(outlines.centroid_x_px),
        outline_y_px=drawn(outlines.centroid_y_px),
        outline_radius_px=tuple(
            drawn(np.array(radii)) for radii in zip(*(outlines[name] for name in names), strict=True)
        ),
    )


def _keys(rows: np.recarray) -> list[tuple[int, int]]:
    return list(zip(rows.microlens_k.tolist(), rows.microlens_l.tolist(), strict=True))


def _plain(column: np.ndarray) -> tuple[Any, ...]:
    return tuple(None if cell != cell else cell for cell in column.tolist())


def picture_of(folder: BuiltFolder, file: str, kind: str, report: Path) -> Picture:
    """Put an image of the build into the report, unless it is there; UsageError if it has vanished, or DamagedFile."""
    source = folder.present(file)
    name = f"images/{folder.digests[file][:_NAME]}"
    width, height = png_size(source)
    picture = Picture(kind=kind, width_px=width, height_px=height, path=f"{name}.png", tile_px=None, levels=1)
    return _put(picture, name, report, lambda: read_png(source), source.read_bytes)


def told_picture(pixels: np.ndarray, kind: str, heading: str, report: Path) -> Picture:
    """Put a picture that another plug-in made into the report."""
    data = png_bytes(pixels)
    name = f"images/{hashlib.sha256(data).hexdigest()[:_NAME]}"
    height, width = pixels.shape[:2]
    path = f"{name}.png"
    picture = Picture(kind=kind, width_px=width, height_px=height, path=path, tile_px=None, levels=1, section=heading)
    return _put(picture, name, report, lambda: pixels, lambda: data)


def _put(
    picture: Picture, name: str, report: Path, pixels: Callable[[], np.ndarray], data: Callable[[], bytes]
) -> Picture:
    """The picture as one file, or, of a large one, as tiles; either is written unless it is there."""
    if max(picture.width_px, picture.height_px) <= _WHOLE_PX:
        if not (report / picture.path).is_file():
            put(report / picture.path, data())
        return picture
    # Each level is half of the next one; level 0 fits into one tile.
    levels = 1 + math.ceil(math.log2(max(picture.width_px, picture.height_px) / _TILE_PX))
    if not (report / name / "0").is_dir():  # the smallest level is written last
        _write_tiles(report / name, pixels(), levels)
    return dataclasses.replace(picture, path=name, tile_px=_TILE_PX, levels=levels)


def _write_tiles(folder: Path, pixels: np.ndarray, levels: int) -> None:
    """Write all levels, the finest with the very pixels of the image."""
    if pixels.ndim == 3 and (pixels == pixels[..., :1]).all():
        pixels = pixels[..., 0]  # a third of the bytes
    for level in reversed(range(levels)):
        aside = folder / f"{level}.new"
        aside.mkdir(parents=True, exist_ok=True)
        height, width = pixels.shape[:2]
        for y in range(0, height, _TILE_PX):
            for x in range(0, width, _TILE_PX):
                tile = pixels[y : y + _TILE_PX, x : x + _TILE_PX]
                write_png(aside / f"{x // _TILE_PX}_{y // _TILE_PX}.png", tile)
        aside.replace(folder / str(level))
        pixels = _halved(pixels)


def _halved(pixels: np.ndarray) -> np.ndarray:
    """Means of 2 x 2 pixels, the last row and column doubled where they are odd; dtype as before."""
    odd = [(0, size % 2) for size in pixels.shape[:2]] + [(0, 0)] * (pixels.ndim - 2)
    even = np.pad(pixels, odd, mode="edge").astype(np.uint32)
    total = even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2]
    return ((total + 2) // 4).astype(pixels.dtype)


def residuals(camera: BuiltCamera, certificate: Mapping[str, Any] | None) -> Residuals:
    """Statistics over all frames; maps show evenly taken rows. The certificate is that of the manifest, if any."""
    claim_px = certificate["claim_px"] if certificate else None
    differences = np.array(certificate["differences_px"] if certificate else (), float)
    rows = camera.correspondences
    empty = np.zeros(0)
    if len(rows) == 0:
        return Residuals(histograms=(), **dict.fromkeys(("x_px", "y_px", "rho_px", "dx_px", "dy_px"), ()))
    deviation = _pinhole_deviation(camera)  # None for plenoptic cameras
    sigma = np.hypot(rows.sigma_x_px, rows.sigma_y_px)
    title = f"Differences that the certificate found, {len(differences)} of {len(rows):,} rows"
    histograms = [
        _histogram(title, differences, is_logarithmic=True, mark=claim_px),
        _histogram("Stated standard error of a row", sigma, is_logarithmic=True, mark=claim_px),
        _histogram("Signed blur radius", rows.rho_px),
        _histogram("Hit fraction", rows.hit_fraction, ""),
    ]
    if deviation is not None and camera.pinhole_with_distortion is not None:
        title = "Left by the pinhole with distortion"
        rms = camera.pinhole_with_distortion.rms_px
        lengths = np.hypot(*deviation.T)
        histograms.append(_histogram(title, lengths, is_logarithmic=True, mark=rms, mark_name="its rms"))
    sample = np.unique(np.linspace(0, len(rows) - 1, min(_POINTS, len(rows))).astype(int))
    dx, dy = (empty, empty) if deviation is None else deviation[sample].T
    return Residuals(
        histograms=tuple(histogram for histogram in histograms if histogram is not None),
        x_px=drawn(rows.x_px[sample]),
        y_px=drawn(rows.y_px[sample]),
        rho_px=drawn(rows.rho_px[sample]),
        dx_px=tuple(dx.tolist()),
        dy_px=tuple(dy.tolist()),
    )


def _pinhole_deviation(camera: BuiltCamera) -> np.ndarray | None:
    """Positions minus those of the equivalent pinhole with distortion, (n, 2) [px]; None for plenoptic cameras."""
    pinhole = camera.pinhole_with_distortion
    if pinhole is None or camera.is_plenoptic:
        return None
    parts = [_deviation_in_view(view, pinhole) for view in camera.views]
    return np.concatenate([part for part in parts if part is not None]) if parts else None


def _deviation_in_view(view: BuiltView, pinhole: BuiltPinhole) -> np.ndarray:
    """Positions minus those of the pinhole, (n, 2) [px]; NaN for rows of a target without a pose."""
    rows = view.correspondences
    deviation = np.full((len(view.correspondences), 2), np.nan)
    for name, pose in view.poses.pinhole_from_target.items():
        on_target = rows.target == name
        points = np.column_stack([rows[f"target_{axis}_mm"][on_target] for axis in "xyz"])
        positions_px = np.column_stack([rows.x_px[on_target], rows.y_px[on_target]])
        deviation[on_target] = positions_px - pinhole.projected(apply(pose, points))
    return deviation


def _histogram(
    title: str,
    values: np.ndarray,
    unit: str = "px",
    *,
    is_logarithmic: bool = False,
    mark: float | None = None,
    mark_name: str = "the claim",
) -> Histogram | None:
    """A histogram of finite values, or over decades of positive ones; None if there are none."""
    values = values[np.isfinite(values) & ((values > 0) | (not is_logarithmic))]
    if not values.size:
        return None
    counts, edges = np.histogram(np.log10(values) if is_logarithmic else values, _BINS)
    return Histogram(
        title=title,
        unit=unit,
        is_logarithmic=is_logarithmic,
        edges=tuple((10.0**edges if is_logarithmic else edges).tolist()),
        counts=tuple(counts.tolist()),
        mark=mark,
        mark_name=mark_name,
    )
