"""JSON files keep the author's order and every digit."""

import math
from pathlib import Path

import numpy as np
import pytest

from pipeline.files.damaged import DamagedFile
from pipeline.files.jsonfile import read_json, write_json


def test_the_file_is_exactly_this(tmp_path: Path) -> None:
    value = {"z": 0.1, "a": [1, np.float64(2.5)], "pose": np.eye(2), "none": [], "far": math.inf}
    write_json(tmp_path / "x", {**value, "lens": {"name": "f/2 µ", "n": None}})
    assert (tmp_path / "x").read_bytes() == (
        '{\n  "z": 0.1,\n  "a": [1, 2.5],\n  "pose": [\n    [1.0, 0.0],\n    [0.0, 1.0]\n  ],\n  "none": [],\n'
        '  "far": "inf",\n'
        '  "lens": {\n    "name": "f/2 µ",\n    "n": null\n  }\n}\n'
    ).encode()


def test_values_return(tmp_path: Path) -> None:
    value = {"x": 1 / 3, "tiny": 5e-324, "n": 2**60, "on": True, "pose": np.eye(2), "t": (1, 2), "k": np.int32(3)}
    write_json(tmp_path / "x", value)
    expected = {"x": 1 / 3, "tiny": 5e-324, "n": 2**60, "on": True, "pose": [[1, 0], [0, 1]], "t": [1, 2], "k": 3}
    assert read_json(tmp_path / "x") == expected


@pytest.mark.parametrize("nan", [math.nan, np.float32(math.nan), np.array([1.0, math.nan])])
def test_nan_is_refused_with_its_place(tmp_path: Path, nan: object) -> None:
    with pytest.raises(ValueError, match=r"\$\.lens\[0\]\.efl_mm"):
        write_json(tmp_path / "x", {"lens": [{"efl_mm": nan}]})
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize("value", [{1: 2}, {"a": object()}, {"a": {1, 2}}])
def test_what_json_cannot_hold_is_refused(tmp_path: Path, value: object) -> None:
    with pytest.raises(TypeError, match=r"\$"):
        write_json(tmp_path / "x", value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{\n"a": 1,\n', r"x\.json:\d: not JSON"),
        (b"\xff", "not JSON"),
        (b'{"a": NaN}', "NaN"),
        (b"", "not JSON"),
        (b"[" * 100_000, "deeply"),
    ],
)
def test_damage_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "x.json").write_bytes(content)
    with pytest.raises(DamagedFile, match=message):
        read_json(tmp_path / "x.json")
