"""Kalibr's AprilGrids: tags count from the lower left, x to the right and y up, unlike its checkerboards."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from plugins.formats.maps import CHECKS as MAPS
from plugins.formats.maps import gathered
from plugins.formats.pretended import SIZE_PX, Scene, write_build, write_manifest

from pipeline.exports.conversion import converted
from pipeline.exports.export import export
from pipeline.exports.gathering import grid_of
from pipeline.formats import Cameras, format_of, loadable
from pipeline.plugins.formats import kalibr
from pipeline.results.output import open_output
from pipeline.targets.patterns.tags import AprilGrid

TAG_MM, SPACING = 20.0, 0.3


def aprilgrid(output):
    pattern = AprilGrid(columns=4, rows=3, tag_mm=TAG_MM, spacing=SPACING)
    places = np.pad(pattern.marks().xy_mm, [(0, 0), (0, 1)])
    material = gathered(output)
    target = replace(
        material.targets[0],
        kind="aprilgrid",
        parameters={"columns": 4, "rows": 3},
        points=places,
        nominal=places,
        grid=grid_of(places),
    )
    none = np.zeros(0, int)
    views = tuple(replace(view, observations=view.observations.only(none)) for view in material.views)
    return converted(replace(material, targets=(target,), views=views), format_of("kalibr"))


def test_the_target_file_of_an_aprilgrid(output, tmp_path):
    kalibr.write(aprilgrid(output), tmp_path)
    said = yaml.safe_load((tmp_path / "target.yaml").read_text())
    assert (said["target_type"], said["tagCols"], said["tagRows"]) == ("aprilgrid", 4, 3)
    assert said["tagSize"] == pytest.approx(TAG_MM / 1000, rel=1e-12)
    assert said["tagSpacing"] == pytest.approx(SPACING, rel=1e-12)


def test_points_of_an_aprilgrid_count_from_the_lower_left(output):
    """GridCalibrationTargetAprilgrid.cpp: x along columns, y along rows, corners of tags by size and gap."""
    points = aprilgrid(output).only_target.points
    edges = np.cumsum([0, 1, SPACING, 1, SPACING, 1, SPACING, 1]) * TAG_MM / 1000
    row, column = np.divmod(np.arange(48), 8)
    np.testing.assert_allclose(points, np.stack([edges[column], edges[row], 0 * row], axis=1), atol=1e-12)


def test_the_pinhole_of_a_wide_lens_comes_as_near_without_k3_as_the_file_says(output, tmp_path):
    """By OpenCV's projection, in a field of 90 degrees: leaving k3 out alone would put corners elsewhere by pixels."""
    material, bent = aprilgrid(output), np.array([-0.3065, 0.1295, 0.0, 0.0, -0.0313])
    camera = material.cameras[0]
    pinhole = replace(camera.pinhole, principal_distance_px=520.0, distortion=bent)
    kalibr.write(replace(material, cameras=(replace(camera, pinhole=pinhole),)), tmp_path)
    text = (tmp_path / "camchain.yaml").read_text()
    said, said_px = yaml.safe_load(text)["cam0"], float(re.search(r", (\S+) px from it at most", text)[1])
    none, way = np.zeros(3), np.array(SIZE_PX) - 1 - pinhole.principal_point_px  # to the farthest corner
    rays = np.append(np.linspace(0, 1.6, 801)[:, None] * way / np.linalg.norm(way), np.ones((801, 1)), axis=1)
    seen = []
    for (fx, fy, *place), coefficients in (
        ([520.0, 520.0, *pinhole.principal_point_px], bent),
        (said["intrinsics"], np.array(said["distortion_coeffs"])),
        ([520.0, 520.0, *pinhole.principal_point_px], bent[:4]),
    ):
        matrix = np.array([[fx, 0, place[0]], [0, fy, place[1]], [0, 0, 1]])
        seen.append(cv2.projectPoints(rays, none, none, matrix, coefficients)[0][:, 0])
    in_image = (seen[0] <= np.array(SIZE_PX) - 1).all(axis=1)
    found_px, left_out_px = (np.linalg.norm(one - seen[0], axis=1)[in_image].max() for one in seen[1:])
    assert found_px == pytest.approx(said_px, rel=0.05)  # of two digits
    assert found_px < left_out_px / 3


def test_a_frame_in_which_nothing_is_seen_is_exported(tmp_path):
    out = write_build(tmp_path / "out", Scene())
    for table in out.rglob("correspondences.csv"):
        head = table.read_text().splitlines()[:2]
        table.write_text("\n".join([*head, ""]))
    write_manifest(out)
    names = [
        name for name, one in loadable().items() if one.cameras is not Cameras.PLENOPTIC and name not in (*MAPS, "bop")
    ]
    folders = export(open_output(out), names, tmp_path / "exports")
    assert len(folders) == len(names)
    corners = (tmp_path / "exports/mrcal/corners.vnl").read_text()
    assert "frames/0001/Left/image.png - - -" in corners
