"""Compartments: verdicts from flows and outflows alone, residence times and gains with all digits."""

from dataclasses import replace
from fractions import Fraction

import networkx as nx
import numpy as np
import pytest
import scipy.sparse as sp

import control_kpos as kp
from control_kpos.theorems import subtraction_free
from control_kpos.theorems.compartments import CompartmentalCertificate, Trap
from control_kpos.theorems.subtraction_free import Elimination, relative_error


def rates(n, seed, density=0.3):
    rng = np.random.default_rng(seed)
    F = rng.uniform(0.1, 1, (n, n)) * (rng.random((n, n)) < density) * 10.0 ** rng.integers(-6, 6, (n, n))
    np.fill_diagonal(F, 0)
    return F, rng


def inverse(F, o):
    """-A^-1 in fractions."""
    n = len(o)
    M = [[-Fraction(F[i][j]) if i != j else Fraction(0) for j in range(n)] + [Fraction(i == k) for k in range(n)]
         for i in range(n)]  # fmt: skip
    for j in range(n):
        M[j][j] = sum((Fraction(F[i][j]) for i in range(n) if i != j), Fraction(o[j]))
    for k in range(n):
        p = next(i for i in range(k, n) if M[i][k])
        M[k], M[p] = M[p], M[k]
        M[k] = [x / M[k][k] for x in M[k]]
        for i in range(n):
            if i != k and M[i][k]:
                M[i] = [x - M[i][k] * y for x, y in zip(M[i], M[k], strict=True)]
    return np.array([row[n:] for row in M], dtype=object)


@pytest.mark.parametrize("seed", range(30))
def test_the_verdict_is_that_of_the_eigenvalues(seed):
    n = 2 + seed % 6
    F, rng = rates(n, seed, 0.25)
    F = np.round(np.log10(F, where=F > 0, out=np.zeros((n, n))) ** 2, 3)
    o = np.where(rng.random(n) < 0.3, 1.0, 0.0)
    found = kp.compartmental(F, o)
    A = F - np.diag(F.sum(axis=0) + o)
    assert found.check()
    assert bool(found) == (np.linalg.eigvals(A).real.max() < -1e-9)
    if not found:
        inside = found.witness.members.astype(int)
        outside = np.setdiff1d(np.arange(n), inside)
        assert inside.size and not o[inside].any() and not F[np.ix_(outside, inside)].any()


@pytest.mark.parametrize(("n", "leak"), [(4, 1e-10), (8, 1e-60), (12, 1e-200)])
def test_every_entry_has_all_digits(n, leak):
    F, rng = rates(n, n)
    F += np.roll(np.eye(n), 1, axis=1)
    np.fill_diagonal(F, 0)
    o = np.zeros(n)
    o[n // 2] = leak
    B, C = rng.random((n, 2)), rng.random((3, n))
    found = kp.compartmental(F, o, B, C)
    exact = inverse(F, o)
    gain = np.vectorize(Fraction)(C) @ exact @ np.vectorize(Fraction)(B)
    for got, wanted in ((found.gain, gain), (found.residence_times, exact.sum(axis=0))):
        errors = [abs(Fraction(x) - y) / y for x, y in zip(got.ravel().tolist(), wanted.ravel(), strict=True)]
        assert max(errors) <= found.relative_error < 1e-12


def test_what_is_typed_is_what_is_proven():
    found = kp.compartmental([[0, "1/3"], [2, 0]], ["1/7", 0], [["1/3"], [0]], [[0, "1/5"]])
    assert found.system.exact.A.fractions().tolist() == [[Fraction(-15, 7), Fraction(1, 3)], [2, Fraction(-1, 3)]]
    assert found.system.linear_lyapunov()
    exact = Fraction(1, 5) * inverse([[0, Fraction(1, 3)], [2, 0]], [Fraction(1, 7), 0])[1, 0] * Fraction(1, 3)
    assert abs(Fraction(found.gain[0, 0]) - exact) <= found.relative_error * exact


@pytest.mark.parametrize("size", [1.0, 1e-200])  # products by BLAS, and below the range where it is watched
def test_gains_of_several_inputs_and_none(size):
    F, rng = rates(6, 2, 0.6)
    B = np.where(rng.random((6, 4)) < 0.5, size, 0)
    found = kp.compartmental(F, np.ones(6), B)
    wanted = inverse(F, np.ones(6)) @ np.vectorize(Fraction)(B)
    assert found.gain == pytest.approx(np.array(wanted, dtype=float), rel=1e-12, abs=0)
    assert kp.compartmental(F, np.ones(6), np.zeros((6, 0))).gain.shape == (6, 0)
    tiny = np.full((6, 1), 5e-324)
    with pytest.raises(kp.UndecidedError):
        _ = kp.compartmental(F, np.full(6, 3.0), tiny).gain


def test_names_that_python_control_refuses():
    graph = nx.DiGraph([("a.b", 1.5)])
    found = kp.compartmental(graph, {1.5: 1})
    assert found.names == ("a.b", "1.5") and found.system.state_labels == ["x[0]", "x[1]"]
    assert "Never drained: a.b, 1.5." in kp.compartmental(graph, {}).explain()


def test_mass_balance():
    F, rng = rates(6, 5, 0.6)
    o = rng.random(6)
    found = kp.compartmental(F, o)
    assert np.allclose(o @ found.gain, 1)  # in a steady state what flows in leaves
    exact = found.system.exact.A.fractions()
    assert (exact.sum(axis=0) == [-Fraction(x) for x in o]).all()


def test_graphs_have_names():
    graph = nx.DiGraph()
    graph.add_edge("blood", "tissue", weight=0.5)
    graph.add_edge("tissue", "blood", weight="1/3")
    found = kp.compartmental(graph, [0.25, 0])
    system = found.system
    assert found and system.state_labels == system.input_labels == system.output_labels == ["blood", "tissue"]
    assert kp.compartmental(graph, {"blood": 0.25}, [[1], [0]]).system.input_labels == ["u[0]"]
    assert np.allclose(found.residence_times, [(1 + 0.5 * 3) * 4, (1 + 0.5 * 3) * 4 + 3])
    both = kp.compartmental(nx.path_graph(3), [0, 0, 1])
    assert np.array_equal(both.certificate.flows.values.toarray(), nx.to_numpy_array(nx.path_graph(3)))


def test_a_chain_of_many():
    n = 20_000
    chain = sp.csr_array(sp.eye_array(n, k=1) + sp.eye_array(n, k=-1))
    leak = np.zeros(n)
    assert kp.compartmental(chain, leak).status is kp.Status.REFUTED
    leak[7] = 1e-200
    found = kp.compartmental(chain, leak, np.eye(n, 1), np.eye(2, n))
    assert found and found.check()
    assert found.relative_error < 1e-9
    assert np.abs(found.residence_times / (n * 1e200) - 1).max() < 1e-12
    assert np.abs(found.gain / 1e200 - 1).max() < 1e-12
    with pytest.raises(kp.TooLargeError, match="20000 inputs and 20000 outputs"):
        _ = kp.compartmental(chain, leak).gain
    with pytest.raises(kp.TooLargeError, match="20000"):
        _ = found.system


@pytest.mark.parametrize("seed", range(6))
def test_rounds_of_elimination_lose_nothing(seed, monkeypatch):
    monkeypatch.setattr(subtraction_free, "_FEW", 3)
    monkeypatch.setattr(subtraction_free, "_FILLED", 0.9)
    n = 12
    F, rng = rates(n, seed, 0.15)
    F = F * 10.0 ** rng.integers(-6, 6, (n, n)) + np.roll(np.eye(n), 1, axis=1)
    np.fill_diagonal(F, 0)
    o = np.where(np.arange(n) == 3, 1e-12, 0.0)
    C = rng.random((2, n))
    exact = inverse(F, o)
    gain = np.vectorize(Fraction)(C) @ exact
    found = kp.compartmental(sp.csr_array(F), o, None, C)
    assert len(found._factors.rounds) > 1
    for got, wanted in ((found.gain, gain), (found.residence_times, exact.sum(axis=0))):
        errors = [abs(Fraction(x) - y) / y if y else x for x, y in zip(got.flat, wanted.flat, strict=True)]
        assert max(errors) <= found.relative_error < 1e-12
    monkeypatch.setattr(subtraction_free, "LARGEST", 2)
    with pytest.raises(kp.TooLargeError, match=r"of 12 compartments are left, with .* the limit is 2"):
        Elimination(sp.csr_array(F.T), o)
    with pytest.raises(kp.TooLargeError, match="12 compartments are eliminated as a dense matrix; the limit is 2"):
        Elimination(F.T, o)


def test_panels_lose_nothing(monkeypatch):
    monkeypatch.setattr(subtraction_free, "_PANEL", 4)
    n = 11
    for seed, low in ((0, 1.0), (1, 1e-100)):
        F, _ = rates(n, seed, 0.9)
        F[0, -1] *= low
        F[-1, 0] = 1e-3 * low
        o = np.where(np.arange(n) == 5, 1e-12, 0.0)
        exact = inverse(F, o)
        found = kp.compartmental(F, o)
        for got, wanted in ((found.gain, exact), (found.residence_times, exact.sum(axis=0))):
            errors = [abs(Fraction(x) - y) / y for x, y in zip(got.flat, wanted.flat, strict=True)]
            assert max(errors) <= found.relative_error < 1e-12
    left, right = np.array([[1e-160, 0], [2, 1]]), np.array([[1e-140, 3], [1e-200, 1]])
    assert np.array_equal(subtraction_free.product(left, right), [[1e-300, 3e-160], [2e-140, 7]])


def test_numbers_that_scipy_would_let_out_of_range(monkeypatch):
    monkeypatch.setattr(subtraction_free, "_FEW", 1)
    monkeypatch.setattr(subtraction_free, "_FILLED", 2.0)
    for size in (1e-300, 1.7e308):
        star = sp.csr_array(np.array([[0, size, size], [size, 0, 0], [size, 0, 0]]))
        with pytest.raises(kp.UndecidedError, match="leaves the range"):
            Elimination(star, np.array([1.7e308, 1e-300, 1.7e308])).solve(np.full((3, 1), 1e-300))


def test_a_chain_with_absorbing_states_is_drained_into_them():
    # A gambler's ruin: states 1, 2, 3, absorbed at 0 and 4.
    half = Fraction(1, 2)
    walk = nx.DiGraph([(a, b, {"weight": half}) for a in (1, 2, 3) for b in (a - 1, a + 1) if b in (1, 2, 3)])
    ruined = kp.compartmental(walk, {1: half, 3: "1/2"})
    at = {name: ruined.names.index(name) for name in "123"}
    assert np.allclose(ruined.residence_times[[at["1"], at["2"], at["3"]]], [3, 4, 3])  # steps, on average
    assert np.allclose(ruined.gain[at["1"]] / 2 + ruined.gain[at["3"]] / 2, 1)  # one of both ends is reached
    closed = kp.compartmental(nx.DiGraph([("up", "down"), ("down", "up")]), {})
    assert closed.status is kp.Status.REFUTED and closed.explain().endswith("Never drained: up, down.")
    numbered = kp.compartmental([[0, 1], [1, 0]], {1: "1/3"})
    assert numbered.certificate.outflows.fractions().tolist() == [[0, Fraction(1, 3)]]


def test_a_laplacian_that_is_not_symmetric_is_transposed():
    W, rng = rates(5, 2, 0.8)
    o, B, C = rng.random(5), rng.random((5, 1)), rng.random((2, 5))
    L = np.diag(W.sum(axis=1)) - W
    gain = C @ np.linalg.solve(L + np.diag(o), B)
    assert np.allclose(kp.compartmental(W.T, o, C.T, B.T).gain.T, gain, rtol=1e-6)


def test_wrong_certificates_are_noticed():
    cert = kp.compartmental([[0, 0], [1, 0]], [0, 1]).certificate
    assert cert and cert.check()
    settle = CompartmentalCertificate.settle
    data = {"flows": cert.flows, "outflows": cert.outflows}
    for levels in ([0, 1], [1, 1]):
        assert not settle(**data, levels=np.array(levels, dtype=float))
        assert not replace(cert, levels=np.array(levels, dtype=float)).check()
    assert not replace(cert, outflows=-cert.outflows).check()
    assert not replace(cert, flows=cert.flows.T).check()
    for members in ([0.0], [1.0], [], [0.5], [2.0], [-1.0]):
        assert settle(**data, witness=Trap(np.array(members))).status is kp.Status.UNDECIDED
    trapped = kp.compartmental([[0, 0], [1, 0]], [1, 0]).certificate
    assert trapped.status is kp.Status.REFUTED and trapped.witness.members.tolist() == [1]
    assert not replace(trapped, outflows=cert.outflows).check()


def test_rates_that_doubles_cannot_multiply():
    chain = kp.compartmental([[0, 0, 1e-300], [1e300, 0, 0], [0, 1e-300, 0]], [1e-300, 0, 0])
    assert chain
    with pytest.raises(kp.UndecidedError, match="leaves the range of doubles"):
        _ = chain.residence_times
    tiny = kp.compartmental([[0, Fraction(1, 10**320)], [1, 0]], [1, 0])
    with pytest.raises(kp.UndecidedError, match="below the range"):
        _ = tiny.residence_times


def test_no_inputs_or_no_outputs():
    assert kp.compartmental([[0, 1], [1, 0]], [1, 0], np.zeros((2, 0))).gain.shape == (2, 0)
    assert kp.compartmental([[0, 1], [1, 0]], [1, 0], None, np.zeros((0, 2))).gain.shape == (0, 2)


def test_rates_below_the_range_of_doubles_count():
    found = kp.compartmental([[0, "1e-400"], [1, 0]], ["1e-400", 0])
    assert found and found.check()
    assert found.system.linear_lyapunov()
    with pytest.raises(kp.DataError, match=r"flows\[1, 0\] is below 0"):
        kp.compartmental([[0, 1], ["-1e-400", 0]], [1, 0])
    with pytest.raises(kp.DataError, match=r"flows\[0, 0\] is above 0, a flow from a compartment to itself"):
        kp.compartmental([["1e-400", 1], [1, 0]], [1, 0])
    many = nx.path_graph(4000)
    nx.set_edge_attributes(many, "1/3", "weight")
    with pytest.raises(kp.TooLargeError, match="flows of 4000 x 4000 with decimals or fractions"):
        kp.compartmental(many, {0: 1})


def test_no_gain_without_a_drain():
    stuck = kp.compartmental([[0, 1], [1, 0]], [0, 0])
    with pytest.raises(kp.KposError, match="never leaves"):
        _ = stuck.gain


def test_the_bound_counts_every_rounding():
    n = 5
    full = Elimination(np.ones((n, n)), np.ones(n))
    assert full.roundings == sum(2 * k * (k + 4) + 2 * k + 2 for k in range(n)) + 2 * n
    assert full.roundings <= relative_error(full.roundings) * 2**53 <= 1.02 * full.roundings
    assert relative_error(10**15) == np.inf
    assert Elimination(np.zeros((1, 1)), np.array([4.0])).solve(np.array([[2.0]])).tolist() == [[0.5]]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (([[0, 1, 0], [1, 0, 0]], [1, 1]), "flows is 2 x 3, but must be 2 x 2"),
        (([[0, 1], [1, 0]], [1]), "outflows has 1 entries; it must have 2"),
        (([[0, -1], [1, 0]], [1, 1]), r"flows\[0, 1\] is -1"),
        (([[-1, 0], [1, 0]], [1, 1]), r"flows\[0, 0\] is -1; .*leave out the diagonal"),
        (([[2, 1], [1, 0]], [1, 1]), r"flows\[0, 0\] is 2, a flow from a compartment to itself"),
        (([[0, 1], [1, 0]], [1, "-1/3"]), r"outflows\[1\] is -0.333"),
        (([[0, 1], [1, 0]], [1, 0], [[1]]), "B is 1 x 1, but must be 2 x any"),
        (([[0, 1], [1, 0]], [1, 0], [[1], [-1]]), r"B\[1, 0\] is -1"),
        (([[0, 1], [1, 0]], [1, 0], None, [[1, 0, 0]]), "C is 1 x 3, but must be any x 2"),
        ((np.zeros((0, 0)), []), "flows has no compartments"),
        ((nx.MultiGraph(), []), "flows is a multigraph"),
        ((nx.path_graph(2), {5: 1}), "outflows has a rate for 5, which is no compartment; the compartments are 0, 1"),
        (([[0, 1], [1, 0]], {2: 1}), "outflows has a rate for 2"),
    ],
)
def test_bad_arguments(arguments, says):
    with pytest.raises(kp.KposError, match=says):
        kp.compartmental(*arguments)
