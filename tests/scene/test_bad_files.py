"""Every file in tests/data/bad is wrong in one way, and `load` says so in the words of EXPECTED.txt.

The second line of each file says what is wrong, the third which codes that must give; EXPECTED.txt pins the words.
After an intended change of words:  PYTHONPATH=tests python tests/scene/test_bad_files.py > tests/data/bad/EXPECTED.txt
"""

import os
import re
import sys
from pathlib import Path

import pytest
from places import ROOT

from pipeline.scene.load import Loaded, load, require_dataset
from pipeline.scene.usd.problems import StageError

FILES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests/data/bad").glob("*.usda"))


@pytest.fixture(autouse=True)
def _at_the_root(monkeypatch):
    """Messages show paths relative to the working directory."""
    monkeypatch.chdir(ROOT)


def one_of_each() -> list[str]:
    """A file for every set of codes that any file announces; `make test` reads a third of these, `make proofs` all."""
    return sorted({tuple(sorted(announced(file))): file for file in FILES}.values())


@pytest.mark.parametrize("are_all", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_bad_files_give_exactly_the_problems_that_they_announce_in_the_expected_words_and_nothing_else(are_all):
    """One test, because two workers that share the tests of a file would each read all stages."""
    files = FILES if are_all else one_of_each()[::3]
    stages = {file: load(file, look=True) for file in files}
    problems = [problem for loaded in stages.values() for problem in loaded.problems]

    assert {file: [problem.code for problem in loaded.problems] for file, loaded in stages.items()} == {
        file: announced(file) for file in files
    }
    assert [name for name, _ in expected()] == list(map(name_of, FILES))
    assert [problem for problem in problems if not problem.file or not problem.line] == []
    assert report(stages) == "".join(words for name, words in expected() if name in map(name_of, files))
    for file, loaded in stages.items():
        if loaded.errors:
            require_nothing(file, loaded)


def name_of(file: str) -> str:
    return Path(file).name


def expected() -> list[tuple[str, str]]:
    """The words of EXPECTED.txt, each file's below its name."""
    text = (ROOT / "tests/data/bad/EXPECTED.txt").read_text()
    parts = [f"## {part}" for part in text.split("## ")[1:]]
    return [(part.splitlines()[0].removeprefix("## "), part) for part in parts]


def require_nothing(file: str, loaded: Loaded) -> None:
    """Nothing is read from a stage with an error."""
    assert (loaded.dataset, loaded.flattened) == (None, ""), file
    with pytest.raises(StageError) as caught:
        require_dataset(loaded, file)
    assert (caught.value.exit_code, caught.value.problems) == (2, loaded.problems), file


def announced(file: str) -> list[str]:
    return re.search(r"^# expect: (.*)$", (ROOT / file).read_text(), re.MULTILINE)[1].split()


def test_a_missing_file_is_a_problem_and_not_a_traceback():
    (problem,) = load("nowhere.usda").problems

    assert (problem.code, problem.message, problem.file) == ("file-missing", "no such file", "nowhere.usda")
    assert problem.hint and problem.hint.startswith("searched: ., ")


def report(stages: dict[str, Loaded]) -> str:
    texts = [
        f"## {Path(file).name}\n" + "".join(f"{problem}\n" for problem in loaded.problems)
        for file, loaded in stages.items()
    ]
    return "".join(texts)


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.stdout.write(report({file: load(file, look=True) for file in FILES}))
