"""Every file in tests/data/bad is wrong in one way, and `load` names each mistake where it is.

The second line of each file says what is wrong, the third which problems that gives: code@line of this file, or
code@file:line. Words are free to change, but for a sample.
"""

import re

import pytest
from places import ROOT

from pipeline.scene.load import Loaded, load, require_dataset
from pipeline.scene.usd.problems import StageError

FILES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests/data/bad").glob("*.usda"))
WORDS = {
    "ambiguous_glass": [
        '25: error: "F5" is a glass of 3 vendors: cdgm:F5 (1.62435/35.94), hikari:F5 (1.60342/38.11), '
        "schott:F5 (1.60342/38.03) [ambiguous-glass]",
        "    at </Dataset/Rig/Lens/S7.plen:glass>",
        '    hint: write one of them with its vendor, as in "schott:F5"; 1.603/38 fits schott:F5 (1.60342/38.03), '
        "hikari:F5 (1.60342/38.11), lzos:LZ_F6 (1.60324/37.96)",
    ],
    "asset_outside": [
        "19: error: @/etc/passwd@ lies outside the folders that a stage may read [asset-outside]",
        "    at </Dataset/Board.userProperties:measurement>",
        "    hint: mark the folder of the project by an empty file pipeline.toml, or allow a folder with --allow-root",
    ],
    "not_finite_orient": [
        '21: error: "xformOp:orient" is not a finite number: nan [not-finite]',
        "    at </Dataset/Board.xformOp:orient>",
    ],
    "window_moves_into_lens": [
        "42: error: at time code 2 </Dataset/Pane> ends 10 mm behind the stop, and what follows it begins 33.77 mm "
        "before the stop [window-order]",
        "    at </Dataset/Rig/Camera.plen:camera:windows>",
        "    hint: windows are listed from the lens outwards; light goes through them towards their +Z, "
        "into the camera",
    ],
}
"""What a person reads of some stages, behind the name of the file."""


@pytest.fixture(autouse=True)
def _at_the_root(monkeypatch):
    """Messages show paths relative to the working directory."""
    monkeypatch.chdir(ROOT)


def one_of_each() -> list[str]:
    """A file for every set of codes that any file announces; `make test` reads a third of these, `make proofs` all."""
    return sorted({tuple(sorted(re.findall(r"(\S+)@", announced(file)))): file for file in FILES}.values())


@pytest.mark.parametrize("are_all", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_bad_files_give_exactly_the_problems_that_they_announce_in_their_lines_and_nothing_else(are_all):
    """One test, because two workers that share the tests of a file would each read all stages."""
    files = FILES if are_all else one_of_each()[::3]
    stages = {file: load(file, look=True) for file in files}

    assert {file: told(file, loaded) for file, loaded in stages.items()} == {file: announced(file) for file in files}
    for file, loaded in stages.items():
        if loaded.errors:
            require_nothing(file, loaded)


def announced(file: str) -> str:
    return re.search(r"^# expect: (.*)$", (ROOT / file).read_text(), re.MULTILINE)[1]


def told(file: str, loaded: Loaded) -> str:
    """Problems as a stage announces them."""
    places = [f"{problem.code}@{problem.file}:{problem.line}" for problem in loaded.problems]
    return " ".join(place.replace(f"@{file}:", "@") for place in places)


def require_nothing(file: str, loaded: Loaded) -> None:
    """Nothing is read from a stage with an error."""
    assert (loaded.dataset, loaded.flattened) == (None, ""), file
    with pytest.raises(StageError) as caught:
        require_dataset(loaded, file)
    assert (caught.value.exit_code, caught.value.problems) == (2, loaded.problems), file


@pytest.mark.parametrize("name", WORDS)
def test_a_problem_is_printed_with_its_prim_and_a_way_to_mend_it(name):
    file = f"tests/data/bad/{name}.usda"
    [problem] = load(file, look=True).problems
    assert str(problem) == f"{file}:" + "\n".join(WORDS[name])


def test_a_missing_file_is_a_problem_and_not_a_traceback():
    (problem,) = load("nowhere.usda").problems

    assert (problem.code, problem.message, problem.file) == ("file-missing", "no such file", "nowhere.usda")
    assert problem.hint and problem.hint.startswith("searched: ., ")
