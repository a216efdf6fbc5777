"""Drawings go to a name that is free, or replace a drawing of ours: a file of somebody's stays."""

import xml.etree.ElementTree as ElementTree

import pytest

from pipeline.errors import UsageError
from pipeline.files.drawings import pdf_bytes, write_drawing

SVG = '<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1">\n</svg>'
MAKERS = {"svg": lambda size: SVG.replace("1", str(size)), "pdf": lambda size: pdf_bytes([(size, size, "")])}


@pytest.mark.parametrize("kind", MAKERS)
def test_a_drawing_of_ours_is_replaced(kind, tmp_path):
    path, alone = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
    write_drawing(path, MAKERS[kind](11111))
    write_drawing(path, MAKERS[kind](2))
    write_drawing(alone, MAKERS[kind](2))
    assert path.read_bytes() == alone.read_bytes()
    assert kind == "pdf" or ElementTree.parse(path).getroot().get("width") == "2"


@pytest.mark.parametrize("kind", MAKERS)
@pytest.mark.parametrize("put", [lambda path: path.write_text(SVG), lambda path: path.symlink_to("none"), "mkdir"])
def test_whatever_else_has_the_name_stays(kind, put, tmp_path):
    path = tmp_path / f"mine.{kind}"
    path.mkdir() if put == "mkdir" else put(path)
    before = sorted((found, found.is_file() and found.read_text()) for found in tmp_path.iterdir())
    with pytest.raises(IsADirectoryError if put == "mkdir" else UsageError):
        write_drawing(path, MAKERS[kind](1))
    assert sorted((found, found.is_file() and found.read_text()) for found in tmp_path.iterdir()) == before
