"""Files beside a hostile stage that a picture may name: one that can be read, and what else may lie there."""

import os
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
from PIL import Image

PICTURES = ("picture.png", "fifo.png", "device.png", "outside.png", "folder.png", "text.png", "empty.exr", "vast.png")
PICTURES += ("negative.exr", "nan.exr", "inf.exr", "flipped.exr", "grey.exr", "wrong.exr", "other.tif")


def lay_pictures(folder: Path) -> None:
    """Make all of them in a folder, unless they are there."""
    if (folder / "picture.png").exists():
        return
    pixels = np.linspace(0, 255, 4 * 4 * 3).reshape(4, 4, 3).astype(np.uint8)
    Image.fromarray(pixels).save(folder / "picture.png")
    os.mkfifo(folder / "fifo.png")
    (folder / "device.png").symlink_to("/dev/zero")
    (folder / "outside.png").symlink_to("/etc/passwd")
    (folder / "folder.png").mkdir()
    (folder / "text.png").write_text("no picture")
    (folder / "empty.exr").touch()
    (folder / "other.tif").touch()
    header = b"IHDR" + struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)
    chunk = struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    (folder / "vast.png").write_bytes(b"\x89PNG\r\n\x1a\n" + chunk + bytes(16))
    for name, odd in (("grey", 0.5), ("negative", -1.0), ("nan", np.nan), ("inf", np.inf)):
        light = np.full((4, 8), 0.5, np.float32)
        light[1, 1] = odd
        _write_exr(folder / f"{name}.exr", {"Y" if name == "grey" else "RGB": light})
    _write_exr(folder / "wrong.exr", {"depth": light})
    flipped = bytearray((folder / "grey.exr").read_bytes())
    flipped[flipped.index(b"dataWindow") + 26] ^= 0x40
    (folder / "flipped.exr").write_bytes(flipped)


def _write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    whole = {name: np.stack([one] * 3, axis=2) if name == "RGB" else one for name, one in channels.items()}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, whole).write(str(path))
