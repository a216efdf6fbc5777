"""Cryptomatte: ids of names as OpenEXR channels hold them, and the attributes that readers look for.

Source: Friedman and Jones, "Fully automatic ID mattes with support for motion blur and transparency", SIGGRAPH 2015
posters; the specification 1.2.0 of https://github.com/Psyop/Cryptomatte. The hash is MurmurHash3_x86_32 by Austin
Appleby.
"""

import json

import numpy as np

_BITS = 0xFFFFFFFF
"""Mask of 32 bits."""


def murmur3(data: bytes) -> int:
    """MurmurHash3_x86_32 with the seed 0."""
    result = 0
    end = len(data) // 4 * 4
    for start in range(0, len(data), 4):
        block = int.from_bytes(data[start : start + 4], "little") * 0xCC9E2D51 & _BITS
        result ^= (block << 15 | block >> 17) * 0x1B873593 & _BITS
        if start < end:
            result = ((result << 13 | result >> 19) * 5 + 0xE6546B64) & _BITS
    result ^= len(data)
    result = (result ^ result >> 16) * 0x85EBCA6B & _BITS
    result = (result ^ result >> 13) * 0xC2B2AE35 & _BITS
    return result ^ result >> 16


def id_of(name: str) -> np.float32:
    """The id of a name as single precision: the bits of its hash, changed where they would be no normal number."""
    bits = murmur3(name.encode())
    if bits >> 23 & 255 in (0, 255):
        bits ^= 1 << 23
    return np.uint32(bits).view(np.float32)


def attributes_of(matte: str, names: list[str]) -> dict[str, str]:
    """Attributes of a part that holds a matte: its name, the hash and conversion, and all names with ids."""
    key = f"cryptomatte/{murmur3(matte.encode()) >> 4:07x}"
    manifest = {name: f"{int(id_of(name).view(np.uint32)):08x}" for name in sorted(set(names))}
    return {
        f"{key}/name": matte,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }
