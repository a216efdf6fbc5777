"""Parameters of the task `picture`."""

from dataclasses import dataclass

PICTURE = "picture.npy"


def source_name(suffix: str) -> str:
    """Name of the unchanged picture among the products of its task."""
    return f"source{suffix}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A picture file: its kind by the end of its name, its bytes in base 64, and its colour space."""

    suffix: str
    encoded: str
    space: str
