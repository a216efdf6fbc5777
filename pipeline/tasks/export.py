"""Task `export`: the delivered build as the files of another program, as `pipeline export` writes them."""

from dataclasses import replace
from pathlib import Path

from pipeline.exports.export import Request, write_export
from pipeline.exports.writer_code import require_code
from pipeline.results.output import open_output
from pipeline.tasks.params.outputs import Export


def run(params: Export, folder: Path, out: Path) -> None:
    """Write the files of the format, and export.json."""
    require_code(params.format, params.code)
    output = replace(open_output(folder), stage=params.stage)
    request = Request(only=params.cameras, position=params.position, noise=params.noise)
    write_export(output, params.format, out, request)
