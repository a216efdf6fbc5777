"""Every block of docs/rays.md runs on the tiny builds, and prints what the page says of it."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest
from builds import tiny

PAGE = (Path(__file__).resolve().parents[2] / "docs/rays.md").read_text(encoding="utf-8")
FIRST, *BLOCKS = re.findall(r"```python\n(.*?)```", PAGE, re.S)


@pytest.fixture(scope="module")
def builds(tmp_path_factory, common_store):
    folder = tmp_path_factory.mktemp("page")
    (folder / "build").mkdir()
    for number, kind in enumerate(("conventional", "plenoptic"), 1):
        tiny(kind, folder / "build", common_store).rename(folder / f"build/{number:02d}_{kind}")
    return folder


@pytest.fixture(scope="module")
def printed(builds) -> list[str]:
    names: dict[str, object] = {}
    pages = []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(builds)
        for block in (FIRST, *BLOCKS):
            said = io.StringIO()
            with contextlib.redirect_stdout(said):
                exec(compile(block, "docs/rays.md", "exec"), names)
            pages.append(said.getvalue())
    return pages[1:]


def test_every_block_prints_numbers(printed):
    assert len(printed) == len(BLOCKS) == 6 and all(re.search(r"\d", said) and "nan" not in said for said in printed)


def test_points_are_told_their_fates(printed):
    lines = printed[0].splitlines()
    assert lines[1] == "[0 1]" and float(lines[2]) < 1e-3
    assert [line.split()[0] for line in lines[3:]] == ["seen", "seen", "behind", "outside"]


def test_the_table_agrees(printed):
    """It is by `moments` with few rays here, so only about; tests/sight compare rows of `direct`."""
    assert float(printed[1].split()[0]) < 0.05


def test_each_ray_has_its_own_pupil(printed):
    numbers = np.array(re.search(r"\[(.*)\]", printed[4], re.S)[1].split(), float)
    assert len(numbers) == 5 and (numbers < 0).all() and 1e-4 < np.ptp(numbers) < 1
