"""What a stage says of coatings and glass, as losses at a wavelength, and what check says of a camera with channels."""

import math
from pathlib import Path

import pytest
from pxr import Usd

from pipeline.optics.glass.absorption import measured
from pipeline.optics.glass.catalogue import find
from pipeline.optics.glass.errors import UnknownAbsorption
from pipeline.optics.transmission.coatings import Coating, Film
from pipeline.scene.losses import check_losses, losses_at, read_losses, wavelengths_seen

ROOT = Path(__file__).resolve().parents[2]
TINY = ROOT / "tests/data/tiny_conventional/dataset.usda"
CAMERA, LENS = "/TinyConventional/Rig/Camera", "/TinyConventional/Rig/Lens"


@pytest.fixture
def stage() -> Usd.Stage:
    """The tiny conventional dataset, of a lens whose surfaces take light."""
    found = Usd.Stage.Open(str(TINY))
    found.SetEditTarget(found.GetSessionLayer())
    write(found, LENS, transmission="surfaces")
    return found


def write(stage: Usd.Stage, path: str, **values: object) -> None:
    """Set attributes of a prim by their names without the namespace."""
    for name, value in values.items():
        stage.GetPrimAtPath(path).GetAttribute(f"plen:{name}").Set(value)


def test_an_ideal_lens_takes_nothing_and_bare_clear_surfaces_have_no_tables(stage: Usd.Stage) -> None:
    losses = losses_at(stage.GetPrimAtPath(CAMERA), 550.0)
    assert losses is not None
    assert set(losses.coatings) == {None} and set(losses.per_mm) == {1.0}
    write(stage, LENS, transmission="ideal")
    assert losses_at(stage.GetPrimAtPath(CAMERA), 550.0) is None


def test_a_model_camera_has_no_surfaces_that_could_take_light(stage: Usd.Stage) -> None:
    """Its lens is ideal, whatever the prescription that it stands for says."""
    stage.GetPrimAtPath(CAMERA).GetAttribute("plen:camera:model").Set("thinLens")
    assert losses_at(stage.GetPrimAtPath(CAMERA), 550.0) is None


def test_tables_and_films_of_a_stage_are_those_of_the_surface_at_the_wavelength(stage: Usd.Stage) -> None:
    write(stage, f"{LENS}/S1", coatingWavelengths=[500, 600], coatingAngles=[0, 30])
    write(stage, f"{LENS}/S1", coatingReflectance=[0.01, 0.03, 0.02, 0.06])
    write(stage, f"{LENS}/S2", coatingFilmIndices=[2.1, 1.38], coatingFilmThicknesses=[130, 100])
    found = read_losses(stage.GetPrimAtPath(LENS), 550.0).coatings
    table, films = found[0], found[1]
    assert table is not None and table.angles_deg == (0.0, 30.0)
    assert table.reflectance == pytest.approx((0.02, 0.04))
    assert films == Coating(films=(Film(index=2.1, waves=130 / 550), Film(index=1.38, waves=100 / 550)))
    assert set(found[2:]) == {None}


def test_internal_transmittance_is_that_of_the_stated_thickness(stage: Usd.Stage) -> None:
    """Half of the light in 25 mm; between two entries the logarithm is linear."""
    write(stage, f"{LENS}/S1", internalTransmittance=0.5, internalTransmittanceThickness=25)
    write(stage, f"{LENS}/S3", internalTransmittanceTable=[0.5, 0.8], internalTransmittanceWavelengths=[500, 600])
    per_mm = read_losses(stage.GetPrimAtPath(LENS), 550.0).per_mm
    assert per_mm[0] ** 25 == pytest.approx(0.5)
    assert per_mm[2] ** 10 == pytest.approx(math.sqrt(0.5 * 0.8))


def test_the_catalogue_gives_what_a_surface_does_not_write(stage: Usd.Stage) -> None:
    lens = stage.GetPrimAtPath(LENS)
    write(stage, LENS, transmittanceSource="catalogue")
    with pytest.raises(UnknownAbsorption, match="ohara:LAL11"):
        read_losses(lens, 400.0)
    write(stage, f"{LENS}/S8", internalTransmittance=0.9)
    per_mm, glass = read_losses(lens, 400.0).per_mm, measured(find("schott:SF15"))
    assert glass is not None
    assert per_mm[3] == glass.share_per_mm(400.0) < 1
    assert per_mm[7] ** 10 == pytest.approx(0.9)
    assert per_mm[1] == per_mm[5] == 1  # air


def test_a_table_has_to_cover_every_channel(stage: Usd.Stage) -> None:
    """The red channel sees what lies beyond the tables, and the warning and the error name those wavelengths."""
    sensor = stage.GetPrimAtPath("/TinyConventional/Rig/Sensor")
    for name, low in (("green", 500), ("red", 600)):
        channel = stage.DefinePrim(sensor.GetPath().AppendChild(name), "PlenChannel")
        write(stage, str(channel.GetPath()), wavelengths=[low, low + 80], response=[1, 1], nodes=2)
    write(stage, f"{LENS}/S1", coatingWavelengths=[480, 610], coatingReflectance=[0.01, 0.03])
    write(stage, f"{LENS}/S3", internalTransmittanceTable=[0.5, 0.8], internalTransmittanceWavelengths=[480, 610])
    camera = stage.GetPrimAtPath(CAMERA)
    seen = wavelengths_seen(camera)
    beyond = [nm for nm in seen if nm > 610]
    assert len(seen) == 4 and len(beyond) == 2
    warning, error = check_losses(camera)
    assert (warning.code, warning.is_error, warning.at) == (
        "coating-range",
        False,
        f"{LENS}/S1.plen:coatingWavelengths",
    )
    assert all(f"{nm:.5g}" in warning.message for nm in beyond)
    assert error.code == "wavelength-out-of-range" and error.is_error
    assert f"{max(beyond):.7g}" in error.message
