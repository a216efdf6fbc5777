"""HDF5: the tables of the formats npz and parquet, a group each with a dataset per column, and camera.json, one file
per camera.
"""

from dataclasses import replace
from pathlib import Path

from pipeline.exports.material import Material
from pipeline.files.jsonfile import json_bytes
from pipeline.formats import ExportError
from pipeline.plugins.formats import npz

FORMAT = replace(
    npz.FORMAT,
    consumer="h5py, h5read of MATLAB, R, Julia and all else that reads HDF5",
    note="a dataset per column below correspondences, poses and micro_images; /camera is camera.json",
    source="run: h5py 3.16",
    files=("<camera>.h5",),
)


def write(material: Material, folder: Path) -> None:
    """Write a file per camera; an attribute holds the remarks."""
    try:
        import h5py
    except ImportError:
        raise ExportError("h5py is not installed", hint='pip install "plenoptic-pipeline[hdf5]"') from None
    text = h5py.string_dtype()
    for camera in material.cameras:
        with h5py.File(folder / f"{camera.name}.h5", "w") as file:
            file.attrs.create("remarks", list(material.remarks), dtype=text)
            file.create_dataset("camera", data=json_bytes(camera.built.record), dtype=text)
    for name, rows in npz.tables(material):
        camera_name, _, table = name.rpartition(".")
        with h5py.File(folder / f"{camera_name}.h5", "a") as file:
            for column in rows.dtype.names or ():
                values = rows[column]
                if values.dtype.kind == "U":
                    values = values.astype(text)
                file.create_dataset(f"{table}/{column}", data=values)
