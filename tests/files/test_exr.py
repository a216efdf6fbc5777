"""Pixels and numbers survive OpenEXR, and damage is noticed."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.files.damaged import DamagedFile
from pipeline.files.exr import Part, read_exr, read_foreign_exr, write_exr


def noise(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)


def test_parts_of_different_size_return_their_pixels(tmp_path: Path) -> None:
    """Moments are stored at K = 1 beside position images that are K times larger. Names are digests, without ending."""
    near = Part(name="near", channels={"X": noise(150, 290, 1), "Y": noise(150, 290, 2)})
    near.channels["X"][::3, 1::2] = np.nan
    near.channels["X"][0, :2] = np.inf, -np.inf
    moments = Part(name="moments", channels={"xn_xn": noise(50, 97, 3)})
    dot = Part(name="dot", channels={"Y": noise(1, 1, 4)})
    path = tmp_path / "a b ü" / "0a1b2c3d"
    path.parent.mkdir()
    write_exr(path, [moments, near, dot])
    parts = read_exr(path)
    assert list(parts) == ["moments", "near", "dot"]
    for part in (near, moments, dot):
        assert parts[part.name].shape == part.shape
        for name, pixels in part.channels.items():
            np.testing.assert_array_equal(parts[part.name].channels[name], pixels)


@pytest.mark.parametrize(
    "view",
    [
        lambda a: a.T,
        lambda a: a[::-1],
        lambda a: a[:, ::-1],
        lambda a: a[3:90:2, 5:77],
        lambda a: np.broadcast_to(a[0], (40, a.shape[1])),
        lambda a: np.stack([a, 2 * a], axis=-1)[..., 1],
        np.asfortranarray,
        lambda a: a.astype(">f4"),
        lambda a: a.astype(np.float64),
    ],
    ids=["transposed", "flipped", "mirrored", "sliced", "broadcast", "interleaved", "fortran", "big-endian", "double"],
)
def test_arrays_of_any_layout_are_written_as_they_look(tmp_path: Path, view) -> None:
    """OpenEXR reads the buffer behind an array and ignores its strides."""
    image = view(noise(140, 130))
    before = image.copy()
    write_exr(tmp_path / "x.exr", [Part(name="j", channels={"X": image})])
    np.testing.assert_array_equal(read_exr(tmp_path / "x.exr")["j"].channels["X"], before)
    np.testing.assert_array_equal(image, before)


def test_numbers_in_headers_keep_all_their_digits(tmp_path: Path) -> None:
    """OpenEXR itself would shrink 0.1 to float32 and turn 2**40 into 0."""
    attributes = {"z_mm": 0.1, "seed": 2**40, "far": np.float64(1 / 3), "open": math.inf, "unit": "µm", "note": ""}
    write_exr(tmp_path / "x.exr", [Part(name="near", channels={"X": noise(3, 4)}, attributes=attributes)])
    read = read_exr(tmp_path / "x.exr")["near"].attributes
    expected = {"z_mm": "0.1", "seed": "1099511627776", "far": repr(1 / 3), "open": "inf", "unit": "µm", "note": ""}
    assert read == expected
    assert float(read["far"]) == 1 / 3


WRITE_AND_DIGEST = """
import hashlib, sys, numpy as np
from pathlib import Path
from pipeline.files.exr import Part, write_exr
y, x = np.mgrid[:300, :200]
parts = [
    Part(name="near", channels=dict([("Y", y / 7), ("X", x / 7)][:: int(sys.argv[2])]), attributes={"z_mm": 0.1}),
    Part(name="moments", channels={"xn_xn": np.where(x > 9, x / 3, np.nan)}),
]
write_exr(sys.argv[1], parts)
print(hashlib.sha256(Path(sys.argv[1]).read_bytes()).hexdigest())
"""


def test_bytes_do_not_depend_on_the_machine_of_the_day(tmp_path: Path) -> None:
    """Neither on time zone, locale, hash seed, file name nor the order in which channels are listed."""
    digests = set()
    for name, order, zone, seed in (("a.exr", "1", "UTC", "1"), ("b", "-1", "Pacific/Kiritimati", "2")):
        env = {**os.environ, "TZ": zone, "PYTHONHASHSEED": seed, "LC_ALL": "C"}
        command = [sys.executable, "-c", WRITE_AND_DIGEST, str(tmp_path / name), order]
        digests.add(subprocess.run(command, env=env, check=True, capture_output=True, text=True).stdout)
    assert len(digests) == 1


@pytest.mark.parametrize(
    ("attribute", "byte"),
    [(b"dataWindow\0box2i\0", 8 + 2), (b"tiles\0tiledesc\0", 4 + 3)],
)
def test_a_damaged_size_costs_neither_memory_nor_time(tmp_path: Path, attribute: bytes, byte: int) -> None:
    """One flipped bit in the header must not ask for gigabytes before the file is found to be short."""
    path = tmp_path / "x.exr"
    write_exr(path, [Part(name="a", channels={"X": noise(30, 20)})])
    whole = path.read_bytes()
    place = whole.index(attribute) + len(attribute) + 4 + byte  # 4: the length of the value
    path.write_bytes(whole[:place] + bytes([16]) + whole[place + 1 :])
    with pytest.raises(DamagedFile, match="so short a file"):
        read_exr(path)


def test_a_folder_that_is_missing_is_no_bug_of_the_library(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_exr(tmp_path / "no folder" / "x", [Part(name="a", channels={"X": noise(2, 2)})])


def test_a_picture_that_is_cut_is_refused_and_nothing_is_printed_among_data(tmp_path, capsys) -> None:
    """OpenEXR's binding prints a warning to stdout, where `check --json` prints its object."""
    path = tmp_path / "x.exr"
    write_exr(path, [Part(name="a", channels={"Y": noise(200, 200)})])
    path.write_bytes(path.read_bytes()[:90_000])
    with pytest.raises(DamagedFile):
        read_foreign_exr(path, lambda values: None)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"channels": {"X": noise(2, 2), "Y": noise(2, 3)}}, "one shape"),
        ({"channels": {}}, "one shape"),
        ({"channels": {"X": noise(2, 2)}, "attributes": {"dataWindow": 3}}, "dataWindow"),
        ({"channels": {"X": noise(2, 2)}, "attributes": {"z_mm": [1.0]}}, "z_mm"),
    ],
)
def test_parts_that_no_file_can_hold_are_refused(part, message, tmp_path: Path) -> None:
    with pytest.raises((ValueError, TypeError), match=message):
        write_exr(tmp_path / "x", [Part(name="a", **part)])
    for parts in ([], [Part(name="a", channels={"X": noise(2, 2)})] * 2):
        with pytest.raises(ValueError, match="different names"):
            write_exr(tmp_path / "x", parts)
    assert not (tmp_path / "x").exists()
