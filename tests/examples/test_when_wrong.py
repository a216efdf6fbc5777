"""docs/when_something_is_wrong.md says what the commands print today, and every mistake is one that they see."""

import importlib.util
import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/when_something_is_wrong.md").read_text(encoding="utf-8")


def _script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("when_wrong", ROOT / "docs/when_wrong.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look themselves up there
    spec.loader.exec_module(module)
    return module


when_wrong = _script()
CASES = when_wrong.cases()


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=[pytest.mark.heavy] * case.builds, id=case.title) for case in CASES]
)
def test_the_page_says_what_the_command_prints(case):
    section = when_wrong.section(case)
    assert f"\n{section}" in PAGE, f"python docs/when_wrong.py writes the page anew; now it is\n{section}"


def test_the_page_has_these_cases_and_no_others():
    assert re.findall(r"^## (.*)", PAGE, re.MULTILINE) == [case.title for case in CASES]
    assert str(ROOT) not in PAGE and "/tmp" not in PAGE


def test_check_names_the_line_of_every_mistake_and_a_way_out():
    """In the page, which the tests above compare with the command."""
    for section in PAGE.split("\n## ")[1:]:
        says = section.split("It says:")[1]
        if "$ pipeline check dataset.usda" in says and "0 errors, 0 warnings" not in says:
            assert re.search(
                r"^dataset\.usda:\d+(:\d+)?: (error|warning): .*\n    at .*\n    hint: ", says, re.MULTILINE
            )


@pytest.mark.parametrize("name", ["tiny_conventional", "tiny_plenoptic"])
def test_without_the_mistakes_the_command_sees_none(name):
    clean = when_wrong.Case(title="", wrong="", command="check dataset.usda", said="", mend="", dataset=name)
    assert when_wrong.answer(clean) == "1 stage checked: 0 errors, 0 warnings"
