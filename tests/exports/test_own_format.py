"""docs/export_format.md: a package that is not ours brings a format, and what is said if it is broken."""

import re
import sys
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builds import DATA
from exports.pretended import Scene, write_build
from stage_text import head

from pipeline import formats
from pipeline.app.build import build
from pipeline.exports.export import export
from pipeline.exports.writer_code import code_of_writer
from pipeline.formats import ExportError, format_of
from pipeline.results.output import open_output
from pipeline.scene.load import load

PAGE = Path(__file__).resolve().parents[2] / "docs/export_format.md"
STAGE = (
    head("Dataset", end=2)
    + f"""
def PlenDataset "Dataset" (
    prepend references = @{DATA}/tiny_conventional/dataset.usda@
)
{{
    uniform token[] plen:exports = ["corner-table"]
}}
"""
)


def install(folder: Path, code: str, project: dict) -> None:
    """What pip leaves of a package in a folder of the path."""
    place = folder / f"{project['name']}-{project['version']}.dist-info"
    place.mkdir(parents=True)
    (folder / "corner_table.py").write_text(code)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    entries = "\n".join(f"{name} = {module}" for name, module in project["entry-points"][formats.GROUP].items())
    (place / "entry_points.txt").write_text(f"[{formats.GROUP}]\n{entries}\n")


@pytest.fixture
def laboratory(tmp_path, monkeypatch):
    """Install the package of the page, or one with other code: its folder."""

    def installed(code: str = "") -> Path:
        python, project = (re.findall(f"```{word}\n(.*?)```", PAGE.read_text(), re.S) for word in ("python", "text"))
        folder = tmp_path / "site"
        install(folder, code or python[0], tomllib.loads(project[0])["project"])
        monkeypatch.syspath_prepend(folder)
        monkeypatch.delitem(sys.modules, "corner_table", raising=False)
        return folder

    yield installed
    sys.modules.pop("corner_table", None)


def test_a_build_is_exported_by_the_format_of_another_package(laboratory, tmp_path):
    laboratory()
    scene = Scene()
    (folder,) = export(open_output(write_build(tmp_path / "out", scene)), ["corner-table"], tmp_path)
    rows = pd.read_csv(folder / "Left.csv", comment="#")
    seen = np.concatenate([scene.pixels("Left", frame)[scene.ids("Left", frame)] for frame in scene.poses])
    np.testing.assert_allclose(rows[["x", "y"]], seen + 1, rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows[["board_x", "board_y"]].iloc[5], [0.01, 0.01], rtol=0, atol=1e-12)


def test_a_stage_asks_for_it_and_new_code_makes_a_new_key(laboratory, tmp_path, common_store, monkeypatch):
    (tmp_path / "stage.usda").write_text(STAGE)
    (error,) = load(tmp_path / "stage.usda", [DATA.parents[1]]).errors
    assert (error.code, error.line) == ("unknown-export", 15) and "opencv" in error.hint
    folder = laboratory()
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    result = build(tmp_path / "stage.usda", tmp_path / "out", jobs=1, allow_roots=(DATA.parents[1],))
    assert result.exit_code == 0, [task.error for task in result.failures]
    assert (tmp_path / "out/exports/corner-table/Rig.Camera.csv").is_file()
    before = code_of_writer("corner-table")
    code = (folder / "corner_table.py").read_text()
    (folder / "corner_table.py").write_text(f"# a comment\n{code}")
    assert code_of_writer("corner-table") == before
    (folder / "corner_table.py").write_text(code.replace('"board_x"', '"board_x_m"'))
    assert code_of_writer("corner-table") != before
    again = build(tmp_path / "stage.usda", tmp_path / "out", jobs=1, allow_roots=(DATA.parents[1],))
    (failure,) = again.failures  # this process has the old code
    assert "is not the one that this build was planned with" in str(failure.error)


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import nowhere_to_be_found", "ModuleNotFoundError: No module named 'nowhere_to_be_found'"),
        ("FORMAT = 1", "is corner_table, which has no FORMAT or no write"),
    ],
)
def test_a_broken_package_is_named_and_disturbs_no_other(laboratory, code, said):
    laboratory(code)
    with pytest.raises(ExportError, match='"corner-table" of the package laboratory') as error:
        format_of("corner-table")
    assert said in str(error.value) and "corner-table" in formats.names()
    assert format_of("opencv").files and "corner-table" not in formats.loadable()


def test_two_packages_with_one_name_are_both_named(laboratory, tmp_path, monkeypatch):
    laboratory()
    project = {"name": "another", "version": "2", "entry-points": {formats.GROUP: {"corner-table": "corner_table"}}}
    install(tmp_path / "other", "", project)
    monkeypatch.syspath_prepend(tmp_path / "other")
    with pytest.raises(ExportError, match="the packages another and laboratory each have"):
        format_of("corner-table")
