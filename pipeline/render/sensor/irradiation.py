"""Irradiation: how many photons hit a pixel where the linear image says 1."""

from dataclasses import dataclass

from pipeline.records.declared import settle
from pipeline.render.sensor.errors import SensorError
from pipeline.render.sensor.response import SensorResponse


@dataclass(frozen=True, slots=True, kw_only=True)
class Irradiation:
    """Exposure of a frame, either by its result or by its photons.

    Attributes
    ----------
    exposure_time_s : float
        For how long light and dark current are collected [s].
    white_level : float or None
        Share of saturation that the light of relative irradiance 1 fills, in the channel of the highest quantum
        efficiency, without dark signal.
    photon_rate : float or None
        Photons that hit a pixel in a second at relative irradiance 1 [1/s].
    """

    exposure_time_s: float
    white_level: float | None = None
    photon_rate: float | None = None

    def __post_init__(self) -> None:
        settle(self, SensorError)
        if (self.white_level is None) == (self.photon_rate is None):
            raise SensorError("an exposure has a white level or a photon rate, one of the two")
        if self.exposure_time_s < 0 or (self.white_level or 0.0) < 0 or (self.photon_rate or 0.0) < 0:
            raise SensorError("an exposure with a negative time, level or rate")

    def photons_at_one(self, response: SensorResponse) -> float:
        """Mean number of photons in a pixel at relative irradiance 1."""
        if self.photon_rate is not None:
            return self.photon_rate * self.exposure_time_s
        assert self.white_level is not None
        return self.white_level * response.saturation_e / max(response.quantum_efficiency)
