"""Nonlinear networks: ends of Jacobians, order, contraction and what follows, against simulations and eigenvalues."""

from __future__ import annotations

from dataclasses import replace

import control as ct
import nonlinear_networks as examples
import numpy as np
import pytest
import scipy.sparse as sp
from certified_nonlinear import phases
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import control_kpos as kp
from control_kpos.errors import ConeMismatchError, DataError, NotProperConeError, ShapeError

SMALL = examples.contacts(12)


def integrated(net, x, w=None, time=20.0, steps=200):
    """The states at all steps."""
    times = np.linspace(0, time, steps + 1)
    found = solve_ivp(lambda t, x: net.dynamics(x, w), (0, time), x, "DOP853", times, rtol=1e-11, atol=1e-13)
    return found.y.T


def approaches(net, cert, region, w=None, T=None, seed=0):
    """The distance of two solutions falls at the proven rate, in the proven norms; T has generators as columns."""
    rng = np.random.default_rng(seed)
    low, high = region
    first, second = (low + rng.random(len(low)) * (high - low) for _ in range(2))
    time, steps = 3.0, 100
    d = integrated(net, first, w, time, steps) - integrated(net, second, w, time, steps)
    d = d if T is None else d @ np.linalg.inv(T).T
    bound = np.exp(-cert.decay_rate * np.linspace(0, time, steps + 1))
    for distance in (
        None if cert.e is None else np.abs(d / cert.e).max(axis=1),
        None if cert.v is None else np.abs(d) @ cert.v,
    ):
        assert distance is None or (distance <= bound * distance[0] * (1 + 1e-6) + 1e-12).all()


# -- worked examples


def test_sis_below_the_threshold_dies_out_from_everywhere():
    net = examples.sis(SMALL)
    cert = kp.differential_positivity(net, region=[[0, 1]], equilibrium=np.zeros(12))
    assert cert and cert.contracts and cert.invariant and cert.check()
    assert "one equilibrium" in cert.explain() and "Constant delays" in cert.explain()
    worst = np.linalg.eigvals(SMALL.toarray()).real.max() - 1  # the Jacobian at 0, which is among those enclosed
    assert 0.8 * -worst < cert.decay_rate <= -worst
    approaches(net, cert, (np.zeros(12), np.ones(12)))
    assert np.abs(integrated(net, np.ones(12), time=40)[-1]).max() < 1e-6


def test_sis_above_the_threshold_contracts_around_its_equilibrium():
    net = examples.sis(SMALL * (3 / np.abs(np.linalg.eigvals(SMALL.toarray())).max()))
    assert kp.differential_positivity(net, region=[[0, 1]]).e is None  # two equilibria: it cannot contract
    x = integrated(net, np.full(12, 0.5), time=60)[-1]
    region = np.column_stack([0.7 * x, np.minimum(1, 1.3 * x)])
    cert = kp.differential_positivity(net, region=region, equilibrium=x)
    assert cert.contracts and cert.invariant
    approaches(net, cert, region.T)


def test_sir_has_one_final_size():
    net = examples.sir(2 * SMALL)
    cert = kp.differential_positivity(net, region=[[0, 1]])
    assert cert.contracts and cert.invariant
    sizes = [integrated(net, np.full(12, start), time=60)[-1] for start in (0.0, 1.0)]
    assert np.allclose(*sizes, atol=1e-8)
    approaches(net, cert, (np.zeros(12), np.ones(12)))


def test_traffic_is_monotone_and_contracts_where_it_flows_freely():
    net, w = examples.traffic(8), np.zeros((16, 2))
    w[0] = [0, 0.3]
    jammed = kp.differential_positivity(net, region=[[0, 1]], inputs=w)
    assert jammed and not jammed.contracts and jammed.invariant and "says nothing against it" in jammed.explain()
    free = kp.differential_positivity(net, region=[[0, 0.3]], inputs=w)
    assert free.contracts and free.invariant
    approaches(net, free, (np.zeros(8), np.full(8, 0.3)), w.mean(axis=1))


def test_genes_with_hill_functions_contract_on_boxes_that_are_cut():
    net = examples.genes(SMALL)
    assert not kp.differential_positivity(net, region=[[0, 3]], pieces=1).contracts
    cert = kp.differential_positivity(net, region=[[0, 2]])
    assert cert.contracts and cert.invariant and cert.check()
    approaches(net, cert, (np.zeros(24), np.full(24, 2.0)))


def test_hopfield_network_is_entrained():
    net = examples.hopfield(SMALL)
    cert = kp.differential_positivity(net, region=[[-2, 2]], inputs=[[-0.5, 0.5]])
    assert cert.contracts and cert.invariant and "under periodic ones" in cert.explain()
    approaches(net, cert, (np.full(12, -2.0), np.full(12, 2.0)), np.full(12, 0.3))
    assert kp.differential_positivity(net, region=[[-2, 2]], inputs=[[-3, 3]]).invariant is None


def test_swing_equations_on_ieee_118():
    net = examples.swing()
    region = examples.angles(net, 44.9)
    cert = kp.differential_positivity(net, region=region)
    assert net.totals == (172, 118, 118) and cert.contracts and cert.invariant and cert.check()
    assert cert.v is None and "delays" not in cert.explain()
    T = net.model.blocks([np.array([np.asarray(k.X.rays).T] * k.count) for k in net.kinds], 0, 0).toarray()
    low, high = 0.2 * region.T
    d0 = np.random.default_rng(0).random(172) * (high - low) + low
    J = net.linearize(d0).A  # Jacobians on the region contract
    M = np.linalg.inv(T) @ J @ T
    assert (M - np.diag(np.diag(M)) >= -1e-9 * np.abs(M).max()).all()
    assert (M @ cert.e <= -cert.decay_rate * cert.e + 1e-9 * np.abs(M) @ cert.e).all()
    wide = kp.differential_positivity(net, region=examples.angles(net, 46))
    assert wide.status is kp.Status.REFUTED and wide.check() and wide.witness.block == 4


# -- random networks


@settings(max_examples=8)
@given(st.integers(0, 10**6), st.booleans())
def test_random_networks_contract_as_is_proven(seed, slanted):
    rng = np.random.default_rng(seed)
    X = [[0, 1], [1, -2]] if slanted else None
    T = np.array(X, dtype=float).T if slanted else np.eye(2)
    N, rate = 4, rng.uniform(1, 2, 4)

    def f(x, u, p):
        z = (x[0], x[1] + 2 * x[0]) if slanted else (x[0], x[1])  # weights of the generators, the other way round
        z = (z[1], z[0]) if slanted else z
        rates = [np.tanh(z[1]) - 2 * p["rate"] * z[0] + u[0], 0.5 * z[0] - p["rate"] * z[1] - z[1] ** 3]
        return [rates[1], rates[0] - 2 * rates[1]] if slanted else rates

    nodes = kp.nonlinear_nodes(f, lambda x, p: [x[0]], n_nodes=N, states=2, params={"rate": rate}, X=X)
    W = sp.csr_array(sp.random(N, N, 0.5, random_state=seed % 1000)) * rng.uniform(0, 1.5)
    net = kp.nonlinear_interconnect(nodes, [W, kp.nonlinear_links(np.tanh, [0, 1], [2, 3], weights=0.3)])
    high = np.tile(T @ np.array([0.5, 0.5]), N)
    cert = kp.differential_positivity(net, region=np.column_stack([-high, high]), pieces=100)
    whole = np.kron(np.eye(N), T)
    J = np.linalg.inv(whole) @ net.linearize(np.zeros(2 * N)).A @ whole
    worst = np.linalg.eigvals(J).real.max()
    assert cert and cert.decay_rate <= max(0.0, -worst) + 1e-9
    assert cert.contracts or worst > -0.2
    if cert.contracts and cert.invariant:
        approaches(net, cert, (-0.5 * high, 0.5 * high), T=whole, seed=seed)


@settings(max_examples=15)
@given(st.integers(0, 10**6))
def test_differences_take_the_worst_slope_of_every_link(seed):
    """e is found if and only if every choice of slopes is stable: each row chooses by itself."""
    rng = np.random.default_rng(seed)
    N, low, high = 5, 0.25, rng.uniform(0.5, 3)
    rows, columns = np.nonzero(rng.random((N, N)) * (1 - np.eye(N)) > 0.5)
    hold = np.where(rng.random(N) < 0.6, rng.uniform(0.1, 1, N), 0.0)
    nodes = kp.nonlinear_nodes(lambda x, u, p: [u[0] - p["hold"] * x[0]], n_nodes=N, params={"hold": hold})
    net = kp.nonlinear_interconnect(nodes, kp.nonlinear_links(kp.interval(low, high), rows, columns, difference=True))
    cert = kp.differential_positivity(net, region=[[-1, 1]])
    abscissae = []
    for _ in range(40):
        s = np.where(rng.random(len(rows)) < 0.5, low, high)
        S = np.zeros((N, N))
        S[rows, columns] = s
        abscissae.append(np.linalg.eigvals(S - np.diag(S.sum(axis=1) + hold)).real.max())
    assert cert and cert.decay_rate <= max(0.0, -max(abscissae)) + 1e-9
    reaches = np.linalg.matrix_power(np.eye(N) + S, N) @ (hold > 0)
    assert cert.contracts == bool((reaches > 0).all())


@pytest.mark.parametrize(
    ("net", "region"),
    [
        (examples.genes(SMALL), np.tile([0.0, 2.0], (24, 1))),
        (examples.traffic(6), np.tile([0.0, 1.0], (6, 1))),
        (examples.sir(SMALL), np.tile([0.2, 0.9], (12, 1))),
        (examples.swing(), examples.angles(examples.swing(), 40)),
    ],
    ids=["genes", "traffic", "sir", "swing"],
)
def test_ends_hold_the_slopes_at_random_states(net, region):
    """In coordinates by generators, all of M = A - B s C + B (W + S) C lies between the ends."""
    cert = kp.differential_positivity(net, region=region, pieces=4)
    T = net.model.blocks([np.array([np.asarray(k.X.rays).T] * k.count) for k in net.kinds], 0, 0).toarray()
    ends = [[M.values.toarray() for M in end] for end in (cert.lower, cert.upper)]
    own = np.eye(net.totals[2])[cert.own.astype(int)]
    (A, B, C, W, S), (a, b, c, w, s) = ends[1], ends[0]
    share = [np.diag(end[4].sum(axis=1)) @ own for end in ends]
    most = A - b @ share[0] @ c + B @ (W + S) @ C
    least = a - B @ share[1] @ C + b @ (w + s) @ c
    rng = np.random.default_rng(0)
    for _ in range(5):
        low, high = np.linalg.solve(T, region).T
        z = low + rng.random(len(low)) * (high - low)
        M = np.linalg.solve(T, net.linearize(T @ z).A @ T)
        room = 1e-9 * (1 + np.abs(least) + np.abs(most))
        assert (least - room <= M).all() and (most + room >= M).all()


# -- certificates


@pytest.mark.parametrize(
    "make", [lambda: phases(40), lambda: kp.differential_positivity(examples.sis(SMALL), region=[[0, 1]])]
)
def test_changed_certificates_fail(make):
    cert = make()
    assert cert.contracts and cert.check()
    for name in ("e", "y", "y_lower", "u", "v", "r", "p"):
        value = getattr(cert, name)
        if value is not None:
            assert not replace(cert, **{name: -value}).check(), name
            assert not replace(cert, **{name: value[:-1]}).check(), name
    worse = value if (value := cert.y_lower) is not None else cert.y
    assert not replace(cert, y_lower=worse + 1).check()
    for name, factor in (("y", 0.9), ("u", 0.9 if cert.v is not None else 1.1), ("r", 0.9), ("p", 0.9)):
        if getattr(cert, name) is not None and name != "u":
            assert not replace(cert, **{name: factor * getattr(cert, name)}).check(), name
    assert not replace(cert, decay_rate=1.01 * cert.decay_rate).check()
    assert not replace(cert, rates_at_lower=cert.rates_at_lower - 1).check()
    assert not replace(cert, rates_at_upper=cert.rates_at_upper + 2).check()
    assert not replace(cert, upper=cert.lower, lower=cert.upper).check()


def test_a_witness_is_an_entry_at_a_state():
    nodes = kp.nonlinear_nodes(lambda x, u, p: [u[0] - x[0]], lambda x, p: [x[0] - x[0] ** 2], n_nodes=3)
    net = kp.nonlinear_interconnect(nodes, 0.1 * np.ones((3, 3)))
    cert = kp.differential_positivity(net, region=[[0, 1]])
    assert cert.status is kp.Status.REFUTED and cert.check() and cert.margin == -1
    w = cert.witness
    assert (w.block, w.row, w.column) == (2, w.row, w.row) and w.value <= 1 - 2 * w.x[w.row] + 1e-9
    assert "more of state" in cert.explain() and "lowers output" in cert.explain()
    assert not replace(cert, witness=replace(w, value=0.5)).check()
    assert not replace(cert, witness=replace(w, value=-5.0)).check()
    assert not replace(cert, witness=replace(w, row=7)).check()
    assert kp.differential_positivity(net, region=[[0, 0.5]])


def test_files_and_the_command(tmp_path):
    for name, cert in (("a", phases(40)), ("b", phases(50))):
        cert.save(tmp_path / f"{name}.json")
        again = kp.load_certificate(tmp_path / f"{name}.json")
        assert again == cert and again.explain() == cert.explain()
        cert.save(tmp_path / f"{name}.npz")
        assert kp.load_certificate(tmp_path / f"{name}.npz") == cert


def test_genes_that_repress_each_other_are_monotone_in_a_mixed_order():
    """The second gene counts downwards: its cone is the negative half-line, and it sends its opposite."""
    up = kp.nonlinear_nodes(lambda x, u, p: [4 / (1 + u[0] ** 2) - x[0]], n_nodes=1)
    down = kp.nonlinear_nodes(
        lambda x, u, p: [4 / (1 + u[0] ** 2) - x[0]], lambda x, p: [-x[0]], n_nodes=1, X=kp.PolyhedralCone([[-1]])
    )
    net = kp.nonlinear_interconnect([up, down], [[0, 1], [1, 0]])
    cert = kp.differential_positivity(net, region=[[0.1, 4], [4, 0.1]])
    assert cert and cert.invariant and not cert.contracts  # two stable equilibria
    near = kp.differential_positivity(net, region=[[3.6, 3.9], [0.3, 0.2]])
    assert near.contracts
    with pytest.raises(DataError, match="in the order of its cone"):
        kp.differential_positivity(net, region=[[0.1, 4], [0.1, 4]])


def test_own_shares_refute_machines_that_swing():
    """Damping 1 against a line of strength 2: no order of angles is kept, also at rest."""
    machines = kp.nonlinear_nodes(
        lambda x, u, p: [x[1], u[0] - x[1]], n_nodes=2, states=2, X=kp.PolyhedralCone([[0, 1], [1, -0.5]])
    )
    net = kp.nonlinear_interconnect(machines, kp.nonlinear_links(np.sin, [0, 1], [1, 0], weights=2, difference=True))
    cert = kp.differential_positivity(net, region=np.array([[-1, 1], [0.4, -0.4]] * 2) * 0.1)
    assert cert.status is kp.Status.REFUTED and cert.check() and cert.witness.block == 0
    assert cert.witness.value == pytest.approx(0.25 - 2, abs=0.1)


def test_ranges_of_links_and_of_differences():
    nodes = kp.nonlinear_nodes(lambda x, u, p: [u[0] - x[0]], n_nodes=2)
    ranged = kp.nonlinear_interconnect(nodes, [[0, kp.interval(0, 0.5)], [kp.interval("1/3", 1), 0]])
    cert = kp.differential_positivity(ranged, region=[[0, 1]])
    assert cert.contracts and cert.invariant
    with pytest.raises(DataError, match="known by ranges only"):
        ranged.dynamics([0, 0])
    assert (
        kp.differential_positivity(
            kp.nonlinear_interconnect(nodes, [[0, kp.interval(-0.5, 0.5)], [0, 0]]), region=[[0, 1]]
        ).status
        is kp.Status.REFUTED
    )
    apart = kp.nonlinear_interconnect(nodes, kp.nonlinear_links(kp.interval(0, 10), [0, 1], [1, 0], difference=True))
    assert kp.differential_positivity(apart, region=[[-1, 1]]).decay_rate == pytest.approx(1)


def test_a_network_is_a_system_of_python_control():
    net = examples.sis(SMALL)
    response = ct.input_output_response(net.system, np.linspace(0, 1, 5), 0, np.full(12, 0.5))
    assert np.allclose(response.states[:, -1], integrated(net, np.full(12, 0.5), time=1.0)[-1], atol=1e-3)
    x = np.full(12, 0.3)
    numeric = np.column_stack([(net.dynamics(x + 1e-6 * d) - net.dynamics(x - 1e-6 * d)) / 2e-6 for d in np.eye(12)])
    assert np.allclose(net.linearize(x).A, numeric, atol=1e-6)
    swing = examples.swing()
    x = np.random.default_rng(0).uniform(-0.3, 0.3, 172)
    directions = np.random.default_rng(1).standard_normal((5, 172))
    for d in directions:
        numeric = (swing.dynamics(x + 1e-6 * d) - swing.dynamics(x - 1e-6 * d)) / 2e-6
        assert np.allclose(swing.linearize(x).A @ d, numeric, rtol=1e-4, atol=1e-3)
    assert [part.shape for part in swing.unpack(x)] == [(2, 54), (1, 64)]
    assert (swing.pack(*swing.unpack(x)) == x).all()


# -- bad input

NODES = kp.nonlinear_nodes(lambda x, u, p: [u[0] - x[0]], n_nodes=2)
NET = kp.nonlinear_interconnect(NODES, [[0, 0.5], [0.5, 0]])
ROOTS = kp.nonlinear_nodes(lambda x, u, p: [u[0] - np.sqrt(x[0])], n_nodes=2)


def of_nodes(f, region=(0, 1), **more):
    return kp.differential_positivity(
        kp.nonlinear_interconnect(kp.nonlinear_nodes(f, n_nodes=3, **more), 0.1 * np.ones((3, 3))), region=[region]
    )


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: kp.differential_positivity(NET), DataError, "region is missing"),
        (lambda: kp.differential_positivity(NET, region=[[1, 0]]), DataError, "exceeds"),
        (lambda: kp.differential_positivity(NET, region=[[0, 1]] * 3), ShapeError, r"must be \(2, 2\)"),
        (lambda: kp.differential_positivity(NET, region=[[0, 1]], inputs=[[0, 1]] * 3), ShapeError, "inputs has"),
        (
            lambda: kp.differential_positivity(NET, kp.orthant(2), [[0, 1]]),
            DataError,
            "not for networks.*name the region",
        ),
        (lambda: kp.differential_positivity([[-1]], [[1]], equilibrium=[0]), DataError, "equilibrium is for networks"),
        (lambda: kp.differential_positivity([[-1]]), DataError, "X is missing"),
        (
            lambda: kp.differential_positivity(NET, region=[[1, 2]], equilibrium=[0, 0]),
            DataError,
            "node 0 has 0 as its coordinate 0, which is outside of the region",
        ),
        (
            lambda: kp.differential_positivity(NET, region=[[0, 2]], equilibrium=[1, 1]),
            DataError,
            "state 0 still changes at the rate -0.5",
        ),
        (lambda: kp.differential_positivity(NET, region=[[-1.7e308, 1.7e308]]), DataError, "region"),
        (lambda: kp.nonlinear_interconnect(ROOTS, np.eye(2)).linearize([0, 1]), DataError, "at this x: f of nodes 0"),
        (lambda: of_nodes(lambda x, u, p: [u[0] - np.sqrt(x[0])]), DataError, "of node 0 is unbounded on its region"),
        (
            lambda: of_nodes(lambda x, u, p: [u[0] - 1 / (x[0] - p["a"])], params={"a": [2, 0.5, 3]}),
            DataError,
            "node 1 is unbounded",
        ),
        (lambda: of_nodes(lambda x, u, p: [u[0] - x[0].sum()]), DataError, "cannot be enclosed"),
        (
            lambda: of_nodes(lambda x, u, p: [u[0] - p["a"] * x[0]]),
            DataError,
            "fails with KeyError: 'a'. Write it as f",
        ),
        (lambda: of_nodes(lambda x, u: [u[0] - x[0]]), DataError, r"fails with TypeError: .* as f\(x, u, p\)"),
        (lambda: of_nodes(lambda x, u, p: [u[0], x[0]]), ShapeError, "2 rows; the nodes need 1"),
        (lambda: kp.nonlinear_nodes("f", n_nodes=2), DataError, "f is a str"),
        (lambda: kp.nonlinear_nodes(abs, n_nodes=2, outputs=2), DataError, "outputs is 2"),
        (lambda: kp.nonlinear_nodes(abs, n_nodes=2, X=kp.orthant(2)), ConeMismatchError, "X is a cone in dimension 2"),
        (
            lambda: kp.nonlinear_nodes(abs, n_nodes=2, states=3, X=kp.lorentz(3, facets=5)),
            NotProperConeError,
            "must be simplicial",
        ),
        (lambda: kp.nonlinear_nodes(abs, n_nodes=2, params={"a": [1, 2, 3]}), ShapeError, "has 3 entries"),
        (lambda: kp.nonlinear_nodes(abs, n_nodes=2, params={"a": "1/3"}), DataError, "is no double"),
        (lambda: kp.nonlinear_interconnect(NODES, [[1.0]]), ConeMismatchError, "coupling is 1 x 1"),
        (lambda: kp.nonlinear_interconnect(NODES, kp.nonlinear_links(np.sin, [2], [0])), ShapeError, "targets holds 2"),
        (lambda: kp.nonlinear_interconnect([NODES, 1]), ShapeError, "nodes holds a int"),
        (lambda: kp.nonlinear_interconnect([]), ShapeError, "nodes is empty"),
        (lambda: kp.nonlinear_links(np.sin, [0, 1], [1]), ShapeError, "targets has 2 entries, but sources has 1"),
        (lambda: kp.nonlinear_links(np.sin, [0.5], [1]), DataError, "targets holds 0.5"),
        (lambda: kp.nonlinear_links(3, [0], [1]), DataError, "function is a int"),
        (
            lambda: kp.nonlinear_interconnect(
                kp.nonlinear_nodes(lambda x, u, p: [u[1]], n_nodes=2, inputs=2),
                kp.nonlinear_links(np.sin, [1], [0], difference=True),
            ),
            DataError,
            "input 1 receives a difference",
        ),
        (lambda: NET.dynamics([1, 2, 3]), ShapeError, "x has 3 entries"),
        (lambda: NET.pack([1], [2]), ShapeError, "2 lists, but 1 kinds"),
        (lambda: NET.pack([1, 2]), ShapeError, "2 rows for nodes of 1 states"),
    ],
)
def test_bad_input_is_named(call, error, text):
    with pytest.raises(error, match=text):
        call()


def test_a_function_that_changes_its_mind_is_refused():
    calls = []

    def f(x, u, p):
        calls.append(1)
        return [u[0] - len(calls) * x[0]]

    with pytest.raises(DataError, match=r"not in their enclosure|cannot be enclosed"):
        of_nodes(f)
