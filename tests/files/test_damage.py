"""Images and arrays that were cut off or altered are noticed, or give what was written: libraries by themselves print a
warning at most, and hand out what they have.
"""

import numpy as np
import pytest

from pipeline.files.damaged import DamagedFile
from pipeline.files.exr import Part, read_exr, write_exr
from pipeline.files.npy import read_npy, write_npy
from pipeline.files.png import read_png, write_png
from pipeline.files.tiff import read_tiff, write_tiff

RAW = np.random.default_rng(5).integers(0, 65536, (37, 53)).astype(np.uint16)
NOISE = np.random.default_rng(0).normal(size=(30, 20)).astype(np.float32)
PARTS = [
    Part(name=name, channels={"X": NOISE[:rows]}, attributes={"z_mm": "0.1"}) for name, rows in (("a", 30), ("b", 9))
]


def parts_of(path):
    return [(name, part.attributes, part.channels["X"].tolist()) for name, part in read_exr(path).items()]


def raw_of(path):
    pixels, about = read_tiff(path)
    return pixels.tolist(), about


FORMATS = {
    "exr": (lambda path: write_exr(path, PARTS), parts_of),
    "npy": (lambda path: write_npy(path, RAW), lambda path: read_npy(path).tolist()),
    "png": (lambda path: write_png(path, RAW), lambda path: read_png(path).tolist()),
    "tiff": (lambda path: write_tiff(path, (3, 4), lambda first, end: RAW[first:end, :4], {"seed": 1}), raw_of),
}


@pytest.fixture(params=FORMATS)
def written(request, tmp_path):
    """A file, its bytes, and its reader."""
    write, read = FORMATS[request.param]
    write(tmp_path / "x")
    return tmp_path / "x", (tmp_path / "x").read_bytes(), read


def test_a_file_that_is_cut_off_is_noticed(written):
    path, whole, read = written
    last = len(whole) - 30 if read is FORMATS["png"][1] else len(whole) - 1  # a PNG ends without pixels
    for size in (*range(0, last, 7), last):
        path.write_bytes(whole[:size])
        with pytest.raises(DamagedFile, match=str(path)):
            read(path)
    path.unlink()
    with pytest.raises(FileNotFoundError):
        read(path)


@pytest.mark.parametrize(("written", "least"), [("exr", 0.9), ("png", 0.95), ("tiff", 0.0)], indirect=["written"])
def test_an_altered_file_never_gives_other_content(written, least):
    """Either the change is noticed, or it stood where nothing depends on it: a tag that no reader of ours asks."""
    (path, whole, read), noticed = written, 0
    content, places = read(path), range(0, len(whole), 11 if least else 1)
    for place in places:
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
        try:
            assert read(path) == content
        except DamagedFile:
            noticed += 1
    assert noticed > least * len(places)
