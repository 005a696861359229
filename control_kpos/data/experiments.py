"""Measurements: samples of one or more experiments beside each other, with a bound of their noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..cones import Cone, as_cone
from ..cones.orthant import nonnegative
from ..errors import ConeMismatchError, DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix, flag
from ..exact.matrix import Matrix


@dataclass(frozen=True)
class Experiments:
    """X1 = A X0 + B U0 + V with |V| <= noise, for the cone X.

    Attributes
    ----------
    X0, X1, noise : Matrix, shape (n, T)
    U0 : Matrix, shape (m, T), or None
    X : Cone
    discrete : bool
    """

    X0: Matrix
    X1: Matrix
    noise: Matrix
    U0: Matrix | None
    X: Cone
    discrete: bool

    def with_noise(self, factor: Fraction) -> Experiments:
        """The same samples with less noise, or more."""
        return replace(self, noise=Matrix.from_fractions(self.noise.fractions() * factor))

    def data(self) -> dict[str, Any]:
        """The fields of a certificate."""
        return dict(vars(self))

    @property
    def Z(self) -> Any:
        """States above inputs, doubles."""
        return self.X0.values if self.U0 is None else np.concatenate([self.X0.values, self.U0.values])


def read_experiments(X0: Any, X1: Any, U0: Any, noise: Any, X: Any, discrete: Any) -> Experiments:
    """Check the samples and put those of all experiments beside each other.

    Raises
    ------
    DataError, ShapeError, ConeMismatchError, NotProperConeError
        Naming the argument, what was found and what to do.
    """
    states, pieces = _samples(X0, "X0", None)
    n = states.shape[0]
    if not n or not states.shape[1]:
        raise ShapeError(f"X0 is {n} x {states.shape[1]}; give one row for each state and one column for each sample.")
    images, _ = _samples(X1, "X1", pieces)
    if images.shape[0] != n:
        raise ShapeError(
            f"X1 has {images.shape[0]} rows, but X0 has {n}: every state has to be measured, before and after a step."
        )
    inputs = None if U0 is None else _samples(U0, "U0", pieces)[0]
    if inputs is not None and not inputs.shape[0]:
        raise ShapeError("U0 has no rows; give one for each input.")
    cone = nonnegative(n) if X is None else as_cone(X, "X")
    if cone.dim != n:
        raise ConeMismatchError(f"X is a cone in {cone.dim} dimensions, but X0 has {n} rows, one for each state.")
    cone.require_proper("X")
    return Experiments(states, images, _noise(noise, n, pieces), inputs, cone, flag(discrete, "discrete"))


def _samples(given: Any, name: str, pieces: list[int] | None) -> tuple[Matrix, list[int]]:
    """The samples of all experiments, and how many there are in each."""
    listed = _listed(given)
    names = [name] if len(listed) == 1 else [f"{name}[{k}]" for k in range(len(listed))]
    read = [_complete(part, of) for part, of in zip(listed, names, strict=True)]
    counts = [M.shape[1] for M in read]
    if pieces is not None and len(counts) != len(pieces):
        raise ShapeError(f"{name} has {len(counts)} experiments, but X0 has {len(pieces)}.")
    for k, of in enumerate(names):
        if pieces is not None and counts[k] != pieces[k]:
            raise ShapeError(f"{of} has {counts[k]} columns, but X0 has {pieces[k]} there: one for each sample.")
        if read[k].shape[0] != read[0].shape[0]:
            raise ShapeError(f"{of} has {read[k].shape[0]} rows, but {names[0]} has {read[0].shape[0]}.")
    return Matrix.join(read, -1), counts


def _complete(part: Any, name: str) -> Matrix:
    """A matrix without gaps."""
    try:
        return exact_matrix(part, name).dense()
    except DataError as error:
        said = str(error).replace("; fill them in first", "")
        if not any(words in said for words in ("must be finite", "masked", " is None ")):
            raise
        raise DataError(f"{said} Leave out samples with a missing entry, the same columns in X0, X1 and U0.") from None


def _listed(given: Any) -> list[Any]:
    """The experiments: the items of a list of matrices."""
    if isinstance(given, (list, tuple)) and given and all(dimensions(part) == 2 for part in given):
        return list(given)
    return list(given) if isinstance(given, np.ndarray) and given.ndim == 3 and len(given) else [given]


def _noise(given: Any, n: int, pieces: list[int]) -> Matrix:
    """A bound for every entry: one number, one for each state, or one for each entry."""
    total, flat = sum(pieces), dimensions(given)
    if flat is not None and flat < 2:
        bound = exact_matrix(given, "noise", ndim=flat)
        if flat and bound.shape != (n,):
            raise ShapeError(f"noise has {bound.shape[0]} entries; give one number, or {n}, one for each state.")
        entries = np.broadcast_to(bound.fractions().reshape(-1, 1), (n, total))
        bound = Matrix.from_fractions(entries)
    else:
        bound, _ = _samples(given, "noise", pieces)
        if bound.shape[0] != n:
            raise ShapeError(f"noise has {bound.shape[0]} rows, but X0 has {n}; give one for each state.")
    if (bound.values < 0).any():
        at = tuple(int(i) for i in np.argwhere(bound.values < 0)[0])
        raise DataError(f"noise is negative for state {at[0]} and sample {at[1]}; give a bound of its size.")
    return bound
