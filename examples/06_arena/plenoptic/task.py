"""A task for programs of plenoptic cameras: a build's exports, its images as programs read them, and clicks on boards.

TASK/exports/<format>/…, TASK/noise_<n>/<format>/…, TASK/white.png, TASK/white_<F-number>.png, TASK/<frame>.png: 8 bits,
linear, three equal channels, the brightest pixel of each white image at 250, images on the scale of white.png.
TASK/task.json has `f_number`, `white` (F-number of each further white image), `frames`, `columns`, `rows`,
`pitch_px`, `camera`, and what the caller adds, `formats` of the exports among it.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scenes import exposed

import pipeline
from pipeline.exports.export import Request, export
from pipeline.exports.noise import Noise
from pipeline.files.exr import read_exr

_WHITE_DN = 250.0
"""Digital number of the brightest pixel of white images [DN]."""


def write_task(
    build: Path, task: Path, electrons: float | None, noises: list[Noise], more: dict[str, Any]
) -> dict[str, Any]:
    """Write the task of a build with one plenoptic camera and one board; returns what task.json has.

    `electrons` of the brightest white pixel, if images have the noise of a sensor; `noises` of exported positions.
    """
    task.mkdir(parents=True, exist_ok=True)
    output = pipeline.open_output(build)
    for place, noise in [("exports", Noise()), *((f"noise_{number}", noise) for number, noise in enumerate(noises))]:
        for name in more["formats"]:
            if not (task / place / name).exists():
                export(output, [name], task / place, Request(noise=noise))
    camera = output.camera.name
    about = json.loads((build / f"cameras/{camera}/camera.json").read_text(encoding="utf-8"))
    white = _linear(build / f"cameras/{camera}/white.exr", "white")
    peak = white.max()
    _write(task / "white.png", white / peak, electrons)
    others = sorted((build / f"cameras/{camera}/white").glob("f*.exr"))
    for path in others:
        other = _linear(path, "white")
        _write(task / f"white_{path.stem[1:]}.png", other / other.max(), electrons)
    frames = sorted(path.name for path in (build / "frames").iterdir())
    for frame in frames:
        _write(task / f"{frame}.png", _linear(build / f"frames/{frame}/{camera}/image.exr", "image") / peak, electrons)
    (scene,) = json.loads((task / f"exports/libpleno/{camera}/scene.js").read_text(encoding="utf-8"))["checkerboards"]
    facts = {
        "camera": camera,
        "pitch_px": about["mla"]["micro_image_pitch_px"],
        "f_number": round(about["lens"]["f_number"], 3),
        "white": {path.stem[1:]: float(path.stem[1:]) for path in others},
        "frames": frames,
        "columns": scene["x_grid"],
        "rows": scene["y_grid"],
    } | more
    (task / "task.json").write_text(json.dumps(facts, indent=1), encoding="utf-8")
    return facts


def _linear(path: Path, part: str) -> np.ndarray:
    channels = read_exr(path)[part].channels
    return np.asarray(next(iter(channels.values())), np.float64)


def _write(path: Path, values: np.ndarray, electrons: float | None) -> None:
    noiseless = np.clip(np.rint(values * _WHITE_DN), 0, 255).astype(np.uint8)
    grey = noiseless if electrons is None else exposed(values, electrons, path.stem, 0)
    Image.fromarray(np.repeat(grey[:, :, None], 3, axis=2)).save(path)
