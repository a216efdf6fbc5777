"""Claim: what a device runs gives the bits of processors, or those of float32, shown in CUDA's simulator of Numba."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from stage_text import stage_in, tiny_text

TESTS = Path(__file__).parents[1]
SINGLE_MM, SINGLE = 2e-4, 1e-5
"""Rays in float32 may differ by this 600 mm away, six roundings of that distance, and shares by so much of themselves.
A pixel of these rigs is 300 micrometres there."""

SMALL = {
    "conventional": (
        ("Aperture = 32", "Aperture = 8"),
        ("Aperture = 24", "Aperture = 6"),
        ("(32, 24)", "(8, 6)"),
        ("image:samples = 64", "image:samples = 4"),
        ("rays = 1", "rays = false"),
        ("            uniform int plen:truth:samples = 64\n", ""),
    ),
    "plenoptic": (
        ("Aperture = 14.4", "Aperture = 3.6"),
        ("Aperture = 12", "Aperture = 3"),
        ("(48, 40)", "(12, 10)"),
        ("image:samples = 64", "image:samples = 4"),
    ),
}
"""What makes few rays of the images of a stage: the simulator takes a millisecond for each."""
IMAGE = 1e-5
"""Largest difference of images of both, relative to white: rays in float32 weigh the same to 1e-5 of themselves."""


def simulated(*arguments: str) -> list[list[str]]:
    """Lines of `simulated.py`, which says what stands in them."""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": f"{TESTS.parent}{os.pathsep}{TESTS}"}
    command = [sys.executable, str(TESTS / "device" / "simulated.py"), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return [line.split() for line in done.stdout.splitlines()]


def test_moments_in_the_simulator_have_the_bits_of_processors() -> None:
    """With microlenses of every model, too, with squares, where rays are weighed, and at aspheres."""
    rows = simulated("moments")
    assert len(rows) == 11
    for name, _, _, lit, same, difference in rows:
        assert int(lit) > 0, name
        assert same == "True", f"{name} differs by {difference}"


@pytest.mark.heavy
def test_more_samples_than_a_packet_holds_have_them_too() -> None:
    name, samples, _, lit, same, _ = simulated("long")[-1]
    assert (name, samples, lit, same) == ("conventional", "1024", "1", "True")


@pytest.mark.heavy
def test_rays_of_images_are_those_of_processors_but_for_float32() -> None:
    """The same ones pass, in the same order; with diffraction, too. They have all bits of compiled float32."""
    rows = simulated("rays")
    assert len(rows) == 12
    for name, rays, apart_mm, share, same in rows:
        assert int(rays) > 40, name
        assert 0 < float(apart_mm) < SINGLE_MM, f"{name}: {apart_mm} mm"
        assert float(share) < SINGLE, f"{name}: {share}"
        assert same == "True", name


@pytest.mark.heavy
@pytest.mark.parametrize("kind", ["conventional", "plenoptic"])
def test_a_build_on_a_device_has_the_truth_of_processors(kind: str, tmp_path: Path) -> None:
    """Certificate and rows to the byte; images to the rounding of float32, and they say what traced them."""
    stage = stage_in(tmp_path, tiny_text(kind, *SMALL[kind]))
    outputs = built(stage, tmp_path / "a"), built(stage, tmp_path / "b", "--device", "cuda")
    processor, device = outputs
    tables = [sorted(path.relative_to(out) for path in out.rglob("correspondences.*")) for out in outputs]
    assert tables[0] == tables[1] != []
    assert all((processor / path).read_bytes() == (device / path).read_bytes() for path in tables[0])
    certificates = [json.loads((out / "manifest.json").read_text("utf-8"))["certificate"] for out in outputs]
    assert certificates[0] == certificates[1]
    for image in processor.rglob("*.exr"):
        with OpenEXR.File(str(image)) as one, OpenEXR.File(str(device / image.relative_to(processor))) as other:
            assert "rays" not in one.header()
            is_traced = kind == "plenoptic" or image.name != "white.exr"  # whites of lenses alone are by quadrature
            assert ("float32, cuda simulator" in other.header().get("rays", "")) == is_traced
            for name, channel in one.channels().items():
                np.testing.assert_allclose(other.channels()[name].pixels, channel.pixels, rtol=0, atol=IMAGE)


def built(stage: Path, folder: Path, *arguments: str) -> Path:
    """The output of a build with a store of its own, in the simulator."""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "PIPELINE_CACHE": str(folder / "store")}
    command = [sys.executable, "-m", "pipeline", "build", str(stage), "-o", str(folder / "out"), "--quiet", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder / "out"
