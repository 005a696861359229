"""What is proven of a family A_0, .., A_S-1 whose members follow each other in any order.

Every A_s keeps X.  *Growth* in discrete time: if v_s in int X* and

    (gamma v_s - A_s'v_t)'x >= 0   for all s, t and generators x,

then v_s(k)'x[k], with the mode s(k) that is applied next, rises at most by the factor gamma per step, whatever the
order.  *Not stable*: some x in X, x != 0, and

    a cycle of modes with the product P:  P x - factor x in X,  factor >= 1:  P^k x - x in X for all k; or
    weights lam >= 0:  (sum_s lam_s A_s) x in X  (discrete time, sum lam = 1:  sum_s lam_s A_s x - x in X).

The second refutes exponential stability under arbitrary switching, because M = sum lam_s A_s would inherit it.
Suppose that |x(t)| <= K e^{-at} |x(0)| for all switching.  In discrete time M^k is a convex combination of products of
k members (sum lam = 1), so that |M^k| <= K e^{-ak}; in continuous time e^{Mt} is the limit of
(e^{A_0 lam_0 t/k} .. e^{A_S-1 lam_S-1 t/k})^k (Trotter), each of norm at most K e^{-at sum lam}.  But M keeps X, and
so M^k x - x, or e^{Mt} x - x, lies in X for all k or t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar, TypeVar

import numpy as np

from ..cards import about, floored, raised, shown
from ..cones import Cone
from ..errors import DataError
from ..exact.condition import Condition
from ..exact.matrix import Matrix
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Fractions, Status, Vector, exactly
from ..proof.encoding import register_record
from ..proof.weights import Prover, product
from ..theorems.positivity import PositivityCertificate
from .common_vector import is_alike

_GROWTH = "gamma v_s'x - v_t'A_s x >= 0"
C = TypeVar("C", bound="ClaimOnFamily")


@register_record
@dataclass(frozen=True, eq=False)
class CycleOfGrowth:
    """Modes that follow each other again and again, with product P, and x in X, x != 0, with P x - factor x in X.

    Attributes
    ----------
    x : ndarray, shape (n,)
    modes : tuple of int
        In the order in which they are applied.
    factor : Fraction
        Positive: P^k x - factor^k x lies in X for every k.
    exact : tuple of Fraction, or None
        The exact x where doubles do not suffice.
    """

    x: Vector = Vector(required=True)
    modes: tuple[int, ...] = ()
    factor: Fraction = Fraction(1)
    exact: Fractions = Fractions("x")

    def __str__(self) -> str:
        modes = ", ".join(map(str, self.modes))
        return f"a cycle of the members {modes} that takes x = {shown(self.x)} to no less than {floored(self.factor)} x"


@register_record
@dataclass(frozen=True, eq=False)
class UnstableMixture:
    """Weights lam >= 0 and x in X, x != 0, with sum_s lam_s A_s x in X (sum lam = 1: minus x in discrete time).

    Attributes
    ----------
    x : ndarray, shape (n,)
    weights : tuple of Fraction
    exact : tuple of Fraction, or None
        The exact x where doubles do not suffice.
    """

    x: Vector = Vector(required=True)
    weights: tuple[Fraction, ...] = ()
    exact: Fractions = Fractions("x")

    def __str__(self) -> str:
        used = [f"{about(a)} of member {s}" for s, a in enumerate(self.weights) if a]
        if len(used) == 1:
            member = next(s for s, a in enumerate(self.weights) if a)
            return f"member {member} alone does not take x = {shown(self.x)} to 0"
        return f"the mixture {' + '.join(used)} does not take x = {shown(self.x)} to 0"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ClaimOnFamily(Certificate):
    """A claim about members that keep one cone.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance of X under every member.
    """

    loops: tuple[PositivityCertificate, ...]

    @property
    def X(self) -> Cone:
        """The cone the verdict is about."""
        return self.loops[0].X

    @property
    def discrete(self) -> bool:
        """True for x[k+1] = A x[k]."""
        return self.loops[0].discrete

    def parts(self) -> tuple[Certificate, ...]:
        """Proofs that this one rests on."""
        return self.loops

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        if any(not is_alike(loop, self.X, self.discrete) for loop in self.loops):
            raise DataError("the members must be about one cone, and all in continuous or all in discrete time.")
        return super()._evaluate()

    def contents(self) -> dict[str, Any]:
        """The members, their cone and time, and the fields."""
        absent = [name for name, x in self.data().items() if x is None or (isinstance(x, tuple) and not x)]
        own = {name: x for name, x in self.data().items() if name not in ("loops", *absent)}
        return {"A": tuple(loop.A for loop in self.loops), "X": self.X, "discrete": self.discrete, **own}

    @classmethod
    def restore(cls: type[C], contents: dict[str, Any]) -> C:
        """The inverse of `contents`.

        Parameters
        ----------
        contents : dict
            By the names in files.
        """
        own = dict(contents)
        A, X, discrete = (own.pop(name) for name in ("A", "X", "discrete"))
        if not A or not all(isinstance(M, Matrix) for M in A):
            raise DataError("there must be a member, and all of them matrices.")
        loops = tuple(PositivityCertificate.settle(A=M, X=X, discrete=discrete) for M in A)
        return cls.settle(loops=loops, **own)

    def evidence(self) -> dict[str, Any]:
        """Weights of A_s x for the generators x of X."""
        prover = Prover()
        return {"P": [prover.inclusion(self.X, loop.A, self.X, invariance=not self.discrete) for loop in self.loops]}

    def _moved(self, cycle: CycleOfGrowth) -> Any:
        """P x - factor x, in fractions."""
        modes = cycle.modes
        if not self.discrete or not modes or not all(0 <= s < len(self.loops) for s in modes) or cycle.factor <= 0:
            raise DataError("a cycle of growth has modes of the family, discrete time and a positive factor.")
        x = out = exactly(cycle, "x").fractions()
        for s in modes:
            out = product(self.loops[s].A, out)
        return out - cycle.factor * x

    def _grows(self, cycle: CycleOfGrowth) -> list[Condition]:
        """x != 0, x in X and P x - factor x in X."""
        row, facets, moved = exactly(cycle, "x")[None], self.X.exact_facets, self._moved(cycle)
        moved = Matrix.from_fractions(moved[None] / max(1, *map(abs, moved)))
        return [
            Condition("x is not 0", BilinearForms(row, None, row), ">"),
            Condition("h'x >= 0", BilinearForms(row, None, facets), ">="),
            Condition("h'(P x - factor x) >= 0", BilinearForms(moved, None, facets), ">="),
        ]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SwitchingCertificate(ClaimOnFamily):
    """Proof that a family is not exponentially stable under arbitrary switching.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance of X under every member.
    witness : UnstableMixture or CycleOfGrowth
    """

    claim: ClassVar[str] = "stable under switching"

    def _evaluate(self) -> tuple[Status, Sequence[Condition]]:
        return (Status.UNDECIDED, ()) if self.witness is None else super()._evaluate()

    def conditions(self) -> list[Condition]:
        """None: stability is proven by a common vector, or by its growth."""
        return []

    def refutation(self) -> list[Condition] | None:
        """The inequalities on the witness."""
        w = self.witness
        if not all(loop.status is Status.PROVED for loop in self.loops):
            return None
        if isinstance(w, CycleOfGrowth):
            return self._grows(w) if w.factor >= 1 else None
        if not isinstance(w, UnstableMixture) or len(w.weights) != len(self.loops) or min(w.weights) < 0:
            return None
        return self._mixed(w) if self._is_scaled(w) else None

    def _is_scaled(self, w: UnstableMixture) -> bool:
        return sum(w.weights) == 1 if self.discrete else sum(w.weights) > 0

    def _mixed(self, w: UnstableMixture) -> list[Condition]:
        """x != 0, x in X and sum_s lam_s A_s x in X (minus x)."""
        x, facets = exactly(w, "x"), self.X.exact_facets
        weights, blocks = [*w.weights], [loop.A for loop in self.loops]
        if self.discrete:
            weights, blocks = [*weights, Fraction(1)], [*blocks, -_eye_like(blocks[0])]
        used = [s for s, a in enumerate(weights) if a]
        rows = Matrix.join([_times(x, weights[s]) for s in used], -1)
        row = x[None]
        return [
            Condition("x is not 0", BilinearForms(row, None, row), ">"),
            Condition("h'x >= 0", BilinearForms(row, None, facets), ">="),
            Condition("h'A x >= 0", BilinearForms(facets, Matrix.join([blocks[s] for s in used], -1), rows), ">="),
        ]

    def evidence(self) -> dict[str, Any]:
        """Weights of A_s x for the generators of X, and of the vectors of the witness that lie in X."""
        w, prover = self.witness, Prover()
        x = exactly(w, "x").fractions()
        if isinstance(w, CycleOfGrowth):
            moved = self._moved(w)
        else:
            terms = [a * product(loop.A, x) for a, loop in zip(w.weights, self.loops, strict=True) if a]
            moved = np.asarray(sum(terms)) - int(self.discrete) * x
        return {**super().evidence(), "wx": prover.vector(self.X, x), "wz": prover.vector(self.X, moved)}

    def explain(self) -> str:
        """What is proven, in words."""
        w = self.refuted_by
        if isinstance(w, CycleOfGrowth):
            return (
                f"Refuted: not stable under arbitrary switching: there is {w}, so this signal does not let x go to 0."
            )
        if w is not None:
            fast = "" if sum(a != 0 for a in w.weights) == 1 else _OF_MIXTURES[self.discrete]
            return f"Refuted: not exponentially stable under arbitrary switching: {w}{fast}."
        return "Undecided: neither stability under arbitrary switching nor a signal that prevents it is proven."


_OF_MIXTURES = (
    ", and switching in these proportions comes as close to it as one likes if it is fast",
    ", and its powers are means of products of members, so that these do not all fall exponentially",
)


def _times(x: Matrix, a: Fraction) -> Matrix:
    """a x', as a row."""
    return x[None] if a == 1 else Matrix.from_fractions((x.fractions() * a)[None])


def _eye_like(M: Matrix) -> Matrix:
    return Matrix.identity(M.shape[0], sparse=M.is_sparse)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class NextModeCertificate(ClaimOnFamily):
    """Proof of a bound on the growth per step of x[k+1] = A_s(k) x[k], whatever the order of the members.

    Attributes
    ----------
    loops : tuple of PositivityCertificate
        Invariance of X under every member.
    vs : Matrix, shape (S, n)
        v_s in int X*, one for every member: v_t'A_s x <= growth v_s'x on X for all s and t.
    growth : float
        gamma: |x[k]| <= K growth^k |x[0]| with the same K for every order.
    cycle : CycleOfGrowth or None
        A periodic signal that grows nearly as fast.
    least : float
        Proven by the cycle: some x in X grows at least by this factor per step; 0 without a cycle.
    """

    claim: ClassVar[str] = "growth under switching"
    no_margin: ClassVar[frozenset[str]] = frozenset({_GROWTH, "h'x >= 0", "h'(P x - factor x) >= 0"})

    vs: Matrix
    growth: float
    least: float
    cycle: CycleOfGrowth | None = None

    def conditions(self) -> list[Condition]:
        """The inequalities of every member, and those of the cycle."""
        vs, count, rays = self.vs, len(self.loops), self.X.exact_rays
        if not self.discrete or vs.shape != (count, self.X.dim) or not 0 <= self.growth < np.inf:
            raise DataError("growth is that of a family in discrete time, with one vector for every member.")
        out = [Condition("v_s'x > 0", BilinearForms(vs, None, rays), ">")]
        for s, loop in enumerate(self.loops):
            eye = _eye_like(loop.A)
            forms = Matrix.join([vs[np.full(count, s)], vs], -1), Matrix.join([_scaled(eye, self.growth), -loop.A], -2)
            out.append(Condition(f"{_GROWTH} ({s})", BilinearForms(*forms, rays), ">="))
        return out + self._from_below()

    def _from_below(self) -> list[Condition]:
        if self.cycle is None:
            if self.least != 0:
                raise DataError("nothing shows the least growth.")
            return []
        if not 0 <= self.least < np.inf:
            raise DataError("the least growth is a number that is not negative.")
        spare = self.cycle.factor - Fraction(self.least) ** len(self.cycle.modes)
        sign, one = Matrix(np.array([[float((spare > 0) - (spare < 0))]])), Matrix.identity(1)
        shown = Condition("factor - least^length >= 0", BilinearForms(sign, None, one), ">=")
        return [*self._grows(self.cycle), shown]

    @property
    def margin(self) -> float:  # type: ignore[override]
        """Scale-free: how far the vectors lie inside the dual of X."""
        return min((c.margin for c in self._own_conditions if c.name == "v_s'x > 0"), default=0.0)

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def evidence(self) -> dict[str, Any]:
        """Weights of A_s x for the generators of X, and of the vectors of the cycle that lie in X."""
        out, prover = super().evidence(), Prover()
        if self.cycle is not None:
            x = exactly(self.cycle, "x").fractions()
            out |= {"ws": prover.vector(self.X, x), "wb": prover.vector(self.X, self._moved(self.cycle))}
        return out

    def explain(self) -> str:
        """What is proven, in words."""
        if not self:
            return "Undecided: the bound on the growth under switching is not proven."
        stable = " It falls, so the family is exponentially stable under arbitrary switching." * (self.growth < 1)
        least = "" if self.cycle is None else f" For some order it grows at least like {floored(self.least, 9)}^k."
        most = raised(self.growth, 9)
        return f"Proved: whatever the order of the members, x[k] grows at most like {most}^k.{least}{stable}"


def _scaled(eye: Matrix, number: float) -> Matrix:
    return Matrix(eye.values * float(number))
