"""A camera with channels as a whole: its folder, its tables, what channels share, and that other programs read it."""

import json
import re
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from builds import cells
from colour.io.fichet2021 import PATTERN_FICHET2021, match_groups_to_nm
from PIL import Image
from rerun.channels import TRIANGLE, stage_at
from stage_text import exposed

import pipeline
from pipeline.app.build import Result
from pipeline.app.verify import verify
from pipeline.formats import pairs

BAYER = """token[] plen:response:filters = ["red", "green", "green", "blue"]
        int plen:response:bitDepth = 12"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Result:
    folder = tmp_path_factory.mktemp("channels")
    stage = stage_at(folder, "conventional", {**TRIANGLE, "again": TRIANGLE["red"]})
    return pipeline.build(stage, folder / "out", jobs=1)


def test_equal_responses_give_equal_tables_and_are_computed_once(built: Result) -> None:
    folder = built.out / "frames/0001/Rig.Camera"
    red, again = (cells(folder / name / "correspondences.csv") for name in ("red", "again"))
    assert [{**row, "channel": ""} for row in red] == [{**row, "channel": ""} for row in again]
    assert {row["channel"] for row in red} == {"red"}
    assert {row["channel"] for row in again} == {"again"}


def test_channels_differ_by_lateral_colour(built: Result) -> None:
    tables = [cells(built.out / f"frames/0002/Rig.Camera/{name}/correspondences.csv") for name in TRIANGLE]
    x = np.array([[float(row["x_px"]) for row in rows] for rows in tables])
    assert x.shape == (3, 6)
    assert 0 < np.abs(x[0] - x[2]).max() < 1  # pixels of 0.1 mm


def test_every_channel_has_a_certificate(built: Result) -> None:
    names = {f"Rig.Camera@{name}" for name in (*TRIANGLE, "again")}
    certificates = json.loads((built.out / "manifest.json").read_text(encoding="utf-8"))["certificate"]
    assert set(certificates) == names
    assert all(one["passed"] for one in certificates.values())


def test_the_image_of_all_channels_is_that_of_each(built: Result) -> None:
    folder = built.out / "frames/0001/Rig.Camera"
    joined = OpenEXR.File(str(folder / "image.exr"), separate_channels=True).channels()
    assert set(joined) == {"R", "G", "B", "again"}
    for letter, name in {"R": "red", "G": "green", "B": "blue", "again": "again"}.items():
        alone = OpenEXR.File(str(folder / name / "image.exr"), separate_channels=True).channels()["Y"].pixels
        np.testing.assert_array_equal(joined[letter].pixels, alone)
    assert np.asarray(Image.open(folder / "image.png")).shape == (24, 32, 3)


def test_another_program_can_judge_the_folder(built: Result) -> None:
    verdict = verify(built.out)
    assert verdict.problems == []
    assert set(verdict.cameras) == {f"Rig.Camera@{name}" for name in (*TRIANGLE, "again")}


def test_an_opened_folder_has_a_camera_for_each_channel(built: Result) -> None:
    out = pipeline.open_output(built.out)
    assert list(out.cameras) == [f"Rig.Camera@{name}" for name in (*TRIANGLE, "again")]
    red, blue = (out.cameras[f"Rig.Camera@{name}"] for name in ("red", "blue"))
    assert red.correspondences.x_px.tolist() != blue.correspondences.x_px.tolist()
    assert set(red.correspondences.channel) == {"red"}
    np.testing.assert_array_equal(red.views[0].poses.camera_from_world, blue.views[0].poses.camera_from_world)


def test_a_bayer_pattern_takes_each_pixel_from_its_channel(tmp_path: Path) -> None:
    """Without noise digital numbers are the irradiance of the pixel's own channel, by its quantum efficiency."""
    stage = stage_at(tmp_path, "conventional", TRIANGLE)
    text = stage.read_text(encoding="utf-8").replace("plen:nodes = 2", "plen:nodes = 1")
    level = """token plen:image:exposure = "level"
        double plen:image:exposureTime = 1
        double plen:image:whiteLevel = 0.5"""
    response = """bool plen:response:shotNoise = false
        double plen:response:fullWell = 8000
        double plen:response:gain = 0.5
        double[] plen:response:quantumEfficiency = [0.4, 0.8, 0.2]"""
    stage.write_text(exposed(text, level, f"{BAYER}\n{response}"), encoding="utf-8")
    out = pipeline.build(stage, tmp_path / "out", jobs=1).out / "frames/0001/Rig.Camera"
    image = OpenEXR.File(str(out / "image.exr"), separate_channels=True).channels()
    numbers = np.asarray(Image.open(out / "raw.tiff"))
    photons = 0.5 * 8000 / 0.8
    for row, column, letter, efficiency in ((0, 0, "R", 0.4), (0, 1, "G", 0.8), (1, 0, "G", 0.8), (1, 1, "B", 0.2)):
        light = image[letter].pixels[row::2, column::2].astype(float)
        expected = np.rint(0.5 * np.minimum(photons * efficiency * light, 8000))
        np.testing.assert_array_equal(numbers[row::2, column::2], expected)
    assert np.ptp(np.asarray(Image.open(out / "raw.png")).astype(int), axis=2).max() > 0


def test_only_different_cameras_in_one_channel_make_a_stereo_pair() -> None:
    """And only where they see a frame together: states of one camera never do."""
    names = ["Left@red", "Left@blue", "Right@red", "Right@blue"]
    assert pairs(names, {name: [1] for name in names}) == [("Left@red", "Right@red"), ("Left@blue", "Right@blue")]
    assert pairs(["A.0001", "A.0003", "B"], {"A.0001": [1, 2], "A.0003": [3], "B": [1, 2]}) == [("A.0001", "B")]


@pytest.mark.heavy
def test_an_exposure_by_radiance_counts_the_photons_of_each_channel(tmp_path: Path) -> None:
    """Triangles have the area times the mean wavelength of their corners; the lens bends both colours almost alike."""
    stage = stage_at(tmp_path, "conventional", TRIANGLE)
    text = stage.read_text(encoding="utf-8")
    radiance = """token plen:image:exposure = "radiance"
        double plen:image:exposureTime = 0.01
        double plen:image:radiance = 2"""
    response = """double plen:response:fullWell = 9000
        double plen:response:gain = 0.4
        double[] plen:response:quantumEfficiency = [0.4, 0.5, 0.4]"""
    stage.write_text(exposed(text, radiance, f"{BAYER}\n{response}"), encoding="utf-8")
    result = pipeline.build(stage, tmp_path / "out", targets=["frames/1/Rig.Camera/raw.tiff"], jobs=1)
    assert result.exit_code == 0, [task.error for task in result.failures]
    with Image.open(tmp_path / "out/frames/0001/Rig.Camera/raw.tiff") as raw:
        photons = json.loads(raw.tag_v2[270])["photons_at_relative_irradiance_1"]
    light = {name: (last - first) / 2 * (first + most + last) / 3 for name, (first, most, last) in TRIANGLE.items()}
    for name in TRIANGLE:
        assert photons[name] / photons["green"] == pytest.approx(light[name] / light["green"], rel=0.01)


@pytest.mark.heavy
def test_a_sensor_of_single_wavelengths_has_an_image_that_colour_science_reads_as_spectra(tmp_path: Path) -> None:
    """Names of its channels are read by colour-science's own pattern; values are those of each channel's image."""
    frame = spectral_frame(tmp_path)
    with OpenEXR.File(str(frame / "spectral.exr"), separate_channels=True) as file:
        found = {name: channel.pixels for name, channel in file.channels().items()}
        assert file.header()["spectralLayoutVersion"] == "1.0"
    pattern, spectra = re.compile(rf"^T\.*{PATTERN_FICHET2021}$"), {}
    for name, pixels in found.items():
        match = pattern.match(name)
        assert match, name
        spectra[match_groups_to_nm(match[1], *match.group(3, 4))] = pixels
    assert_spectra(frame, spectra)


def spectral_frame(folder: Path) -> Path:
    stage = stage_at(folder, "conventional", TRIANGLE)
    text = stage.read_text(encoding="utf-8").replace("plen:nodes = 2", "plen:nodes = 1")
    stage.write_text(text, encoding="utf-8")
    wanted = [f"frames/0001/Rig.Camera/{name}image.exr" for name in ("", "red/", "green/", "blue/")]
    result = pipeline.build(stage, folder / "out", targets=[*wanted, f"{wanted[0][:-9]}spectral.exr"], jobs=1)
    assert result.exit_code == 0, [task.error for task in result.failures]
    return folder / "out/frames/0001/Rig.Camera"


def assert_spectra(frame: Path, spectra: dict[float, np.ndarray]) -> None:
    """Pixels by wavelength in nm are those of the channels' images."""
    for (name, corners), nm in zip(sorted(TRIANGLE.items()), sorted(spectra), strict=True):
        # Photons grow with the wavelength, so that their mean lies a little beyond that of the corners.
        assert 0 < nm - sum(corners) / 3 < 2.0
        image = OpenEXR.File(str(frame / name / "image.exr"), separate_channels=True).channels()["Y"].pixels
        np.testing.assert_array_equal(spectra[nm], image)
