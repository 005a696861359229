"""What is proven about a gain: its bound, every closed loop, a common vector of several, the gain from disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np

from ..cards import raised
from ..cones import Cone, orthant
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.intake import exact_matrix
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..families.common_vector import CommonVectorCertificate, is_alike, is_same, require_vector
from ..proof.certificate import Certificate
from ..proof.portable_cones import portable_rows
from ..proof.weights import ProofOmittedError, Prover
from ..theorems.positivity import PositivityCertificate
from ..theorems.stability import LyapunovCertificate
from .plant import Floats, leading_sizes


class Demand(Certificate):
    """A claim about a gain that is proven or dropped."""

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class GainBoundCertificate(Demand):
    """Proof that -bound <= F x_k <= bound at every generator of X, input by input.

    Attributes
    ----------
    F : Matrix, shape (m, n)
    bound : ndarray, shape (m,)
    X : Cone
    leading : bool
        True: the generators count with a leading entry of 1, see `leading`; False: with their lengths in `X.rays`.
    """

    claim: ClassVar[str] = "gain bound"

    F: Matrix
    bound: Floats
    X: Cone
    leading: bool = False

    def conditions(self) -> list[Condition]:
        """The inequalities that prove the claim."""
        # [F, -b] [x; size] for x with a leading entry of this size; or for the doubles, whose length matters
        rays = self._rays() if self.leading else np.asarray(self.X.rays, dtype=float)
        sizes = leading_sizes(rays) if self.leading else np.ones(len(rays))
        right = Matrix.from_fractions(np.concatenate([rays, sizes[:, None]], axis=1).astype(object))
        F = self.F.fractions()
        b = np.array([[Fraction(v)] for v in np.asarray(self.bound).tolist()], dtype=object)
        upper = Matrix.from_fractions(np.concatenate([F, -b], axis=1))
        lower = Matrix.from_fractions(np.concatenate([F, b], axis=1))
        return [
            Condition("F x - bound <= 0", BilinearForms(upper, None, right), "<="),
            Condition("F x + bound >= 0", BilinearForms(lower, None, right), ">="),
        ]

    def evidence(self) -> dict[str, Any]:
        """Nothing: generators in files have the lengths that they have here."""
        if not self.leading and (self._rays() != Matrix(np.asarray(self.X.rays, dtype=float)).fractions()).any():
            raise ProofOmittedError("bounds at generators that are no doubles are for control_kpos alone")
        return {}

    def explain(self) -> str:
        """What is proven, in words."""
        if self:
            bound = f"[{' '.join(raised(b, 4) for b in self.bound)}]"
            scaled = ", its leading entry scaled to 1" if self.leading else ""
            return f"Proved: |F x_k| is at most {bound} at every generator of X{scaled}."
        return "The bound on the gain is not proven at every generator of X."

    def _rays(self) -> Any:
        return portable_rows(self.X.exact_rays)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FeedbackCertificate(Demand):
    """Proof that one gain does everything that was asked: all of its parts are proven.

    Attributes
    ----------
    loops : tuple of LyapunovCertificate
        One for each vertex (A_s + B_s F), each with its proof of invariance.
    others : tuple of Certificate
        Gain bound, positivity from input to output, a common vector: x of the closed loops on X, or v, which is the x
        of the transposed loops on X*.
    """

    claim: ClassVar[str] = "feedback"

    loops: tuple[LyapunovCertificate, ...]
    others: tuple[Certificate, ...] = ()

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> FeedbackCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By field; null stands for no part.
        """
        return cls.settle(**{name: x for name, x in contents.items() if x is not None})

    def parts(self) -> tuple[Certificate, ...]:
        """Proofs that this one rests on."""
        return self.loops + self.others

    def conditions(self) -> list[Condition]:
        """None of its own; raises if there is no closed loop, or a part that is about something else."""
        if not self.loops:
            raise DataError("a feedback without a closed loop proves nothing.")
        if not all(isinstance(loop, LyapunovCertificate) for loop in self.loops):
            raise DataError("the closed loops of a feedback must be proven to be stable.")
        if not all(map(self._is_about_these, self.parts())):
            raise DataError("all parts of a feedback must be about its closed loops, one cone and one time.")
        return []

    def _is_about_these(self, part: Certificate) -> bool:
        """True if a part is about the cone, the time and, as far as it has any, the matrices of the closed loops."""
        X, discrete, closed = self.loops[0].X, self.loops[0].discrete, [loop.A for loop in self.loops]
        if isinstance(part, GainBoundCertificate):
            return part.X == X
        if isinstance(part, CommonVectorCertificate):
            return part.is_about(X, closed, discrete) or part.is_about(X.dual, [A.T for A in closed], discrete)
        if isinstance(part, LyapunovCertificate):  # the plant in a network, if it is none of the loops
            return is_alike(part, X, discrete)
        own = getattr(part, "positivity", part)
        if not isinstance(own, PositivityCertificate):
            return False
        return is_alike(own, X, discrete) and any(is_same(own.A, A) for A in closed)

    def evidence(self) -> dict[str, Any]:
        """Nothing: every part comes with a proof of its own."""
        return {}

    @property
    def margin(self) -> float:  # type: ignore[override]
        """The smallest margin of the parts."""
        return min(part.margin for part in self.parts())

    @property
    def decay_rate(self) -> float:
        """Proven for every vertex; if a common vector is a part, for the whole hull of the vertices."""
        common = [part.decay_rate for part in self.others if isinstance(part, CommonVectorCertificate)]
        return min(common or [loop.decay_rate for loop in self.loops])

    @property
    def v(self) -> Floats | None:
        """Lyapunov vector of the (first) closed loop."""
        return self.loops[0].v

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: not all that was asked of the closed loop is proven."
        if len(self.loops) == 1:
            return " ".join(part.explain() for part in self.parts())
        slowest = min(self.loops, key=lambda loop: loop.decay_rate)
        rest = " ".join(dict.fromkeys(map(self._said, self.others)))
        return f"All {len(self.loops)} vertices are proven; the slowest: {slowest.explain()} {rest}"

    def _said(self, part: Certificate) -> str:
        """What a part proves, in words about X."""
        if not isinstance(part, CommonVectorCertificate) or not part.is_dual(self.loops):
            return part.explain()
        return part.told_of_v()


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DisturbanceCertificate(Demand):
    """Proof that the L-infinity gain from w to z is below `gamma`.

    Attributes
    ----------
    positivity : PositivityCertificate
        Of x' = A x + E w, z = G x + D w with orthants for w and z (closed loop matrices).
    x : ndarray, shape (n,)
        A x + E 1 in the interior of -X and G x + D 1 < gamma 1 (A - I for A in discrete time).
    gamma : float
    """

    claim: ClassVar[str] = "disturbance gain"

    positivity: PositivityCertificate
    x: Floats
    gamma: float

    def parts(self) -> Sequence[Certificate]:
        """Proofs that this one rests on."""
        return (self.positivity,)

    def conditions(self) -> Sequence[Condition]:
        """The inequalities that prove the claim."""
        p = self.positivity
        if p.B is None or p.C is None or p.D is None:
            raise DataError("the positivity certificate must cover w and z.")
        if orthant(p.B.shape[1]) != p.U or orthant(p.C.shape[0]) != p.Y:
            raise DataError("w and z must be in orthants.")
        A = p.A.fractions() - int(p.discrete) * Matrix.identity(p.X.dim).fractions()
        pushed, through = (M.fractions().sum(axis=1, keepdims=True) for M in (p.B, p.D))
        inner = np.concatenate([A, pushed], axis=1)
        outer = np.concatenate([p.C.fractions(), through - Fraction(float(self.gamma))], axis=1)
        point = Matrix(np.append(np.asarray(self.x, dtype=float), 1.0)[None, :])
        X = p.X
        return [
            Condition("h'x > 0", BilinearForms(X.exact_facets, None, exact_matrix(self.x, "x")), ">"),
            Condition("h'(A x + E 1) < 0", BilinearForms(X.exact_facets, Matrix.from_fractions(inner), point), "<"),
            Condition("G x + D 1 - gamma < 0", BilinearForms(Matrix.from_fractions(outer), None, point), "<"),
        ]

    def contents(self) -> dict[str, Any]:
        """The dual statement: A', C', B', D' are dissipative on X* with storage x and supply gamma 1'u - 1'y."""
        p = self.positivity.system()
        return {
            "A": p.A.T,
            "B": p.C.T,
            "C": p.B.T,
            "D": p.D.T,
            "X": p.X.dual,
            "U": p.Y,
            "Y": p.U,
            "discrete": p.discrete,
            "v": self.x,
            "q": -np.ones(p.U.dim),
            "r": float(self.gamma) * np.ones(p.Y.dim),
        }

    @classmethod
    def restore(cls, contents: dict[str, Any]) -> DisturbanceCertificate:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        require_vector(cls, contents["v"])
        shapes = (contents["Y"].dim,), (contents["U"].dim,)
        alike = (contents["q"].shape, contents["r"].shape) == shapes
        if not alike or np.any(contents["q"] != -1) or np.ptp(contents["r"]):
            raise DataError("the supply rate must be gamma 1'u - 1'y.")
        a, b, c, d = (contents[name].T for name in "ACBD")
        positivity = PositivityCertificate.settle(
            A=a, B=b, C=c, D=d, X=contents["X"].dual, U=contents["Y"], Y=contents["U"], discrete=contents["discrete"]
        )
        return cls.settle(positivity=positivity, x=contents["v"], gamma=float(contents["r"][0]))

    def evidence(self) -> dict[str, Any]:
        """Weights of A'h, C'z, B'h and D'z."""
        parts = self.contents()
        X, U, Y, prover = parts["X"], parts["U"], parts["Y"], Prover()
        out = {"P": prover.inclusion(X, parts["A"], X, invariance=not parts["discrete"])}
        maps = (("N", X, "B", U), ("L", Y, "C", X), ("K", Y, "D", U))
        return out | {name: prover.inclusion(target, parts[M], source) for name, target, M, source in maps}

    def explain(self) -> str:
        """What is proven, in words."""
        if self:
            gamma = raised(self.gamma)
            return (
                f"Proved: the L-infinity gain from w to z is below {gamma}: if every |w_i(t)| is at most 1, "
                f"every |z_i(t)| stays below {gamma} from rest."
            )
        return "The bound on the L-infinity gain is not proven."
