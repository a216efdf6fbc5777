"""Exports that a stage asks for: made of the delivered folder, as `pipeline export` makes them."""

import re
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builds import made as build_of
from places import DATA, ROOT
from plugins.formats.pretended import Scene, write_build
from shorter import few
from stage_text import head

from pipeline import formats
from pipeline.app.build import Result, build, project
from pipeline.engine.planning import task_code
from pipeline.errors import Exit
from pipeline.exports.export import Request, export
from pipeline.exports.noise import Noise
from pipeline.exports.writer_code import code_of_writer
from pipeline.formats import ExportError, format_of
from pipeline.results.output import open_output
from pipeline.results.records import finished_folder
from pipeline.scene.load import load

ASKED = {
    "conventional": [
        "opencv",
        "mrcal",
        "colmap",
        "kalibr",
        "npz",
        "rays",
        "stmap",
        "depth",
        "ros",
        "nerfstudio",
        "hdf5",
        "matlab",
        "bop",
    ],
    "plenoptic": ["libpleno", "bok", "lftoolbox", "plenopticam", "npz", "hdf5", "depth", "lightfield"],
}
ROOTS = (DATA.parents[1],)
NOISE = Noise(noise_px=0.2, outliers=0.1, missed=0.1, seed=5)


def stage_text(kind, formats, **noise) -> str:
    lines = "".join(f"    uniform {line}\n" for line in noise.values())
    names = ", ".join(f'"{name}"' for name in formats)
    return (
        f"{head('Dataset', end=2)}\n"
        'def PlenDataset "Dataset" (\n'
        f"    prepend references = @{DATA}/tiny_{kind}/dataset.usda@\n)\n{{\n"
        f"    uniform token[] plen:exports = [{names}]\n{lines}}}\n"
    )


NOISY = {
    "noise": "double plen:exports:noise = 0.2",
    "outliers": "double plen:exports:outliers = 0.1",
    "missed": "double plen:exports:missed = 0.1",
    "seed": "int plen:exports:noiseSeed = 5",
}


@pytest.fixture
def made(tmp_path, common_store):
    def run(text):
        (tmp_path / "stage.usda").write_text(text)
        return build_of(tmp_path / "stage.usda", tmp_path / "out", common_store, allow_roots=ROOTS), tmp_path / "out"

    return run


@pytest.mark.parametrize("kind", few(["conventional"], "plenoptic"))
def test_a_build_writes_what_the_command_writes_of_it(kind, made, tmp_path):
    """Byte by byte, noise included; the rays of a task are those of the camera made ready from the folder."""
    _, out = made(stage_text(kind, ASKED[kind], **NOISY))
    output = replace(open_output(out), stage="</Dataset>")
    readers = [name for name in ASKED[kind] if "correspondences and poses" in format_of(name).reads]
    others = [name for name in ASKED[kind] if name not in readers]
    folders = export(output, readers, tmp_path / "by_hand", Request(noise=NOISE))
    folders += export(output, others, tmp_path / "by_hand")  # rays have no observations, so no noise
    for folder in folders:
        there = out / "exports" / folder.name
        names = sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())
        assert names == sorted(str(path.relative_to(there)) for path in there.rglob("*") if path.is_file())
        for name in names:
            assert (folder / name).read_bytes() == (there / name).read_bytes(), (folder.name, name)


def test_another_seed_rebuilds_the_exports_alone_and_another_format_adds_one(made):
    made(stage_text("conventional", ["npz", "rays"], **NOISY))
    first, out = made(stage_text("conventional", ["npz", "rays"], **NOISY | {"seed": "int plen:exports:noiseSeed = 6"}))
    assert [task.name for task in first.tasks if task.state == "executed"] == ["export/npz"]
    before = np.load(out / "exports/npz/Rig.Camera.correspondences.npz")["x_px"]
    more = stage_text("conventional", ["colmap", "npz", "rays"], **NOISY | {"seed": "int plen:exports:noiseSeed = 6"})
    second, _ = made(more)
    assert [task.name for task in second.tasks if task.state == "executed"] == ["export/colmap"]
    assert (np.load(out / "exports/npz/Rig.Camera.correspondences.npz")["x_px"] == before).all()
    fewer, _ = made(stage_text("conventional", ["npz"]))
    assert sorted(path.name for path in (out / "exports").iterdir()) == ["npz"]
    assert [task.name for task in fewer.tasks if task.state == "executed"] == ["export/npz"]  # without noise


def test_the_plan_knows_every_file_of_a_rig_with_both_kinds_of_cameras():
    """A format takes the cameras that it can describe; the names of pairs follow the order of an opened build."""
    cameras = {"A@red": False, "A@blue": False, "B@red": False}
    assert format_of("opencv").paths(cameras, {name: [1] for name in cameras}, 1) == sorted(
        [f"{name}.{ending}" for name in cameras for ending in ("npz", "yml")]
        + ["stereo-A@red-B@red.npz", "stereo-A@red-B@red.yml", "export.json"]
    )
    paths = format_of("npz").paths({"A": False, "B": True}, {"A": [1], "B": [1]}, 1)
    assert [path for path in paths if "micro" in path] == ["B.micro_images.npz"]
    two = ["A/0001.depth.exr", "A/0020.depth.exr", "export.json"]
    assert format_of("depth").paths({"A": False}, {"A": [1, 20]}, 2) == two
    masks = [path for path in format_of("bop").paths({"A": False}, {"A": [20]}, 2) if "visib" in path]
    assert masks == ["000000/mask_visib/000020_000000.png", "000000/mask_visib/000020_000001.png"]


def test_a_preview_exports_nothing(tmp_path):
    (tmp_path / "stage.usda").write_text(stage_text("conventional", ["npz"]))
    found = project(tmp_path / "stage.usda", tmp_path / "out", (DATA.parents[1],), preview=True)
    assert not any(name.startswith("export") for name in (*found.graph, *found.files))


GROUP = "plenoptic_pipeline.formats"
PAGE = ROOT / "docs/export_format.md"


def install(folder: Path, code: str, project: dict) -> None:
    """What pip leaves of a package in a folder of the path."""
    place = folder / f"{project['name']}-{project['version']}.dist-info"
    place.mkdir(parents=True)
    (folder / "corner_table.py").write_text(code)
    (place / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    entries = "\n".join(f"{name} = {module}" for name, module in project["entry-points"][GROUP].items())
    (place / "entry_points.txt").write_text(f"[{GROUP}]\n{entries}\n")


@pytest.fixture
def laboratory(tmp_path, monkeypatch):
    """Install the package of the page, or one with other code: its folder."""

    def installed(code: str = "") -> Path:
        python, project = (re.findall(f"```{word}\n(.*?)```", PAGE.read_text(), re.S) for word in ("python", "text"))
        folder = tmp_path / "site"
        install(folder, code or python[0], tomllib.loads(project[0])["project"])
        monkeypatch.syspath_prepend(folder)
        for known in (sys.modules, task_code._first_seen):  # of another test
            monkeypatch.delitem(known, "corner_table", raising=False)
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
    (tmp_path / "stage.usda").write_text(stage_text("conventional", ["corner-table"]))
    (error,) = load(tmp_path / "stage.usda", [DATA.parents[1]]).errors
    assert (error.code, error.line) == ("unknown-export", 15) and "opencv" in error.hint
    folder = laboratory()
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    assert build(tmp_path / "stage.usda", tmp_path / "out", jobs=1, allow_roots=ROOTS).exit_code == 0
    assert (tmp_path / "out/exports/corner-table/Rig.Camera.csv").is_file()
    before = code_of_writer("corner-table")
    code = (folder / "corner_table.py").read_text()
    (folder / "corner_table.py").write_text(f"# a comment\n{code}")
    assert code_of_writer("corner-table") == before
    (folder / "corner_table.py").write_text(code.replace('"board_x"', '"board_x_m"'))
    assert code_of_writer("corner-table") != before
    again = build(tmp_path / "stage.usda", tmp_path / "out", jobs=1, allow_roots=ROOTS)
    (failure,) = again.failures  # this process has the old code
    assert "is not the one that this build was planned with" in str(failure.error)


def test_an_export_that_fails_is_named_and_loses_only_itself(laboratory, tmp_path, common_store, monkeypatch):
    """Everything else is delivered, and the next build makes what is missing; nothing is exported twice."""
    code = re.findall("```python\n(.*?)```", PAGE.read_text(), re.S)[0]
    broken = code.replace(
        "    for camera in", "    if 'NO_INK' in os.environ:\n        raise ValueError('no ink')\n    for camera in"
    )
    laboratory(f"import os\n{broken}")
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    monkeypatch.setenv("NO_INK", "1")
    out, text = tmp_path / "out", stage_text("conventional", ["npz", "corner-table"], **NOISY)

    def built(text: str, **options) -> Result:
        (tmp_path / "stage.usda").write_text(text)
        return build(tmp_path / "stage.usda", out, jobs=1, allow_roots=ROOTS, **options)

    first = built(text)
    (failure,) = first.failures
    assert failure.name == "export/corner-table" and "no ink" in failure.error and first.exit_code == Exit.FAILED
    assert "exports/npz/export.json" in finished_folder(out).files and not (out / "exports/corner-table").exists()
    monkeypatch.delenv("NO_INK")
    second = built(text)
    assert [task.name for task in second.tasks if task.state == "executed"] == ["export/corner-table"]
    assert set(second.delivery.written) == {
        f"exports/corner-table/{name}" for name in ("Rig.Camera.csv", "export.json")
    }
    third = built(text)
    assert third.executed == 0 and third.delivery.written == ()
    (out / "exports/npz/export.json").unlink()
    fourth = built(text.replace(', "corner-table"', ""), targets=["exports/npz"])
    assert (
        fourth.executed == 0
        and fourth.requested is None
        and sorted(path.name for path in (out / "exports").iterdir()) == ["npz"]
    )


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
    project = {"name": "another", "version": "2", "entry-points": {GROUP: {"corner-table": "corner_table"}}}
    install(tmp_path / "other", "", project)
    monkeypatch.syspath_prepend(tmp_path / "other")
    with pytest.raises(ExportError, match="the packages another and laboratory each have"):
        format_of("corner-table")
