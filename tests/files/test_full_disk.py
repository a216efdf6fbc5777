"""Every writer says of a disk that takes no more which error the system gave: the engine tells it from a bug by that.

A limit on the size of files stands for the disk.
"""

import errno
import os
import resource

import numpy as np
import pytest

from pipeline.files import exr_bands
from pipeline.files.exr import Part, write_exr
from pipeline.files.exr_bands import BandedPart, write_bands
from pipeline.files.jsonfile import write_json
from pipeline.files.npy import write_npy
from pipeline.files.png import write_png
from pipeline.files.tables import write_table
from pipeline.files.tiff import write_tiff

NOISE = np.random.default_rng(1).random((64, 64))

BANDED = BandedPart(name="a", shape=NOISE.shape, channels=("Y",), rows=lambda first, end: NOISE[first:end])
WRITERS = {
    "bands": lambda path: write_bands(path, [BANDED]),
    "exr": lambda path: write_exr(path, [Part(name="a", channels={"Y": NOISE})]),
    "json": lambda path: write_json(path, NOISE.tolist()),
    "npy": lambda path: write_npy(path, NOISE),
    "png": lambda path: write_png(path, (NOISE * 255).astype(np.uint8)),
    "tiff": lambda path: write_tiff(path, NOISE.shape, lambda first, end: NOISE[first:end].astype(np.uint16), {}),
    "table": lambda path: write_table(path, ["head"], {"x": NOISE.ravel()}),
}


@pytest.mark.parametrize("limit_bytes", [0, 100, 2000])
@pytest.mark.parametrize("kind", WRITERS)
def test_a_writer_names_the_error_of_the_system(kind, limit_bytes, tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, before[1]))
    try:
        with pytest.raises(OSError) as caught:
            WRITERS[kind](tmp_path / "file")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.errno == errno.EFBIG
    WRITERS[kind](tmp_path / "file")
    assert (tmp_path / "file").stat().st_size > 2000


def test_a_library_that_loses_the_error_of_a_full_disk_is_found_out(tmp_path, monkeypatch):
    """OpenEXR drops it where it comes only when the file is closed: the file is cut, and nothing is said."""
    real = exr_bands.write_exr

    def cut(path, parts):
        real(path, parts)
        os.truncate(path, 100)
        resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    monkeypatch.setattr(exr_bands, "write_exr", cut)
    try:
        with pytest.raises(OSError) as caught:
            WRITERS["bands"](tmp_path / "file")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.errno == errno.EFBIG
