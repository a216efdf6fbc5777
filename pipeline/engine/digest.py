"""Canonical bytes of plain values, and the keys made from them.

Every value is a tag, the length of its payload and the payload, so no two different values share their bytes. A type
without a rule raises: a key must never fall back to pickle, repr() or str().
"""

import functools
import hashlib
import math
import re
import struct
from collections.abc import Callable, Mapping
from typing import Any

from pipeline.records.plain import Shared

DIGEST = re.compile(r"[0-9a-f]{64}")
"""Pattern of keys and of blob names; paths in the store are built from nothing else."""


def key_of(domain: str, value: Any) -> str:
    """Hex key of a plain value. The domain keeps keys of different purposes apart."""
    return key_of_bytes(domain, canonical(value))


def key_of_bytes(domain: str, value: bytes) -> str:
    """`key_of` for a value whose canonical bytes are at hand."""
    return hashlib.sha256(_item(b"D", domain.encode()) + value).hexdigest()


def canonical(value: Any) -> bytes:
    """Canonical bytes of a value: None, bool, int, float, str, list, dict or `Shared`.

    Floats are encoded by their exact bits. Infinity is valid (a plane has an infinite radius), NaN is a ValueError. Any
    other type is a TypeError: NumPy's numbers, dicts whose keys are not strings, and tuples, because another process
    would receive them as lists.
    """
    return _BYTES[type(value)](value)


def canonical_dict(items: Mapping[str, bytes]) -> bytes:
    """Bytes of a dict from the canonical bytes of its values."""
    return _item(b"m", b"".join([_name(name) + items[name] for name in sorted(items)]))


def _item(tag: bytes, payload: bytes = b"") -> bytes:
    """A value with its tag and length."""
    return b"%b%d:%b" % (tag, len(payload), payload)


@functools.lru_cache(maxsize=4096)
def _name(name: str) -> bytes:
    """Canonical bytes of a string: dicts of many tasks have the same names."""
    return _item(b"s", name.encode())


class _ByType(dict[type, Callable[[Any], Any]]):
    """Encoders by exact type: isinstance() takes True for an int and a NumPy float64 for a float."""

    def __missing__(self, kind: type) -> Any:
        raise TypeError(f"a key cannot be made from {kind.__name__}")


_bits = struct.Struct(">d").pack


def _float(value: float) -> bytes:
    if value != value:
        raise ValueError("a key cannot be made from NaN")
    return b"d8:" + _bits(value)


def _list(values: list[Any]) -> bytes:
    if {*map(type, values)} == {float} and not math.isnan(sum(values)):  # rows of numbers, of which none is NaN
        return _item(b"l", b"".join([b"d8:" + _bits(value) for value in values]))
    return _item(b"l", b"".join([_BYTES[type(value)](value) for value in values]))


def _dict(values: Mapping[str, Any]) -> bytes:
    for name in values:
        if type(name) is not str:
            raise TypeError("a key can only be made from dicts whose keys are strings")
    return canonical_dict({name: _BYTES[type(value)](value) for name, value in values.items()})


_BYTES = _ByType(
    {
        type(None): lambda value: b"n0:",
        bool: lambda value: b"b1:1" if value else b"b1:0",
        int: lambda value: _item(b"i", b"%d" % value),
        float: _float,
        str: lambda value: _item(b"s", value.encode()),
        list: _list,
        dict: _dict,
        Shared: lambda value: value.once(_dict),
    }
)
