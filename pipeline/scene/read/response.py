"""Response of a sensor and light of its frames, for raw images."""

from pxr import Usd

from pipeline.channel_names import colour_of
from pipeline.render.sensor.colorimetry import DAYLIGHT, Colorimetry, colorimetry
from pipeline.render.sensor.demosaic import PRIMARIES
from pipeline.render.sensor.irradiation import ChannelRadiance, Irradiation, Radiance
from pipeline.render.sensor.response import SensorResponse
from pipeline.scene.read.channels import channel_prims, effective_nm, illuminant_of, response_of, wavelengths_of
from pipeline.scene.read.losses import losses_at
from pipeline.scene.usd.values import need, read, target

_NUMBERS = {
    "quantum_efficiency": "quantumEfficiency",
    "full_well_e": "fullWell",
    "gain_dn_per_e": "gain",
    "bit_depth": "bitDepth",
    "black_level_dn": "blackLevel",
    "filters": "filters",
    "shot_noise": "shotNoise",
    "dark_noise_e": "darkNoise",
    "row_noise_e": "rowNoise",
    "column_noise_e": "columnNoise",
    "dark_current_e_per_s": "darkCurrent",
    "dsnu_e": "dsnu",
    "dsnu_row_e": "dsnuRow",
    "dsnu_column_e": "dsnuColumn",
    "prnu": "prnu",
    "prnu_row": "prnuRow",
    "prnu_column": "prnuColumn",
    "hot_share": "hotShare",
    "dead_share": "deadShare",
    "nonlinearity": "nonlinearity",
    "crosstalk": "crosstalk",
    "specimen": "specimen",
}
"""Attributes of PlenSensorResponseAPI, without their namespace, by the fields of `SensorResponse`."""
_MAY_LACK = {
    "temperature_degc": "temperature",
    "dark_current_at_degc": "darkCurrentTemperature",
    "doubling_k": "doublingTemperature",
}


def has_response(sensor: Usd.Prim) -> bool:
    """Whether a PlenSensor says how it turns photons into digital numbers."""
    return bool(sensor.HasAPI("PlenSensorResponseAPI"))


def read_response(sensor: Usd.Prim) -> SensorResponse:
    """A PlenSensor with PlenSensorResponseAPI."""
    values = {field: need(sensor, f"plen:response:{name}") for field, name in _NUMBERS.items()}
    values |= {field: read(sensor, f"plen:response:{name}") for field, name in _MAY_LACK.items()}
    return SensorResponse(hot_current_e_per_s=read(sensor, "plen:response:hotCurrent") or 0.0, **values)


def read_irradiation(camera: Usd.Prim) -> Irradiation | None:
    """The light of each frame of a camera; None where it asks for no raw images."""
    if need(camera, "plen:image:exposure") == "none":
        return None
    by_radiance = need(camera, "plen:image:exposure") == "radiance"
    channels = channel_prims(target(camera, "plen:camera:sensor", "PlenSensor")) if by_radiance else []
    return Irradiation(
        exposure_time_s=need(camera, "plen:image:exposureTime"),
        white_level=read(camera, "plen:image:whiteLevel"),
        photon_rate=read(camera, "plen:image:photonRate"),
        radiance=_read_radiance(camera) if by_radiance and not channels else None,
        channels=tuple(_read_channel_radiance(camera, prim) for prim in channels),
    )


def read_colorimetry(sensor: Usd.Prim, illuminant: str) -> tuple[Colorimetry, ...]:
    """The channels red, green and blue of a PlenSensor beside the standard observer, in this light and in daylight."""
    channels = {colour_of(prim.GetName()): prim for prim in channel_prims(sensor)}
    if not set(PRIMARIES) <= channels.keys():
        return ()
    responses = [response_of(channels[colour]) for colour in PRIMARIES]
    seen = [colorimetry(responses, light) for light in dict.fromkeys((illuminant, DAYLIGHT))]
    return tuple(one for one in seen if one and seen[0])


def _read_radiance(camera: Usd.Prim) -> Radiance:
    """The light before the lens of a camera of one wavelength that is exposed by it."""
    wavelength_nm = need(camera, "plen:camera:wavelength")
    losses = losses_at(camera, wavelength_nm)
    return Radiance(w_per_m2_sr=need(camera, "plen:image:radiance"), wavelength_nm=wavelength_nm, losses=losses)


def _read_channel_radiance(camera: Usd.Prim, channel: Usd.Prim) -> ChannelRadiance:
    """The same as a channel counts it."""
    illuminant = illuminant_of(camera)
    wavelengths_nm, _ = wavelengths_of(channel, illuminant)
    return ChannelRadiance(
        channel=channel.GetName(),
        w_per_m2_sr=need(camera, "plen:image:radiance"),
        effective_nm=effective_nm(channel, illuminant),
        losses=tuple(losses_at(camera, float(nm)) for nm in wavelengths_nm),
    )
