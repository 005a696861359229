"""DesignResult: a certified gain, a proof that there is none, or UNDECIDED with what stands in the way."""

from __future__ import annotations

from dataclasses import dataclass, fields
from fractions import Fraction
from typing import Any

import numpy as np
from control import InputOutputSystem
from numpy.typing import NDArray

from ..cards import about, floored, raised, shown_rows
from ..proof.answer import Answer
from ..proof.certificate import Status

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Nearest:
    """What is possible where the demand is not.

    Attributes
    ----------
    decay_rate : float or None
        Largest decay rate that the other demands leave, by the linear programs: computed, not proven.
    gain_bound : float or None
        Smallest max |F x_k| that meets the other demands, computed, not proven.
    """

    decay_rate: float | None = None
    gain_bound: float | None = None

    def __str__(self) -> str:
        parts = []
        if self.decay_rate is not None:
            parts.append(f"a decay rate just below {floored(self.decay_rate)} with everything else as asked")
        if self.gain_bound is not None:
            parts.append(f"a gain bound just above {raised(self.gain_bound)} with everything else as asked")
        return " or ".join(parts) if parts else "nothing nearby was found"


# What is asked for where it is not a small gain.
LARGEST_RATE = "largest decay rate"
# The least gain of a network whose nodes share it.
ONE_GAIN = "smallest gain max |F x_k| over all generators (leading entries 1), with one vector x for all nodes"
# The law of an observer; its design is the feedback of the dual system.
OBSERVER = "z' = A z + B u + L (C z - y)"
_DUAL_WORDS = {
    "not controllable": "not observable",
    "uncontrollable": "unobservable",
    "no feedback stabilises this plant": "no gain makes the error decay",
    "actuators": "sensors",
    "Actuators": "Sensors",
    "on X": "on the dual of X",
    "cone X": "dual of X",
    "generators of X": "facets of X",
    "any F": "any L",
    "every F": "every L",
    "gain bound on input": "gain bound on output",
    " input ": " output ",
}


def dual_words(text: str) -> str:
    """What is said of the feedback of a dual system, in words about the observer."""
    for word, other in _DUAL_WORDS.items():
        text = text.replace(word, other)
    return text


def percent(fraction: float) -> str:
    """A fraction of an effect in per cent, rounded up, with so many digits that it is below 100."""
    texts = (raised(100 * Fraction(fraction), digits) for digits in (4, 6, 9))
    return next((text for text in texts if text != "100"), "100")


class Lazy:
    """A field that may be given as a function without arguments, which is asked when the field is first read.

    Systems can be called, too: they are values.

    Parameters
    ----------
    default : object
    """

    def __init__(self, default: Any) -> None:
        self.default = default

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, record: Any, owner: type | None = None) -> Any:
        held = self.default if record is None else vars(record)[self.name]
        if callable(held) and not isinstance(held, InputOutputSystem):
            held = vars(record)[self.name] = held()
        return held

    def __set__(self, record: Any, value: Any) -> None:
        vars(record)[self.name] = value


def changed(result: DesignResult, **changes: Any) -> DesignResult:
    """The result with other fields; what is proven when it is first read is not proven for that."""
    return DesignResult(**{f.name: vars(result)[f.name] for f in fields(result)} | changes)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DesignResult(Answer):
    """Outcome of a feedback design.  `bool(result)` is True only for PROVED; otherwise there is no gain.

    Attributes
    ----------
    status : Status
        PROVED: `F` does what was asked.  REFUTED: no gain does, proven by `certificate`; of several vertices no gain
        with a common vector x inside X, as `explain` says.  UNDECIDED: no gain was found, or none could be proven.
    F : ndarray, shape (m, n), or None
        Gain of u = F x + w.  Of modes: shape (S, m, n).  Of networks: shape (N, m, n), or a tuple of arrays.
    closed_loop : ConeStateSpace or network, or None
        From w to y, with A + B F exact.  Of modes: a tuple, one for each.  Of one system it is made when it is first
        read; what is proven rests on the same A + B F, not on it.
    certificate : Certificate or None
        Proof for the closed loop formed exactly from the plant's data and the doubles in `F`; or the proof
        that there is no gain.
    objective : str
        What was minimised or maximised.
    value : float
        What was reached; NaN without a gain.
    limit : float
        Proven: no gain for this cone that meets the demands (of several vertices, and of one gain for all nodes of a
        network: with a common vector x inside X) does better than this value.  Proven by multipliers when it is first
        read.  NaN where that is not proven, as for the local search of other methods, structures and cones: what was
        reached is the best found then.
    decay_rate : float
        Proven for the closed loop; NaN without a gain.
    certified_fraction : float or ndarray
        Proven: everything in `certificate` holds for A + B diag(s) F, too, for all s with every s_j between this number
        and 1 (actuators that lose effect, each on its own), with a decay rate of `weakened_rate` for its own.  Proven
        when it is first read.  1: nothing less is proven.  Of networks: for every node.  NaN without a gain.
    weakened_rate : float or Fraction
        The decay rate that was asked for, as it was given.  0: some decay rate.
    message : str
        What stands in the way, for a design that failed.
    nearest : Nearest or None
        For a design that failed: what is possible instead.
    notes : tuple of str
        Uncontrollable modes, loss of positivity under weakened gains, and the like.  Of a gain they are written when
        they are first read.
    law : str
        Where the gain stands: "u = F x", for output feedback "u = F y", for an observer `OBSERVER`.
    alarm : str
        Of networks: what the `ActuatorLossWarning` says; "" for none.
    """

    F: Any = None
    closed_loop: Lazy = Lazy(None)
    objective: str = ""
    value: float = float("nan")
    limit: Lazy = Lazy(float("nan"))
    decay_rate: float = float("nan")
    certified_fraction: Lazy = Lazy(float("nan"))
    weakened_rate: float | Fraction = 0.0
    nearest: Nearest | None = None
    notes: Lazy = Lazy(())
    law: str = "u = F x"
    alarm: str = ""

    def __post_init__(self) -> None:
        if self.law == OBSERVER:
            object.__setattr__(self, "message", dual_words(self.message))
            object.__setattr__(self, "notes", tuple(dual_words(note) for note in self.notes))

    @property
    def K(self) -> Any:
        """-F, for u = -K x (output feedback: u = -K y) as python-control writes it."""
        if self.F is None:
            return None
        return tuple(-f for f in self.F) if isinstance(self.F, tuple) else -np.asarray(self.F)

    @property
    def L(self) -> Any:
        """The gain of an observer, the same as `F`; None for a feedback."""
        return self.F if self.law == OBSERVER else None

    @property
    def x_max(self) -> Floats | None:
        """The x_max for which [0, x_max] is kept, in the order of X, where bounds were asked for; rounded."""
        parts = getattr(self.certificate, "others", ()) if self else ()
        return next((part.x_max for part in parts if hasattr(part, "x_max")), None)

    def explain(self) -> str:
        """What was done, what is proven, and what to do next.

        Returns
        -------
        str
        """
        return dual_words(self._explanation()) if self.law == OBSERVER else self._explanation()

    def _explanation(self) -> str:
        notes = "".join(f" {note}" for note in self.notes)
        if self:
            proof = "" if self.certificate is None else f" {self.certificate.explain()}"
            return (
                f"Certified gain for {self.law}. {self.objective}: {about(self.value)} reached, {self._best()}. "
                f"Decay rate {floored(self.decay_rate)}.{proof} {self._weakening()}{notes}"
            )
        proof = self.certificate.explain() if self.certificate is not None else ""
        nearest = f" Possible instead, as computed and not proven: {self.nearest}." if self.nearest is not None else ""
        scope = getattr(self.certificate, "scope", "")
        lead = (
            f"No gain{scope} exists for this cone" if self.status is Status.REFUTED else "No certified gain was found"
        )
        why = " ".join(filter(None, (self.message, proof)))
        return f"{lead}: {why}{nearest}{notes}"

    def _best(self) -> str:
        """What is proven of other gains."""
        if not np.isfinite(self.limit):
            return "the best found"
        common = len(getattr(self.certificate, "loops", ())) > 1 or self.objective == ONE_GAIN
        scope = " with a common vector x inside X" if common else ""
        least, most = f"less than {floored(self.limit)}", f"more than {raised(self.limit)}"
        better = most if self.objective == LARGEST_RATE else least
        return f"and no gain{scope} for this cone that meets the demands has {better}, which is proven"

    def _weakening(self) -> str:
        if np.ndim(self.certified_fraction):
            return ""  # a network: the notes name the most sensitive node
        least = float(self.certified_fraction)
        if np.isnan(least):
            return ""
        if least >= 1:
            return "Nothing is proven of actuators that lose effect: the gain must act as designed."
        # constraints of the user's own are on F alone
        others = "every other demand" + (" but your own constraints" if self.objective.endswith("given") else "")
        least_rate = floored(self.weakened_rate)
        rate = f"with a decay rate of at least {least_rate}" if self.weakened_rate else "however slowly"
        kept = f"Invariance, stability and {others} are proven, {rate}"
        if least <= 0:
            return f"{kept}, also if actuators lose any part of their effect, even all."
        return (
            f"{kept}, for actuators at {percent(least)} % to 100 % of their effect, each on its own; nothing is proven "
            "below."
        )

    def facts(self) -> list[tuple[str, str]]:
        """Objective, decay rate and gain, for the card that a notebook shows.

        Returns
        -------
        list of (str, str)
        """
        rows = [(self.objective, about(self.value)), ("decay rate", floored(self.decay_rate))] if self else []
        if isinstance(self.F, np.ndarray) and self.F.ndim == 2:
            rows.append((f"{'L' if self.law == OBSERVER else 'F'} in {self.law}", shown_rows(self.F)))
        return rows

    def __repr__(self) -> str:
        if not self:
            return super().__repr__()
        value, rate = about(self.value, digits=4), floored(self.decay_rate, 4)
        return f"<DesignResult PROVED, {self.objective} {value}, decay rate {rate}>"
