"""Every page: its Python runs, its USD is read, its commands are ones that exist, and its links lead somewhere."""

import contextlib
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import schema_reference
import typer
from places import ROOT
from pxr import Sdf
from sybil import Document, Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser
from typer.testing import CliRunner

from pipeline.app.verbs.terminal import Verbs
from pipeline.cli import app
from pipeline.entry_points import offered
from pipeline.scene.load import load

NAMES = ("README", "CONTRIBUTING", "CONVENTIONS", "docs/**/*", *(f"{folder}/**/*" for folder in ("examples", "stages")))
PAGES = sorted(page for name in (*NAMES, "schemas/*", "benchmarks/*") for page in ROOT.glob(f"{name}.md"))
TOUR = ROOT / "docs/tour.md"
HOW_TOS = [TOUR, *sorted((ROOT / "docs/how_to").glob("*.md"))]
RUN = {"check", "new", "design", "target", "import", "library", "show"}
"""Verbs of the how-tos that take no build: they run as they are written, in the order of the page."""
ENDS_A_COMMAND = {"|", "||", "&", "&&", ";", ">", "<"}


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def read_usd(example: Example) -> None:
    """A stage passes `pipeline check`; the attributes of a fragment are those of the schema."""
    text = str(example.parsed)
    save(example)
    if "metersPerUnit" in text:
        Path("stage_of_a_page.usda").write_text(text, encoding="utf-8")
        assert load(Path("stage_of_a_page.usda")).problems == []
        return
    if re.match(r"(?!def|over|#usda)", text):
        text = f'over "Fragment"\n{{\n{text}\n}}'
    layer, names = Sdf.Layer.CreateAnonymous(".usda"), set()
    assert layer.ImportFromString(text if text.startswith("#usda") else f"#usda 1.0\n{text}\n")
    layer.Traverse("/", lambda path: names.add(path.name) if path.IsPropertyPath() else None)
    known = {prop.name for spec in schema_reference.classes().values() for prop in spec.properties}
    assert {name for name in names if name.startswith("plen:")} <= known


def save(example: Example) -> None:
    """Write a block that the page tells to save as a file."""
    before = example.document.text[: example.region.start].rstrip()
    if name := re.search(r"as `([\w.]+)`[^`]*:$", before):
        Path(name[1]).write_text(str(example.parsed), encoding="utf-8")


def test_pages_write_files_of_their_own_names():
    """Who reads them in one folder meets no file of another page, which `new` would refuse to replace."""
    written = {
        page: set(
            re.findall(r"^\$ pipeline (?:new|design) \w+ (\S+)|(?:as `| -o )(\S+usda)`?", page.read_text("utf-8"), re.M)
        )
        for page in (ROOT / "README.md", *HOW_TOS)
    }
    names = [(a or b).strip("`") for found in written.values() for a, b in found]
    assert sorted(set(names)) == sorted(names)


def commands(text: str) -> list[list[str]]:
    """Words of each command: of the lines behind `$ ` where there are such, else of all."""
    lines = [line.strip() for line in re.sub(r"\s*\\\n\s*", " ", text).split("\n") if line.strip()]
    lines = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")] or lines
    return [words for line in lines if (words := words_of(line))]


def words_of(line: str) -> list[str]:
    """Words of a line of a shell up to the end of its first command, without variables that stand before it."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=";<>|&")
    lexer.whitespace_split, lexer.commenters = True, "#"
    words = list(lexer)
    end = next((place for place, word in enumerate(words) if word in ENDS_A_COMMAND), len(words))
    first = next((place for place, word in enumerate(words) if not re.match(r"\w+=", word)), 0)
    return words[first:end]


def is_of_a_missing_plug_in(words: list[str]) -> bool:
    return words[1] in Verbs.plug_ins and words[1] not in offered("verb")


def parsed(words: list[str]) -> None:
    """Parse a command of `pipeline` as typer does, which raises where it cannot be; no file is read."""
    command, rest = typer.main.get_command(app), words[1:]
    while rest and hasattr(command, "get_command") and (below := command.get_command(None, rest[0])):
        command = below
        rest.pop(0)
    with contextlib.suppress(typer.Exit):  # --help, --list: they print and end
        command.make_context(command.name, rest)


def reader(run: set[str]) -> Sybil:
    """A reader of pages that runs these verbs of how-tos, and looks at all other commands alone."""

    def look_at(example: Example) -> None:
        for words in commands(str(example.parsed)):
            if words[0] != "pipeline" or is_of_a_missing_plug_in(words):
                continue
            parsed(words)
            shown = example.region.lexemes["arguments"] == "console" and Path(example.path) in HOW_TOS
            if shown and words[1] in run:
                done = CliRunner().invoke(app, words[1:])
                assert done.exit_code == 0 and "error:" not in done.output, f"{' '.join(words)}\n{done.output}"

    shells = [CodeBlockParser(language, look_at) for language in ("console", "bash")]
    return Sybil([PythonCodeBlockParser(), CodeBlockParser("usda", read_usd), CodeBlockParser("text", save), *shells])


@pytest.fixture
def folder(tmp_path: Path, builds: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory like that of a reader who has built the examples."""
    for name, there in (("build", builds / "build"), ("examples", ROOT / "examples"), ("stages", ROOT / "stages")):
        (tmp_path / name).symlink_to(there)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def evaluated(page: Path, run: set[str]) -> Document:
    """A page, all of whose blocks hold."""
    document = reader(run).parse(page)
    for example in document.examples():
        example.evaluate()
    return document


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_holds(page, folder):
    """Of the how-tos, `make test` runs the commands of the tour."""
    evaluated(page, RUN - {"show"} if page == TOUR else set())


@pytest.mark.heavy
@pytest.mark.parametrize("page", HOW_TOS, ids=name_of)
def test_how_tos_hold_with_what_they_run(page, folder):
    evaluated(page, RUN)


def test_the_product_of_the_how_to_is_made_on_a_white_image(folder):
    page = evaluated(ROOT / "docs/how_to/task.md", set()).namespace
    white = folder / "build/01_conventional/cameras/Rig.Camera/white.exr"
    page["darkest"](page["Darkest"](wavelength_nm=587.6), {"white": {"white.exr": white}}, folder)
    assert '"irradiance": 0.' in (folder / "darkest.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_files(page):
    """Their headings are looked for where the site is built."""
    links = re.findall(r"\]\(([^()#\s]+)(?:#[^()\s]+)?\)", page.read_text(encoding="utf-8"))
    assert [link for link in links if "://" not in link and not (page.parent / link).exists()] == []


def test_the_reference_of_the_schema_is_what_the_schema_says():
    assert schema_reference.stale() == {}, "python docs/schema_reference.py --write"
    shown = [name for model in schema_reference.models() for name in model.classes]
    assert sorted(shown) == sorted(schema_reference.classes()), "docs/schema.toml: each class on one page"


def test_version_is_one():
    """Of the package, the citation and the changelog."""
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f'version: "{version}"' in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {version}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.heavy
def test_the_site_builds_without_a_warning(tmp_path):
    pytest.importorskip("sphinx")
    options = ("-q", "-W", "--keep-going", "-b", "html", "-d", str(tmp_path / "read"), "-c", str(ROOT / "docs"))
    command = [sys.executable, "-m", "sphinx", *options, str(ROOT), str(tmp_path / "site")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "plen:squareSize" in (tmp_path / "site/docs/schema/targets.html").read_text(encoding="utf-8")
    assert "--check-determinism" in (tmp_path / "site/docs/cli.html").read_text(encoding="utf-8")


@pytest.mark.heavy
def test_the_notebook_prints_what_it_holds(common_store, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    run = [sys.executable, ROOT / "docs/notebook.py", ROOT / "docs/tutorial.ipynb"]
    done = subprocess.run(run, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
