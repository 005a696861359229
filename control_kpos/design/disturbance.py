"""Disturbance rejection: the L-infinity gain from w to z minimised, exactly on simplicial cones.

For x' = (A + B F) x + E w, z = (G + H F) x + D w, positive from w in the orthant to z in the orthant, the L-infinity
gain is the largest row sum of the DC gain.  It is below gamma if and only if some xi > 0 has

    (A + B F) x + E 1 < 0 (in the order of X),   (G + H F) x + D 1 < gamma 1,   x = sum xi_k x_k,

which is linear in xi, z_k = xi_k F x_k and gamma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ..cones import Cone, orthant
from ..errors import DataError, ShapeError
from ..exact.budget import seconds_left
from ..exact.condition import Condition
from ..exact.intake import exact_matrix, require_shape
from ..exact.matrix import Matrix
from ..exact.programs import failure
from ..exact.signs import BilinearForms
from ..proof.certificate import Certificate, Status
from ..proof.weights import Prover
from ..theorems.positivity import PositivityCertificate, cone_positivity
from .accept import (
    FeedbackCertificate,
    accept,
    closed_loop,
    roundings,
)
from .modes import controllability_notes
from .plant import Floats, Plant
from .result import DesignResult
from .simplicial.inequalities import column_rows, gain_from_columns, split
from .simplicial.program import SimplicialProgram, gain_of
from .simplicial.ratio import Solver
from .simplicial.rows import bordered, scaled_rows, stacked
from .simplicial.search import succeed

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
        return DesignResult(Status.REFUTED, certificate=inflow, message=message)
    program = SimplicialProgram(plant, np.ones((plant.n, plant.m), dtype=bool), lp)
    n, m, v = plant.n, plant.m, plant.n * (1 + plant.m)
    values = [np.asarray(M.values) for M in (E, G, H, D)]
    heights = np.einsum("ij,ij->i", plant.facets, plant.rays)
    push = (plant.facets @ values[0]).sum(axis=1) / heights
    i, k = (index.ravel() for index in np.indices((len(values[1]), n)))
    outputs = column_rows((values[1] @ plant.rays.T)[i, k], values[2][i], k, n)
    total = np.hstack([values[1] @ plant.rays.T, np.tile(values[2], (1, n))])
    through = values[3].sum(axis=1)
    fixed = program._fixed(None)
    drift = program._decreasing(rate)

    def solve(gamma: float | None, cost: Floats) -> Any:
        above = stacked(fixed, -outputs, drift)
        right = [np.zeros(fixed.shape[0] + outputs.shape[0]), -push, -through]
        low = np.concatenate([np.full(n, 1e-6), np.full(n * m, -np.inf), [-np.inf]])
        high = np.append(np.full(v, np.inf), np.inf if gamma is None else gamma)
        rows = bordered(above, total, -np.ones(len(total)))
        answer = lp(cost, rows, np.concatenate(right), bounds=(low, high))
        inside = bool(answer) and (answer.x[:n] > 0).all()
        return answer if inside or not answer else failure("the solver returned a point that violates the program")

    first = solve(None, np.append(np.zeros(v), 1.0))
    if not first:
        return DesignResult(
            Status.UNDECIDED,
            objective=LINF_GAIN,
            message=f"the program has no solution ({first.message or first.outcome}): no gain keeps x in X, z in its "
            "orthant, and the loop stable.",
            notes=tuple(controllability_notes(plant)),
        )
    best = float(first.x[-1])
    if gain_of(program.read(first.x[:-1])[0], plant.rays) > _HUGE * max(plant.scale, 1.0):
        message = "the larger the gain, the better, without end; give gain_bound."
        return DesignResult(Status.UNDECIDED, objective=LINF_GAIN, limit=best, message=message)
    for slack in (_SLACK, 1e-2):
        gamma = best + slack * max(abs(best), 1e-6)
        # at this gamma, the smallest |F x_k| with the weights xi of the first point
        xi = first.x[:n]
        slope = scaled_rows(program.slope, 1 / np.tile(np.repeat(xi, m), 2))
        margin = 1e-7 * (abs(program.closed) @ np.abs(first.x[:-1]))
        second = _small(program, fixed, outputs, drift, total, push, through, gamma, slope, margin, lp)
        for point in (p for p in (second, first.x[:-1]) if p is not None):
            xi, columns = split(point, n, m)
            found = _certify(
                plant, gain_from_columns(columns, plant.rays), xi @ plant.rays, gamma, rate, (E, G, H, D), Z
            )
            if found is not None:
                return succeed(plant, found, LINF_GAIN, found.certificate.others[-1].gamma, best)
    return DesignResult(
        Status.UNDECIDED, objective=LINF_GAIN, limit=best, message="a gain was found, but could not be proven."
    )


def _small(
    program: SimplicialProgram,
    fixed: Any,
    outputs: Any,
    drift: Any,
    total: Floats,
    push: Floats,
    through: Floats,
    gamma: float,
    slope: Any,
    margin: Floats,
    lp: Solver,
) -> Floats | None:
    """Minimise the largest entry of |F x_k| (frozen weights) with a little margin in every inequality."""
    n, v = program.n, fixed.shape[1]
    rows = bordered(stacked(fixed, -outputs, drift, total), slope, -np.ones(slope.shape[0]))
    shifted = np.zeros(fixed.shape[0])
    shifted[: len(margin)] = -margin
    for strength in (1.0, 1e-2, 0.0):
        right = np.concatenate(
            [
                strength * shifted,
                np.zeros(outputs.shape[0]),
                -push,
                gamma - through - 1e-6 * abs(gamma),
                np.zeros(slope.shape[0]),
            ]
        )
        low = np.concatenate([np.full(n, 1e-6), np.full(v - n, -np.inf), [0.0]])
        answer = lp(np.append(np.zeros(v), 1.0), rows, right, bounds=(low, np.inf))
        if answer and (answer.x[:n] > 0).all():
            return answer.x[:-1]
    return None


def _certify(plant: Plant, F: Floats, x: Floats, gamma: float, rate: float, data: tuple[Matrix, ...], Z: Cone) -> Any:
    E, G, H, D = data
    for candidate in roundings(F):
        if seconds_left() <= 0:
            return None
        found = accept(plant, candidate, rate=rate)
        if found is None or not np.array_equal(found.F, candidate):
            continue
        out = closed_loop(G, H, candidate)
        positivity = cone_positivity(
            found.closed[0], E, out, D, plant.X, orthant(E.shape[1]), Z, discrete=plant.discrete
        )
        if not positivity:
            continue
        certificate = DisturbanceCertificate.settle(positivity=positivity, x=x, gamma=float(gamma))
        if certificate:
            loops = getattr(found.certificate, "loops", None) or (found.certificate,)
            others = (*getattr(found.certificate, "others", ()), certificate)
            joint = FeedbackCertificate.settle(loops=tuple(loops), others=others)
            if joint:
                return type(found)(found.F, found.closed, joint)
    return None
