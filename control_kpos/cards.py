"""What objects show in a notebook: a small card of HTML, never more than fits in a cell."""

from __future__ import annotations

from collections.abc import Iterable
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


def shown_rows(rows: NDArray[np.float64]) -> str:
    """Vectors, one after the other, as many as fit."""
    shown = [
        "(" + ", ".join(f"{v:.4g}" for v in row[:_MOST_COLUMNS]) + (", ..." if len(row) > _MOST_COLUMNS else "") + ")"
        for row in rows[:_MOST_ROWS]
    ]
    return ", ".join(shown) + (", ..." if len(rows) > _MOST_ROWS else "")
