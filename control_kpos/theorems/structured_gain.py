"""Gains between Euclidean norms, and for blocks of uncertainty, without the DC gain: certificates.

Let U and Y be nonnegative orthants and the system positive and stable.  Its impulse response is nonnegative, so that
|G(j omega)| <= G(0) entry by entry (discrete time: G(1)).  Let blocks b pair inputs with outputs, u_b = Delta_b y_b.
The *structured gain* is

    mu = max {g : |(G(0) a)_b| >= g |a_b| in every block, for some inputs a >= 0, a != 0}
       = min {g : sum_b d_b |(G(0) a)_b|^2 <= g^2 sum_b d_b |a_b|^2 for all a, for some d > 0}

(an infimum).  One block of all signals: mu = sigma_max(G(0)), the L2 gain.  Blocks of one input and one output:
mu = rho(G(0)).  Both sides are equal because |(G(0) a)_b|^2 - g^2 |a_b|^2 is a concave function of the squares a_i^2
(Colombino and Smith, IEEE Trans. Automatic Control 61 (2016)).  1 / mu is the stability margin, see `robust_margin`.

From above, by a Schur test: w, u, d > 0, r and z with d w >= r and z >= d u in every block, x, and p with p'x_i > 0,

    -(A x + B w) in X,    C x + D w <= g u,    (p'A + z'C) x_i < 0,    p'B + z'D <= g r'

prove mu <= g: the strict inequality makes p a Lyapunov vector, so that G(0) w <= C x + D w and G(0)'z <= B'p + D'z.
With y = G(0) a, y_j^2 <= g u_j sum_i G_ji a_i^2 / w_i by Cauchy and Schwarz, hence
sum_b d_b |y_b|^2 <= sum_j (z_j / u_j) y_j^2 <= g^2 sum_i (r_i / w_i) a_i^2 <= g^2 sum_b d_b |a_b|^2.

If no input comes back to its block, mu = 0 is shown by levels, see `zero_gain`, and p with p'x_i > 0 > p'A x_i.

From below: A x + B a in X, 0 <= y <= C x + D a, c >= g a >= 0 and |y_b| >= |c_b| in every block prove mu >= g.
In discrete time A - I takes the place of A.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..cards import floored, raised
from ..cones import Cone
from ..errors import ConeMismatchError, DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix, dense
from ..exact.signs import BilinearForms
from ..proof.certificate import Status, Vector, exactly
from ..proof.in_time import unfinished
from ..proof.inclusion import PositivityViolation
from ..proof.weights import Prover, drift
from ..proof.weights import product as exact_product
from ..systems.system import System
from .blocks import Blocks, is_diagonal
from .decay_rates import drift_forms
from .dissipativity import motion_forms, state_forms
from .positivity import ClaimOnPositivity
from .stability import LyapunovCertificate
from .zero_gain import level_conditions

_WEIGHTS, _SCALED = "w, u, d > 0", "d w - r >= 0, z - d u >= 0"
_INPUT_SIDE, _OUTPUT_SIDE = "C x + D w - upper u <= 0", "p'B + z'D - upper r' <= 0"
_LEAST = "c - lower a >= 0"
_ABOVE, _BELOW, _LEVELS = "wudrzxp", "acys", ("levels", "block_levels")


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class StructuredGainCertificate(ClaimOnPositivity):
    """Proof that a positive system is stable with its structured gain in [lower, upper], or that it is neither.

    Attributes
    ----------
    positivity : PositivityCertificate
        Positivity with respect to (X, U, Y), with the data A, B, C, D; U and Y are nonnegative orthants.
    input_blocks, output_blocks : tuple of int
        The block of every input and of every output, counted from 0.  All 0: the L2 gain.
    lower, upper : float
        Proven bounds of the structured gain; NaN if the system is not stable or not positive.
    w, u, d, r, z, x, p : ndarray or None
        The proof from above, see the module; w and r for the inputs, u and z for the outputs, d for the blocks, x and p
        for the states.
    a, c, y, s : ndarray or None
        The proof from below: inputs a, c >= lower a, outputs y, and the state s.  None if lower is 0.
    levels, block_levels : ndarray or None
        If upper is 0: the proof of that, with p; see `theorems.zero_gain`.
    witness : PositivityViolation, InstabilityDirection or None
        Why the gain is not finite, or not known: the system is not stable, or not positive.
    """

    claim: ClassVar[str] = "structured gain"
    no_margin: ClassVar[frozenset[str]] = frozenset({_SCALED, _INPUT_SIDE, _OUTPUT_SIDE, _LEAST})

    input_blocks: tuple[int, ...]
    output_blocks: tuple[int, ...]
    lower: float = float("nan")
    upper: float = float("nan")
    w: Vector = Vector()
    u: Vector = Vector()
    d: Vector = Vector()
    r: Vector = Vector()
    z: Vector = Vector()
    x: Vector = Vector()
    p: Vector = Vector()
    a: Vector = Vector()
    c: Vector = Vector()
    y: Vector = Vector()
    s: Vector = Vector()
    levels: Vector = Vector()
    block_levels: Vector = Vector()

    @property
    def n_blocks(self) -> int:
        """The number of blocks."""
        return max(self.input_blocks, default=-1) + 1

    def conditions(self) -> Sequence[Condition]:
        """The inequalities of the bound from above, and of the bound from below if it is not 0; or those of 0."""
        system = self.positivity.system()
        _require_fit(self, system)
        if self.upper == 0:
            return self._without_gain(system)
        return [*self._from_above(system), *([] if self.lower == 0 else self._from_below(system))]

    def _row(self, name: str) -> Matrix:
        return exactly(self, name)[None]

    def _from_above(self, system: System) -> list[Condition]:
        """The inequalities of the bound from above, for the system of the certificate."""
        w, u, d, r, z, x, p = map(self._row, _ABOVE)
        m, q = w.shape[1], u.shape[1]
        if d.shape[1] != self.n_blocks:
            raise DataError(f"d has {d.shape[1]} entries, not one for each of the {self.n_blocks} blocks.")
        ins, outs = (dense(d.values)[0][list(blocks)] for blocks in (self.input_blocks, self.output_blocks))
        places = np.arange(m + q)
        twice = np.concatenate([places[:m], m + places[:m], 2 * m + places[:q], 2 * m + q + places[:q]])
        scaled = np.concatenate([ins, -np.ones(m), -outs, np.ones(q)])
        columns = np.concatenate([places[:m], places[:m], places[m:], places[m:]])
        B, C, D = system.B, system.C, system.D
        inward = Matrix.join([C.T, D.T, _times_identity(-self.upper, q)], -2)
        outward = Matrix.join([B, D, _times_identity(-self.upper, m)], -2)
        positive = Matrix.join([w, u, d], -1)
        scaling = Matrix(sp.csr_array((scaled, (twice, columns)), shape=(2 * (m + q), m + q)))
        return [
            Condition(_WEIGHTS, _entries(positive), ">"),
            Condition(_SCALED, _entries(Matrix.join([w, r, u, z], -1), scaling), ">="),
            Condition("h'(A x + B w) <= 0", motion_forms(system, x, w), "<="),
            Condition(_INPUT_SIDE, _entries(Matrix.join([x, w, u], -1), inward), "<="),
            Condition("p'x_i > 0", BilinearForms(p, None, system.X.exact_rays), ">"),
            Condition("(p'A + z'C) x_i < 0", state_forms(system, p, -z), "<"),
            Condition(_OUTPUT_SIDE, _entries(Matrix.join([p, z, r], -1), outward), "<="),
        ]

    def _without_gain(self, system: System) -> list[Condition]:
        """What shows that the gain is 0, for the system of the certificate."""
        p, rays = self._row("p"), system.X.exact_rays
        blocks = Blocks(np.array(self.input_blocks), np.array(self.output_blocks))
        levels, of_blocks = (dense(self._row(name).values)[0] for name in _LEVELS)
        return [
            Condition("p'x_i > 0", BilinearForms(p, None, rays), ">"),
            Condition("p'A x_i < 0", drift_forms(p, system.A, rays, system.discrete), "<"),
            *level_conditions(system, levels, of_blocks, blocks),
        ]

    def _from_below(self, system: System) -> list[Condition]:
        """The inequalities of the bound from below, for the system of the certificate."""
        a, c, y, s = map(self._row, _BELOW)
        m, q = a.shape[1], y.shape[1]
        reached = Matrix.join([system.C.T, system.D.T, _times_identity(-1.0, q)], -2)
        least = Matrix.join([_times_identity(1.0, m), _times_identity(-self.lower, m)], -2)
        both = Matrix.join([y, c], -1)
        members = np.array([*self.output_blocks, *self.input_blocks]), np.arange(q + m)
        signed = dense(both.values)[0] * np.repeat([1.0, -1.0], [q, m])
        squares = Matrix(sp.csr_array((signed, members), shape=(self.n_blocks, q + m)))
        return [
            Condition("1'a > 0", BilinearForms(a, None, Matrix(np.ones((1, m)))), ">"),
            Condition("a, y >= 0", _entries(Matrix.join([a, y], -1)), ">="),
            Condition("h'(A s + B a) >= 0", motion_forms(system, s, a), ">="),
            Condition("C s + D a - y >= 0", _entries(Matrix.join([s, a, y], -1), reached), ">="),
            Condition(_LEAST, _entries(Matrix.join([c, a], -1), least), ">="),
            Condition("|y|^2 - |c|^2 >= 0 in every block", BilinearForms(squares, None, both), ">="),
        ]

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if self.witness is None and self.p is None:
            return Status.UNDECIDED, ()  # nothing was found that could be proven
        return super()._evaluate()

    def refutation(self) -> Sequence[Condition] | None:
        """The inequalities on the witness: those of `PositivityCertificate` or `LyapunovCertificate`."""
        _require_blocks(self, self.positivity.system())
        if not (np.isnan(self.lower) and np.isnan(self.upper)) or any(
            vars(self)[name] is not None for name in (*_ABOVE, *_BELOW, *_LEVELS)
        ):
            return None  # a witness says nothing about bounds
        return self._unstable().refutation()

    def _unstable(self) -> LyapunovCertificate:
        return LyapunovCertificate(positivity=self.positivity, witness=self.witness)

    def evidence(self) -> dict[str, Any]:
        """Evidence of positivity, and weights of -(A x + B w) and A s + B a in X, or those of a witness."""
        if self.witness is not None:
            return self._unstable().evidence()
        out, system, prover = self.positivity.evidence(), self.positivity.system(), Prover()
        if system.X.is_simplicial:  # weights follow; and so it is if the gain is 0
            return out
        out["wz"] = prover.vector(system.X, -_motion(system, exactly(self, "x"), exactly(self, "w")))
        if self.lower != 0:
            out["wy"] = prover.vector(system.X, _motion(system, exactly(self, "s"), exactly(self, "a")))
        return out

    def explain(self) -> str:
        """The bounds of the gain, or why it is not finite."""
        if isinstance(self.refuted_by, PositivityViolation):
            return f"Refuted: the system is not positive. {self.positivity.explain()}"
        if self.refuted_by is not None:
            return f"Refuted: the system is positive, but not exponentially stable: there is {self.witness}."
        if not self:
            if unfinished(self):
                return unfinished(self)
            return (
                "Undecided: no bound of the gain was proven; the system may be too close to the edge of stability, "
                "or of positivity."
            )
        if self.upper == 0:
            return (
                f"Proved: the system is positive and exponentially stable, and {self._what()} is 0: "
                f"{'no input reaches an output' if self.n_blocks == 1 else 'no signal comes back to its own block'}."
            )
        return (
            f"Proved: the system is positive and exponentially stable, and {self._what()} "
            f"lies between {floored(self.lower, 12)} and {raised(self.upper, 12)}."
        )

    def _what(self) -> str:
        G = "G(1)" if self.positivity.discrete else "G(0)"
        if self.n_blocks == 1:
            return f"its L2 gain, the largest singular value of {G},"
        if is_diagonal(self.input_blocks, self.output_blocks):
            return f"its structured gain for {self.n_blocks} single loops, the spectral radius of {G},"
        return f"its structured gain for {self.n_blocks} blocks, the least over scalings by block of a norm of {G},"


def require_orthants(U: Cone, Y: Cone) -> None:
    """Refuse ports on other cones."""
    for name, cone in (("U", U), ("Y", Y)):
        if not is_orthant(cone):
            raise ConeMismatchError(
                f"{name} is no nonnegative orthant, and the DC gain tells gains between Euclidean norms on orthants "
                "only: with other cones of outputs they can be larger at other frequencies. Choose U and Y as "
                "kp.orthant(...); X may be any cone."
            )


def is_orthant(cone: Cone) -> bool:
    """True for the nonnegative orthant, however its generators are scaled and ordered."""
    if cone.n_rays != cone.dim:
        return False
    rays = cone.exact_rays.values
    kinds = (rays > 0).sum(axis=0), (rays > 0).sum(axis=1), (rays != 0).sum(axis=1)
    return all(bool((np.asarray(count).ravel() == 1).all()) for count in kinds)


def _require_fit(c: StructuredGainCertificate, system: System) -> None:
    _require_blocks(c, system)
    if not (is_orthant(system.U) and is_orthant(system.Y)):
        raise DataError("U and Y must be nonnegative orthants.")
    if not (0 <= c.lower < np.inf and 0 <= c.upper < np.inf):
        raise DataError("lower and upper must be finite, and not negative.")
    unused = _LEVELS if c.upper else _ABOVE[:-1]
    if any(vars(c)[name] is not None for name in unused) or (c.lower and not c.upper):
        raise DataError("a gain of 0 is shown by levels and p, any other by vectors without levels.")
    if c.lower == 0 and any(vars(c)[name] is not None for name in _BELOW):
        raise DataError("a bound of 0 from below needs no proof.")


def _require_blocks(c: StructuredGainCertificate, system: System) -> None:
    ins, outs = c.input_blocks, c.output_blocks
    if (len(ins), len(outs)) != system.sizes[1:] or not (set(ins) == set(outs) == set(range(c.n_blocks))):
        raise DataError("every input and every output is in one block, and every block has both.")


def _entries(row: Matrix, M: Matrix | None = None) -> BilinearForms:
    """The entries of the row, or of its product with M."""
    size = row.shape[1] if M is None else M.shape[1]
    return BilinearForms(row, M, Matrix.identity(size, sparse=True))


def _times_identity(factor: float, size: int) -> Matrix:
    return Matrix(sp.csr_array(factor * sp.eye_array(size)))


def _motion(system: System, x: Matrix, w: Matrix) -> NDArray[np.object_]:
    """A x + B w, with A - I for A in discrete time, in fractions."""
    return drift(system.A, x.fractions(), system.discrete) + exact_product(system.B, w.fractions())
