"""The error of every reader in this room, and what all of them refuse."""

from pathlib import Path

from pipeline.errors import PipelineError

MAX_COMPRESSION_RATIO = 1032
"""The best that deflate can do, by its own documentation: a header that promises more lies."""


class DamagedFile(PipelineError):
    """A file that is not what its reader expects: truncated, altered, or written by something else.

    Parameters
    ----------
    path : path
        The file.
    reason : str
        What is wrong with it.
    line : int, optional
        Where, for text files, counted from 1.
    """

    def __init__(self, path: str | Path, reason: str, *, line: int | None = None) -> None:
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {reason}", hint="remove the file and build again")
        self.path = Path(path)
        self.reason = reason
        self.line = line
