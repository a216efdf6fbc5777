"""The picture of a graph of tasks: lines lead where they should, and never behind a box."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from pipeline.app.build import project
from pipeline.report.graph import HEIGHT, WIDTH, svg

TINY = Path(__file__).resolve().parents[1] / "data/tiny_plenoptic/dataset.usda"
SIZE = np.array([WIDTH, HEIGHT])
SVG = "{http://www.w3.org/2000/svg}"


@dataclass
class Node:
    name: str
    reads: list[str] = field(default_factory=list)
    colour: str = "#fff"

    @property
    def label(self) -> tuple[str, str]:
        return self.name, ""


def random_graph(seed: int, count: int, back: int = 0) -> list[Node]:
    """Nodes that read earlier ones, and some later ones."""
    rng = np.random.default_rng(seed)
    nodes = [Node(str(i), [str(j) for j in range(i) if rng.random() < 3 / (i + 1)]) for i in range(count)]
    for one, other in rng.choice(count, (back, 2)):
        if one != other and str(other) not in nodes[one].reads:
            nodes[one].reads.append(str(other))
    return nodes


def tasks(stage: Path) -> list[Node]:
    graph = project(stage).graph
    return [Node(name, list(graph.sources(name))) for name in graph]


def drawn(nodes: list[Node]):
    """Boxes by name as (left, top), and the control points of the lines, (4, 2) each, as a browser would read them."""
    group = ElementTree.fromstring(svg(nodes, "title")).find(f"{SVG}g")
    rectangles = group.findall(f"{SVG}rect")
    boxes = {node.name: (float(r.get("x")), float(r.get("y"))) for node, r in zip(nodes, rectangles, strict=True)}
    lines = []
    for path in group.findall(f"{SVG}path"):
        points = np.array(re.findall(r"(-?[\d.]+),(-?[\d.]+)", path.get("d")), float)
        straight = points[0] + np.outer([0, 1 / 3, 2 / 3, 1], points[-1] - points[0])
        lines.append((points if len(points) == 4 else straight, path.get("marker-end") is not None))
    return boxes, lines


CHAIN = [Node("a"), Node("b", ["a"]), Node("c", ["b"]), Node("d", ["a", "c"]), Node("e", ["b", "d"])]
GRAPHS = [
    CHAIN,
    [Node("alone")],
    *(random_graph(seed, count) for seed, count in ((1, 8), (2, 20), (3, 60))),
    *(random_graph(seed, 15, back=4) for seed in (4, 5)),
    tasks(TINY),
]


@pytest.mark.parametrize("nodes", GRAPHS, ids=range(len(GRAPHS)))
def test_no_line_passes_behind_a_box_and_boxes_do_not_overlap(nodes):
    boxes, lines = drawn(nodes)
    t = np.linspace(0, 1, 200)[:, None]
    corners = np.array(list(boxes.values()))

    for control, _ in lines:
        a, b, c, d = control
        points = (1 - t) ** 3 * a + 3 * (1 - t) ** 2 * t * b + 3 * (1 - t) * t**2 * c + t**3 * d
        inside = (points[:, None] > corners + 0.5) & (points[:, None] < corners + SIZE - 0.5)
        assert not inside.all(axis=2).any()
    for (x, y), (u, v) in combinations(boxes.values(), 2):
        assert abs(x - u) >= WIDTH or abs(y - v) >= HEIGHT


@pytest.mark.parametrize("nodes", GRAPHS[:5] + GRAPHS[-1:], ids=range(6))
def test_lines_lead_from_a_box_to_all_that_read_it_and_to_nothing_else(nodes):
    boxes, lines = drawn(nodes)
    at_left = {(round(x, 1), round(y + HEIGHT / 2, 1)): name for name, (x, y) in boxes.items()}

    for name, (x, y) in boxes.items():
        ways, reached = [(round(x + WIDTH, 1), round(y + HEIGHT / 2, 1))], set()
        while ways:
            here = ways.pop()
            for control, is_arrow in lines:
                if tuple(control[0].round(1)) == here:
                    end = tuple(control[-1].round(1))
                    assert is_arrow == (end in at_left)
                    reached.add(at_left[end]) if is_arrow else ways.append(end)
        assert reached == {node.name for node in nodes if name in node.reads}


def test_a_node_that_reads_a_later_one_has_an_arrow_that_goes_back():
    boxes, lines = drawn([Node("a", ["c"]), Node("b", ["a"]), Node("c", ["b"])])
    ((start, end),) = [(line[0], line[-1]) for line, is_arrow in lines if is_arrow and line[-1][0] < line[0][0]]

    assert end.tolist() == pytest.approx([boxes["a"][0] + WIDTH, boxes["a"][1] + HEIGHT / 2], abs=0.1)
    assert start[0] == pytest.approx(boxes["b"][0], abs=0.1)
