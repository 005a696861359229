"""Families switched by a Markov chain: its rates and jumps as they are given, and candidates for the proof."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from ..cones import Cone, product
from ..cones.polyhedral import has_open_facets
from ..errors import DataError, ShapeError
from ..exact.intake import dimensions, exact_matrix, found, items, require_shape
from ..exact.matrix import Matrix
from ..proof.answer import first_proven
from ..proof.certificate import Status, exactly
from ..theorems.growing_direction import InstabilityDirection, SlowDirection
from ..theorems.positivity import PositivityCertificate, settle_positivity, state_positivity
from ..theorems.stability import LyapunovCertificate, lyapunov_on
from .arguments import Family
from .candidates import worst_mixture
from .chain import MeanDirection, MeanStabilityCertificate

Pairs = dict[tuple[int, int], Matrix]
# States of the means up to which their system is formed in fractions at once, or where doubles do not decide; and up to
# which its sparse factors are computed.
_SMALL, _EXACT, _FACTORED = 24, 120, 3000
# Powers tried for means that grow.
_POWERS = 500
# Relative reductions of a decay rate until it is proven; all of it at the end.
_LESS = (0.0, 2.0**-48, 1e-12, 1e-9, 1e-6, 1.0)
# How close to the largest one a decay rate comes in doubles.
_NEARLY = 1e-3
# How far a row may be from its sum, relative to its entries, for each of these.
_ROUNDING = 2.0**-50


@dataclass(frozen=True)
class Jumping:
    """A family, the rates or probabilities of its chain, and the jumps that are not the identity."""

    family: Family
    chain: Matrix
    jumps: Pairs


def read_chain(family: Family, chain: Any, jumps: Any) -> Jumping:
    """Check a chain and its jumps.

    Raises
    ------
    DataError, ShapeError
        Naming the row or the jump, what was found and what to do.
    """
    count = len(family.matrices)
    Q = (
        require_shape(exact_matrix(chain, "chain"), "chain", (count, count), "a row for every member")
        .dense()
        .fractions()
    )
    for i, j in np.argwhere(Q < 0):
        if i != j or family.discrete:
            what = "a probability" if family.discrete else "a rate between members"
            raise DataError(
                f"chain[{i}, {j}] is {float(Q[i, j]):g}; {what} must not be negative"
                f"{'; in continuous time a chain has rates' * family.discrete}."
            )
    rows = [_row(i, row, family.discrete) for i, row in enumerate(Q)]
    pairs = {} if jumps is None else _jumps(jumps, count, family.X.dim)
    return Jumping(family, Matrix.from_fractions(np.array(rows, dtype=object)), pairs)


def _row(i: int, row: Any, discrete: bool) -> list[Fraction]:
    """The row with the sum that it should have, if it has it up to rounding."""
    total, size = sum(row) - int(discrete), sum(map(abs, row))
    if abs(total) > len(row) * Fraction(_ROUNDING) * size:
        kind, right = ("probabilities", 1) if discrete else ("rates", 0)
        steps = not discrete and abs(sum(row) - 1) < Fraction(1, 10**6)
        raise DataError(
            f"row {i} of chain sums to {float(sum(row)):g}; the {kind} of a row must sum to {right}"
            f"{'' if discrete else ', with minus the sum of the others on the diagonal'}"
            f"{'; in discrete time (discrete=True) a chain has probabilities' * steps}."
        )
    if discrete:
        return [Fraction(a) / sum(row) for a in row]
    return [Fraction(a) - total * (i == j) for j, a in enumerate(row)]


def _jumps(jumps: Any, count: int, n: int) -> Pairs:
    """The jumps by pairs of members."""
    out = {}
    for i, j, J in _listed(jumps, count):
        name = f"jumps[{i}, {j}]"
        M = require_shape(exact_matrix(J, name), name, (n, n), "as the members")
        if not _is_identity(M):
            if i == j:
                raise DataError(f"{name} is not the identity; there is a jump only where the member changes.")
            out[i, j] = M
    return out


def _listed(jumps: Any, count: int) -> Iterator[tuple[int, int, Any]]:
    if isinstance(jumps, Mapping):
        for key, J in jumps.items():
            if not isinstance(key, tuple) or len(key) != 2 or not all(_is_member(k, count) for k in key):
                raise DataError(f"jumps has the key {key!r:.60}; give pairs (i, j) of members, each below {count}.")
            yield int(key[0]), int(key[1]), J
        return
    if dimensions(jumps) != 4 and not isinstance(jumps, (list, tuple)):
        raise DataError(f"jumps is {found(jumps)}; give a dictionary of (i, j): J_ij, or an array (M, M, n, n).")
    rows = items(jumps, "jumps")
    if len(rows) != count:
        raise ShapeError(f"jumps has length {len(rows)}; there must be {count} x {count} matrices.")
    for i, row in enumerate(rows):
        parts = items(row, f"jumps[{i}]")
        if len(parts) != count:
            raise ShapeError(f"jumps[{i}] has length {len(parts)}; there must be {count} x {count} matrices.")
        yield from ((i, j, J) for j, J in enumerate(parts) if J is not None)


def _is_member(k: Any, count: int) -> bool:
    return isinstance(k, (int, np.integer)) and not isinstance(k, bool) and k in range(count)


def _is_identity(M: Matrix) -> bool:
    if M.is_sparse:
        return abs(M.values - sp.eye_array(M.shape[0])).nnz == 0
    return M.is_double and np.array_equal(M.values, np.eye(M.shape[0]))


# -- proofs


def mean_stability(
    given: Jumping, loops: tuple[PositivityCertificate, ...], rate: Literal["max"] | Fraction | None
) -> tuple[MeanStabilityCertificate | PositivityCertificate, str]:
    """The certificate of mean stability, of its opposite, or of a jump that leaves X, with what is to be said of it."""
    X, pairs = given.family.X, given.jumps
    jumps = {pair: state_positivity(J, X, discrete=True) for pair, J in pairs.items()}
    for (i, j), kept in jumps.items():
        if not kept:
            return kept, f"The jump from {i} to {j} does not map X into X." * (kept.status is Status.REFUTED)
    asked = rate if isinstance(rate, Fraction) else None
    data = {
        "loops": loops,
        "chain": given.chain,
        "jumps": tuple(jumps.values()),
        "between": tuple(k for pair in pairs for k in pair),
    }
    size = len(loops) * X.dim
    quick = None if size <= _SMALL or (rate is not None and size <= _EXACT) else _from_doubles(data, given, rate)
    if quick is not None and (quick.status is not Status.UNDECIDED or size > _EXACT):
        return quick, ""
    return _from_exact(data, given, rate, asked), ""


def _from_exact(data: Any, given: Jumping, rate: Any, asked: Fraction | None) -> MeanStabilityCertificate:
    """From Theorem 2 for the system of the means."""
    family, count = given.family, len(given.family.matrices)
    whole = settle_positivity(A=means(given), X=product([family.X] * count), discrete=family.discrete)
    proof = lyapunov_on(whole, rate=rate)
    found = _settled(data, proof, asked)
    if found.status is Status.UNDECIDED and asked is not None:  # stable all the same?
        slower = _settled(data, lyapunov_on(whole, rate="max"), None)
        return slower if slower else found
    return found


def _settled(data: Any, proof: LyapunovCertificate, asked: Fraction | None) -> MeanStabilityCertificate:
    count, w = len(data["loops"]), proof.witness
    if isinstance(w, InstabilityDirection):
        slow = w.rate if isinstance(w, SlowDirection) else 0.0
        witness = MeanDirection(_apart(exactly(w, "x"), count), slow)
        return MeanStabilityCertificate.settle(**data, witness=witness, required_rate=asked if slow else None)
    if proof.v is None:
        return MeanStabilityCertificate.settle(**data)
    vs = _apart(exactly(proof, "v"), count)
    return MeanStabilityCertificate.settle(**data, vs=vs, decay_rate=proof.decay_rate, required_rate=asked)


def _apart(x: Matrix, count: int) -> Matrix:
    """A vector of X^M as M rows."""
    return Matrix.from_fractions(x.fractions().reshape(count, -1))


def means(given: Jumping) -> Matrix:
    """The matrix L of the means, exactly, dense."""
    family, q, count, n = given.family, given.chain.fractions(), len(given.family.matrices), given.family.X.dim
    eye, out = np.eye(n, dtype=int).astype(object), np.full((count * n, count * n), Fraction(0), dtype=object)
    own = [A.dense().fractions() for A in family.matrices]
    jumps = {pair: J.dense().fractions() for pair, J in given.jumps.items()}
    for i, j in np.ndindex(count, count):
        J = jumps.get((i, j), eye)
        block = q[i, j] * (J @ own[i] if family.discrete else J)
        out[j * n : (j + 1) * n, i * n : (i + 1) * n] = block if family.discrete or i != j else block + own[i]
    return Matrix.from_fractions(out)


def _from_doubles(data: Any, given: Jumping, rate: Any) -> MeanStabilityCertificate:
    """From one sparse solve with the rounded system of the means; what it gives is proven for the exact one."""
    family, count, asked = given.family, len(given.family.matrices), rate if isinstance(rate, Fraction) else None
    L, whole = rounded_means(given), product([family.X] * count)
    for slow in (0.0,) if asked is None else (0.0, float(asked) * (1 - _NEARLY)):
        for x in _growing(L, whole, family.discrete, slow):
            witness = MeanDirection(Matrix(x.reshape(count, -1)), slow)
            found = MeanStabilityCertificate.settle(**data, witness=witness, required_rate=asked if slow else None)
            if found.status is Status.REFUTED:
                return found
    for v in _falling(L, whole, family.discrete, rate):
        draft = {**data, "vs": Matrix(v.reshape(count, -1)), "required_rate": asked}
        rates = (_rate(L, v, whole, family.discrete) * (1 - step) for step in _LESS)
        proof = first_proven(
            rates, lambda r, draft=draft: MeanStabilityCertificate.settle(**draft, decay_rate=max(r, 0))
        )
        if proof is not None:
            return proof
    if asked is not None:
        return _from_doubles(data, given, None)
    if not _EXACT < L.shape[0] <= _FACTORED:
        return MeanStabilityCertificate.settle(**data)
    rounded = settle_positivity(A=Matrix(L), X=whole, discrete=family.discrete)
    return _settled(data, lyapunov_on(rounded), None)


def _falling(L: Any, whole: Cone, discrete: bool, rate: Any) -> list[Any]:
    """v that fall in the mean, on simplicial cones; with "max" nearly as fast as the largest eigenvalue allows."""
    if not whole.is_simplicial:
        return []
    turned, least = sp.csr_array(L.T), float(rate) if isinstance(rate, Fraction) else 0.0
    found = [worst_mixture(whole.dual, (Matrix(turned),), discrete=discrete, rate=least)]
    if rate == "max":
        with suppress(spla.ArpackError):
            largest = spla.eigs(turned, 1, which="LR", v0=np.ones(L.shape[0]), return_eigenvectors=False)
            most = float(discrete - largest[0].real) * (1 - _NEARLY)
            found.append(worst_mixture(whole.dual, (Matrix(turned),), discrete=discrete, rate=most))
    falling = [v for v in found if v is not None and _rate(L, v, whole, discrete) > 0]
    return sorted(falling, key=lambda v: -_rate(L, v, whole, discrete))


def rounded_means(given: Jumping) -> sp.csr_array:
    """The matrix L of the means in doubles, sparse."""
    family, q, count = given.family, np.asarray(given.chain.values), len(given.family.matrices)
    own = [sp.csr_array(A.values) for A in family.matrices]
    eye = sp.eye_array(family.X.dim, format="csr")
    jumps = {pair: sp.csr_array(J.values) for pair, J in given.jumps.items()}
    blocks: Any = [[None] * count for _ in range(count)]
    for i, j in np.ndindex(count, count):
        J = jumps.get((i, j), eye)
        block = q[i, j] * (J @ own[i] if family.discrete else J)
        blocks[j][i] = block if family.discrete or i != j else block + own[i]
    return sp.csr_array(sp.block_array(blocks, format="csr"))


def _growing(L: Any, whole: Cone, discrete: bool, rate: float) -> Iterator[Any]:
    """x in X^M that L + rate I maps into X^M, by powers of L + a I; none where these show that it falls faster."""
    if has_open_facets(whole):
        return
    H, x = whole.exact_facets.values, whole.interior_point / np.abs(whole.interior_point).max()
    scale = 1.0 if discrete else max(float(abs(L.diagonal()).max()), 1e-300)
    step, rest = L / scale, (rate - discrete) / scale
    for _ in range(_POWERS):
        moved = step @ x + rest * x
        ahead = H @ moved
        if (ahead < 0).all():
            return
        if (ahead >= 0).all():
            yield x
            return
        x = x + (0.5 if discrete else 1.0) * moved
        x = x / np.abs(x).max()


def _rate(L: Any, v: Any, whole: Cone, discrete: bool) -> float:
    """The decay rate of v in floating point; NaN if it is not inside X*."""
    rays = whole.exact_rays.values
    inside = rays @ v
    return float(np.min(-(rays @ (L.T @ v - (v if discrete else 0))) / inside)) if (inside > 0).all() else np.nan
