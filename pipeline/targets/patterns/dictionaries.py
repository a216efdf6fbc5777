"""Tags by number, from the dictionaries of OpenCV. The only module that imports it."""

import functools

import numpy as np

from pipeline.targets.patterns.pattern import TargetError

DICTIONARIES = (
    *(f"{n}x{n}_{count}" for n in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "aruco_original",
    "aruco_mip_36h12",
    "apriltag_16h5",
    "apriltag_25h9",
    "apriltag_36h10",
    "apriltag_36h11",
)
"""Names as in stages; OpenCV calls them DICT_4X4_50, DICT_APRILTAG_36h11 and so on."""


@functools.cache
def _dictionary(name: str):  # type: ignore[no-untyped-def]
    import cv2

    # OpenCV writes 4X4_50 and APRILTAG_36h11.
    family, _, rest = name.rpartition("_") if name.startswith(("apriltag", "aruco_mip")) else ("", "", name.upper())
    official = f"DICT_{family.upper()}_{rest}" if family else f"DICT_{rest}"
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, official))


def size_of(name: str) -> tuple[int, int]:
    """Number of tags of a dictionary, and of bits along an edge."""
    if name not in DICTIONARIES:
        raise TargetError(f'no dictionary "{name}"', hint="one of: " + ", ".join(DICTIONARIES))
    dictionary = _dictionary(name)
    return len(dictionary.bytesList), dictionary.markerSize


def require_tags(name: str, first: int, count: int) -> None:
    """Refuse more tags than a dictionary has."""
    known, _ = size_of(name)
    if first < 0 or first + count > known:
        raise TargetError(
            f"the target needs tags {first} to {first + count - 1}, and {name} ends at {known - 1}",
            hint="take a larger dictionary, or fewer tags",
            code="too-few-tags",
        )


@functools.cache
def bits_of(name: str, number: int) -> np.ndarray:
    """Bits of a tag without its border, (n, n) uint8, 1 is white; rows from the top, as OpenCV draws it upright."""
    import cv2

    dictionary = _dictionary(name)
    return cv2.aruco.Dictionary.getBitsFromByteList(dictionary.bytesList[number : number + 1], dictionary.markerSize)
