"""Tables as NumPy record arrays, as pandas data frames where pandas is installed, and as plots over the image."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.channel_names import name_with
from pipeline.errors import UsageError
from pipeline.files.tables import Table
from pipeline.results.notebook import axes as new_axes
from pipeline.results.notebook import html_table
from pipeline.spelling import did_you_mean

if TYPE_CHECKING:
    import pandas

INSTALL_FRAMES = 'python -m pip install "plenoptic-pipeline[frames]"'
MICROLENS = frozenset({"microlens_k", "microlens_l", "microlens_type"})
"""Columns without values for a conventional camera."""
_TEXTS = frozenset({"camera", "channel", "second_camera", "target", "method"})
_COUNTS = MICROLENS | {"frame", "point_id", "complete"}


def rows_of(table: Table, without: frozenset[str] = frozenset()) -> np.recarray:
    """A table as a record array of text, int64, and float64, NaN where a cell is empty; `without` some columns."""
    columns = {name: _column(table, name) for name in table.columns if name not in without}
    return np.rec.fromarrays(list(columns.values()), dtype=[(name, column.dtype) for name, column in columns.items()])


def as_pandas(rows: np.ndarray) -> "pandas.DataFrame":
    """Rows as a data frame; UsageError if pandas is not installed."""
    try:
        import pandas
    except ImportError:
        raise UsageError("pandas is not installed", hint=INSTALL_FRAMES) from None
    return pandas.DataFrame({name: rows[name] for name in rows.dtype.names or ()})


def _column(table: Table, name: str) -> np.ndarray:
    if name in _TEXTS:
        return np.array(table.columns[name], dtype=str)
    if name not in _COUNTS:
        return table.numbers(name)
    return table.whole_numbers(name)


_FIRST_ROWS = 8
"""Rows shown in a notebook: enough to see what a table holds."""
_WIDTH_IN = 8.0
"""Width of a plot [inch]: that of a notebook page."""
_SHAPE = 0.75
"""Height over width of a plot of rows from an image of unknown size [1]."""
_COLOURS = ("#f07818", "#2f7fe0", "#27a05a", "#c8489a", "#8f63e8", "#b8901a")
"""Colours of the kinds of rows, distinct on grey images; further kinds begin again."""


@dataclass(frozen=True, slots=True)
class Backdrop:
    """Images behind the rows: their size for each camera, and previews by camera and frame."""

    sizes_px: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    pictures: Mapping[tuple[str, int], Path] = field(default_factory=dict)


class CorrespondenceRows(np.recarray):
    """Rows of the ground truth; columns are attributes, described in docs/outputs.md."""

    backdrop: Backdrop

    def __array_finalize__(self, parent: Any) -> None:
        """Keep the backdrop in every selection of rows."""
        super().__array_finalize__(parent)  # type: ignore[misc]  # NumPy states no type
        self.backdrop = getattr(parent, "backdrop", None) or Backdrop()

    @property
    def seen_by(self) -> np.ndarray:
        """Names of cameras as `Output.cameras` has them, with the channel where a sensor has channels, (n,) str."""
        if "channel" not in (self.dtype.names or ()):
            return np.asarray(self.camera)
        pairs = zip(self.camera.tolist(), self.channel.tolist(), strict=True)
        return np.array([name_with(camera, channel) if channel else camera for camera, channel in pairs], dtype=str)

    def plot(self, frame: int | None = None, camera: str | None = None, *, axes: Any = None) -> Any:
        """Plot positions over the image of their frame, one colour per target and type of microlens; returns the axes.

        `frame`: the frame to draw; by default all rows, those of several frames without an image.
        `camera`: its name, as `Rig.Camera` or `Rig.Camera@red`, where rows are of several.
        `axes`: those of matplotlib to draw on, by default of a new figure, in pixels: (0, 0) is the centre of the
        top-left one.
        UsageError if there are no such rows, or rows of several cameras, or if matplotlib is not installed.
        """
        rows = self._of_camera(camera)._of_frame(frame)
        name = str(rows.seen_by[0])
        frames = np.unique(rows.frame).tolist()
        size_px = rows.backdrop.sizes_px.get(name)
        shape = size_px[1] / size_px[0] if size_px else _SHAPE
        sheet = new_axes(_WIDTH_IN, _WIDTH_IN * shape) if axes is None else axes
        picture = rows.backdrop.pictures.get((name, frames[0])) if len(frames) == 1 else None
        if picture is not None:
            from pipeline.files.png import read_png

            sheet.imshow(read_png(picture), cmap="gray", vmin=0, vmax=255)
        for number, (kind, selected) in enumerate(rows._kinds()):
            x = rows.x_px[selected]
            y = rows.y_px[selected]
            colour = _COLOURS[number % len(_COLOURS)]
            sheet.plot(x, y, "+", color=colour, markersize=5, label=f"{kind}: {len(x)}")
        if size_px:
            sheet.set(xlim=(-0.5, size_px[0] - 0.5), ylim=(size_px[1] - 0.5, -0.5))
        title = f"frame {frames[0]}" if len(frames) == 1 else f"{len(frames)} frames"
        sheet.set(aspect="equal", xlabel="x [px]", ylabel="y [px]", title=f"{name}, {title}: {len(rows)} rows")
        sheet.legend(loc="upper right", fontsize="small")
        return sheet

    def _repr_html_(self) -> str:
        """The first rows, for a notebook."""
        names = self.dtype.names or ()
        more = f", the first {_FIRST_ROWS}" if len(self) > _FIRST_ROWS else ""
        return html_table(
            names, (row.item() for row in self[:_FIRST_ROWS]), f"{len(self):,} rows of correspondences{more}"
        )

    def _of_camera(self, camera: str | None) -> "CorrespondenceRows":
        if not len(self):
            raise UsageError("there are no rows to plot", hint="no target point is seen: look at an image of the frame")
        names = np.unique(self.seen_by).tolist()
        if camera is None and len(names) == 1:
            return self
        if camera not in names:
            mistake = "rows are of several cameras" if camera is None else f"no row is of a camera {camera!r}"
            hint = (did_you_mean(camera, names) if camera else None) or f"choose: {', '.join(names)}"
            raise UsageError(mistake, hint=hint)
        return self[self.seen_by == camera]

    def _of_frame(self, frame: int | None) -> "CorrespondenceRows":
        if frame is None:
            return self
        rows = self[self.frame == frame]
        if not len(rows):
            numbers = ", ".join(map(str, np.unique(self.frame).tolist()))
            raise UsageError(f"no row is of frame {frame!r}", hint=f"frames with rows: {numbers}")
        return rows

    def _kinds(self) -> Iterable[tuple[str, np.ndarray]]:
        """Row selections by target and, behind microlenses, by type."""
        for target in np.unique(self.target).tolist():
            selected = self.target == target
            if "microlens_type" not in (self.dtype.names or ()):
                yield target, selected
                continue
            for kind in np.unique(self.microlens_type[selected]).tolist():
                yield f"{target}, microlenses of type {kind}", selected & (self.microlens_type == kind)


def with_backdrop(rows: np.recarray, backdrop: Backdrop) -> CorrespondenceRows:
    """Rows with the images that they are plotted over."""
    over_backdrop = rows.view(CorrespondenceRows)
    over_backdrop.backdrop = backdrop
    return over_backdrop


def joined(parts: Sequence[CorrespondenceRows]) -> CorrespondenceRows:
    """Rows of several tables with all backdrops; UsageError if only some are plenoptic: their columns differ."""
    if len({part.dtype.names for part in parts}) > 1:
        raise UsageError(
            "tables of plenoptic and conventional cameras have different columns",
            hint="take those of one camera: output.cameras[NAME].correspondences",
        )
    sizes = dict[str, tuple[int, int]]()
    pictures = dict[tuple[str, int], Path]()
    for part in parts:
        sizes.update(part.backdrop.sizes_px)
        pictures.update(part.backdrop.pictures)
    rows = np.concatenate(parts).view(np.recarray) if parts else np.recarray(0, dtype=[])
    return with_backdrop(rows, Backdrop(sizes, pictures))
