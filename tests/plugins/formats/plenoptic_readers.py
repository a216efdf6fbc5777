"""Readers of formats for plenoptic cameras; in `test_programs` programs read libpleno, raytrix, lftoolbox and bok."""

import json
from pathlib import Path

import numpy as np
from plugins.formats.pretended import COLUMNS
from plugins.formats.pretended_plenoptic import (
    ARRAY_TO_SENSOR_MM,
    AXIS_PX,
    FIELDS_MM,
    FOCAL_MM,
    LENS_TO_ARRAY_MM,
    RADIUS_PX,
    SIZE_PX,
    PlenopticScene,
)
from scipy.io import loadmat

FITTED_PX = 1e-6
"""What the least squares of a lattice leave of centres that are regular [px]."""
NAME = "Rig.Camera"


def nearest(scene: PlenopticScene, place: np.ndarray) -> int:
    off = np.linalg.norm(scene.array.centre_px - place, axis=1)
    assert off.min() < FITTED_PX, f"no micro-image at {place}, the next one is {off.min()} px away"
    return int(off.argmin())


def virtual_depths(focal_mm: float) -> list[float]:
    """Main-lens images of the ends of the depth of field, behind the array, over the distance of the sensor."""
    behind = [1 / (1 / FOCAL_MM - 1 / end) - LENS_TO_ARRAY_MM for end in FIELDS_MM[focal_mm]]
    return sorted(one / ARRAY_TO_SENSOR_MM for one in behind)


def check_bok(folder: Path, scene: PlenopticScene) -> None:
    """MATLAB counts from 1: pixels, rows of tables, types."""
    place = folder / NAME
    data = loadmat(place / "microlens_center_list.mat")
    centres, connection = data["center_list"] - 1, data["center_connection"].astype(int)
    assert centres.shape[0] == 2 and connection.shape == (7, centres.shape[1])
    assert data["image_size"].ravel().tolist() == list(SIZE_PX)
    rows = [nearest(scene, centre) for centre in centres.T]
    assert connection.min() == 1 and (connection[0] == np.arange(1, len(rows) + 1)).all()
    pitch = np.median(np.linalg.norm(centres.T[connection[1] - 1] - centres.T, axis=1))
    for step, degrees in zip(connection[1:], (0, 60, 120, 180, 240, 300), strict=True):
        away = centres.T[step - 1] - centres.T
        inner = step != connection[0]
        np.testing.assert_allclose(np.linalg.norm(away[inner], axis=1), pitch, atol=1e-6)
        off = np.rad2deg(np.arctan2(away[inner, 1], away[inner, 0])) - degrees
        assert (np.abs((off + 180) % 360 - 180) < 5).all() and inner.sum() > len(rows) / 2  # the array is turned by 1.1
    kinds = loadmat(place / "lens_types.mat")
    for kind in range(3):
        found = {scene.array.types[nearest(scene, place - 1)] for place in kinds[f"type{kind + 1}_struct"].T}
        assert found == {kind}
    for frame in scene.poses:
        x, y, centre_x, centre_y, column, row = loadmat(place / f"correspondencesAll_{frame:04d}.mat")[
            "correspondences"
        ]
        expected = scene.rows(frame)
        assert len(x) == len(expected)
        np.testing.assert_allclose(np.stack([x, y], 1) - 1, [one[4:6] for one in expected], atol=1e-9)
        assert (row * COLUMNS + column).tolist() == [one[0] for one in expected]
        for one, centre in zip(expected, np.stack([centre_x, centre_y], 1) - 1, strict=True):
            assert scene.array.kl[nearest(scene, centre)].tolist() == list(one[1:3])
    assert float((place / "pattern_size.txt").read_text()) == 2.0
    np.testing.assert_allclose(np.array((place / "image_center.txt").read_text().split(), float) - 1, AXIS_PX)


def check_plenopticam(folder: Path, scene: PlenopticScene) -> None:
    """mic_list rows are y, x, row, column, from 0."""
    data = json.loads((folder / f"{NAME}.json").read_text())
    assert data["pat_type"] == {"hexagonal": "hex", "square": "rec"}[scene.layout]
    listed = np.array(data["mic_list"])
    for y, x, _, _ in listed:
        nearest(scene, np.array([x, y]))
    inside = ((scene.array.centre_px >= 0) & (scene.array.centre_px <= np.array(SIZE_PX) - 1)).all(axis=1)
    assert len(listed) >= inside.sum() and listed[:, 2:].min() == 0
    by_cell = {(int(row), int(column)): np.array([x, y]) for y, x, row, column in listed}
    pitch_y, pitch_x = data["ptc_mean"]
    for (row, column), place in by_cell.items():
        if (row, column + 1) in by_cell:
            np.testing.assert_allclose(by_cell[row, column + 1][0] - place[0], pitch_x, rtol=1e-3)
        if (row + 2, column) in by_cell:
            np.testing.assert_allclose(by_cell[row + 2, column][1] - place[1], 2 * pitch_y, rtol=0.05)


def require_all_centres(places: np.ndarray, scene: PlenopticScene) -> None:
    """Fail unless those of places (n, 2) that lie in the image are the centres of all micro-images there."""
    inside, seen = (((one > 0) & (one < np.array(SIZE_PX) - 1)).all(axis=1) for one in (places, scene.array.centre_px))
    assert inside.sum() == seen.sum() > 60
    for place in places[inside]:
        nearest(scene, place)


def check_lightfield(folder: Path, scene: PlenopticScene) -> None:
    """Light that grows evenly has in each view the value at the view's place; lines of a hexagon are straightened."""
    for frame in scene.poses:
        data = np.load(folder / f"{NAME}/{frame:04d}.lightfield.npz")
        views, steps, centres = data["views"], data["offsets_px"], data["centres"]
        assert steps.tolist() == list(range(-int(RADIUS_PX), int(RADIUS_PX) + 1)) and "white" not in data
        rows, columns = centres.shape[:2]
        assert views.shape == (len(steps), len(steps), rows, columns)
        there = np.isfinite(centres).all(axis=2)
        assert there.sum() > 50 and all(nearest(scene, place) >= 0 for place in centres[there])
        away = np.diff(centres, axis=1)
        assert (away[..., 0][np.isfinite(away[..., 0])] > 0).all()  # columns to the right
        middle = len(steps) // 2
        light = slope(centres, frame)
        for v, u in ((middle, middle), (0, middle), (middle, len(steps) - 1)):
            wanted = light + steps[u] / 1000 + steps[v] / 100
            if scene.layout == "hexagonal":
                wanted[0::2, 1:] = (wanted[0::2, 1:] + wanted[0::2, :-1]) / 2
            elif scene.layout == "hexagonal-columns":
                wanted[1:, 0::2] = (wanted[1:, 0::2] + wanted[:-1, 0::2]) / 2
            seen = np.isfinite(views[v, u]) & np.isfinite(wanted)
            assert seen.sum() > 50
            np.testing.assert_allclose(views[v, u][seen], wanted[seen], rtol=0, atol=1e-5)


def slope(places: np.ndarray, frame: int) -> np.ndarray:
    return places[..., 0] / 1000 + places[..., 1] / 100 + frame
