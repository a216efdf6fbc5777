"""Sealed files: small JSON files with a last line that holds the digest, so that damage is noticed."""

import hashlib
import json
from typing import Any

from pipeline.engine.records import as_json

_TRAILER = b"\n#sha256="


def seal(value: Any) -> bytes:
    """Plain data or records as sealed bytes, which `unseal` reads."""
    body = as_json(value)
    return body + _TRAILER + hashlib.sha256(body).hexdigest().encode() + b"\n"


def unseal(raw: bytes | None) -> Any:
    """The sealed content; None if a byte is missing or altered, or if it is not JSON that can be parsed safely."""
    body, _, tail = (raw or b"").rpartition(_TRAILER)
    if tail != hashlib.sha256(body).hexdigest().encode() + b"\n":
        return None
    return parse(body)


def parse(text: bytes | None) -> Any:
    """The value of a JSON text, or None if it is invalid or nested too deeply for the parser."""
    try:
        return json.loads(text or b"")
    except (ValueError, RecursionError):
        return None
