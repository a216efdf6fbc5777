"""Raw images of a build: one task a frame, made of the linear image alone, and nothing else of a build moves."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rawpy
from laws import rigs
from laws.rigs import facing
from naive import polar
from stage_text import edited, exposed, stage_in, tiny_text

import pipeline
from pipeline.app.verify import wrong_files
from pipeline.camera.tracer import Tracer
from pipeline.engine.output import manifest
from pipeline.files import tiff
from pipeline.files.exr import read_exr
from pipeline.files.jsonfile import write_json
from pipeline.files.npy import write_npy
from pipeline.files.tiff import read_tiff
from pipeline.products.cameras import FOCUSED, light_file
from pipeline.products.raw.make import expose
from pipeline.products.raw.params import Expose
from pipeline.records.plain import to_plain
from pipeline.render.radiometry import FieldTransmission
from pipeline.render.sensor.read_out import Shot, digital_numbers, fixed_pattern
from pipeline.render.sensor.response import Irradiation, SensorResponse
from pipeline.scene.load import load

RAW = ("raw.tiff", "raw.dng", "raw.png")
EXPOSED = """token plen:image:exposure = "level"
double plen:image:exposureTime = 0.02
double plen:image:whiteLevel = 0.9"""
RESPONDS = """int plen:response:bitDepth = 12
double plen:response:blackLevel = 100
double[] plen:response:crosstalk = [0, 0.02, 0, 0.02, 0.92, 0.02, 0, 0.02, 0]
double plen:response:darkNoise = 5
double plen:response:fullWell = 9000
double plen:response:gain = 0.4
double plen:response:prnu = 0.01
double[] plen:response:quantumEfficiency = [0.6]"""
RESPONSE = SensorResponse(
    quantum_efficiency=(0.6,),
    full_well_e=9000.0,
    gain_dn_per_e=0.4,
    bit_depth=12,
    black_level_dn=100.0,
    dark_noise_e=5.0,
    prnu=0.01,
    crosstalk=(0.0, 0.02, 0.0, 0.02, 0.92, 0.02, 0.0, 0.02, 0.0),
)
"""The same sensor as RESPONDS, and the same exposure."""
IRRADIATION = Irradiation(exposure_time_s=0.02, white_level=0.9)


@pytest.fixture
def stage(tmp_path, common_store, monkeypatch):
    """The tiny dataset; `PIPELINE_CACHE` is the store of this test run."""
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    return stage_in(tmp_path, tiny_text("conventional"))


def built(stage: Path, out: Path) -> tuple[dict[str, bytes], Counter]:
    result = pipeline.build(stage, out, jobs=1)
    assert result.exit_code == 0, [task.error for task in result.failures]
    files = {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    files.pop("manifest.json")
    return files, Counter(task.kind.rpartition(".")[2] for task in result.tasks)


def test_raw_images_are_a_task_a_frame_and_move_nothing_else(stage, tmp_path):
    plain, tasks = built(stage, tmp_path / "plain")
    stage.write_text(exposed(stage.read_text(encoding="utf-8"), EXPOSED, RESPONDS), encoding="utf-8")
    raw, more = built(stage, tmp_path / "raw")

    assert more - tasks == Counter(expose=2, fixed_pattern=1)
    added = {f"frames/{frame}/Rig.Camera/{name}" for frame in ("0001", "0002") for name in RAW}
    added.add("cameras/Rig.Camera/fixed_pattern.exr")
    assert raw.keys() - plain.keys() == added
    assert [name for name in plain if plain[name] != raw[name]] == ["dataset.usda"]
    assert list(wrong_files(tmp_path / "raw", manifest.read(tmp_path / "raw"))) == []

    maps = read_exr(tmp_path / "raw/cameras/Rig.Camera/fixed_pattern.exr")["fixed_pattern"].channels
    of_camera = fixed_pattern(RESPONSE.spread, "Rig.Camera", (0, 0), (24, 32))
    np.testing.assert_array_equal(maps["response"], of_camera.response.astype(np.float32))
    assert not maps["dark_e"].any() and not maps["hot_e_per_s"].any()

    folder = tmp_path / "raw" / "frames" / "0002" / "Rig.Camera"
    numbers, about = read_tiff(folder / "raw.tiff")
    light = np.pad(read_exr(folder / "image.exr")["image"].channels["Y"].astype(float), 1, "edge")
    photons = {"mono": light * (0.9 * 9000 / 0.6)}
    shot = Shot(seed=3, camera="Rig.Camera", frame=2, exposure_time_s=0.02)
    np.testing.assert_array_equal(numbers, digital_numbers(RESPONSE, photons, shot))
    assert (about["black_level_dn"], about["white_level_dn"], about["frame"]) == (100, 3700, 2)
    with rawpy.imread(str(folder / "raw.dng")) as negative:
        np.testing.assert_array_equal(negative.raw_image, numbers)
        assert (negative.black_level_per_channel[0], negative.white_level) == (100, 3700)


def test_a_flat_white_target_has_the_noise_of_its_sensor_and_no_pattern_of_rays(stage, tmp_path):
    """EMVA 1288's spatial variance, by the covariance of two frames: what both have in common.

    768 pixels of 8,000 electrons know it to 0.2 %; four samples of rays left 9 %. And white.exr has the light of
    textbook rays.
    """
    text = edited(
        exposed(stage.read_text(encoding="utf-8"), EXPOSED, RESPONDS),
        ("plen:squareSize = 1.4", "plen:squareSize = 40"),
        ("1: (0, 0, -434.4)", "1: (20, 40, -434.4)"),
        ("2: (0.3, -0.2, -432)", "2: (20, 40, -432)"),
        ("plen:image:samples = 64", "plen:image:samples = 4"),
        ("plen:response:prnu = 0.01", "plen:response:prnu = 0"),
    )
    stage.write_text(text, encoding="utf-8")
    built(stage, tmp_path / "out")
    frames = [read_tiff(tmp_path / f"out/frames/{frame}/Rig.Camera/raw.tiff")[0] for frame in ("0001", "0002")]
    light = np.reshape(frames, (2, -1)) - 100.0
    y, x = np.mgrid[-1:1:24j, -1:1:32j].reshape(2, -1)
    smooth = np.stack([x**i * y**j for i in range(5) for j in range(5 - i)], axis=1)
    fall = (smooth @ np.linalg.lstsq(smooth, light.T, rcond=None)[0]).T
    assert abs(np.mean(np.prod(light / fall - 1, axis=0))) < 0.006**2

    white = read_exr(tmp_path / "out/cameras/Rig.Camera/white.exr")["white"].channels["Y"]
    tracer, corners = Tracer(load(stage).dataset.cameras[0].camera), ((0, 0), (31, 23))
    starts = [np.zeros(2), *(tracer.positions_mm(*corner) for corner in corners)]
    axis, *weights = (polar.mean_hit(tracer.camera, start, facing(434.4), None, 512)[1] for start in starts)
    np.testing.assert_allclose([white[row, column] for column, row in corners], np.array(weights) / axis, rtol=1e-4)


def camera_in(folder):
    """The input of a camera, whose lens a negative states."""
    write_json(folder / FOCUSED, to_plain(rigs.conventional()))
    return {"camera": {FOCUSED: folder / FOCUSED}}


def test_the_bytes_do_not_depend_on_bands(tmp_path, monkeypatch):
    """Neither does the crosstalk from one band into the next."""
    light = np.random.default_rng(2).uniform(0, 1.2, (61, 23))
    write_npy(array := tmp_path / light_file("image"), light)
    params = Expose(camera="C", frame=-4, seed=9, response=RESPONSE, irradiation=IRRADIATION)
    for name, band_px in (("whole", 1 << 20), ("bands", 5 * 23), ("rows", 1)):
        (tmp_path / name).mkdir()
        monkeypatch.setattr(tiff, "_BAND_PX", band_px)
        expose(params, {"image": {array.name: array}, **camera_in(tmp_path)}, tmp_path / name)
    for file in RAW:
        assert (tmp_path / "bands" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes(), file
        assert (tmp_path / "rows" / file).read_bytes() == (tmp_path / "whole" / file).read_bytes(), file


def test_a_raw_image_has_what_the_lens_lets_pass_at_each_pixel(tmp_path, monkeypatch):
    """Light falls by a hundredth from column to column, before the crosstalk; in bands as in one piece."""
    write_npy(tmp_path / light_file("image"), np.ones((4, 6)))
    shares = tuple(0.5 - 0.005 * column for column in range(6))
    field = FieldTransmission(
        axis=0.5,
        axis_px=(0.0, 0.0),
        places=((0.0, 1.0, 2.0, 3.0), (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)),
        shares=(shares,) * 4,
        error=0.0,
    )
    write_json(tmp_path / "transmission.json", {"mono": to_plain(field)})
    quiet = SensorResponse(
        quantum_efficiency=(1.0,),
        full_well_e=2e4,
        gain_dn_per_e=1.0,
        bit_depth=16,
        shot_noise=False,
        crosstalk=(0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0),
    )
    level = Irradiation(exposure_time_s=0.0, white_level=0.5)
    params = Expose(camera="C", frame=1, seed=0, response=quiet, irradiation=level)
    files = {"image": light_file("image"), "transmission": "transmission.json"}
    inputs = {role: {name: tmp_path / name} for role, name in files.items()} | camera_in(tmp_path)
    for band_px in (1 << 20, 1):
        monkeypatch.setattr(tiff, "_BAND_PX", band_px)
        expose(params, inputs, tmp_path)
        # Half of a pixel's electrons go to its right neighbour; the first column goes on beyond the border.
        expected = [10000, 9950, 9850, 9750, 9650, 9550]
        assert read_tiff(tmp_path / "raw.tiff")[0].tolist() == [expected] * 4
