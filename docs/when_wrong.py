"""Write docs/when_something_is_wrong.md: mistakes made on purpose, and what `pipeline` says to each.

    python docs/when_wrong.py [PAGE.md]

The mistakes stand in docs/when_wrong.toml. Each is an edit of a tiny dataset of tests/data, or files of its own, in an
empty folder; the command runs there, in this process. Only what version 54ef84b said is quoted, all else is run.
"""

import argparse
import contextlib
import difflib
import io
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import dedent
from unittest import mock

from pipeline import cli
from pipeline.share import share

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/when_something_is_wrong.md"
HEAD = """# When something is wrong

Mistakes that new users made in their first hour, and some more, made on purpose: what was written, what the command
said to it in an early version (54ef84b, shortened), what it says today, and how to mend it. `python docs/when_wrong.py`
writes this page by running every command; a test compares the page with what the commands print. The lines of single
tasks and all times are left out.

Before the first build, run `pipeline check dataset.usda`: it reads the stage, and looks at every target in every frame,
in seconds. `pipeline show dataset.usda` says what the cameras do.
"""
LEFT_OUT = "[…]"
PROGRESS = re.compile(r"\[\d+/\d+ |warning: waiting for ")
CHANGING = re.compile(r" in [\d.]+ s; store .*|  \[[0-9a-f]{12}\]$|^\tError in .* : ")
"""What a build prints of single tasks and of waits for others, times, digests of keys, places in the source of USD."""


@dataclass(frozen=True)
class Case:
    """One mistake: a table `[[case]]` of docs/when_wrong.toml."""

    title: str
    wrong: str
    said: str  # by 54ef84b
    mend: str
    command: str = ""  # of `pipeline`
    python: str = ""  # or a program, in a process of its own
    after: str = ""  # what a build of 54ef84b then did
    dataset: str = "tiny_conventional"  # of tests/data, which the case edits
    edits: list[tuple[str, str]] = field(default_factory=list)  # text of the dataset, and what stands there instead
    files: dict[str, str] = field(default_factory=dict)  # beside dataset.usda, by name
    lines: int | None = None  # of the answer that the page shows; all
    built: bool = False  # before the edit, by `pipeline build`

    @property
    def builds(self) -> bool:
        """Whether the answer takes a build, and so more than a moment."""
        return self.built or self.command.startswith("build")

    def right(self) -> str:
        """The text of the dataset before the edit, at home in any folder."""
        path = ROOT / "tests/data" / self.dataset / "dataset.usda"
        return path.read_text(encoding="utf-8").replace("@../../../stages/", "@")

    def edited(self) -> str:
        """The text with the mistake."""
        text = self.right()
        for old, new in self.edits:
            if text.count(old) != 1:
                raise ValueError(f"{self.title}: {old!r} stands {text.count(old)} times in {self.dataset}")
            text = text.replace(old, new)
        return text

    def change(self) -> str:
        """The lines of the edit with - and + before them, as little indented as may be."""
        lines = difflib.unified_diff(self.right().splitlines(), self.edited().splitlines(), n=0, lineterm="")
        kept = [line for line in lines if not line.startswith(("---", "+++", "@@"))]
        body = dedent("\n".join(line[1:] for line in kept)).split("\n")
        change = "\n".join(f"{line[0]} {rest}".rstrip() for line, rest in zip(kept, body, strict=True))
        return change.rstrip("\n+-")  # empty lines at its end


def cases() -> list[Case]:
    """All mistakes, in the order of the page."""
    with (ROOT / "docs/when_wrong.toml").open("rb") as file:
        return [Case(**row) for row in tomllib.load(file)["case"]]


def answer(case: Case) -> str:
    """What the command prints today, without this machine's folders."""
    with tempfile.TemporaryDirectory() as name, _inside(Path(name).resolve() / "mine") as folder:
        stage = Path("dataset.usda")
        if case.built:
            stage.write_text(case.right(), encoding="utf-8")
            _said("build dataset.usda")
        stage.write_text(case.edited(), encoding="utf-8")
        for file, text in case.files.items():
            Path(file).write_text(text, encoding="utf-8")
        text = _program(case.python) if case.python else _said(case.command)
    for path, short in ((folder, ""), (share("stages").resolve(), "stages/"), (ROOT, "")):
        text = text.replace(f"{path}/", short).replace(str(path), short or ".")
    lines = [line for line in text.rstrip().splitlines() if not PROGRESS.match(line)]
    cut = [LEFT_OUT] if case.lines is not None and case.lines < len(lines) else []
    return "\n".join([*(CHANGING.sub("", line.rstrip()) for line in lines[: case.lines]), *cut])


def _said(command: str) -> str:
    """What a command prints, in this process."""
    said = io.StringIO()
    typed = mock.patch.object(sys, "argv", ["pipeline", *command.split()])
    heard = contextlib.redirect_stdout(said), contextlib.redirect_stderr(said)
    with typed, heard[0], heard[1], contextlib.suppress(SystemExit):
        cli.main()
    return said.getvalue()


def _program(text: str) -> str:
    """What a program prints, or the last line of its traceback."""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
    return done.stdout + "".join(done.stderr.splitlines()[-1:])


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[Path]:
    """Work in a folder, with a store of results of its own."""
    store = {"PIPELINE_CACHE": str(folder / "store"), "PIPELINE_REPORT": "no", "COLUMNS": "120"}
    folder.mkdir()
    with contextlib.chdir(folder), mock.patch.dict(os.environ, store):
        yield folder


def section(case: Case) -> str:
    """The case as the page has it."""
    blocks = [f"## {case.title}", case.wrong]
    if case.edits:
        blocks.append(_fenced("diff", case.change()))
    blocks += [_fenced("", f"# {file}\n{text}") for file, text in case.files.items()]
    if case.python:
        blocks += [_fenced("python", case.python), "It said:", _fenced("", case.said), *filter(None, [case.after])]
        blocks += ["It says:", _fenced("", answer(case))]
    else:
        blocks += ["It said:", _fenced("", f"$ pipeline {case.command}\n{case.said}"), *filter(None, [case.after])]
        blocks += ["It says:", _fenced("", f"$ pipeline {case.command}\n{answer(case)}")]
    blocks.append(f"**To mend it:** {case.mend}")
    return "\n\n".join(blocks) + "\n"


def _fenced(kind: str, text: str) -> str:
    return f"```{kind}\n{text.strip()}\n```"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", nargs="?", type=Path, default=PAGE, help="file to write, else that of docs/")
    page = parser.parse_args().page
    page.write_text("\n".join([HEAD, *map(section, cases())]), encoding="utf-8")


if __name__ == "__main__":
    main()
