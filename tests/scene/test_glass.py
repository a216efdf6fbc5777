"""A lens with indices of a catalogue, coatings and absorbing glass: what is read, and what check says."""

import math

import pytest
from places import ROOT, TINY
from pxr import Usd
from stage_text import over_tiny, stage_in

from pipeline.optics.glass.absorption import measured
from pipeline.optics.glass.catalogue import find
from pipeline.optics.glass.medium import GlassError
from pipeline.optics.transmission import Coating, Film
from pipeline.scene.load import load, open_dataset
from pipeline.scene.losses import check_losses, light_wavelengths_nm, losses_at, read_losses

GLASSES = ["hikari:BAF10", "hikari:BAF10", "schott:SF15", "schott:F5", "ohara:LAL11", "hoya:LAF3"]
IN_GLASS = (0, 2, 3, 6, 7, 9)
CAMERA, LENS = "/TinyConventional/Rig/Camera", "/TinyConventional/Rig/Lens"


@pytest.fixture
def write(tmp_path):
    """Write a dataset with the conventional rig and overrides of its lens and camera; gives its path."""

    def writer(lens='uniform token plen:indexSource = "catalogue"', camera="", surfaces=""):
        return stage_in(tmp_path, over_tiny(camera, f"{lens}\n{surfaces}"))

    return writer


def read(path):
    (entry,) = open_dataset(path, [ROOT]).cameras
    return entry


def indices(path):
    """Indices of the six elements of its lens."""
    surfaces = read(path).camera.prescription.surfaces
    return [surfaces[i].index for i in IN_GLASS]


def test_printed_indices_are_read_bit_for_bit_although_the_glasses_are_known(write):
    path = write(lens="")

    assert indices(path) == [1.67, 1.67, 1.699, 1.603, 1.658, 1.717]
    assert read(path).index_source == "printed"


def test_catalogue_indices_are_those_of_the_glasses_at_the_wavelength_of_the_camera(write):
    for wavelength_nm in (587.56, 486.1327, 656.2725):
        path = write(camera=f"uniform double plen:camera:wavelength = {wavelength_nm}")
        assert indices(path) == [find(name).index(wavelength_nm) for name in GLASSES]


def test_everything_but_the_indices_stays_as_printed(write):
    printed, catalogue = (read(write(*lens)).camera for lens in ([""], []))

    for one, other in zip(printed.prescription.surfaces, catalogue.prescription.surfaces, strict=True):
        assert (one.radius_mm, one.thickness_mm, one.semi_diameter_mm) == (
            other.radius_mm,
            other.thickness_mm,
            other.semi_diameter_mm,
        )
        assert abs(one.index - other.index) < 5e-4


def test_tables_and_reports_name_the_medium_of_every_element(write):
    surfaces = 'over "S10"\n{\nuniform string plen:glass = ""\n}'

    assert read(write()).index_source == f"catalogue ({', '.join(GLASSES)})"
    assert read(write(surfaces=surfaces)).index_source.endswith("ohara:LAL11, normal line 1.717/48)")


def test_a_medium_without_a_name_has_its_printed_index_at_its_printed_wavelength(write):
    surfaces = 'over "S10"\n{\nuniform string plen:glass = ""\n}'

    assert indices(write(surfaces=surfaces))[-1] == pytest.approx(1.717, rel=1e-15)


def test_with_printed_indices_a_name_alone_is_for_people(write):
    surfaces = 'over "S8"\n{\nuniform string plen:glass = "LAK11"\n}'

    assert load(write(lens="", surfaces=surfaces), [ROOT]).problems == []
    assert [one.code for one in load(write(surfaces=surfaces), [ROOT]).problems] == ["unknown-glass"]


@pytest.fixture
def stage() -> Usd.Stage:
    """The tiny conventional dataset, of a lens whose surfaces take light."""
    opened = Usd.Stage.Open(str(TINY))
    opened.SetEditTarget(opened.GetSessionLayer())
    put(opened, LENS, transmission="surfaces")
    return opened


def put(stage: Usd.Stage, path: str, **values: object) -> None:
    """Set attributes of a prim by their names without the namespace."""
    for name, value in values.items():
        stage.GetPrimAtPath(path).GetAttribute(f"plen:{name}").Set(value)


def test_an_ideal_lens_takes_nothing_and_bare_clear_surfaces_have_no_tables(stage: Usd.Stage) -> None:
    losses = losses_at(stage.GetPrimAtPath(CAMERA), 550.0)
    assert losses is not None
    assert set(losses.coatings) == {None} and set(losses.per_mm) == {1.0}
    put(stage, LENS, transmission="ideal")
    assert losses_at(stage.GetPrimAtPath(CAMERA), 550.0) is None


def test_a_model_camera_has_no_surfaces_that_could_take_light(stage: Usd.Stage) -> None:
    """Its lens is ideal, whatever the prescription that it stands for says."""
    stage.GetPrimAtPath(CAMERA).GetAttribute("plen:camera:model").Set("thinLens")
    assert losses_at(stage.GetPrimAtPath(CAMERA), 550.0) is None


def test_tables_and_films_of_a_stage_are_those_of_the_surface_at_the_wavelength(stage: Usd.Stage) -> None:
    put(stage, f"{LENS}/S1", coatingWavelengths=[500, 600], coatingAngles=[0, 30])
    put(stage, f"{LENS}/S1", coatingReflectance=[0.01, 0.03, 0.02, 0.06])
    put(stage, f"{LENS}/S2", coatingFilmIndices=[2.1, 1.38], coatingFilmThicknesses=[130, 100])
    found = read_losses(stage.GetPrimAtPath(CAMERA), 550.0).coatings
    table, films = found[0], found[1]
    assert table is not None and table.angles_deg == (0.0, 30.0)
    assert table.reflectance == pytest.approx((0.02, 0.04))
    assert films == Coating(films=(Film(index=2.1, waves=130 / 550), Film(index=1.38, waves=100 / 550)))
    assert set(found[2:]) == {None}


def test_internal_transmittance_is_that_of_the_stated_thickness(stage: Usd.Stage) -> None:
    """Half of the light in 25 mm; between two entries the logarithm is linear."""
    put(stage, f"{LENS}/S1", internalTransmittance=0.5, internalTransmittanceThickness=25)
    put(stage, f"{LENS}/S3", internalTransmittanceTable=[0.5, 0.8], internalTransmittanceWavelengths=[500, 600])
    per_mm = read_losses(stage.GetPrimAtPath(CAMERA), 550.0).per_mm
    assert per_mm[0] ** 25 == pytest.approx(0.5)
    assert per_mm[2] ** 10 == pytest.approx(math.sqrt(0.5 * 0.8))


def test_the_catalogue_gives_what_a_surface_does_not_write(stage: Usd.Stage) -> None:
    camera = stage.GetPrimAtPath(CAMERA)
    put(stage, LENS, transmittanceSource="catalogue")
    with pytest.raises(GlassError, match="ohara:LAL11"):
        read_losses(camera, 400.0)
    put(stage, f"{LENS}/S8", internalTransmittance=0.9)
    per_mm, glass = read_losses(camera, 400.0).per_mm, measured(find("schott:SF15"))
    assert glass is not None
    assert per_mm[3] == glass.share_per_mm(400.0) < 1
    assert per_mm[7] ** 10 == pytest.approx(0.9)
    assert per_mm[1] == per_mm[5] == 1  # air


def test_a_table_has_to_cover_every_channel(stage: Usd.Stage) -> None:
    """The red channel sees what lies beyond the tables, and the warning and the error name those wavelengths."""
    sensor = stage.GetPrimAtPath("/TinyConventional/Rig/Sensor")
    for name, low in (("green", 500), ("red", 600)):
        channel = stage.DefinePrim(sensor.GetPath().AppendChild(name), "PlenChannel")
        put(stage, str(channel.GetPath()), wavelengths=[low, low + 80], response=[1, 1], nodes=2)
    put(stage, f"{LENS}/S1", coatingWavelengths=[480, 610], coatingReflectance=[0.01, 0.03])
    put(stage, f"{LENS}/S3", internalTransmittanceTable=[0.5, 0.8], internalTransmittanceWavelengths=[480, 610])
    camera = stage.GetPrimAtPath(CAMERA)
    camera.GetAttribute("plen:image:exposure").Set("radiance")
    seen = light_wavelengths_nm(camera)
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
