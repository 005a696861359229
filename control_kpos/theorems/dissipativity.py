"""Exponential dissipativity with a linear storage function and a linear supply rate.

Theorem 3 (Kawano and Forni, Theorem `cone_d`), with D.  A system that is positive with respect to
(X, U, Y) is exponentially dissipative with storage v'x, v in int X*, and supply r'u + q'y, if and only if
for some rate a > 0, every generator x_i of X and u_j of U

    v'x_i > 0,    (v'A + a v' - q'C) x_i <= 0,    (v'B - r' - q'D) u_j <= 0.

The paper prints v'x_i >= 0, which lets v = 0 and hidden unstable modes through; its remark after the
theorem asks for positive storage, and so do we.  In discrete time A - I takes the place of A.
If there is no such v, there are x in X and u in U with A x + B u in X whose supply is not positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..cards import floored, shown
from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition, all_hold
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Fractions, Status, Vector, exactly
from ..proof.encoding import register_record
from ..proof.in_time import unfinished
from ..proof.inclusion import PositivityViolation
from ..proof.weights import (
    Prover,
    drift,
)
from ..proof.weights import product as exact_product
from ..systems.system import System
from .positivity import (
    ClaimOnPositivity,
    PositivityCertificate,
    cone_positivity,
)
from .storage_candidates import storage_candidates, supply_witness

_BACKOFF = (0.0, 2.0**-50, 2.0**-44, 1e-11, 1e-9, 1e-6, 1e-3, 0.5)
_STORAGE, _STATE, _RATE, _INPUT = (
    "v'x > 0",
    "(v'A - q'C) x < 0",
    "(v'A + rate v' - q'C) x <= 0",
    "(v'B - r' - q'D) u <= 0",
)


@register_record
@dataclass(frozen=True, eq=False)
class SupplyViolation:
    """x in X and u in U with A x + B u in X (A x + B u - x) although the supply r'u + q'y is not positive.

    No storage v'x, v in int X*, can decrease there.

    Attributes
    ----------
    x, u : ndarray, shapes (n,) and (m,)
    x_exact, u_exact : tuple of Fraction, or None
        The exact vectors where doubles do not suffice; x and u are their roundings.
    """

    x: Vector = Vector(required=True)
    u: Vector = Vector(required=True)
    x_exact: Fractions = Fractions("x")
    u_exact: Fractions = Fractions("u")

    def __str__(self) -> str:
        return "a state and an input that move the state into X while the supply r'u + q'y is not positive"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DissipativityCertificate(ClaimOnPositivity):
    """Proof that a system is positive and exponentially dissipative, or that one of them fails.

    Attributes
    ----------
    positivity : PositivityCertificate
        Positivity with respect to (X, U, Y), with the data A, B, C, D.
    q, r : ndarray, shapes (number of outputs,) and (number of inputs,)
        Supply rate r'u + q'y.  r is None if no r makes the system dissipative with this q.
    v : ndarray, shape (n,), or None
        Storage v'x.
    decay_rate : float
        Proven rate a of the dissipation inequality; NaN if there is no v.
    v_exact, q_exact, r_exact : tuple of Fraction, or None
        The exact v, q and r where doubles do not suffice; those above are their roundings.
    witness : PositivityViolation, SupplyViolation or None
    """

    claim: ClassVar[str] = "dissipative"
    no_margin: ClassVar[frozenset[str]] = frozenset({_RATE, _INPUT})

    q: Vector = Vector(required=True)
    r: Vector = Vector()
    v: Vector = Vector()
    decay_rate: float = float("nan")
    v_exact: Fractions = Fractions("v")
    q_exact: Fractions = Fractions("q")
    r_exact: Fractions = Fractions("r")

    @property
    def supply(self) -> tuple[Matrix, Matrix | None]:
        """q and r, exactly, as rows."""
        return exactly(self, "q")[None], None if self.r is None else exactly(self, "r")[None]

    def conditions(self) -> Sequence[Condition]:
        """The inequalities of Theorem 3."""
        p = self.positivity.system()
        q, r = self.supply
        if self.v is None or r is None:
            raise DataError("v or r is missing.")
        v = exactly(self, "v")[None]
        return [
            Condition(_STORAGE, BilinearForms(v, None, p.X.exact_rays), ">"),
            Condition(_STATE, state_forms(p, v, q), "<"),
            Condition(_RATE, state_forms(p, v, q, self.decay_rate), "<="),
            Condition(_INPUT, _input_forms(p, v, q, r), "<="),
        ]

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and (self.v is None or self.r is None):
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness."""
        w, p = self.witness, self.positivity.system()
        if isinstance(w, PositivityViolation):
            return replace(self.positivity, witness=w).refutation()
        if not isinstance(w, SupplyViolation) or self.positivity.status is not Status.PROVED:
            return None
        if self.r is None and np.any(w.u):
            return None
        x, u = exactly(w, "x")[None], exactly(w, "u")[None]
        motion, supply = motion_forms(p, x, u), _supply_forms(p, x, u, *self.supply)
        moves = np.any(w.x) or np.any(np.isin(motion.signs(), (-1, 1))) or supply.signs()[0, 0] == -1
        if not moves:
            return None
        return [
            Condition("h'x >= 0", BilinearForms(x, None, p.X.exact_facets), ">="),
            Condition("h'u >= 0", BilinearForms(u, None, p.U.exact_facets), ">="),
            Condition("h'(A x + B u) >= 0", motion, ">="),
            Condition("q'y + r'u <= 0", supply, "<="),
        ]

    def evidence(self) -> dict[str, Any]:
        """Evidence of positivity, and of a witness the weights of x, u and A x + B u in their cones."""
        w, p, out = self.witness, self.positivity.system(), self.positivity.evidence()
        if not isinstance(w, SupplyViolation):
            return out
        x, u, prover = exactly(w, "x").fractions(), exactly(w, "u").fractions(), Prover()
        motion = drift(p.A, x, p.discrete) + exact_product(p.B, u)
        weights = {"wx": prover.vector(p.X, x), "wu": prover.vector(p.U, u), "wz": prover.vector(p.X, motion)}
        return {**out, **weights}

    def explain(self) -> str:
        """For which supply rate, at what rate, or why not."""
        if isinstance(self.refuted_by, PositivityViolation):
            return f"Refuted: the system is not positive. {self.positivity.explain()}"
        supply = f"q = {shown(self.q)}" + ("" if self.r is None else f", r = {shown(self.r)}")
        if self:
            return (
                f"Proved exponentially dissipative: V(x) = v'x grows no faster than the supply r'u + q'y, less "
                f"{floored(self.decay_rate)} V(x) per unit of time; {supply}. Scale-free margin {self.margin:.3g}."
            )
        if self.refuted_by is not None:
            every = "any r" if self.r is None else "this supply rate"
            return f"Refuted for {every} ({supply}): there is {self.witness}. Enlarge r, or q."
        if unfinished(self):
            return unfinished(self)
        if not self.positivity:
            return f"Undecided, because positivity is: {self.positivity.explain()}"
        return (
            f"Undecided: no storage was proven for {supply}, and no counterexample either; "
            "the supply rate may be too close to the edge."
        )


def dissipativity(
    A: ArrayLike | Matrix | Any,
    B: ArrayLike | Matrix | Any,
    C: ArrayLike | Matrix | Any,
    D: ArrayLike | Matrix | Any,
    X: Cone | ArrayLike,
    U: Cone | ArrayLike,
    Y: Cone | ArrayLike,
    *,
    q: ArrayLike | None = None,
    r: ArrayLike | None = None,
    discrete: bool = False,
) -> DissipativityCertificate:
    """Decide exponential dissipativity with respect to the supply rate r'u + q'y: Theorem 3.

    Parameters
    ----------
    A, B, C, D : array_like, shapes (n, n), (n, m), (p, n), (p, m)
    X, U, Y : Cone, or array_like of its generators
        Polyhedral proper cones in R^n, R^m, R^p.
    q : array_like, shape (p,), optional
        Output part of the supply rate.  None: q = -g f for the sum f of the normalised facets of Y, with
        g = 1 if r is not given either, else (nearly) the largest g that r allows.
    r : array_like, shape (m,), optional
        Input part.  None: (nearly) the least r for this q.
    discrete : bool
        True for x[k+1] = A x[k] + B u[k].

    Returns
    -------
    DissipativityCertificate
        PROVED with v, q, r and the rate; REFUTED with the violation of positivity, or with a state and an
        input that no storage survives.

    Raises
    ------
    ShapeError, DataError, ConeMismatchError, NotProperConeError
        Sizes that do not fit, numbers that are not finite and real, cones that are not proper.

    Notes
    -----
    Costs the positivity check and a few solves with A; a linear program in n unknowns if these do not
    settle it, in rational numbers for small systems near the boundary.

    Examples
    --------
    >>> import control_kpos as kp
    >>> R1 = kp.orthant(1)
    >>> cert = kp.dissipativity([[-2]], [[1]], [[1]], [[0]], R1, R1, R1, q=[-1], r=[0.6])
    >>> cert.status.name
    'PROVED'
    >>> kp.dissipativity([[-2]], [[1]], [[1]], [[0]], R1, R1, R1, q=[-1], r=[0.4]).status.name
    'REFUTED'
    """
    positivity = cone_positivity(A, B, C, D, X, U, Y, discrete=discrete)
    return dissipativity_of(positivity, q=q, r=r)


@np.errstate(all="ignore")
def dissipativity_of(
    positivity: PositivityCertificate, *, q: ArrayLike | None = None, r: ArrayLike | None = None
) -> DissipativityCertificate:
    """Decide dissipativity once positivity has been decided; see `dissipativity`."""
    system = positivity.system()
    given_q = None if q is None else _supply(q, "q", system.Y.dim, "outputs")
    given_r = None if r is None else _supply(r, "r", system.U.dim, "inputs")
    supply_q = Matrix(-np.asarray(system.Y.dual.interior_point, dtype=float)[None]) if given_q is None else given_q
    data = {"positivity": positivity, "q": _flat(supply_q), "r": None if given_r is None else _flat(given_r)}
    if positivity.witness is not None:
        return DissipativityCertificate.settle(**data, witness=positivity.witness)
    if not positivity:
        return DissipativityCertificate.settle(**data)
    for v, q_try in storage_candidates(system, supply_q, given_r, free_q=given_q is None):
        cert = _attempt(positivity, Matrix(v), q_try, given_r)
        if cert is not None:
            return cert
    exact = supply_witness(system, supply_q, given_r)
    if exact is not None:
        storage, x, u = exact
        if storage is not None:
            cert = _attempt(positivity, Matrix.from_fractions(storage), supply_q, given_r)
            if cert is not None:
                return cert
        else:
            witness = SupplyViolation(Matrix.from_fractions(x), Matrix.from_fractions(u))
            return DissipativityCertificate.settle(**data, witness=witness)
    return DissipativityCertificate.settle(**data)


def _attempt(
    positivity: PositivityCertificate, v: Matrix, q: Matrix, r: Matrix | None
) -> DissipativityCertificate | None:
    """The certificate if v (with the least r if r is None) proves dissipativity."""
    if not np.isfinite(v.values).all():
        return None
    row, p = v[None], positivity.system()
    if not all_hold(
        [
            Condition(_STORAGE, BilinearForms(row, None, p.X.exact_rays), ">"),
            Condition(_STATE, state_forms(p, row, q), "<"),
        ]
    ):
        return None
    if r is None:
        r = _least_input_supply(p, row, q)
    if Condition(_INPUT, _input_forms(p, row, q, r), "<=").verdict() is not True:
        return None
    rate = proven_rate(p, row, q)
    return DissipativityCertificate.settle(positivity=positivity, v=v, q=_flat(q), r=_flat(r), decay_rate=rate)


def _least_input_supply(p: System, v: Matrix, q: Matrix) -> Matrix:
    """r = B'v - D'q, moved into U* by a rounding error or so until the input inequality is proven."""
    B, D, v_, q_ = p.B.values, p.D.values, v.values[0], q.values[0]
    r = np.asarray(v_ @ B - q_ @ D, dtype=float)
    inward = np.asarray(p.U.dual.interior_point, dtype=float)
    inward = inward / np.abs(inward).max()
    size = float(np.max(np.abs(v_) @ abs(B) + np.abs(q_) @ abs(D), initial=0.0))
    for step in (0.0, 2.0**-52, 2.0**-48, 1e-12, 1e-9):
        moved = Matrix((r + step * size * inward)[None])
        if Condition(_INPUT, _input_forms(p, v, q, moved), "<=").verdict() is True:
            return moved
    return Matrix(r[None])


def _supply(data: ArrayLike, name: str, size: int, what: str) -> Matrix:
    return require_shape(exact_matrix(data, name), name, (1, size), f"one entry for each of the {size} {what}")


def _flat(row: Matrix) -> Matrix:
    return row.dense()[0]


# -- inequalities


def state_forms(p: System, v: Matrix, q: Matrix, rate: float = 0.0) -> BilinearForms:
    """(v'A + rate v' - q'C) x_i, with A - I for A in discrete time."""
    if not np.isfinite(rate):
        raise DataError(f"a rate of {rate} proves nothing; it must be finite.")
    n = p.A.shape[0]
    rows, blocks = [v, -q], [p.A, p.C]
    for factor in ([-1.0] if p.discrete else []) + ([rate] if rate else []):
        rows.append(v)
        blocks.append(Matrix(Matrix.identity(n, sparse=p.A.is_sparse).values * factor))
    return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), p.X.exact_rays)


def _input_forms(p: System, v: Matrix, q: Matrix, r: Matrix) -> BilinearForms:
    """(v'B - r' - q'D) u_j."""
    m = r.shape[1]
    blocks = [p.B, Matrix.identity(m, sparse=p.B.is_sparse), p.D]
    return BilinearForms(Matrix.join([v, -r, -q], -1), Matrix.join(blocks, -2), p.U.exact_rays)


def motion_forms(p: System, x: Matrix, u: Matrix) -> BilinearForms:
    """h'(A x + B u), with A - I for A in discrete time, for the facets h of X."""
    rows, blocks = [x, u], [p.A.T, p.B.T]
    if p.discrete:
        rows.append(x)
        blocks.append(-Matrix.identity(p.A.shape[0], sparse=p.A.is_sparse))
    return BilinearForms(Matrix.join(rows, -1), Matrix.join(blocks, -2), p.X.exact_facets)


def _supply_forms(
    p: System,
    x: Matrix,
    u: Matrix,
    q: Matrix,
    r: Matrix | None,
) -> BilinearForms:
    """q'(C x + D u) + r'u."""
    m = u.shape[1]
    r = Matrix.zeros(1, m) if r is None else r
    top = Matrix.join([p.C.T, Matrix.zeros(p.A.shape[0], m)], -1)
    low = Matrix.join([p.D.T, Matrix.identity(m)], -1)
    return BilinearForms(Matrix.join([x, u], -1), Matrix.join([top, low], -2), Matrix.join([q, r], -1))


def proven_rate(p: System, v: Matrix, q: Matrix) -> float:
    """The largest rate in floating point that v proves, rounded down."""
    with np.errstate(all="ignore"):
        drift, value = state_forms(p, v, q).values, BilinearForms(v, None, p.X.exact_rays).values
        quotient = float(np.min(-drift / value))
    if np.isfinite(quotient) and quotient > 0:
        for step in _BACKOFF:
            rate = quotient * (1 - step)
            if Condition(_RATE, state_forms(p, v, q, rate), "<=").verdict() is True:
                return rate
    return 0.0
