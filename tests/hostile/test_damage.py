"""Every sequence of bytes as a layer is read, or ends in problems with a place; the process that asks goes on."""

from pathlib import Path

import pytest
from hostile.damage import damaged, sources

from pipeline.confine.process import Bounds, Ended, Guards, ask
from pipeline.roots import readable_for
from pipeline.scene.load import load

SEEDS = {".usda": 3000, ".usdz": 1500, ".usdc": 1500}
"""So many in `make proofs`; `make test` takes a fortieth, of binary layers a sixtieth."""
BOUNDS = Bounds(cpu_s=60, wall_s=120)
LEFT_TO_LOAD = 20
"""Of those that end a process that reads them: each costs the time of another process."""


def places_of(problems):
    """Problems without a file and a line, of binary layers a prim; or that a terminal would obey."""
    bad = [one for one in problems if not (one.file and (one.line or one.at))]
    return [str(one) for one in problems if one in bad or not str(one).replace("\n", "").isprintable()]


def texts_and_packages(folder: Path, suffix: str, seeds: range) -> int:
    """How many of some damaged layers were refused; they are read in this process, which no text can crash."""
    whole, refused = sources(folder)[suffix], 0
    for seed in seeds:
        path = folder / f"damaged-{seed}{suffix}"
        path.write_bytes(damaged(whole, seed))
        problems = load(path).problems
        assert places_of(problems) == [], seed
        refused += any(one.is_error for one in problems)
        path.unlink()
    return refused


def binaries(folder: Path, seeds: range) -> tuple[int, list[Path]]:
    """How many damaged binary layers were refused, and those that their process did not survive."""
    whole, paths = sources(folder)[".usdc"], []
    for seed in seeds:
        paths.append(folder / f"damaged-{seed}.usdc")
        paths[-1].write_bytes(damaged(whole, seed))
    refused, deadly, todo = 0, [], list(map(str, paths))
    while todo:
        try:
            found, _ = ask("hostile.test_damage:read_all", todo, readable_for([folder]), BOUNDS)
            assert found["misplaced"] == []
            return refused + found["refused"], deadly
        except Ended as error:
            begun = [line.removeprefix("begin: ") for line in error.words.splitlines() if line.startswith("begin: ")]
            deadly.append(Path(begun[-1]))
            todo = todo[todo.index(begun[-1]) + 1 :]
    return refused, deadly


def read_all(paths: list[str], guards: Guards) -> dict:
    """Read layers one after the other, in a process that may end of any."""
    problems = []
    for path in paths:
        print(f"begin: {path}", flush=True)
        problems.append(load(path, guards=guards).problems)
    misplaced = [one for found in problems for one in places_of(found)]
    return {"refused": sum(any(one.is_error for one in found) for found in problems), "misplaced": misplaced}


def no_binary_does_harm(folder: Path, seeds: range, loaded: int) -> None:
    refused, deadly = binaries(folder, seeds)
    assert refused + len(deadly) > len(seeds) / 10
    for path in deadly[:loaded]:
        problems = load(path).problems
        assert problems and places_of(problems) == [], path


@pytest.mark.parametrize("suffix", [".usda", ".usdz"])
def test_some_damaged_texts_and_packages_end_in_problems_with_a_place(suffix, tmp_path):
    seeds = range(SEEDS[suffix] // 40)
    assert texts_and_packages(tmp_path, suffix, seeds) > len(seeds) / 4


def test_some_damaged_binary_layers_end_in_problems_with_a_place(tmp_path):
    no_binary_does_harm(tmp_path, range(SEEDS[".usdc"] // 60), loaded=1)


@pytest.mark.heavy
@pytest.mark.parametrize("suffix", [".usda", ".usdz"])
def test_damaged_texts_and_packages_end_in_problems_with_a_place(suffix, tmp_path):
    seeds = range(SEEDS[suffix])
    assert texts_and_packages(tmp_path, suffix, seeds) > len(seeds) / 4


@pytest.mark.heavy
def test_damaged_binary_layers_end_in_problems_with_a_place(tmp_path):
    no_binary_does_harm(tmp_path, range(SEEDS[".usdc"]), LEFT_TO_LOAD)
