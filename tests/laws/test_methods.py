"""Claim: whatever the camera, target and pose, the four methods give the same rows within what each of them states.

`direct` is judged by random rays, and then judges the others.
"""

from pathlib import Path

import numpy as np
import pytest
from laws import rigs
from laws.random_scenes import random_camera, random_pose, random_target
from scipy import stats
from tolerances import ONCE_IN_A_MILLION

from pipeline.camera.integrals import Bundles, integrals
from pipeline.camera.parts.camera import Sampling
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer, parallel_planes
from pipeline.camera.tracing.moments import COVARIANCE, WEIGHT
from pipeline.targets.patterns.checkerboard import Checkerboard
from pipeline.targets.surfaces import Warped
from pipeline.targets.target import Target
from pipeline.tasks.artefacts.truth_table import PosedPoints
from pipeline.tasks.positions import position_image
from pipeline.tasks.truth import by_two_planes, correspondences
from pipeline.truth.grid import per_plane
from pipeline.truth.grid.per_plane import correspond_points
from pipeline.truth.grid.position_image import correction, crossing_share, on_target
from pipeline.truth.grid.ray_grid import RayGrid
from pipeline.truth.judging.certificate import WITHIN, WORST, Rows, certify
from pipeline.truth.planes import tangent_planes
from pipeline.truth.rows import Correspondences
from pipeline.truth.settings import TruthSettings

K = 2
SAMPLES = {True: 64, False: 2048}
"""Rays per position, with and without microlenses: behind those sampling must stand above what interpolation leaves."""
FULL_LIGHT = 0.98
"""Hit fraction above which no edge cuts the bundle: there J is smooth, and sampling is the only error that matters."""
EXACT = TruthSettings(method="direct", accuracy_px=1e-4)


class Scene:
    """One random scene, and the rows of any method in it."""

    def __init__(self, number: int, folder: Path) -> None:
        rng = np.random.default_rng(number)
        camera, target, self.seed = random_camera(rng), random_target(rng), number
        self.samples = SAMPLES[camera.microlenses is not None]
        tracer = Tracer(camera, number)
        self.rig = Rig.of(tracer)
        self.points, self.pose = target.points(), random_pose(rng, self.rig)
        self.grid = rigs.ray_grid(folder / "rays", camera, K, self.samples, number)
        self.direct = self.rows(EXACT)

    def rows(self, settings: TruthSettings) -> Correspondences:
        """Rows by any method; NaN everywhere in J of planes that face away."""
        grid = None if settings.method == "direct" else self.grid
        image_of = by_two_planes(settings.method)
        if settings.method == "image":
            images = [self._traced(frame) for frame in self.points.frames]

            def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
                return images[number][rays.fine]

        found = correspondences(self.rig, grid, settings, PosedPoints("Board", self.points, self.pose), image_of)
        assert found is not None
        return found

    def second_order(self) -> Correspondences:
        """Rows of `moments` as the search leaves them, before `direct` mends the doubtful ones."""
        settings = TruthSettings(method="moments")
        found = correspond_points(self.points, self.grid, self.pose, settings, by_two_planes("moments"))
        assert found is not None
        return found

    def _traced(self, target_from_plane: np.ndarray) -> np.ndarray:
        sampling = Sampling(supersampling=K, samples=self.samples, seed=self.seed)
        pose = self.pose @ target_from_plane
        return position_image(self.rig, pose, sampling).astype(np.float64)

    def apart(self, rows: Correspondences) -> tuple[np.ndarray, np.ndarray]:
        """Differences from `direct` (n, 2) [px] of the rows that it knows, and which those are."""
        width = len(self.rig.axial)
        here, there = (r.solutions.point * width + r.solutions.cell for r in (rows, self.direct))
        order = np.argsort(there)
        place = order[np.minimum(np.searchsorted(there[order], here), len(there) - 1)]
        known = there[place] == here
        x, exact = (r.solutions.xy_px for r in (rows, self.direct))
        return x[known] - exact[place[known]], known


def judged(scene: Scene, rows: Correspondences, bias_px: float, claim_px: float) -> dict:
    """The certificate's verdict on a few rows, moved by a bias."""
    some = np.random.default_rng(0).permutation(len(rows.solutions.point))[:16]
    found = rows.solutions.only(some)
    planes = tangent_planes(scene.pose, scene.points.position_mm, scene.points.plane_axes)[found.point]
    x = np.stack([found.x_px + bias_px, found.y_px], axis=1)
    return certify(scene.rig, Rows(planes, found.cell, x, rows.method[some] == "direct"), len(some), claim_px)


def most_by_chance(rows: int) -> float:
    """rms of actual over stated error of so many rows that chance exceeds once in a million scenes.

    Squared, it is distributed as F: two components per row, each with a variance from four replicas.
    """
    return float(np.sqrt(stats.f.isf(ONCE_IN_A_MILLION, 2 * rows, 6 * rows)))


def second_order_px(scene: Scene, rows: Correspondences) -> np.ndarray:
    """What two planes leave out, to second order, from moments by quadrature at each row, (n, 2) [px]."""
    x = rows.solutions.xy_px
    near_far = scene.grid.near_mm, scene.grid.far_mm
    planes = np.repeat(parallel_planes(*near_far)[None], len(x), axis=0)
    flat = integrals(scene.rig.tracer, Bundles(x, scene.rig.microlens(rows.solutions.cell), planes), 2).moments
    shift = np.empty((len(x), 2))
    for row, (moments, point) in enumerate(zip(flat, rows.solutions.point, strict=True)):
        pose = scene.pose @ scene.points.frames[scene.points.plane[point]]
        share, _, way = crossing_share(moments[None, :2], moments[None, 2:4], *near_far, pose)
        shift[row] = correction(moments[None, COVARIANCE:WEIGHT], share, way, pose)[0]
    return np.linalg.solve(rows.solutions.jacobian, shift[..., None])[..., 0]


QUICK = (7,)
NUMBERS = [pytest.param(n, marks=() if n in QUICK else pytest.mark.heavy) for n in range(20)]


@pytest.fixture(params=NUMBERS)
def scene(request: pytest.FixtureRequest, tmp_path: Path) -> Scene:
    return Scene(request.param, tmp_path)


def test_all_methods_agree_within_what_they_state(scene: Scene) -> None:
    direct = scene.direct
    assert len(direct.solutions.point) >= 4

    honest = judged(scene, direct, 0.0, 5e-4)
    assert honest["passed"] is True, honest
    biased = judged(scene, direct, 0.02, 5e-4)
    assert biased["passed"] is False and abs(biased["mean_px"] - 0.02) < 1e-3

    moments = scene.rows(TruthSettings(method="moments"))
    apart, known = scene.apart(moments)
    length = np.hypot(*apart.T)
    claim_px = TruthSettings(method="moments").claim_px
    assert claim_px is not None
    assert np.mean(length <= claim_px) >= WITHIN and length.max() <= WORST * claim_px
    assert abs(len(moments.solutions.point) - len(direct.solutions.point)) <= 2 and np.sum(~known) <= 1

    by_method = {"two-plane": scene.rows(TruthSettings(method="two-plane")), "moments": scene.second_order()}
    if len(scene.points.frames) <= 3:
        by_method["image"] = scene.rows(TruthSettings(method="image"))
    for method, rows in by_method.items():
        apart, known = scene.apart(rows)
        lit = rows.hit_fraction[known] > FULL_LIGHT
        if np.sum(lit) < 4:
            continue
        stated = np.sqrt(np.mean(rows.sigma_px[known][lit] ** 2))
        bias = second_order_px(scene, rows)[known][lit] if method == "two-plane" else 0.0
        ratio = np.sqrt(np.mean((apart[lit] - bias) ** 2)) / stated
        assert ratio < most_by_chance(int(np.sum(lit))), method


def test_rows_of_a_bent_target_are_those_of_the_whole_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of its points has a plane of its own, and J on that is made only around where the point is seen."""
    grid = rigs.ray_grid(tmp_path / "rays", rigs.conventional(), 1, 64)
    points, pose = Target(Checkerboard(columns=8, rows=5, square_mm=1.4), BENT).points(), rigs.facing(437.0, 8.0)
    made = []

    def image_of(number: int, pose: np.ndarray, rays: RayGrid) -> np.ndarray:
        made.append(rays.size_px)
        return on_target(rays.near, rays.far, rays.near_mm, rays.far_mm, pose)

    found = correspond_points(points, grid, pose, TruthSettings(method="two-plane"), image_of)
    assert len(made) == len(points.position_mm) and np.mean([w * h for w, h in made]) < 0.5 * 96 * 72
    monkeypatch.setattr(per_plane, "_window", lambda grid, _: tuple(slice(0, size) for size in grid.size_px[::-1]))
    whole = correspond_points(points, grid, pose, TruthSettings(method="two-plane"), image_of)
    assert set(made[len(points.position_mm) :]) == {(96, 72)}
    assert found is not None and whole is not None
    assert found.solutions.point.tolist() == whole.solutions.point.tolist() == list(range(40))
    np.testing.assert_array_equal(found.solutions.x_px, whole.solutions.x_px)
    np.testing.assert_array_equal(found.solutions.y_px, whole.solutions.y_px)


BENT = Warped(deflection_mm=(0.3, -0.2))
