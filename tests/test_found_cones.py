"""A found cone goes into every function that takes one, and a search without a cone is refused in all of them."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import control as ct
import numpy as np
import pytest
from matplotlib import pyplot as plt
from planted import pair, with_dominant_eigenvalue

import control_kpos as kp
from control_kpos.errors import DataError
from control_kpos.find import find_cone
from control_kpos.find.answer import FoundCone

B, C, D, ONE = np.array([[0], [0], [1.0]]), np.array([[0, 0, 1.0]]), np.zeros((1, 1)), kp.orthant(1)
ZERO, LOW, HIGH = np.zeros((1, 3)), [0, 0, 0.0], [0, 0, 1.0]


def turning(rays: int) -> np.ndarray:
    """A stable matrix whose cones have at least that many rays."""
    w = 0.5 * rays / np.pi
    return np.array([[-1, w, 0], [-w, -1, 0], [0, 0, -0.5]])


def searched(A: np.ndarray, **more: Any) -> Any:
    return find_cone(A, **more)


def plant(A: np.ndarray) -> ct.StateSpace:
    return ct.ss(A, B, C, 0)


def drawn(X) -> bool:
    kp.plot_cone(X)
    plt.close("all")
    return True


# Quick at any size, and those that take work that grows with pairs of facets and rays.
QUICK = {
    "state_positivity": lambda A, X: kp.state_positivity(A, X),
    "cone_positivity": lambda A, X: kp.cone_positivity(A, B, C, D, X, ONE, ONE),
    "linear_lyapunov": lambda A, X: kp.linear_lyapunov(A, X, rate=0.25),
    "not stable": lambda A, X: not kp.linear_lyapunov(A + np.eye(3), X),
    "induced_gain": lambda A, X: kp.induced_gain(A, B, C, D, X, ONE, ONE),
    "dissipativity": lambda A, X: kp.dissipativity(A, B, C, D, X, ONE, q=[-1], r=[3], Y=ONE),
    "system": lambda A, X: kp.ConeStateSpace(plant(A), X=X),
    "product": lambda A, X: kp.product([X, ONE]) == kp.product([searched(A).cone, ONE]),
    "times": lambda A, X: (ONE * X).dim == 4,
    "half-spaces": lambda A, X: (
        kp.PolyhedralCone.from_facets([[0, 0, 1.0]]).contains(X)
        or kp.PolyhedralCone.from_facets([[0, 0, -1.0]]).contains(X)
    ),
    "stack": lambda A, X: kp.stack(A=np.array([A] * 2), B=np.array([B] * 2), C=np.array([C] * 2), X=X),
}
MORE = {
    "cone of inputs": lambda A, X: kp.cone_positivity(A, np.eye(3), ZERO, np.zeros((1, 3)), X, X, ONE),
    "cone of outputs": lambda A, X: kp.cone_positivity(A, np.zeros((3, 1)), np.eye(3), np.zeros((3, 1)), X, ONE, X),
    "inputs of a system": lambda A, X: kp.ConeStateSpace(ct.ss(A, np.eye(3), ZERO, 0), X=X, U=X).is_cone_positive(),
    "outputs of a system": lambda A, X: kp.ConeStateSpace(ct.ss(A, 0 * B, np.eye(3), 0), X=X, Y=X).is_cone_positive(),
    "inputs of nodes": lambda A, X: (
        kp.stack(A=np.array([A]), B=np.array([np.eye(3)]), C=np.array([ZERO]), X=X, U=X).U.dim == 3
    ),
    "outputs of nodes": lambda A, X: (
        kp.stack(A=np.array([A]), B=np.array([0 * B]), C=np.array([np.eye(3)]), X=X, Y=X).Y.dim == 3
    ),
    "delayed": lambda A, X: kp.delayed(A, 0.1 * np.eye(3), X=X),
    "switched": lambda A, X: kp.switched([A, A - np.eye(3)], X=X),
    "state_feedback": lambda A, X: kp.state_feedback(plant(A), X=X),
    "output_feedback": lambda A, X: kp.output_feedback(plant(A), X=X),
    "observer_gain": lambda A, X: kp.observer_gain(plant(A), X=X),
    "order_interval": lambda A, X: kp.order_interval(plant(A), searched(A).cone.interior_point, X=X),
    "differential_positivity": lambda A, X: kp.differential_positivity(A, X),
    "intersection": lambda A, X: (kp.PolyhedralCone(np.eye(3)) & X).dim == 3,
    "sum": lambda A, X: (kp.PolyhedralCone(searched(A).cone.rays[:1]) + X) == searched(A).cone,
    "within": lambda A, X: searched(A, within=X),
    "contains": lambda A, X: searched(A, contains=X),
    "plot_cone": lambda A, X: drawn(X),
}
# These want a simplicial cone, and say so.
SIMPLICIAL = {
    "scale_free_feedback": lambda A, X: kp.scale_free_feedback(plant(A), 1, X=X),
    "gain_rate_tradeoff": lambda A, X: kp.gain_rate_tradeoff(plant(A), [0.1, 0.2], X=X),
    "nonlinear_nodes": lambda A, X: kp.nonlinear_nodes(
        lambda x, u, p: [u[0] - x[0], -x[1], -x[2]], n_nodes=2, states=3, X=X
    ),
}
ALL = {**QUICK, **MORE}


@pytest.mark.filterwarnings("ignore::control_kpos.errors.ActuatorLossWarning")
@pytest.mark.parametrize("rays", [10, 100])
@pytest.mark.parametrize("use", ALL)
def test_a_found_cone_goes_into_every_function(use, rays):
    A = turning(rays)
    found = searched(A)
    assert found.n_rays > rays - 2 and ALL[use](A, found) and ALL[use](A, found.cone)


@pytest.mark.parametrize("use", QUICK)
def test_thousands_of_rays_are_taken(use):
    A = turning(2000)
    assert QUICK[use](A, searched(A))


def test_ten_thousand_rays_are_taken():
    A = turning(10**4)
    found = searched(A)
    X = found.cone
    assert found.n_rays == X.n_rays >= 10**4
    assert kp.PolyhedralCone(X.rays) == X and X.is_proper


@pytest.mark.parametrize("use", [*ALL, *SIMPLICIAL])
def test_a_search_without_a_cone_is_refused_with_its_reason(use):
    """A search that excluded every cone, and one that found none."""
    A = turning(10)
    nothing = searched(pair(0.0, 1.0))
    unknown = replace(nothing, status=kp.Status.UNDECIDED, message="Nobody knows.")
    for none, reason in ((nothing, "not real"), (unknown, "Nobody knows")):
        assert isinstance(none, FoundCone) and none.cone is None
        with pytest.raises(DataError, match=f"search that found no cone.*{reason}"):
            {**ALL, **SIMPLICIAL}[use](A, none)


@pytest.mark.parametrize("use", SIMPLICIAL)
def test_those_that_want_a_simplicial_cone_take_a_found_one(use):
    A = np.diag([-1.0, -2, -3])
    assert SIMPLICIAL[use](A, searched(A)) is not None
    with pytest.raises(kp.NotProperConeError, match=r"X has 1\d generators in dimension 3"):
        SIMPLICIAL[use](turning(10), searched(turning(10)))


def test_a_found_cone_proposes_its_own_multipliers(monkeypatch):
    """Of the matrix it was found for, of multiples, and beside multiples of the identity: no linear program for A."""
    n = 30
    A = with_dominant_eigenvalue(0, n, discrete=False)
    found = searched(A)
    X = found.cone
    monkeypatch.setattr("control_kpos.proof.proposed_weights.pointing_functional", lambda _: pytest.fail("a program"))
    for M in (A, 0.3 * A, A - 0.25 * np.eye(n), 2 * A + 1.1 * np.eye(n)):
        for cone in (found, X, pickle.loads(pickle.dumps(X))):
            assert kp.state_positivity(M, cone).check()
    monkeypatch.undo()
    B = X.interior_point[:, None]
    assert kp.ConeStateSpace(A - 9 * np.eye(n), B, np.zeros((1, n)), 0, X=found).is_cone_positive()


def test_multipliers_of_another_matrix_prove_nothing():
    """What is proposed is checked: a wrong proof in the cone is passed over."""
    A = with_dominant_eigenvalue(0, 30, discrete=False)
    X = searched(A).cone
    (found,) = vars(X)["_found"]
    wrong = found._replace(proof=replace(found.proof, multipliers=-found.proof.multipliers))
    vars(X)["_found"] = [wrong, found]
    assert kp.state_positivity(A, X)
