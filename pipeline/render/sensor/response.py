"""Response of a sensor to light, by the parameters of EMVA 1288, release 4.0, linear model; and its exposure."""

import math
from dataclasses import dataclass
from typing import Annotated

from pipeline.errors import PipelineError
from pipeline.optics.transmission import Losses
from pipeline.records.declared import settle


class SensorError(PipelineError):
    """An impossible sensor, or light that it cannot record."""


_SUM_OF_KERNEL = 1e-6
"""Largest difference of the sum of a crosstalk kernel from 1 [1]: tables are printed with six decimals."""
PLANCK_J_S, LIGHT_M_PER_S = 6.62607015e-34, 299792458.0
"""Planck constant [J s] and speed of light [m/s]: exact, by definition of the SI (2019)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PatternSpread:
    """Part of a `SensorResponse` that makes the fixed pattern of a specimen."""

    # standard deviations over pixels, rows and columns: DSNU and PRNU
    dark_e: tuple[float, float, float]
    response: tuple[float, float, float]
    hot_share: float
    hot_current_e_per_s: float
    dead_share: float
    specimen: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorResponse:
    """Parameters of a sensor as an EMVA 1288 report states them; an effect whose parameter is missing is off.

    Fields are annotated with their attributes in a stage.

    `dsnu_e`, `prnu` and those of rows and columns: standard deviations of the dark signal, and of the photo response
        relative to its mean, constant over frames.

    Source: EMVA Standard 1288, Standard for Characterization of Image Sensors and Cameras, Release 4.0 Linear, 2021.
    """

    # electrons per photon, one for each channel
    quantum_efficiency: Annotated[tuple[float, ...], "plen:response:quantumEfficiency"]
    full_well_e: Annotated[float, "plen:response:fullWell"]  # electrons that a pixel holds at most
    gain_dn_per_e: Annotated[float, "plen:response:gain"]  # overall system gain K
    bit_depth: Annotated[int, "plen:response:bitDepth"]
    black_level_dn: Annotated[float, "plen:response:blackLevel"] = 0.0
    # colour filter array: names of channels of n x n pixels, row by row from the top-left pixel, repeated over the
    # sensor. The channels are these names in the order in which they first occur
    filters: Annotated[tuple[str, ...], "plen:response:filters"] = ("mono",)
    # whether electrons are counted (Poisson), or arrive as their expected number
    shot_noise: Annotated[bool, "plen:response:shotNoise"] = True
    # temporal dark noise sigma_d0 without that of the dark current
    dark_noise_e: Annotated[float, "plen:response:darkNoise"] = 0.0
    # temporal noise that all pixels of a row or column share, new in each frame
    row_noise_e: Annotated[float, "plen:response:rowNoise"] = 0.0
    column_noise_e: Annotated[float, "plen:response:columnNoise"] = 0.0
    dark_current_e_per_s: Annotated[float, "plen:response:darkCurrent"] = 0.0
    # all or none: temperature of the sensor, the one at which the dark current is as said, and the difference that
    # doubles it
    temperature_degc: Annotated[float | None, "plen:response:temperature"] = None
    dark_current_at_degc: Annotated[float | None, "plen:response:darkCurrentTemperature"] = None
    doubling_k: Annotated[float | None, "plen:response:doublingTemperature"] = None
    dsnu_e: Annotated[float, "plen:response:dsnu"] = 0.0
    dsnu_row_e: Annotated[float, "plen:response:dsnuRow"] = 0.0
    dsnu_column_e: Annotated[float, "plen:response:dsnuColumn"] = 0.0
    prnu: Annotated[float, "plen:response:prnu"] = 0.0
    prnu_row: Annotated[float, "plen:response:prnuRow"] = 0.0
    prnu_column: Annotated[float, "plen:response:prnuColumn"] = 0.0
    # share of the pixels with a further dark current, exponentially distributed with this mean
    hot_share: Annotated[float, "plen:response:hotShare"] = 0.0
    hot_current_e_per_s: float = 0.0
    dead_share: Annotated[float, "plen:response:deadShare"] = 0.0  # share of the pixels that no light reaches
    # deviation from the straight line, relative to the signal, at shares of the full well in ascending order; linear in
    # between, constant beyond
    nonlinearity: Annotated[tuple[tuple[float, float], ...], "plen:response:nonlinearity"] = ()
    # kernel of n x n entries, n odd, row by row: the share of the electrons of a pixel that are collected by each of
    # its neighbours, itself in the middle. Empty: none is lost
    crosstalk: Annotated[tuple[float, ...], "plen:response:crosstalk"] = ()
    # number of its fixed pattern: one of all sensors that were made alike
    specimen: Annotated[int, "plen:response:specimen"] = 0

    def __post_init__(self) -> None:
        settle(self, SensorError)
        self._settle_charge()
        self._settle_filters()
        self._settle_tables()

    def _settle_charge(self) -> None:
        _require(self.black_level_dn < self.most_dn, f"a black level of {self.black_level_dn} of {self.most_dn} DN")
        temperatures = self.temperature_degc, self.dark_current_at_degc, self.doubling_k
        _require(len({value is None for value in temperatures}) == 1, "some but not all temperatures of a dark current")

    def _settle_filters(self) -> None:
        filters = len(self.filters)
        channels = len(self.channels)
        efficiencies = len(self.quantum_efficiency)
        _require(_is_square(filters), f"{filters} colour filters, which fill no square of n x n")
        message = f"{efficiencies} quantum efficiencies for {channels} channel{'s' * (channels > 1)}"
        _require(efficiencies == channels, message, f"one for each of: {', '.join(self.channels)}")

    def _settle_tables(self) -> None:
        shares = [share for share, _ in self.nonlinearity]
        ascending = shares == sorted(set(shares)) and all(0 <= share <= 1 for share in shares)
        message = f"a non-linearity at the shares {shares}, which do not ascend from 0 to 1"
        _require(ascending, message, "each pair is a share of the full well and the deviation there")
        if self.crosstalk:
            size = len(self.crosstalk)
            total = math.fsum(self.crosstalk)
            _require(size % 2 == 1 and _is_square(size), f"a crosstalk kernel of {size} entries, not n x n, n odd")
            message = f"a crosstalk kernel whose sum is {total:.9g}, not 1"
            _require(abs(total - 1) <= _SUM_OF_KERNEL, message, "divide its entries by their sum")

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels, in the order in which the filters name them."""
        return tuple(dict.fromkeys(self.filters))

    @property
    def spread(self) -> PatternSpread:
        """Spread of the fixed pattern."""
        return PatternSpread(
            dark_e=(self.dsnu_e, self.dsnu_row_e, self.dsnu_column_e),
            response=(self.prnu, self.prnu_row, self.prnu_column),
            hot_share=self.hot_share,
            hot_current_e_per_s=self.hot_current_e_per_s,
            dead_share=self.dead_share,
            specimen=self.specimen,
        )

    @property
    def period_px(self) -> int:
        """Edge of the repeating square of filters."""
        return math.isqrt(len(self.filters))

    @property
    def margin_px(self) -> int:
        """Width of the border around a window from which crosstalk enters it."""
        return math.isqrt(len(self.crosstalk)) // 2 if self.crosstalk else 0

    @property
    def most_dn(self) -> int:
        """Largest digital number."""
        return 2**self.bit_depth - 1

    @property
    def saturation_e(self) -> float:
        """Charge at which the digital number stops growing: the full well, or the largest number [e-]."""
        return min(self.full_well_e, (self.most_dn - self.black_level_dn) / self.gain_dn_per_e)

    @property
    def white_dn(self) -> int:
        """Noise-free digital number at saturation."""
        return min(self.most_dn, math.floor(self.black_level_dn + self.gain_dn_per_e * self.full_well_e + 0.5))

    def dark_current(self) -> float:
        """Mean dark current at the temperature of the sensor [e-/s]."""
        if self.temperature_degc is None or self.dark_current_at_degc is None or self.doubling_k is None:
            return self.dark_current_e_per_s
        return self.dark_current_e_per_s * 2.0 ** (
            (self.temperature_degc - self.dark_current_at_degc) / self.doubling_k
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Radiance:
    """Light before a lens, of one wavelength, or as a channel of a sensor weighs it."""

    w_per_m2_sr: float  # radiance of what the linear image calls 1 [W m^-2 sr^-1]; for a channel between 380 and 780 nm
    # the wavelength; for a channel that of light of which a joule has as many photons as count in the channel for a
    # joule of that radiance: each counts by the channel's response at its wavelength over the highest
    effective_nm: float
    # at each wavelength that stands for the light; None: the lens takes no light but what its apertures stop
    losses: tuple[Losses | None, ...] = (None,)
    channel: str | None = None

    def __post_init__(self) -> None:
        settle(self, SensorError)

    def photons(self, energy_j: float) -> float:
        """Number of photons in an energy [J] that count."""
        return energy_j * self.effective_nm * 1e-9 / (PLANCK_J_S * LIGHT_M_PER_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class Irradiation:
    """Exposure of a frame: by its result, by its photons, or by the radiance of the scene."""

    # for how long light and dark current are collected [s]
    exposure_time_s: Annotated[float, "plen:image:exposureTime"]
    # share of saturation that the light of relative irradiance 1 fills, in the channel of the highest quantum
    # efficiency, without dark signal
    white_level: Annotated[float | None, "plen:image:whiteLevel"] = None
    # photons that hit a pixel in a second at relative irradiance 1 [1/s]
    photon_rate: Annotated[float | None, "plen:image:photonRate"] = None
    # radiance that has the relative irradiance 1; the camera then determines the photon rate
    radiance: Radiance | None = None
    channels: tuple[Radiance, ...] = ()  # the same for a sensor with channels, one for each

    def __post_init__(self) -> None:
        settle(self, SensorError)
        if [self.white_level, self.photon_rate, self.radiance, self.channels or None].count(None) != 3:
            raise SensorError(
                "the exposure is not stated, or stated more than once",
                hint="give one of white_level, photon_rate, radiance and channels",
            )

    def photons_at_one(self, response: SensorResponse, rate: float | None = None) -> float:
        """Mean number of photons in a pixel at relative irradiance 1.

        `rate` is that of `render.radiometry.photon_rate`, or of a channel if there are any, when the exposure is given
        by radiance.
        """
        if self.radiance is not None or self.channels:
            if rate is None:
                raise SensorError("an exposure by radiance needs the photon rate of a camera")
            return rate * self.exposure_time_s
        if self.photon_rate is not None:
            return self.photon_rate * self.exposure_time_s
        assert self.white_level is not None
        return self.white_level * response.saturation_e / max(response.quantum_efficiency)


def _require(is_true: bool, fault: str, hint: str | None = None) -> None:
    if not is_true:
        raise SensorError(fault, hint=hint)


def _is_square(count: int) -> bool:
    return count > 0 and math.isqrt(count) ** 2 == count
