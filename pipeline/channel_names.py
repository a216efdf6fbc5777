"""Names that join a camera with a channel of its sensor, as in `Rig.Camera@red`, or with one of its states, as in
`Rig.Camera.0001`.
"""

import re

_AT = "@"
_STATE = re.compile(rf"\.-?\d+(?=$|{_AT})")
COLOURS = ("red", "green", "blue", "cyan", "magenta", "yellow", "white")
"""Colours in the numbering that TIFF/EP gives to filters."""


def colour_of(channel: str) -> str | None:
    """The colour in the name of a channel: `Red`, `red` and `R` are red; None if the name states no colour."""
    name = channel.casefold()
    return next((colour for colour in COLOURS if name in (colour, colour[0])), None)


def name_with(camera: str, channel: str | None) -> str:
    """Name of a channel of a camera, or of the camera where it has no channels."""
    return camera if channel is None else f"{camera}{_AT}{channel}"


def name_in_state(camera: str, first_frame: int) -> str:
    """Name of a camera in the state of lens and sensor that first occurs in a frame."""
    return f"{camera}.{first_frame:04d}"  # no prim has such a name


def without_state(name: str) -> str:
    """Name of a camera, or of a channel, without its state."""
    return _STATE.sub("", name)


def body_and_channel(name: str) -> tuple[str, str]:
    """Names of the camera and of the channel, empty for a camera without channels."""
    body, _, channel = name.partition(_AT)
    return body, channel


def folder_of(name: str) -> str:
    """Path of a camera's or channel's folder below `cameras` or a frame."""
    return name.replace(_AT, "/")
