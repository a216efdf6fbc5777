"""Decentred and tilted lenses of other programs stand where their manuals put them, by rays of a naive reader."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from naive import lens_files as naive
from plugins.lenses import on_the_spot
from tolerances import ROUND_TRIP_MM

from pipeline.app.stages import import_lens, write_stage
from pipeline.optics.printed import prescription_of
from pipeline.optics.rays import traced
from pipeline.optics.table import towards_sensor
from pipeline.plugins.lenses.read import read_lens

pytestmark = pytest.mark.filterwarnings("ignore:Optimal rotation")  # about an axis of symmetry, any is

read, refused = partial(on_the_spot.read, read_lens), on_the_spot.refused

GLASS = "  GLAS ___BLANK 1 0 1.6 50"


def zmx(*surfaces: str) -> str:
    """A Zemax file; each surface is its type, curvature, thickness and what else it has, in lines."""
    blocks = [f"SURF {i}\n  TYPE {words}" for i, words in enumerate(surfaces, 1)]
    return "UNIT MM\nSURF 0\n  DISZ INFINITY\n" + "\n".join(blocks) + f"\nSURF {len(surfaces) + 1}\n  DISZ 0\n"


def lens(curvature: float, thickness: float, *rest: str, kind: str = "STANDARD") -> str:
    return "\n".join([kind, f"  CURV {curvature}", f"  DISZ {thickness}", "  DIAM 9 1", *rest])


def broken(*values: float, thickness: float = 0.0) -> str:
    return "\n".join(["COORDBRK", f"  DISZ {thickness}", *(f"  PARM {i} {value}" for i, value in enumerate(values, 1))])


INDICES = 1.6240884719368396, 1.658042414517168, 1.4879392824909605, 1.0  # F2, KZFSN5, FK51
STOP = lens(0, 2, "  STOP")
TURN = (0.7, -0.4, 6.0, -9.0, 20.0)
BACK = tuple(-value for value in TURN)
ZEMAX = {
    "one surface": zmx(lens(0.02, 4, GLASS), broken(*TURN), lens(-0.01, 0), broken(*BACK, 1, thickness=5), STOP),
    "the other order": zmx(lens(0.02, 4, GLASS), broken(*TURN, 1), lens(-0.01, 0), broken(*BACK, thickness=5), STOP),
    "one break behind the other": zmx(
        STOP,
        broken(*TURN, thickness=3),
        lens(0.02, 4, GLASS),
        broken(-1.0, 0.2, 3.0, 1.0, thickness=1),
        lens(0.01, 4, "  GLAS ___BLANK 1 0 1.7 30"),
        broken(0.1, 0.3, -2.0, 4.0, 5.0, 1, thickness=-1),
        lens(-0.015, 40),
    ),
    "tilted planes": zmx(
        STOP,
        lens(0.02, 5, GLASS),
        lens(0, 5, "  GLAS ___BLANK 1 0 1.7 30", "  PARM 1 0.2", "  PARM 2 -0.3", kind="TILTSURF"),
        lens(0, 40, "  PARM 2 0.1", kind="TILTSURF"),
    ),
    # As OpticStudio's own tool does it: back to the vertex of the first surface, then along the axis.
    "a lens about its first vertex": zmx(
        STOP,
        broken(0, 0, 5, thickness=3),
        lens(0.02, 4, GLASS),
        lens(-0.01, -4),
        broken(0, 0, -5, 0, 0, 1, thickness=4),
        lens(0, 30),
    ),
}
SEQ = "RDM;LEN\nDIM M\nEPD 4\nWL 587.6\nYAN 0\nSO 0 1e14\n{}SI 0 0\nGO\n"
HEAD = "S 0 3\nSTO\nCIR 4\nS 50 4 1.6:50\nCIR 9\n"
CODEV = {
    "goes on": HEAD + "XDE 0.3;YDE -0.5;ZDE 0.2\nADE 6;BDE -4;CDE 20\nS -80 40\nCIR 9\n",
    "and returns": HEAD + "DAR\nYDE -0.5;ADE 6;BDE -4\nS -80 40\nCIR 9\n",
    "and is undone": HEAD
    + "YDE -0.5\nADE 6;CDE 9\nS -80 3 1.7:30\nCIR 9\nREV\nYDE -0.5\nADE 6\nCDE 9\nS 70 40\nCIR 9\n",
}


def stage(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    assert write_stage(import_lens(folder / name).text, folder / "lens.usda") == []
    return folder / "lens.usda"


@pytest.mark.parametrize("name", ZEMAX)
def test_breaks_of_zemax_are_those_of_its_manual(name: str, tmp_path: Path) -> None:
    rows, _ = naive.zemax(ZEMAX[name])
    indices = [float(row.glass[3]) if row.glass else 1.0 for row in rows]
    ours = on_the_spot.stage_prescription(stage(tmp_path, "a.zmx", ZEMAX[name]))
    assert not ours.is_centred and naive.is_displaced(rows)
    assert on_the_spot.apart_mm(rows, indices, ours) < ROUND_TRIP_MM


@pytest.mark.parametrize("name", CODEV)
def test_decentres_of_codev_are_those_of_its_manual(name: str, tmp_path: Path) -> None:
    text = SEQ.format(CODEV[name])
    rows = naive.codev(text, is_radius=True)
    indices = [float(row.glass[0].split(":")[0]) if row.glass else 1.0 for row in rows]
    ours = on_the_spot.stage_prescription(stage(tmp_path, "a.seq", text))
    assert on_the_spot.apart_mm(rows, indices, ours) < ROUND_TRIP_MM
    assert ours.surfaces[-1].tilt_deg == ours.surfaces[0].tilt_deg or name == "goes on"


def test_there_and_back_is_the_lens_that_never_was_turned(tmp_path: Path) -> None:
    front, rear = lens(0.02, 4, GLASS), lens(-0.01, 5)
    plain = read(tmp_path, "a.zmx", zmx(front, rear, STOP))
    assert read(tmp_path, "a.zmx", zmx(front, rear, broken(*TURN), broken(*BACK, 1), STOP)) == plain
    (rest,) = read(tmp_path, "a.zmx", zmx(broken(0, 3, 5), front, rear, STOP)).surfaces[:1]
    assert rest == plain.surfaces[0]  # the axis is that of the lens, not that before it
    text = SEQ.format(
        "S 50 4 1.6:50\nCIR 9\nS -100 5 1.7:30\nCIR 9\nADE 5;YDE 2\nS -90 0\nREV\nADE 5;YDE 2\nCIR 9\n"
        "S 0 2\nSTO\nCIR 9\n"
    )
    assert [surface.tilt_deg for surface in read(tmp_path, "a.seq", text).surfaces] == [(5, 0), (0, 0), (0, 0), (5, 0)]


def test_surfaces_that_bend_nothing_stand_in_nobodys_way(tmp_path: Path) -> None:
    """Light would go back to the last surface but one, and cross it."""
    text = zmx(lens(0.02, 4, GLASS), lens(-0.01, 6), lens(0, -3), STOP)
    found = read(tmp_path, "a.zmx", text)
    assert found.surfaces == read(tmp_path, "a.zmx", zmx(lens(0.02, 4, GLASS), lens(-0.01, 3), STOP)).surfaces
    assert found.lost[0].statement.startswith("surfaces that bend nothing")
    assert "thickness -3 mm leads back" in refused(
        import_lens, tmp_path, "a.zmx", text.replace("DISZ -3", "DISZ -3\n" + GLASS)
    )


def test_cylinders_of_zemax_are_toroids_without_a_second_radius(tmp_path: Path) -> None:
    cylinder = lens(0.02, 4, GLASS, "  PARM 1 0", kind="TOROIDAL")
    path = stage(tmp_path, "a.zmx", zmx(cylinder, lens(-0.01, 6), STOP))
    front, rear, _ = on_the_spot.stage_prescription(path).surfaces
    assert front.is_cylinder and not rear.is_cylinder and front.radius_mm == 50
    assert "of type TOROIDAL" in refused(
        read_lens, tmp_path, "a.zmx", zmx(cylinder.replace("PARM 1 0", "PARM 1 30"), STOP)
    )
    turned = zmx(lens(-0.01, 6), broken(0, 0, 0, 0, 90), cylinder, STOP)
    assert "a cylinder, turned about the axis by 90" in refused(read_lens, tmp_path, "a.zmx", turned)


def test_the_chief_ray_leaves_a_prism_where_opticstudio_found_it(tmp_path: Path) -> None:
    """Three prisms of a sample of OpticStudio: its solve has decentred and turned what follows onto the chief ray.

    Indices at its primary wavelength of 546 nm by the catalogue of that time.
    """
    angles = 4.278935018198, -11.24974636752, 11.24974636752, -7.422899840207
    blocks = [lens(0, 10)]
    for angle, index in zip(angles, INDICES, strict=True):
        glass = [f"  GLAS ___BLANK 1 0 {index} 50"] if index != 1 else []
        blocks += [broken(0, 0, angle), lens(0, 0, *glass), broken(0, 0, -angle, 0, 0, 1, thickness=4 if glass else 0)]
    blocks[2] += "\n  STOP"
    follow = broken(0, -2.248504444889e-1, 4.01395066795, thickness=20)
    found = prescription_of(read(tmp_path, "a.zmx", zmx(*blocks, follow)))
    start_mm = found.vertices_from_stop_mm[0] - 5
    ray = traced(towards_sensor(found), np.array([[0, 0, start_mm]]), np.array([[0, 0, 1.0]]))
    (_, y_mm, z_mm), (_, down, along) = ray.position[0], ray.direction[0]
    assert np.degrees(np.arctan2(-down, along)) == pytest.approx(4.01395066795, abs=1e-6)
    assert y_mm + (12 - z_mm) * down / along == pytest.approx(-2.248504444889e-1, abs=1e-6)
