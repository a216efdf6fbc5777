"""Tables that a program prints and, asked by `--write`, puts into a page between two comments."""

import argparse
from collections.abc import Callable
from pathlib import Path


def print_or_write(description: str, table: Callable[[], str], page: Path, program: str) -> None:
    """Print a table, or put it into the page where the comment names the program."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help=f"into {page.name}")
    arguments = parser.parse_args()  # before the table is made: --help needs none
    if not arguments.write:
        print(table(), end="")
        return
    begin, end = f"<!-- python {program} --write -->\n", "<!-- end -->\n"
    head, found, rest = page.read_text(encoding="utf-8").partition(begin)
    if not found:
        parser.error(f"{page.name} lacks the line {begin.strip()!r}")
    page.write_text(f"{head}{begin}{table()}{end}{rest.partition(end)[2]}", encoding="utf-8")
