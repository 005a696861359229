"""What objects show: numbers rounded to the safe side, and in a notebook a small card of HTML that fits in a cell.

"At least" and "exp(-rate t)" take `floored`, "at most", "below" and "no more than" take `raised`.  A number that is
stated takes `about`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import MAX_EMAX, MIN_EMIN, ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from html import escape

import numpy as np
from numpy.typing import NDArray

# A sign besides the colour, for those who do not see it.
_SIGNS = {"PROVED": ("\u2713", "#0072B2"), "REFUTED": ("\u2717", "#D55E00"), "UNDECIDED": ("?", "#666666")}
_MOST_ROWS, _MOST_COLUMNS = 8, 8
# What texts number.
_NUMBERED = re.compile(r"\b(facet|generator|input)s? (\d+(?:, \d+)*)")


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


@dataclass(frozen=True)
class Signals:
    """Names of states, inputs and outputs, for texts that speak of facets, generators and inputs by number.

    Attributes
    ----------
    states, inputs, outputs : tuple of str
        Empty: they have no names of their own.
    orthants : frozenset of str
        Which of the three are in an orthant, so that facet i and generator i are the i-th of them.
    """

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    orthants: frozenset[str] = frozenset()

    def legend(self, text: str, facet: str = "states", generator: str = "states") -> str:
        """Who the numbers in a text are, in a sentence of its own; "" if nothing is named.

        Parameters
        ----------
        text : str
        facet, generator : {"states", "inputs", "outputs"}
            What the facets and the generators in it are about.

        >>> signals = Signals(states=("plasma", "tissue"), orthants=frozenset({"states"}))
        >>> signals.legend("A X in X fails at facet 1, normal (0, 1), and generator 0, (1, 0)")
        ' By name: facet 1 is tissue, generator 0 is plasma.'
        """
        roles = {"facet": facet, "generator": generator, "input": "inputs"}
        named = []
        for word, numbers in dict.fromkeys(_NUMBERED.findall(text)):
            names = getattr(self, roles[word]) if word == "input" or roles[word] in self.orthants else ()
            places = (int(number) for number in numbers.split(", "))
            named += [f"{word} {k} is {names[k]}" for k in places if k < len(names)]
        return f" By name: {', '.join(dict.fromkeys(named))}." if named else ""

    def dual(self) -> Signals:
        """Of the dual system, whose inputs are the outputs of this one."""
        turned = {"states": "states", "inputs": "outputs", "outputs": "inputs"}
        return Signals(self.states, self.outputs, self.inputs, frozenset(turned[kind] for kind in self.orthants))

    def of_states(self) -> Signals:
        """For texts about other inputs and outputs than those of the system."""
        return Signals(states=self.states, orthants=self.orthants & {"states"})

    def support(self, x: NDArray[np.float64]) -> str:
        """Which states a vector is about; "" if they are all, or have no names."""
        held = np.flatnonzero(x)
        if "states" not in self.orthants or len(x) != len(self.states) or len(held) == len(x):
            return ""
        more = f" and {len(held) - _MOST_ROWS} others" if len(held) > _MOST_ROWS else ""
        return f" By name: x is not 0 at {', '.join(self.states[k] for k in held[:_MOST_ROWS])}{more}."


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
