"""Arrays between tasks: the right numbers or DamagedFile, and nothing allocated on a header's word."""

import contextlib
import time

import numpy as np
import pytest

from pipeline.files.damaged import DamagedFile
from pipeline.files.npy import read_npy, write_npy


@pytest.fixture
def array(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.arange(12.0).reshape(3, 4))
    return path


@pytest.mark.parametrize("turn", [np.asarray, np.transpose, np.flipud])
def test_files_are_those_of_numpy(tmp_path, turn):
    array = turn(np.arange(12, dtype=np.int32).reshape(3, 4))
    write_npy(tmp_path / "ours", array)
    np.save(tmp_path / "theirs.npy", np.ascontiguousarray(array))
    assert (tmp_path / "ours").read_bytes() == (tmp_path / "theirs.npy").read_bytes()
    assert np.array_equal(read_npy(tmp_path / "ours"), array)


@pytest.mark.filterwarnings("ignore:invalid escape")
def test_a_header_with_any_byte_changed_is_damaged_or_means_another_array(array):
    whole = bytearray(array.read_bytes())
    for place in range(10, 70):
        for byte in b"('\"{\\":
            array.write_bytes(whole[:place] + bytes([byte]) + whole[place + 1 :])
            with contextlib.suppress(DamagedFile):
                assert read_npy(array).size == 12


@pytest.mark.parametrize("shape", [(10**6, 10**6), (-1, 12), (2**62, 8)])
def test_a_header_that_promises_too_much_costs_nothing(tmp_path, shape):
    path = tmp_path / "bomb.npy"
    with path.open("wb") as stream:
        header = {"descr": "<f8", "fortran_order": False, "shape": shape}
        np.lib.format.write_array_header_1_0(stream, header)
        stream.write(bytes(64))
    start = time.process_time()
    with pytest.raises(DamagedFile, match="promises"):
        read_npy(path)
    assert time.process_time() - start < 1
