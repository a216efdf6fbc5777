"""puzzlepaint camera_calibration: dataset.bin, integers big-endian and floats little-endian, as its code has them."""

import struct
from collections.abc import Iterator
from pathlib import Path

from pipeline.exports.errors import ExportError
from pipeline.exports.material import ExportTarget, Material

_MAGIC, _VERSION = b"calib_data", 0
"""Begin of the file, and the version that its reader knows."""


def write(material: Material, folder: Path) -> None:
    """Write dataset.bin.

    Raises
    ------
    ExportError
        A target is no grid of squares.
    """
    (folder / "dataset.bin").write_bytes(b"".join(_parts(material)))


def _parts(material: Material) -> Iterator[bytes]:
    first, known = 0, dict[str, int]()
    for target in material.targets:
        known[target.name] = first
        first += len(target.points)
    yield _MAGIC + _counts(_VERSION, len(material.cameras))
    for camera in material.cameras:
        yield _counts(*camera.size_px)
    frames = sorted({view.frame for view in material.views})
    yield _counts(len(frames))
    for frame in frames:
        name = f"{frame:04d}.png".encode()
        yield _counts(len(name)) + name
        for camera in material.cameras:
            views = [view for view in material.of(camera) if view.frame == frame]
            yield _counts(sum(len(view.observations.ids) for view in views))
            for view in views:
                found = view.observations
                for (x, y), point in zip(found.positions.tolist(), found.ids.tolist(), strict=True):
                    yield struct.pack("<ff", x, y) + struct.pack(">i", point + known[view.target])
    yield _counts(len(material.targets))
    for target in material.targets:
        yield from _geometry(target, known[target.name])


def _geometry(target: ExportTarget, first: int) -> Iterator[bytes]:
    grid = target.grid
    if grid is None:
        raise ExportError(f"this format knows points on a grid of squares, and {target.name} is a {target.kind}")
    if grid.step_mm is None:
        raise ExportError(f"this format knows grids of squares, and columns and rows of {target.name} differ")
    yield struct.pack("<f", grid.column_step) + _counts(len(target.points))
    for point in range(len(target.points)):
        row, column = divmod(point, grid.columns)
        yield struct.pack(">iii", first + point, column, row)


def _counts(*numbers: int) -> bytes:
    return struct.pack(f">{len(numbers)}I", *numbers)
