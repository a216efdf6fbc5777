"""CRC-32 of two concatenated pieces, computed from those of both.

A CRC is the remainder of a polynomial over GF(2). Bytes behind a piece multiply its polynomial by a power of x; numbers
here have the coefficient of x^31 in their lowest bit, as zlib counts.
"""

_POLYNOMIAL, _ONE, _BYTE = 0xEDB88320, 1 << 31, 1 << 23
"""x^32 less its remainder; x^0; x^8."""


def joined(first: int, second: int, second_bytes: int) -> int:
    """CRC-32 of two pieces together.

    Parameters
    ----------
    first, second : int
        `zlib.crc32` of each piece alone.
    second_bytes : int
        Length of the second piece.
    """
    shift, power = _ONE, _BYTE
    while second_bytes:
        if second_bytes & 1:
            shift = _product(shift, power)
        power, second_bytes = _product(power, power), second_bytes >> 1
    return _product(first, shift) ^ second


def _product(a: int, b: int) -> int:
    """Product of two remainders."""
    result = 0
    for bit in range(31, -1, -1):
        if a >> bit & 1:
            result ^= b
        b = (b >> 1) ^ (_POLYNOMIAL if b & 1 else 0)
    return result
