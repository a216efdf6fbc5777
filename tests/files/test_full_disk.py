"""Every writer says of a disk that takes no more which error the system gave: the engine tells it from a bug by that.

A limit on the size of files stands for the disk.
"""

import errno
import resource

import numpy as np
import pytest

from pipeline.files.exr import Part, write_exr
from pipeline.files.jsonfile import write_json
from pipeline.files.npy import write_npy
from pipeline.files.png import write_png
from pipeline.files.tables import write_table

NOISE = np.random.default_rng(1).random((64, 64))

WRITERS = {
    "exr": lambda path: write_exr(path, [Part(name="a", channels={"Y": NOISE})]),
    "json": lambda path: write_json(path, NOISE.tolist()),
    "npy": lambda path: write_npy(path, NOISE),
    "png": lambda path: write_png(path, (NOISE * 255).astype(np.uint8)),
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
