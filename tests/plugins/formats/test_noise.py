"""Noise is what was asked for, depends on the seed and the observation alone, and every file says that it is there."""

import json
from dataclasses import replace

import numpy as np
import pytest
from plugins.formats.maps import SlantedScene, gathered
from scipy import stats

from pipeline.exports.export import Request, export
from pipeline.exports.material import ExportView, Material, Observations
from pipeline.exports.noise import Noise, noise_of, with_noise
from pipeline.formats import ExportError
from pipeline.results.output import open_output

COUNT = 40_000


def many(ids: np.ndarray, camera: str = "A") -> Material:
    n = len(ids)
    found = Observations(rows=np.arange(n), ids=ids, positions=np.zeros((n, 2)), microlenses=None, rho_px=np.zeros(n))
    view = ExportView(
        camera=camera, target="T", frame=1, image="", built=None, camera_from_target=None, camera_from_world=None,
        observations=found,
    )  # fmt: skip
    return Material(stage="", remarks=(), cameras=(), targets=(), views=(view,), frames=(1,), scene=SlantedScene)


def drawn(noise: Noise, ids: np.ndarray | None = None, camera: str = "A") -> Observations:
    return with_noise(many(np.arange(COUNT) if ids is None else ids, camera), noise).views[0].observations


def test_gaussian_noise_is_gaussian_and_independent_on_both_axes():
    places = drawn(Noise(noise_px=0.5)).positions
    assert len(places) == COUNT
    for axis in places.T:
        assert stats.kstest(axis, "norm", args=(0, 0.5)).pvalue > 1e-3
    assert abs(np.corrcoef(places.T)[0, 1]) < 4 / np.sqrt(COUNT)
    assert abs(np.corrcoef(places[1:, 0], places[:-1, 0])[0, 1]) < 4 / np.sqrt(COUNT)


def test_shares_are_kept_and_outliers_fill_their_square():
    noise = Noise(noise_px=0.0, outliers=0.2, outlier_px=7.0, missed=0.3)
    found = drawn(noise)
    sigma = np.sqrt(0.3 * 0.7 * COUNT)
    assert abs(len(found.ids) - 0.7 * COUNT) < 4 * sigma
    moved = found.positions[(found.positions != 0).any(axis=1)]
    assert abs(len(moved) - 0.2 * len(found.ids)) < 4 * np.sqrt(0.16 * len(found.ids))
    assert stats.kstest(moved.ravel(), "uniform", args=(-7, 14)).pvalue > 1e-3


def test_an_observation_has_the_same_noise_whatever_else_there_is():
    noise = Noise(noise_px=0.1, outliers=0.1, missed=0.1)
    full = drawn(noise)
    order = np.random.default_rng(1).permutation(COUNT)[: COUNT // 3]
    some = drawn(noise, order)
    by_id = dict(zip(full.ids.tolist(), full.positions.tolist(), strict=True))
    assert some.ids.tolist() == [number for number in order.tolist() if number in by_id]
    assert some.positions.tolist() == [by_id[number] for number in some.ids.tolist()]


@pytest.mark.parametrize("other", [Noise(noise_px=0.1, seed=2), "B"])
def test_seeds_and_cameras_have_noise_of_their_own(other):
    first = drawn(Noise(noise_px=0.1)).positions
    second = drawn(other).positions if isinstance(other, Noise) else drawn(Noise(noise_px=0.1), camera=other).positions
    assert abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]) < 4 / np.sqrt(COUNT)


def test_microlenses_of_a_point_have_noise_of_their_own():
    material = many(np.zeros(COUNT, np.int64))
    view = material.views[0]
    lenses = np.stack([np.arange(COUNT) - COUNT // 2, np.arange(COUNT) % 7 - 3], axis=1)
    view = replace(view, observations=replace(view.observations, microlenses=lenses))
    places = with_noise(replace(material, views=(view,)), Noise(noise_px=1.0)).views[0].observations.positions
    assert stats.kstest(places[:, 1], "norm").pvalue > 1e-3


def test_no_noise_changes_nothing(output):
    material = gathered(output)
    assert with_noise(material, Noise()) is material


def test_every_file_with_comments_says_so_and_so_does_the_side_car(output, tmp_path):
    noise = noise_of("0.25, outliers=0.1, missed=0.05, seed=9")
    texts = {
        "opencv": ["Left.yml", "stereo-Left-Right.yml"],
        "mrcal": ["corners.vnl", "Left.cameramodel"],
        "kalibr": ["target.yaml", "camchain.yaml", "corners.csv"],
        "colmap": ["cameras.txt", "images.txt", "points3D.txt"],
    }
    for folder in export(output, list(texts), tmp_path, Request(noise=noise)):
        for name in texts[folder.name]:
            assert "NOISE WAS ADDED: Gaussian 0.25 px, 0.1 outliers" in (folder / name).read_text()
        said = json.loads((folder / "export.json").read_text())
        assert said["noise"] == {"noise_px": 0.25, "outliers": 0.1, "outlier_px": 10.0, "missed": 0.05, "seed": 9}
    (folder,) = export(output, ["npz"], tmp_path, Request(noise=noise))
    assert any("NOISE" in line for line in np.load(folder / "Left.correspondences.npz")["remarks"])
    exact = open_output(output.path).cameras["Left"].correspondences.x_px
    assert len(np.load(folder / "Left.correspondences.npz")["x_px"]) <= len(exact)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("outlers=0.1", 'did you mean "outliers"?'),
        ("0.1,missed=1.5", "missed is a share"),
        ("0.1,seed=x", "seed is int, not 'x'"),
        ("-1", "widths of noise are finite lengths"),
        ("inf", "widths of noise are finite lengths"),
        ("0.1,outlier_px=inf", "widths of noise are finite lengths"),
        ("", "noise_px is float, not ''"),
    ],
)
def test_wrong_noise_is_refused(text, said):
    with pytest.raises(ExportError) as error:
        noise_of(text)
    assert said in str(error.value)
