"""A lens with indices of a catalogue: what is read, at which wavelength, and what the tables say of it."""

from pathlib import Path

import pytest

from pipeline.optics.glass.catalogue import find
from pipeline.scene.load import load, open_dataset

ROOT = Path(__file__).resolve().parents[2]
GLASSES = ["hikari:BAF10", "hikari:BAF10", "schott:SF15", "schott:F5", "ohara:LAL11", "hoya:LAF3"]
IN_GLASS = (0, 2, 3, 6, 7, 9)


@pytest.fixture
def write(tmp_path):
    """Write a dataset with the conventional rig and overrides of its lens and camera; gives its path."""

    def writer(lens='uniform token plen:indexSource = "catalogue"', camera="", surfaces=""):
        path = tmp_path / "dataset.usda"
        path.write_text(
            f"""#usda 1.0
(
    defaultPrim = "Dataset"
    endTimeCode = 2
    metersPerUnit = 0.001
    startTimeCode = 1
    timeCodesPerSecond = 24
    upAxis = "Y"
    subLayers = [@{ROOT.as_posix()}/tests/data/tiny_conventional/dataset.usda@]
)

over "TinyConventional"
{{
    over "Rig"
    {{
        over "Camera"
        {{
            {camera}
        }}
        over "Lens"
        {{
            {lens}
            {surfaces}
        }}
    }}
}}
""".replace('"Dataset"', '"TinyConventional"')
        )
        return path

    return writer


def read(path):
    """The only camera of a dataset."""
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
