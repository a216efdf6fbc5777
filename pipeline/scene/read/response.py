"""Response of a sensor and light of its frames, for raw images."""

from pxr import Usd

from pipeline.render.sensor.irradiation import Irradiation
from pipeline.render.sensor.response import SensorResponse
from pipeline.scene.usd.values import need, read

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
    return Irradiation(
        exposure_time_s=need(camera, "plen:image:exposureTime"),
        white_level=read(camera, "plen:image:whiteLevel"),
        photon_rate=read(camera, "plen:image:photonRate"),
    )
