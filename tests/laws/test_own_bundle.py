"""Claim: every row has the hit fraction and blur of its own bundle, by whatever method it was found."""

from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.solving import rig_of
from shorter import few

from pipeline.camera.tracing.moments import COVARIANCE
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.target import Target
from pipeline.tasks.artefacts.truth_table import PosedPoints
from pipeline.tasks.truth import by_two_planes, correspondences
from pipeline.truth.planes import tangent_planes
from pipeline.truth.settings import TruthSettings

RAYS = 1 << 16
SHARE, TRACE = 0.002, 0.01
"""What 65,536 random rays err by, with room: of a hit fraction, and of a trace [relative]."""


@pytest.mark.parametrize("method", few(["moments"], "two-plane"))
def test_rows_of_position_images_have_the_light_and_blur_of_their_own_bundle(method: str, tmp_path: Path) -> None:
    """Behind microlenses, where both change within a pixel, against random rays from the row's position."""
    camera, board, pose = rigs.plenoptic(2.0), Checkerboard(columns=3, rows=2, square_mm=1.0), rigs.facing(420.0, 20.0)
    rig, grid = rig_of(camera), rigs.ray_grid(tmp_path, camera, 1, 256)
    settings = TruthSettings(method=method, filter="none", accuracy_px=0.2 if method == "moments" else None)
    points = Target(board).points()
    rows = correspondences(rig, grid, settings, PosedPoints("Board", points, pose), by_two_planes(method))
    assert rows is not None
    traced = rows.only(rows.method != "direct")
    found = traced.solutions
    assert len(found.point) > 20 and traced.hit_fraction.min() < 0.6
    x, planes = found.xy_px, tangent_planes(pose, points.position_mm)[found.point]
    both, lens = np.stack([planes, planes], axis=1), rig.microlens(found.cell)
    moments = rig.tracer.moments(rig.tracer.positions_mm(*x.T), lens, both, RAYS, np.rint(x).astype(np.int64))
    assert np.abs(traced.hit_fraction - rig.hit_fraction(moments)).max() < SHARE
    on_plane = found.jacobian @ traced.blur_px2 @ found.jacobian.transpose(0, 2, 1)
    trace, expected = np.trace(on_plane, axis1=1, axis2=2), moments[:, COVARIANCE] + moments[:, COVARIANCE + 4]
    assert np.abs(trace / expected - 1).max() < TRACE
