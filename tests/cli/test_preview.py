"""Previews: coarse pictures in a folder of their own; the results of the dataset are neither used nor touched."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from places import TINY

from pipeline.app.build import build, project
from pipeline.app.verify import verify
from pipeline.engine.running.session import plan_of
from pipeline.errors import UsageError

PICTURES = {"cameras/Rig.Camera/white.png", "frames/0001/Rig.Camera/image.png", "frames/0002/Rig.Camera/image.png"}


def test_only_pictures_are_made_and_by_other_keys(tmp_path):
    whole, small = project(TINY, tmp_path / "out"), project(TINY, preview=True)
    assert small.out == Path("build/tiny_conventional.preview")
    assert set(small.files) == PICTURES
    assert {small.graph[name].short_kind for name in small.graph} == {"camera", "white", "image"}
    for name in small.graph:
        assert small.graph[name].params != whole.graph[name].params


def test_a_preview_has_a_quarter_of_the_size_and_the_same_view(tmp_path, common_store, monkeypatch):
    """Each of its pixels is near the mean of the sixteen that it stands for: by the law of the pixel's integral."""
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    assert build(TINY, tmp_path / "whole", targets=sorted(PICTURES), jobs=1).exit_code == 0
    before = {path: path.read_bytes() for path in (tmp_path / "whole").rglob("*") if path.is_file()}
    assert build(TINY, tmp_path / "small", preview=True, jobs=1).exit_code == 0
    assert {path: path.read_bytes() for path in before} == before
    manifest = json.loads((tmp_path / "small" / "manifest.json").read_text())
    assert set(manifest["files"]) == PICTURES
    with pytest.raises(UsageError, match="it is a preview, without truth"):
        verify(tmp_path / "small")
    fine, coarse = (light(tmp_path / name / "frames/0001/Rig.Camera/image.png") for name in ("whole", "small"))
    assert (fine.shape, coarse.shape) == ((24, 32), (6, 8))
    means = fine.reshape(6, 4, 8, 4).mean(axis=(1, 3))
    # The mean of 16 independent rays, half of them dark, scatters by one eighth; Sobol points do better.
    assert np.abs(means - coarse).max() < 2 / 8
    assert np.sqrt(((means - coarse) ** 2).mean()) < 0.5 / 8
    assert abs((means - coarse).mean()) < 2 / 8 / np.sqrt(means.size)


def light(path):
    """Grey picture as relative irradiance: the standard's decoding of sRGB (IEC 61966-2-1)."""
    value = np.asarray(Image.open(path).convert("L"), float) / 255
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def test_a_preview_never_goes_into_the_folder_of_the_dataset(tmp_path, common_store, monkeypatch):
    monkeypatch.setenv("PIPELINE_CACHE", str(common_store))
    build(TINY, tmp_path / "out", targets=["cameras/Rig.Camera/white.png"], jobs=1)
    build(TINY, tmp_path / "whole", jobs=1)
    with pytest.raises(UsageError):
        plan_of(project(TINY, tmp_path / "whole", preview=True))
