"""NCore's file of a camera behind windows: its law brings points to their rows within the residual that is stated."""

import importlib
import json
from types import SimpleNamespace

import numpy as np
import pytest
from builds import made
from laws.test_windows import WATER, stage, window

from pipeline.app.build import build
from pipeline.files.tables import read_table
from pipeline.scene.load import open_dataset

_ASKED = 'uniform token[] plen:exports = ["ncore"]\n'
_ROWS = "frames/0001/Rig.Camera/correspondences.csv"
_MODEL, _SIDE = "exports/ncore/Rig.Camera.json", "exports/ncore/export.json"
_CYLINDER = "double plen:radius", "uniform bool plen:cylindrical = 1\ndouble plen:radius"
PANES = {
    "flat": window(-200.0, turn="(25, -20, 10)"),
    "windshield": window(-150.0, radii_mm=(300.0, 290.0), turn="(20, 10, 30)").replace(*_CYLINDER),
}
SINGLE_PX = 1e-3
"""Single precision of an image a thousand pixels wide, and of some twenty terms [px]."""


@pytest.fixture
def behind(tmp_path, common_store):
    """What a build says of a pinhole behind a pane: its file, what is stated of it, and its rows."""

    def asked(pane: str, **options):
        file = stage(tmp_path, pane, PANES[pane], dataset=_ASKED, **options)
        out = made(file, tmp_path / pane, common_store, targets=[_ROWS, _MODEL, _SIDE]).out
        table, model = read_table(out / _ROWS), json.loads((out / _MODEL).read_text())
        stated = json.loads((out / _SIDE).read_text())["central_models"]["Rig.Camera"]
        points = np.stack([table.numbers(f"camera_{axis}_mm") for axis in "xyz"], axis=1) - stated["centre_mm"]
        xy_px = np.stack([table.numbers("x_px"), table.numbers("y_px")], axis=1)
        return SimpleNamespace(file=file, model=model, stated=stated, points_mm=points, xy_px=xy_px)

    return asked


def bent(ways: np.ndarray, horizontal: list[float], vertical: list[float]) -> np.ndarray:
    """A ray by the documentation: P(phi, N) P(theta, 0) + P(phi, N - 1) P(theta, 1) + ..., of phi and of theta."""
    phi, theta = np.arcsin(ways[:, :2] / np.linalg.norm(ways, axis=1, keepdims=True)).T
    angles = []
    for left in (list(horizontal), list(vertical)):
        order, total = round((np.sqrt(8 * len(left) + 1) - 3) / 2), 0.0
        for power in range(order + 1):
            row, left = left[: order + 1 - power], left[order + 1 - power :]
            total = total + np.polynomial.polynomial.polyval(phi, row) * theta**power
        angles.append(total)
    x, y = np.sin(angles)
    return np.stack([x, y, np.sqrt(1 - x * x - y * y)], axis=1)


def off_px(seen: SimpleNamespace, ways: np.ndarray) -> np.ndarray:
    """Ways of rays behind the windows, by the pinhole of the file, from the rows; the first pixel is at (0.5, 0.5)."""
    own = seen.model["camera_model_parameters"]
    return np.hypot(*(ways[:, :2] / ways[:, 2:] * own["focal_length"] + own["principal_point"] - 0.5 - seen.xy_px).T)


def test_points_behind_a_windshield_lie_in_their_rows_by_the_law_of_ncore(behind):
    seen = behind("windshield")
    own, camera = seen.model["camera_model_parameters"], open_dataset(seen.file).cameras[0].camera
    assert own["focal_length"] == pytest.approx([camera.sensor_distance_mm / camera.sensor.pitch_mm] * 2, rel=1e-9)
    assert own["principal_point"] == pytest.approx(np.array(camera.sensor.size_px) / 2, abs=1e-9)
    external, most_px = own["external_distortion_parameters"], seen.stated["max_px"]
    behind_pane = bent(seen.points_mm, external["horizontal_poly"], external["vertical_poly"])
    assert off_px(seen, behind_pane).max() < most_px < 0.1 < 5 < off_px(seen, seen.points_mm).max()
    there = bent(behind_pane, external["horizontal_poly_inverse"], external["vertical_poly_inverse"])
    back = bent(there, external["horizontal_poly"], external["vertical_poly"])
    assert off_px(seen, back).max() < most_px + seen.stated["windshield"]["inverse_max_px"]
    assert f"{most_px:.3g} px at most; far away by" in seen.model["about"][-1]


@pytest.mark.heavy
@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("pane", PANES)
def test_ncore_projects_points_behind_panes_to_their_rows_and_back(behind, pane, fixed):
    data = pytest.importorskip("ncore.data", reason="nvidia-ncore is not installed")
    sensors, seen = importlib.import_module("ncore.sensors"), behind(pane, fixed=fixed)
    parameters = data.OpenCVPinholeCameraModelParameters.from_dict(seen.model["camera_model_parameters"])
    assert parameters.external_distortion_parameters.type() == "bivariate-windshield"
    theirs = sensors.camera_model_from_parameters(parameters, device="cpu")
    found = theirs.camera_rays_to_image_points(seen.points_mm.astype(np.float32))
    assert found.valid_flag.all()
    most_px = seen.stated["max_px"] + SINGLE_PX
    assert np.hypot(*(found.image_points.numpy() - 0.5 - seen.xy_px).T).max() < most_px < 0.1
    rays = theirs.image_points_to_camera_rays((seen.xy_px + 0.5).astype(np.float32)).numpy()
    most_px += seen.stated["windshield"]["inverse_max_px"]
    ways = seen.points_mm / np.linalg.norm(seen.points_mm, axis=1, keepdims=True)
    focal_px = seen.stated["focal_px"][0]
    assert np.linalg.norm(np.cross(rays, ways), axis=1).max() * focal_px < 1.1 * most_px
    if pane == "flat":  # a ray from far away leaves it in its own direction
        slopes = (seen.xy_px + 0.5 - parameters.principal_point) / focal_px
        far = np.column_stack([slopes, np.ones(len(slopes))]).astype(np.float32)
        off = theirs.camera_rays_to_image_points(far).image_points.numpy() - 0.5 - seen.xy_px
        assert 0.1 < np.hypot(*off.T).max() < seen.stated["windshield"]["infinity_max_px"]


def test_windows_that_shift_rays_too_much_are_refused(tmp_path, common_store, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    port = window(-150.0, turn="(40, 10, 0)")
    file = stage(tmp_path, "port", port, dataset=_ASKED + WATER)
    result = build(file, tmp_path / "out", jobs=1, targets=[_MODEL])
    assert "NCore's windshield misses rays through the windows before Rig.Camera by" in str(result.failures[0].error)
