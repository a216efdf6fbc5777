"""Archives of Zemax (`.zar`): the lens with the glass catalogues that it needs, one member behind the other.

Each has a header with its length and its name; a name that ends in .LZW is packed. Nobody has published the layout: it is
that which zmxtools (T. Vettenburg) found, and that of archives which Thorlabs distributes.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from pipeline.files.lenses.text import UnreadableLens

_HEADERS = {0xEA: ("<12xI16x", 0x14C, "latin-1"), 0xEC: ("<16xQ24x", 0x288, "utf-16-le")}
"""By the first byte, which tells the version: where a header has the member's length, and behind it the name; its own
length in bytes; the encoding of the name.
"""
_MOST_BYTES = 64 * 2**20
"""Largest unpacked member: a lens of a thousand surfaces has 1 MiB, a maker's catalogue 2; packed, 64 KiB may hold 2 GiB."""


def members(path: str | Path, endings: tuple[str, ...]) -> Iterator[tuple[str, bytes]]:
    """Names and contents of the members with these endings; UnreadableLens if the archive is damaged."""
    with Path(path).open("rb") as stream:
        for name, size in _headers(path, stream):
            plain = name.removesuffix(".LZW").removesuffix(".lzw")
            if not plain.lower().endswith(endings):
                stream.seek(size, 1)
            else:
                raw = stream.read(min(size, _MOST_BYTES + 1))
                yield plain, raw if plain == name else _unpacked(path, plain, raw)


def _headers(path: str | Path, stream: BinaryIO) -> Iterator[tuple[str, int]]:
    length = Path(path).stat().st_size
    while first := stream.read(1):
        layout, own, encoding = _HEADERS.get(first[0], ("", 0, ""))
        header = first + stream.read(max(own - 1, 0))
        if not layout or len(header) < own:
            raise UnreadableLens(path, "is no archive of Zemax, or is damaged", hint="let OpticStudio open and save it")
        (size,) = struct.unpack_from(layout, header)
        name = header[struct.calcsize(layout) :].decode(encoding, "replace").partition("\0")[0]
        if size > length - stream.tell():
            raise UnreadableLens(path, f"is cut off within {name!r}")
        yield name, size


def _unpacked(path: str | Path, name: str, packed: bytes) -> bytes:
    """Welch's algorithm: codes of 9 bits and more, the first bit first; the table grows without end."""
    words = [bytes([value]) for value in range(256)]
    unpacked, before, width, bits, count = bytearray(), b"", 8, 0, 0
    for byte in packed:
        width += len(words) >= 1 << width
        bits, count = bits << 8 | byte, count + 8
        if count < width:
            continue
        count -= width
        code, bits = bits >> count, bits & (1 << count) - 1
        if code > len(words) - (not before) or len(unpacked) > _MOST_BYTES:
            raise UnreadableLens(path, f"its member {name!r} is damaged or too large")
        word = words[code] if code < len(words) else before + before[:1]
        unpacked += word
        if before:
            words.append(before + word[:1])
        before = word
    return bytes(unpacked)
