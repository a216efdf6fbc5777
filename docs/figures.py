"""Hold every figure of the documents against what its command prints.

    python docs/figures.py                   say which figures differ, and which nothing covers
    python docs/figures.py --write           put what the commands printed into the documents
    python docs/figures.py --run NAME...     run commands anew, and keep what they print in docs/printed/

docs/figures.toml says which command prints what, and where it is quoted. A test compares the documents with what is
kept, and runs the cheap commands anew; `make long` runs the costly ones. Commands run in a copy of the
examples, with an empty store of results unless PIPELINE_CACHE names one.
"""

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from decimal import Decimal
from functools import cached_property
from pathlib import Path

from quotes import Quote, Span, figures, places

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs/figures.toml"
PRINTED = ROOT / "docs/printed"
GENERATED = {  # by when_wrong.py and public_numbers.py, with tests of their own
    ROOT / "docs/when_something_is_wrong.md",
    ROOT / "docs/public_numbers.md",
}
DOCUMENTS = sorted(
    {
        ROOT / "README.md",
        ROOT / "benchmarks/README.md",
        *ROOT.glob("docs/*.md"),
        *ROOT.glob("docs/how_to/*.md"),
        *ROOT.glob("examples/*/README.md"),
    }
    - GENERATED
)
COPIED = ("benchmarks", "docs", "examples", "stages", "pyproject.toml")

TIME = re.compile(r"(?<![\w.])[\d.]+(?:e[-+]?\d+)? (?=(?:s|µs|rays/s|ray-surfaces/s)\b)")
ELSEWHERE = (
    (re.compile(r"; store .*"), ""),
    (re.compile(r"\[[0-9a-f]{12}\]"), "[…]"),
    (re.compile(r"^warning: waiting for .*\n", re.MULTILINE), ""),
    (re.compile(r"[\d.]+(?= GB in one process)"), "[…]"),
)
"""What an output says of this machine's store and memory, digests of keys, waits for others: none is kept."""


@dataclass(frozen=True)
class Command:
    """What prints figures: a table `[[command]]`.

    `costs`: "seconds", which `make test` spends, or "minutes", which `make long` does.
    """

    name: str
    run: str  # lines of bash
    costs: str

    @property
    def kept(self) -> Path:
        """File of what it printed; the first line says when and where."""
        return PRINTED / f"{self.name}.txt"

    @cached_property
    def printed(self) -> str:
        """What it printed, each line of bash with `$ ` before its output."""
        return self.kept.read_text(encoding="utf-8").partition("\n")[2]

    def output(self) -> str:
        """What it prints now."""
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name).resolve()
            for part in COPIED:
                (shutil.copytree if (ROOT / part).is_dir() else shutil.copy)(ROOT / part, folder / part)
            path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
            store = os.environ.get("PIPELINE_CACHE", str(folder / "store"))
            environment = {**os.environ, "PATH": path, "PIPELINE_CACHE": store, "COLUMNS": "120"}
            said = [self._line(line, folder, environment) for line in self.run.strip().split("\n")]
        text = "".join(said).replace(f"{folder}/", "").replace(str(ROOT), "…")
        for pattern, instead in ELSEWHERE:
            text = pattern.sub(instead, text)
        return text

    def _line(self, line: str, folder: Path, environment: dict[str, str]) -> str:
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        return f"$ {line}\n{done.stdout}"


def entries() -> tuple[dict[str, Command], list[Quote]]:
    """Commands by name, and what is quoted of them or stands for itself."""
    with TABLE.open("rb") as file:
        rows = tomllib.load(file)
    commands = {row["name"]: Command(**row) for row in rows["command"]}
    return commands, [Quote(**row) for kind in ("quote", "measured", "constant") for row in rows[kind]]


def wanted(quote: Quote, command: Command, text: str, spans: list[Span]) -> list[str]:
    """What a document should have in these places, written as it writes there."""
    if quote.block:
        return [excerpt(text[slice(*spans[0])], command.printed)]
    values = list(_printed(quote, command.printed))
    if len(values) != len(spans):
        raise ValueError(f"{quote}: {len(spans)} figures, but {command.name} prints {len(values)}: {values}")
    return [written_like(text[slice(*span)], value) for span, value in zip(spans, values, strict=True)]


def _printed(quote: Quote, output: str) -> Iterator[str]:
    """The figures of a quote in an output: those of the same table, or the groups of its regular expression."""
    if not quote.printed:
        yield from (output[slice(*span)] for spans in places(quote, output) for span in spans)
    for match in re.finditer(quote.printed, output, re.MULTILINE) if quote.printed else ():
        yield from filter(None, match.groups())


def written_like(figure: str, value: str) -> str:
    """A printed number with the digits and in the style of a figure of a document."""
    old, new = (Decimal(number.replace(",", "")) for number in (figure, value))
    if abs(old - new) <= Decimal(5).scaleb(int(old.as_tuple().exponent) - 1):
        return figure
    if "e" in figure:
        mantissa, exponent = f"{new:.{len(old.as_tuple().digits) - 1}e}".split("e")
        return f"{mantissa}e{int(exponent):+03d}" if re.search(r"e[-+]\d\d", figure) else f"{mantissa}e{int(exponent)}"
    places = max(0, -int(old.as_tuple().exponent))
    comma, sign = "," if "," in figure else "", "+" if figure[0] == "+" else "-"
    return f"{new:{sign}{comma}.{places}f}"


def excerpt(block: str, printed: str) -> str:
    """A block with what its commands printed; without commands, what the last one did.

    A last line … or […] stays, and so does the number of lines above it; comments behind commands stay, and what a
    command is piped into is not shown. Of a command that was run twice, this is the second answer.
    """
    indent = re.match(r" *", block)[0]
    parts = (part.split("\n", 1) for part in re.split(r"^\$ ", printed, flags=re.MULTILINE)[1:])
    answers = {line.partition(" |")[0]: answer for line, answer in parts}
    shown = []
    for part in re.split(rf"^(?={indent}\$ )", block, flags=re.MULTILINE):
        head, *old = [line.removeprefix(indent) for line in part.rstrip("\n").split("\n")] if part else [""]
        if not part:
            continue
        if not head.startswith("$ "):
            head, old = "", [head, *old]
        typed = head[2:].partition("  #")[0].strip() if head else list(answers)[-1]
        if typed not in answers:
            raise ValueError(f"nothing is kept of $ {typed}")
        new = answers[typed].rstrip("\n").split("\n")
        cut = bool(old) and old[-1] in ("…", "[…]")
        shown += [*([head] if head else []), *(new[: len(old) - 1] if cut else new), *(old[-1:] if cut else [])]
    return "".join(f"{indent}{line}".rstrip() + "\n" for line in shown)


def same(here: str, there: str) -> bool:
    """Whether two texts are the same but for times."""
    return TIME.sub("", here) == TIME.sub("", there)


def differences(document: Path, write: bool = False) -> list[str]:
    """Figures of a document that are not what their commands printed; `write` mends them."""
    commands, quotes = entries()
    text, changes, wrong = document.read_text(encoding="utf-8"), [], []
    for quote in quotes:
        if not quote.of or ROOT / quote.file != document:
            continue
        found = places(quote, text)
        if len(found) != 1:
            wrong.append(f"{quote}: it is there {len(found)} times")
            continue
        try:
            news = wanted(quote, commands[quote.of], text, found[0])
        except ValueError as error:
            wrong.append(str(error))
            continue
        for span, new in zip(found[0], news, strict=True):
            if not same(text[slice(*span)], new):
                changes.append((span, new))
                wrong.append(f"{place(document, text, span)}, of {quote.of} now {new}")
    if write and changes:
        for (start, end), new in sorted(changes, reverse=True):
            text = text[:start] + new + text[end:]
        document.write_text(text, encoding="utf-8")
    return wrong


def uncovered(document: Path) -> list[str]:
    """Figures of a document that no entry of docs/figures.toml covers."""
    text = document.read_text(encoding="utf-8")
    here = [quote for quote in entries()[1] if not quote.file or ROOT / quote.file == document]
    covered = {index for quote in here for spans in places(quote, text) for span in spans for index in range(*span)}
    found = sorted({span for span in figures(text) if not covered.issuperset(range(*span))})
    return [place(document, text, span) for span in found]


def place(document: Path, text: str, span: Span) -> str:
    """File, line and figure."""
    return f"{document.relative_to(ROOT)}:{text.count(chr(10), 0, span[0]) + 1}: {text[slice(*span)]}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put what is kept into the documents")
    parser.add_argument("--run", nargs="+", metavar="NAME", default=[], help="run these commands, and keep the output")
    chosen = parser.parse_args()
    commands = entries()[0]
    for name in chosen.run:
        keep(commands[name], commands[name].output())
    wrong = [line for document in DOCUMENTS for line in differences(document, chosen.write)]
    wrong += [f"{line}: nothing covers this" for document in DOCUMENTS for line in uncovered(document)]
    print("\n".join(wrong))
    sys.exit(1 if wrong else 0)


def keep(command: Command, output: str) -> None:
    """Write what a command printed, with the day and the machine."""
    model = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else None
    where = f"{os.cpu_count()} cores, {model[1] if model else platform.processor()}, Python {platform.python_version()}"
    today = f"{date.today().day} {date.today():%B %Y}"
    command.kept.write_text(f"Printed on {today}: {where}.\n{output}", encoding="utf-8")


if __name__ == "__main__":
    main()
