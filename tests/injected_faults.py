"""Numerical routines that fail now and then, and claims whose truth is known."""

import control as ct
import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from scipy.linalg import lapack
from strategies import without_facets

import control_kpos as kp
from control_kpos.exact import programs as linear_programs
from control_kpos.exact.programs import Solution

PROVED, REFUTED = kp.Status.PROVED, kp.Status.REFUTED
X2, LINE, PAPER = kp.orthant(2), kp.orthant(1), kp.examples.paper_cone()
SQUARE_RAYS = [[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]
STATIC = [kp.ConeStateSpace([[-2]], [[1]], [[1]], [[0.5]])]
INWARDS = [[-2, 0.1, 0], [0, -3, 0.2], [0, 0, -1]], [[0.5], [0], [0.9]], [[0, 0, 1]], [[0]]
SIMPLE = [kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)]


def chain(weight, size=40):
    return sp.diags_array([weight, -3.0, weight], offsets=[-1, 0, 1], shape=(size, size)).tocsr()


def square():
    return kp.PolyhedralCone(SQUARE_RAYS)  # a new one every time, whose facets are not known yet


def unlisted():
    return without_facets(np.array(SQUARE_RAYS, dtype=float))


def ring(nodes, weight):
    return kp.feedback_interconnect(nodes, weight * kp.examples.ring(len(nodes)))


def pendulum(damping):
    system = ct.nlsys(lambda t, x, u, p: [x[1], -np.sin(x[0]) - damping * x[1]], None, inputs=0, states=2)
    return kp.differential_positivity(system, [[1, 0], [1, -2]], [[-1.5, 1.5], [-9, 9]])


def scalar(r):
    return kp.dissipativity([[-2]], [[1]], [[1]], [[0]], LINE, LINE, LINE, q=[-1], r=[r])


def verdict(answer):
    return PROVED if answer else REFUTED


def find(A, **more):
    return kp.find_cone(A, restarts=2, time_limit=3.0, **more).certificate


CLAIMS = {
    "stable": (lambda: kp.linear_lyapunov([[-3, 1], [1, -3]], X2), PROVED),
    "stable, rate": (lambda: kp.linear_lyapunov([[-3, 1], [1, -3]], X2, rate="max"), PROVED),
    "unstable": (lambda: kp.linear_lyapunov([[-1, 2], [2, -1]], X2), REFUTED),
    "unstable, rate": (lambda: kp.linear_lyapunov([[-1, 2], [2, -1]], X2, rate="max"), REFUTED),
    "marginal": (lambda: kp.linear_lyapunov([[-1, 1], [1, -1]], X2), REFUTED),
    "stable, square": (lambda: kp.linear_lyapunov(np.diag([-1, -1, -0.5]), square()), PROVED),
    "unstable, square": (lambda: kp.linear_lyapunov(np.diag([-1, -1, 0.5]), square()), REFUTED),
    "stable, discrete": (lambda: kp.linear_lyapunov([[0.5, 0.2], [0.2, 0.5]], X2, discrete=True), PROVED),
    "stable, sparse": (lambda: kp.linear_lyapunov(chain(1.0), kp.orthant(40)), PROVED),
    "unstable, sparse": (lambda: kp.linear_lyapunov(chain(2.0), kp.orthant(40)), REFUTED),
    "dissipative": (lambda: scalar(0.6), PROVED),
    "on the boundary": (lambda: scalar(0.5), REFUTED),
    "not dissipative": (lambda: scalar(0.4), REFUTED),
    "network": (lambda: ring([kp.examples.mass_spring_node()] * 4, 1).certificate, PROVED),
    "unstable network": (lambda: ring([kp.examples.mass_spring_node()] * 4, 30).certificate, REFUTED),
    "algebraic loops": (lambda: ring(STATIC * 4, 0.4).certificate, PROVED),
    "unstable, algebraic loops": (lambda: ring(STATIC * 4, 1.9).certificate, REFUTED),
    "abscissa": (lambda: ring([kp.examples.mass_spring_node()] * 4, 1).abscissa_certificate(), PROVED),
    "scale-free": (lambda: kp.scale_free_certificate(SIMPLE, 1.9), PROVED),
    "not scale-free": (lambda: kp.scale_free_certificate(SIMPLE, 2.1), REFUTED),
    "cone": (lambda: find([[-1, 4, 0], [-4, -1, 0], [0, 0, 1]]), PROVED),
    "no cone": (lambda: find([[0, 1], [-1, 0]]), REFUTED),
    "cone of a family": (lambda: find([[[-2, 1], [1, -2]], [[-3, 1], [2, -2]]]), PROVED),
    "no cone of a family": (lambda: find([[[1, 0], [0, -1]], [[0, 1], [-1, 0]]]), REFUTED),
    "cone with ports": (lambda: find([[-1, 1], [0, -2]], contains=[[0, 1]], within=[[1, 0]]), PROVED),
    "nonlinear": (lambda: pendulum(3), PROVED),
    "not monotone": (lambda: pendulum(0.1), REFUTED),
    "cone of thousands of generators": (lambda: find([[-2e-3, 1, 0], [-1, -2e-3, 0], [0, 0, 0]]), PROVED),
    "positive, from generators": (lambda: kp.cone_positivity(*INWARDS, unlisted(), LINE, LINE), PROVED),
    "not positive, from generators": (lambda: kp.state_positivity(np.diag([1, 1, 0.5])[::-1], unlisted()), REFUTED),
    "stable, from generators": (lambda: kp.linear_lyapunov(INWARDS[0], unlisted()), PROVED),
    "unstable, from generators": (lambda: kp.linear_lyapunov(np.diag([-1, -1, 0.5]), unlisted()), REFUTED),
    "facets": (lambda: verdict(square().n_facets == 4), PROVED),
    "inside": (lambda: verdict(kp.lorentz(3, 12).contains([1, 0.9, 0])), PROVED),
    "outside": (lambda: verdict(kp.lorentz(3, 12).contains([1, 1.01, 0])), REFUTED),
}

ROUTINES = {
    **{
        f"numpy.linalg.{n}": (np.linalg, n)
        for n in ("solve", "inv", "eig", "eigvals", "lstsq", "svd", "pinv", "qr", "cond")
    },
    **{f"scipy.linalg.{n}": (sl, n) for n in ("solve", "eig", "eigvals", "schur", "expm", "null_space", "orth")},
    **{f"lapack.{n}": (lapack, n) for n in ("dgetrf", "dgetrs", "dgebal")},
    **{f"sparse.{n}": (spla, n) for n in ("splu", "eigs", "lsqr")},
    "HiGHS": (linear_programs, "_run_highs"),
}
ERRORS = {
    "raises": RuntimeError("injected"),
    "no convergence": np.linalg.LinAlgError("injected"),
    "memory": MemoryError(),
}
OUTCOMES = ("infeasible", "unbounded", "failed")  # of a linear program
VALUES = {
    "NaN": lambda a, rng: np.full(a.shape, np.nan),
    "infinite": lambda a, rng: np.full(a.shape, np.inf),
    "zero": lambda a, rng: np.zeros(a.shape),
    "random": lambda a, rng: rng.standard_normal(a.shape),
    "positive": lambda a, rng: rng.random(a.shape),
    "huge": lambda a, rng: 1e300 * rng.standard_normal(a.shape),
    "flipped": lambda a, rng: -a,
    "wrong length": lambda a, rng: a[..., :-1] if a.ndim else a,
}


def corrupted(answer, value, rng):
    """An answer with its floating-point arrays replaced."""
    if isinstance(answer, tuple):
        return tuple(corrupted(part, value, rng) for part in answer)
    array = np.asarray(answer)
    if array.dtype.kind not in "fc":
        return _Factors(answer, value, rng) if isinstance(answer, spla.SuperLU) else answer
    out = value(array, rng).astype(array.dtype, copy=False)
    return out if array.ndim else out[()]


class _Factors:
    """Sparse factors whose solves are corrupted."""

    def __init__(self, factors, value, rng):
        self.factors, self.value, self.rng, self.shape, self.U = factors, value, rng, factors.shape, factors.U

    def solve(self, b, *more):
        return corrupted(self.factors.solve(b, *more), self.value, self.rng)


def faulty(routine, fault, share, rng):
    """The routine, failing in this share of its calls."""

    def call(*arguments, **more):
        fails = rng.random() < share
        if fails and fault in ERRORS:
            raise ERRORS[fault]
        answer = routine(*arguments, **more)
        if fails and isinstance(answer, Solution):
            return lie(fault, np.size(arguments[0]), answer, rng)
        return corrupted(answer, VALUES[fault], rng) if fails else answer

    return call


def lie(fault, size, answer, rng):
    """A linear program's answer with a wrong point, a wrong basis or a wrong outcome."""
    if fault in OUTCOMES:
        return Solution(fault, np.empty(0), message="so it says")
    x = VALUES[fault](answer.x if answer.x.size == size else np.ones(size), rng)
    basis = None if answer.basic is None else rng.permutation(size + answer.basic.size)[: answer.basic.size]
    return Solution("optimal", x, float(rng.standard_normal()), basis)


def used_routines(monkeypatch):
    """How often each claim calls each routine: {claim: {routine: count}}."""
    calls = {}

    def counting(label, name, original):
        def call(*arguments, **more):
            calls[label][name] = calls[label].get(name, 0) + 1
            return original(*arguments, **more)

        return call

    for label, (claim, truth) in CLAIMS.items():
        calls[label] = {}
        with monkeypatch.context() as patch:
            for name, (module, attribute) in ROUTINES.items():
                original = getattr(module, attribute)
                patch.setattr(module, attribute, counting(label, name, original))
            answer = claim()
        assert (answer if isinstance(answer, kp.Status) else answer.status) is truth, label
    return calls
