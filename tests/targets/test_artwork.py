"""Claim: a print is the pattern in true size, read back from the files by a reader that shares nothing with us."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from targets.examples import EXAMPLES, name_of

from pipeline.app.pages.artwork import pages_of, pdf_content, svg
from pipeline.files.drawings import pdf_bytes
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.surfaces import Cube, Cylinder
from pipeline.targets.target import Target

Painted = list[tuple[int, list[np.ndarray]]]
"""Colour and closed polygons of each path, in order of painting, mm."""


def flattened(tokens: list[str], letters: dict[str, str]) -> list[np.ndarray]:
    """Polygons of a path whose operators come before their numbers; curves in 32 steps."""
    outlines: list[list[np.ndarray]] = []
    numbers: list[float] = []
    operator = ""
    for token in [*tokens, "end"]:
        if token not in letters and token != "end":
            numbers.append(float(token))
            continue
        points = np.array(numbers).reshape(-1, 2)
        kind = letters.get(operator)
        if kind == "move":
            outlines.append([points[0]])
        elif kind == "line":
            outlines[-1].append(points[0])
        elif kind == "curve":
            t = (np.arange(1, 33) / 32)[:, None]
            a, (b, c, d) = outlines[-1][-1], points
            outlines[-1] += list((1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d)
        operator, numbers = token, []
    return [np.array(outline) for outline in outlines]


def read_svg(text: str) -> tuple[float, float, Painted]:
    """Width and height [mm], and what is painted, y down."""
    root = ElementTree.fromstring(text)
    width, height = (float(root.get(name).removesuffix("mm")) for name in ("width", "height"))
    assert [float(value) for value in root.get("viewBox").split()] == [0, 0, width, height]
    painted = []
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        assert path.get("fill-rule") == "evenodd"
        tokens = re.findall(r"[MLCZ]|-?[\d.]+", path.get("d"))
        letters = {"M": "move", "L": "line", "C": "curve", "Z": "close"}
        painted.append((int(path.get("fill") == "#ffffff"), flattened(tokens, letters)))
    return width, height, painted


def read_pdf(data: bytes) -> list[tuple[float, float, Painted]]:
    """The same of every page of a PDF, y up."""
    start = int(re.search(rb"startxref\n(\d+)", data)[1])
    assert data[start : start + 4] == b"xref"
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", data[start:]), start=1):
        assert data[int(place) :].startswith(b"%d 0 obj" % number)
    pages = []
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data)
    contents = re.findall(rb"<< /Length (\d+) >>\nstream\n(.*?)endstream", data, re.DOTALL)
    for (width, height), (length, content) in zip(boxes, contents, strict=True):
        assert int(length) == len(content)
        scale = float(re.match(rb"q ([\d.]+) 0 0", content)[1])
        assert scale == pytest.approx(72 / 25.4, rel=1e-12)
        painted, colour, path = [], 0, []
        for line in content.decode("latin-1").splitlines()[1:-1]:
            *numbers, operator = line.split()
            if operator == "g":
                colour, path = int(numbers[0]), []
            elif operator == "f*":
                painted.append((colour, flattened(path, {"m": "move", "l": "line", "c": "curve", "h": "close"})))
            elif operator in {"m", "l", "c", "h"}:
                path += [operator, *numbers]
        pages.append((float(width) / scale, float(height) / scale, painted))
    return pages


def colour_at(painted: Painted, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Colour of points: crossings of a level ray with all edges of a path, odd is inside; white paper."""
    colour = np.ones(len(x))
    for value, outlines in painted:
        crossings = np.zeros(len(x), int)
        for outline in outlines:
            for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
                between = (ay > y) != (by > y)
                with np.errstate(divide="ignore", invalid="ignore"):
                    crossings += between & (x < ax + (y - ay) * (bx - ax) / (by - ay))
        colour[crossings % 2 == 1] = value
    return colour


def points_on(pattern, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng, drawing = np.random.default_rng(5), pattern.drawing
    return drawing.half_x_mm * rng.uniform(-1, 1, count), drawing.half_y_mm * rng.uniform(-1, 1, count)


@pytest.mark.parametrize("pattern", EXAMPLES, ids=name_of)
def test_the_files_show_the_pattern_in_true_size(pattern) -> None:
    """Sheet in the middle of the page, 10 mm from its upper end; wherever one looks, the colour is the drawing's."""
    x, y = points_on(pattern, 1500)
    expected = pattern.drawing.whiteness(x, y)
    pages = pages_of(Target(pattern), "Board")
    width, _, painted = read_svg(svg(pages))
    top = 10 + pattern.drawing.half_y_mm
    # 32 chords per arc of 22.5 degrees, and digits of a nanometre: within 1e-4 mm of an edge either colour is right.
    agree = colour_at(painted, width / 2 + x, top - y) == expected
    assert np.sum(~agree) <= 1
    ((pdf_width, pdf_height, painted),) = read_pdf(
        pdf_bytes([(p.width_mm, p.height_mm, pdf_content(p)) for p in pages])
    )
    assert pdf_width == pytest.approx(width, abs=1e-5)
    agree = colour_at(painted, pdf_width / 2 + x, pdf_height - top + y) == expected
    assert np.sum(~agree) <= 1


def test_the_bar_is_100_mm_long_and_stands_outside_of_the_pattern() -> None:
    pattern = Checkerboard(columns=4, rows=3, square_mm=3.0)
    (page,) = pages_of(Target(pattern), "Board")
    _, _, painted = read_svg(svg([page]))
    bar = np.concatenate(painted[-1][1])
    assert np.ptp(bar[:, 0]) == pytest.approx(100.0, abs=1e-9)
    assert bar[:, 1].min() > 10 + 2 * pattern.drawing.half_y_mm
    words, (x, y) = page.lines[-1]
    assert words == "100 mm"
    assert bar[:, 0].min() < x < bar[:, 0].max() - 80
    lower = page.height_mm - bar[:, 1].max(), page.height_mm - (10 + 2 * pattern.drawing.half_y_mm)
    assert lower[0] < y < y + 3 < lower[1]


def test_a_cylinder_prints_the_sheet_that_is_rolled_and_a_cube_all_faces() -> None:
    pattern = EXAMPLES[1]
    targets = Target(pattern), Target(pattern, Cylinder(radius_mm=30.0))
    flat, rolled = (read_svg(svg(pages_of(target, "Board")))[2][:-1] for target in targets)
    assert repr(flat) == repr(rolled)
    pages = pages_of(Target(EXAMPLES[2], Cube(edge_mm=60.0)), "Cube")
    assert len(pages) == 6
    assert "Cube 6/6" in pages[5].lines[0][0]
    assert "30 to 35" in " ".join(words for words, _ in pages[5].lines)
    assert len(read_pdf(pdf_bytes([(p.width_mm, p.height_mm, pdf_content(p)) for p in pages]))) == 6
    assert pages[0].paths != pages[1].paths


def test_words_cannot_break_the_files() -> None:
    pages = pages_of(Target(EXAMPLES[0]), r"A<b>&(c)\)")
    assert "A&lt;b&gt;&amp;(c)" in svg(pages)
    assert r"A<b>&\(c\)\\\)" in pdf_content(pages[0])


def test_printed_circles_are_round() -> None:
    """Every point of the outlines of discs and rims lies one radius from the centre, to the digits that are written."""
    for pattern, radius in ((EXAMPLES[4], 1.5), (EXAMPLES[8], 15.0)):
        width, _, painted = read_svg(svg(pages_of(Target(pattern), "Board")))
        centre = np.array([width / 2, 10 + pattern.drawing.half_y_mm]) + pattern.marks().xy_mm[0] * [1, -1]
        distance = np.linalg.norm(np.concatenate(painted[0][1]) - centre, axis=1)
        rim = distance[distance > 0.5 * radius]
        assert len(rim) > 500
        assert rim[rim > 1e-5] == pytest.approx(np.full(len(rim), radius), abs=2e-6)
