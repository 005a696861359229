"""What the next experiment should bring, where the data do not suffice: estimates in doubles, no proofs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..cards import floored
from .plants import Search

# Bisections of the noise that an experiment tolerates.
_HALVINGS = 6
# Directions are told without entries below this.
_SMALL = 1e-6


def not_enough(search: Search, *, gain: bool, refuted: bool = False) -> str:
    """Rank of the samples; else the open pair of facet and generator, and the noise that would be tolerable.

    Parameters
    ----------
    search : Search
    gain : bool
        A gain was sought, not only a verdict about the plants as they are.
    refuted : bool
        It was proven that there is none; then no pair is told as open.
    """
    n, Z = search.data.X.dim, search.samples.Z
    states = _unreached(Z[:n])
    if states is not None:
        return (
            f"the states of the samples reach only {_rank(Z[:n])} of {n} dimensions, and nothing is known along "
            f"{_told(states)}. Add an experiment that starts or moves there."
        )
    both = _unreached(Z)
    if both is not None:
        return (
            f"the inputs of the samples depend on their states: the rank of X0 above U0 is {_rank(Z)}, not {len(Z)}. "
            "Add samples with other inputs at the same states, at least one for each missing rank."
        )
    opened = "" if refuted else f"{_open(search, gain=gain)} "
    return f"{opened}{_tolerable(search, gain=gain)}".rstrip()


def _rank(Z: Any) -> int:
    return int(np.linalg.matrix_rank(_scaled(Z)))


def _scaled(Z: Any) -> Any:
    sizes = np.abs(Z).max(axis=1, keepdims=True, initial=0.0)
    return Z / np.where(sizes > 0, sizes, 1.0)


def _unreached(Z: Any) -> Any:
    """A direction in which no sample has a component, or None."""
    if _rank(Z) == len(Z):
        return None
    left, _, _ = np.linalg.svd(_scaled(Z))
    return left[:, -1]


def _told(d: Any) -> str:
    d = d / d[np.argmax(np.abs(d).round(6))]  # the first of those that rounding makes different
    return f"({', '.join(f'{0.0 if abs(x) < _SMALL else x:.3g}' for x in d)})"


def _open(search: Search, *, gain: bool) -> str:
    """The pair of facet and generator that misses most where the sum of all that is missing is least."""
    found = _attempt(search, gain=gain, elastic=True)
    if found is None or found.open is None:
        return "no program over all plants that agree with the data has an answer in floating point."
    at = int(np.argmax(found.open))
    what = "for no gain F" if gain else "as they are"
    if at >= len(search.pairs):
        return (
            f"{what} all plants that agree with the data were proven stable by a common e: open is the decay at facet "
            f"{at - len(search.pairs)}, normal {_told(search.h[at - len(search.pairs)])}."
        )
    h, k = search.pairs[at]
    return (
        f"{what} all plants that agree with the data were proven to keep X: open is the pair of facet {h}, normal "
        f"{_told(search.h[h])}, and generator {k}, {_told(search.x[k])}. Add samples near that generator."
    )


def _tolerable(search: Search, *, gain: bool) -> str:
    """For the plant in the middle: the share of the noise at which the same experiment would suffice."""
    if search.plant is None:
        return ""
    plant, low, high = np.asarray(search.plant.values), 0.0, 1.0
    if not _suffices(search, plant, 0.0, gain=gain):
        return (
            "The plant in the middle of those that agree does not seem to allow it even without noise; try another "
            "cone."
        )
    for _ in range(_HALVINGS):
        share = (low + high) / 2
        low, high = (share, high) if _suffices(search, plant, share, gain=gain) else (low, share)
    if not low:
        return f"For the plant in the middle of those that agree, even {0.5**_HALVINGS:.2g} of this noise is too much."
    return (
        "For the plant in the middle of those that agree, the same experiment would suffice with about "
        f"{floored(low, 2)} of this noise (an estimate); more or larger samples serve as well."
    )


def _suffices(search: Search, plant: Any, share: float, *, gain: bool) -> bool:
    samples = search.samples
    central = replace(samples, X1=plant @ samples.Z, noise=share * samples.noise)
    found = _attempt(search, central, gain=gain)
    return found is not None and (not gain or found.margin > 0)


def _attempt(search: Search, samples: Any = None, *, gain: bool, elastic: bool = False) -> Any:
    """The program of the search: of a gain, or of the plants as they are."""
    with_e = gain
    unknowns = search.start() if gain else search.fixed_vector(search.x.sum(axis=0), free=False)
    return search.joint(unknowns, search.named(with_e), search.pairs, samples=samples, stable=with_e, elastic=elastic)
