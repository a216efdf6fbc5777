"""Builds of the tiny datasets, for tests that read output folders."""

import os
from pathlib import Path

from pipeline.app.build import build

DATA = Path(__file__).parent / "data"


def tiny(kind: str, folder: Path, store: Path) -> Path:
    """Output folder of `tiny_conventional` or `tiny_plenoptic`, below a folder, by a store that others fill."""
    before = os.environ.get("PIPELINE_CACHE")
    os.environ["PIPELINE_CACHE"] = str(store)
    try:
        result = build(DATA / f"tiny_{kind}/dataset.usda", folder / kind, jobs=1)
    finally:
        os.environ.pop("PIPELINE_CACHE") if before is None else os.environ.update(PIPELINE_CACHE=before)
    assert result.exit_code == 0, [task.error for task in result.failures]
    return folder / kind
