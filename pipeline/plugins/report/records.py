"""Records of the report page: data between Python and the scripts of `web/`, which know no optics and no files.

Lists of numbers hold None where a value is unknown. `web/record_types.py` writes the same records as TypeScript.
"""

from dataclasses import dataclass
from typing import Any

from pipeline.app.pages.text import Figure as Figure  # of `Figures`, for web/src/records.ts
from pipeline.app.pages.text import Figures
from pipeline.files.jsonfile import Json
from pipeline.plugins.report.shapes import Matrix, RayFan, SurfaceShape
from pipeline.results.spots import Numbers, Spot


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """An image for the viewer.

    `kind`: `image`, `raw` or `white`, with the name of a channel where there are some.
    `path`: one PNG below the report, or a folder of tiles `LEVEL/X_Y.png`, level 0 being the smallest.
    `tile_px`: edge of the tiles; None: one file.
    `section`: heading of the section that shows it beside others; empty of images of the build.
    """

    kind: str
    width_px: int
    height_px: int
    path: str
    tile_px: int | None
    levels: int
    section: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A camera in a frame; `data` is the script with its table."""

    frame: int
    rows: int
    seen: int
    of: int
    data: str
    pictures: tuple[Picture, ...]
    camera_from_world: Matrix
    camera_from_target: dict[str, Matrix]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableData:
    """The rows of a table by column; `same` holds the constant columns."""

    rows: int
    same: Json
    columns: dict[str, tuple[Any, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class MicroImageData:
    """Micro-images of a camera; radii of outlines are from the centroid, in equal steps from +x towards +y."""

    k: tuple[int, ...]
    l: tuple[int, ...]
    type: tuple[int, ...]
    centre_x_px: Numbers
    centre_y_px: Numbers
    outline_x_px: Numbers
    outline_y_px: Numbers
    outline_radius_px: tuple[Numbers, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Histogram:
    """Counts between edges (one more than counts); `unit` belongs to the edges."""

    title: str
    unit: str
    is_logarithmic: bool
    edges: tuple[float, ...]
    counts: tuple[int, ...]
    mark: float | None
    mark_name: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Residuals:
    """Statistics of all rows of a camera; points are an even selection of at most a few thousand.

    `x_px`, `y_px`, `rho_px`: positions and signed blur radii.
    `dx_px`, `dy_px`: position minus that of the equivalent pinhole with distortion; empty where there is none.
    """

    histograms: tuple[Histogram, ...]
    x_px: Numbers
    y_px: Numbers
    rho_px: Numbers
    dx_px: Numbers
    dy_px: Numbers


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """A curve of a chart."""

    name: str
    y: Numbers
    is_dashed: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """Curves over a common axis."""

    title: str
    remark: str
    x_name: str
    y_name: str
    x: Numbers
    lines: tuple[Line, ...]
    y_range: tuple[float, float] | None = None  # ends of the axis; None: those of the lines


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """The optical part of a camera."""

    drawing: str
    figures: tuple[Figures, ...]
    charts: tuple[Chart, ...]
    spots: tuple[Spot, ...]
    surfaces: tuple[SurfaceShape, ...]
    sensor_mm: Matrix  # corners of the sensor, around it, vision frame
    fans: tuple[RayFan, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ToldPart:
    """A section of the page that another plug-in tells of a camera: lines, and an SVG, empty where there is none."""

    lines: tuple[str, ...]
    drawing: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPart:
    """A camera, or one of its channels; `optics` and so on are scripts, None where there are none, and those of
    `ToldPart`s by the heading of their section.
    """

    name: str
    kind: str
    lens: str
    width_px: int
    height_px: int
    principal_distance_px: float
    certificate: Json | None
    optics: str | None
    micro_images: str | None
    told: dict[str, str]
    pictures: tuple[Picture, ...]
    views: tuple[View, ...]
    residuals: Residuals


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetPart:
    """A target: faces as quadrilaterals in the target frame, and their corners on its picture."""

    name: str
    kind: str
    points: int
    corners_mm: tuple[tuple[float, ...], ...]
    faces: tuple[tuple[int, ...], ...]
    places: tuple[tuple[float, ...], ...]  # from (0, 0), lower left, to (1, 1)
    picture: str  # a PNG as a URL of its data: a page from disk may show no file in space


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskRun:
    """A task: how it ended in the last build, and the run that made its result.

    `state`: `executed`, `cached` or `made before`, where the last build is not known.
    `start_s`, `end_s`: times of the run, from the beginning of the last build; None if it did not run.
    """

    name: str
    kind: str
    state: str
    start_s: float | None = None
    end_s: float | None = None
    cpu_s: float | None = None
    peak_bytes: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """History of the folder: its tasks."""

    tasks: tuple[TaskRun, ...]
    seconds: float | None
    workers: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """Everything that the page shows at once; the rest are scripts that it loads on demand."""

    title: str
    stage: str
    seed: int
    frames: tuple[int, ...]
    bytes: int
    files: int
    versions: dict[str, str]
    cameras: tuple[CameraPart, ...]
    targets: tuple[TargetPart, ...]
    history: str
