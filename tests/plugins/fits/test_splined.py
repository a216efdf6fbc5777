"""mrcal's splined models, against mrcal, against SciPy's splines, and in a build."""

import numpy as np
import pytest
from debian_mrcal import by_mrcal
from scipy.interpolate import BSpline

from pipeline.fits.field import FitError
from pipeline.plugins.fits.information import derivatives
from pipeline.plugins.fits.splined import EXAMPLE, Splined

CORE = np.array([800.0, 810.0, 320.0, 240.0])
NAMES = [f"LENSMODEL_SPLINED_STEREOGRAPHIC_order={order}_Nx=10_Ny=8_fov_x_deg=60" for order in (2, 3)]


def control_points(model: Splined) -> np.ndarray:
    return np.random.default_rng(1).uniform(-0.02, 0.02, len(model.parameters))


def spread(count: int = 40, half_mm: float = 300.0) -> np.ndarray:
    """Points all over the field, and beyond the grid."""
    return np.random.default_rng(2).uniform(-1, 1, (count, 3)) * (half_mm, half_mm, 0) + (0, 0, 400.0)


@pytest.mark.heavy
@pytest.mark.parametrize("name", NAMES)
def test_mrcal_projects_alike_with_the_same_derivatives(name):
    model, points = Splined.named(name, CORE), spread()
    p = control_points(model)
    program = """
q = mrcal.project(np.array(given["points"]), given["name"], np.array(given["own"]), get_gradients=True)
print(json.dumps([part.tolist() for part in q]))
"""
    given = {"points": points.tolist(), "name": name, "own": [*CORE, *p]}
    x_px, by_point, by_own = map(np.array, by_mrcal(program, given))
    none = np.zeros((len(points), 0))
    ours_by_own, ours_by_point = derivatives(model.project, p, points, none)

    assert model.name == name
    np.testing.assert_allclose(model.project(p, points, none), x_px, rtol=0, atol=1e-9)
    np.testing.assert_allclose(ours_by_point, by_point, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours_by_own, by_own[..., 4:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_image_plane_is_bent_by_splines_of_scipy(name):
    """Knots of mrcal are control points: -+ 0.689012 and 0.153113 apart along x, at ten for 60 degrees, if cubic."""
    model, points = Splined.named(name, CORE), spread(half_mm=160.0)
    p, order = control_points(model), model.order
    u = 2 * points[:, :2] / (np.linalg.norm(points, axis=1) + points[:, 2])[:, None]
    step = 4 * np.tan(np.radians(15)) / (10 - order)
    of_axes = []
    for axis, count in enumerate((10, 8)):
        knots = step * (np.arange(count + order + 1) - (order + 1) / 2 - (count - 1) / 2)
        of_axes.append(BSpline(knots, np.eye(count), order, extrapolate=False)(u[:, axis]))
    bent = np.einsum("nj,ni,jix->nx", of_axes[1], of_axes[0], p.reshape(8, 10, 2))

    assert order == 2 or step == pytest.approx(0.15311382, abs=1e-8)
    assert np.isfinite(bent).all()
    np.testing.assert_allclose(model.project(p, points, points), (u + bent) * CORE[:2] + CORE[2:], rtol=0, atol=1e-10)


def test_control_points_that_image_positions_tell_are_found_and_others_are_left_at_nothing():
    model, points = Splined.named(NAMES[1], CORE), spread(600, 160.0) * (1, 0.3, 1)
    wanted = control_points(model)
    p = model.nearest(points, model.project(wanted, points, points))
    of_rows = p.reshape(8, 10, 2)

    np.testing.assert_allclose(model.project(p, points, points), model.project(wanted, points, points), atol=1e-3)
    np.testing.assert_allclose(of_rows[[0, 7]], 0.0, atol=1e-12)


@pytest.mark.parametrize("count", ["Nx=3", "Ny=3"])
def test_grids_too_small_for_a_segment_are_refused(count):
    assert Splined.named(EXAMPLE, CORE) is not None and Splined.named("brown", CORE) is None
    with pytest.raises(FitError, match="has no spline"):
        Splined.named(EXAMPLE.replace({"Nx": "Nx=12", "Ny": "Ny=9"}[count[:2]], count), CORE)
