"""Optimal control of networks in sparse matrices: the dense route, linear programs, forged certificates, refusals."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

import control_kpos as kp
from control_kpos import checker
from control_kpos.design.optimal.arguments import Question, closed_loop_of
from control_kpos.design.optimal.certificate import GrowingCost
from control_kpos.design.optimal.routes import network_route, system_route
from control_kpos.design.optimal.search import OptimalFeedback, solved
from control_kpos.design.running import within
from control_kpos.errors import DataError, ShapeError
from control_kpos.exact.layers import height, sparse_product, tower

PAPER = kp.PolyhedralCone([[0, 1], [1, -2]])
SQUARE = kp.PolyhedralCone([[1, 1, 2], [1, -1, 2], [-1, 1, 2], [-1, -1, 2]])
CONES = (kp.orthant(1), kp.orthant(2), PAPER, SQUARE)


def transport(n, links=3, seed=0, discrete=True, **more):
    """What is in a node moves along links and leaks; a control moves up to half as much more or less along each."""
    rng, size = np.random.default_rng(seed), n * links
    j = np.repeat(np.arange(n), links)
    k = (j + rng.integers(1, n, size=size)) % n
    w = rng.uniform(0.03, 0.1, size=size)
    gone = np.bincount(j, w, minlength=n) + rng.uniform(0.02, 0.3, size=n)
    nodes = kp.stack((discrete - gone)[:, None, None], np.ones((1, 1)), np.ones((1, 1)), dt=discrete)
    ends = np.concatenate([k, j]), np.tile(np.arange(size), 2)
    controls = sp.csr_array((np.concatenate([np.ones(size), -np.ones(size)]), ends), shape=(n, size))
    limits = sp.csr_array((0.5 * w, (np.arange(size), j)), shape=(size, n))
    net = kp.feedback_interconnect(nodes, sp.csr_array((w, (k, j)), shape=(n, n)), progress=False)
    return {"sys": net, "s": rng.uniform(0.5, 2, size=n), "r": rng.uniform(0, 0.3, size=size), "limits": limits} | {
        "controls": controls,
        **more,
    }


def by_route(route, sys, s, r, limits, controls=None, groups=None, use_all=False, disturbance=None, discount=None):
    """The answer of one route, whatever the size."""
    question = Question(s, r, limits, groups, use_all, disturbance, discount)
    found = route(question, sys, None, controls)
    return within(None, lambda lp: solved(found, lp), answer=OptimalFeedback)


def random_network(rng, cones=CONES):
    """Nodes on random cones, links, and controls that start and end anywhere; with a rest of the limits that do."""
    discrete, count = bool(rng.integers(2)), int(rng.integers(2, 6))
    nodes = []
    for X in (cones[rng.integers(len(cones))] for _ in range(count)):
        n, R, H = X.dim, np.asarray(X.rays), np.asarray(X.facets)
        A = R.T @ rng.random((len(R), len(H))) @ H
        A *= rng.uniform(0.1, 0.4) / np.abs(np.linalg.eigvals(A)).max()
        B, C = R.T @ rng.random((len(R), 1)), rng.random((1, len(H))) @ H
        nodes.append(kp.ConeStateSpace(A if discrete else A - np.eye(n), B, C, 0, discrete, X=X))
    W = 0.1 * rng.random((count, count))
    net = kp.feedback_interconnect(nodes, W, progress=False)
    m = int(rng.integers(1, 5))
    controls = rng.normal(size=(count, m)) * (rng.random((count, m)) < 0.7)
    H, R = np.asarray(net.X.facets), np.asarray(net.X.rays)
    sender = np.repeat(np.arange(count), [node.X.n_facets for node in nodes])[None] == rng.integers(count, size=(m, 1))
    L = (rng.uniform(0.1, 1, size=sender.shape) * sender) @ H
    pushed, free = np.einsum("hm,km->hk", np.abs(H @ net.B @ controls), R @ L.T), H @ net.A @ R.T
    where = (pushed > 1e-12) & (np.ones(free.shape, dtype=bool) if discrete else np.asarray(net.X.incidence))
    L = L * max(0.0, min(1, 0.999 * (free[where] / pushed[where]).min(initial=1)))
    s, r = rng.uniform(0.1, 1, size=len(H)) @ H, 0.2 * rng.normal(size=m)
    r = r * min(1, 0.9 * (R @ s / np.maximum((R @ L.T) @ np.abs(r), 1e-300)).min())
    return net, s, r, L, controls


@pytest.mark.parametrize("seed", range(40))
def test_the_sparse_and_the_dense_route_agree(seed):
    rng = np.random.default_rng(seed)
    net, s, r, L, controls = random_network(rng)
    m, n = L.shape
    more = {}
    if seed % 4 == 1:
        more = {"groups": np.sort(rng.integers(0, 2, size=m)) if m > 3 else np.zeros(m, dtype=int)}
        more["groups"] = np.unique(more["groups"], return_inverse=True)[1]
        L = L[: more["groups"].max() + 1] / (2 * m)
    if seed % 4 == 2:
        more = {"disturbance": (1e-3 * rng.normal(size=(n, 1)), 1e-3 * np.asarray(net.X.facets).sum(axis=0)[None])}
    if seed % 4 == 3:
        more = {"discount": 0.5}
    a = by_route(system_route, net, s, r, L, controls, **more)
    b = by_route(network_route, net, s, r, sp.csr_array(L), sp.csr_array(controls), **more)
    assert a.status is b.status, (a.message, b.message)
    assert a.message == b.message
    if a:
        assert b.check() and b.certificate.gap <= 1e-6 and b.iterations <= 12
        np.testing.assert_allclose(np.asarray(net.X.rays) @ b.cost, np.asarray(net.X.rays) @ a.cost, rtol=1e-7)
        assert sp.issparse(b.F) and b.closed_loop.model.n_nodes == net.model.n_nodes
        loop = net.A + net.B @ controls @ b.F.toarray()
        np.testing.assert_allclose(b.closed_loop.A, loop, atol=1e-12 * np.abs(loop).max())


@pytest.mark.parametrize("seed", range(20))
def test_both_routes_refuse_the_same_limits(seed):
    """Twice what (a) allows, somewhere; s is raised so that costs stay positive."""
    net, s, r, L, controls = random_network(np.random.default_rng(seed))
    a, b = (
        by_route(route, net, 3 * s, r, form(2.1 * L), form(controls))
        for route, form in ((system_route, np.asarray), (network_route, sp.csr_array))
    )
    assert a.status is b.status and bool(a.message) == bool(b.message)
    places = [answer.message.partition(" at generator")[0].partition("facet")[0] for answer in (a, b)]
    assert places[0] == places[1]


def test_most_random_networks_have_a_proven_policy():
    rng = np.random.default_rng(0)
    answers = [by_route(network_route, *random_network(rng)) for _ in range(20)]
    assert sum(map(bool, answers)) >= 15 and sum(bool(a) and a.F.nnz > 0 for a in answers) >= 10


# -- the closed loop without rounding


def fractions(M):
    return np.array([[Fraction(x) for x in row] for row in M.toarray().tolist()], dtype=object)


@pytest.mark.parametrize("seed", range(6))
def test_products_of_sparse_doubles_are_not_rounded(seed):
    rng = np.random.default_rng(seed)
    a = sp.random_array((7, 9), density=0.4, rng=rng, format="csr")
    b = sp.random_array((9, 6), density=0.4, rng=rng, format="csr")
    b.data *= 2.0 ** rng.integers(-60, 60, size=b.nnz)
    terms = sparse_product(a, b)
    assert (sum(map(fractions, terms)) == fractions(a) @ fractions(b)).all()
    layers = tower(terms)
    assert height(layers, 7) > 1
    assert (fractions(layers.values).reshape(-1, 7, 6).sum(axis=0) == fractions(a) @ fractions(b)).all()
    whole = sp.csr_array(np.round(4 * a.toarray()))
    assert height(tower(sparse_product(whole, sp.csr_array(np.eye(9)[:, :6]))), 7) == 1


@pytest.mark.parametrize("seed", range(4))
def test_the_closed_loop_of_a_network_is_exact(seed):
    net, *_, controls = random_network(np.random.default_rng(seed))
    A, B = closed_loop_of(net, controls)
    n = net.nstates
    assert (fractions(A.values).reshape(-1, n, n).sum(axis=0) == net.exact.A.fractions()).all()
    exact = net.exact.B.fractions() @ fractions(sp.csr_array(controls))
    assert (fractions(B.values).reshape(-1, n, B.shape[1]).sum(axis=0) == exact).all()


def test_sparse_limits_make_the_gain_sparse():
    problem = transport(20)
    a = kp.optimal_feedback(**problem)
    assert a and sp.issparse(a.F) and isinstance(a.closed_loop, kp.ConeNetwork)
    b = kp.optimal_feedback(**problem | {"limits": problem["limits"].toarray()})
    assert b and isinstance(b.F, np.ndarray) and (a.F.toarray() == b.F).all()
    exact = kp.feedback_interconnect(kp.stack([[["1/3"]]] * 2, [[1]], [[1]], dt=True), np.zeros((2, 2)))
    c = kp.optimal_feedback(exact, [[1], [1]], [0, 0], sp.eye_array(2) * 0.25)
    assert c and isinstance(c.F, np.ndarray) and c.certificate.problem.A.fractions()[0, 0] == Fraction(1, 3)


def test_cones_that_no_doubles_describe():
    """Facets of 106 digits: small networks are multiplied out, large ones refused."""
    X = kp.PolyhedralCone(np.eye(3) + np.random.default_rng(0).random((3, 3)))
    B = np.asarray(X.rays).sum(axis=0)[:, None]
    A = np.tile(0.2 * np.eye(3), (101, 1, 1))
    for count in (2, 101):
        nodes = kp.stack(A[:count], B, np.asarray(X.facets).sum(axis=0)[None], dt=True, X=X)
        net = kp.feedback_interconnect(nodes, sp.csr_array((count, count)), progress=False)
        given = net, np.tile(np.asarray(X.facets).sum(axis=0), count), np.zeros(count), sp.csr_array((count, 3 * count))
        if count == 2:
            assert isinstance(kp.optimal_feedback(*given).F, np.ndarray)
        else:
            with pytest.raises(DataError, match="doubles or integers"):
                kp.optimal_feedback(*given)


# -- larger ones


def by_program(problem):
    """max 1'p subject to s + (A - I)'p - L'zeta >= 0, |r + B'p| <= zeta, by HiGHS (orthant, discrete time)."""
    net, B, L = problem["sys"], problem["controls"], problem["limits"]
    n, m = B.shape
    eye, own = sp.eye_array(n), sp.eye_array(m)
    rows = sp.block_array([[eye - net.sparse_A.T, L.T], [B.T, -own], [-B.T, -own]], format="csc")
    bound = np.concatenate([problem["s"], -problem["r"], problem["r"]])
    sides = [(None, None)] * (n + m)
    return linprog(np.concatenate([-np.ones(n), np.zeros(m)]), rows, bound, bounds=sides, method="highs").x[:n]


def test_the_linear_program_agrees():
    problem = transport(400)
    a = kp.optimal_feedback(**problem)
    assert a and a.check() and a.iterations <= 10 and a.certificate.gap <= 1e-6
    np.testing.assert_allclose(a.cost, by_program(problem), rtol=1e-9)
    assert sp.issparse(a.F) and sp.issparse(a.K) and (a.K != -a.F).nnz == 0
    assert a.closed_loop.certificate and a.closed_loop.model.n_nodes == 400


@pytest.mark.parametrize("discrete", [False, True])
def test_ten_thousand_nodes(discrete):
    a = kp.optimal_feedback(**transport(10_000, discrete=discrete))
    assert a and a.certificate.gap <= 1e-6 and a.iterations <= 10
    assert "exponentially stable" in a.explain()


def test_ties_and_free_controls():
    """Nothing changes by moving between equal nodes; every policy is optimal."""
    n = 400
    nodes = kp.stack(np.full((n, 1, 1), 0.5), np.ones((1, 1)), np.ones((1, 1)), dt=True)
    net = kp.feedback_interconnect(nodes, sp.csr_array((n, n)), progress=False)
    j = np.arange(n)
    moves = sp.csr_array((np.tile([1.0, -1.0], n), (np.stack([(j + 1) % n, j], 1).ravel(), np.repeat(j, 2))))
    a = kp.optimal_feedback(net, np.ones(n), np.zeros(n), sp.eye_array(n) * 0.0, controls=moves)
    assert a and not a.F.nnz
    np.testing.assert_allclose(a.cost, 2)
    b = kp.optimal_feedback(net, np.ones((n, 1)), np.zeros(n), sp.eye_array(n) * 0.25)
    assert b and b.check()  # a local input at its limit: 1 / (1 - 1/4)
    np.testing.assert_allclose(b.cost, 4 / 3)


@pytest.mark.parametrize("seed", range(8))
def test_near_ties_are_not_taken_back_and_forth(seed):
    """Treatments at prices next to p, what they save."""
    rng, n = np.random.default_rng(seed), 300
    spread = sp.csr_array(
        sp.random_array((n, n), density=3 / n, rng=rng, data_sampler=lambda size: 0.03 * rng.random(size))
    )
    drift = rng.uniform(-0.3, -0.15, n)
    net = kp.feedback_interconnect(kp.stack(drift[:, None, None], [[1]], [[1]], dt=0), spread, progress=False)
    untreated = -np.linalg.solve(np.diag(drift) + spread.toarray().T, np.ones(n))
    price = untreated * (1 + rng.uniform(-3e-6, 3e-6, n))
    a = kp.optimal_feedback(
        net, np.ones(n), price, 0.2 * sp.eye_array(n), controls=-sp.eye_array(n), groups=np.arange(n)
    )
    assert a and a.iterations <= 12 and a.certificate.gap <= 1e-6
    np.testing.assert_allclose(a.cost, untreated, rtol=2e-5)


def test_shortest_paths():
    """Roads between many places, one of them chosen at each: the distances are those of Bellman and Ford."""
    n, rng = 400, np.random.default_rng(0)
    start = np.repeat(np.arange(n), 3)
    end = rng.integers(0, n, size=3 * n)
    end[::3] = np.arange(n) - 1  # so that the target, place -1, is reached from everywhere
    length = rng.uniform(1, 2, size=3 * n)
    away = end >= 0
    roads = sp.csr_array((np.ones(away.sum()), (end[away], np.flatnonzero(away))), shape=(n, 3 * n))
    places = kp.stack(np.zeros((n, 1, 1)), [[1]], [[1]], dt=True)
    net = kp.feedback_interconnect(places, sp.csr_array((n, n)), progress=False)
    a = kp.optimal_feedback(net, np.zeros(n), length, sp.eye_array(n), controls=roads, groups=start, use_all=True)
    distance = np.full(n + 1, np.inf)
    distance[-1] = 0
    for _ in range(n):
        distance[:n] = (length + distance[end]).reshape(n, 3).min(axis=1)
    assert a and a.check()
    np.testing.assert_allclose(a.cost, distance[:n], rtol=1e-9)
    assert (np.asarray(a.F.sum(axis=0)) == 1).all()  # one road from every place


def test_a_link_that_a_control_may_cut_exactly():
    """The limit is the weight of the link, 0.1: the condition holds with equality, and cutting is best."""
    n = 320
    nodes = kp.stack(np.full((n, 1, 1), -1.0), np.ones((1, 1)), np.ones((1, 1)), dt=0)
    ring = sp.csr_array((np.full(n, 0.1), (np.arange(n), np.roll(np.arange(n), 1))), shape=(n, n))
    net = kp.feedback_interconnect(nodes, ring, progress=False)
    a = kp.optimal_feedback(net, np.ones(n), np.zeros(n), ring)
    assert a and not a.closed_loop.model.W.nnz
    np.testing.assert_allclose(a.cost, 1)
    assert kp.optimal_feedback(net, np.ones(n), np.zeros(n), 1.001 * ring).status is kp.Status.UNDECIDED


# -- certificates


def test_forged_certificates_prove_nothing():
    c = kp.optimal_feedback(**transport(320)).certificate
    assert c.check()
    wrong, cheap = c.policy.copy(), c.problem.s.values.copy()
    wrong[np.argmax(c.policy != 0)] *= -1
    cheap[0, 5] *= 0.5
    dear = c.lower.copy()
    dear[7] *= 1.001
    low = c.upper.copy()
    low[7] *= 0.999
    limits = c.problem.limits.values.copy()
    limits.data = limits.data * 4
    forged = [
        {"lower": dear},
        {"upper": low},
        {"policy": wrong},
        {"policy": c.policy * 2},
        {"lower": c.lower * np.nan},
        {"problem": replace(c.problem, s=type(c.problem.s)(cheap))},
        {"problem": replace(c.problem, limits=type(c.problem.limits)(limits))},
    ]
    for change in forged:
        assert not replace(c, **change).check(), change.keys()
    with pytest.raises(DataError):
        replace(c, problem=replace(c.problem, A=c.problem.A.dense()))


def test_files_hold_sparse_matrices(tmp_path):
    a = by_route(network_route, **transport(30, links=2))
    for name in ("cost.json", "cost.npz"):
        a.save(tmp_path / name)
        again = kp.load_certificate(tmp_path / name)
        assert again == a.certificate and again.check() and again.problem.A.is_sparse
    assert checker.main(tmp_path / "cost.json") == 0


def test_closed_loops_of_long_numbers_are_not_written(tmp_path):
    n, rng = 301, np.random.default_rng(0)
    nodes = kp.stack(-1 - rng.random((n, 1, 1)), rng.random((n, 1, 1)), rng.random((n, 1, 1)), dt=0)
    net = kp.feedback_interconnect(nodes, sp.csr_array(0.5 * kp.examples.ring(n)), progress=False)
    a = kp.optimal_feedback(net, np.ones(n), np.zeros(n), sp.eye_array(n) * 0.1)
    assert a and a.check() and a.certificate.problem.A.shape[0] > n
    with pytest.raises(DataError, match="no doubles"):
        a.save(tmp_path / "cost.json")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("discrete", [False, True])
def test_no_finite_cost_is_refuted_by_few_nodes(discrete):
    problem = transport(320, discrete=discrete)
    nodes = problem["sys"].model.stacks[0]
    A = nodes.A.values.copy()
    A[5] = 1.5 if discrete else 0.5  # what node 5 makes is more than its controls move away
    net = kp.feedback_interconnect(kp.stack(A, [[1]], [[1]], dt=discrete), problem["sys"].model.W, progress=False)
    a = kp.optimal_feedback(**problem | {"sys": net})
    assert a.status is kp.Status.REFUTED and a.check() and "finite cost" in a.explain()
    d = a.witness.d
    assert not replace(a.certificate, witness=GrowingCost(np.where(d == d.max(), 0.0, d))).check()


# -- arguments


def test_inputs_that_leave_the_cone_are_named():
    problem = transport(320)
    a = kp.optimal_feedback(**problem | {"limits": 30 * problem["limits"], "r": 0 * problem["r"]})
    assert a.status is kp.Status.UNDECIDED and "may push x out of X" in a.message and "times as large" in a.message


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"s": np.ones(3)}, ShapeError, r"must be \(301,\)"),
        ({"s": np.ones((7, 43))}, ShapeError, r"must be \(301,\)"),
        ({"s": -np.ones(301)}, DataError, "the cost is negative"),
        ({"limits": -sp.eye_array(301)}, DataError, r"limits\[0\] is negative"),
        ({"limits": sp.eye_array(300)}, ShapeError, "limits"),
        ({"limits": [["1/3"] * 301] * 301}, DataError, "must hold doubles"),
        ({"controls": sp.eye_array(7)}, ShapeError, "controls"),
        ({"controls": sp.csr_array((301, 0))}, ShapeError, "no columns"),
        ({"X": kp.orthant(301)}, DataError, "leave X out"),
        ({"groups": np.zeros(7, dtype=int)}, DataError, "each of the 301 inputs"),
        ({"groups": np.ones(301, dtype=int)}, DataError, "none may be empty"),
        ({"groups": np.full(301, 10**15)}, DataError, "the group of each of the 301 inputs"),
        ({"disturbance": (np.ones((3, 1)), np.ones((1, 301)))}, ShapeError, "disturbance G"),
    ],
)
def test_wrong_arguments(changes, error, message):
    nodes = kp.stack(np.full((301, 1, 1), 0.5), [[1]], [[1]], dt=True)
    net = kp.feedback_interconnect(nodes, sp.csr_array((301, 301)), progress=False)
    given = {"sys": net, "s": np.ones(301), "r": np.zeros(301), "limits": sp.eye_array(301) * 0.1}
    with pytest.raises(error, match=message):
        kp.optimal_feedback(**given | changes)


def test_networks_that_are_not_taken():
    direct = kp.stack(np.full((301, 1, 1), 0.5), [[1]], [[1]], [[1]], dt=True)
    exact = kp.stack([[["1/3"]]] * 301, [[1]], [[1]], dt=True)
    for nodes, message in ((direct, "feedthrough"), (exact, "must hold doubles")):
        net = kp.feedback_interconnect(nodes, sp.csr_array((301, 301)), progress=False)
        with pytest.raises(DataError, match=message):
            kp.optimal_feedback(net, np.ones(301), np.zeros(301), sp.eye_array(301) * 0.1)


def test_direct_paths_may_be_closed_first():
    """As the refusal says: states linked by the entries of sparse_A, controls by sparse_B; a small one tells."""
    answers = []
    for n in (20, 301):
        W = sp.csr_array((np.full(n - 1, 0.25), (np.arange(1, n), np.arange(n - 1))), shape=(n, n))
        nodes = kp.stack(np.full((n, 1, 1), 0.25), [[0.125]], [[1]], [[0.5]], dt=True)
        net = kp.feedback_interconnect(nodes, W, progress=False)
        A, own = net.sparse_A, net.sparse_A.diagonal()[:, None, None]
        links = sp.csr_array(A - sp.diags_array(A.diagonal()))
        closed = kp.feedback_interconnect(kp.stack(own, [[1]], [[1]], dt=True), links, progress=False)
        given = np.ones(n), np.zeros(n), sp.eye_array(n) * 0.1
        a = kp.optimal_feedback(closed, *given, controls=net.sparse_B)
        assert a and a.certificate.gap < 1e-9
        answers.append(a.cost[-20:])
        if n == 20:
            b = kp.optimal_feedback(net, *given)
            np.testing.assert_allclose(a.cost, b.cost, rtol=1e-9)
        else:
            with pytest.raises(DataError, match="sparse_A"):
                kp.optimal_feedback(net, *given)
    np.testing.assert_allclose(*answers, rtol=1e-9)


def test_costs_may_be_fractions():
    nodes = kp.stack(np.full((301, 1, 1), 0.5), [[1]], [[1]], dt=True)
    net = kp.feedback_interconnect(nodes, sp.csr_array((301, 301)), progress=False)
    a = kp.optimal_feedback(net, ["1/3"] * 301, ["1/9"] * 301, sp.eye_array(301) * 0.25, discount="2/3")
    assert a and a.check() and a.certificate.problem.s.fractions()[0, 0] == Fraction(1, 3)
    np.testing.assert_allclose(a.cost, (1 / 3 - 0.25 / 9) / (1 - 2 / 3 * 0.25))


def test_a_time_limit_ends_it():
    a = kp.optimal_feedback(**transport(2000), time_limit=1e-9)
    assert a.status is kp.Status.UNDECIDED and a.F is None


def test_controls_along_a_generator_push_nothing_out():
    """h'B = 2 - 2 = 0 exactly, although two terms meet there."""
    eye, X = np.eye(2), kp.PolyhedralCone([[0, 1], [1, -2]])
    net = kp.feedback_interconnect(kp.stack([-2 * eye], B=[eye], C=[eye], dt=0, X=X), np.zeros((2, 2)))
    for limits in (np.array([[0.125, 0]]), sp.csr_array([[0.125, 0]])):
        a = kp.optimal_feedback(net, [3, 1], [0], limits, controls=[[1], [-2]])
        assert a and a.check()


def test_a_network_that_leaves_its_cone_is_told_so():
    nodes = kp.stack(-np.ones((2, 1, 1)), B=np.ones((2, 1, 1)), C=np.ones((2, 1, 1)), dt=0)
    net = kp.feedback_interconnect(nodes, np.array([[0, -1.0], [0, 0]]))
    for limits in (np.array([[0, 0.1]]), sp.csr_array([[0, 0.1]])):
        a = kp.optimal_feedback(net, [1, 1], [0], limits, controls=[[0], [1.0]])
        assert a.status == "UNDECIDED" and "without any input" in a.message
