"""Exports that a stage asks for: tasks of its build, whose files are those of `pipeline export`."""

from dataclasses import replace

import numpy as np
import pytest
from builds import DATA
from shorter import few
from stage_text import head

from pipeline.app.build import build, project
from pipeline.exports.export import Request, export
from pipeline.exports.noise import Noise
from pipeline.formats import format_of
from pipeline.results.output import open_output

ASKED = {
    "conventional": ["opencv", "mrcal", "colmap", "kalibr", "npz", "rays", "stmap", "depth"],
    "plenoptic": ["libpleno", "pip", "bok", "lftoolbox", "plenopticam", "npz", "depth", "lightfield"],
}
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
def made(tmp_path, common_store, monkeypatch):
    """Build a stage of this text: the result and its folder."""
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))

    def run(text, **options):
        (tmp_path / "stage.usda").write_text(text)
        result = build(tmp_path / "stage.usda", tmp_path / "out", jobs=1, allow_roots=(DATA.parents[1],), **options)
        assert result.exit_code == 0, [task.error for task in result.failures]
        return result, tmp_path / "out"

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
    assert format_of("opencv").paths(cameras, [1]) == sorted(
        [f"{name}.{ending}" for name in cameras for ending in ("npz", "yml")]
        + ["stereo-A@red-B@red.npz", "stereo-A@red-B@red.yml", "export.json"]
    )
    paths = format_of("npz").paths({"A": False, "B": True}, [1])
    assert [path for path in paths if "micro" in path] == ["B.micro_images.npz"]
    assert format_of("depth").paths({"A": False}, [1, 20]) == ["A/0001.depth.exr", "A/0020.depth.exr", "export.json"]


def test_a_preview_exports_nothing(tmp_path):
    (tmp_path / "stage.usda").write_text(stage_text("conventional", ["npz"]))
    found = project(tmp_path / "stage.usda", tmp_path / "out", (DATA.parents[1],), preview=True)
    assert not any(name.startswith("export") for name in (*found.graph, *found.files))
