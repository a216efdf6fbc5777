"""Irradiation: how many photons hit a pixel where the linear image says 1."""

from dataclasses import dataclass

from pipeline.optics.transmission import Losses
from pipeline.records.declared import settle
from pipeline.render.sensor.response import SensorError, SensorResponse

PLANCK_J_S, LIGHT_M_PER_S = 6.62607015e-34, 299792458.0
"""Planck constant [J s] and speed of light [m/s]: exact, by definition of the SI (2019)."""


def _photons(energy_j: float, wavelength_nm: float) -> float:
    """Number of photons of an energy, at a wavelength."""
    return energy_j * wavelength_nm * 1e-9 / (PLANCK_J_S * LIGHT_M_PER_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Radiance:
    """Light before a lens, of one wavelength.

    `w_per_m2_sr`: radiance of what the linear image calls 1 [W m^-2 sr^-1].
    `losses`: None: the lens takes no light but what its apertures stop.
    """

    w_per_m2_sr: float
    wavelength_nm: float
    losses: Losses | None = None

    def __post_init__(self) -> None:
        settle(self, SensorError)
        if not (self.w_per_m2_sr > 0 and self.wavelength_nm > 0):
            raise SensorError(f"a radiance of {self.w_per_m2_sr} W m^-2 sr^-1 at {self.wavelength_nm} nm")

    @property
    def losses_of_each(self) -> tuple[Losses | None, ...]:
        """Losses at each wavelength of the light: there is one."""
        return (self.losses,)

    def photons(self, energy_j: float) -> float:
        """Number of photons of an energy [J]."""
        return _photons(energy_j, self.wavelength_nm)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelRadiance:
    """Light before a lens, as a channel of a sensor counts it.

    `w_per_m2_sr`: radiance of what the linear image calls 1, between 380 and 780 nm [W m^-2 sr^-1].
    `effective_nm`: wavelength of light of which a joule has as many photons as count in the channel for a joule of that
        radiance: each counts by the channel's response at its wavelength over the highest one [nm].
    `losses`: losses at each wavelength that stands for the channel.
    """

    channel: str
    w_per_m2_sr: float
    effective_nm: float
    losses: tuple[Losses | None, ...]

    def __post_init__(self) -> None:
        settle(self, SensorError)
        if not (self.w_per_m2_sr > 0 and self.effective_nm > 0):
            raise SensorError(f"a radiance of {self.w_per_m2_sr} W m^-2 sr^-1 that counts as {self.effective_nm} nm")

    @property
    def losses_of_each(self) -> tuple[Losses | None, ...]:
        """Losses at each wavelength of the light."""
        return self.losses

    def photons(self, energy_j: float) -> float:
        """Number of photons of an energy [J] that count in the channel."""
        return _photons(energy_j, self.effective_nm)


@dataclass(frozen=True, slots=True, kw_only=True)
class Irradiation:
    """Exposure of a frame: by its result, by its photons, or by the radiance of the scene.

    `exposure_time_s`: for how long light and dark current are collected [s].
    `white_level`: share of saturation that the light of relative irradiance 1 fills, in the channel of the highest
        quantum efficiency, without dark signal.
    `photon_rate`: photons that hit a pixel in a second at relative irradiance 1 [1/s].
    `radiance`: radiance that has the relative irradiance 1; the camera then determines the photon rate.
    `channels`: the same for a sensor with channels, one for each.
    """

    exposure_time_s: float
    white_level: float | None = None
    photon_rate: float | None = None
    radiance: Radiance | None = None
    channels: tuple[ChannelRadiance, ...] = ()

    def __post_init__(self) -> None:
        settle(self, SensorError)
        if [self.white_level, self.photon_rate, self.radiance, self.channels or None].count(None) != 3:
            raise SensorError(
                "the exposure is stated in no way, or in several",
                hint="give one of white_level, photon_rate, radiance and channels",
            )
        for name in ("exposure_time_s", "white_level", "photon_rate"):
            if (getattr(self, name) or 0.0) < 0:
                raise SensorError(f"an exposure with the negative {name} {getattr(self, name)}")

    def photons_at_one(self, response: SensorResponse, rate: float | None = None) -> float:
        """Mean number of photons in a pixel at relative irradiance 1.

        `rate` is that of `render.radiometry.photon_rate`, of a channel if there are any, where the exposure is one by
        radiance.
        """
        if self.radiance is not None or self.channels:
            if rate is None:
                raise SensorError("an exposure by radiance needs the photon rate of a camera")
            return rate * self.exposure_time_s
        if self.photon_rate is not None:
            return self.photon_rate * self.exposure_time_s
        assert self.white_level is not None
        return self.white_level * response.saturation_e / max(response.quantum_efficiency)
