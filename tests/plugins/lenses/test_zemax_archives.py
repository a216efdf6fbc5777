"""A lens in an archive of Zemax is the lens of its file, and no archive asks for more than it holds."""

import io
import tracemalloc
import zipfile
from functools import partial
from pathlib import Path

import pytest
from plugins.lenses import on_the_spot

from pipeline.app.stages import import_lens
from pipeline.plugins.lenses import zar
from pipeline.plugins.lenses.read import read_lens

read, refused = (partial(act, read_lens) for act in (on_the_spot.read, on_the_spot.refused))

SURFACES = (
    "SURF 0\n  DISZ INFINITY\nSURF 1\n  CURV 0.02\n  DISZ 4\n  GLAS N-BK7 0 0\n  DIAM 9 1\nSURF 2\n  STOP\n  DISZ 90\n"
)
ZMX = f"UNIT MM\nGCAT SCHOTT\n{SURFACES}  DIAM 5 1\nSURF 3\n  DISZ 0\n"
BAD = ZMX.replace("CURV 0.02", "CURV x")
HEADERS = {0xEA: (0x14C, 0x0C, 4, 0x20, "latin-1"), 0xEC: (0x288, 0x10, 8, 0x30, "utf-16-le")}


def welch(text: bytes) -> bytes:
    """Packed by Welch's algorithm as published (IEEE Computer 17, 6, 1984): the longest word that the table has."""
    table, bits = {bytes([value]): value for value in range(256)}, ""
    width, word = 9, b""
    for byte in text:
        if word + bytes([byte]) in table:
            word += bytes([byte])
            continue
        bits += f"{table[word]:0{width}b}"
        # He who unpacks knows the newest word one code later.
        width = max(9, len(table).bit_length())
        table[word + bytes([byte])] = len(table)
        word = bytes([byte])
    bits += f"{table[word]:0{width}b}"
    return int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")


def member(version: int, name: str, content: bytes, size: int | None = None) -> bytes:
    length, place, width, name_at, encoding = HEADERS[version]
    header = bytearray(length)
    header[:2] = bytes([version, 3])
    header[place : place + width] = (len(content) if size is None else size).to_bytes(width, "little")
    shown = name.encode(encoding)
    header[name_at : name_at + len(shown)] = shown
    return bytes(header) + content


def zipped(**texts: str) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in texts.items():
            archive.writestr(name.replace("_", "."), text)
    return stream.getvalue()


def archive(version: int, text: bytes) -> bytes:
    """As OpticStudio lays them out: the lens, catalogues and settings behind it."""
    others = member(version, "SCHOTT.AGF.LZW", welch(b"NM N-BK7" * 400)), member(version, "A.SES", b"\0" * 50)
    return member(version, "LENS.ZMX.LZW", welch(text)) + b"".join(others)


@pytest.mark.parametrize(
    "made",
    [
        archive(0xEA, ZMX.encode("latin-1")),
        archive(0xEC, ZMX.encode("utf-16") * 1 + "! a long remark about nothing \n".encode("utf-16-le") * 900),
        member(0xEC, "lens.zmx", ZMX.encode()),
        zipped(lens_zmx=ZMX, notes_txt="zmx"),
    ],
    ids=["older", "newer", "not packed", "zip"],
)
def test_the_lens_of_an_archive_is_that_of_its_file(made: bytes, tmp_path: Path) -> None:
    found, expected = read(tmp_path, "a.zar", made), read(tmp_path, "a.zmx", ZMX)
    assert found.surfaces == expected.surfaces
    assert found.provenance[0] == "Imported from a.zar, a Zemax archive."
    assert import_lens(tmp_path / "a.zar").text.count("def PlenSurface") == 2


def test_a_glass_that_nobody_knows_is_that_of_the_catalogue_in_the_archive(tmp_path: Path) -> None:
    """Coefficients of N-BK7 under another name: Schott's n_d of 1.5168; beside a known name they do not count."""
    agf = "NM {} 2 0 1.5168 64.17\nCD 1.03961212 6.00069867E-3 2.31792344E-1 2.00179144E-2 1.01046945 1.03560653E+2\n"
    lens = ZMX.replace("N-BK7", "OWN1").encode()
    made = member(0xEC, "a.zmx", lens) + member(0xEC, "MY.AGF.LZW", welch(agf.format("OWN1").encode()))
    assert read(tmp_path, "a.zar", made).surfaces[0].index == pytest.approx(1.5168, abs=5e-6)
    known = zipped(a_zmx=ZMX.replace("N-BK7", "F2"), b_agf=agf.format("F2"))
    assert read(tmp_path, "a.zar", known).surfaces[0].index == pytest.approx(1.62004, abs=5e-6)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (b"UNIT MM", "a.zar: cannot be read as an archive of Zemax"),
        (b"", "a.zar: holds no lens (.zmx)"),
        (archive(0xEC, ZMX.encode())[:700], "a.zar: cannot be read as an archive of Zemax: it is cut off"),
        (member(0xEC, "a.zmx", b"", size=2**64 - 1), "a.zar: cannot be read as an archive of Zemax: it is cut off"),
        (member(0xEA, "a.zmx.lzw", b"\xff" * 40), "a.zar: cannot be read as an archive of Zemax"),
        (member(0xEA, "a.zmx", ZMX.encode()) + member(0xEA, "b.ZMX", b""), "a.zar: holds several lenses"),
        (zipped(a_zmx="x" * 4000), "a.zar: holds a lens of 16 MiB and more"),
        (zipped(a_zmx=ZMX)[:-60] + zipped(a_zmx=ZMX)[-22:], "a.zar: cannot be read as an archive of Zemax"),
        (member(0xEA, "a.zmx.lzw", welch(b"\n" * 4000)), "a.zar: holds a lens of 16 MiB and more"),
        (member(0xEC, "../\x1b]0;x\x07.zmx", BAD.encode()), 'a.zar/../]0;x.zmx:6: CURV must be a number, not "x"'),
    ],
)
def test_a_spoilt_archive_is_refused(made: bytes, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zar, "_MOST_BYTES", 4000)
    assert refused(tmp_path, "a.zar", made).startswith(said)
    assert [path.name for path in tmp_path.iterdir()] == ["a.zar"]


def test_a_packed_lens_takes_no_more_memory_than_the_largest_that_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each code is the word that the one before it completes, so that 4 kB unpack to 4 MB."""
    codes = [10, *range(256, 3000)]
    bits = "".join(f"{code:0{max(9, (255 + place).bit_length())}b}" for place, code in enumerate(codes))
    packed = int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")
    assert zar._unpacked(packed) == b"\n" * sum(range(1, len(codes) + 1))
    monkeypatch.setattr(zar, "_MOST_BYTES", 4000)
    tracemalloc.start()
    assert zar._unpacked(packed) == b"\n" * 4000
    assert tracemalloc.get_traced_memory()[1] < 100_000
    tracemalloc.stop()
