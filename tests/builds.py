"""Builds for tests that read output folders, and their tables by another reader than ours."""

import csv
import os
from pathlib import Path
from typing import Any

from places import DATA

from pipeline.app.build import Result, build


def made(stage: Path, out: Path, store: Path, **options: Any) -> Result:
    """A build that did not fail, by a store that others fill."""
    before = os.environ.get("PIPELINE_CACHE")
    os.environ["PIPELINE_CACHE"] = str(store)
    try:
        result = build(stage, out, jobs=1, **options)
    finally:
        os.environ.pop("PIPELINE_CACHE") if before is None else os.environ.update(PIPELINE_CACHE=before)
    assert result.exit_code == 0, [task.error for task in result.failures]
    return result


def tiny(kind: str, folder: Path, store: Path) -> Path:
    """Output folder of `tiny_conventional` or `tiny_plenoptic`, below a folder."""
    return made(DATA / f"tiny_{kind}/dataset.usda", folder / kind, store).out


def cells(table: Path) -> list[dict[str, str]]:
    """Rows of a table of a build, as Python's own reader has them."""
    with table.open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))
