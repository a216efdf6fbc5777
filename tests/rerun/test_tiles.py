"""Into how many tiles work is split changes no byte of the output folder."""

import itertools
from collections import Counter
from pathlib import Path

import pytest
from builds import made
from rerun.channels import TRIANGLE, stage_at
from stage_text import edited

from pipeline.files import exr_bands
from pipeline.products import cameras, tiles
from pipeline.truth.grid import correspond as searching

TILED = {"image_tile", "white_tile", "micro_images_tile"}


def in_small_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles of nine rows or four points, and bands of as little as there can be."""

    def bands(count: int, _: float) -> list[tuple[int, int]]:
        size = 9 if count > 9 else 4
        return [(first, min(first + size, count)) for first in range(0, count, size)]

    monkeypatch.setattr(tiles, "bands", bands)
    monkeypatch.setattr(tiles, "_MICROLENSES", 12)
    monkeypatch.setattr(searching, "_BAND_POSITIONS", 1)
    monkeypatch.setattr(exr_bands, "_BAND_PX", 1)
    monkeypatch.setattr(cameras, "_PICTURE_ROWS", 7)


@pytest.mark.parametrize(
    ("tiny", "truth", "kinds"),
    [
        pytest.param(
            "plenoptic",
            'uniform token plen:truth:method = "direct"\n            uniform bool plen:truth:rays = true',
            TILED | {"rays_tile", "truth_tile"},
            marks=pytest.mark.heavy,
        ),
        pytest.param(
            "plenoptic",
            'uniform token plen:truth:method = "two-plane"',
            TILED | {"rays_tile"},
            marks=pytest.mark.heavy,
        ),
        pytest.param("plenoptic, red", "", {"image_tile", "white_tile"}, marks=pytest.mark.heavy),
        ("conventional", 'uniform token plen:truth:method = "image"', {"image_tile", "white_tile", "rays_tile"}),
    ],
)
def test_small_tiles_give_the_same_bytes(
    tiny: str, truth: str, kinds: set[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, (kind, *channels) = '        over "Camera"\n        {\n', tiny.split(", ")
    stage = stage_at(tmp_path, kind, {name: TRIANGLE[name] for name in channels})
    stage.write_text(edited(stage.read_text("utf-8"), (camera, f"{camera}            {truth}\n")), encoding="utf-8")
    outs, counts = [], []
    for name in ("whole", "tiles"):
        if name == "tiles":
            in_small_tiles(monkeypatch)
        # Keys hold the text of the code, not what a test replaces in memory.
        result = made(stage, tmp_path / name, tmp_path / f"store of {name}")
        counts.append(Counter(task.kind for task in result.tasks))
        files = [path for path in sorted((tmp_path / name).rglob("*")) if path.is_file()]
        outs.append({path.relative_to(tmp_path / name).as_posix(): path.read_bytes() for path in files})
        outs[-1].pop("manifest.json")  # the manifest holds keys, which depend on the tiles
    assert outs[0].keys() == outs[1].keys()
    assert [name for name in outs[0] if outs[0][name] != outs[1][name]] == []
    assert not TILED & counts[0].keys()  # a result of one tile has no tasks for tiles
    assert all(counts[1][kind] >= 2 for kind in kinds), counts[1]


def test_tiles_hold_everything_once() -> None:
    for count, number in itertools.product((1, 2, 7, 600, 4384), (0.1, 1, 3.2, 513, 1e9)):
        found = tiles.bands(count, number)
        assert [i for first, end in found for i in range(first, end)] == list(range(count))
        assert len(found) <= max(1, min(count, number + 1))
    for points in ({}, {"b": 5, "a": 3}, {"a": 700}, {"c": 0, "b": 300, "a": 40, "d": 0}):
        shares = tiles.point_tiles(points, is_plenoptic=True)
        assert [list(some) for some in shares] == [sorted(some) for some in shares]
        met = {name: [i for some in shares if name in some for i in range(*some[name])] for name in points}
        assert met == {name: list(range(size)) for name, size in points.items()}
        assert all(any(name in some for some in shares) for name in points)
