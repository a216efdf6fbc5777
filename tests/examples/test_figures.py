"""Every figure of the documents is what its command prints, or has a day and a machine, or a source."""

import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "docs"))  # its modules lie beside the script that imports them

import figures  # noqa: E402
import quotes  # noqa: E402

COMMANDS, QUOTES = figures.entries()
MEND = "python docs/figures.py --write puts what is kept in docs/printed into the documents"


def name_of(command: figures.Command) -> str:
    """A short test id."""
    return command.name


def test_figures_are_those_that_their_commands_printed():
    assert [line for document in figures.DOCUMENTS for line in figures.differences(document)] == [], MEND


def test_no_figure_is_without_a_command_or_a_source():
    wrong = [line for document in figures.DOCUMENTS for line in figures.uncovered(document)]
    assert wrong == [], "docs/figures.toml lists what covers a figure"


@pytest.mark.parametrize("command", [one for one in COMMANDS.values() if one.costs == "seconds"], ids=name_of)
def test_cheap_commands_print_today_what_is_kept(command, monkeypatch):
    monkeypatch.delenv("PIPELINE_CACHE", raising=False)
    assert figures.same(command.output(), command.printed), f"python docs/figures.py --run {command.name}"


COSTLY = [one for one in COMMANDS.values() if one.costs != "seconds"]


@pytest.mark.long
@pytest.mark.parametrize("command", COSTLY, ids=name_of)
def test_costly_commands_print_today_what_is_kept(command, monkeypatch, common_store):
    """By a store that others fill, unless a command prints how many tasks were executed or cached.

    Last digits and counts of rays depend on the level of the processor, so no other machine is asked for them.
    """
    if "executed" in command.printed or "cached" in command.printed:
        monkeypatch.delenv("PIPELINE_CACHE", raising=False)
    else:
        monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    assert figures.same(command.output(), command.printed), f"python docs/figures.py --run {command.name}"


def test_what_no_command_prints_again_is_there_and_has_a_day_or_a_source():
    wrong = {str(quote): lacks(quote) for quote in QUOTES if not quote.of}
    assert {quote: reason for quote, reason in wrong.items() if reason} == {}


def lacks(quote: quotes.Quote) -> str:
    """What an entry lacks whose figures no command prints again; empty: nothing."""
    texts = [path.read_text(encoding="utf-8") for path in figures.DOCUMENTS if path == ROOT / (quote.file or path)]
    if not any(quotes.places(quote, text) for text in texts):
        return "a place: it is in no document"
    if quote.source:
        files = re.findall(r"`(\S+/\S+|\w+file)`", quote.source)
        return ", ".join(file for file in files if not (ROOT / file).exists())
    if quote.date not in " ".join(texts[0].split()) or not re.search(r"cores? of an? ([^,]+?),", texts[0]):
        return "a document that names the day and the machine"
    goal, script = re.match(r"make (\w+)$", quote.command), re.match(r"python (\S+)$", quote.command)
    if goal and not re.search(rf"^{goal[1]}:", (ROOT / "Makefile").read_text(), re.MULTILINE):
        return f"a goal {goal[1]} of the Makefile"
    return f"a script {script[1]}" if script and not (ROOT / script[1]).exists() else ""


def test_every_command_is_quoted_and_what_it_printed_says_when():
    head = re.compile(r"Printed on \d+ \w+ \d{4}: \d+ cores, .+, Python 3\.\d+\.\d+\.$")
    heads = {name: command.kept.read_text(encoding="utf-8").split("\n")[0] for name, command in COMMANDS.items()}
    assert set(COMMANDS) - {quote.of for quote in QUOTES} == set()
    assert [name for name, line in heads.items() if not head.match(line)] == []


@pytest.mark.parametrize(
    ("figure", "value", "shown"),
    [
        ("0.0016", "2.1447e-03", "0.0021"),
        ("0.0135", "0.01345", "0.0135"),
        ("2,721", "3258", "3,258"),
        ("6.34e7", "6.71e+07", "6.71e7"),
        ("4.7e-05", "0.000051", "5.1e-05"),
        ("+0.007", "0.0081", "+0.008"),
        ("100", "99.98", "100"),
    ],
)
def test_a_printed_number_is_written_as_the_document_writes_it(figure, value, shown):
    assert figures.written_like(figure, value) == shown


def test_a_new_figure_is_seen_wherever_it_stands():
    """In prose, in a cell of a table, in a block of output; not in a program and not in the first column."""
    page = "It is 0.25 px off.\n\n| K | px |\n|---|---|\n| 7 | 0.5 |\n\n```\nit took 9 of 8\n```\n"
    page += "\n```python\nx = 3\n```\n\n    rows 41\n\nUp to 2.1 or so in f/1.8.\n"
    assert [page[slice(*span)] for span in sorted(set(quotes.figures(page)))] == ["0.25", "0.5", "9", "8", "41"]


def test_a_block_shows_what_the_command_prints_now():
    kept = "$ pipeline plan x.usda | head -1\n3 tasks\nmore\n$ python y.py\na 1\nb 2\nc 3\n"
    assert figures.excerpt("$ pipeline plan x.usda  # now\n2 tasks\n[…]\n", kept) == (
        "$ pipeline plan x.usda  # now\n3 tasks\n[…]\n"
    )
    assert figures.excerpt("    a 7\n    b 7\n    …\n", kept) == "    a 1\n    b 2\n    …\n"
    with pytest.raises(ValueError, match="nothing is kept"):
        figures.excerpt("$ pipeline show x.usda\n", kept)
    assert figures.same("done in 1.5 s", "done in 20 s") and not figures.same("4 tasks in 1.5 s", "3 tasks in 1.5 s")
