"""libpleno's files, read and judged from its published layout and model alone: nothing of this comes from our code.

Sections of observations: pleno/geometry/observation.cpp. Nodes of a mesh: GridMesh_::node. Types: lens_type. The model:
thin lens, Brown terms left out, a straight line through each microlens, u = W - 1 - x / scale.
"""

import gzip
import json
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from plugins.formats.pretended import COLUMNS, ROWS
from plugins.formats.pretended_plenoptic import (
    ARRAY_TO_SENSOR_MM,
    F_NUMBER,
    FOCAL_MM,
    HIT_PX,
    LENS_TO_ARRAY_MM,
    PIXEL_MM,
    SIZE_PX,
    PlenopticScene,
)

SIN_60 = np.sin(np.deg2rad(60.0))
PRINTED = 1e-9
"""Rounding of doubles [px, mm]."""
FITTED_PX = 1e-6
"""What the least squares of a mesh leave of centres that are regular [px]."""


@dataclass(frozen=True)
class Files:
    centres: list[tuple]
    features: list[tuple]
    camera: dict
    params: dict
    scene: dict
    poses: dict


def sections(path: Path) -> list[list[tuple]]:
    """Centres, corners and features: each a count of 64 bits, then packed records, all little-endian."""
    data, place, found = gzip.decompress(path.read_bytes()), 0, []
    for form in ("<iidd", "<iiddii", "<iidddii"):
        (count,) = struct.unpack_from("<Q", data, place)
        place += 8
        found.append([struct.unpack_from(form, data, place + i * struct.calcsize(form)) for i in range(count)])
        place += count * struct.calcsize(form)
    assert place == len(data)
    return found


def read(folder: Path) -> Files:
    centres, corners, features = sections(folder / "observations.bin.gz")
    assert corners == []
    again, corners, none = sections(folder / "corners.bin.gz")
    assert again == centres and none == []
    assert corners == [(k, l, u, v, cluster, frame) for k, l, u, v, _, cluster, frame in features]
    texts = (json.loads((folder / f"{name}.js").read_text()) for name in ("camera", "params", "scene", "poses"))
    return Files(centres, features, *texts)


def matrix(columns: list[list[float]]) -> np.ndarray:
    return np.array(columns, float).T


def node(mesh: dict, k: int, l: int) -> np.ndarray:
    """GridMesh_::nodeInWorld of 48db282, (2,) [px]."""
    geometry, (pitch,) = mesh["geometry"], mesh["pitch"]
    across = 0.5 if geometry == 1 and l % 2 == 0 else 0.0
    down = -0.5 if geometry == 2 and k % 2 == 1 else 0.0
    x = pitch[0] * (k + across) * (SIN_60 if geometry == 2 else 1.0)
    y = pitch[1] * (l + down) * (SIN_60 if geometry == 1 else 1.0)
    (translation,) = mesh["pose"]["translation"]
    return matrix(mesh["pose"]["rotation"]) @ [x, y] + translation


def kind(mesh: dict, count: int, k: int, l: int) -> int:
    """MicroImagesArray::type."""
    if count == 1:
        return 0
    first, second = (k, l) if mesh["geometry"] == 1 else (l, k)
    return ((second % (count - 1)) + first) % count


def distances(files: Files) -> tuple[float, float]:
    """D and d, as libpleno finds them: dist_focus gives H, H = D + 2 d or D - 2 d; lambda = D / (D + d)."""
    far, focal = files.camera["dist_focus"], files.camera["main_lens"]["f"]
    image = far / 2 * (1 - np.sqrt(1 - 4 * focal / far))
    ratio = files.params["lambda"]
    per_array = (1 - ratio) / ratio  # d / D
    array = image / (1 + {0: 0, 1: -2, 2: 2}[files.camera["mode"]] * per_array)
    return array, array * per_array


def check_libpleno(folder: Path, scene: PlenopticScene) -> None:
    """The files alone reproject with no error: nodes of the board through the main lens and the microlenses."""
    files = read(folder / "Rig.Camera")
    mesh, sensor, count = files.camera["mia"]["mesh"], files.camera["sensor"], files.camera["I"]
    assert (sensor["width"], sensor["height"]) == SIZE_PX and count == len(scene.focal_mm)
    for k, l, u, v in files.centres:
        assert 0 <= k < mesh["width"] and 0 <= l < mesh["height"]
        np.testing.assert_allclose(node(mesh, k, l), [u, v], rtol=0, atol=FITTED_PX)
    assert min(k for k, *_ in files.centres) == min(l for _, l, *_ in files.centres) == 0
    inside = ((scene.array.centre_px >= 0) & (scene.array.centre_px <= np.array(SIZE_PX) - 1)).all(axis=1)
    exact = {tuple(place) for place in scene.array.centre_px[inside].tolist()}
    assert exact <= {(u, v) for _, _, u, v in files.centres}
    (board,) = files.scene["checkerboards"]
    assert (board["x_grid"], board["y_grid"]) == (COLUMNS, ROWS)
    poses = {pose["frame"] for pose in files.poses["poses"]}
    expected = [row for frame in sorted(scene.poses) for row in scene.rows(frame)]
    assert len(files.features) == len(expected) and sorted(poses) == sorted(scene.poses)
    np.testing.assert_allclose(reprojection_errors(files), 0, rtol=0, atol=1e-5)
    assert np.abs([row[2:4] - HIT_PX for row in map(np.array, files.features)]).sum(axis=1).min() < PRINTED
    for name, number in (
        ("dc", mesh["pitch"][0][0] * sensor["scale"]),
        ("dC", files.params["dc"] * files.params["lambda"]),
    ):
        np.testing.assert_allclose(files.params[name], number, rtol=1e-9)
    array, sensor_mm = distances(files)
    np.testing.assert_allclose([array, sensor_mm], [LENS_TO_ARRAY_MM, ARRAY_TO_SENSOR_MM], rtol=1e-9)
    np.testing.assert_allclose(files.params["m"], -sensor_mm * FOCAL_MM / (2 * array), rtol=1e-9)
    assert files.camera["main_lens"] == {"aperture": F_NUMBER, "f": FOCAL_MM}
    assert (files.params["N"], files.params["I"], files.params["scale"]) == (F_NUMBER, count, PIXEL_MM)
    np.testing.assert_allclose(np.add(files.params["q"], files.params["dc"] / 2), files.params["q_prime"], rtol=1e-12)


def reprojection_errors(files: Files) -> np.ndarray:
    """u, v and rho of the model less those of the features, (n, 3)."""
    (board,) = files.scene["checkerboards"]
    poses = {pose["frame"]: pose["pose"] for pose in files.poses["poses"]}
    off = []
    for k, l, u, v, rho, cluster, frame in files.features:
        row, column = divmod(cluster, board["x_grid"])
        place = np.array([column * board["lph"], row * board["lph"], 0.0])
        seen = matrix(poses[frame]["rotation"]).T @ (place - poses[frame]["translation"][0])
        off.append(np.subtract(reprojected(files, seen, k, l), [u, v, rho]))
    return np.array(off)


def reprojected(files: Files, seen: np.ndarray, k: int, l: int) -> list[float]:
    """u, v and rho of a point of the camera frame through the microlens of micro-image (k, l): libpleno's model."""
    array, sensor_mm = distances(files)
    mesh, scale = files.camera["mia"]["mesh"], files.camera["sensor"]["scale"]
    focal = files.camera["main_lens"]["f"]
    image = -focal / (abs(seen[2]) - focal) * seen
    last = np.array([files.camera["sensor"][side] for side in ("width", "height")]) - 1
    middle = last / 2 - node(mesh, k, l)  # of the micro-image, in sensor coordinates from the axis
    lens = np.append(middle * scale * array / (array + sensor_mm), -array)
    along = (-(array + sensor_mm) - image[2]) / (lens[2] - image[2])
    met = image + along * (lens - image)
    u, v = last / 2 - met[:2] / scale
    own = kind(mesh, files.camera["I"], k, l)
    micro_focal = files.params["dC"] * sensor_mm / (2 * files.params["q_prime"][own])
    before = image[2] + array
    blur = 1 / micro_focal - 1 / before - 1 / sensor_mm
    rho = files.params["dc"] * array / (array + sensor_mm) * sensor_mm / 2 * blur / scale
    return [u, v, rho]
