"""Numbers as text, without rounding: how certificate files write them, and what they may look like.

A number is a JSON integer, or text: a double in hexadecimal ("0x1.8p+1"), a decimal or a fraction as the
user gave it ("-21.3", "1/3"), or a fraction of long integers in hexadecimal ("0x1f/0x3").
"""

from __future__ import annotations

import re
from contextlib import suppress
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import CertificateFileError

_LONG = 10**18
_SHORT_DECIMAL = 10**15
# The grammar of numbers, as on the page certificate_format and in the checker.
_DOUBLE = re.compile(r"(-?0x[0-9a-f]{1,30})(?:\.([0-9a-f]{0,30}))?p([+-][0-9]{1,4})")
_TEXT = re.compile(r"-?([0-9]{1,4000}(\.[0-9]{1,4000}|/[0-9]{1,4000})?|0x[0-9a-f]{1,20000}(/0x[0-9a-f]{1,20000})?)")


def nested_text(values: Any) -> Any:
    """Nested lists of numbers as text."""
    return [nested_text(item) for item in values] if isinstance(values, list) else number_text(values)


def number_texts(values: NDArray[Any]) -> list[str | int]:
    """What `number_text` writes for each of many doubles."""
    values = np.asarray(values, dtype=float)
    whole = (values == np.rint(values)) & (abs(values) < 2**53) & ((values != 0) | ~np.signbit(values))
    out = np.empty(values.size, dtype=object)
    out[whole] = values[whole].astype(np.int64).tolist()
    out[~whole] = list(map(float.hex, values[~whole].tolist()))
    return out.tolist()


def number_text(x: Any) -> str | int:
    """A number without loss: int, float or Fraction."""
    if isinstance(x, float):
        return number_texts(np.array([x]))[0]
    x = Fraction(x)
    p, q = x.numerator, x.denominator
    if q == 1 and abs(p) < _LONG:
        return p
    if max(abs(p), q) >= _LONG:
        return hex(p) if q == 1 else f"{p:#x}/{q:#x}"
    digits = next((k for k in range(1, 16) if 10**k % q == 0), None) if q < _SHORT_DECIMAL else None
    if digits is None:
        return f"{p}/{q}"
    whole = str(abs(p) * (10**digits // q)).rjust(digits + 1, "0")
    return f"{'-' if p < 0 else ''}{whole[:-digits]}.{whole[-digits:]}"


def number(x: Any) -> Fraction:
    """A number as text or a JSON integer."""
    if type(x) is int:
        return Fraction(x)
    if not isinstance(x, str):
        raise CertificateFileError(f"{str(x)[:60]!r} is not a number.")
    found = _DOUBLE.fullmatch(x)
    if found:
        digits = found[2] or ""
        return int(found[1] + digits, 16) * Fraction(2) ** (int(found[3]) - 4 * len(digits))
    if not _TEXT.fullmatch(x):
        raise CertificateFileError(f"{x[:60]!r} is not a number, or has too many digits.")
    if "x" in x:
        top, _, bottom = x.partition("/")
        return Fraction(int(top, 16), int(bottom or "1", 16))
    return Fraction(x)


def double(x: Any) -> float:
    """A number that is a double."""
    if type(x) is int and -_SHORT_DECIMAL < x < _SHORT_DECIMAL:
        return float(x)
    if isinstance(x, str) and _DOUBLE.fullmatch(x):
        with suppress(OverflowError):
            value = float.fromhex(x)
            if value and value.hex() == x:  # as `number_texts` writes it
                return value
    exact = number(x)
    with suppress(OverflowError):
        value = exact.numerator / exact.denominator
        if Fraction(value) == exact:
            return value
    raise CertificateFileError(f"{str(x)[:60]!r} is not a double.")


def special_double(x: Any) -> float:
    """A double, or what stands for none: inf and nan."""
    return float(x) if x in ("inf", "-inf", "nan") else _signed(x)


def _signed(x: Any) -> float:
    value = double(x)
    return -0.0 if value == 0 and isinstance(x, str) and x.startswith("-0x") else value
