"""Data frames: correspondences, poses and micro-images of each camera as Parquet."""

from dataclasses import replace
from pathlib import Path

from pipeline.errors import UsageError
from pipeline.exports.material import Material
from pipeline.plugins.formats import npz
from pipeline.results.rows import INSTALL_FRAMES, as_pandas

FORMAT = replace(
    npz.FORMAT,
    consumer="pandas, Polars, R and all else that reads Parquet",
    note="",
    files=tuple(file.replace(".npz", ".parquet") for file in npz.FORMAT.files),
)


def write(material: Material, folder: Path) -> None:
    """Write the files; their metadata hold the remarks (`attrs` of the data frame).

    Raises UsageError: pandas or pyarrow is not installed.
    """
    for name, rows in npz.tables(material):
        frame = as_pandas(rows)
        frame.attrs["remarks"] = list(material.remarks)
        try:
            frame.to_parquet(folder / f"{name}.parquet", engine="pyarrow", index=False)
        except ImportError:
            raise UsageError("pyarrow is not installed", hint=INSTALL_FRAMES) from None
