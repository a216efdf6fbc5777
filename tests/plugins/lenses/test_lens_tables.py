"""Plain tables of a lens, as typed from a patent: every way to write one, sized apertures, and what is refused."""

import math

import numpy as np
import pytest
from plugins.lenses import on_the_spot
from plugins.lenses.on_the_spot import LENSES, before, stage_prescription

from pipeline.app.stages import import_lens, write_stage
from pipeline.errors import PipelineError
from pipeline.optics.first_order import first_order
from pipeline.optics.kernels import trace_rays
from pipeline.optics.table import towards_sensor
from pipeline.plugins.lenses.read import read_lens
from pipeline.plugins.lenses.table import NAMES

COOKE = stage_prescription(LENSES / "cooke_triplet_50mm.usda")
# Cooke triplet of Zemax's samples, as in stages/lenses/cooke_triplet_50mm.usda: published for 50 mm, f/5, 20 degrees.
TABLE = """# Cooke triplet, Zemax sample
# efl: 50
surface,radius,thickness,nd,vd
1,22.01359,3.25896,1.62041,60.33
2,-435.76044,6.00755,,
3,-22.21328,0.99997,1.62004,36.37
stop,20.29192,4.75041,,
5,79.6836,2.95208,1.62041,60.33
6,-18.39533,42.20778,,
"""
BEAM = {"f_number": 5.0, "half_field_deg": 20.0}


def read(tmp_path, text, name="lens.csv", **beam):
    return on_the_spot.read(read_lens, tmp_path, name, text, **beam)


def refused(tmp_path, text, name="lens.csv", **beam):
    return on_the_spot.refused(read_lens, tmp_path, name, text, **beam)


def shapes(lens):
    return [(s.radius_mm, s.thickness_mm, s.index, s.is_stop) for s in lens.surfaces]


def test_a_patent_table_without_semi_diameters_gives_its_focal_length_and_f_number(tmp_path):
    (tmp_path / "lens.csv").write_text(TABLE)
    imported = import_lens(tmp_path / "lens.csv", **BEAM)
    assert write_stage(imported.text, tmp_path / "lens.usda") == []
    assert "semi-diameter" in imported.warnings[0] and "half field 20" in imported.warnings[0]
    lens = stage_prescription(tmp_path / "lens.usda")
    figures = first_order(lens)
    assert figures.efl_mm == pytest.approx(50.0, rel=1e-3)
    assert figures.efl_mm / figures.entrance_pupil.diameter_mm == pytest.approx(5.0, rel=1e-12)
    for one, other in zip(lens.surfaces, COOKE.surfaces, strict=True):
        assert (one.radius_mm, one.index, one.is_stop) == (other.radius_mm, other.index, other.is_stop)
        assert one.thickness_mm == other.thickness_mm or one is lens.surfaces[-1]


@pytest.mark.parametrize(("field_deg", "part"), [(0.0, 0.95), (10.0, 0.95), (20.0, 0.8)])
def test_rays_up_to_the_edge_of_the_field_pass_as_sized_and_few_far_beyond(tmp_path, field_deg, part):
    """Sized to first order: at 20 degrees real rays through the outermost fifth of the pupil may go astray."""
    (tmp_path / "lens.csv").write_text(TABLE)
    write_stage(import_lens(tmp_path / "lens.csv", **BEAM).text, tmp_path / "lens.usda")
    lens = stage_prescription(tmp_path / "lens.usda")
    assert passing(lens, field_deg, part) == 1.0
    assert passing(lens, 30.0, part) < 0.5


def passing(lens, field_deg, part):
    """Share of the rays through a part of the entrance pupil, of an object at infinity, that pass the lens."""
    pupil = first_order(lens).entrance_pupil
    radius, turn = np.meshgrid(np.linspace(0, part * pupil.diameter_mm / 2, 9), np.linspace(0, 2 * math.pi, 24))
    across = [(radius * np.cos(turn)).ravel(), (radius * np.sin(turn)).ravel()]
    slope = math.tan(math.radians(field_deg))
    direction = np.tile(np.array([0.0, slope, 1.0]) / math.hypot(1, slope), (radius.size, 1))
    position = before(lens, np.column_stack(across), direction)
    alive = np.ones(radius.size)
    trace_rays(towards_sensor(lens), position, direction, alive)
    return alive.mean()


@pytest.mark.parametrize(
    "header",
    [
        "Surface;R [mm];t (mm);n;V",
        "surf\tradius_mm\tThickness\tIndex\tAbbe number",
        '"no","ROC","d","n_d","v-no"',
        "type  r  d  nd  vd",
    ],
)
def test_names_and_delimiters_do_not_matter(tmp_path, header):
    mark = next((mark for mark in "\t;," if mark in header), " ")
    rows = [row.replace(",,", ",-,-" if mark == " " else ",,") for row in TABLE.splitlines()[3:]]
    text = "\n".join([header, *(row.replace(",", mark) for row in rows)])
    found = read(tmp_path, text, "lens.txt", **BEAM)
    assert shapes(found) == shapes(read(tmp_path, TABLE, **BEAM))
    assert found.lost[0].statement.startswith("surfaces 1, 2")


def test_planes_stops_glasses_and_aspheres_are_understood(tmp_path):
    text = """# unit: cm
# name: Test
# wavelength: 546.07
surface,radius,thickness,glass,diameter,conic,A4,stop
object,inf,inf,,,,,
1,5,0.3,N-BK7,2,-1,1e-3,
2,plane,0.1,air,2,,,
3,,0.2,,1,,,x
4,Infinity,0.3,,2,,,
image,,,,,,,
"""
    lens = read(tmp_path, text)
    first, second, stop, last = lens.surfaces
    assert (first.radius_mm, first.thickness_mm, first.semi_diameter_mm, first.conic) == (50.0, 3.0, 10.0, -1.0)
    assert dict(first.asphere) == {4: pytest.approx(1e-6)}  # 1e-3 / cm^3
    assert first.index == pytest.approx(1.51872, abs=1e-5)  # n_e, as Schott's data sheet has it
    assert first.abbe == pytest.approx(64.17, abs=0.01)
    assert math.isinf(second.radius_mm) and second.index == 1
    assert stop.is_stop and stop.semi_diameter_mm == 5.0 and math.isinf(stop.radius_mm)
    assert last.thickness_mm == 3.0 and (lens.name, lens.wavelength_nm) == ("Test", 546.07)


def test_settings_in_comments_size_the_lens_and_options_stand_above_them(tmp_path):
    text = "# f-number: 8\n# half-field: 10\n" + TABLE
    inside = read(tmp_path, text)
    assert shapes(inside) == shapes(read(tmp_path, TABLE, f_number=8.0, half_field_deg=10.0))
    sizes = [surface.semi_diameter_mm for surface in inside.surfaces]
    larger = [surface.semi_diameter_mm for surface in read(tmp_path, text, f_number=5.0).surfaces]
    assert all(one < other for one, other in zip(sizes, larger, strict=True))


def test_printed_semi_diameters_stay(tmp_path):
    rows = [f"{row},{9 - i}" for i, row in enumerate(TABLE.splitlines()[3:])]
    lens = read(tmp_path, "\n".join(["surface,radius,thickness,nd,vd,sd", *rows]))
    assert [surface.semi_diameter_mm for surface in lens.surfaces] == [9, 8, 7, 6, 5, 4]


def test_a_table_of_the_blender_add_on_without_apertures_is_sized_too(tmp_path):
    rows = ["50;3;BK7;1.5168;64;", ";2;air;;;", ";2;air;;;", "-50;3;BK7;1.5168;64;", "60;0;air;;;"]
    text = "radius;thickness;material;index;v-no;sa\n" + "\n".join(rows)
    assert "--f-number N and --half-field DEGREES" in refused(tmp_path, text)
    assert all(surface.semi_diameter_mm for surface in read(tmp_path, text, **BEAM).surfaces)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("stop,", "4,", 'lens.csv: 0 rows are marked as the aperture stop, one must be\n    hint: write "stop"'),
        ("nd,vd", "nd,n", "lens.csv:3: two columns hold index"),
        ("22.01359", "22.0l", 'lens.csv:4: radius must be a number, not "22.0l"'),
        ("6.00755", "", "lens.csv:5: has no thickness\n    hint: only the last row"),
        ("# efl: 50", "# unit: parsec", 'lens.csv:2: unknown unit "parsec"\n    hint: known are mm, cm, in, inch'),
        ("# efl: 50", "#", "surfaces 1, 2, 3, 4, 5, 6 have no semi-diameter"),
    ],
)
def test_what_cannot_be_understood_is_refused_with_file_line_and_a_way_out(tmp_path, old, new, said):
    assert said in refused(tmp_path, TABLE.replace(old, new, 1))


def test_decimal_commas_between_semicolons_and_columns_of_no_known_name_are_named(tmp_path):
    text = TABLE.replace(",", ";").replace("22.01359", "22,01359")
    assert 'radius must be a number, not "22,01359"\n    hint: write decimals with a point' in refused(tmp_path, text)
    lens = read(tmp_path, TABLE.replace("vd", "vdd"), **BEAM)
    assert lens.lost[0].statement.startswith('column "vdd" is not known') and lens.lost[0].line == 3
    (tmp_path / "lens.zmx").write_text("")
    assert "are for tables" in refused(tmp_path, "", "lens.zmx", f_number=4.0)


def test_the_table_of_the_documentation_is_read_and_every_name_stands_there(tmp_path):
    page = (LENSES.parents[1] / "docs/lenses.md").read_text(encoding="utf-8")
    lens = read(tmp_path, page.split("```")[1].strip())
    assert shapes(lens)[:-1] == shapes(read(tmp_path, TABLE, **BEAM))[:-1]
    rows = {cells[1].strip(): cells[2] for line in page.splitlines() if len(cells := line.split("|")) == 5}
    for quantity, names in NAMES.items():
        assert [name.strip() for name in rows[quantity].split(",")] == list(names)


def test_a_table_without_surfaces_is_led_to_a_thin_lens(tmp_path):
    (tmp_path / "lens.csv").write_text("efl,fno\n12,2\n", encoding="utf-8")
    with pytest.raises(PipelineError, match="new rig --focal-length"):
        import_lens(tmp_path / "lens.csv")
