"""`pipeline export`: folders, side-car, and what it refuses."""

import json
import sys
from functools import partial

import numpy as np
import pytest
from builds import made
from places import ROOT
from plugins.formats.pretended import DISTORTION, Scene, write_build, write_manifest
from rerun.channels import TRIANGLE, stage_at
from typer.testing import CliRunner

from pipeline import cli
from pipeline.exports.export import Request, export
from pipeline.exports.gathering import grid_of
from pipeline.formats import ExportError, format_of, names
from pipeline.results.output import open_output


@pytest.fixture
def command(tmp_path, monkeypatch, in_this_process):
    monkeypatch.chdir(tmp_path)
    return partial(in_this_process, "export")


def test_each_format_gets_a_folder_and_a_side_car(command, out, tmp_path):
    code, said, _ = command("opencv,npz", out)
    folders = [tmp_path / "exports/out" / name for name in ("opencv", "npz")]
    assert code == 0 and said.split() == [f"exports/out/{folder.name}" for folder in folders]
    for folder in folders:
        side = json.loads((folder / "export.json").read_text())
        assert side["files"] == sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.name != "export.json")
        assert side["conventions"]["source"] == format_of(folder.name).source and side["noise"] is None
        assert str(tmp_path) not in (folder / "export.json").read_text()
        for name, camera in open_output(out).cameras.items():  # a pinhole never comes without what it leaves
            stated = camera.record["pinhole"]["with_distortion"]["residual_px"]
            assert side["residuals_of_equivalent_pinholes_px"][name]["with_distortion"] == stated
    assert sorted(path.name for path in folders[0].parent.iterdir()) == ["npz", "opencv"]


def test_one_camera_alone(out, tmp_path):
    (folder,) = export(open_output(out), ["opencv"], tmp_path, Request(only=("Right",)))
    assert sorted(path.name for path in folder.iterdir()) == ["Right.npz", "Right.yml", "export.json"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["opncv"], 'did you mean "opencv"?'),
        (["opencv", "--only", "Lft"], 'did you mean "Left"?'),
        (["opencv", "--noise", "much"], "noise_px is float"),
    ],
)
def test_what_is_misspelt_is_named_and_nothing_is_written(command, out, tmp_path, arguments, said):
    code, _, told = command(arguments[0], out, *arguments[1:])
    assert code == 2 and said in told and list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_is_left_alone(command, out, tmp_path):
    (tmp_path / "exports/out/opencv").mkdir(parents=True)
    code, _, told = command("npz,opencv", out)
    assert code == 2 and "exports/out/opencv exists" in told
    assert [path.name for path in (tmp_path / "exports/out").iterdir()] == ["opencv"]
    assert "is no export" in command("npz,opencv", out, "--replace")[2]


def test_exports_are_replaced_on_demand_and_answer_in_json(command, out, tmp_path):
    folders = [str(tmp_path / "here" / name) for name in ("npz", "opencv")]
    assert json.loads(command("npz", out, "-o", tmp_path / "here", "--json")[1]) == {"folders": folders[:1]}
    (tmp_path / "here/npz/old.txt").touch()
    assert command("npz,opencv", out, "-o", tmp_path / "here")[0] == 2 and not (tmp_path / "here/opencv").exists()
    again = command("npz,opencv", out, "-o", tmp_path / "here", "--replace", "--json")
    assert json.loads(again[1]) == {"folders": folders}
    assert not (tmp_path / "here/npz/old.txt").exists()


def test_a_format_that_fails_leaves_nothing_behind(out, tmp_path):
    with pytest.raises(ExportError, match="no position"):
        export(open_output(out), ["npz"], tmp_path, Request(position="sadle"))
    with pytest.raises(ExportError, match="build it with plen:truth:columns"):
        export(open_output(out), ["npz"], tmp_path, Request(position="saddle"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "library", "extra"),
    [("parquet", "pandas", "frames"), ("parquet", "pyarrow", "frames"), ("hdf5", "h5py", "hdf5")],
)
def test_tables_without_their_libraries_say_what_to_install(command, out, tmp_path, monkeypatch, name, library, extra):
    monkeypatch.setitem(sys.modules, library, None)
    code, _, told = command(name, out)
    assert code == 2 and f"{library} is not installed" in told and f"plenoptic-pipeline[{extra}]" in told
    assert list((tmp_path / "exports/out").iterdir()) == []


def test_other_positions_of_a_point_get_a_folder_of_their_own(command, tmp_path):
    out = write_build(tmp_path / "out", Scene())
    for table in out.rglob("correspondences.csv"):
        comment, head, *rows = table.read_text().splitlines()
        chief = [f"{row},{float(row.split(',')[7]) + 0.25!r},7.5" for row in rows]
        chief[1] = f"{rows[1]},,"
        table.write_text("\n".join([comment, head + ",chief_x_px,chief_y_px", *chief, ""]))
    write_manifest(out)
    code, said, _ = command("npz,npz:chief", out)
    exact, other = (np.load(f"{place}/Left.correspondences.npz") for place in said.split())
    assert code == 0 and said.split()[1] == "exports/out/npz-chief"
    kept = np.isfinite(exact["chief_x_px"])
    assert (~kept).sum() == 3 and other["x_px"].tolist() == (exact["x_px"][kept] + 0.25).tolist()
    assert set(other["y_px"]) == {7.5}
    assert json.loads((tmp_path / "exports/out/npz-chief/export.json").read_text())["position"] == "chief"
    assert command("npz:chef", out)[0] == 2 and command("npz:saddle", out)[0] == 2


def test_cameras_of_the_other_kind_are_refused(command, plenoptic_build):
    code, _, told = command("opencv", plenoptic_build)
    assert code == 2 and "opencv expects one position per point, and Rig.Camera is plenoptic" in told
    assert "formats for it:" in told and "npz" in told


def test_coco_names_the_image_of_each_channel(tmp_path, common_store):
    stage = stage_at(tmp_path, "conventional", dict(list(TRIANGLE.items())[::2]))
    built = made(stage, tmp_path / "out", common_store)
    (folder,) = export(open_output(built.out), ["coco"], tmp_path)
    images = json.loads((folder / "coco.json").read_text(encoding="utf-8"))["images"]
    assert images[0]["file_name"] == "frames/0001/Rig.Camera/red/image.png"
    assert all((built.out / image["file_name"]).exists() for image in images)


def test_cameras_that_move_against_each_other_are_no_rig(tmp_path):
    out = write_build(tmp_path / "out", Scene())
    file = out / "frames/0002/Right/poses.json"
    poses = json.loads(file.read_text())
    poses["pinhole"]["pinhole_from_world"][0][3] += 1e-3
    file.write_text(json.dumps(poses))
    write_manifest(out)
    for name in ("opencv", "mrcal", "kalibr"):
        with pytest.raises(ExportError, match="Right moves against Left"):
            export(open_output(out), [name], tmp_path / "exports")
    assert list((tmp_path / "exports").iterdir()) == []


def test_a_rig_far_from_the_origin_of_the_world_is_rigid_within_rounding(tmp_path):
    """Turned about its vertical by another angle in each frame, 1e8 mm away: products of matrices round to 1e-8 mm."""
    out = write_build(tmp_path / "out", Scene())
    for file in out.rglob("poses.json"):
        poses = json.loads(file.read_text())
        c, s = np.cos(frame := int(file.parent.parent.name)), np.sin(frame)
        moved = np.array([[c, 0, s, 1e8], [0, 1, 0, 0], [-s, 0, c, 3e7], [0, 0, 0, 1]])
        poses["pinhole"]["pinhole_from_world"] = (poses["pinhole"]["pinhole_from_world"] @ moved).tolist()
        file.write_text(json.dumps(poses))
    write_manifest(out)
    (folder,) = export(open_output(out), ["kalibr"], tmp_path / "exports")
    assert folder.exists()


def test_a_rig_of_which_one_sensor_is_tilted_has_as_many_coefficients_of_each_camera(tmp_path):
    built = write_build(tmp_path / "built", Scene())
    record = json.loads((built / "cameras/Upper/camera.json").read_text())
    record["pinhole"]["with_distortion"]["distortion"] += [0.0] * 7 + [0.02, -0.03]
    (built / "cameras/Upper/camera.json").write_text(json.dumps(record))
    write_manifest(built)
    (folder,) = export(open_output(built), ["opencv-multiview"], tmp_path)
    left, _, upper = np.load(folder / "multiview.npz")["distortions"]
    np.testing.assert_array_equal(left, [*DISTORTION, *[0.0] * 9])
    np.testing.assert_array_equal(upper[12:], [0.02, -0.03])


def test_the_list_has_a_line_per_format():
    shown = CliRunner().invoke(cli.app, ["export", "--list"]).output
    assert [line.split()[0] for line in shown.splitlines()] == names()
    for words in (["--list", "--json"], ["--json", "--list"]):
        assert list(json.loads(CliRunner().invoke(cli.app, ["export", *words]).output)) == names()


def test_a_grid_is_found_only_where_ids_count_it_from_the_top():
    row, column = np.divmod(np.arange(12), 4)
    grid = np.stack([column * 2.0, -row * 2.0, 0 * row], axis=1)
    found = grid_of(grid)
    assert (found.columns, found.rows, found.column_step, found.row_step, found.step_mm) == (4, 3, 2.0, 2.0, 2.0)
    assert grid_of(grid * [1, 2, 1]).step_mm is None
    assert grid_of(grid * [1, -1, 1]) is None and grid_of(grid[::-1]) is None and grid_of(grid[:11]) is None


def test_the_page_holds_the_table(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    import export_table

    assert export_table.table() in (ROOT / "docs/exports.md").read_text(encoding="utf-8")
