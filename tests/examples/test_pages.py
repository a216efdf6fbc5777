"""Every block of every page runs, is read by USD, or is a command that exists; every page is in the contents."""

import contextlib
import io
import json
import re
import subprocess
import sys
import tomllib

import cli_reference
import pages
import pytest
import schema_reference
from builds import tiny
from other_commands import refusal_of_other
from pages import ROOT
from typer.testing import CliRunner

from pipeline.cli import app

LANGUAGES = {"python", "usda", "bash", "console", "text", "diff", "", "{toctree}", "{eval-rst}"}
RUN = {"check", "new", "target", "import", "library"}
"""Verbs of the how-tos that take no build: they run as they are written, in the order of the page."""
FORM = ("The model", "The data", "Validation", "Result", "What is not modelled")
"""Parts of the page of an effect; lists of attributes and outputs may stand between."""
HOW_TO = sorted((ROOT / "docs/how_to").glob("*.md"))
BY_THEMSELVES = {"docs/reading.md", "docs/rays.md", "docs/when_something_is_wrong.md", "README.md"}
"""Pages whose Python has a test of its own: they need a build."""


def schema_names() -> set[str]:
    """All properties of the schema, and those of an array of values such as plen:shape:…"""
    return {prop.name for spec in schema_reference.classes().values() for prop in spec.properties}


@pytest.mark.parametrize("page", pages.PAGES, ids=pages.name_of)
def test_every_block_is_in_a_language_that_is_checked(page):
    assert {block.language for block in pages.blocks(page)} <= LANGUAGES


@pytest.mark.parametrize("page", pages.PAGES, ids=pages.name_of)
def test_python_compiles_and_usd_is_read_with_attributes_of_the_schema(page):
    known = schema_names()
    for block in pages.blocks(page):
        if block.language == "python":
            compile(block.text, pages.name_of(page), "exec")
        elif block.language == "usda":
            layer, found = pages.usd_layer(block.text), set()
            layer.Traverse("/", lambda path, found=found: found.add(str(path.name)) if path.IsPropertyPath() else None)
            assert {name for name in found if name.startswith("plen:")} <= known


def test_usd_is_fenced_so_that_it_is_checked():
    indented = re.compile(r"^    (?:def|over|uniform|rel) ", re.MULTILINE)
    assert [pages.name_of(page) for page in pages.PAGES if indented.search(pages.prose(page))] == []


@pytest.mark.parametrize("page", pages.PAGES, ids=pages.name_of)
def test_every_command_is_one_that_the_parser_takes(page):
    refused = {" ".join(words): pages.refusal(words) for words in pages.typed_commands(page)}
    assert {words: reason for words, reason in refused.items() if reason} == {}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("build", "needs stage"),
        ("biuld x.usda", "no verb biuld"),
        ("new dataset x.usda --rigg r --target t", "--rigg"),
        ("show a b c d", "too much"),
        ("build x.usda frames/1 -j 4", ""),
    ],
)
def test_the_parser_refuses_what_the_command_would(words, reason):
    assert (reason in pages.refusal(words.split())) and bool(reason) == bool(pages.refusal(words.split()))


@pytest.mark.parametrize("page", pages.PAGES, ids=pages.name_of)
def test_every_other_command_is_one_that_its_program_takes(page):
    typed = [words for block in pages.blocks(page) for line in block.commands if (words := pages.words_of(line))]
    others = [words for words in typed if words[0] != "pipeline"]
    assert {" ".join(words): refusal_of_other(words) for words in others if refusal_of_other(words)} == {}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("dask wroker --nthreads 1", "no verb"),
        ("dask worker --scheduler-file x.json --nthreds 1", "unexpected"),
        ("dask worker --scheduler-file x.json --nworkers 8", ""),
        ("pip install plenoptic-pipeline[clutser]", "no extra"),
        ("make tets", "no target"),
        ("python benchmarks/trase.py", "no file"),
        ("python examples/06_arena/tables.py --breif", "no option"),
        ("export PIPELINE_CASH=x", "nothing reads"),
        ("rm -rf build", "no test knows"),
    ],
)
def test_other_commands_are_refused_as_their_programs_would(words, reason):
    found = refusal_of_other(words.split())
    assert reason in found and bool(reason) == bool(found)


@pytest.mark.parametrize("page", pages.PAGES, ids=pages.name_of)
def test_verbs_and_options_in_sentences_exist(page):
    tree = {" ".join(path): verb for path, verb in cli_reference.verbs()}
    for said in re.findall(r"`pipeline ([a-z][^`]*)`", pages.prose(page)):
        words = said.split()
        verb = tree.get(" ".join(words[:2])) or tree.get(words[0])
        assert verb is not None, said
        known = {name for option in verb.params for name in option.opts} | {"--help"}
        below = getattr(verb, "commands", {}).values()
        known |= {name for one in below for option in one.params for name in option.opts}
        assert {word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)} <= known, said


@pytest.mark.parametrize("page", pages.PAGES, ids=pages.name_of)
def test_links_lead_to_headings_that_exist(page):
    wrong = []
    for path, anchor in pages.links(page):
        there = (page.parent / path).resolve() if path else page
        if not there.exists():
            wrong.append(path)
        elif anchor and there.suffix == ".md" and anchor not in pages.anchors(there) and there.name != "cli.md":
            wrong.append(f"{path}#{anchor}")
    assert wrong == []


def test_every_page_is_in_the_contents():
    of_docs = set((ROOT / "docs").rglob("*.md")) - {pages.INDEX}
    assert of_docs - pages.contents() == set()


def test_files_that_pages_name_exist():
    """Paths of the repository in backticks; `<kind>` and … stand for something else."""
    named = re.compile(r"`((?:pipeline|tests|docs|schemas|stages|benchmarks|examples)/[\w./-]+)`")
    wrong = [
        f"{pages.name_of(page)}: {path}"
        for page in {*pages.PAGES} - {ROOT / "CONTRIBUTING.md"}
        for path in named.findall(pages.prose(page))
        if not any((base / path).exists() for base in (ROOT, ROOT / "pipeline"))
    ]
    assert wrong == []
    tests = {path.name for path in (ROOT / "tests").rglob("test_*.py")}
    named_tests = {name for page in pages.PAGES for name in re.findall(r"\btest_\w+\.py", pages.text_of(page))}
    assert named_tests - tests == set()


@pytest.mark.parametrize("verbs", [RUN, pytest.param({*RUN, "show"}, marks=pytest.mark.heavy)], ids=["quick", "all"])
@pytest.mark.parametrize("page", [*HOW_TO, ROOT / "docs/tour.md"], ids=pages.name_of)
def test_commands_of_a_how_to_run_as_they_are_written(page, verbs, tmp_path, monkeypatch):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (tmp_path / "stages").symlink_to(ROOT / "stages")
    monkeypatch.chdir(tmp_path)
    for block in pages.blocks(page):
        saved = re.search(r"as `([\w.]+)`[^`]*:$", block.before)
        if saved:
            (tmp_path / saved[1]).write_text(block.text, encoding="utf-8")
        for line in block.commands if block.language == "console" else ():
            words = pages.words_of(line)[1:]
            if words[0] in verbs:
                done = CliRunner().invoke(app, words)
                assert done.exit_code == 0 and "error:" not in done.output, f"{line}\n{done.output}"


@pytest.fixture(scope="module")
def in_a_build(tmp_path_factory, common_store):
    """A working directory with the tiny build in the place of that of example 01."""
    folder = tmp_path_factory.mktemp("pages")
    (folder / "build").mkdir()
    tiny("conventional", folder / "build", common_store).rename(folder / "build/01_conventional")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield folder


def said_by(page, names):
    """What the Python of a page prints, one block after the other."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        for block in pages.blocks(page):
            if block.language == "python":
                exec(compile(block.text, pages.name_of(page), "exec"), names)
    return said.getvalue()


def test_the_tour_runs_on_the_tiny_build(in_a_build):
    """Its truth is by `moments` with few rays, so solving it again agrees about only."""
    said = said_by(ROOT / "docs/tour.md", names := {})
    assert said.split()[0] == str(len(names["view"].correspondences))
    assert float(re.search(r"solved again: (\S+) px", said)[1]) < 0.05
    assert said.splitlines()[-1] == "2 views for cv2.calibrateCamera"


def test_python_of_all_other_pages_runs(in_a_build):
    for page in pages.PAGES:
        if pages.name_of(page) not in {*BY_THEMSELVES, "docs/tour.md"}:
            said_by(page, {"__name__": "page"})


def test_the_task_of_the_how_to_runs_on_a_white_image(in_a_build, tmp_path):
    said_by(ROOT / "docs/how_to/task.md", names := {})
    white = in_a_build / "build/01_conventional/cameras/Rig.Camera/white.exr"
    names["run"](None, {"white": {"white.exr": white}}, tmp_path)
    assert 0 < json.loads((tmp_path / "darkest.json").read_text(encoding="utf-8"))["irradiance"] < 1


def test_the_reference_of_the_schema_is_what_the_schema_says():
    assert schema_reference.stale() == {}, "python docs/schema_reference.py --write"
    shown = [name for model in schema_reference.models() for name in model.classes]
    assert sorted(shown) == sorted(schema_reference.classes()), "docs/schema.toml: each class on one page"


def test_the_reference_of_the_command_has_every_option():
    text = cli_reference.page()
    for path, verb in cli_reference.verbs():
        section = text.split(f" pipeline {' '.join(path)}\n", 1)[1].split("\n##", 1)[0]
        if not getattr(verb, "commands", None):
            assert [
                name
                for one in verb.params
                for name in getattr(one, "opts", [])
                if name.startswith("-") and f"`{name}" not in section
            ] == []


def test_every_effect_has_a_page_of_the_same_form():
    matrix = ROOT / "docs/effects.md"
    named = dict.fromkeys(re.findall(r"\| \[[^\]]+\]\((\w+)\.md\) \|$", pages.text_of(matrix), re.MULTILINE))
    listed = re.search(r":caption: Effects\n:hidden:\n\n(.*?)```", pages.text_of(pages.INDEX), re.DOTALL)[1].split()
    assert [matrix.stem, *named] == listed
    for page in named:
        headings = re.findall(r"^## (.*)$", pages.text_of(ROOT / f"docs/{page}.md"), re.MULTILINE)
        parts = [next((form for form in FORM if heading.startswith(form)), None) for heading in headings]
        assert list(dict.fromkeys(part for part in parts if part)) == list(FORM), page


def test_tools_of_the_site_are_pinned():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pinned = {line.split("==")[0].lower() for line in (ROOT / "constraints.txt").read_text().splitlines()}
    assert {re.split("[<>=]", need)[0] for need in project["optional-dependencies"]["docs"]} <= pinned


@pytest.mark.heavy
def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("sphinx")
    options = ("-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "read"), "-c", str(ROOT / "docs"))
    command = [sys.executable, "-m", "sphinx", *options, str(ROOT), str(tmp_path / "site")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site/index.html").is_file()
    assert "plen:squareSize" in (tmp_path / "site/docs/schema/targets.html").read_text(encoding="utf-8")
    assert "--check-determinism" in (tmp_path / "site/docs/cli.html").read_text(encoding="utf-8")
