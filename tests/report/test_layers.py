"""The picture of a graph of tasks: arrows lead where they should, beside boxes that stand one below the other."""

import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from places import TINY_PLENOPTIC

from pipeline.app.build import project
from pipeline.engine.planning.collapsed_graph import Node
from pipeline.report.graph import HEIGHT, WIDTH, svg

SVG = "{http://www.w3.org/2000/svg}"


def node(name: str, reads: list[str] = ()) -> Node:
    return Node(name, Counter(run=1), list(reads))


def tasks(stage: Path) -> list[Node]:
    graph = project(stage).graph
    return [node(name, graph.sources(name)) for name in graph]


@pytest.mark.parametrize(
    "nodes",
    [
        [node("alone")],
        [node("a"), node("b", ["a"]), node("c", ["b"]), node("d", ["a", "c"]), node("e", ["b", "d"])],
        [node("a", ["c"]), node("b", ["a"]), node("c", ["b"])],  # one reads a later one, as collapsed passes do
        tasks(TINY_PLENOPTIC),
    ],
    ids=("alone", "chain", "back", "tiny"),
)
def test_arrows_lead_from_a_box_to_all_that_read_it_in_the_picture_and_beside_all_boxes(nodes):
    root = ElementTree.fromstring(svg(nodes, "title"))
    width, height = (float(root.get(side)) for side in ("width", "height"))
    group = root.find(f"{SVG}g")
    left, top = map(float, re.findall(r"[\d.]+", group.get("transform")))
    boxes = {float(box.get("y")): node.name for node, box in zip(nodes, group.findall(f"{SVG}rect"), strict=True)}
    arcs = [np.array(re.findall(r"(-?[\d.]+),(-?[\d.]+)", p.get("d")), float) for p in group.findall(f"{SVG}path")]

    assert all(below - above > HEIGHT for above, below in pairwise(boxes)) and top + max(boxes) + HEIGHT < height
    read = {(boxes[start[1] - HEIGHT / 2], boxes[end[1] - HEIGHT / 2]) for start, *_, end in arcs}
    assert read == {(source, node.name) for node in nodes for source in node.reads}
    for arc in arcs:
        assert arc[0, 0] == arc[-1, 0] == WIDTH and arc[1:-1, 0].min() > WIDTH
        assert left + WIDTH + 0.75 * (arc[1, 0] - WIDTH) < width
