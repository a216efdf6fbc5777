"""Claim: `check` names the frames of each camera and target that would be blank, or nearly so, in few words, and no
others.
"""

import re

import pytest
from stage_text import edited, stage_in, tiny_text

from pipeline.app.build import build
from pipeline.scene.load import load

BACK = "(0, 0, 1, 0)"


@pytest.fixture
def check(tmp_path):
    """Warnings of the tiny dataset over eight frames, with other poses in some and other text."""

    def warnings(poses: dict[int, tuple[str, str]], *replaced: tuple[str, str]) -> list[str]:
        text = tiny_text("conventional", ("endTimeCode = 2", "endTimeCode = 8"))
        start, end = text.index("        quatd xformOp:orient"), text.index("        uniform token[] xformOpOrder")
        usual = "(1, 0, 0, 0)", "(0, 0, -434.4)"
        both = [poses.get(number, usual) for number in range(1, 9)]
        turns = "".join(f"            {number}: {turn},\n" for number, (turn, _) in enumerate(both, 1))
        places = "".join(f"            {number}: {place},\n" for number, (_, place) in enumerate(both, 1))
        text = (
            f"{text[:start]}        quatd xformOp:orient.timeSamples = {{\n{turns}        }}\n"
            f"        double3 xformOp:translate.timeSamples = {{\n{places}        }}\n{text[end:]}"
        )
        assert load(stage_in(tmp_path, edited(text, *replaced))).problems == []  # a plan need not ask for it
        return [
            str(problem).split(": ", 3)[3].split(" [")[0]
            for problem in load(tmp_path / "dataset.usda", look=True).problems
        ]

    return warnings


def test_frames_are_listed_by_reason_and_others_are_not(check):
    away, beside = (BACK, "(0, 0, -434.4)"), ("(1, 0, 0, 0)", "(0, 90, -434.4)")
    assert check({}) == []
    assert check({2: away, 3: away, 7: away, 5: beside}) == [
        "frames 2-3, 7 (it shows its back); frame 5 (out of view)",
    ]


def test_a_board_of_grey_is_named_though_its_light_arrives(check):
    """Squares of 1.4 mm: at 0.7 m they are 2.5 px apart and blur to 14; not so near the focus at 0.43 m."""
    far, behind = ("(1, 0, 0, 0)", "(0, 0, -700)"), ("(1, 0, 0, 0)", "(0, 0, -440)")
    assert check({4: far, 5: behind}) == ["frame 4 (too far away or too blurred to tell its points apart)"]


@pytest.mark.heavy
def test_a_board_of_grey_in_micro_images_is_named_also_by_a_build(tmp_path, monkeypatch):
    """Squares of 1 mm at 420 and 800 mm: images over white images have standard deviations of 0.30 and 0.10."""
    text = tiny_text("plenoptic")
    found = []
    for z in (420, 800):
        moved = re.sub(r"\(([-\d.]+), ([-\d.]+), -[\d.]+\)", rf"(\1, \2, -{z})", text)
        found.append([str(one) for one in load(stage_in(tmp_path, moved), look=True).problems])
    assert found[0] == []
    grey = "frames 1-2 (too far away or too blurred to tell its points apart)"
    assert grey in found[1][0]
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))  # a task has to run
    told = []
    build(
        tmp_path / "dataset.usda", tmp_path / "out", on_event=told.append, targets=("cameras/Rig.Camera/camera.json",)
    )
    assert [grey in event.text for event in told if event.name == "warning"] == [True]


def test_frames_of_few_points_are_named(check):
    """Of 3 x 2 points 1.4 mm apart two are left, then one. The image shows 10.8 x 8.1 mm there, and 1.4 mm beside it a
    point may still be seen.
    """
    few = {2: ("(1, 0, 0, 0)", "(7.5, 0, -434.4)"), 5: ("(1, 0, 0, 0)", "(7.5, 5.4, -434.4)")}
    assert check(few) == ["frame 5 (out of view)"]


def test_a_board_is_hidden_by_another_one_but_not_by_one_behind_it_or_beside_it(check):
    other = """
    def PlenCheckerboard "Near"
    {{
        uniform int plen:columns = 3
        uniform int plen:rows = 2
        uniform double plen:squareSize = 8
        double3 xformOp:translate = ({x}, 0, {z})
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }}

    def PlenCheckerboard "Board" ("""
    for x, z, found in ((0, -300, ["frames 1-8 (hidden)"]), (0, -500, []), (3, -500, [])):
        edits = (
            (
                "rel plen:targets = </TinyConventional/Board>",
                "rel plen:targets = [</TinyConventional/Board>, </TinyConventional/Near>]",
            ),
        )
        warned = check({}, *edits, ('\n    def PlenCheckerboard "Board" (', other.format(x=x, z=z)))
        assert [one for one in warned if "hidden" in one] == found
