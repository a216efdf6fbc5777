"""Places of the repository that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "tests/data"
TINY = DATA / "tiny_conventional/dataset.usda"
TINY_PLENOPTIC = DATA / "tiny_plenoptic/dataset.usda"
