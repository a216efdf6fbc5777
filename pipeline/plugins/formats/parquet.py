"""Data frames: correspondences, poses and micro-images of each camera as Parquet."""

from dataclasses import replace
from pathlib import Path

from pipeline.exports.material import Material
from pipeline.plugins.formats import npz
from pipeline.results.rows import write_parquet

FORMAT = replace(
    npz.FORMAT,
    consumer="pandas, Polars, R and all else that reads Parquet",
    note="",
    files=tuple(file.replace(".npz", ".parquet") for file in npz.FORMAT.files),
)


def write(material: Material, folder: Path) -> None:
    """Write the files; their metadata hold the remarks (`attrs` of the data frame)."""
    for name, rows in npz.tables(material):
        write_parquet(folder / f"{name}.parquet", rows, material.remarks)
