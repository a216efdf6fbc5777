"""Pages of the documents: their blocks of code, links and commands."""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import typer.main

from pipeline.cli import app

ROOT = Path(__file__).resolve().parents[1]
INDEX = ROOT / "docs/index.md"
PAGES = sorted(
    {
        *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CONVENTIONS.md")),
        *(
            path
            for folder in ("docs", "examples", "stages", "schemas", "benchmarks")
            for path in (ROOT / folder).rglob("*.md")
        ),
    }
)
ENDS_A_COMMAND = {"|", "|&", "||", "&", "&&", ";", ">", "<", "#"}


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text without indent, and the words before it."""

    page: Path
    language: str
    text: str
    before: str

    @property
    def commands(self) -> list[str]:
        """Lines that a reader types: behind `$ ` where there are such, else all of a shell's."""
        lines = [line.strip() for line in re.sub(r"\s*\\\n\s*", " ", self.text).split("\n")]
        typed = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
        return typed or (lines if self.language in ("bash", "console") else [])


def name_of(page: Path) -> str:
    """A short test id."""
    return page.relative_to(ROOT).as_posix()


@cache
def text_of(page: Path) -> str:
    """All of a page."""
    return page.read_text(encoding="utf-8")


def blocks(page: Path) -> Iterator[Block]:
    """Fenced blocks of a page, also those in lists."""
    text = text_of(page)
    for match in re.finditer(r"^( *)```(\S*)[^\n]*\n(.*?)^\1```$", text, re.MULTILINE | re.DOTALL):
        outdented = re.sub(f"^{match[1]}", "", match[3], flags=re.MULTILINE)
        yield Block(page, match[2], outdented, text[: match.start()].rstrip())


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return re.sub(r"^( *)```.*?^\1```$", "", text_of(page), flags=re.MULTILINE | re.DOTALL)


def typed_commands(page: Path) -> Iterator[list[str]]:
    """Words of each `pipeline …` that a page tells to type, in blocks, fenced or indented."""
    lines = [line for block in blocks(page) for line in block.commands]
    lines += re.findall(r"^    (?:\$ )?(pipeline .*)$", prose(page), re.MULTILINE)
    for line in lines:
        words = [word for word in words_of(line) if not re.match(r"\w+=", word)]
        if words and words[0] == "pipeline":
            yield words[1:]


def words_of(line: str) -> list[str]:
    """Words of a line of a shell up to the end of its first command."""
    # What a reader replaces, such as […], and comments after two blanks are not part of it.
    lexer = shlex.shlex(re.split(r"  +", line.strip())[0], posix=True, punctuation_chars=";<>|&")
    lexer.whitespace_split, lexer.commenters = True, "#"
    words = list(lexer)
    ends = [place for place, word in enumerate(words) if word in ENDS_A_COMMAND]
    return words[: ends[0]] if ends else words


@cache
def parser() -> Any:
    """The command's parser."""
    return typer.main.get_command(app)


def refusal(words: list[str]) -> str:
    """What the command's parser has against these words; empty: nothing. No file is looked at."""
    command, rest = parser(), list(words)
    while rest and hasattr(command, "commands"):
        name = rest.pop(0)
        if name.startswith("-"):
            known = {option for one in command.params for option in one.opts}
            return "" if name in known else f"no option {name}"
        if name not in command.commands:
            return f"no verb {name}"
        command = command.commands[name]
    context = command.context_class(command, info_name=command.name, help_option_names=["-h", "--help"])
    try:
        given, extra, _ = command.make_parser(context).parse_args(args=rest)
    except Exception as error:  # the parser's own classes are private to typer
        return f"{type(error).__name__}: {error}"
    if any(one.is_eager and given.get(one.name) is True for one in command.params) or given.get("help") is True:
        return ""  # --list, --help: they print and end
    needed = [one.name for one in command.params if one.required]
    missing = [name for name in needed if not isinstance(given.get(name), str | list | tuple)]
    return "; ".join([*(f"too much: {word}" for word in extra), *(f"needs {name}" for name in missing)])


def anchors(page: Path) -> set[str]:
    """What links to a page may name behind #: headings as GitHub and MyST spell them, and labels."""
    headings = re.findall(
        r"^#{1,6} +(.*?)\s*$", re.sub(r"^```.*?^```$", "", text_of(page), flags=re.M | re.S), re.MULTILINE
    )
    words = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading) for heading in headings)
    slugs = {re.sub(r"[^\w\- ]", "", word.lower()).replace(" ", "-") for word in words}
    return slugs | set(re.findall(r"^\(([\w-]+)\)=$", text_of(page), re.MULTILINE))


def links(page: Path) -> list[tuple[str, str]]:
    """Local links of a page: path, empty for itself, and anchor."""
    found = re.findall(r"\]\(([^()#\s]*)(?:#([^()\s]+))?\)", text_of(page))
    return [(path, anchor) for path, anchor in found if "://" not in path]


def contents() -> set[Path]:
    """All pages that a table of contents of the first page names."""
    named: set[Path] = set()
    for block in blocks(INDEX):
        if block.language == "{toctree}":
            entries = [line for line in block.text.split("\n") if line and not line.startswith(":")]
            for entry in entries:
                page = re.sub(r".*<(.*)>$", r"\1", entry)
                named.update(path.resolve() for path in INDEX.parent.glob(f"{page}.md"))
    return named


def usd_layer(text: str) -> Any:
    """A block of USD as a layer; fragments become the content of one."""
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous(".usda")
    if not text.startswith("#usda"):
        inside = re.match(r"\s*(?:uniform|rel|double|float|int|token|#|quat)", text)
        text = f'#usda 1.0\nover "Fragment"\n{{\n{text}\n}}\n' if inside else f"#usda 1.0\n{text}"
    if not layer.ImportFromString(text):
        raise ValueError("USD cannot read this")
    return layer
