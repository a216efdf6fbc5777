"""Data frames: correspondences, poses and micro-images of each camera as Parquet."""

from pathlib import Path

from pipeline.exports.material import Material
from pipeline.exports.writers.npz import tables
from pipeline.formats import Board, Cameras, Format, Microlenses, Origin, Pose, Rotation, Unit
from pipeline.results.rows import write_parquet

FORMAT = Format(
    consumer="pandas, Polars, R and all else that reads Parquet",
    source="CONVENTIONS.md: nothing is converted",
    cameras=Cameras.ANY,
    files=("<camera>.correspondences.parquet", "<camera>.poses.parquet", "<plenoptic camera>.micro_images.parquet"),
    origin=Origin.ZERO,
    board=Board.OURS,
    pose=Pose.CAMERA_FROM_TARGET,
    rotation=Rotation.VECTOR,
    unit=Unit.MM,
    microlenses=Microlenses.AXIAL,
)


def write(material: Material, folder: Path) -> None:
    """Write the files; their metadata hold the remarks (`attrs` of the data frame).

    Raises
    ------
    UsageError
        pandas or pyarrow is not installed.
    """
    for name, rows in tables(material):
        write_parquet(folder / f"{name}.parquet", rows, material.remarks)
