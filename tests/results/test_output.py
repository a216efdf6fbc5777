"""`pipeline.open_output` gives back what the files of a build say, by readers that are not ours."""

import json
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from builds import cells

import pipeline
from pipeline.errors import PipelineError, UsageError
from pipeline.frames import apply


def test_rows_are_those_of_the_tables_in_every_column(plenoptic_build):
    out = pipeline.open_output(plenoptic_build)
    stated = [
        row
        for frame in out.frames
        for row in cells(plenoptic_build / f"frames/{frame:04d}/Rig.Camera/correspondences.csv")
    ]
    rows = out.correspondences
    assert len(rows) == len(stated) > 100 and list(rows.dtype.names) == list(stated[0])
    for name in rows.dtype.names:
        kind = type(rows[name][0].item())
        assert rows[name].tolist() == [kind(row[name] or "nan") for row in stated] or name.startswith(("blur", "rho"))
    assert rows.dtype["microlens_k"] == rows.dtype["point_id"] == np.int64
    assert np.isnan(rows.rho_px).sum() == sum(not row["rho_px"] for row in stated)


def test_pandas_reads_the_same_from_the_files(conventional_build):
    out = pipeline.open_output(conventional_build)
    files = sorted(conventional_build.glob("frames/*/*/correspondences.csv"))
    stated = pd.concat([pd.read_csv(file, comment="#") for file in files])
    empty = ["microlens_k", "microlens_l", "microlens_type"]
    assert stated[empty].isna().all().all()
    stated = stated.drop(columns=empty).reset_index(drop=True)
    pd.testing.assert_frame_equal(out.pandas(), stated, check_dtype=False, check_exact=True)
    pd.testing.assert_frame_equal(out.pandas(), out.camera.pandas())


def test_a_conventional_camera_has_no_columns_of_microlenses(conventional_build, plenoptic_build):
    plain, behind = (pipeline.open_output(out).camera for out in (conventional_build, plenoptic_build))
    assert not plain.is_plenoptic and plain.micro_images is None
    assert "microlens_k" not in plain.correspondences.dtype.names
    stated = cells(plenoptic_build / "cameras/Rig.Camera/micro_images.csv")
    assert behind.is_plenoptic and behind.micro_images.centre_x_px.tolist() == [float(r["centre_x_px"]) for r in stated]
    assert behind.micro_image_outlines.shape[0] <= len(stated)


def test_poses_take_points_of_the_target_to_the_places_of_the_table(conventional_build):
    """Two files of a build, written by two tasks, say the same."""
    out = pipeline.open_output(conventional_build)
    for view in out.camera.views:
        rows = view.correspondences
        points = out.targets["Board"].points_mm[rows.point_id]
        seen = apply(view.poses.camera_from_target["Board"], points)
        np.testing.assert_allclose(seen, np.stack([rows.camera_x_mm, rows.camera_y_mm, rows.camera_z_mm], 1), atol=1e-9)
        shift = out.camera.pinhole.centre_mm
        through = apply(view.poses.pinhole_from_target["Board"], points)
        np.testing.assert_allclose(through, seen - shift, atol=1e-9)


def test_the_pinhole_projects_points_to_their_positions(conventional_build):
    out = pipeline.open_output(conventional_build)
    model = out.camera.pinhole_with_distortion
    assert model.max_px < out.camera.pinhole.max_px
    (view, *_) = out.camera.views
    rows = view.correspondences
    seen = apply(view.poses.pinhole_from_target["Board"], out.targets["Board"].points_mm[rows.point_id])
    pixels = (out.camera.pinhole.matrix @ (seen / seen[:, 2:]).T)[:2].T
    np.testing.assert_allclose(pixels, np.stack([rows.x_px, rows.y_px], 1), atol=0.2)


def test_files_that_no_manifest_lists_are_not_seen(conventional_build):
    out = pipeline.open_output(conventional_build)
    view = out.view(out.frames[0])
    assert view.image_path.is_file() and view.preview_path.is_file()
    assert out.camera.white_path.is_file() and out.camera.rays_path.is_file() and out.baselines is None
    foreign = view.image_path.with_name("positions.exr")
    foreign.touch()
    assert pipeline.open_output(conventional_build).view(out.frames[0]).positions_path is None
    foreign.unlink()


def told(path) -> str:
    with pytest.raises(UsageError) as error:
        pipeline.open_output(path)
    return str(error.value)


def test_whatever_is_no_finished_build_is_named(conventional_build, tmp_path):
    assert "is a stage, and no output folder" in told("tests/data/tiny_conventional/dataset.usda")
    assert "is no folder" in told(tmp_path / "nowhere")
    assert f"did you mean {conventional_build}?" in told(conventional_build.parent)
    assert "it has no manifest.json" in told(tmp_path)
    (tmp_path / "frames").mkdir()
    assert "interrupted" in told(tmp_path)
    (tmp_path / "manifest.json").write_text("{")
    assert "damaged" in told(tmp_path)
    manifest = json.loads((conventional_build / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, "format": 7}))
    assert "format 7" in told(tmp_path)
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert "missing, though manifest.json lists it" in told(tmp_path)
    pictures = {name: entry for name, entry in manifest["files"].items() if name.endswith(".png")}
    (tmp_path / "manifest.json").write_text(json.dumps({**manifest, "files": pictures}))
    assert "holds a preview, without truth" in told(tmp_path)
    with pytest.raises(KeyError, match=r"0 is none of Rig\.Camera"):
        pipeline.open_output(conventional_build).cameras[0]


def test_frames_and_cameras_that_are_not_there_are_named(conventional_build):
    out = pipeline.open_output(conventional_build)
    with pytest.raises(PipelineError, match="no frame 99"):
        out.view(99)
    with pytest.raises(PipelineError, match=r"did you mean \"Rig.Camera\"\?"):
        out.view(1, "Rig.Camara")


def test_tables_of_both_kinds_of_cameras_are_not_mixed(conventional_build, plenoptic_build):
    from pipeline.results.rows import joined

    tables = [pipeline.open_output(out).correspondences for out in (conventional_build, plenoptic_build)]
    with pytest.raises(UsageError, match="different columns"):
        joined(tables)


def test_opening_needs_no_optics_and_no_usd(conventional_build):
    code = (
        f"import sys, pipeline; pipeline.open_output({str(conventional_build)!r}).correspondences; print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pxr", "numba", "scipy", "cv2", "pandas", "OpenEXR", "pipeline.camera"} & set(loaded)
