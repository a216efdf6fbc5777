"""Canonical bytes of plain values, and the keys made from them.

Every value is a tag, the length of its payload and the payload, so no two different values share their bytes.
A type without a rule raises: a key must never fall back to pickle, repr() or str().
"""

import hashlib
import math
import re
import struct
from typing import Any

DIGEST = re.compile(r"[0-9a-f]{64}")
"""What a key or the name of a blob looks like; paths in the store are built from nothing else."""


def key_of(domain: str, value: Any) -> str:
    """Hex key of a plain value. The domain keeps keys of different purposes apart."""
    return hashlib.sha256(_item(b"D", domain.encode()) + canonical(value)).hexdigest()


def canonical(value: Any) -> bytes:
    """Bytes of None, bool, int, float, str, list, tuple and dict.

    Floats count by their exact bits; infinity is a value (a plane has an infinite radius), NaN is not.

    Raises
    ------
    ValueError
        For NaN.
    TypeError
        For any other type, NumPy scalars among them, and for dicts with keys that are not strings.
    """
    # Exact types: True is an int to isinstance(), and a NumPy float64 is a float.
    kind = type(value)
    if value is None:
        return _item(b"n")
    if kind is bool:
        return _item(b"b", b"1" if value else b"0")
    if kind is int:
        return _item(b"i", str(value).encode())
    if kind is float:
        if math.isnan(value):
            raise ValueError("a key cannot be made from NaN")
        return _item(b"d", struct.pack(">d", value))
    if kind is str:
        return _item(b"s", value.encode())
    if kind in (list, tuple):
        return _item(b"l", b"".join(map(canonical, value)))
    if kind is dict:
        if not all(type(name) is str for name in value):
            raise TypeError("a key can only be made from dicts whose keys are strings")
        return _item(b"m", b"".join(canonical(name) + canonical(value[name]) for name in sorted(value)))
    raise TypeError(f"a key cannot be made from {kind.__name__}")


def plain(value: Any) -> Any:
    """The same value as JSON gives it back: tuples become lists; what has no canonical bytes raises.

    Tasks get their parameters in this form on every engine, whether they crossed a process border or not.
    """
    if isinstance(value, dict):
        if not all(type(name) is str for name in value):
            raise TypeError("parameters can only be dicts whose keys are strings")
        return {name: plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    canonical(value)
    return value


def _item(tag: bytes, payload: bytes = b"") -> bytes:
    return tag + str(len(payload)).encode() + b":" + payload
