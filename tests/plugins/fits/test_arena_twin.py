"""The arena's twin: which rows it takes, and where its fits begin."""

import sys
from pathlib import Path

import numpy as np
import pytest
from tolerances import SIGMAS

EXAMPLE = Path(__file__).resolve().parents[3] / "examples/06_arena"
sys.path[:0] = [str(EXAMPLE), str(EXAMPLE / "plenoptic")]
import cameras  # noqa: E402
import twin  # noqa: E402
from calibrating import true_numbers  # noqa: E402
from contestants.calibrate_twin import values_of  # noqa: E402
from truth import truth_of  # noqa: E402

import pipeline  # noqa: E402
from pipeline.files.tables import write_table  # noqa: E402
from pipeline.plugins.fits.association import associated  # noqa: E402
from pipeline.plugins.fits.free_numbers import FreeStage  # noqa: E402
from pipeline.plugins.fits.linear_rows import Assumptions, Linearisation  # noqa: E402
from pipeline.plugins.fits.observations import Stated, read_observations  # noqa: E402
from pipeline.plugins.fits.predicted_rows import Predictor, Slopes, Views  # noqa: E402


@pytest.mark.heavy
def test_rows_of_the_twin_are_chosen_without_a_look_at_their_noise(tmp_path, monkeypatch):
    """At the true camera noise makes chi squared larger than a fit does by the trace of its hat matrix, as far as the
    numbers go: the fit's deviations are those of the noise. Rows of an unfocused camera that are chosen by where noise
    has put them promise more than they hold.
    """
    monkeypatch.setattr(twin, "MOST", 10**6)
    rig = cameras.small(cameras.small(next(rig for rig in cameras.RIGS if rig.name == "lytro")))
    path = tmp_path / "dataset.usda"
    cameras.write_stage(rig, path)
    truth = truth_of(rig, path, pipeline.build(path, tmp_path / "built", jobs=1, pictures=False).out)
    sigma_px, random, stage = 0.1, np.random.default_rng(8), FreeStage(path, ["Made"])
    write_table(tmp_path / "seen.csv", ["pixel_origin: 0", "position: exact"], twin.table_of(truth, truth.boards))
    seen = associated(read_observations(tmp_path / "seen.csv", Stated(sigma_px=sigma_px)), stage.nominal)
    views, true = Views.of(seen), np.zeros(len(stage.numbers))
    steps = [number.step for number in stage.numbers]
    poses = views.poses(stage.nominal)
    slopes = Predictor(seen, views).slopes(stage.nominal, stage.neighbours(true), steps, poses, seen.x_px)
    inner = twin.taken_rows(truth)
    nearest_px = np.hypot(*(truth.boards.image_px - truth.centre_px[truth.boards.microlens])[inner].T).max()

    def linearised(rows, noise_px):
        part = Slopes(by_number=slopes.by_number[rows], by_pose=slopes.by_pose[rows], arm_mm=slopes.arm_mm[rows])
        assumptions = Assumptions(
            sigma_px=seen.sigma_px[rows],
            view=views.of_rows[rows],
            prior_deviation=np.array([number.deviation for number in stage.numbers]),
            reach=np.full(len(true), np.inf),
            has_free_poses=True,
            loss_scale=None,
        )
        return Linearisation(part, -noise_px[rows], true, assumptions)

    gains, chosen_gains = [], []
    for noise_px in random.normal(0, sigma_px, (60, len(seen), 2)):
        off_px = np.hypot(*(truth.boards.image_px + noise_px - truth.centre_px[truth.boards.microlens]).T)
        gains.append(linearised(inner, noise_px).decrement)
        chosen_gains.append(linearised(np.flatnonzero(off_px < nearest_px), noise_px).decrement)
    rows_basis = linearised(inner, noise_px).numbers().range_basis[: 2 * len(inner)]
    told = (rows_basis**2).sum()
    print(f"{len(inner)} rows: {np.mean(gains):.1f}, chosen by noise {np.mean(chosen_gains):.1f}, expected {told:.1f}")

    # Decrements follow chi squared with so many degrees of freedom, whose variance is twice their number.
    error = np.sqrt(2 * told / len(gains))
    assert np.mean(gains) == pytest.approx(told, abs=SIGMAS * error)
    assert np.mean(chosen_gains) > told + SIGMAS * error

    # These drawings have the array off so far that rims of micro-images cut the light of rows that the images have.
    noisy = truth.noisy(sigma_px, 12)[11].only(inner[::4])
    fit = twin.fitted_to(truth, path, noisy, tmp_path / "12.usda")
    off = (values_of(fit) - [*true_numbers(path).values()]) / fit.solution.deviation
    assert fit.solution.converged and len(fit.missing) == 0 and np.abs(off).max() < SIGMAS
