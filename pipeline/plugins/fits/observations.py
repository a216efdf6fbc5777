"""Image positions that a detector found, from files of several programs, in our conventions.

No file says by itself what number the centre of the top-left pixel has, or which position a detector looks for, of a
corner or of a micro-image: both are stated, in the file or beside it, and never guessed.
"""

import gzip
import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self
from zipfile import BadZipFile

import numpy as np

from pipeline.errors import UsageError
from pipeline.files.damaged import DamagedFile
from pipeline.files.tables import Table, read_table

ORIGINS = {"0": 0.0, "0.5": 0.5, "1": 1.0}
"""Name -> number of the centre of the top-left pixel [px]."""
_WORDS = {
    "pixel_origin": tuple(ORIGINS),
    "position": ("exact", "saddle", "centroid", "chief"),
    "centres": ("centroid", "chief", "none"),
}
"""What is said of positions, and the words for it. Positions that detectors may find are that of the mean of rays, the
saddle of a corner's image, the centroid of a dot's, and that of the chief ray. What programs call the centre of a
micro-image is the centroid of its light, or the chief ray through its microlens; with `none` those of a file are left
out."""
_STATED = re.compile(rf"\s*({'|'.join(_WORDS)})\s*[:=]\s*(\S+)")
_NO_POINT = -1
"""Frame, and number of the point, of the centre of a micro-image."""
_MICROLENS = ("microlens_k", "microlens_l")
_LIBPLENO = [("k", "<i4"), ("l", "<i4"), ("x_px", "<f8", 2)]
_CORNER = [*_LIBPLENO, ("cluster", "<i4"), ("frame", "<i4")]
_FEATURE = [*_LIBPLENO, ("rho", "<f8"), ("cluster", "<i4"), ("frame", "<i4")]
_Columns = dict[str, Any]
"""Columns of `Observations` as a file has them: positions in its own pixels, no `sigma_px` where it says none, and no
`point_id` of centres."""


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

    `target` is empty where a file names none. `position`: the word for it, of a point or of a centre.
    `microlens`: k and l, or None where positions say which one it is. `file`, `line`: of the row, for errors; line 0 of
    a file without lines. `board_mm`: where on its board the program had the point, (n, 3), or None.
    """

    x_px: np.ndarray  # (n, 2)
    sigma_px: np.ndarray
    position: np.ndarray
    camera: np.ndarray
    frame: np.ndarray
    target: np.ndarray
    point_id: np.ndarray
    is_centre: np.ndarray
    file: np.ndarray
    line: np.ndarray
    microlens: np.ndarray | None = None
    board_mm: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.x_px)

    @classmethod
    def of(cls, x_px: np.ndarray, *, microlens: Any = None, board_mm: Any = None, **columns: Any) -> Self:
        """Observations at positions (n, 2); a column is (n,), or one value for all. Without points they are centres."""
        defaults = {"frame": _NO_POINT, "point_id": _NO_POINT, "target": "", "file": "", "line": 0}
        complete = {"is_centre": "point_id" not in columns, **defaults, **columns}
        broadcast = {name: np.broadcast_to(value, len(x_px)) for name, value in complete.items()}
        return cls(x_px=x_px, microlens=microlens, board_mm=board_mm, **broadcast)

    @property
    def kinds(self) -> str:
        """Positions that are observed, in words."""
        points, centres = (np.unique(self.position[self.is_centre == flag]).tolist() for flag in (False, True))
        return ", ".join([*points, *(f"{centre} of micro-images" for centre in centres)])

    def name(self, row: int) -> str:
        """A row in words."""
        camera = self.camera[row] or "the camera"
        if not self.is_centre[row]:
            return f"point {self.point_id[row]} in frame {self.frame[row]} of {camera}"
        if self.microlens is None:
            return f"the centre of a micro-image at ({self.x_px[row, 0]:g}, {self.x_px[row, 1]:g}) px of {camera}"
        return f"the centre of micro-image {tuple(self.microlens[row].tolist())} of {camera}"

    def error_at(self, row: int, message: str, hint: str | None = None) -> UsageError:
        """The error about a row, with the file and the line that it comes from."""
        location = f"{self.file[row]}:{self.line[row]}" if self.line[row] else f"{self.file[row]}"
        return UsageError(f"{location}: {message}", hint=hint)


def concatenated(parts: Sequence[Observations]) -> Observations:
    """Observations of several files, with microlenses if all have them; UsageError: two of them have the same."""
    columns: _Columns = {}
    for name in (column.name for column in fields(Observations)):
        of_parts = [getattr(part, name) for part in parts]
        columns[name] = None if any(column is None for column in of_parts) else np.concatenate(of_parts)
    observations = Observations(**columns)
    _require_once(observations)
    return observations


def read_observations(path: Path, stated: Stated) -> Observations:
    """Read a file of positions; what it is follows from its suffix.

    Raises UsageError: it is of no kind that is read, is damaged, or does not say what has to be said.
    """
    if path.is_dir():
        raise UsageError(f"{path} is a folder", hint="name the file of observations in it")
    reader = next((read for suffix, read in _READERS.items() if path.name.endswith(suffix)), None)
    if reader is None:
        hint = f"files that are read end in {', '.join(_READERS)}"
        raise UsageError(f"{path} is no file of observations", hint=hint)
    if not path.is_file():
        raise UsageError(f"there is no file {path}")
    try:
        words, parts = reader(path, stated)
    except DamagedFile as error:
        raise UsageError(error.message, hint="correct it; docs/how_to/calibrate.md has the layout") from error
    found = [_observations(path, stated, words, part) for part in parts if len(part["x_px"])]
    if not (kept := [part for part in found if part.position[0] != "none"]):
        raise UsageError(f"{path} holds no position")
    observations = concatenated(kept)
    sigma_px = observations.sigma_px
    for quantity, fault, is_right in (
        ("position", "is no number", np.isfinite(observations.x_px).all(axis=1)),
        ("sigma", "is not above 0", (sigma_px > 0) & np.isfinite(sigma_px)),
    ):
        if not is_right.all():
            row = int(is_right.argmin())
            message = f"the {quantity} of {observations.name(row)} {fault}"
            raise observations.error_at(row, message, hint="leave out what was not seen")
    return observations


def _observations(path: Path, stated: Stated, words: Mapping[str, str], columns: _Columns) -> Observations:
    """Columns of a file in our conventions, by what it says and what is stated beside it."""
    kind = "position" if "point_id" in columns else "centres"
    origin, position = (_word(path, stated, words, name) for name in ("pixel_origin", kind))
    columns = {"camera": stated.camera or "", "file": path, "position": position, **columns}
    if "sigma_px" not in columns:
        if stated.sigma_px is None:
            hint = "say --sigma PX: how far the detector may be off along x and y, one sigma"
            raise UsageError(f"{path} does not say how good its positions are", hint=hint)
        columns["sigma_px"] = stated.sigma_px * columns.pop("times_sigma", 1.0)
    return Observations.of(columns.pop("x_px") - ORIGINS[origin], **columns)


def _word(path: Path, stated: Stated, words: Mapping[str, str], name: str) -> str:
    """A word that a file has to say, or what is stated beside it; UsageError: neither says it, both say it differently,
    or it is none of those that are allowed.
    """
    option, beside = f"--{name.replace('_', '-')}", getattr(stated, name)
    if beside and words.get(name, beside) != beside:
        message = f"{path} says {name}: {words[name]}, and {option} says {beside}"
        raise UsageError(message, hint="one of them is wrong")
    word = beside or words.get(name, "")
    if word not in _WORDS[name]:
        message = f"{path} says {name}: {word}" if word else f"{path} does not say its {name}"
        hint = f"say {option} {'|'.join(_WORDS[name])}, or write '# {name}: …' above the header of a table"
        raise UsageError(message, hint=hint)
    return str(word)


def _require_once(observations: Observations) -> None:
    """UsageError: a point is twice in an image, or all positions of an image are those of another."""
    microlens = observations.x_px if observations.microlens is None else observations.microlens
    image = group_numbers(observations.camera, observations.frame)
    point = (observations.target, observations.point_id, *microlens.T)
    _, first_rows = np.unique(group_numbers(image, *point), return_index=True)
    if len(repeated := np.setdiff1d(np.arange(len(observations)), first_rows)):
        message = f"{observations.name(repeated[0])} is there twice"
        raise observations.error_at(repeated[0], message, "leave one of them out")
    content = group_numbers(observations.camera, *point, *observations.x_px.T)
    order = np.lexsort((content, image))
    first_row_of = dict[bytes, int]()
    for rows in np.split(order, np.flatnonzero(np.diff(image[order])) + 1):
        if (other := first_row_of.setdefault(content[rows].tobytes(), rows[0])) != rows[0]:
            frame, other_frame = observations.frame[rows[0]], observations.frame[other]
            message = f"frame {frame} has the positions of frame {other_frame} again"
            hint = "no two images are alike to the last digit: give each frame its own"
            raise observations.error_at(rows[0], message, hint)


def group_numbers(*columns: np.ndarray) -> np.ndarray:
    """A number for each row, the same where all columns hold the same, (n,)."""
    return np.unique(np.rec.fromarrays(columns), return_inverse=True)[1]


def _csv(path: Path, stated: Stated) -> tuple[dict[str, str], list[_Columns]]:
    """Our own table, of points or of centres."""
    table = read_table(path)
    of_points = ("frame", "point_id") if {"frame", "point_id"} & {*table.columns} else ()
    needed = (*of_points, "x_px", "y_px")
    if missing := [name for name in needed if name not in table.columns]:
        raise UsageError(f"{path} has no column {missing[0]}", hint=f"it needs {', '.join(needed)}, between commas")
    further = {*table.columns.get("camera", ())} - {stated.camera}
    if stated.camera and further:
        message = f"{path} has positions of {min(further) or 'no camera'}, and --camera says {stated.camera}"
        raise UsageError(message, hint="leave --camera out: the table names its cameras")
    columns: _Columns = {name: table.columns[name] for name in ("camera", "target") if name in table.columns}
    columns |= {name: table.whole_numbers(name) for name in of_points}
    columns["x_px"] = np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1)
    columns["line"] = table.line(0) + np.arange(len(columns["x_px"]))
    if _has_values(table, *_MICROLENS):
        columns["microlens"] = np.stack([table.whole_numbers(name) for name in _MICROLENS], axis=1)
    if _has_values(table, "sigma_px"):
        columns["sigma_px"] = table.numbers("sigma_px")
    return {match[1]: match[2] for line in table.comments if (match := _STATED.match(line))}, [columns]


def _has_values(table: Table, *names: str) -> bool:
    """Whether a table has these columns, and none of them is empty."""
    return all(any(table.columns.get(name, ())) for name in names)


def _npz(path: Path, _: Stated) -> tuple[dict[str, str], list[_Columns]]:
    """OpenCV: `image_points` and `object_points`, and, if they are there, the words `pixel_origin` and `position`, and
    of each view its number in `frames`, else from 1, and its name in `targets`.

    Of whole boards (f, n, 2), NaN of what is not seen, and (n, 3) or (f, n, 3); of parts all points one after the
    other, with `ids`, view i from starts[i] to starts[i + 1], as `pipeline export opencv` writes them.
    """
    arrays = _arrays(path)
    if missing := [name for name in ("image_points", "object_points") if name not in arrays]:
        raise UsageError(f"{path} has no array {missing[0]}", hint="docs/how_to/calibrate.md has its layout")
    try:
        image_px, board_mm, view, point_id = _points_of(arrays)
        frame = np.asarray(arrays["frames"], int)[view] if "frames" in arrays else view + 1
        target = np.asarray(arrays["targets"], str)[view] if "targets" in arrays else np.full(len(view), "")
    except (ValueError, TypeError, IndexError, KeyError):
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items() if array.ndim)
        hint = "(f, n, 2) and (n, 3), or all points one after the other with starts (f + 1,) and ids"
        raise UsageError(f"{path} has arrays that do not fit together: {shapes}", hint=hint) from None
    columns = {"x_px": image_px, "board_mm": board_mm, "frame": frame, "target": target, "point_id": point_id}
    is_observed = ~np.isnan(image_px).any(axis=1)
    words: dict[str, str] = {name: str(arrays[name]) for name in ("pixel_origin", "position") if name in arrays}
    return words, [{name: column[is_observed] for name, column in columns.items()}]


def _arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an archive of NumPy that hold observations."""
    names = ("image_points", "object_points", "starts", "ids", "frames", "targets", "pixel_origin", "position")
    try:
        with np.load(path) as data:
            return {name: data[name] for name in names if name in data.files}
    except (ValueError, OSError, EOFError, BadZipFile) as error:
        if "pickle" not in str(error):
            raise DamagedFile(path, f"no arrays of NumPy ({type(error).__name__})") from error
        hint = "write them one after the other: image_points=np.concatenate(image_points), object_points and ids alike,"
        hint += " starts=np.cumsum([0, *map(len, image_points)])"
        raise UsageError(f"{path} holds lists of arrays, which only a pickle can: it is not read", hint=hint) from error


def _points_of(arrays: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Positions in the image (n, 2) and on the board (n, 3), views and ids (n,) of the points of OpenCV's arrays."""
    image_px, board_mm = (np.asarray(arrays[name], float) for name in ("image_points", "object_points"))
    if "starts" in arrays:
        counts = np.diff(np.asarray(arrays["starts"], int))
        view = np.repeat(np.arange(len(counts)), counts)
        ids = np.asarray(arrays["ids"], int).reshape(len(view))
        return image_px.reshape(len(view), 2), board_mm.reshape(len(view), 3), view, ids
    image_px = image_px.reshape(len(image_px), -1, 2)
    view, ids = np.indices(image_px.shape[:2]).reshape(2, -1)
    board_mm = np.broadcast_to(board_mm.reshape(-1, image_px.shape[1], 3), (*image_px.shape[:2], 3))
    return image_px.reshape(-1, 2), board_mm.reshape(-1, 3), view, ids


def _vnl(path: Path, stated: Stated) -> tuple[dict[str, str], list[_Columns]]:
    """mrcal's corners: lines of file name, x, y and level, all points of a board, x fastest; "-" is one not seen.

    The frame is the last number in the name of the image, and a folder with a point in its name is that of a camera, as
    in `frames/0001/Rig.Camera/image.png`. Sigma grows by two with each level, as mrcal weighs it.
    """
    try:
        text = path.read_bytes().decode()
    except UnicodeDecodeError as error:
        raise DamagedFile(path, f"not a text file in UTF-8 ({error})") from error
    rows, points_before = [], Counter[str]()
    for number, line in enumerate(text.splitlines(), 1):
        if not (cells := line.split("#")[0].split()):
            continue
        image, folder = cells[0], Path(cells[0]).parent.name
        camera = folder if "." in folder.strip(".") else ""
        digits = re.findall(r"\d+", image.replace(camera, ""))
        if len(cells) < 3 or not digits:
            raise DamagedFile(path, "no file name with a number, x, y and level", line=number)
        points_before[image] += 1
        if cells[1] == "-":
            continue
        try:
            x, y, level = map(float, [*cells[1:4], "0"][:3])
        except ValueError:
            raise DamagedFile(path, f"no number in {line!r}", line=number) from None
        of_image = (number, stated.camera or camera, int(digits[-1]))
        rows.append((*of_image, points_before[image] - 1, (x, y), 2.0**level))
    names = ("line", "camera", "frame", "point_id", "x_px", "times_sigma")
    columns = zip(names, map(np.array, zip(*rows, strict=True)), strict=True)
    return {"pixel_origin": "0"}, [dict(columns)] if rows else []


def _libpleno(path: Path, _: Stated) -> tuple[dict[str, str], list[_Columns]]:
    """libpleno's observations: centres, then corners, then features with a blur radius. Its microlenses are numbered by
    its own grid: positions say which ones they are.
    """
    try:
        data = gzip.decompress(path.read_bytes())
        parts, first = [], 0
        for layout in (_LIBPLENO, _CORNER, _FEATURE):
            count = int.from_bytes(data[first : first + 8], "little")
            parts.append(np.frombuffer(data, layout, count, first + 8))
            first += 8 + count * np.dtype(layout).itemsize
    except (ValueError, OSError, EOFError, OverflowError, zlib.error) as error:
        raise DamagedFile(path, f"no observations of libpleno: {error}") from error
    centres, *of_points = parts
    points = {
        column: np.concatenate([part[name] for part in of_points])
        for column, name in (("x_px", "x_px"), ("frame", "frame"), ("point_id", "cluster"))
    }
    return {"pixel_origin": "0"}, [points, {"x_px": centres["x_px"]}]


_READERS = {".csv": _csv, ".npz": _npz, ".vnl": _vnl, ".bin.gz": _libpleno}
