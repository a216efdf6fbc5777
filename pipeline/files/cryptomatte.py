"""Cryptomatte: ids of names as OpenEXR channels hold them, and the attributes that readers look for.

Friedman and Jones, "Fully automatic ID mattes with support for motion blur and transparency", SIGGRAPH 2015 posters;
the specification 1.2.0 of https://github.com/Psyop/Cryptomatte. The hash is MurmurHash3_x86_32 by Austin Appleby.
"""

import json

import numpy as np

_MASK = 0xFFFFFFFF
"""Bits of a number that count: it has 32."""
_FIRST, _SECOND = 0xCC9E2D51, 0x1B873593
"""Factors of the hash for each block."""


def _turned(value: int, bits: int) -> int:
    """A number of 32 bits turned to the left."""
    return (value << bits | value >> 32 - bits) & _MASK


def murmur3(data: bytes, seed: int = 0) -> int:
    """MurmurHash3_x86_32."""
    result, end = seed, len(data) // 4 * 4
    for start in range(0, len(data), 4):
        block = int.from_bytes(data[start : start + 4], "little")
        result ^= _turned(block * _FIRST & _MASK, 15) * _SECOND & _MASK
        if start < end:
            result = (_turned(result, 13) * 5 + 0xE6546B64) & _MASK
    result ^= len(data)
    result = (result ^ result >> 16) * 0x85EBCA6B & _MASK
    result = (result ^ result >> 13) * 0xC2B2AE35 & _MASK
    return result ^ result >> 16


def id_of(name: str) -> np.float32:
    """The id of a name as single precision: the bits of its hash, changed where these were no ordinary number."""
    bits = murmur3(name.encode())
    if bits >> 23 & 255 in (0, 255):
        bits ^= 1 << 23
    return np.uint32(bits).view(np.float32)


def attributes_of(matte: str, names: list[str]) -> dict[str, str]:
    """Attributes of a part with the channels of a matte: its name, rules of conversion, and all names with ids."""
    key = f"cryptomatte/{murmur3(matte.encode()):08x}"[: len("cryptomatte/") + 7]
    manifest = {name: f"{int(id_of(name).view(np.uint32)):08x}" for name in sorted(set(names))}
    return {
        f"{key}/name": matte,
        f"{key}/hash": "MurmurHash3_32",
        f"{key}/conversion": "uint32_to_float32",
        f"{key}/manifest": json.dumps(manifest, ensure_ascii=False, separators=(",", ":")),
    }
