"""Task `truth_tile`: the rows of some target points, for the task `truth`; of the method that solves each alone."""

from pathlib import Path
from typing import Any

from pipeline.files.jsonfile import write_json
from pipeline.files.tables import write_table
from pipeline.records import to_plain
from pipeline.tasks.cameras import Inputs
from pipeline.tasks.truth import NOTES, ROWS, target_rows


def run(params: dict[str, Any], inputs: Inputs, out: Path) -> None:
    """Params: those of `truth`; points."""
    notes, columns = target_rows(params, inputs)
    write_table(out / ROWS, [], columns)
    write_json(out / NOTES, {"targets": to_plain(notes)})
