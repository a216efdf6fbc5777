"""mrcal: corners.vnl, and a .cameramodel per camera.

The reference frame of the models is the first camera. File names of images are those below the output folder, so a glob
per camera is `frames/*/<camera>/image.png`; the images need not be there when --imagersize is given.
"""

from collections.abc import Iterator
from pathlib import Path

from pipeline.exports.material import ExportCamera, ExportView, Grid, Material
from pipeline.formats import Cameras, Centre, Format, Origin, Pose, Rotation, Targets, Unit

FORMAT = Format(
    consumer="mrcal",
    note="LENSMODEL_OPENCV5",
    source="proof: mrcal 2.2 of Debian calibrates from the corners and reads the models",
    cameras=Cameras.CONVENTIONAL,
    targets=Targets.BOARD,
    files=("corners.vnl", "<camera>.cameramodel"),
    origin=Origin.ZERO,
    pose=Pose.CAMERA_FROM_FIRST,
    centre=Centre.FITTED_TO_ROWS,
    rotation=Rotation.VECTOR,
    unit=Unit.M,
)

_LEVEL = 0
"""Decimation level of a corner: its weight is 2 to the power of minus this, so 1."""


def write(material: Material, folder: Path) -> None:
    """Write both kinds of files."""
    board = material.board
    lines = [
        "# mrcal-calibrate-cameras --corners-cache corners.vnl --lensmodel LENSMODEL_OPENCV5 --focal PIXELS",
        f"#   --object-spacing {board.column_step!r} --object-width-n {board.columns} --object-height-n {board.rows}",
        "#   --imagersize WIDTH HEIGHT 'frames/*/CAMERA/image.png' (a glob per camera)",
        "# filename x y level",
    ]
    lines += [line for view in material.views for line in _corners(view, board)]
    material.write_text(folder / "corners.vnl", lines)
    for camera in material.cameras:
        material.write_text(folder / f"{camera.name}.cameramodel", _model(camera))


def _corners(view: ExportView, board: Grid) -> Iterator[str]:
    """All rows of an image, x fastest; a point without an observation keeps its row."""
    observations = view.observations
    if not len(observations.ids):
        yield f"{view.image} - - -"
        return
    position_of = dict(zip(observations.ids.tolist(), observations.positions.tolist(), strict=True))
    for number in range(board.columns * board.rows):
        cells = (
            [repr(coordinate) for coordinate in position_of[number]] + [str(_LEVEL)]
            if number in position_of
            else ["-"] * 3
        )
        yield " ".join([view.image, *cells])


def _model(camera: ExportCamera) -> Iterator[str]:
    """A Python literal: the reader evaluates it."""
    assert camera.pose is not None
    yield "{"
    yield "    'lensmodel':  'LENSMODEL_OPENCV5',"
    yield "    # fx, fy, cx, cy, k1, k2, p1, p2, k3"
    yield f"    'intrinsics': {camera.opencv!r},"
    yield "    # camera from the first camera: Rodrigues vector, translation in m; both keys, for old and new versions"
    yield f"    'rt_cam_ref': {camera.pose.numbers!r},"
    yield f"    'extrinsics': {camera.pose.numbers!r},"
    yield f"    'imagersize': {list(camera.size_px)!r},"
    yield "}"
