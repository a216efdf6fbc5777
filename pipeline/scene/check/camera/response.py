"""A sensor whose response cannot be, and cameras that want raw images of a sensor without one."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.channel_names import COLOURS
from pipeline.errors import PipelineError
from pipeline.files.dng import nameless_filters
from pipeline.scene.check.camera.losses import check_losses
from pipeline.scene.read.channels import channel_prims
from pipeline.scene.read.response import has_response, read_response
from pipeline.scene.usd.problems import Problem, did_you_mean
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read

_FILTERS = "plen:response:filters"
MONO = "mono"
"""The channel of a sensor that has no channels."""


def check_response(sensor: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenSensor with PlenSensorResponseAPI whose values are right one by one."""
    try:
        read_response(sensor)
    except UnreadableValue as error:
        yield problem(error.thing, error.code, error.what)
    except PipelineError as error:
        yield problem(sensor, "sensor-response", error.what, hint=error.hint)
    else:
        yield from _check_filters(sensor)


def _check_filters(sensor: Usd.Prim) -> Iterator[Problem]:
    """Colour filters that let through what is no channel of the sensor."""
    channels = [prim.GetName() for prim in channel_prims(sensor)] or [MONO]
    for name in dict.fromkeys(read(sensor, _FILTERS) or ()):
        if name not in channels:
            message = f'there is a colour filter "{name}", and the sensor has no such channel'
            hint = did_you_mean(name, channels) or f"its channels: {', '.join(channels)}"
            yield problem(sensor.GetAttribute(_FILTERS), "colour-filters", message, hint=hint)


def check_exposure(camera: Usd.Prim, sensor: Usd.Prim) -> Iterator[Problem]:
    """A camera that asks for raw images, although its sensor does not say how it responds to light."""
    if read(camera, "plen:image:exposure") in ("level", "photons", "radiance") and not has_response(sensor):
        message = f"raw images need a sensor that responds to light, and <{sensor.GetPath()}> does not say how it does"
        hint = (
            "reference one of sensors/ in the library, or apply PlenSensorResponseAPI to it:"
            ' prepend apiSchemas = ["PlenSensorResponseAPI"]'
        )
        yield problem(camera.GetAttribute("plen:image:exposure"), "no-response", message, hint=hint)
    elif read(camera, "plen:image:exposure") != "none" and (odd := nameless_filters(read(sensor, _FILTERS) or ())):
        message = f"raw.dng tells filters by their colours, and {', '.join(odd)} names none"
        yield problem(sensor.GetAttribute(_FILTERS), "colour-filters", message, hint=f"call them {', '.join(COLOURS)}")
    if read(camera, "plen:image:exposure") == "radiance":
        yield from _check_radiance(camera)


def _check_radiance(camera: Usd.Prim) -> Iterator[Problem]:
    """An exposure by radiance of a camera for which it is not defined, or through a coating that is none."""
    exposure = camera.GetAttribute("plen:image:exposure")
    if read(camera, "plen:camera:weight") == "area":
        message = "radiance gives photons only where rays weigh irradiance, not area"
        yield problem(exposure, "radiance-of-area", message, hint='write plen:camera:weight = "irradiance"')
    yield from check_losses(camera)
