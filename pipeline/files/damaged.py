"""The error of all readers in this room, and a limit that all of them apply."""

from pathlib import Path

from pipeline.errors import PipelineError

MAX_COMPRESSION_RATIO = 1032
"""The best compression ratio of deflate according to its documentation: a header that promises more is wrong."""


class DamagedFile(PipelineError):
    """A file does not have the expected content: truncated, altered, or written by another program."""

    def __init__(self, path: str | Path, reason: str, *, line: int | None = None) -> None:
        location = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{location}: {reason}", hint="remove the file and build again")
        self.reason = reason
