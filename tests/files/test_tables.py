"""A table says what is known, exactly, and leaves empty what is not."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.files.damaged import DamagedFile
from pipeline.files.tables import read_table, write_table


def test_the_file_is_exactly_this(tmp_path: Path) -> None:
    columns = {
        "frame": np.array([0, 1, 2]),
        "camera": ["Rig.Left", "a,b", 'say "x"'],
        "x_px": np.array([0.1, np.nan, -0.5]),
        "microlens_k": [None, -3, np.int64(7)],
        "y_px": [None, np.float64(1 / 3), math.nan],
        "complete": [True, False, np.True_],
    }
    write_table(tmp_path / "t.csv", ["Ground truth", "units: px, µm", ""], columns)
    assert (tmp_path / "t.csv").read_bytes() == (
        "# Ground truth\n# units: px, µm\n#\n"
        "frame,camera,x_px,microlens_k,y_px,complete\n"
        "0,Rig.Left,0.1,,,1\n"
        '1,"a,b",,-3,0.3333333333333333,0\n'
        '2,"say ""x""",-0.5,7,,1\n'
    ).encode()


def test_it_reads_back(tmp_path: Path) -> None:
    write_table(tmp_path / "t", ["title"], {"name": ["a,b", "#c", " d", "e\nf", ""], "x": [1, None, 0.1, math.inf, 0]})
    table = read_table(tmp_path / "t")
    assert table.comments == ("title",)
    assert table.columns == {"name": ["a,b", "#c", " d", "e\nf", ""], "x": ["1", "", "0.1", "inf", "0"]}
    np.testing.assert_array_equal(table.numbers("x"), [1, np.nan, 0.1, np.inf, 0])


def test_a_cell_that_is_no_number_is_named_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "t").write_text("# title\nx,k\n1.5,2\n1.5e,2.5\n", encoding="utf-8")
    table = read_table(tmp_path / "t")
    with pytest.raises(DamagedFile, match=r"t:4: x is '1\.5e', no number"):
        table.numbers("x")
    with pytest.raises(DamagedFile, match=r"t:4: k is '2\.5', no whole number"):
        table.whole_numbers("k")


def test_a_lone_column_keeps_its_unknown_rows(tmp_path: Path) -> None:
    """A blank line would not count as a row."""
    write_table(tmp_path / "t", [], {"x": [1.5, None, 2.5]})
    np.testing.assert_array_equal(read_table(tmp_path / "t").numbers("x"), [1.5, np.nan, 2.5])


def test_a_table_without_rows_keeps_its_columns(tmp_path: Path) -> None:
    write_table(tmp_path / "t", ["none found"], {"x": [], "y": np.empty(0)})
    table = read_table(tmp_path / "t")
    assert table.columns == {"x": [], "y": []}
    assert table.numbers("x").shape == (0,)


def test_numpy_reads_it(tmp_path: Path) -> None:
    write_table(tmp_path / "t", ["a comment"], {"x": [0.1, None], "k": [1, 2], "name": ["a", "b"]})
    read = np.genfromtxt(tmp_path / "t", delimiter=",", names=True, skip_header=1, dtype=None, encoding="utf-8")
    assert read["x"][0] == 0.1
    assert math.isnan(read["x"][1])
    assert read["name"].tolist() == ["a", "b"]


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.lists(st.tuples(st.floats(), st.text(st.characters(exclude_categories=["Cs"]))), min_size=1))
def test_any_float_and_any_text_return(tmp_path_factory: pytest.TempPathFactory, rows: list) -> None:
    path = tmp_path_factory.mktemp("t") / "t"
    numbers, texts = zip(*rows, strict=True)
    write_table(path, [], {"x": np.array(numbers), "same": list(numbers), "text": list(texts)})
    table = read_table(path)
    np.testing.assert_array_equal(table.numbers("x"), numbers)
    np.testing.assert_array_equal(table.numbers("same"), numbers)
    assert table.columns["text"] == list(texts)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"# only a comment\n", "no header row"),
        (b"", "cut off"),
        (b"a,b\n1,2\n3", "cut off"),
        (b"# c\na,b\n1,2\n3\n", r"t\.csv:4: 1 cells where the header has 2"),
        (b"a,b\n1,2,3\n", r"t\.csv:2: 3 cells"),
        (b"a\n\xff\n", "UTF-8"),
        (b'a,b\n"1,2\n', r"t\.csv:2"),
    ],
)
def test_damage_is_named_with_its_line(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "t.csv").write_bytes(content)
    with pytest.raises(DamagedFile, match=message):
        read_table(tmp_path / "t.csv")


def test_what_is_no_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="one length"):
        write_table(tmp_path / "t", [], {"a": [1], "b": [1, 2]})
    with pytest.raises(ValueError, match="one line"):
        write_table(tmp_path / "t", ["a\nb"], {"a": [1]})
    with pytest.raises(TypeError, match="complex"):
        write_table(tmp_path / "t", [], {"a": [1j]})
    assert not (tmp_path / "t").exists()
