"""Files of observations: each says what it must, and what is damaged ends in an error that names the file."""

import gzip
import io
import random
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hostile.test_damage import damaged
from places import DATA
from plugins.fits.planted import narrow_stage

import pipeline
from pipeline.errors import UsageError
from pipeline.plugins.fits.association import associated
from pipeline.plugins.fits.observations import Stated, read_observations
from pipeline.scene.load import open_dataset

EVERYTHING = Stated(pixel_origin="0", position="exact", centres="centroid", sigma_px=0.1)
CSV = """# pixel_origin: 0
# position: exact
camera,frame,point_id,x_px,y_px,sigma_px
Rig.Camera,1,0,100.5,200.25,0.1
Rig.Camera,1,1,110.5,201.25,0.1
Rig.Camera,2,0,103.5,199.25,0.2
"""
VNL = "# filename x y level\nimages/0001.png 100.5 200.25 0\nimages/0001.png - - -\nimages/0002.png 103.5 199.25 1\n"


def libpleno(centres: list[tuple], corners: list[tuple], features: list[tuple]) -> bytes:
    """The layout of comsee-research/libpleno, pleno/geometry/observation.cpp: packed, little-endian, sizes before."""
    data = b""
    for layout, rows in (("<iidd", centres), ("<iiddii", corners), ("<iidddii", features)):
        data += struct.pack("<Q", len(rows)) + b"".join(struct.pack(layout, *row) for row in rows)
    return gzip.compress(data, mtime=0)


PLENO = libpleno(
    [(0, 0, 11.5, 12.5), (1, 0, 31.5, 12.5)], [(1, 0, 30.0, 14.0, 5, 2)], [(0, 0, 10.25, 13.0, -1.5, 4, 1)]
)


def arrays() -> bytes:
    file = io.BytesIO()
    image = np.array([[[100.5, 200.25], [110.5, 201.25]], [[103.5, 199.25], [np.nan, np.nan]]])
    np.savez(file, image_points=image, object_points=np.array([[0.0, 0, 0], [3, 0, 0]]))
    return file.getvalue()


FILES = {"a.csv": CSV.encode(), "a.vnl": VNL.encode(), "a.bin.gz": PLENO, "a.npz": arrays()}


def read(folder: Path, name: str, content: bytes | str, stated: Stated = EVERYTHING):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogateescape"))
    return read_observations(path, stated)


def test_observations_of_libpleno_are_read_with_their_centres(tmp_path):
    found = read(tmp_path, "a.bin.gz", PLENO)
    assert found.is_centre.tolist() == [False, False, True, True] and found.microlens is None
    assert found.position.tolist() == ["exact", "exact", "centroid", "centroid"]
    assert (found.frame[:2].tolist(), found.point_id[:2].tolist()) == ([2, 1], [5, 4])
    assert found.x_px.tolist() == [[30.0, 14.0], [10.25, 13.0], [11.5, 12.5], [31.5, 12.5]]
    assert len(read(tmp_path, "a.bin.gz", PLENO, Stated(position="exact", centres="none", sigma_px=0.1))) == 2
    with pytest.raises(UsageError, match="does not say its centres"):
        read(tmp_path, "a.bin.gz", PLENO, Stated(position="exact", sigma_px=0.1))
    with pytest.raises(UsageError, match="--pixel-origin says 1"):
        read(tmp_path, "a.bin.gz", PLENO, Stated(position="exact", centres="none", sigma_px=0.1, pixel_origin="1"))


@pytest.mark.parametrize(
    ("name", "content", "place", "said"),
    [
        ("a.txt", CSV, "", "is no file of observations"),
        ("a.csv", "", "", "the last line is cut off"),
        ("a.csv", CSV.replace(",", ";"), "", "has no column x_px"),
        ("a.csv", CSV.replace("x_px", "x"), "", "has no column x_px"),
        ("a.csv", CSV.replace("103.5,", ""), ":6", "5 cells where the header has 6"),
        ("a.csv", CSV.replace("103.5", "nan"), ":6", "the position of point 0 in frame 2 of Rig.Camera is no number"),
        ("a.csv", CSV.replace("103.5", ""), ":6", "the position of point 0 in frame 2 of Rig.Camera is no number"),
        ("a.csv", CSV.replace("103.5", "-inf"), ":6", "the position of point 0 in frame 2 of Rig.Camera is no number"),
        ("a.csv", CSV.replace("0.2\n", "inf\n"), ":6", "the sigma of point 0 in frame 2 of Rig.Camera is not above 0"),
        ("a.csv", CSV.replace("0.2\n", "-1\n"), ":6", "the sigma of point 0 in frame 2 of Rig.Camera is not above 0"),
        ("a.csv", CSV.replace("0.2\n", "\n"), ":6", "the sigma of point 0 in frame 2 of Rig.Camera is not above 0"),
        ("a.csv", CSV.replace("103.5", "far"), ":6", "x_px is 'far', no number"),
        ("a.csv", CSV.replace("a,2,0", "a,1e300,0"), ":6", "frame is '1e300', no whole number"),
        ("a.csv", CSV.replace("a,2,0", "a,2,"), ":6", "point_id is '', no whole number"),
        ("a.csv", CSV.replace("exact", "corner"), "", "says position: corner"),
        ("a.csv", CSV[: CSV.index("Rig")], "", "holds no position"),
        ("a.vnl", "", "", "holds no position"),
        ("a.vnl", VNL.replace("0001", "one"), ":2", "no file name with a number"),
        ("a.vnl", VNL.replace("103.5", "inf"), ":4", "the position of point 0 in frame 2 of the camera is no number"),
        ("a.npz", b"", "", "no arrays of NumPy"),
        ("a.npz", b"PK\x03\x04", "", "no arrays of NumPy"),
        ("a.bin.gz", b"", "", "no observations of libpleno"),
        ("a.bin.gz", gzip.compress(b"", mtime=0), "", "no observations of libpleno"),
        ("a.bin.gz", gzip.compress(struct.pack("<Q", 2**63), mtime=0), "", "no observations of libpleno"),
        ("a.bin.gz", gzip.compress(struct.pack("<QQQ", 0, 0, 0), mtime=0), "", "holds no position"),
    ],
)
def test_a_file_that_is_wrong_says_where(tmp_path, name, content, place, said):
    with pytest.raises(UsageError, match=said) as refused:
        read(tmp_path, name, content)
    assert refused.value.message.startswith(f"{tmp_path / name}{place}")


SEEN = """# pixel_origin: 0
# position: exact
camera,frame,target,point_id,x_px,y_px,sigma_px
Rig.Camera,1,Board,0,100.5,200.25,0.1
Rig.Camera,1,Board,1,110.5,201.25,0.1
Rig.Camera,2,Board,0,103.5,199.25,0.2
"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("Rig.Camera,2,Board,0", "Rig.Camara,2,Board,0", ":6: the dataset has no camera 'Rig.Camara'"),
        ("Rig.Camera,2,Board,0", "Rig.Camera,9,Board,0", ":6: the dataset has no frame 9"),
        ("Rig.Camera,2,Board,0", "Rig.Camera,2,Bord,0", ":6: the dataset has no target 'Bord'"),
        ("Rig.Camera,2,Board,0", "Rig.Camera,2,Board,28", ":6: Board has no point 28"),
        ("Rig.Camera,2,Board,0", "Rig.Camera,2,Board,-1", ":6: Board has no point -1"),
        ("Rig.Camera,2,Board,0", "Rig.Camera,1,Board,0", ":6: point 0 in frame 1 of Rig.Camera is there twice"),
        ("103.5", "1280.5", ":6: (1280.5, 199.25) px lies outside of the image of Rig.Camera, 640 x 480 px"),
        (",sigma_px", "", ":4: 7 cells where the header has 6"),
        (SEEN[SEEN.index("Rig.Camera,2") :], "", ":4: Board in frame 1 of Rig.Camera has 2 points"),
    ],
)
def test_a_table_that_does_not_fit_the_dataset_ends_in_one_sentence_with_its_line(run, tmp_path, old, new, said):
    (tmp_path / "a.csv").write_text(SEEN.replace(old, new), encoding="utf-8")
    code, output, log = run("calibrate", narrow_stage(tmp_path), "a.csv", "-o", "fitted.usda")
    first, *hints = log.strip().splitlines()
    assert (code, output) == (2, "") and first.startswith(f"error: a.csv{said}")
    assert len(hints) <= 1 and sorted(tmp_path.glob("fitted*")) == []


def test_what_export_opencv_writes_is_read_again(tmp_path, in_this_process, conventional_build):
    """Views of different lengths, in single precision."""
    assert in_this_process("export", "opencv", conventional_build, "-o", tmp_path / "out")[0] == 0
    found = read_observations(tmp_path / "out/opencv/Rig.Camera.npz", replace(EVERYTHING, sigma_px=1e-3))
    rows = pipeline.open_output(conventional_build).cameras["Rig.Camera"].correspondences
    expected = {(row.frame, row.point_id): (row.x_px, row.y_px) for row in rows}
    assert {*zip(found.frame.tolist(), found.point_id.tolist(), strict=True)} == expected.keys()
    for frame, point, x_px in zip(found.frame.tolist(), found.point_id.tolist(), found.x_px, strict=True):
        np.testing.assert_allclose(x_px, expected[frame, point], rtol=1e-6)
    assert len(associated(found, open_dataset(DATA / "tiny_conventional/dataset.usda"))) == len(expected)


def test_a_number_in_the_name_of_a_camera_is_no_frame(tmp_path):
    """Paths as `pipeline export mrcal` has them, whose file names have no number."""
    found = read(tmp_path, "a.vnl", VNL.replace("images/0001", "frames/0003/Left2.Camera/image"))
    assert [*zip(found.camera.tolist(), found.frame.tolist(), strict=True)] == [("Left2.Camera", 3), ("", 2)]


def test_lists_of_arrays_are_refused_with_what_to_write_instead(tmp_path):
    """As users of OpenCV keep what a detector found: one array per image, of different lengths."""
    lists = [np.zeros((4, 2)), np.zeros((3, 2))]
    np.savez(tmp_path / "a.npz", image_points=np.array(lists, object), object_points=np.array(lists, object))
    with pytest.raises(UsageError, match="only a pickle can") as refused:
        read_observations(tmp_path / "a.npz", EVERYTHING)
    assert "np.cumsum" in refused.value.hint


def test_a_folder_is_named_as_one(tmp_path):
    with pytest.raises(UsageError, match="is a folder"):
        read_observations(tmp_path, EVERYTHING)


def test_a_camera_that_a_table_names_is_not_replaced_in_silence(tmp_path):
    with pytest.raises(UsageError, match=r"has positions of Rig\.Camera, and --camera says Other"):
        read(tmp_path, "a.csv", CSV, Stated(position="exact", pixel_origin="0", camera="Other"))


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_read_or_refused_by_name(tmp_path, name):
    """Text with typing errors, bytes with others in their place or cut off."""
    refused, dice, whole = 0, random.Random(7), FILES[name]
    packed = gzip.decompress(whole) if name.endswith(".gz") else whole
    for seed in range(200):
        if name.endswith((".csv", ".vnl")):
            content = damaged(whole.decode(), seed).encode("utf-8", "replace")
        else:
            content = bytearray(packed)
            for _ in range(dice.choice([1, 4, 16])):
                content[dice.randrange(len(content))] = dice.randrange(256)
            content = bytes(content[: dice.choice([len(content), dice.randrange(len(content))])])
            content = gzip.compress(content) if name.endswith(".gz") else content
        try:
            found = read(tmp_path, name, content)
        except UsageError as error:
            refused += 1
            assert name in error.message and len(error.message) < 1000, seed
        else:
            assert len(found) and np.isfinite(found.x_px).all() and (found.sigma_px > 0).all(), seed
    assert refused > 20
