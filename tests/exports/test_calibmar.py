"""CalibMar's file of a camera behind a port: rays refracted by its numbers alone meet the points of rows."""

import json
import re

import numpy as np
import pytest
from builds import made
from laws.test_windows import PORT_MM, WATER, stage, window

from pipeline.app.build import build
from pipeline.files.tables import read_table

_ASKED = f'uniform token[] plen:exports = ["calibmar"]\n{WATER}'
_ROWS, _YAML, _CAMERA = (
    "frames/0001/Rig.Camera/correspondences.csv",
    "exports/calibmar/Rig.Camera.yaml",
    "cameras/Rig.Camera/camera.json",
)
_APPARENT = "double plen:camera:near = 420\ndouble plen:camera:far = 450\n"
"""Planes about where the board seems to be in air."""
PORTS = {
    "FLATPORT": window(-PORT_MM, turn="(9, -7, 0)"),
    "DOMEPORT": window(-65.0, radii_mm=(60.0, 50.0)).replace("(0, 0, -65.0)", "(2, 3, -65)"),
}


def numbers(text: str, key: str) -> list[float]:
    return json.loads(re.search(rf"^{key}: (\[.*\])$", text, re.MULTILINE)[1])


def refracted(way: np.ndarray, normal: np.ndarray, ratio: float) -> np.ndarray:
    """Snell's law in vectors; the normal points along the ray."""
    cosine = np.sum(way * normal, axis=-1, keepdims=True)
    return ratio * way + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal


def rays(text: str, xy_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places on the outer face and directions in water, (n, 3) [m], of positions whose first pixel is about 0.5."""
    (fx, fy, cx, cy, k1, k2, p1, p2, *more), port = numbers(text, "parameters"), numbers(text, "non_svp_parameters")
    assert not any((p1, p2, *more[1:]))
    seen = (xy_px - [cx, cy]) / [fx, fy]
    bent, k3 = seen.copy(), more[0] if more else 0.0
    for _ in range(50):
        square = np.sum(bent**2, axis=1, keepdims=True)
        bent = seen / (1 + square * (k1 + square * (k2 + square * k3)))
    way = np.column_stack([bent, np.ones(len(bent))])
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    place, first, lengths, (na, ng, nw) = np.zeros_like(way), np.array(port[:3]), np.cumsum(port[3:5]), port[5:]
    for length, ratio in zip(lengths, (na / ng, ng / nw), strict=True):
        if "FLATPORT" in text:
            normal = np.broadcast_to(first, way.shape)
            place = place + way * ((length - place @ first) / (way @ first))[:, None]
        else:
            along = np.sum((first - place) * way, axis=1)
            off = np.sum((first - place) ** 2, axis=1) - along**2
            place = place + way * (along + np.sqrt(length**2 - off))[:, None]
            normal = (place - first) / length
        way = refracted(way, normal, ratio)
    return place, way


def off_px(text: str, table, centre_mm) -> float:
    """The largest angle between a ray of the file and the point of its row, seen from the outer face, in pixels."""
    at = {name: table.numbers(name) for name in ("x_px", "y_px", "camera_x_mm", "camera_y_mm", "camera_z_mm")}
    place, way = rays(text, np.column_stack([at["x_px"], at["y_px"]]) + 0.5)
    to_point = np.column_stack([at[f"camera_{axis}_mm"] for axis in "xyz"]) - centre_mm - 1e3 * place
    sine = np.linalg.norm(np.cross(to_point, way), axis=1) / np.linalg.norm(to_point, axis=1)
    return float(sine.max() * numbers(text, "parameters")[0])


@pytest.mark.parametrize("port", PORTS)
def test_rays_of_a_pinhole_behind_a_port_meet_the_points_of_rows(tmp_path, common_store, port):
    file = stage(tmp_path, port, PORTS[port], dataset=_ASKED)
    out = made(file, file.with_suffix(""), common_store, targets=[_ROWS, _YAML]).out
    text = (out / _YAML).read_text()
    assert re.search(r"^non_svp_model: (\w+)$", text, re.MULTILINE)[1] == port
    assert off_px(text, read_table(out / _ROWS), np.zeros(3)) < 1e-8


def test_rays_of_a_lens_miss_points_by_the_residual_of_its_pinhole_in_air(tmp_path, common_store):
    """What a camera without a port has in camera.json: the centre and the residual; a port adds nothing to it."""
    port, plain = (
        stage(tmp_path, name, pane, camera=_APPARENT, dataset=asked)
        for name, pane, asked in (("port", window(-PORT_MM, turn="(1, -1, 0)"), _ASKED), ("plain", "", ""))
    )
    for file in (port, plain):  # through a wide stop the mean ray behind a turned port is not that of its middle
        narrow = 'over "Lens"\n{\nover "Stop"\n{\ndouble plen:semiDiameter = 0.3\n}\n}\nover "Camera"'
        file.write_text(file.read_text().replace('over "Camera"', narrow))
    out = made(port, tmp_path / "out", common_store, targets=[_ROWS, _YAML]).out
    alone = made(plain, tmp_path / "alone", common_store, targets=[_CAMERA]).out
    pinhole = json.loads((alone / _CAMERA).read_text())["pinhole"]
    most_px, text = pinhole["with_distortion"]["residual_px"]["max"], (out / _YAML).read_text()
    assert f"# overall_rms: {pinhole['with_distortion']['residual_px']['rms']!r}" in text
    assert off_px(text, read_table(out / _ROWS), pinhole["centre_mm"]) < most_px


def test_what_is_no_port_is_refused(tmp_path, common_store, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    bent = window(-60.0, radii_mm=(60.0, 50.0)).replace(
        "double plen:radius", "bool plen:cylindrical = 1\ndouble plen:radius"
    )
    for name, pane in (("bent", bent), ("shells", window(-60.0, radii_mm=(60.0, 49.0)))):
        file = stage(tmp_path, name, pane, dataset=_ASKED)
        result = build(file, tmp_path / f"out_{name}", jobs=1, targets=[_YAML])
        assert "CalibMar knows" in str(result.failures[0].error)
