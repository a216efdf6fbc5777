"""Absorption of glass: Beer and Lambert's law, tables for a thickness, and the table that ships."""

import math

import numpy as np
import pytest
from tolerances import BISECTED

from pipeline.optics.glass.absorption import measured, stated
from pipeline.optics.glass.catalogue import find
from pipeline.optics.glass.medium import GlassError, OutOfRange
from pipeline.optics.glass.row import medium
from pipeline.optics.prescription import Prescription, Surface
from pipeline.optics.table import towards_sensor
from pipeline.optics.transmission import Coating, Losses, transmitted

NM, TAU = (400.0, 500.0, 600.0), (0.6, 0.9, 0.98)


def test_a_glass_stated_for_twice_the_thickness_is_the_same_at_every_wavelength() -> None:
    """Twice the way squares what is left (Beer and Lambert), between the entries of the table, too."""
    thin, thick = stated(NM, TAU, 10.0), stated(NM, tuple(tau**2 for tau in TAU), 20.0)
    for nm in np.linspace(400, 600, 41):
        assert thick.share_per_mm(nm) == pytest.approx(thin.share_per_mm(nm), rel=BISECTED)
    for nm, tau in zip(NM, TAU, strict=True):
        assert thin.share_per_mm(nm) ** 10 == pytest.approx(tau, rel=BISECTED)


def test_between_two_entries_is_their_geometric_mean() -> None:
    assert stated(NM, TAU, 10.0).share_per_mm(450.0) ** 10 == pytest.approx(math.sqrt(0.6 * 0.9), rel=BISECTED)


@pytest.mark.parametrize("nm", [399.9, 600.1])
def test_nothing_is_known_beyond_a_table(nm: float) -> None:
    with pytest.raises(OutOfRange, match="known from 400 to 600 nm, not at"):
        stated(NM, TAU, 10.0).share_per_mm(nm)


@pytest.mark.parametrize(
    ("table", "code"),
    [
        (((400.0,), (0.9, 0.9)), "internal-transmittance"),
        (((), ()), "internal-transmittance"),
        (((500.0, 400.0), (0.9, 0.9)), "glass-wavelengths"),
        (((400.0,), (1.1,)), "internal-transmittance"),
        (((400.0,), (0.0,)), "internal-transmittance"),
    ],
)
def test_what_no_glass_has_is_refused(table: tuple[tuple[float, ...], tuple[float, ...]], code: str) -> None:
    with pytest.raises(GlassError) as refused:
        stated(*table, 10.0)
    assert refused.value.code == code


@pytest.mark.parametrize("angle_deg", [0.0, 40.0])
def test_a_ray_loses_by_its_own_way_through_the_glass(angle_deg: float) -> None:
    """A plate: thickness over the cosine of the angle in it."""
    index, tau = 1.6, stated(NM, TAU, 25.0).share_per_mm(450.0)
    glass = Surface(thickness_mm=12.0, semi_diameter_mm=50.0, index=index)
    lens = Prescription(surfaces=(glass, Surface(semi_diameter_mm=50.0, is_stop=True)))
    sine = math.sin(math.radians(angle_deg))
    way = np.array([[sine, 0.0, math.sqrt(1 - sine**2)]])
    losses = Losses(coatings=(Coating(reflectance=(0.0,)),) * 2, per_mm=(tau, 1.0))
    found = transmitted(towards_sensor(lens), np.array([[0.0, 0.0, -20.0]]), way, losses)
    length_mm = 12.0 / math.sqrt(1 - (sine / index) ** 2)
    assert found[0] == pytest.approx((0.6 * 0.9) ** (0.5 * length_mm / 25.0), rel=BISECTED)


def test_air_absorbs_nothing_and_what_the_table_lacks_is_refused() -> None:
    assert measured(medium(glass="", index=1.0, abbe=None, wavelength_nm=587.56)) is None
    for unknown in (
        find("ohara:LAL11"),
        medium(glass="constant(1.5)", index=None, abbe=None, wavelength_nm=587.56),
        medium(glass="", index=1.5168, abbe=64.2, wavelength_nm=587.56),
    ):
        with pytest.raises(GlassError) as refused:
            measured(unknown)
        assert unknown.label in refused.value.what and "plen:internalTransmittance" in (refused.value.hint or "")
