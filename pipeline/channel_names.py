"""One name for a camera and a channel of its sensor, as in `Rig.Camera@red`."""

_AT = "@"


def name_with(camera: str, channel: str | None) -> str:
    """Name of a channel of a camera; that of the camera itself where it has no channels."""
    return camera if channel is None else f"{camera}{_AT}{channel}"


def body_and_channel(name: str) -> tuple[str, str]:
    """Name of the camera, and that of the channel: empty for a camera without channels."""
    body, _, channel = name.partition(_AT)
    return body, channel


def folder_of(name: str) -> str:
    """Path below `cameras` or a frame where the files of a camera or a channel stand."""
    return name.replace(_AT, "/")
