"""A text with typing errors is read, or ends in problems with a place."""

import random

import pytest
from stage_text import tiny_text

from pipeline.scene.load import load

TOKENS = (
    *("{", "}", "(", ")", "[", "]", '"', "'''", '"""', "@", "@@@", "<", ">", "=", ",", ":", ";", "\n", "#", "/*", "*/"),
    *(
        "//",
        "\\",
        "\0",
        "\x1b[31m",
        "-",
        "1e400",
        "nan",
        "9" * 30,
        "1.2.3:",
        "def",
        "over",
        "class",
        "variantSet ",
        "rel ",
    ),
    *("timeSamples", ".connect", "token[]", "matrix4d", "None", "add ", "delete ", "reorder nameChildren = "),
    *("inherits = ", "references = @./whole.usda@", "subLayers", "\udcff"),
)


def damaged(whole: str, seed: int) -> str:
    """A text with one to sixteen changes: something left out, put in, or repeated."""
    dice, text = random.Random(seed), whole
    for _ in range(dice.choice([1, 1, 2, 4, 16])):
        at, start = dice.randrange(len(text) + 1), dice.randrange(len(text) + 1)
        count = dice.randrange(1, 50)
        match dice.randrange(3):
            case 0:
                text = text[:at] + (text[at + count :] if dice.random() < 0.7 else "")
            case 1:
                text = text[:at] + dice.choice(TOKENS) + text[at:]
            case _:
                text = text[:at] + text[start : start + 4 * count] + text[at:]
    return text


@pytest.mark.parametrize("count", [75, pytest.param(3000, marks=pytest.mark.heavy)])
def test_a_damaged_text_is_read_or_ends_in_problems_with_a_place(count, tmp_path):
    whole, refused = tiny_text("conventional"), 0
    (tmp_path / "whole.usda").write_text(whole)
    for seed in range(count):
        path = tmp_path / f"damaged-{seed}.usda"
        path.write_text(damaged(whole, seed), errors="surrogateescape")
        loaded = load(path)
        problems = loaded.problems
        assert (loaded.dataset is None) == bool(loaded.errors), seed
        assert all(problem.file and problem.line for problem in problems), seed
        assert all(str(problem).replace("\n", "").isprintable() for problem in problems), seed
        refused += any(problem.is_error for problem in problems)
        path.unlink()
    assert count / 4 < refused < count
