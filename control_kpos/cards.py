"""What objects show: numbers rounded to the safe side, and in a notebook a small card of HTML that fits in a cell.

"At least" and "exp(-rate t)" take `floored`, "at most", "below" and "no more than" take `raised`.  A number that is
stated takes `about`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from decimal import MAX_EMAX, MIN_EMIN, ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from html import escape

import numpy as np
from numpy.typing import NDArray

# A sign besides the colour, for those who do not see it.
_SIGNS = {"PROVED": ("\u2713", "#0072B2"), "REFUTED": ("\u2717", "#D55E00"), "UNDECIDED": ("?", "#666666")}
_MOST_ROWS, _MOST_COLUMNS = 8, 8


def card(title: str, rows: Iterable[tuple[str, str]] = (), *, status: str = "", text: str = "") -> str:
    """HTML with a title, a verdict, a table of facts, and a few sentences.

    Parameters
    ----------
    title : str
    rows : iterable of (str, str)
        Names of facts, and facts.
    status : str
        "PROVED", "REFUTED", "UNDECIDED", or nothing.
    text : str

    Returns
    -------
    str
    """
    verdict = ""
    if status:
        sign, colour = _SIGNS[status]
        verdict = f' <b style="color:{colour}">{sign} {status}</b>'
    cell = '<td style="text-align:left;vertical-align:top;padding:1px 10px 1px 0">'
    table = "".join(f"<tr>{cell}{escape(name)}</td>{cell}{escape(fact)}</td></tr>" for name, fact in rows)
    return (
        '<div style="border-left:3px solid #999;padding:2px 10px">'
        f"<b>{escape(title)}</b>{verdict}"
        + (f"<table>{table}</table>" if table else "")
        + (f'<div style="max-width:60em">{escape(text)}</div>' if text else "")
        + "</div>"
    )


def floored(x: float | Fraction, digits: int = 6) -> str:
    """The largest decimal number of so many digits that is not above x.

    >>> floored(0.9999999), floored(-0.9999999), floored(Fraction(2, 3), 3)
    ('0.999999', '-1', '0.666')
    """
    return _rounded(x, digits, ROUND_FLOOR)


def raised(x: float | Fraction, digits: int = 6) -> str:
    """The smallest decimal number of so many digits that is not below x.

    >>> raised(1.0000001), raised(-1.0000001), raised(Fraction(2, 3) / 10**9, 3)
    ('1.00001', '-1', '6.67e-10')
    """
    return _rounded(x, digits, ROUND_CEILING)


def _rounded(x: float | Fraction, digits: int, rounding: str) -> str:
    if isinstance(x, float) and not math.isfinite(x):
        return f"{x:g}"
    context = Context(prec=digits, rounding=rounding, Emin=MIN_EMIN, Emax=MAX_EMAX, traps=[])
    exact = Fraction(x)
    quotient = context.divide(Decimal(exact.numerator), Decimal(exact.denominator)).normalize(context)
    exponent = quotient.adjusted()
    if -5 < exponent < digits:
        return f"{quotient:f}"
    return f"{quotient.scaleb(-exponent, context):f}e{exponent:+03d}"


def about(*values: float | Fraction, digits: int = 6, form: str = "{}") -> str:
    """Numbers in `form`, after the word "about" if one of them has more digits.

    >>> about(-0.5), about(1 / 3, digits=3), about(0.5, 3**0.5, form="{} +/- {}j")
    ('-0.5', 'about 0.333', 'about 0.5 +/- 1.73205j')
    """
    texts = [f"{float(v):.{digits}g}" for v in values]
    exact = all(
        Fraction(text) == v if isinstance(v, Fraction) else float(text) == v or math.isnan(v)
        for text, v in zip(texts, values, strict=True)
    )
    return ("" if exact else "about ") + form.format(*texts)


def shown(x: NDArray[np.float64], most: int = 6) -> str:
    """The first entries of a vector."""
    form = ", ".join(["{}"] * min(len(x), most) + ["..."] * (len(x) > most))
    return about(*x[:most], digits=4, form=f"({form})")


def shown_rows(rows: NDArray[np.float64]) -> str:
    """Vectors, one after the other, as many as fit."""
    return ", ".join([shown(row, _MOST_COLUMNS) for row in rows[:_MOST_ROWS]] + ["..."] * (len(rows) > _MOST_ROWS))
