"""Images to a stated noise, as builds: what is reused, what is stated, and the same bytes however they came about."""

from collections import Counter
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from builds import made
from stage_text import edited, stage_in, tiny_text

from pipeline.engine.events import Done
from pipeline.products import tiles
from pipeline.products.images import plan

IMAGES = ("image", "white")
LAMP = """    def SphereLight "Lamp"
    {
        float inputs:intensity = 9
        float inputs:radius = 40
        double3 xformOp:translate = (80, 90, -250)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }

"""


def stage_with(noise: float, folder: Path, *, lit: bool = False) -> Path:
    """The tiny dataset with a noise that is asked for, and with a lamp."""
    samples = "uniform int plen:image:samples = "
    noisy = f"{samples}16\n            uniform double plen:image:noise = {noise}"
    text = tiny_text("conventional", (f"{samples}64", noisy), ("endTimeCode = 2", "endTimeCode = 1"))
    if lit:
        text = edited(text, ('    def PlenCheckerboard "Board"', LAMP + '    def PlenCheckerboard "Board"'))
    folder.mkdir(exist_ok=True)
    return stage_in(folder, text)


def files_of(out: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(out.rglob("*.exr"))}


@pytest.mark.parametrize("lit", [False, pytest.param(True, marks=pytest.mark.heavy)])
def test_a_finer_request_goes_on_from_a_coarser_one(lit: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From its first passes: it ends with the bytes that it has alone."""
    monkeypatch.setattr(plan, "MOST_SAMPLES", 256)
    monkeypatch.setattr(tiles, "_STRIP_PX", 400)  # two strips
    coarse_stage, fine_stage = (stage_with(noise, tmp_path / str(noise), lit=lit) for noise in (0.12, 0.05))
    made(coarse_stage, tmp_path / "a", tmp_path / "store", targets=IMAGES)
    finer = made(fine_stage, tmp_path / "b", tmp_path / "store", targets=IMAGES)
    made(fine_stage, tmp_path / "c", tmp_path / "other store", targets=IMAGES)
    assert files_of(tmp_path / "b") == files_of(tmp_path / "c") != files_of(tmp_path / "a")
    ran = Counter(task.kind for task in finer.tasks if task.state == "executed")
    assert not {"image_first", "white_first"} & ran.keys() and ran["image_strip"] == 2


def test_what_is_reached_is_stated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the header, per pixel, and, while it runs, in the progress; the most samples end a request too fine."""
    monkeypatch.setattr(plan, "MOST_SAMPLES", 64)
    events = []
    stage = stage_with(0.001, tmp_path / "stage")
    result = made(stage, tmp_path / "out", tmp_path / "store", targets=IMAGES, on_event=events.append)
    assert Counter(task.kind for task in result.tasks)["image_strip"] == 1
    file = OpenEXR.File(str(tmp_path / "out/frames/0001/Rig.Camera/image.exr"), separate_channels=True)
    header = {name: float(file.parts[0].header[name]) for name in ("noise_asked", "noise", "passes_most")}
    assert header["noise_asked"] == 0.001 and header["passes_most"] == 3
    assert 0.001 < header["noise"] < 0.1, "not reached, and said so"
    image, error = (part.channels["Y"].pixels.astype(float) for part in file.parts)
    noisy = error > 0.2 * header["noise"] * image.mean()
    rms = np.sqrt(np.mean(error[noisy] ** 2)) / image.mean()
    assert rms == pytest.approx(header["noise"], rel=0.3), "that of sampled pixels, which white's adds to"
    news = [event.news for event in events if isinstance(event, Done) and event.news]
    assert news and all(text.endswith(", asked 0.001") for text in news)
