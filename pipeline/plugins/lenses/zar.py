"""Archives of Zemax (`.zar`): a lens, glass catalogues and more, one behind the other, or in a zip.

The layout is unpublished; this follows zmxtools (T. Vettenburg), from archives that Thorlabs distributes.
"""

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from pipeline.optics.printed import PrintedLens
from pipeline.plugins.lenses.agf import read_agf
from pipeline.plugins.lenses.glasses import Glasses
from pipeline.plugins.lenses.text import UnreadableLens
from pipeline.plugins.lenses.zemax import read_zemax

_HEADERS = {0xEA: (0x14C, "<I", 0x0C, 0x20, "latin-1"), 0xEC: (0x288, "<Q", 0x10, 0x30, "utf-16-le")}
"""By first byte: header length, format and offset of its member's length, offset and encoding of the name."""
_MOST_BYTES = 16 * 2**20
"""Largest lens that is read: one of a thousand surfaces has 1 MiB, and a file of 20 kB can be packed to hold 16."""


def read_zar(path: str | Path, glasses: Glasses) -> PrintedLens:
    """The lens of an archive, whose catalogues are used where no other has a glass."""
    lenses = list[tuple[str, bytes]]()
    try:
        for name, raw in _members(Path(path)):
            if name.lower().endswith(".agf"):
                with suppress(UnreadableLens):
                    glasses.packed |= read_agf(f"{path}/{_printable(name)}", raw)
            elif len(lenses) < 2:
                lenses.append((name, raw))
    except (OSError, EOFError, IndexError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise UnreadableLens(path, f"cannot be read as an archive of Zemax: {reason}") from None
    if len(lenses) != 1 or len(lenses[0][1]) >= _MOST_BYTES:
        content = "several lenses" if lenses[1:] else "a lens of 16 MiB and more" if lenses else "no lens (.zmx)"
        raise UnreadableLens(path, f"holds {content}", hint="unpack it, and import one of its files")
    ((name, raw),) = lenses
    return read_zemax(f"{path}/{_printable(name)}", glasses, raw)


def _printable(name: str) -> str:
    return "".join(filter(str.isprintable, name))


def _members(path: Path) -> Iterator[tuple[str, bytes]]:
    """Names and contents of lenses and catalogues, cut off at the largest size; an error if the archive is damaged."""
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            for name in (name for name in archive.namelist() if name.lower().endswith((".zmx", ".agf"))):
                yield name, archive.open(name).read(_MOST_BYTES)
        return
    size = path.stat().st_size
    with path.open("rb") as stream:
        while first := stream.read(1):
            if first[0] not in _HEADERS:
                raise EOFError("a header begins with no version")
            length, layout, size_at, name_at, encoding = _HEADERS[first[0]]
            header = first + stream.read(length - 1)
            if (
                len(header) < length
                or stream.tell() + (packed := struct.unpack_from(layout, header, size_at)[0]) > size
            ):
                raise EOFError("it is cut off")
            name = header[name_at:].decode(encoding, "replace").partition("\0")[0]
            behind = stream.tell() + packed
            if name.lower().removesuffix(".lzw").endswith((".zmx", ".agf")):
                raw = stream.read(min(packed, _MOST_BYTES))
                yield (name[:-4], _unpacked(raw)) if name.lower().endswith(".lzw") else (name, raw)
            stream.seek(behind)


def _unpacked(packed: bytes) -> bytes:
    """LZW decompression (Welch, Computer 17(6) (1984) 8): codes from 9 bits up, highest bit first, without a limit."""
    words = [bytes([value]) for value in range(256)]
    unpacked = bytearray()
    previous = b""
    width = 8  # of the next code [bit]
    bits = 0  # read, and not yet part of a code
    count = 0  # of these
    for byte in packed:
        width += len(words) >= 1 << width
        bits = bits << 8 | byte
        count = count + 8
        if count >= width:
            count -= width
            code = bits >> count
            bits &= (1 << count) - 1
            # A code one beyond the table is the previous word with its first byte behind it.
            word = words[code] if code < len(words) else words[code - 1] and previous + previous[:1]
            words += [previous + word[:1]] * bool(previous)
            unpacked += word
            previous = word
        if len(unpacked) >= _MOST_BYTES:
            break
    return bytes(unpacked[:_MOST_BYTES])
