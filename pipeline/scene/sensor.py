"""Readers and checks of sensors, their response, and the light of raw images."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.camera.parts.camera import Sensor
from pipeline.channel_names import COLOURS, colour_of
from pipeline.errors import PipelineError
from pipeline.files.tiff import nameless_filters
from pipeline.render.sensor.colours import DAYLIGHT, PRIMARIES, Colorimetry, colorimetry
from pipeline.render.sensor.response import Irradiation, Radiance, SensorResponse
from pipeline.scene.channels import channel_prims, effective_nm, illuminant_of, response_of, wavelengths_of
from pipeline.scene.losses import check_losses, losses_at
from pipeline.scene.usd.problems import Problem, problem
from pipeline.scene.usd.values import UnreadableValue, fields_of, need, read, target
from pipeline.spelling import did_you_mean

_FILTERS = "plen:response:filters"
MONO = "mono"
"""The channel of a sensor that has no channels."""


def read_sensor(prim: Usd.Prim) -> Sensor:
    """The record of a PlenSensor."""
    width_px, height_px = need(prim, "plen:resolution")
    offset_x_mm, offset_y_mm = need(prim, "plen:offset")
    return Sensor(
        width_px=width_px,
        height_px=height_px,
        offset_x_mm=offset_x_mm,
        offset_y_mm=offset_y_mm,
        **fields_of(prim, Sensor),
    )


def has_response(sensor: Usd.Prim) -> bool:
    """Whether a PlenSensor says how it turns photons into digital numbers."""
    return bool(sensor.HasAPI("PlenSensorResponseAPI"))


def read_response(sensor: Usd.Prim) -> SensorResponse:
    """A PlenSensor with PlenSensorResponseAPI."""
    hot = read(sensor, "plen:response:hotCurrent") or 0.0
    return SensorResponse(hot_current_e_per_s=hot, **fields_of(sensor, SensorResponse))


def read_irradiation(camera: Usd.Prim) -> Irradiation | None:
    """The light of each frame of a camera; None where it asks for no raw images."""
    if need(camera, "plen:image:exposure") == "none":
        return None
    is_radiance = need(camera, "plen:image:exposure") == "radiance"
    before_lens = read(camera, "plen:image:radiance")
    illuminant = illuminant_of(camera)
    light_nm = need(camera, "plen:camera:wavelength")
    channels = channel_prims(target(camera, "plen:camera:sensor", "PlenSensor")) if is_radiance else []
    radiance = None
    if is_radiance and not channels:
        radiance = Radiance(w_per_m2_sr=before_lens, effective_nm=light_nm, losses=(losses_at(camera, light_nm),))
    return Irradiation(
        **fields_of(camera, Irradiation),
        radiance=radiance,
        channels=tuple(
            Radiance(
                channel=channel.GetName(),
                w_per_m2_sr=before_lens,
                effective_nm=effective_nm(channel, illuminant),
                losses=tuple(losses_at(camera, float(nm)) for nm in wavelengths_of(channel, illuminant)[0]),
            )
            for channel in channels
        ),
    )


def read_colorimetry(sensor: Usd.Prim, illuminant: str) -> tuple[Colorimetry, ...]:
    """The channels red, green and blue of a PlenSensor beside the standard observer, in this light and in daylight."""
    channels = {colour_of(prim.GetName()): prim for prim in channel_prims(sensor)}
    if not set(PRIMARIES) <= channels.keys():
        return ()
    responses = [response_of(channels[colour]) for colour in PRIMARIES]
    in_lights = [colorimetry(responses, light) for light in dict.fromkeys((illuminant, DAYLIGHT))]
    return tuple(colours for colours in in_lights if colours and in_lights[0])


def check_sensor(sensor: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenSensor whose values are right one by one."""
    if not has_response(sensor):
        return
    try:
        read_response(sensor)
    except UnreadableValue as error:
        yield problem(error.thing, error.code, error.message)
    except PipelineError as error:
        yield problem(sensor, "sensor-response", error.message, hint=error.hint)
    else:
        channels = [prim.GetName() for prim in channel_prims(sensor)] or [MONO]
        for name in dict.fromkeys(name for name in need(sensor, _FILTERS) if name not in channels):
            message = f'there is a colour filter "{name}", and the sensor has no such channel'
            hint = did_you_mean(name, channels) or f"its channels: {', '.join(channels)}"
            yield problem(sensor.GetAttribute(_FILTERS), "colour-filters", message, hint=hint)


def check_exposure(camera: Usd.Prim, sensor: Usd.Prim) -> Iterator[Problem]:
    """Problems of raw images: a sensor without a response, filters without a colour, and weights without photons."""
    attribute = camera.GetAttribute("plen:image:exposure")
    exposure = read(camera, "plen:image:exposure")
    if exposure not in ("none", None) and not has_response(sensor):
        message = f"raw images need a sensor that responds to light, and <{sensor.GetPath()}> does not say how it does"
        hint = (
            "reference one of sensors/ in the library, or apply PlenSensorResponseAPI to it:"
            ' prepend apiSchemas = ["PlenSensorResponseAPI"]'
        )
        yield problem(attribute, "no-response", message, hint=hint)
    elif exposure != "none" and (nameless := nameless_filters(read(sensor, _FILTERS) or ())):
        message = f"raw.dng tells filters by their colours, and {', '.join(nameless)} names none"
        yield problem(sensor.GetAttribute(_FILTERS), "colour-filters", message, hint=f"call them {', '.join(COLOURS)}")
    if exposure == "radiance" and read(camera, "plen:camera:weight") == "area":
        message = "radiance gives photons only where rays weigh irradiance, not area"
        yield problem(attribute, "radiance-of-area", message, hint='write plen:camera:weight = "irradiance"')
    yield from check_losses(camera)
