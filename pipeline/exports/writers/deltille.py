"""Deltille and BabelCalib: corners of an image as .orpc, the board as .dsc."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.exports.filestorage import real
from pipeline.exports.material import ExportView, Material

_BOARD, _ORDERED, _NO_TAG = 0, 1, -1
"""Number of the only board; whether its points are in order; a node that no tag stands at."""


def write(material: Material, folder: Path) -> None:
    """Write a file per image, and one of the board.

    Raises
    ------
    ExportError
        The target is no grid of squares.
    """
    (folder / "board.dsc").write_text("\n".join([*_board(material), ""]), encoding="utf-8")
    for camera in material.cameras:
        (folder / camera.name).mkdir()
        for view in material.of(camera):
            text = "\n".join([*_corners(view, camera.size_px), ""])
            (folder / camera.name / f"{view.frame:04d}.orpc").write_text(text, encoding="utf-8")


def _corners(view: ExportView, size_px: tuple[int, int]) -> Iterator[str]:
    """Five lines of a head, which has no place for comments, then a line per corner."""
    found = view.observations
    yield f"filename: {view.image}"
    yield f"width: {size_px[0]}"
    yield f"height: {size_px[1]}"
    yield f"num_corners: {len(found.ids)}"
    yield "encoding: ascii"
    for (x, y), point in zip(found.positions.tolist(), found.ids.tolist(), strict=True):
        yield f"{_BOARD},{point},{_ORDERED},{x!r},{y!r}"


def _board(material: Material) -> Iterator[str]:
    """Columns and rows of squares, then a node per line from the top row down, whose row counts from the bottom."""
    grid, points = material.board, material.only_target.points
    yield f"{_BOARD},{grid.columns + 1},{grid.rows + 1},{real(grid.square_mm)}"
    yield "t36h11,1"
    for point, place in enumerate(points.tolist()):
        row, column = divmod(point, grid.columns)
        yield ",".join([str(_NO_TAG), str(column), str(grid.rows - 1 - row), *map(real, place)])
