"""Cameras, views, tables and targets of a build as parts of the page; tables have the very numbers of the files."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.channel_names import body_and_channel, folder_of
from pipeline.report.page.images import picture_of
from pipeline.report.page.records import CameraPart, MicroImageData, Picture, TableData, TargetPart, View
from pipeline.report.page.residuals import residuals
from pipeline.report.page.scripts import Scripts
from pipeline.report.page.shapes import matrix
from pipeline.report.text import Figure
from pipeline.results.folder import BuiltFolder
from pipeline.results.output import Output
from pipeline.results.records import BuiltCamera, BuiltView
from pipeline.results.spots import drawn
from pipeline.targets.preview import preview_faces
from pipeline.targets.target import AnyTarget, Target

_MOST_FACES = 20_000
"""Faces of a target in the 3-D view; one with more is left out there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedBuild:
    """A build that is reported, and where the report is written; `points` and `certificate` are the manifest's."""

    output: Output
    folder: BuiltFolder
    points: Mapping[str, Any]
    certificate: Mapping[str, Any]
    scripts: Scripts

    @property
    def report(self) -> Path:
        """Folder of the report."""
        return self.scripts.report


def camera_part(source: ReportedBuild, camera: BuiltCamera, optics: str | None) -> CameraPart:
    """A camera with its views; writes the scripts of its tables, and puts its images into the report."""
    record, (width, height) = camera.record, camera.size_px
    certificate = source.certificate.get(camera.name)
    return CameraPart(
        name=camera.name,
        kind="plenoptic" if camera.is_plenoptic else "conventional",
        lens=record["lens"]["name"],
        width_px=width,
        height_px=height,
        pitch_mm=camera.pitch_mm,
        principal_distance_px=record["principal_distance_px"],
        key_figures=_key_figures(camera),
        certificate=certificate,
        optics=optics,
        micro_images=_micro_images(source, camera),
        pictures=_pictures(source, f"cameras/{folder_of(camera.name)}", ("white",)),
        views=tuple(_view(source, camera, view) for view in camera.views),
        residuals=residuals(camera, certificate),
    )


def _key_figures(camera: BuiltCamera) -> tuple[Figure, ...]:
    lens, (width, height) = camera.record["lens"], camera.size_px
    across, down, _ = camera.record["field_of_view_deg"]
    return (
        Figure(name="focal length", value=f"{lens['efl_mm']:.2f} mm", remark=f"f/{lens['f_number']:.1f}"),
        Figure(name="sensor", value=f"{width} × {height} px", remark=f"{1000 * camera.pitch_mm:g} µm pixels"),
        Figure(name="field of view", value=f"{across:.1f}° × {down:.1f}°", remark=""),
    )


def _micro_images(source: ReportedBuild, camera: BuiltCamera) -> str | None:
    images, outlines = camera.micro_images, camera.micro_image_outlines
    if images is None or outlines is None:
        return None
    return source.scripts.write(f"micro_images.{camera.name}", micro_image_data(images, outlines))


def _view(source: ReportedBuild, camera: BuiltCamera, view: BuiltView) -> View:
    place = f"frames/{view.frame:04d}/{folder_of(camera.name)}"
    facts = source.points[camera.name]
    seen = next(row["seen"] for row in facts["frames"] if row["frame"] == view.frame)
    body = f"frames/{view.frame:04d}/{body_and_channel(camera.name)[0]}"
    pictures = _pictures(source, place, ("image", "raw"))
    if body != place:
        pictures += _pictures(source, body, ("image", "raw"), "all channels: ")
    poses = view.poses
    return View(
        frame=view.frame,
        rows=len(view.correspondences),
        seen=sum(seen.values()),
        of=sum(facts["of"].values()),
        data=source.scripts.write(f"rows.{camera.name}.{view.frame:04d}", table_data(view.correspondences)),
        pictures=pictures,
        camera_from_world=matrix(poses.camera_from_world),
        camera_from_target={name: matrix(pose) for name, pose in poses.camera_from_target.items()},
    )


def _pictures(source: ReportedBuild, place: str, kinds: tuple[str, ...], before: str = "") -> tuple[Picture, ...]:
    folder = source.folder
    files = [(kind, f"{place}/{kind}.png") for kind in kinds if folder.file(f"{place}/{kind}.png")]
    return tuple(picture_of(folder, file, f"{before}{kind}", source.report) for kind, file in files)


def target_part(name: str, kind: str, count: int, target: AnyTarget | None) -> TargetPart:
    """A target with its faces; none of a mesh, and none where the stage could not be read."""
    part = TargetPart(name=name, kind=kind, points=count, corners_mm=(), faces=(), greys=())
    faces = preview_faces(target) if isinstance(target, Target) else None
    if faces is None or len(faces.faces) > _MOST_FACES:
        return part
    return dataclasses.replace(
        part,
        corners_mm=tuple(tuple(point) for point in np.round(faces.points_mm, 4).tolist()),
        faces=tuple(tuple(face) for face in faces.faces.tolist()),
        greys=tuple(grey or 0.0 for grey in drawn(faces.radiance)),
    )


_OUTER = "light_"
"""Beginning of the columns of the outline of all light."""


def table_data(rows: np.recarray) -> TableData:
    """All columns of a table; those in which all rows are equal once."""
    columns = {name: _plain(rows[name]) for name in rows.dtype.names or ()}
    same = {name: cells[0] for name, cells in columns.items() if len(cells) > 1 and len(set(cells)) == 1}
    return TableData(
        rows=len(rows), same=same, columns={name: cells for name, cells in columns.items() if name not in same}
    )


def micro_image_data(images: np.recarray, outlines: np.recarray) -> MicroImageData:
    """Micro-images that light reaches, with the outline of all of their light."""
    names = [name for name in outlines.dtype.names or () if name.startswith(_OUTER)]
    row_of = {key: row for row, key in enumerate(_keys(images))}
    shown = images[[row_of[key] for key in _keys(outlines)]].view(np.recarray)
    return MicroImageData(
        k=tuple(shown.microlens_k.tolist()),
        l=tuple(shown.microlens_l.tolist()),
        type=tuple(shown.microlens_type.tolist()),
        centre_x_px=drawn(shown.centre_x_px),
        centre_y_px=drawn(shown.centre_y_px),
        radius_px=drawn(shown.radius_px),
        outline_x_px=drawn(outlines.centroid_x_px),
        outline_y_px=drawn(outlines.centroid_y_px),
        outline_radius_px=tuple(
            drawn(np.array(radii)) for radii in zip(*(outlines[name] for name in names), strict=True)
        ),
    )


def _keys(rows: np.recarray) -> list[tuple[int, int]]:
    return list(zip(rows.microlens_k.tolist(), rows.microlens_l.tolist(), strict=True))


def _plain(column: np.ndarray) -> tuple[Any, ...]:
    """Cells of a column; None where one is empty."""
    return tuple(None if cell != cell else cell for cell in column.tolist())
