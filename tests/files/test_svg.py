"""Claim: whatever words and numbers come, the text is XML that says them, in few digits and without -0."""

from xml.etree import ElementTree

import pytest

from pipeline.files import svg

NAME = "{http://www.w3.org/2000/svg}"
ODD = "a < b & \"c\" 'd' > é"


@pytest.mark.parametrize(
    ("value", "decimals", "text"),
    [
        (1.5, 6, "1.5"),
        (100, 6, "100"),
        (100.0, 0, "100"),
        (-4e-7, 6, "0"),
        (-0.0, 2, "0"),
        (1 / 3, 2, "0.33"),
        (2.9999999, 6, "3"),
        (-12.25, 1, "-12.2"),
    ],
)
def test_numbers_have_the_digits_that_they_need(value, decimals, text):
    assert svg.number(value, decimals) == text


def test_a_reader_of_xml_finds_everything_where_it_was_put():
    head = svg.words(ODD, (1.234, 5), font_size=11)
    inner = svg.element("svg", svg.area([(0, 0), (1, 0), (0, 1)], fill=ODD), x=3)
    way = svg.path([("M", [(0.123456, 1)]), ("C", [(1, 2), (3, 4), (5, 6)]), ("Z", [])], svg.FINE, stroke_width=0.5)
    root = ElementTree.fromstring(svg.document((30, 20.5), head, inner, way, svg.line([(1, 2), (3, 4)]), unit="mm"))
    assert (root.tag, root.get("width"), root.get("height"), root.get("viewBox")) == (
        NAME + "svg",
        "30mm",
        "20.5mm",
        "0 0 30 20.5",
    )
    paper, words, nested, path, line = root
    assert (paper.tag, paper.get("fill")) == (NAME + "rect", "#ffffff")
    assert (words.text, words.get("x"), words.get("y"), words.get("font-size")) == (ODD, "1.23", "5", "11")
    assert nested.get("x") == "3" and nested[0].get("points") == "0,0 1,0 0,1" and nested[0].get("fill") == ODD
    assert path.get("d") == "M0.123456,1C1,2 3,4 5,6Z" and path.get("stroke-width") == "0.5"
    assert line.get("points") == "1,2 3,4" and line.get("fill") == "none"
