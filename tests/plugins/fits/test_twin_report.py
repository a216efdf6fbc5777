"""The fit to a real camera in the report: its maps show what was planted, and its images are those of their frames."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from places import DATA

from pipeline.errors import UsageError
from pipeline.files.exr import read_exr
from pipeline.files.png import read_png, write_png
from pipeline.plugins.fits.real_images import found_images
from pipeline.plugins.fits.twin_page import residual_maps
from pipeline.scene.load import open_dataset

TINY = DATA / "tiny_conventional/dataset.usda"
RED = "#c0392b"


def document(off_px: np.ndarray, x_px: np.ndarray, frame: np.ndarray) -> dict:
    """What is known of a fit to a camera of 300 x 300 px, with a sigma of 0.1 px."""
    chi2 = (off_px**2).sum(axis=1) / 0.1**2
    rows = {"camera": ["A"] * len(x_px), "frame": frame.tolist(), "x_px": x_px.tolist(), "residual_px": off_px.tolist()}
    rows |= {"sigma_px": [0.1] * len(x_px), "chi2": chi2.tolist(), "expected": [2.0] * len(x_px)}
    return {"rows": rows, "sizes_px": {"A": [300, 300]}}


def test_residuals_that_are_planted_in_one_region_of_one_frame_are_drawn_there():
    """Nine by nine positions in each of two frames; those at the top right of the second are eight sigma off."""
    x_px = np.tile(np.stack(np.meshgrid(*[np.arange(9) * 33.0 + 15] * 2), axis=-1).reshape(-1, 2), (2, 1))
    frame = np.repeat([4, 7], 81)
    there = (frame == 7) & (x_px[:, 0] > 200) & (x_px[:, 1] < 100)
    off_px = np.where(there[:, None], [0.8, 0.0], np.random.default_rng(1).normal(scale=0.1, size=x_px.shape))
    image = ElementTree.fromstring(residual_maps(document(off_px, x_px, frame)))
    words = [(each, "".join(each.itertext())) for each in image.iter() if each.tag.endswith("text")]
    red = [(each, text) for each, text in words if RED in each.get("style")]
    regions = [each for each, text in words if re.fullmatch(r"χ² [\d.]+", text)]
    places = [[float(each.get("x")), float(each.get("y"))] for each in regions]
    (right, _), (_, top) = np.max(places, axis=0), np.min(places, axis=0)
    assert len(places) == 9
    at_corner = [each for each, place in zip(regions, places, strict=True) if place == [right, top]]
    assert [text for _, text in red if text.startswith("frame")] == [text for _, text in words if "frame 7" in text]
    assert [each for each, text in red if not text.startswith("frame")] == at_corner


def folder_of(tmp_path: Path, *names: str, size: tuple[int, int]) -> Path:
    (tmp_path / "photos").mkdir()
    for name in names:
        write_png(tmp_path / "photos" / name, np.zeros(size[::-1], np.uint8))
    return tmp_path / "photos"


@pytest.mark.parametrize(
    ("names", "grown", "said"),
    [
        (["a_1.png"], 1, r"photos/a_1\.png is \d+ x \d+ px, the images of the camera are \d+ x \d+ px"),
        (["a_9.png"], 0, "a_9.png names frame 9, which the dataset does not have"),
        (["board.png"], 0, "board.png names no frame"),
        (["a_1.png", "b_01.png"], 0, "b_01.png and photos/a_1.png are both of frame 1"),
        ([], 0, "photos is no folder with images"),
    ],
)
def test_images_that_are_none_of_the_camera_are_refused(tmp_path, names, grown, said):
    dataset = open_dataset(TINY)
    width, height = dataset.cameras[0].camera.sensor.size_px
    folder = folder_of(tmp_path, *names, size=(width + grown, height))
    with pytest.raises(UsageError, match=said):
        found_images([str(folder)], dataset, tmp_path / "fitted.usda")


def test_images_that_a_build_may_not_read_and_cameras_that_there_are_none_of_are_refused(tmp_path):
    dataset = open_dataset(TINY)
    folder = folder_of(tmp_path, "1.png", size=dataset.cameras[0].camera.sensor.size_px)
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(UsageError, match=r"may not read .*1\.png"):
        found_images([str(folder)], dataset, tmp_path / "elsewhere/fitted.usda")
    with pytest.raises(UsageError, match="names no camera of the dataset"):
        found_images([f"Rig.Camara={folder}"], dataset, tmp_path / "fitted.usda")


def told(report: Path) -> dict:
    (script,) = (report / "data").glob("twin.*.js")
    return json.loads(re.fullmatch(r'plenopticReport\(".*?",(.*)\);\n', script.read_text(), re.DOTALL)[1])


def pictures(report: Path) -> dict[str, np.ndarray]:
    page = json.loads(re.search(r",(\{.*\})\);\n", (report / "data/page.js").read_text())[1])
    shown = [each for each in page["cameras"][0]["views"][0]["pictures"] if each["section"] == "Twin"]
    return {each["kind"]: read_png(report / each["path"]) for each in shown}


def test_a_twin_and_images_that_differ_by_exposure_alone_are_shown_as_the_same(
    tmp_path, monkeypatch, in_this_process, conventional_build, common_store
):
    """The twin's own light, in other units and above a black level, with something behind the board that no stage has,
    and with one pixel that nobody explains.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    light = read_exr(next(conventional_build.glob("frames/0001/*/image.exr")))["image"].channels["Y"]
    real = np.rint(30_000.0 * light + 700.0).astype(np.uint16)
    real[0] = 60_000
    (tmp_path / "photos").mkdir()
    write_png(tmp_path / "photos/IMG_0001.png", real)
    rows = next(conventional_build.glob("frames/0001/*/correspondences.csv")).read_text().splitlines()
    table = [line for line in rows if not line.startswith("#")]
    (tmp_path / "corners.csv").write_text("\n".join(["# pixel_origin: 0", "# position: exact", *table, ""]))
    free = ["--poses", "known", "--sigma", "0.05", "--allow-root", DATA]
    code, _, log = in_this_process("calibrate", TINY, "corners.csv", "-o", "fitted.usda", "--images", "photos", *free)
    assert code == 0, log
    assert in_this_process("build", "fitted.usda", "-o", "out", "--allow-root", DATA)[0] == 0
    code, _, log = in_this_process("report", "out")
    assert code == 0 and "the report has no" not in log
    found, shown = told(tmp_path / "out.report"), pictures(tmp_path / "out.report")
    gain, offset = re.search(r"times (\S+) plus (\S+):", "\n".join(found["lines"])).groups()
    assert (float(gain), float(offset)) == pytest.approx((30_000, 700), rel=1e-4)
    assert any(line.startswith("chi squared") for line in found["lines"]) and "<svg" in found["drawing"]
    assert list(shown) == ["real", "twin", "real minus twin"]
    board = {kind: picture[1:].astype(int) for kind, picture in shown.items()}
    assert np.ptp(board["real"]) == 255 and np.abs(board["real"] - board["twin"]).max() <= 1
    assert np.abs(board["real minus twin"] - 128).max() <= 1

    real[5, 7] += 6000
    write_png(tmp_path / "photos/IMG_0001.png", real)
    assert in_this_process("report", "out")[0] == 0
    difference = pictures(tmp_path / "out.report")["real minus twin"].astype(int)
    assert np.argwhere(difference[1:] > 200).tolist() == [[4, 7]]
    (tmp_path / "photos/IMG_0001.png").unlink()
    code, _, log = in_this_process("report", "out")
    assert code == 0 and "the report has no fit" in log and "IMG_0001.png is no image that can be read" in log
