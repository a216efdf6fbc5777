"""Colour channels of a sensor: whether they stand below one, have a spectrum, and what a lens knows of their light."""

from collections.abc import Iterator

from pxr import Usd

from pipeline.channel_names import colour_of
from pipeline.optics.glass.errors import GlassError
from pipeline.render.spectral.nodes import SpectrumError
from pipeline.scene.read.channels import channel_prims, illuminant_of, read_channel, wavelengths_of
from pipeline.scene.read.media import knows_one_wavelength
from pipeline.scene.usd.problems import Problem
from pipeline.scene.usd.source_locations import problem
from pipeline.scene.usd.values import UnreadableValue, read, target


def check_illuminant(root: Usd.Prim) -> Iterator[Problem]:
    """A PlenDataset whose illuminant nobody knows."""
    name = read(root, "plen:illuminant")
    if name in (None, "E"):
        return
    from pipeline.render.spectral.spectra import illuminant  # colour-science takes half a second to import

    try:
        illuminant(name)
    except SpectrumError as error:
        yield problem(root.GetAttribute("plen:illuminant"), error.code, error.what, hint=error.hint)


def check_channel(channel: Usd.Prim) -> Iterator[Problem]:
    """Problems of a PlenChannel alone."""
    if not channel.GetParent().IsA("PlenSensor"):
        message = "a PlenChannel stands directly below its PlenSensor, and this one does not"
        yield problem(channel, "misplaced-channel", message, hint="channels are the colours of their sensor")
        return
    yield from _check_name(channel)
    table, name = read(channel, "plen:wavelengths"), read(channel, "plen:sensitivity")
    response = read(channel, "plen:response")
    if table is None or response is None or name is None:
        return  # values that are wrong by themselves
    if bool(table) == bool(name):
        both = "says its response by a table and by a name" if name else "has no response"
        hint = 'either "plen:wavelengths" and "plen:response", or "plen:sensitivity" and "plen:component"'
        yield problem(channel, "channel-response", f"the channel {both}", hint=hint)
    elif len(table) != len(response):
        message = f"{len(table)} wavelengths have {len(response)} values"
        yield problem(channel.GetAttribute("plen:response"), "channel-response", message, hint="one value for each")
    else:
        yield from _check_spectrum(channel)


def _check_name(channel: Usd.Prim) -> Iterator[Problem]:
    """A channel that an earlier one of its sensor leaves no name: files are named by channels, and by their colours."""
    prims = channel_prims(channel.GetParent())
    named = [colour_of(prim.GetName()) or prim.GetName().casefold() for prim in prims]
    place = prims.index(channel) if channel in prims else 0
    if named[place] in named[:place]:
        message = f'two channels of a sensor share the name "{named[place]}"'
        yield problem(channel, "name-collision", message, hint="rename one of the prims")


def _check_spectrum(channel: Usd.Prim) -> Iterator[Problem]:
    try:
        wavelengths_of(channel, illuminant_of(channel))
    except SpectrumError as error:
        if error.code == "unknown-illuminant":
            return  # reported where the dataset is checked
        named = "plen:sensitivity" if read(channel, "plen:sensitivity") else "plen:wavelengths"
        yield problem(channel.GetAttribute(named), error.code, error.what, hint=error.hint)
    except UnreadableValue:
        return  # reported where the value is checked


def check_channels(camera: Usd.Prim, lens: Usd.Prim) -> Iterator[Problem]:
    """The channels of a camera against what its lens and its microlenses know of their light."""
    sensor = target(camera, "plen:camera:sensor", "PlenSensor")
    if not sensor or not channel_prims(sensor):
        return
    try:
        is_printed = knows_one_wavelength(lens)
    except UnreadableValue:
        return  # reported where the value is checked
    if is_printed:
        message = "the indices of the lens are printed for one wavelength, and the sensor has channels"
        hint = 'plen:indexSource = "catalogue" on the lens computes them for any wavelength'
        yield problem(camera, "printed-wavelength", message, hint=hint)
        return
    array = target(camera, "plen:camera:microlenses", "PlenMicrolensArray")
    if array and read(array, "plen:model") != "thin" and not read(array, "plen:glass"):
        message = "the microlenses have the same index at all wavelengths, and the sensor has channels"
        hint = "plen:glass on the array says what they are made of"
        yield problem(array, "printed-wavelength", message, hint=hint, severity="warning")
    for prim in channel_prims(sensor):
        try:
            read_channel(camera, prim, illuminant_of(camera))
        except GlassError as error:
            hint = "narrow the response of the channel, or choose glasses that are known at all of its wavelengths"
            yield problem(prim, error.code, error.what, hint=hint)
        except (SpectrumError, UnreadableValue):
            continue  # reported where the channel is checked
