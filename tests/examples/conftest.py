"""What the pages read: small builds in the places of those of examples 01 and 02."""

from pathlib import Path

import pytest
from builds import DATA, tiny

import pipeline


@pytest.fixture(scope="session")
def builds(tmp_path_factory: pytest.TempPathFactory, common_store: Path) -> Path:
    """A folder with build/01_conventional, and with build/02_plenoptic, which has every kind of file."""
    folder = tmp_path_factory.mktemp("pages")
    (folder / "build").mkdir()
    tiny("conventional", folder / "build", common_store).rename(folder / "build/01_conventional")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(common_store))
        stage = DATA / "reading/dataset.usda"
        result = pipeline.build(stage, folder / "build/02_plenoptic", jobs=1, allow_roots=(DATA,))
    assert result.exit_code == 0, [task.error for task in result.failures]
    return folder
