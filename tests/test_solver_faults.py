"""Whatever a solver answers, nothing false is proven: faults in every linear program and linear solve."""

import time
from contextlib import suppress

import certified
import numpy as np
import pytest
import scipy.sparse.linalg as spla
from scipy.linalg import lapack

import control_kpos as kp
from control_kpos import linear_programs, perron, rational_programs, storage
from control_kpos.linear_programs import Solution

RNG = np.random.default_rng(7)


def raises(*_, **__):
    raise RuntimeError("the solver failed")


def out_of_memory(*_, **__):
    raise MemoryError


def singular(*_, **__):
    raise np.linalg.LinAlgError("Singular matrix")


VECTORS = {
    "nan": lambda n: np.full(n, np.nan),
    "infinite": lambda n: np.full(n, np.inf),
    "zero": np.zeros,
    "random": RNG.standard_normal,
    "huge": lambda n: RNG.standard_normal(n) * 1e300,
    "positive garbage": RNG.random,
}
FALSE = {  # claims that are false: never PROVED, whatever the solvers say
    "unstable": lambda: kp.linear_lyapunov([[-1, 2], [2, -1]], kp.orthant(2)),
    "unstable, rate": lambda: kp.linear_lyapunov([[-1, 2], [2, -1]], kp.orthant(2), rate="max"),
    "marginal": lambda: kp.linear_lyapunov([[-1, 1], [1, -1]], kp.orthant(2)),
    "unstable, square": lambda: kp.linear_lyapunov([[-1, 0, 0], [0, -1, 0], [0, 0, 0.5]], certified.SQUARE),
    "not dissipative": lambda: certified.scalar_supply(0.4),
    "network": lambda: certified.network(certified.mass_springs(), 30 * kp.examples.ring(4)),
}
TRUE = {  # claims that are true: never REFUTED
    "stable": lambda: kp.linear_lyapunov([[-3, 1], [1, -3]], kp.orthant(2)),
    "stable, rate": lambda: kp.linear_lyapunov([[-3, 1], [1, -3]], kp.orthant(2), rate="max"),
    "dissipative": lambda: certified.scalar_supply(0.6),
    "network": lambda: certified.network(certified.mass_springs(), kp.examples.ring(4)),
}


def never_wrong():
    for claim in FALSE.values():
        with suppress(kp.KposError):
            assert claim().status is not kp.Status.PROVED
    for claim in TRUE.values():
        with suppress(kp.KposError):
            assert claim().status is not kp.Status.REFUTED


@pytest.mark.parametrize("name", VECTORS)
def test_dense_solves_that_return_garbage(name, monkeypatch):
    make = VECTORS[name]
    monkeypatch.setattr(lapack, "dgetrs", lambda lu, piv, b, **_: (make(np.shape(b)[0]).reshape(np.shape(b)), 0))
    monkeypatch.setattr(np.linalg, "solve", lambda a, b: make(np.size(b)).reshape(np.shape(b)))
    monkeypatch.setattr(np.linalg, "lstsq", lambda a, b, **_: (make(np.shape(a)[1]), None, 0, None))
    never_wrong()


@pytest.mark.parametrize("name", VECTORS)
def test_sparse_solves_that_return_garbage(name, monkeypatch):
    make = VECTORS[name]

    class Factors:
        def __init__(self, matrix, *_, **__):
            self.shape = matrix.shape

        def solve(self, b, *_):
            return make(np.size(b)).reshape(np.shape(b))

    monkeypatch.setattr(spla, "splu", Factors)
    never_wrong()


@pytest.mark.parametrize("fault", [raises, singular])
def test_factorisations_that_fail(fault, monkeypatch):
    monkeypatch.setattr(perron.ScaledProblem, "_solver", lambda *_: (_ for _ in ()).throw(perron.SingularMatrixError()))
    monkeypatch.setattr(np.linalg, "solve", singular)
    never_wrong()
    assert kp.linear_lyapunov([[-3, 1], [1, -3]], kp.orthant(2))  # settled in rational arithmetic
    assert kp.linear_lyapunov([[-1, 2], [2, -1]], kp.orthant(2)).status is kp.Status.REFUTED


def programs(monkeypatch, answer):
    for module in (linear_programs, rational_programs, storage):
        monkeypatch.setattr(module, "solve", answer)


def garbage(make, outcome="optimal", wrong_length=False):
    def answer(c, A_ub=None, b_ub=None, A_eq=None, b_eq=None, bounds=None, **_):
        n = np.size(c)
        rows = sum(0 if b is None else np.size(b) for b in (b_ub, b_eq))
        basic = RNG.permutation(n + rows)[:rows]
        return Solution(outcome, make(n + 3 * wrong_length), 0.0, basic)

    return answer


@pytest.mark.parametrize("name", VECTORS)
def test_linear_programs_that_return_garbage(name, monkeypatch):
    programs(monkeypatch, garbage(VECTORS[name]))
    never_wrong()


@pytest.mark.parametrize("outcome", ["infeasible", "unbounded", "failed"])
def test_linear_programs_that_give_up(outcome, monkeypatch):
    programs(monkeypatch, garbage(lambda n: np.empty(0), outcome))
    never_wrong()
    assert certified.scalar_supply(0.6)
    assert certified.scalar_supply(0.4).status is kp.Status.REFUTED


@pytest.mark.parametrize("fault", [raises, out_of_memory, KeyError])
def test_a_solver_that_raises_is_an_answer(fault, monkeypatch):
    def fail(*_, **__):
        raise fault if isinstance(fault, type) else fault()

    monkeypatch.setattr(linear_programs, "_run_highs", fault if fault is not KeyError else fail)
    answer = linear_programs.solve([1.0], A_ub=[[1.0]], b_ub=[1.0])
    assert answer.outcome == "failed" and "raised" in answer.message
    never_wrong()


def test_a_solver_that_hangs_is_left_behind(monkeypatch):
    monkeypatch.setattr(linear_programs, "_run_highs", lambda *_: time.sleep(30))
    start = time.monotonic()
    answer = linear_programs.solve([1.0], A_ub=[[1.0]], b_ub=[1.0], time_limit=0.2)
    assert answer.outcome == "failed" and time.monotonic() - start < 0.2 + 2


def test_interruption_leaves_objects_usable(monkeypatch):
    A, X = [[-3, 1], [1, -3]], kp.orthant(2)
    positivity = kp.state_positivity(A, X)

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(perron.ScaledProblem, "left_vector", interrupt)
        with pytest.raises(KeyboardInterrupt):
            kp.linear_lyapunov(A, X)
    assert positivity.check() and kp.linear_lyapunov(A, X)
    cone = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])
    with monkeypatch.context() as patch:
        patch.setattr("control_kpos.cones.polyhedral.convert", interrupt)
        with pytest.raises(KeyboardInterrupt):
            _ = cone.facets
    assert cone.n_facets == 4
