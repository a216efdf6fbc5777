"""Layers with a few bytes changed: flipped, cut, repeated, or replaced by what means something in a layer."""

import random
import zipfile
from pathlib import Path

from pxr import Sdf

TINY = Path(__file__).parents[1] / "data/tiny_conventional/dataset.usda"
TOKENS = [
    *(
        b"{",
        b"}",
        b"(",
        b")",
        b"[",
        b"]",
        b'"',
        b"'''",
        b'"""',
        b"@",
        b"@@@",
        b"<",
        b">",
        b"=",
        b",",
        b":",
        b";",
        b"\n",
    ),
    *(b"#", b"/*", b"*/", b"//", b"\\", b"\0", b"\xff", b"\x1b[31m", b"-", b"1e400", b"nan", b"9" * 30, b"1.2.3:"),
    *(
        b"def",
        b"over",
        b"class",
        b"variantSet ",
        b"timeSamples",
        b".connect",
        b"rel ",
        b"token[]",
        b"matrix4d",
        b"None",
    ),
    *(b"add ", b"delete ", b"reorder nameChildren = ", b"inherits = ", b"references = @./whole.usda@", b"subLayers"),
]
WORDS = [b"\xff" * 8, b"\0" * 8, b"\xff\xff\xff\x7f", b"\x01\0\0\0", b"\0\0\0\x80"]


def sources(folder: Path) -> dict[str, bytes]:
    """The tiny dataset as a text, as a binary layer, and as a package of both."""
    text = folder / "whole.usda"
    text.write_text(TINY.read_text().replace("../../../stages/", ""))
    binary = text.with_suffix(".usdc")
    Sdf.Layer.OpenAsAnonymous(str(text)).Export(str(binary))
    package = text.with_suffix(".usdz")
    with zipfile.ZipFile(package, "w") as archive:
        archive.write(text, "in.usda")
        archive.write(binary, "in.usdc")
    return {path.suffix: path.read_bytes() for path in (text, binary, package)}


def damaged(whole: bytes, seed: int) -> bytes:
    """A layer with one to sixteen changes."""
    dice, data = random.Random(seed), bytearray(whole)
    for _ in range(dice.choice([1, 1, 2, 4, 16])):
        at = dice.randrange(len(data) + 1)
        match dice.randrange(6):
            case 0 if at < len(data):
                data[at] ^= 1 << dice.randrange(8)
            case 1:
                del data[at : None if dice.random() < 0.3 else at + dice.randrange(1, 50)]
            case 2:
                data[at:at] = dice.choice(TOKENS)
            case 3:
                start = dice.randrange(len(data) + 1)
                data[at:at] = data[start : start + dice.randrange(200)]
            case 4 if at < len(data):
                data[at] = dice.randrange(256)
            case _:
                word = dice.choice(WORDS)
                data[at : at + len(word)] = word
    return bytes(data)
