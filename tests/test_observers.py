"""Interval observers: enclosures that no simulation leaves, final widths, and what makes them fail."""

from dataclasses import replace

import control as ct
import numpy as np
import pytest
from certified_observers import SQUARE, double_integrator, observed

import control_kpos as kp
from control_kpos.exact.matrix import Matrix
from control_kpos.observers import program

BOXES = {"disturbance": ([0, -1], [0, 1]), "noise": ["1/10"]}


@pytest.fixture(scope="module")
def integrator():
    return double_integrator()


def test_the_double_integrator_needs_n(integrator):
    # width_2 = 2/N_2 + 2 N_2/5 at N = (1, N_2), smallest at N_2 = sqrt(5)
    assert integrator and integrator.check()
    assert integrator.width[0] == pytest.approx(0.2)
    assert integrator.width[1] == pytest.approx(4 / np.sqrt(5), rel=1e-3)
    plant = ct.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    assert kp.observer_gain(plant, X=kp.orthant(2)).status is kp.Status.REFUTED  # no A + L C


def test_the_error_equation(integrator):
    A, C = np.array([[0, 1], [0, 0]]), np.array([[1, 0]])
    proof, L, N = integrator.certificate, integrator.L, integrator.N
    T = np.eye(2) - N @ C
    np.testing.assert_allclose(proof.positivity.A.values, T @ A + L @ C)
    np.testing.assert_allclose(np.array(proof.equation.K, dtype=float), (T @ A + L @ C) @ N - L)


def steps(o, A, C, box, noise, seed, count=60):
    """Escapes, and the last width over the one proven, of a random run in discrete time."""
    rng = np.random.default_rng(seed)
    n, (low, high) = len(A), box
    x = rng.normal(size=n)
    first, states, measured = (x - rng.random(n), x + rng.random(n)), [], []
    for _ in range(count):
        states.append(x)
        measured.append(C @ x + noise * rng.choice([-1, 1], len(C)))
        x = A @ x + np.where(rng.random(n) < 0.5, low, high)
    lower, upper = o.simulate(np.arange(count), np.array(measured).T, x0=first)
    x = np.array(states).T
    return ((x < lower - 1e-9) | (x > upper + 1e-9)).sum(), ((upper - lower)[:, -1] / o.width).max()


@pytest.mark.parametrize("seed", range(6))
def test_nothing_escapes(seed):
    rng = np.random.default_rng(seed)
    n = 1 + seed % 3
    A, C = rng.normal(size=(n, n)), rng.normal(size=(max(n - 1, 1), n))
    A /= max(abs(np.linalg.eigvals(A)))  # on the edge of stability
    box, noise = (-rng.random(n), rng.random(n)), 0.1 * rng.random(len(C))
    o = kp.interval_observer(ct.ss(A, np.ones((n, 1)), C, 0, True), disturbance=box, noise=noise)
    assert o and o.check()
    escapes, ratio = steps(o, A, C, box, noise, seed)
    assert escapes == 0 and ratio < 1 + 1e-6


def test_a_cone_of_four_generators():
    A, C = np.diag([0.5, 0.5, 0.75]), np.array([[0, 0, 1.0]])
    o = observed(A, C, dt=1, X=SQUARE, noise=0.25)
    assert o and o.check() and o.cone.n_rays == 4
    assert steps(o, A, C, (-np.ones(3), np.ones(3)), 0.25, 1)[0] == 0


def test_continuous_time_encloses_with_inputs(integrator):
    T = np.linspace(0, 10, 401)
    u = np.sin(T)
    w = np.sign(np.cos(3 * T)) * 0.5
    plant = ct.ss([[0, 1], [0, 0]], [[0], [1]], np.eye(2), np.zeros((2, 1)))
    x = ct.forced_response(plant, T, u + w, [0.5, -0.5]).states
    lower, upper = integrator.simulate(T, x[0] + 0.09 * np.cos(20 * T), u, x0=([-1, -1], [1, 1]))
    assert (lower <= x).all() and (x <= upper).all()
    assert (upper - lower)[:, -1] == pytest.approx(integrator.width, rel=1e-3)


@pytest.mark.parametrize("dim", [2, 3, 20])
def test_facets_of_any_length(dim):
    # exact facets of generators in doubles are integers of any length: bounds are those of the orthant, moved
    rng = np.random.default_rng(dim)
    R = np.eye(dim) + rng.random((dim, dim)) / dim
    A, C = np.diag(-1 - rng.random(dim)) + 0.1 * rng.random((dim, dim)) / dim, np.eye(1, dim)
    moved, seen = R @ A @ np.linalg.inv(R), C @ np.linalg.inv(R)
    o = observed(moved, seen, X=kp.PolyhedralCone(R.T.tolist()), noise=0.1)
    H, K, T = (np.asarray(M, dtype=float) for M in (o.cone.facets, o.certificate.equation.K, o.certificate.equation.T))
    most = np.abs(H @ T).sum(axis=1) + 0.1 * np.abs(H @ K).sum(axis=1)
    assert o and o.certificate.upper == pytest.approx(np.linalg.solve(H, most), rel=1e-6)
    x = R.sum(axis=0)
    assert (o.system.C @ o.start((x, x)))[:dim] == pytest.approx(T @ x, rel=1e-6)


def test_a_cone_is_found_for_the_transposed_plant():
    A = [[0, 0, -4], [1, 0, -2], [0, 1, 1]]  # one output, of which no orthant needs to know
    plant = ct.ss(A, np.ones((3, 1)), [[1, 2, -1]], 0)
    o = kp.interval_observer(plant, disturbance=([-1] * 3, [1] * 3), noise=0.1)
    assert o and o.check() and o.cone.is_simplicial


def test_no_gain_is_refuted():
    plant = ct.ss([[1, 0], [0, -1]], [[1], [1]], [[0, 1]], 0)  # the unstable state is not seen
    o = kp.interval_observer(plant, X=kp.orthant(2), noise=1)
    assert o.status is kp.Status.REFUTED and o.check() and o.L is None
    o = kp.interval_observer(plant, noise=1)
    assert o.status is kp.Status.UNDECIDED and "no cone" in o.explain()
    with pytest.raises(kp.DataError, match="encloses nothing"):
        o.simulate([0, 1], [0, 0], x0=([0, 0], [1, 1]))


def test_gains_are_not_larger_than_the_width_needs(integrator, monkeypatch):
    assert np.abs(integrator.L).max() <= 1 + 1e-9  # z_1 = 0: any decay will do
    larger = 0
    for seed in (1, 3, 9):
        rng = np.random.default_rng(seed)
        A, C = rng.normal(size=(2, 2)), rng.normal(size=(1, 2))
        both = []
        for gains in (program._GAINS, ()):
            with monkeypatch.context() as patch:
                patch.setattr(program, "_GAINS", gains)
                both.append(observed(A, C, noise=0.1))
        calm, plain = both
        assert calm and calm.check() and calm.width.sum() <= 1.01 * plain.width.sum()
        larger += np.abs(plain.L).max() > 3 * np.abs(calm.L).max()
    assert larger


def test_more_noise_makes_it_wider():
    widths = [observed([[0.5]], [[1]], dt=1, noise=noise).width[0] for noise in (0, 0.1, 1, 100)]
    assert widths == sorted(widths) and widths[0] < widths[-1] <= 4 + 1e-9


@pytest.mark.parametrize("name", ["w_lo", "w_hi", "noise", "upper", "lower", "v", "spread", "width"])
def test_a_changed_vector_does_not_pass(integrator, name):
    proof = integrator.certificate
    change = -1 if name in ("upper", "v", "spread", "width", "w_lo") else 1
    changed = Matrix(getattr(proof, name) + change)
    assert proof.check() and not replace(proof, **{name: changed}).check()


@pytest.mark.parametrize("name", ["plant", "output", "gain", "shift", "covers"])
def test_a_changed_matrix_does_not_pass(integrator, name):
    proof = integrator.certificate
    changed = Matrix(getattr(proof, name).values - 0.5)
    assert not replace(proof, **{name: changed}).check()


def test_files(integrator, tmp_path):
    integrator.save(tmp_path / "observer.json")
    loaded = kp.load_certificate(tmp_path / "observer.json")
    assert loaded == integrator.certificate and loaded.check() and loaded.exact == integrator.certificate.exact


def test_what_is_typed_is_what_is_proven():
    o = observed([["-1/3"]], [["1/7"]], w=["1/3"])
    assert o.certificate.plant.fractions()[0, 0] * 3 == -1 and o.certificate.output.fractions()[0, 0] * 7 == 1


BAD = {
    "disturbance": [([0], [1]), ([1, 1], [0, 0]), [1], 3, ([0, np.nan], [1, 1])],
    "noise": [[1, 2], -1, "much", [np.inf]],
}


@pytest.mark.parametrize(("name", "value"), [(name, value) for name, values in BAD.items() for value in values])
def test_bad_arguments_are_named(name, value):
    plant = ct.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    with pytest.raises(kp.KposError, match=name):
        kp.interval_observer(plant, **{**BOXES, name: value})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"T": [0, 1, 3]}, "equal steps"),
        ({"T": [0]}, "two at least"),
        ({"y": [0, 0]}, "y has shape"),
        ({"u": [[0, 0, 0], [0, 0, 0]]}, "u has shape"),
        ({"x0": ([1, 1], [0, 0])}, "x0 has its lower"),
        ({"x0": [0]}, "x0 must be a pair"),
        ({"x0": None}, "x0 must be a pair"),
        ({"x0": ([-1e308] * 2, [1e308] * 2)}, "x0 could not be enclosed"),
        ({"y": [1e308, -1e308, 1e308]}, "range of doubles"),
        ({"T": [0, 1e300, 2e300]}, "range of doubles"),
    ],
)
def test_bad_signals_are_named(integrator, change, words):
    good = {"T": [0, 1, 2], "y": [0, 0, 0], "x0": ([0, 0], [1, 1])}
    with pytest.raises(kp.KposError, match=words):
        integrator.simulate(**good | change)


def test_names_are_distinct():
    for names, found in ((("one", "y"), ["y", "one", "one_"]), (("y", "y"), ["y", "y_", "one"])):
        plant = ct.ss(-1, 1, 1, 0, inputs=names[0], outputs=names[1])
        assert kp.interval_observer(plant, noise=1).system.input_labels == found
    dotted = kp.interval_observer(ct.ss(-1, 1, 1, 0, states=["tank.level"]), noise=1)
    assert dotted.system.output_labels == ["tank_level_upper", "tank_level_lower"]


def test_disturbances_of_all_sizes_prove_nothing_wrong():
    plant = ct.ss([[0, 1], [0, 0]], [[0], [1]], [[1, 0]], 0)
    o = kp.interval_observer(plant, disturbance=([0, -1e-300], [1e300, 0]), noise=0.1)
    assert not o or np.isfinite(o.width).all()


def test_no_plant():
    with pytest.raises(kp.DataError, match="sys"):
        kp.interval_observer(3)
    with pytest.raises(kp.ShapeError, match="no outputs"):
        kp.interval_observer(ct.ss([[-1]], [[1]], np.zeros((0, 1)), np.zeros((0, 1))))
    with pytest.raises(kp.DataError, match="at most 60"):
        kp.interval_observer(ct.ss(-np.eye(61), np.ones((61, 1)), np.ones((1, 61)), 0))


def test_numbers_beyond_all_doubles_prove_nothing():
    square = [[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]]
    for X in (None, square):
        o = observed(np.diag([-1, -1.0, -0.5]), [[1e8, 0, 1e8]], X=X, noise=1e307, w=[1e307] * 3)
        assert o.status is not kp.Status.REFUTED and (not o or np.isfinite(o.width).all())
