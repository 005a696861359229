"""A common vector of a family of matrices, which proves stability under arbitrary switching.

Let every A_s keep X.  If some e in int X has A_s e in -int X for all s (discrete time: A_s e - e), the gauge norm
|x|_e = max_k |h_k'x| / h_k'e falls along x' = A_s(t) x for any switching; on X* and for the transposed matrices e is a
v, and V(x) = v'x falls.  A family may have one and not the other.  There is no common e if and only if

    some w_s in X*, not all 0, have sum_s A_s'w_s in X*      (discrete time: (A_s - I)'w_s),

because 0 <= e'sum_s A_s'w_s = sum_s w_s'A_s e < 0 otherwise (and by duality of linear programs).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..cards import floored
from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.intake import exact_matrix
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, ClaimWithRate, Status
from ..proof.encoding import register_record, require_kinds
from ..proof.weights import Prover, drift
from ..theorems.decay_rates import proven_rate, transposed_drift
from ..theorems.positivity import PositivityCertificate

Floats = NDArray[np.float64]


@register_record
@dataclass(frozen=True, eq=False)
class NoCommonVector:
    """w_s in X*, not all 0, with sum_s A_s'w_s in X* ((A_s - I)'w_s): no e in int X is mapped into -int X by all A_s.

    Attributes
    ----------
    vectors : Matrix, shape (S, n)
        The w_s, one a row.
    """

    vectors: Matrix

    def __str__(self) -> str:
        return (
            "one w_s in the dual of X for each of them, not all 0, with a sum of w_s'A_s x (discrete time: "
            "w_s'A_s x - w_s'x) that is nowhere negative on X"
        )


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class CommonVectorCertificate(ClaimWithRate):
    """Proof that one x inside X is mapped inwards by every vertex: stability of the whole convex hull; or that none is.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance under every vertex.
    x : ndarray, shape (n,), or None
        Interior to X, with A_s x interior to -X for every s (A_s x - x in discrete time).  Then x (t) stays in
        the shrinking order interval between -c(t) x and c(t) x, for any switching among the vertices.
    decay_rate : float
        Proven for all of them: A_s x + decay_rate x in -X.
    required_rate : Fraction or None
        The same for the rate that was asked for, exactly as given.
    witness : NoCommonVector or None
        No such x exists.
    """

    claim: ClassVar[str] = "common vector"

    loops: tuple[PositivityCertificate, ...]
    x: Floats | None = None
    decay_rate: float = 0.0

    @classmethod
    def of(cls, loops: tuple[PositivityCertificate, ...], x: Floats, rate: Fraction) -> CommonVectorCertificate:
        """The certificate with the rate that x proves, and with the one asked for if that is more.

        Parameters
        ----------
        loops : tuple of PositivityCertificate
            Invariance under every vertex.
        x : ndarray, shape (n,)
            A candidate.
        rate : Fraction
            Asked for; 0: none.
        """
        row, first = Matrix(x[None]), loops[0]
        fastest = min(proven_rate(row, loop.A.T, first.X.exact_facets, first.discrete) for loop in loops)
        return cls.settle(loops=loops, x=x, decay_rate=fastest, required_rate=rate if rate > fastest else None)

    def is_about(self, X: Cone, matrices: Sequence[Matrix], discrete: bool) -> bool:
        """True if these are the matrices, the cone and the time that it is about.

        Parameters
        ----------
        X : Cone
            The cone.
        matrices : sequence of Matrix, shape (n, n)
            The vertices, in their order.
        discrete : bool
            The time.
        """
        same = len(self.loops) == len(matrices)
        pairs = zip(self.loops, matrices, strict=False)
        return same and all(is_alike(p, X, discrete) and is_same(p.A, A) for p, A in pairs)

    def is_dual(self, loops: Sequence[Any]) -> bool:
        """True if x is a v of these closed loops: it is about the transposed ones on X*.

        Parameters
        ----------
        loops : sequence of LyapunovCertificate or PositivityCertificate
            One for every vertex.
        """
        return not self.is_about(loops[0].X, [loop.A for loop in loops], loops[0].discrete)

    def parts(self) -> tuple[Certificate, ...]:
        """Proofs that this one rests on."""
        return self.loops

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if any(not is_alike(loop, self.loops[0].X, self.loops[0].discrete) for loop in self.loops):
            raise DataError("the vertices must be about one cone, and all in continuous or all in discrete time.")
        return super()._evaluate()

    def conditions(self) -> list[Condition]:
        """The inequalities that prove the claim."""
        x = exact_matrix(self.x, "x")
        X = self.loops[0].X
        if self.decay_rate < 0:
            raise DataError("decay_rate must not be negative.")
        out = [Condition("h'x > 0", BilinearForms(X.exact_facets, None, x), ">")]
        for s, loop in enumerate(self.loops):
            forms = partial(transposed_drift, x, loop.A, X, loop.discrete)
            out.append(Condition(f"h'A_{s} x < 0", forms(), "<"))
            rates = (rate for rate in (self.decay_rate, self.required_rate) if rate)
            out += [Condition(f"h'A_{s} x + rate h'x <= 0", forms(rate), "<=") for rate in rates]
        return out

    def refutation(self) -> list[Condition] | None:
        """The inequalities on the witness."""
        w, first = self.witness, self.loops[0]
        if not isinstance(w, NoCommonVector) or self.x is not None or self.required_rate is not None:
            return None
        if w.vectors.shape != (len(self.loops), first.X.dim):
            raise DataError("there must be one vector for every vertex.")
        rays, every = first.X.exact_rays, [w.vectors[np.array([s])] for s in range(len(self.loops))]
        blocks = [loop.A for loop in self.loops]
        if first.discrete:
            eye = Matrix.identity(first.X.dim, sparse=blocks[0].is_sparse)
            every, blocks = every * 2, blocks + [-eye] * len(blocks)
        row = Matrix.join(every, -1)
        return [
            Condition("w'x >= 0", BilinearForms(w.vectors, None, rays), ">="),
            Condition("w is not 0", BilinearForms(row, None, row), ">"),
            Condition("sum_s w_s'A_s x >= 0", BilinearForms(row, Matrix.join(blocks, -2), rays), ">="),
        ]

    def contents(self) -> dict[str, Any]:
        """The dual statement: x is a common Lyapunov vector of the A_s' on X*."""
        first = self.loops[0]
        said = {"required_rate": self.required_rate, "v": self.x, "witness": self.witness}
        said["decay_rate"] = None if self.x is None else self.decay_rate
        return {
            "A": tuple(loop.A.T for loop in self.loops),
            "X": first.X.dual,
            "discrete": first.discrete,
            **{name: value for name, value in said.items() if value is not None},
        }

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> CommonVectorCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        if contents.get("v") is not None or contents.get("witness") is None:
            require_vector(cls, contents["v"])
        X, discrete = contents["X"].dual, contents["discrete"]
        loops = tuple(PositivityCertificate.settle(A=A.T, X=X, discrete=discrete) for A in contents["A"])
        if not loops:
            raise DataError("there must be a vertex.")
        more = {name: contents[name] for name in ("decay_rate", "required_rate", "witness") if name in contents}
        return cls.settle(loops=loops, x=contents.get("v"), **more)

    def evidence(self) -> dict[str, Any]:
        """Weights of A_s'h for the generators h of X*; or of the vectors of the witness and their sum in X*."""
        prover, X, discrete = Prover(), self.loops[0].X.dual, self.loops[0].discrete
        if not isinstance(self.witness, NoCommonVector):
            return {"P": [prover.inclusion(X, loop.A.T, X, invariance=not discrete) for loop in self.loops]}
        vectors = self.witness.vectors.fractions()
        moved = sum(drift(loop.A.T, w, discrete) for loop, w in zip(self.loops, vectors, strict=True))
        return {"wx": _each([prover.vector(X, w) for w in vectors]), "wz": prover.vector(X, np.asarray(moved))}

    def explain(self) -> str:
        """What is proven, in words."""
        if self:
            rate = f", with a decay rate of at least {floored(self.decay_rate)}" if self.decay_rate else ""
            return (
                f"Proved: one vector x inside X is mapped into the interior of -X by all {len(self.loops)} vertices, "
                f"so every system in their convex hull, also switching, is exponentially stable{rate}."
            )
        if self.refuted_by is not None:
            return (
                f"Refuted: no vector inside X is mapped into the interior of -X by all {len(self.loops)} vertices: "
                f"there is {self.witness}. This says nothing about other proofs of stability."
            )
        return "The common vector is not proven for every vertex."

    def told_of_v(self) -> str:
        """What is proven, in words about a v: the certificate is about transposed matrices on the dual of X."""
        rate = f", with a decay rate of at least {floored(self.decay_rate)}" if self.decay_rate else ""
        return (
            f"Proved: V(x) = v'x with one v inside X* falls on X at all {len(self.loops)} vertices, so every system in "
            f"their convex hull, also switching, is exponentially stable{rate}."
        )


def _each(weights: list[Any]) -> list[Any] | None:
    return None if None in weights else weights


def require_vector(cls: Any, v: Any) -> None:
    """Raise an error unless v can be the x of a certificate."""
    require_kinds(cls, {"x": v})
    if v is None or v.ndim != 1:
        raise DataError("v is a vector.")


def is_alike(part: Any, X: Cone, discrete: bool) -> bool:
    """True if a certificate is about this cone and this time."""
    return part.X == X and part.discrete == discrete


def is_same(M: Matrix, N: Matrix) -> bool:
    """True if two matrices are the same numbers."""
    return M is N or (M.shape == N.shape and not (M.dense().fractions() != N.dense().fractions()).any())
