"""What the documents show exists, runs, and passes."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from typer.main import get_command

from pipeline.cli import app
from pipeline.files.png import read_png
from pipeline.scene.load import load

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted(path.parent for path in ROOT.glob("examples/*/dataset.usda"))
DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("examples/*/*.md"), ROOT / "stages/README.md"]
)
README = (ROOT / "README.md").read_text(encoding="utf-8")


def name_of(path: Path) -> str:
    """A short test id."""
    return path.relative_to(ROOT).as_posix()


def block(kind: str) -> str:
    """The first fenced block of README.md of that kind."""
    return re.search(rf"```{kind}\n(.*?)```", README, re.S)[1]


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_every_link_and_picture_leads_somewhere(document):
    links = re.findall(r"\]\(([^)#]+)\)", document.read_text(encoding="utf-8"))
    local = [link for link in links if "://" not in link]

    assert [link for link in local if not (document.parent / link).exists()] == []


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_every_command_exists(document):
    text = document.read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    verbs = set(get_command(app).commands)
    goals = set(re.findall(r"^([a-z-]+):", makefile, re.M))

    assert set(re.findall(r"(?:^    |^\$ |`)make ([a-z-]+)", text, re.M)) <= goals
    assert set(re.findall(r"(?:^    |^\$ |`)pipeline ([a-z][a-z-]*)", text, re.M)) <= verbs
    scripts = re.findall(r"python ((?:docs|examples|schemas|benchmarks)/\S+\.py)", text)
    assert [script for script in scripts if not (ROOT / script).exists()] == []


def test_every_option_in_contributing_is_an_option():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for verb, options in re.findall(r"`pipeline ([a-z-]+)([^`]*)`", text):
        known = {name for option in get_command(app).commands[verb].params for name in option.opts}
        assert set(re.findall(r"--[a-z-]+", options)) <= known


@pytest.mark.parametrize(
    "picture", [ROOT / "docs/micro_images.png", *(e / "picture.png" for e in EXAMPLES)], ids=name_of
)
def test_pictures_are_small_and_have_colours(picture):
    pixels = read_png(picture)

    assert picture.stat().st_size < 300_000
    assert (pixels.max(axis=2) != pixels.min(axis=2)).sum() > 500


def test_the_picture_comes_first():
    assert README.split("\n")[2].startswith("![")
    assert README.index("make demo") < README.index("\n## ")


def test_the_dataset_of_the_readme_passes_check(tmp_path):
    stage = tmp_path / "dataset.usda"
    stage.write_text(block("usda"), encoding="utf-8")

    assert load(stage).problems == []
    assert len(load(stage).dataset.frames) == 2


def test_the_occluder_of_the_manual_fits_into_the_dataset_of_the_readme(tmp_path):
    manual = (ROOT / "docs/targets.md").read_text(encoding="utf-8")
    card = re.search(r"```usda\n.*?(\n    def Mesh.*?)}\n```", manual, re.S)[1]
    stage, dataset = tmp_path / "dataset.usda", block("usda").rstrip().removesuffix("}")
    named = "    rel plen:occluders = </Mine/Card>\n"
    stage.write_text(f"{dataset}{named}{card}}}\n", encoding="utf-8")

    assert load(stage).problems == []
    assert [frame.world_from_occluder["/Mine/Card"][0][3] for frame in load(stage).dataset.frames] == [0.0, 8.0]


def test_the_notebook_snippet_runs(tmp_path):
    run = subprocess.run(
        [sys.executable, "-c", block("python")], capture_output=True, text=True, check=True, cwd=tmp_path
    )

    assert re.fullmatch(r"\d+ rays, mean crossing \[.*\] mm, 600 mm before the stop\n", run.stdout)


def test_version_is_one():
    """Of the package, the citation and the changelog."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

    assert f'version: "{version}"' in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_documents_know_no_machine():
    for document in DOCUMENTS:
        assert not re.search(r"/(?:home|work|root|tmp|Users)/", document.read_text(encoding="utf-8")), document


def test_the_ci_script_can_be_executed():
    assert (ROOT / ".ci/run").stat().st_mode & 0o111
