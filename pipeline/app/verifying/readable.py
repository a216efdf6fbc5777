"""Check that the files of a folder can be read, in a process with limits, because foreign libraries read them.

The process writes one line per file. If a reader crashes, the file is known, and another process goes on with the rest.
"""

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from pipeline.confine.process import Bounds, confine
from pipeline.engine.output.foreign import ForeignFolder, Unfit
from pipeline.files.damaged import DamagedFile
from pipeline.machine.another_python import command
from pipeline.machine.processor import settings

MEMORY_BYTES = 4 * 2**30
"""Memory of the process that opens the files [bytes], the same as for reading an untrusted stage: a file is read as a
whole, and a hostile one may be made to fill any memory.
"""
_FILE_S, _SLOWEST_BYTES_PER_S = 60.0, 10e6
"""Time limit of a file: these seconds, plus its size over this rate [bytes/s], slower than any disk."""
_TOO_LARGE = f"needs more than {MEMORY_BYTES // 2**30} GiB of memory"

_OTHERS = "exports/"
"""Folder of the files of other programs, whose readers are not ours: their digests are compared."""
_PICTURES = re.compile(r"pictures/[0-9a-f]{16}\.\w+")
"""Names of pictures of the stage, by their content: the stage is read with them."""
_ENDINGS = (".exr", ".png", ".json", ".csv", ".tiff", ".dng")

Reader = Callable[[Path], Any]


def unreadable(root: Path, names: Iterable[str]) -> tuple[dict[str, str], dict[str, str]]:
    """Files with damaged content, and files too large to be checked: name -> reason each."""
    ours = (name for name in sorted(names) if not name.startswith(_OTHERS) and not is_of_stage(name))
    left = [name for name in ours if Path(name).suffix in _ENDINGS]
    damaged, unknown = dict[str, str](), dict[str, str]()
    while left:
        answers, ended = _ask(root, left)
        for name, reason in zip(left, answers, strict=False):
            if reason:
                (unknown if reason == _TOO_LARGE else damaged)[name] = reason
        left = left[len(answers) :]
        if left:
            damaged[left.pop(0)] = f"its reader {ended}"
    return damaged, unknown


def is_of_stage(name: str) -> bool:
    """Whether a file is a picture that the stage names, of whatever program."""
    return _PICTURES.fullmatch(name) is not None


def main() -> None:
    """Run the confined process: root and names come on stdin, one line of JSON per file goes to stdout."""
    question = json.load(sys.stdin)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print must not mix with the answers
    bounds = Bounds(memory_bytes=MEMORY_BYTES, cpu_s=question["cpu_s"], file_bytes=0)
    confine([Path(question["root"])], bounds, question["parent"])
    for name in question["names"]:
        print(json.dumps(_reason(Path(question["root"]), name)), file=answers, flush=True)


def _reason(root: Path, name: str) -> str | None:
    """The reason why a file cannot be read. None if it can, or if it is no file, which is reported elsewhere."""
    try:
        handle = ForeignFolder(root).open(name)
    except Unfit:
        return None
    place = Path(f"/proc/self/fd/{handle}")  # the open file: nobody can replace it meanwhile
    try:
        _reader(name)(place)
    except DamagedFile as error:
        return error.reason
    except MemoryError:
        return _TOO_LARGE
    finally:
        os.close(handle)
    return None


def _reader(name: str) -> Reader:
    """The reader of a file, by its suffix. A library is loaded with the first file that needs it."""
    if name.endswith(".exr"):
        from pipeline.files.exr import read_exr

        return read_exr
    if name.endswith(".png"):
        from pipeline.files.png import read_png

        return read_png
    if name.endswith((".tiff", ".dng")):
        from pipeline.files.tiff import read_tiff

        return read_tiff
    if name.endswith(".json"):
        from pipeline.files.jsonfile import read_json

        return read_json
    from pipeline.files.tables import read_table

    return read_table


def _ask(root: Path, names: list[str]) -> tuple[list[str | None], str]:
    """Answers about the first names, and how the process ended if it left some unanswered."""
    allowed_s = _FILE_S * len(names) + sum(_sizes(root, names)) / _SLOWEST_BYTES_PER_S
    order = {"root": str(root.absolute()), "names": names, "cpu_s": math.ceil(allowed_s), "parent": os.getpid()}
    try:
        done = subprocess.run(
            command("pipeline.app.verifying.readable:main"),
            input=json.dumps(order).encode(),
            capture_output=True,
            timeout=allowed_s,
            env={**os.environ, **settings()},
            check=False,
        )
        said, ended = done.stdout, f"ended with code {done.returncode}"
    except subprocess.TimeoutExpired as error:
        said, ended = error.stdout or b"", f"did not end in {allowed_s:.0f} s"
    return [json.loads(line) for line in said.splitlines(keepends=True) if line.endswith(b"\n")], ended


def _sizes(root: Path, names: list[str]) -> Iterator[int]:
    for name in names:
        try:
            yield (root / name).lstat().st_size
        except OSError:
            yield 0
