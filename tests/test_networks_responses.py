"""The closed loop as a python-control system: names, responses, delays and lost links."""

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from network_examples import CONE, cycle, lag, mass, random_masses, sparse_ring

import control_kpos as kp
from control_kpos.networks import closed_loop
from control_kpos.proof.certificate import Status

# -- the closed loop


def test_python_control_works_on_it_and_names_follow():
    net = kp.feedback_interconnect([mass(name="left"), mass(name="right")], cycle(2), name="pair")
    assert isinstance(net, ct.StateSpace) and net.name == "pair"
    assert net.input_labels == ["left_u[0]", "right_u[0]"] and net.state_labels[0] == "left_x[0]"
    plain = ct.ss(net.A, net.B, net.C, net.D)
    np.testing.assert_allclose(np.sort(ct.poles(net)), np.sort(plain.poles()))
    np.testing.assert_allclose(net(1j), plain(1j))
    np.testing.assert_allclose(ct.dcgain(net), ct.dcgain(plain))
    assert (net * net).nstates == 8
    assert net.copy().certificate.status is Status.PROVED


def test_external_signals_are_chosen_by_name_or_place():
    nodes = [mass(name="left"), mass(name="right")]
    net = kp.feedback_interconnect(nodes, cycle(2), inputs=["left"], outputs=["right_y[0]", 0])
    whole = kp.feedback_interconnect(nodes, cycle(2))
    np.testing.assert_array_equal(net.B, whole.B[:, [0]])
    np.testing.assert_array_equal(net.C, whole.C[[1, 0]])
    with pytest.raises(kp.ShapeError, match="middle"):
        kp.feedback_interconnect(nodes, cycle(2), outputs=["middle"])


def test_large_networks_refuse_dense_matrices_and_say_what_to_do():
    net = kp.feedback_interconnect(random_masses(np.random.default_rng(0), 4000), sparse_ring(4000))
    with pytest.raises(kp.TooLargeError, match="sparse_A"):
        _ = net.A
    with pytest.raises(kp.TooLargeError):
        net.poles()
    lower, upper = net.spectral_abscissa()
    assert abs(net.poles(3)[0].real - upper) < 1e-5 and upper - lower < 1e-5
    response = net.initial_response(1.0, 1.0, outputs=[0, 17])
    assert isinstance(response, ct.TimeResponseData) and response.outputs.shape == (2, 200)


@pytest.mark.parametrize(
    "ask", [lambda n: n(0j), ct.dcgain, lambda n: ct.frequency_response(n, [1.0]), ct.ss2tf, ct.tf]
)
def test_what_would_fill_the_memory_is_refused_before_it_does(ask):
    """python-control makes arrays of states squared, or lists of ports squared, before it looks at A."""
    n = 20_000
    nodes = kp.stack(A=-np.ones((n, 1, 1)), B=np.ones((n, 1, 1)), C=np.ones((n, 1, 1)))
    net = kp.feedback_interconnect(nodes, sp.eye_array(n, k=1, format="csr") * 0.5)
    with pytest.raises(kp.TooLargeError, match="forced_response"):
        ask(net)


@pytest.mark.parametrize("dt", [0, 0.1])
def test_responses_are_those_of_python_control(dt):
    rng = np.random.default_rng(6)
    nodes = [
        lag(0.5 if dt else 3.0, D=0.2, dt=dt),
        lag(0.3 if dt else 40.0, D=0.1, dt=dt),
        lag(0.2 if dt else 1.5, dt=dt),
    ]
    net = kp.feedback_interconnect(nodes, 0.5 * rng.random((3, 3)))
    plain = ct.ss(net.A, net.B, net.C, net.D, dt)
    T, x0 = np.arange(0, 3.05, 0.1), rng.random(3)
    U = rng.random((3, len(T)))
    ours, theirs = net.forced_response(T, U, x0), ct.forced_response(plain, T, U, x0)
    np.testing.assert_allclose(ours.outputs, theirs.outputs, atol=1e-10)
    np.testing.assert_allclose(ours.states, theirs.states, atol=1e-10)
    np.testing.assert_allclose(
        net.initial_response(T, x0).outputs, ct.initial_response(plain, T, x0).outputs, atol=1e-10
    )


def test_bad_simulation_input():
    net = kp.feedback_interconnect([lag(1)] * 2, cycle(2, 0.5))
    for T in ([0, 1, 5], [], -1.0, [1, 0]):
        with pytest.raises(kp.KposError):
            net.initial_response(T, 1.0)
    with pytest.raises(kp.ShapeError, match="X0 has 3 entries; it must have 2"):
        net.initial_response(1.0, [1, 2, 3])
    with pytest.raises(kp.ShapeError, match="U is 1 x 4"):
        net.forced_response([0, 1, 2], [[1, 2, 3, 4]])
    with pytest.raises(kp.ShapeError, match="outputs names 'z'"):
        net.initial_response(1.0, 1.0, outputs=["z"])


# -- delays and lost links


def test_delayed_links_stay_stable_and_converge_to_the_delay_equation():
    rng = np.random.default_rng(7)
    net = kp.feedback_interconnect(random_masses(rng, 5), cycle(5, 18.0))
    assert net.certificate.status is Status.PROVED and "delay" in net.certificate.explain()
    T = np.linspace(0, 1, 41)
    undelayed = net.delayed_response(T, 1.0, 0.0, refine=40).outputs
    np.testing.assert_allclose(undelayed, net.initial_response(T, 1.0).outputs, atol=1e-6)
    # one node fed by itself, delayed: x' = -2 x + x(t - 1) with x = 1 before, solved by steps on [0, 1]
    single = kp.feedback_interconnect([lag(2)], [[1.0]]).delayed_response(T, 1.0, 1.0, refine=10)
    np.testing.assert_allclose(single.outputs[0], 0.5 + 0.5 * np.exp(-2 * T), atol=1e-6)
    for _ in range(3):
        late = net.delayed_response(np.linspace(0, 60, 121), 1.0, rng.uniform(0, 4, (5, 5)), refine=30).outputs
        assert np.abs(late[:, -1]).max() < 0.2 * np.abs(late[:, 0]).max()
    with pytest.raises(kp.DataError, match="not negative"):
        net.delayed_response(T, 1.0, -1.0)


def test_switching_links_off_and_on_never_raises_the_storage():
    rng = np.random.default_rng(8)
    net = kp.feedback_interconnect(random_masses(rng, 6), cycle(6, 18.0))
    v = np.concatenate([np.ravel(k) for k in net.certificate.v])
    x = np.ravel(rng.random((6, 2)) @ CONE.rays)
    before = v @ x
    for _ in range(20):
        lost = net.with_links(cycle(6, 18.0) * (rng.random((6, 6)) < 0.5))
        x = lost.initial_response([0, 0.3], x).states[:, -1]
        assert v @ x <= before * np.exp(-0.3 * net.certificate.decay_rate) + 1e-12
        before = v @ x


def test_progress_is_reported_and_interruption_leaves_nothing_half_done():
    lines = []
    nodes = random_masses(np.random.default_rng(9), 50)
    net = kp.feedback_interconnect(nodes, 30 * sparse_ring(50), progress=lines.append)
    assert net.certificate.status is Status.REFUTED and lines

    def interrupt(line):
        raise KeyboardInterrupt

    broken = kp.feedback_interconnect(
        random_masses(np.random.default_rng(9), 50), 30 * sparse_ring(50), progress=interrupt
    )
    with pytest.raises(KeyboardInterrupt):
        _ = broken.certificate
    broken._progress = None
    assert broken.certificate.status is Status.REFUTED


# -- LAPACK and ARPACK that do not converge


@pytest.mark.parametrize("routine", [(np.linalg, "eigvals"), (sp.linalg, "eigs")])
def test_eigenvalues_that_do_not_converge_are_said_to_be_unknown(routine, monkeypatch):
    error = (
        sp.linalg.ArpackNoConvergence("injected", [], []) if "eigs" in routine else np.linalg.LinAlgError("injected")
    )

    def fail(*_, **__):
        raise error

    small, large = (kp.feedback_interconnect([lag(2)] * n, 0.3 * kp.examples.ring(n)) for n in (3, 500))
    monkeypatch.setattr(*routine, fail)
    with pytest.raises(kp.UndecidedError, match="the poles could not be computed"):
        large.poles(2) if "eigs" in routine else small.poles()
    if "eigvals" in routine:
        with pytest.raises(kp.UndecidedError, match="the poles could not be computed"):
            small.poles(1)
        with pytest.raises(kp.UndecidedError, match="the largest weight could not be computed"):
            kp.scale_free_certificate(lag(2))


def test_some_outputs_of_loops_too_large_to_be_resolved(monkeypatch):
    """Above `LOOP_LIMIT` inputs on loops the rows of R come from a solve each."""
    rng, n = np.random.default_rng(0), 40
    i = np.arange(n)
    W = sp.csr_array((rng.uniform(0.1, 0.5, 2 * n), (np.r_[i, i], np.r_[(i + 1) % n, (i + 7) % n])), shape=(n, n))
    one = np.ones((n, 1, 1))
    nodes = kp.stack(-rng.uniform(1, 2, (n, 1, 1)), one, one, rng.uniform(0, 0.5, (n, 1, 1)))
    expected = kp.feedback_interconnect(nodes, W).initial_response(1.0, 1.0, outputs=[3, 5]).outputs
    monkeypatch.setattr(closed_loop, "LOOP_LIMIT", 10)
    monkeypatch.setattr(closed_loop, "EXACT_STATES", 1)
    net = kp.feedback_interconnect(nodes, W)
    assert np.allclose(net.initial_response(1.0, 1.0, outputs=[3, 5]).outputs, expected, atol=1e-12)
    with pytest.raises(kp.TooLargeError):
        net.sparse_C  # noqa: B018
