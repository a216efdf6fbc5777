"""Figures in the Markdown of the documents: where a quote has them, and where any are."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

NUMBER = r"[-+]?\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?"
UNIT = r"(?:px²|px|rays|rows|tasks|samples|files|%|s|ms|µs|min|minutes?|hours?|million|times|GB|MB)(?!\w)"
Span = tuple[int, int]


@dataclass(frozen=True)
class Quote:
    """Figures of a document: a table `[[quote]]`, `[[measured]]` or `[[constant]]`.

    One of `text`, `table` and `block` says where they are. Quotes name their command in `of`; measured ones are those
    of a `machine` at a `date`, with the command to repeat them; constants have a source.
    """

    file: str = ""  # below the root; a constant without one may be in any document
    text: str = ""  # words of the document, each {} a figure; blanks and line breaks are the same
    table: str = ""  # beginning of the head of a Markdown table
    columns: list[int] = field(default_factory=list)  # of it, from 0; all but the first
    block: str = ""  # first line of a block, which shows lines of the output; a last line … leaves out the rest
    of: str = ""
    printed: str = ""  # regular expression: its groups, over all matches, are the figures in their order
    command: str = ""
    date: str = ""
    machine: str = ""
    source: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.text or self.table or self.block}"


def places(quote: Quote, text: str) -> list[list[Span]]:
    """The figures of a quote in the text of a document, once for each place where it stands."""
    if quote.table:
        return [list(_cells(quote, text, match.start())) for match in re.finditer(re.escape(quote.table), text)]
    if quote.block:
        return [[span] for span in blocks(text) if text[slice(*span)].lstrip().startswith(quote.block)]
    words = (r"\s+".join(map(re.escape, part.split(" "))) for part in quote.text.split("{}"))
    pattern = rf"({NUMBER})".join(words)
    if quote.source:
        return [[match.span()] for match in re.finditer(pattern, text)]
    return [[match.span(i + 1) for i in range(match.re.groups)] for match in re.finditer(pattern, text)]


def _cells(quote: Quote, text: str, start: int) -> Iterator[Span]:
    """Numbers in the rows of a table whose head begins at `start`."""
    end = text.find("\n\n", start)
    rows = re.finditer(r"^\|.*\|$", text[start : None if end < 0 else end], re.MULTILINE)
    for row in list(rows)[1:]:
        if set(row[0]) <= set("| -:"):
            continue
        for column, cell in enumerate(re.finditer(r"(?<=\|)[^|]*", row[0][:-1])):
            if column in (quote.columns or range(1, 99)):
                first = start + row.start() + cell.start()
                yield from ((first + one.start(), first + one.end()) for one in re.finditer(NUMBER, cell[0]))


def blocks(text: str) -> Iterator[Span]:
    """Fenced blocks without a language and indented ones, without their fences."""
    outside = 0
    for fenced in re.finditer(r"^```(.*)\n((?:.*\n)*?)```$", text, re.MULTILINE):
        yield from _indented(text, outside, fenced.start())
        outside = fenced.end()
        if not fenced[1]:
            yield fenced.span(2)
    yield from _indented(text, outside, len(text))


def _indented(text: str, start: int, end: int) -> Iterator[Span]:
    for block in re.finditer(r"(?<=\n\n)(?:    .*\n)+(?=\n|$)", text[start:end]):
        yield start + block.start(), start + block.end()


def figures(text: str) -> Iterator[Span]:
    """Numbers with a unit, cells of tables that are numbers, and numbers in blocks without a language."""
    code = [match.span() for match in re.finditer(r"^```\w+\n(?:.*\n)*?```$", text, re.MULTILINE)]
    cell = rf"(?<=[^\n]\|) *({NUMBER})(?= *(?:{UNIT})? *\|)"
    for pattern in (rf"(?<![\w.,/-])({NUMBER})(?= ?{UNIT})", cell):
        for match in re.finditer(pattern, text):
            if not any(start <= match.start() < end for start, end in code):
                yield match.span(1)
    for start, end in blocks(text):
        for match in re.finditer(rf"(?<![\w./-]){NUMBER}(?![\w/])", text[start:end]):
            yield start + match.start(), start + match.end()
