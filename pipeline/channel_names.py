"""One name for a camera and a channel of its sensor, as in `Rig.Camera@red`, and for a state of one that changes, as in
`Rig.Camera.0001`.
"""

import re

_AT = "@"
_STATE = re.compile(rf"\.-?\d+(?=$|{_AT})")
COLOURS = ("red", "green", "blue", "cyan", "magenta", "yellow", "white")
"""Colours by the numbers that TIFF/EP gives to filters."""


def colour_of(channel: str) -> str | None:
    """The colour that the name of a channel states, as `Red`, `red` and `R` do; None: it states none."""
    name = channel.casefold()
    return next((colour for colour in COLOURS if name in (colour, colour[0])), None)


def name_with(camera: str, channel: str | None) -> str:
    """Name of a channel of a camera; that of the camera itself where it has no channels."""
    return camera if channel is None else f"{camera}{_AT}{channel}"


def name_in_state(camera: str, first_frame: int) -> str:
    """Name of a camera in the state of its lens and sensor that a frame is the first to have."""
    return f"{camera}.{first_frame:04d}"  # no prim has such a name


def without_state(name: str) -> str:
    """Name of a camera, or of a channel, in all of its states."""
    return _STATE.sub("", name)


def body_and_channel(name: str) -> tuple[str, str]:
    """Name of the camera, and that of the channel: empty for a camera without channels."""
    body, _, channel = name.partition(_AT)
    return body, channel


def folder_of(name: str) -> str:
    """Path below `cameras` or a frame where the files of a camera or a channel stand."""
    return name.replace(_AT, "/")
