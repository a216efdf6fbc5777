"""Task `truth_tile`: the rows of some target points, for the task `truth`, by method `direct`, which solves each row
alone.
"""

from pathlib import Path

from pipeline.files.jsonfile import write_json
from pipeline.files.tables import write_table
from pipeline.records.plain import to_plain
from pipeline.tasks.artefacts.cameras import Inputs, rig_of
from pipeline.tasks.params.truth import TruthTile as Params
from pipeline.tasks.truth import NOTES, ROWS, target_rows


def run(params: Params, inputs: Inputs, out: Path) -> None:
    """Write the rows and the notes about the targets."""
    rig = rig_of(inputs, params.table.labels.seed, params.square_px)
    notes, columns = target_rows(params.table, params.view, rig, inputs, params.points)
    write_table(out / ROWS, [], columns)
    write_json(out / NOTES, {"targets": to_plain(notes)})
