"""The table of correspondences: its header and notes, and the columns of one target."""

from dataclasses import dataclass

import numpy as np

from pipeline.camera.parts.camera import Camera
from pipeline.camera.rig import Rig
from pipeline.files.jsonfile import Json
from pipeline.frames import apply
from pipeline.motion import Motion, Shutter
from pipeline.products.truth.params import TruthTable
from pipeline.targets.points import TargetPoints
from pipeline.truth.moving import time_of_rows
from pipeline.truth.planes import Planes, tangent_planes
from pipeline.truth.positions.column_sets import SETS, SetNote, column_names
from pipeline.truth.rows import Correspondences, Solutions
from pipeline.truth.settings import TruthSettings
from pipeline.truth.visibility import METHOD

COLUMNS = (
    *("frame", "camera", "target", "point_id", "microlens_k", "microlens_l", "microlens_type"),
    *("x_px", "y_px", "sigma_x_px", "sigma_y_px"),
    *("target_x_mm", "target_y_mm", "target_z_mm", "camera_x_mm", "camera_y_mm", "camera_z_mm"),
    *("hit_fraction", "visibility", "blur_xx_px2", "blur_xy_px2", "blur_yy_px2", "rho_px", "method"),
)

TIME = ("t_s", "motion_xx_px2", "motion_xy_px2", "motion_yy_px2", "lines")
"""Further columns of a camera with a shutter."""
CHANNEL = "channel"
"""Column of the tables of a camera with channels, after the camera."""


def column_order(table: TruthTable) -> list[str]:
    """Names of all columns that the stage asks for, in order."""
    after = COLUMNS.index("camera") + 1
    channel = [] if table.channel is None else [CHANNEL]
    sets = (name for column_set in table.settings.column_sets for name in column_names(column_set))
    time = TIME if table.shutter else ()
    return [*COLUMNS[:after], *channel, *COLUMNS[after:], *time, *sets]


_TIME_NOTE = (
    "time: t_s is the middle of the exposure of the line at {}_px, after the time code of the frame, and camera_*_mm"
    " are of then; motion: covariance of the position by motion during the exposure; lines: how many have the point in"
    " them when they are exposed"
)
_SETS_IN_TIME = (
    "in time: each further position of a point is that of the still target in the middle of the exposure there"
)


@dataclass(frozen=True, slots=True)
class PosedPoints:
    """Points of a target, in its own frame, at its pose vision_from_target in a frame, (4, 4) [mm]."""

    target: str
    points: TargetPoints
    vision_from_target: np.ndarray

    @property
    def of_target(self) -> np.ndarray:
        """Tangent planes of all points in the frame of the target."""
        return tangent_planes(np.eye(4), self.points.position_mm, self.points.plane_axes)

    @property
    def planes(self) -> np.ndarray:
        """Tangent planes of all points in the vision frame, as from `truth.planes.tangent_planes`."""
        return tangent_planes(self.vision_from_target, self.points.position_mm, self.points.plane_axes)

    def before(self, rig: Rig, shutter: Shutter | None, motion: Motion | None) -> Planes:
        """The planes before a camera; they may move while a shutter is open."""
        if shutter is None:
            return Planes(self.planes)
        planes = self.planes if motion is None else self.of_target
        return Planes(planes, motion, shutter, rig.tracer.camera.sensor.size_px)


def columns_of(table: TruthTable, posed: PosedPoints, rig: Rig, truth: Correspondences, visibility: np.ndarray) -> Json:
    """Columns of one target, but those of the sets that the stage asks for besides."""
    solutions = truth.solutions
    lattice = rig.tracer.lattice
    rows = len(solutions.point)
    microlens = [[None] * rows] * 3
    if lattice is not None:
        microlens = [column[solutions.cell] for column in (lattice.k, lattice.l, lattice.type)]
    point = posed.points.position_mm[solutions.point]
    blur = truth.blur_px2
    values = (
        [table.frame] * rows,
        [table.camera] * rows,
        [posed.target] * rows,
        solutions.point,
        *microlens,
        solutions.x_px,
        solutions.y_px,
        *truth.sigma_px.T,
        *point.T,
        *apply(posed.vision_from_target, point).T,
        truth.hit_fraction,
        visibility,
        blur[:, 0, 0],
        blur[:, 0, 1],
        blur[:, 1, 1],
        truth.rho_px,
        [table.settings.method] * rows,
    )
    columns: Json = dict(zip(COLUMNS, values, strict=True))
    channel = table.channel
    return columns if channel is None else {**columns, CHANNEL: [channel.name] * rows}


def time_columns(rig: Rig, solutions: Solutions, planes: Planes) -> Json:
    """Columns of the time of rows, and of the positions of their points at that time if they move."""
    time = time_of_rows(rig, planes, solutions)
    motion = time.motion_px2
    values = (time.middle_s, motion[:, 0, 0], motion[:, 0, 1], motion[:, 1, 1], time.lines)
    columns: Json = dict(zip(TIME, values, strict=True))
    if planes.moves:
        points_mm = planes.middle(solutions.point, solutions.xy_px)[:, 0]
        columns |= dict(zip(("camera_x_mm", "camera_y_mm", "camera_z_mm"), points_mm.T, strict=True))
    return columns


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetNote:
    """Counts and remarks about the points of a target, or about some of them.

    Counts are numbers of rows by reason, None if the camera sees the back of the target; `away` is the number of points
    that face away; `sag_mm` is the largest distance of the surface from its tangent plane over the blur of a row;
    `unsolved` names the points that a search should have found, with k and l of the microlens.
    """

    target: str
    counts: dict[str, int] | None
    away: int = 0
    sag_mm: float = 0.0
    sets: tuple[SetNote, ...] = ()
    unsolved: tuple[tuple[int, ...], ...] = ()

    @property
    def names(self) -> list[str]:
        """Names of the unsolved points, with their microlenses."""
        return [f"point {point}" + (f" behind {tuple(at)}" if at else "") for point, *at in self.unsolved]

    @property
    def text(self) -> str:
        """Text for the header of a table."""
        if self.counts is None:
            return f"{self.target}: no rows, because the camera sees its back"
        remarks = [f"{name} {count}" for name, count in self.counts.items()]
        if self.unsolved:
            remarks.append(f"unsolved are {', '.join(self.names)}")
        if self.away:
            remarks.append(f"points_facing_away {self.away}")
        if self.sag_mm:
            remarks.append(f"largest sag of the surface from its tangent plane over the blur {self.sag_mm:.2g} mm")
        return "; ".join([f"{self.target}: {', '.join(remarks)}", *(note.text for note in self.sets)])

    def joined(self, other: "TargetNote") -> "TargetNote":
        """The note about the points of both, which must be different points."""
        if self.counts is None or other.counts is None:
            return self
        return TargetNote(
            target=self.target,
            counts={name: count + other.counts[name] for name, count in self.counts.items()},
            away=self.away + other.away,
            sag_mm=max(self.sag_mm, other.sag_mm),
            sets=tuple(first.joined(second) for first, second in zip(self.sets, other.sets, strict=True)),
            unsolved=self.unsolved + other.unsolved,
        )


def header_of(table: TruthTable, supersampling: int | None, camera: Camera) -> list[str]:
    """Comment lines of a table, without those about its targets; no supersampling K without position images."""
    settings = table.settings
    light = table.light
    empty = "" if camera.microlenses else "microlens_k, microlens_l, microlens_type (a conventional camera); "
    claim = "none" if settings.claim_px is None else f"{settings.claim_px} px"
    channel = [] if table.channel is None else [table.channel.text]
    mean = "" if table.channel is None else ", their mean"
    return [
        f"exact image positions of target points: camera {table.camera}, frame {table.frame}",
        *channel,
        "pixel convention: (0, 0) is the centre of the top-left pixel, x right, y down",
        "units: px in the image, mm in space; target frame x right, y up, z to the viewer;"
        " camera = vision frame x right, y down, z forward, origin at the aperture stop",
        f"method: {settings.method}; {_search(settings)}; smallest hit fraction {settings.min_hit_fraction};"
        f" claimed accuracy: {claim}; rows of method direct whose sigma is larger did not reach it",
        f"weight: {light.weight}; wavelengths: {light.wavelength_nm} nm{mean}; indices: {table.index_source};"
        f" stop: {camera.prescription.stop.aperture}; footprint: {light.footprint}",
        f"seed: {table.seed}" + (f"; K: {supersampling}; samples: {table.samples}" if supersampling else ""),
        f"visibility: {METHOD}; hidden points and points that face away have no rows",
        *([_TIME_NOTE.format("xy"[table.shutter.axis])] if table.shutter else []),
        f"empty: {empty}single empty cells of blur and rho: no bundle of the micro-image at the pixel",
        *(SETS[name] for name in settings.column_sets),
        *([_SETS_IN_TIME] if table.shutter and settings.column_sets else []),
    ]


def _search(settings: TruthSettings) -> str:
    if not settings.searches:
        return "J(x) = p solved at every point, no position image"
    if settings.search == "nearest":
        return f"search: nearest, threshold {settings.nearest_threshold_mm} mm"
    filtered = f"{settings.filter}, lambda_d {settings.lambda_d}, lambda_alpha {settings.lambda_alpha_deg} deg"
    return f"search: quad, filter {filtered}"
