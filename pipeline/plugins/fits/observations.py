"""Image positions that a detector found, from files of several programs, in our conventions.

No file says by itself what number the centre of the top-left pixel has, or which position a detector looks for, of a
corner or of a micro-image: both are stated, in the file or beside it, and never guessed.
"""

import gzip
import re
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self
from zipfile import BadZipFile

import numpy as np

from pipeline.errors import UsageError
from pipeline.files.damaged import DamagedFile
from pipeline.files.tables import Table, read_table

POSITIONS = ("exact", "saddle", "centroid", "chief")
"""Image positions that detectors may find: that of the mean of rays, the saddle of a corner's image, the centroid of a
dot's, and that of the chief ray."""
CENTRES = ("centroid", "chief", "none")
"""Positions that programs call the centre of a micro-image: the centroid of its light, and the chief ray through its
microlens. With `none`, those of a file are left out."""
_LARGEST = 2**53
"""Number above which floats skip whole ones."""
_NO_POINT = -1
"""Frame, and number of the point, of the centre of a micro-image."""
ORIGINS = {"0": 0.0, "0.5": 0.5, "1": 1.0}
"""Name -> number of the centre of the top-left pixel [px]."""
_STATED = re.compile(r"\s*(pixel_origin|position|centres)\s*[:=]\s*(\S+)")
_MICROLENS = ("microlens_k", "microlens_l")
_LIBPLENO = [("k", "<i4"), ("l", "<i4"), ("u", "<f8"), ("v", "<f8")]
_CORNER = [*_LIBPLENO, ("cluster", "<i4"), ("frame", "<i4")]
_FEATURE = [*_LIBPLENO, ("rho", "<f8"), ("cluster", "<i4"), ("frame", "<i4")]
_FROM_ZERO = ("pixel_origin: 0",)
"""Remark that files imply whose format says what pixels count from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stated:
    """Facts about a file that are given beside it; None: the file has to say.

    `sigma_px`: error of positions along x and y, one sigma. `camera`: that of a file that names none.
    """

    pixel_origin: str | None = None
    position: str | None = None
    centres: str | None = None
    sigma_px: float | None = None
    camera: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """Image positions of points of targets and centres of micro-images, a row each; (0, 0) is the centre of the
    top-left pixel.

    `target` is empty where a file names none. `position`: one of `POSITIONS`, or for a centre of `CENTRES`.
    `microlens`: k and l, or None where positions say which one it is. `board_mm`: points of the board by id, as the
    program had them.
    """

    camera: np.ndarray
    frame: np.ndarray
    target: np.ndarray
    point_id: np.ndarray
    x_px: np.ndarray  # (n, 2)
    sigma_px: np.ndarray
    position: np.ndarray
    is_centre: np.ndarray
    microlens: np.ndarray | None = None
    board_mm: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.frame)

    @classmethod
    def of_points(cls, *, position: str, count: int, target: np.ndarray | None = None, **columns: Any) -> Self:
        """Positions of points, all of one kind."""
        return cls(
            target=np.full(count, "") if target is None else target,
            position=np.full(count, position),
            is_centre=np.zeros(count, bool),
            **columns,
        )

    @classmethod
    def of_centres(cls, *, position: str, count: int, **columns: Any) -> Self:
        """Centres of micro-images, all of one kind."""
        nowhere = np.full(count, _NO_POINT)
        return cls(
            frame=nowhere,
            target=np.full(count, ""),
            point_id=nowhere,
            position=np.full(count, position),
            is_centre=np.ones(count, bool),
            **columns,
        )

    @property
    def kinds(self) -> str:
        """Positions that are observed, in words."""
        points, centres = (np.unique(self.position[self.is_centre == flag]).tolist() for flag in (False, True))
        return ", ".join([*points, *(f"{each} of micro-images" for each in centres)])

    def name(self, row: int) -> str:
        """One of the rows, in words."""
        camera = self.camera[row] or "the camera"
        if not self.is_centre[row]:
            return f"point {self.point_id[row]} in frame {self.frame[row]} of {camera}"
        if self.microlens is None:
            return f"the centre of a micro-image at ({self.x_px[row, 0]:g}, {self.x_px[row, 1]:g}) px of {camera}"
        return f"the centre of micro-image {tuple(self.microlens[row].tolist())} of {camera}"


_COLUMNS = tuple(each.name for each in fields(Observations) if each.name != "board_mm")


def joined(parts: Sequence[Observations], where: str) -> Observations:
    """Observations of several files; UsageError: two of them have the same."""
    columns: dict[str, Any] = {}
    for name in _COLUMNS:
        of_parts = [getattr(part, name) for part in parts]
        columns[name] = None if of_parts[0] is None else np.concatenate(of_parts)
    found = Observations(**columns)
    _once(found, where)
    return found


def read_observations(path: Path, stated: Stated) -> Observations:
    """Read a file of positions; what it is follows from its suffix.

    Raises UsageError: it is of no kind that is read, is damaged, or does not say what has to be said.
    """
    reader = next((read for suffix, read in _READERS.items() if path.name.endswith(suffix)), None)
    if reader is None:
        hint = f"files that are read end in {', '.join(_READERS)}"
        raise UsageError(f"{path} is no file of observations", hint=hint)
    if not path.is_file():
        raise UsageError(f"there is no file {path}")
    try:
        found = reader(path, stated)
    except DamagedFile as error:
        raise UsageError(error.message, hint="correct it; docs/how_to/calibrate.md has the layout") from error
    if not len(found):
        raise UsageError(f"{path} holds no position")
    wrong = np.flatnonzero(~(np.isfinite(found.x_px).all(axis=1) & (found.sigma_px > 0) & np.isfinite(found.sigma_px)))
    if len(wrong):
        what = f"{path} has a position that is no number, or a sigma that is not above 0: {found.name(wrong[0])}"
        raise UsageError(what, hint="leave out what was not seen")
    _once(found, str(path))
    return found


def _once(found: Observations, where: str) -> None:
    """UsageError: a point is twice in an image, or all positions of an image are those of another."""
    microlens = np.zeros((len(found), 2), int) if found.microlens is None else found.microlens
    seen, images = dict[tuple, int](), dict[tuple, dict]()
    for row, (camera, frame, *rest) in enumerate(
        zip(found.camera, found.frame, found.target, found.point_id, *microlens.T, strict=True)
    ):
        place = (*found.x_px[row],) if found.microlens is None else ()
        if seen.setdefault((camera, frame, *rest, *place), row) != row:
            raise UsageError(f"{where} has {found.name(row)} twice", hint="leave one of them out")
        images.setdefault((camera, frame), {})[(*rest, *found.x_px[row])] = None
    first: dict[tuple, tuple] = {}
    for (camera, frame), content in images.items():
        other = first.setdefault((camera, *sorted(content)), (camera, frame))
        if other != (camera, frame):
            what = f"{where} has the positions of frame {other[1]} again as frame {frame}"
            raise UsageError(what, hint="no two images are alike to the last digit: give each frame its own")


def _settled(path: Path, stated: Stated, comments: tuple[str, ...], *names: str) -> dict[str, str]:
    """Words that a file has to say, of what it says and what is said of it."""
    said = {match[1]: match[2] for line in comments if (match := _STATED.match(line))}
    given = {"pixel_origin": stated.pixel_origin, "position": stated.position, "centres": stated.centres}
    allowed = {"pixel_origin": tuple(ORIGINS), "position": POSITIONS, "centres": CENTRES}
    for name in names:
        option, value = f"--{name.replace('_', '-')}", given[name]
        if value and said.get(name, value) != value:
            raise UsageError(
                f"{path} says {name}: {said[name]}, and {option} says {value}", hint="one of them is wrong"
            )
        said[name] = value or said.get(name, "")
        if said[name] not in allowed[name]:
            what = f"{path} says {name}: {said[name]}" if said[name] else f"{path} does not say its {name}"
            hint = f"say {option} {'|'.join(allowed[name])}, or write '# {name}: …' above the header of a table"
            raise UsageError(what, hint=hint)
    return said


def _sigma(path: Path, stated: Stated, count: int) -> np.ndarray:
    if stated.sigma_px is None:
        hint = "say --sigma PX: how far the detector may be off along x and y, one sigma"
        raise UsageError(f"{path} does not say how good its positions are", hint=hint)
    return np.full(count, stated.sigma_px)


def _csv(path: Path, stated: Stated) -> Observations:
    """Our own table, of points or of centres."""
    table = read_table(path)
    is_of_centres = not {"frame", "point_id"} & {*table.columns}
    kind = "centres" if is_of_centres else "position"
    wanted = ("x_px", "y_px") if is_of_centres else ("frame", "point_id", "x_px", "y_px")
    if missing := [name for name in wanted if name not in table.columns]:
        raise UsageError(f"{path} has no column {missing[0]}", hint=f"it needs {', '.join(wanted)}, between commas")
    said = _settled(path, stated, table.comments, "pixel_origin", kind)
    x_px = np.stack([_column(path, table, name) for name in ("x_px", "y_px")], axis=1) - ORIGINS[said["pixel_origin"]]
    has_microlens, count = _has(table, *_MICROLENS), len(x_px)
    camera = _texts(table, "camera", stated.camera, count)
    if stated.camera and (further := {*camera.tolist()} - {stated.camera}):
        what = f"{path} has positions of {min(further) or 'no camera'}, and --camera says {stated.camera}"
        raise UsageError(what, hint="leave --camera out: the table names its cameras")
    columns = {
        "camera": camera,
        "x_px": x_px,
        "sigma_px": _column(path, table, "sigma_px") if _has(table, "sigma_px") else _sigma(path, stated, count),
        "microlens": np.stack([_whole(path, table, name) for name in _MICROLENS], axis=1) if has_microlens else None,
    }
    if is_of_centres:
        return Observations.of_centres(position=said[kind], count=count, **columns)
    columns |= {name: _whole(path, table, name) for name in ("frame", "point_id")}
    target = _texts(table, "target", None, count)
    return Observations.of_points(position=said[kind], count=count, target=target, **columns)


def _has(table: Table, *names: str) -> bool:
    return all(any(table.columns.get(name, ())) for name in names)


def _texts(table: Table, name: str, instead: str | None, count: int) -> np.ndarray:
    return np.array(table.columns.get(name) or [instead or ""] * count, dtype=str)


def _column(path: Path, table: Table, name: str) -> np.ndarray:
    try:
        return table.numbers(name)
    except ValueError as error:
        raise DamagedFile(path, f"column {name}: {error}") from None


def _whole(path: Path, table: Table, name: str) -> np.ndarray:
    values = _column(path, table, name)
    if not (values == np.round(values)).all() or not (np.abs(values) < _LARGEST).all():
        raise DamagedFile(path, f"column {name} holds something that is no whole number")
    return values.astype(np.int64)


def _npz(path: Path, stated: Stated) -> Observations:
    """OpenCV: `image_points` (f, n, 2), NaN of what is not seen, `object_points` (n, 3) or (f, n, 3); if they are
    there, `ids` (n,), `frames` (f,), and the words `pixel_origin` and `position`.
    """
    try:
        with np.load(path) as data:
            arrays = {name: data[name] for name in data.files}
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        raise DamagedFile(path, f"no arrays of NumPy ({type(error).__name__})") from error
    if missing := [name for name in ("image_points", "object_points") if name not in arrays]:
        raise UsageError(f"{path} has no array {missing[0]}", hint="docs/how_to/calibrate.md has its layout")
    words = (f"{name}: {arrays[name]}" for name in ("pixel_origin", "position") if name in arrays)
    said = _settled(path, stated, tuple(words), "pixel_origin", "position")
    try:
        image = np.asarray(arrays["image_points"], float)
        image = image.reshape(len(image), -1, 2)
        count = image.shape[1]
        board = np.asarray(arrays["object_points"], float).reshape(-1, count, 3)
    except (ValueError, TypeError):
        shapes = ", ".join(f"{name} {arrays[name].shape}" for name in ("image_points", "object_points"))
        raise UsageError(f"{path} has arrays that do not fit together: {shapes}", hint="(f, n, 2) and (n, 3)") from None
    ids = np.asarray(arrays.get("ids", np.arange(count)), int).ravel()
    frames = np.asarray(arrays.get("frames", np.arange(1, len(image) + 1)), int).ravel()
    if len(ids) != count or len(frames) != len(image) or not (board == board[:1]).all():
        raise UsageError(f"{path} has arrays of different lengths, or several boards")
    frame, point = np.nonzero(np.isfinite(image).all(axis=2))
    points = np.full((ids.max() + 1, 3), np.nan)
    points[ids] = board[0]
    return Observations.of_points(
        position=said["position"],
        count=len(frame),
        camera=np.full(len(frame), stated.camera or ""),
        frame=frames[frame],
        point_id=ids[point],
        x_px=image[frame, point] - ORIGINS[said["pixel_origin"]],
        sigma_px=_sigma(path, stated, len(frame)),
        board_mm=points,
    )


def _vnl(path: Path, stated: Stated) -> Observations:
    """mrcal's corners: lines of file name, x, y and level, all points of a board, x fastest; "-" is one not seen.

    The frame is the last number in the name of the image, and sigma grows by two with each level, as mrcal weighs it.
    """
    said = _settled(path, stated, _FROM_ZERO, "pixel_origin", "position")
    rows, count = list[tuple[str, int, int, float, float, float]](), dict[str, int]()
    try:
        text = path.read_bytes().decode()
    except UnicodeDecodeError as error:
        raise DamagedFile(path, f"not a text file in UTF-8 ({error})") from error
    for number, line in enumerate(text.splitlines(), 1):
        cells = line.split("#")[0].split()
        if not cells:
            continue
        name, point = cells[0], count.get(cells[0], 0)
        count[name] = point + 1
        digits = re.findall(r"\d+", name)
        if len(cells) < 3 or not digits:
            raise DamagedFile(path, "no file name with a number, x, y and level", line=number)
        if cells[1] == "-":
            continue
        try:
            x, y, level = float(cells[1]), float(cells[2]), float(cells[3]) if len(cells) > 3 else 0.0
        except ValueError:
            raise DamagedFile(path, f"no number in {line!r}", line=number) from None
        parts = Path(name).parts
        camera = stated.camera or (parts[-2] if len(parts) > 1 and "." in parts[-2] else "")
        rows.append((camera, int(digits[-1]), point, x, y, 2.0**level))
    cameras, frames, points, xs, ys, scale = zip(*rows, strict=True) if rows else [()] * 6
    return Observations.of_points(
        position=said["position"],
        count=len(rows),
        camera=np.array(cameras, str),
        frame=np.array(frames, int),
        point_id=np.array(points, int),
        x_px=np.stack([xs, ys], axis=1).reshape(-1, 2) - ORIGINS[said["pixel_origin"]],
        sigma_px=_sigma(path, stated, len(rows)) * np.array(scale),
    )


def _libpleno(path: Path, stated: Stated) -> Observations:
    """libpleno's observations: centres, then corners, then features with a blur radius. Its microlenses are numbered by
    its own grid: positions say which ones they are.
    """
    try:
        data, parts, first = gzip.decompress(path.read_bytes()), [], 0
        for kind in (_LIBPLENO, _CORNER, _FEATURE):
            count, size = int.from_bytes(data[first : first + 8], "little"), np.dtype(kind).itemsize
            parts.append(np.frombuffer(data, kind, count, first + 8))
            first += 8 + count * size
    except (ValueError, OSError, EOFError, OverflowError, zlib.error) as error:
        raise DamagedFile(path, f"no observations of libpleno: {error}") from error
    centres, *points = parts
    rows = np.concatenate([part[[name for name, _ in _CORNER]].astype(_CORNER) for part in points])
    names = [name for name, each in (("position", rows), ("centres", centres)) if len(each)]
    said = _settled(path, stated, _FROM_ZERO, "pixel_origin", *names)
    centres = centres[:0] if said.get("centres") == "none" else centres
    observed: list[dict[str, Any]] = [
        {
            "count": len(each),
            "camera": np.full(len(each), stated.camera or ""),
            "x_px": np.stack([each["u"], each["v"]], axis=1) - ORIGINS[said["pixel_origin"]],
            "sigma_px": _sigma(path, stated, len(each)),
        }
        for each in (rows, centres)
    ]
    observed[0] |= {"frame": rows["frame"].astype(int), "point_id": rows["cluster"].astype(int)}
    both = (
        Observations.of_points(position=said.get("position", ""), **observed[0]),
        Observations.of_centres(position=said.get("centres", ""), **observed[1]),
    )
    return joined(both, str(path))


_READERS: dict[str, Callable[[Path, Stated], Observations]] = {
    ".csv": _csv,
    ".npz": _npz,
    ".vnl": _vnl,
    ".bin.gz": _libpleno,
}
