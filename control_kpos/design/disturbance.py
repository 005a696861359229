"""Disturbance rejection: the L-infinity gain from w to z minimised, exactly on simplicial cones.

For x' = (A + B F) x + E w, z = (G + H F) x + D w, positive from w in the orthant to z in the orthant, the L-infinity
gain is the largest row sum of the DC gain.  It is below gamma if and only if some xi > 0 has

    (A + B F) x + E 1 < 0 (in the order of X),   (G + H F) x + D 1 < gamma 1,   x = sum xi_k x_k,

which is linear in xi, z_k = xi_k F x_k and gamma.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..cones import Cone, orthant
from ..errors import DataError, ShapeError
from ..exact.budget import affords
from ..exact.condition import Condition
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix
from ..exact.program import Block, Program, Solver
from ..exact.signs import BilinearForms
from ..proof.answer import first_proven
from ..proof.certificate import Certificate, Status
from ..proof.weights import Prover
from ..theorems.positivity import PositivityCertificate, cone_positivity
from .accept import Accepted, FeedbackCertificate, accept, closed_loop, roundings
from .plant import Floats, Plant
from .result import DesignResult
from .simplicial.inequalities import column_rows
from .simplicial.program import SimplicialProgram
from .simplicial.rows import scaled_rows
from .simplicial.search import succeed, undecided

LINF_GAIN = "L-infinity gain from w to z"
# Relative increase of gamma that is spent on a small gain and on margins.
_SLACK = 1e-3
# Gains this many times the size of the plant count as unbounded.
_HUGE = 1e4


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DisturbanceCertificate(Certificate):
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
        n, count = p.B.shape
        A = p.A.fractions()
        if p.discrete:
            A = A - np.array([[int(i == j) for j in range(n)] for i in range(n)], dtype=object)
        ones = np.array([[1]] * count, dtype=object)
        gamma = exact_matrix([[float(self.gamma)]], "gamma").fractions()
        inner = np.concatenate([A, p.B.fractions() @ ones], axis=1)
        outer = np.concatenate([p.C.fractions(), p.D.fractions() @ ones - gamma[0, 0]], axis=1)
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
        if np.any(contents["q"] != -1) or np.ptp(contents["r"]):
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

    def refutation(self) -> None:
        """None: there is no witness against this claim."""
        return

    def explain(self) -> str:
        """What is proven, in words."""
        if self:
            return (
                f"Proved: the L-infinity gain from w to z is below {self.gamma:.6g}: if every |w_i(t)| is at most 1, "
                f"every |z_i(t)| stays below {self.gamma:.6g} from rest."
            )
        return "The bound on the L-infinity gain is not proven."


def read_disturbance(data: Sequence[ArrayLike], plant: Plant) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """(E, G, H, D) with zeros for what was left out."""
    if not isinstance(data, (tuple, list)) or not 2 <= len(data) <= 4:
        raise ShapeError("disturbance must be (E, G), (E, G, H) or (E, G, H, D), a tuple of matrices.")
    E, G = exact_matrix(data[0], "disturbance E"), exact_matrix(data[1], "disturbance G")
    require_shape(E, "disturbance E", (plant.n, None), "one row per state")
    require_shape(G, "disturbance G", (None, plant.n), "one column per state")
    zeros = Matrix.zeros(G.shape[0], plant.m), Matrix.zeros(G.shape[0], E.shape[1])
    H = exact_matrix(data[2], "disturbance H") if len(data) > 2 else zeros[0]
    D = exact_matrix(data[3], "disturbance D") if len(data) > 3 else zeros[1]
    require_shape(H, "disturbance H", (G.shape[0], plant.m), "one row per row of G, one column per input")
    require_shape(D, "disturbance D", (G.shape[0], E.shape[1]), "one row per row of G, one column per column of E")
    return E, G, H, D


def reject_disturbance(plant: Plant, rate: float, data: Sequence[ArrayLike], lp: Solver) -> DesignResult:
    """The gain of smallest L-infinity gain from w to z (within 0.1 %), then of small size."""
    if len(plant.A) > 1:
        raise DataError("disturbance rejection takes one plant; leave vertices out.")
    E, G, H, D = read_disturbance(data, plant)
    Z = orthant(G.shape[0])
    inflow = cone_positivity(np.eye(plant.n), E, None, D, plant.X, orthant(E.shape[1]), Z)
    if inflow.status is Status.REFUTED:
        message = "w in the orthant must not leave X or z's orthant directly: E must map into X and D be nonnegative."
        return DesignResult(status=Status.REFUTED, certificate=inflow, message=message)
    program = SimplicialProgram(plant, np.ones((plant.n, plant.m), dtype=bool), lp)
    rows = _Rows(program, rate, tuple(np.asarray(M.values) for M in (E, G, H, D)))
    least = rows.program()
    least.add(gamma=Block(1, cost=1.0))
    least.below(-rows.through, x=rows.total, gamma=-np.ones(len(rows.total)))
    first = least.solve(lp)
    if not first or not (first["x"][: plant.n] > 0).all():
        reason = (first.message or first.outcome) if not first else "the solver returned a point that violates it"
        message = (
            f"the program has no solution ({reason}): no gain keeps x in X, z in its orthant, and the loop stable."
        )
        return undecided(message, plant, objective=LINF_GAIN)
    x, best = first["x"], float(first["gamma"][0])
    if plant.gain_of(program.read(x)[0]) > _HUGE * max(plant.scale, 1.0):
        message = "the larger the gain, the better, without end; give gain_bound."
        return undecided(message, objective=LINF_GAIN, limit=best)

    def points() -> Iterator[tuple[float, Floats]]:
        """Of each gamma, the point of smallest |F x_k|, then the first one."""
        for slack in (_SLACK, 1e-2):
            gamma = best + slack * max(abs(best), 1e-6)
            second = rows.small(gamma, x, lp)
            yield from ((gamma, point) for point in (second, x) if point is not None)

    def prove(candidate: tuple[float, Floats]) -> Accepted | None:
        F, inside = program.read(candidate[1])
        return _certify(plant, F, inside, candidate[0], rate, (E, G, H, D), Z)

    found = first_proven(points(), prove)
    if found is None:
        return undecided("a gain was found, but could not be proven.", objective=LINF_GAIN, limit=best)
    return succeed(plant, found, LINF_GAIN, found.certificate.others[-1].gamma, best)  # type: ignore[attr-defined]


class _Rows:
    """The inequalities of the module's head over x = (xi, z), for E, G, H, D in doubles."""

    def __init__(self, design: SimplicialProgram, rate: float, data: tuple[Floats, ...]) -> None:
        E, G, H, D = data
        plant, n = design.plant, design.n
        self.design, self.n = design, n
        self.push = (plant.facets @ E).sum(axis=1) / np.einsum("ij,ij->i", plant.facets, plant.rays)
        i, k = (index.ravel() for index in np.indices((len(G), n)))
        self.outputs = column_rows((G @ plant.rays.T)[i, k], H[i], k, n)
        self.total = np.hstack([G @ plant.rays.T, np.tile(H, (1, n))])
        self.through = D.sum(axis=1)
        self.fixed, self.drift = design.fixed(None), design.decreasing(rate)

    def program(self, shift: Floats | float = 0.0) -> Program:
        """Invariance (by -shift), z in its orthant, and (A + B F) x + E 1 < 0."""
        low = np.full(self.fixed.shape[1], -np.inf)
        low[: self.n] = 1e-6
        program = Program(x=Block(len(low), low=low))
        program.below(shift, x=self.fixed)
        program.above(0.0, x=self.outputs)
        program.below(-self.push, x=self.drift)
        return program

    def small(self, gamma: float, x: Floats, lp: Solver) -> Floats | None:
        """The smallest largest entry of |F x_k| at this gamma, with the weights xi of x and a little margin."""
        closed, slope = self.design.closed, self.design.slope
        scaled = scaled_rows(slope, 1 / np.tile(np.repeat(x[: self.n], self.design.m), 2))
        margin = np.zeros(self.fixed.shape[0])
        margin[: closed.shape[0]] = 1e-7 * (abs(closed) @ np.abs(x))

        def solve(strength: float) -> Floats | None:
            program = self.program(-strength * margin)
            program.add(largest=Block(1, low=0.0, cost=1.0))
            program.below(gamma - self.through - 1e-6 * abs(gamma), x=self.total)
            program.below(0.0, x=scaled, largest=-np.ones(scaled.shape[0]))
            answer = program.solve(lp)
            return answer["x"] if answer and (answer["x"][: self.n] > 0).all() else None

        return next((point for strength in (1.0, 1e-2, 0.0) if (point := solve(strength)) is not None), None)


def _certify(
    plant: Plant, F: Floats, x: Floats, gamma: float, rate: float, data: tuple[Matrix, ...], Z: Cone
) -> Accepted | None:
    E, G, H, D = data

    def prove(candidate: Floats) -> Accepted | None:
        found = accept(plant, candidate, rate=rate)
        if found is None or not np.array_equal(found.F, candidate):
            return None
        W, out = orthant(E.shape[1]), closed_loop(G, H, candidate)
        positivity = cone_positivity(found.closed[0], E, out, D, plant.X, W, Z, discrete=plant.discrete)
        if not positivity:
            return None
        certificate = DisturbanceCertificate.settle(positivity=positivity, x=x, gamma=float(gamma))
        if not certificate:
            return None
        loops = getattr(found.certificate, "loops", None) or (found.certificate,)
        others = (*getattr(found.certificate, "others", ()), certificate)
        joint = FeedbackCertificate.settle(loops=tuple(loops), others=others)
        return replace(found, certificate=joint) if joint else None

    return first_proven((candidate for candidate in roundings(F) if affords()), prove)
