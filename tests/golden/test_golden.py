"""Change detectors on tiny stages, not proofs: what was built the last time somebody looked and agreed.

Stages are compared as text, correspondences in pixels, images by a z-test against mean and variance over many seeds.
`pytest --update-golden` is the only writer; it prints old, new and their difference.
"""

import difflib
from pathlib import Path

import numpy as np
import pytest

import pipeline
from pipeline.camera.rig import Rig
from pipeline.camera.tracer import Tracer
from pipeline.files.exr import Part, read_exr, write_exr
from pipeline.files.tables import read_table, write_table
from pipeline.graph.poses import vision_from_target
from pipeline.render.imaging import irradiance_and_crosstalk, pictures
from pipeline.render.light import TargetLight
from pipeline.scene.load import load

HERE = Path(__file__).parent
DATA = HERE.parent / "data"
TINY = ("tiny_conventional", "tiny_plenoptic")

TRUTH_PX = 1e-5
"""Positions are stored in double but come from float32 images: one unit in the last place moves them by 3e-6 px."""
SEEDS = range(100, 116)
SAMPLES = 64
"""Rays per pixel of the tiny images."""
LARGEST_Z = 6.0
"""Of some thousand pixels; Student's t with 15 degrees of freedom exceeds it once in 4e4."""


@pytest.fixture
def golden(request, capsys):
    """Whether golden files are written, and a printer that pytest does not swallow."""

    def show(text: str) -> None:
        with capsys.disabled():
            print(f"\n{text}")

    return request.config.getoption("--update-golden"), show


@pytest.fixture(scope="module", params=TINY)
def built(request, tmp_path_factory, common_store):
    """Name and output folder of a tiny dataset."""
    out = tmp_path_factory.mktemp("golden")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PIPELINE_CACHE", str(common_store))
        result = pipeline.build(DATA / request.param / "dataset.usda", out / "out", jobs=1)
    assert result.exit_code == 0
    return request.param, out / "out"


def test_the_flattened_stage(built, golden):
    name, out = built
    file, new = HERE / f"{name}.usda", (out / "dataset.usda").read_text(encoding="utf-8")
    update, show = golden
    old = file.read_text(encoding="utf-8") if file.exists() else ""
    if update:
        show("\n".join(difflib.unified_diff(old.splitlines(), new.splitlines(), str(file), "new", lineterm="", n=1)))
        file.write_text(new, encoding="utf-8")
        return
    assert new == old


@pytest.mark.parametrize("frame", [1, 2])
def test_the_correspondences(built, golden, frame):
    name, out = built
    file = HERE / f"{name}.{frame:04d}.csv"
    table = read_table(out / f"frames/{frame:04d}/Rig.Camera/correspondences.csv")
    names = ("point_id", "microlens_k", "microlens_l", "x_px", "y_px", "visibility")
    new = {column: table.numbers(column) for column in names}
    update, show = golden
    old = read_table(file) if file.exists() else None
    if update:
        known = {} if old is None else {key: old.numbers(key) for key in new if key in old.columns}
        rows = {key: len(column) for key, column in known.items()}.get("x_px", 0)
        moved = np.nan
        if rows == len(new["x_px"]):
            moved = max(np.abs(known[axis] - new[axis]).max() for axis in ("x_px", "y_px"))
        show(f"{file.name}: {rows} rows -> {len(new['x_px'])} rows, largest move {moved} px")
        write_table(file, ["positions of a tiny dataset, px"], new)
        return
    assert old is not None, "no golden file: run pytest --update-golden"
    for column in ("point_id", "microlens_k", "microlens_l"):
        assert np.array_equal(old.numbers(column), new[column], equal_nan=True)
    assert np.array_equal(old.numbers("visibility"), new["visibility"])
    for axis in ("x_px", "y_px"):
        assert np.abs(old.numbers(axis) - new[axis]).max() < TRUTH_PX


def test_the_image(built, golden):
    name, out = built
    file = HERE / f"{name}.exr"
    new = read_exr(out / "frames/0002/Rig.Camera/image.exr")["image"].channels["Y"].astype(float)
    update, show = golden
    if update:
        images = np.stack([_image(name, seed) for seed in SEEDS])
        mean, variance = images.mean(axis=0), images.var(axis=0, ddof=1)
        if file.exists():
            old = read_exr(file)["image"].channels["mean"]
            show(f"{file.name}: mean {old.mean()} -> {mean.mean()}, largest change {np.abs(old - mean).max()}")
        write_exr(file, [Part(name="image", channels={"mean": mean, "variance": variance})])
        return
    known = read_exr(file)["image"].channels
    variance = known["variance"] * (1 + 1 / len(SEEDS))
    # The variance over 16 seeds misses a ray that passes an edge once in a hundred: allow a quarter of its share.
    spread = np.hypot(np.sqrt(variance), 0.25 / SAMPLES)
    z = (new - known["mean"]) / spread
    assert np.abs(z).max() < LARGEST_Z
    assert np.abs(np.sum(new - known["mean"])) < LARGEST_Z * np.sqrt(np.sum(variance))


def _image(name: str, seed: int) -> np.ndarray:
    """The image of frame 2 with another seed."""
    dataset = load(DATA / name / "dataset.usda").dataset
    camera, frame = dataset.cameras[0], dataset.frames[1]
    tracer = Tracer(camera.camera, seed)
    targets = [(entry.target, vision_from_target(frame, camera.name, entry.name)) for entry in dataset.targets]
    light = TargetLight(targets, dataset.background)
    rig = Rig.of(tracer)
    white, foreign = irradiance_and_crosstalk(rig, camera.image_samples, None)
    return pictures(rig, camera.image_samples, [light], np.array([white - foreign, foreign]))[0]
