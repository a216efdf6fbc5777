"""Files written band by band are those written whole."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.files import exr_bands
from pipeline.files.exr import Part, read_exr, write_exr
from pipeline.files.exr_bands import BandedPart, write_bands


def parts() -> list[Part]:
    """Two sizes, noise that hardly packs, planes that do, NaN, edges off the tiles."""
    rng = np.random.default_rng(5)
    ramp = np.add.outer(np.arange(400.0), np.arange(300.0)).astype(np.float32)
    noise = rng.normal(size=(400, 300)).astype(np.float32)
    noise[::7, 3] = np.nan
    small = rng.integers(0, 9, (200, 150)).astype(np.float32)
    return [
        Part(name="near", channels={"Y": noise, "X": ramp}, attributes={"plane_z_mm": 0.1, "a": "text"}),
        Part(name="moments", channels={"b": small, "a": 2 * small, "c": np.zeros_like(small)}),
    ]


def banded(part: Part) -> BandedPart:
    def rows(first: int, end: int) -> np.ndarray:
        return np.stack([pixels[first:end] for pixels in part.channels.values()], axis=-1)

    return BandedPart(
        name=part.name, shape=part.shape, channels=tuple(part.channels), rows=rows, attributes=part.attributes
    )


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("band_px", [1, 1 << 22])
def test_bands_of_any_height_give_the_bytes_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int, band_px: int
) -> None:
    monkeypatch.setattr(exr_bands, "_BAND_PX", band_px)
    write_exr(tmp_path / "whole", parts()[:count])
    write_bands(tmp_path / "bands", [banded(part) for part in parts()[:count]])
    assert (tmp_path / "bands").read_bytes() == (tmp_path / "whole").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bands", "whole"]
    assert list(read_exr(tmp_path / "bands")) == [part.name for part in parts()[:count]]


def test_a_part_that_gives_other_rows_than_it_was_asked_for_is_an_error(tmp_path: Path) -> None:
    part = BandedPart(name="j", shape=(9, 4), channels=("X",), rows=lambda a, b: np.zeros((b - a, 5)))
    with pytest.raises(ValueError, match="rows 0 to 9"):
        write_bands(tmp_path / "x", [part])
    assert not list(tmp_path.glob("*.band"))
