"""Names of states, inputs and outputs, for those who read a verdict."""

from __future__ import annotations

import re
from typing import Any

from ..cards import Signals
from ..cones import Cone, Orthant

# Labels that python-control gives where the user gives none.
_OWN = re.compile(r"[xuy]\[\d+\]")


def signals_of(sys: Any, X: Cone, U: Cone, Y: Cone) -> Signals:
    """The names that a system has for its signals, for texts about it on these cones.

    Parameters
    ----------
    sys : StateSpace
    X, U, Y : Cone

    Returns
    -------
    Signals
        Without names that python-control made up.

    Examples
    --------
    >>> import control as ct
    >>> from control_kpos.cones import orthant
    >>> sys = ct.ss(-1, 1, 1, 0, states=["level"])
    >>> signals_of(sys, *[orthant(1)] * 3)
    Signals(states=('level',), inputs=(), outputs=(), orthants=frozenset({'states'}))
    """
    labels = {"states": (sys.state_labels, X), "inputs": (sys.input_labels, U), "outputs": (sys.output_labels, Y)}
    own = {kind: pair for kind, pair in labels.items() if not all(map(_OWN.fullmatch, pair[0]))}
    orthants = frozenset(kind for kind, (_, cone) in own.items() if isinstance(cone, Orthant))
    return Signals(**{kind: tuple(names) for kind, (names, _) in own.items()}, orthants=orthants)
