"""What the pages read: small builds in the places of those of examples 01 and 02."""

from pathlib import Path

import pytest
from builds import DATA, made, tiny


@pytest.fixture(scope="session")
def builds(tmp_path_factory: pytest.TempPathFactory, common_store: Path) -> Path:
    """A folder with build/01_conventional, and with build/02_plenoptic, which has every kind of file."""
    folder = tmp_path_factory.mktemp("pages")
    (folder / "build").mkdir()
    tiny("conventional", folder / "build", common_store).rename(folder / "build/01_conventional")
    made(DATA / "reading/dataset.usda", folder / "build/02_plenoptic", common_store, allow_roots=(DATA,))
    return folder
