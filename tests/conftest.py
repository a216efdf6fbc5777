"""What several rooms of the tests share: the Tronnier lens, small cameras, and their position images.

Kernels are compiled once per machine and source: nothing here touches PIPELINE_JIT_CACHE.
"""

import functools
import os
from pathlib import Path

import pytest
from builds import tiny
from laws import rigs

from pipeline import cli
from pipeline.camera import tracer
from pipeline.camera.parts.camera import Camera, Sensor
from pipeline.camera.tracer import Tracer
from pipeline.optics.prescription import Prescription, Surface
from pipeline.truth.grid.ray_grid import RayGrid

for name in ("outlines", "grid_outlines"):
    # Tests share some hundred cameras; a user's process has few, so the package keeps the outlines of few.
    setattr(tracer, name, functools.cache(getattr(tracer, name).__wrapped__))


@pytest.fixture
def in_this_process(monkeypatch, capsys):
    """Run the command in this process: exit code, stdout, stderr."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["pipeline", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        return end.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def run(tmp_path, monkeypatch, in_this_process):
    """The same in an empty folder, with a store of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PIPELINE_CACHE", str(tmp_path / "store"))
    return in_this_process


@pytest.fixture(scope="session")
def common_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store for all processes of this test run: what one test has built, others start from."""
    own = tmp_path_factory.getbasetemp()
    return (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "common-store"


@pytest.fixture(scope="session")
def conventional_build(tmp_path_factory: pytest.TempPathFactory, common_store: Path) -> Path:
    """Output folder of the tiny conventional dataset, which no test changes."""
    return tiny("conventional", tmp_path_factory.mktemp("built"), common_store)


@pytest.fixture(scope="session")
def plenoptic_build(tmp_path_factory: pytest.TempPathFactory, common_store: Path) -> Path:
    """Output folder of the tiny plenoptic dataset, which no test changes."""
    return tiny("plenoptic", tmp_path_factory.mktemp("built"), common_store)


@pytest.fixture(scope="session")
def tronnier() -> Prescription:
    """The double Gauss 100 mm f/2 with its full stop."""
    return rigs.tronnier()


@pytest.fixture(scope="session")
def conventional() -> Camera:
    """The double Gauss at about f/11 before 96 x 72 pixels of 50 micrometres."""
    return rigs.conventional()


@pytest.fixture(scope="session")
def plenoptic() -> Camera:
    """The paper's plenoptic camera before 128 x 96 pixels of 10 micrometres."""
    return rigs.plenoptic(extent_mm=3.0)


@pytest.fixture(scope="session")
def ideal() -> Camera:
    """An ideal thin lens of 50 mm with its stop of 10 mm, focused at 500 mm."""
    lens = Surface(semi_diameter_mm=5.0, focal_length_mm=50.0, thickness_mm=0.0)
    stop = Surface(semi_diameter_mm=5.0, is_stop=True)
    sensor = Sensor(width_px=600, height_px=400, pitch_mm=0.01)
    prescription = Prescription(surfaces=(lens, stop))
    return Camera(prescription=prescription, sensor=sensor, sensor_distance_mm=500 * 50 / 450)


@pytest.fixture(scope="session")
def plenoptic_tracer() -> Tracer:
    """Of the paper's whole array."""
    return Tracer(rigs.plenoptic())


@pytest.fixture(scope="session")
def conventional_grid(conventional: Camera, tmp_path_factory: pytest.TempPathFactory) -> RayGrid:
    """K = 1, 1,024 rays per position."""
    return rigs.ray_grid(tmp_path_factory.mktemp("conventional"), conventional, 1, 1024)


@pytest.fixture(scope="session")
def plenoptic_grid(plenoptic: Camera, tmp_path_factory: pytest.TempPathFactory) -> RayGrid:
    """K = 2, 256 rays per position."""
    return rigs.ray_grid(tmp_path_factory.mktemp("plenoptic"), plenoptic, 2, 256)
