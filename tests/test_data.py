"""Every plant that agrees with measurements: positivity, stability, gains."""

import itertools
from dataclasses import replace
from fractions import Fraction

import certified_data
import numpy as np
import pytest
from certified_data import SQUARE

import control_kpos as kp
from control_kpos.data.program import Samples, extreme
from control_kpos.errors import ConeMismatchError, DataError, ShapeError
from control_kpos.exact.matrix import Matrix
from control_kpos.exact.programs import solve

TILTED = kp.PolyhedralCone([[0, 1], [1, -2]])


def random_plant(rng, n, m, *, discrete, X=None):
    """A, B for which a gain is likely to exist: positive on X, little damped, with a strong input."""
    T = np.eye(n) if X is None else X.rays[:n].T
    M = rng.uniform(0.1, 1, (n, n))
    M /= np.abs(np.linalg.eigvals(M)).max() / 0.7
    A = T @ (M if discrete else M - 1.5 * np.eye(n)) @ np.linalg.inv(T)
    B = rng.normal(size=(n, m))
    return A + B @ rng.normal(size=(m, n)) * 0.5, B


def experiment(rng, A, B, count, noise):
    n, m = B.shape
    X0, U0 = rng.normal(size=(n, count)), rng.normal(size=(m, count))
    return X0, A @ X0 + B @ U0 + rng.uniform(-noise, noise, (n, count)), U0


def consistent_plants(rng, data, noise, count):
    """Vertices of the set of plants that agree with the data: minimisers of random costs, row by row."""
    X0, X1, U0 = data
    Z = np.vstack([X0, U0])
    for _ in range(count):
        c = rng.normal(size=(len(X1), len(Z)))
        rows = [
            solve(w, np.vstack([Z.T, -Z.T]), np.concatenate([x + noise, noise - x]), bounds=(-np.inf, np.inf)).x
            for w, x in zip(c, X1, strict=True)
        ]
        yield np.array(rows)


@pytest.mark.parametrize(
    ("n", "m", "X", "discrete"),
    [
        (2, 1, None, True),
        (2, 1, None, False),
        (2, 1, TILTED, True),
        (2, 1, TILTED, False),
        (3, 1, kp.PolyhedralCone(SQUARE), True),
        (3, 2, None, True),
    ],
)
def test_no_plant_that_agrees_breaks_what_is_proven(n, m, X, discrete):
    rng, proven = np.random.default_rng(n + 10 * m + discrete), 0
    cone = kp.orthant(n) if X is None else X
    for _ in range(4):
        A, B = random_plant(rng, n, m, discrete=discrete, X=X)
        data = experiment(rng, A, B, 30, 0.01)
        found = kp.data_feedback(*data, noise=0.01, X=X, discrete=discrete)
        if not found:
            continue
        proven += 1
        assert found.check() and np.array_equal(found.K, -found.F)
        for plant in (np.hstack([A, B]), *consistent_plants(rng, data, 0.01, 15)):
            M = plant[:, :n] + plant[:, n:] @ found.F
            products = cone.facets @ M @ cone.rays.T
            assert (products[np.ones_like(cone.incidence) if discrete else cone.incidence] > -1e-7).all()
            growth = cone.facets @ (M @ found.e - discrete * found.e)
            assert (growth < 1e-9).all()
            roots = np.linalg.eigvals(M)
            assert (np.abs(roots).max() < 1) if discrete else (roots.real.max() < 0)
    assert proven


def vertices(Z, row, noise):
    """All vertices of the rows of plants that agree with the samples of one state."""
    sides, right = np.vstack([Z.T, -Z.T]), np.concatenate([row + noise, noise - row])
    for chosen in itertools.combinations(range(len(sides)), len(Z)):
        if abs(np.linalg.det(sides[list(chosen)])) > 1e-9:
            w = np.linalg.solve(sides[list(chosen)], right[list(chosen)])
            if (sides @ w <= right + 1e-9).all():
                yield w


def decay_by_vertices(X0, X1, U0, noise, *, discrete):
    """The best margin of a gain on the orthant, one input, with a common e, by a program over all vertices."""
    n, rows = len(X0), []
    for i in range(n):
        for w in vertices(np.vstack([X0, U0]), X1[i], noise):
            for k in range(n):
                if discrete or k != i:  # xi_k (A x_k + B F x_k)_i >= 0
                    rows.append(np.zeros(2 * n + 1))
                    rows[-1][[k, n + k]] = -w[k], -w[n]
            rows.append(np.concatenate([w[:n], np.full(n, w[n]), [1.0]]))
            rows[-1][i] -= discrete
    high = np.concatenate([np.ones(n), np.full(n + 1, np.inf)])
    low = np.concatenate([np.zeros(n), np.full(n + 1, -np.inf)])
    return -solve(-np.eye(2 * n + 1)[-1], np.array(rows), np.zeros(len(rows)), bounds=(low, high)).value


@pytest.mark.parametrize("discrete", [True, False])
def test_a_gain_is_found_or_excluded_as_the_vertices_say(discrete):
    rng, seen = np.random.default_rng(11 + discrete), []
    for k in range(16):
        A, B = random_plant(rng, 2, 1, discrete=discrete)
        noise = (0.05, 0.3, 0.6, 1.0)[k % 4]
        data = experiment(rng, A, B, 6, noise)
        margin = decay_by_vertices(*data, noise, discrete=discrete)
        found = kp.data_feedback(*data, noise=noise, discrete=discrete)
        assert found.status.name == ("PROVED" if margin > 1e-9 else "REFUTED") and found.check()
        seen.append(found.status.name)
        if not found:
            agrees = [np.abs(data[1] - A.values @ data[0] - B.values @ data[2]) for A, B in pairs(found.witness)]
            assert np.max(agrees) <= noise + 1e-12 and "no gain F keeps X" in found.explain()
    assert min(map(seen.count, ("PROVED", "REFUTED"))) > 2


def pairs(witness):
    return zip(witness.A, witness.B, strict=True)


def test_both_answers_come_close_to_the_edge():
    """A gain exists up to a noise of about 0.04957."""
    X0, U0 = np.array([[1, 0, 1, 2], [0, 1, 1, 1]]), np.array([[0, 0, 1, -1]])
    X1 = np.array([[1.2, 0.3], [0.1, 0.5]]) @ X0 + np.array([[1], [0.2]]) @ U0
    assert decay_by_vertices(X0, X1, U0, 0.0495, discrete=True) > 1e-5
    assert decay_by_vertices(X0, X1, U0, 0.0496, discrete=True) == 0
    assert kp.data_feedback(X0, X1, U0, noise=0.0495)
    beyond = kp.data_feedback(X0, X1, U0, noise=0.0496)
    assert beyond.status.name == "REFUTED" and "about 0.9" in beyond.message and beyond.F is None
    assert "makes all of them stable. The proof" in beyond.explain()
    wide = kp.data_feedback(X0, X1, U0, noise=0.1).explain()
    assert "with a common e" in wide and "Other proofs of stability" in wide


def test_a_few_bounds_that_can_only_be_zero_do_not_stop_the_proof():
    """Without noise the input cancels 1/3 exactly and leaves the zero below where it is."""
    X0, U0 = [[1, 0, 0], [0, 1, 0]], [[0, 0, 1]]
    found = kp.data_feedback(X0, [["3/4", "-1/3", 1], [0, "1/2", 0]], U0, noise=0)
    assert found and found.check() and found.certificate.plant.fractions()[0, 1] == Fraction(-1, 3)


def test_bounds_are_those_of_the_plants():
    """The box of A x is the range over all plants, by the other linear program, over plants."""
    rng = np.random.default_rng(3)
    X0, X1, U0 = experiment(rng, rng.normal(size=(3, 3)), rng.normal(size=(3, 1)), 20, 0.1)
    Z = np.vstack([X0, U0])
    samples, z = Samples(Z, X1, np.full(X1.shape, 0.1)), rng.normal(size=4)
    for i in range(3):
        rows = np.vstack([Z.T, -Z.T]), np.concatenate([X1[i] + 0.1, 0.1 - X1[i]])
        for side, sign in enumerate((1, -1)):
            direct = sign * solve(sign * z, *rows, bounds=(-np.inf, np.inf)).value
            found, l, w = extreme(samples, i, side, z, solve)
            assert (-sign * found.value) == pytest.approx(direct, abs=1e-7)
            assert np.allclose(Z @ l, z) and w @ z == pytest.approx(direct, abs=1e-7)


def test_one_combination_for_all_entries_is_only_sufficient():
    """h = (1, 1), X1 = [0 0 0; 0 0 3/2], Z = [1 0 1; 0 1 1], z = (1, 0), noise 1: one l is off by 1/2."""
    Z, X1 = np.array([[1.0, 0, 1], [0, 1, 1]]), np.array([[0.0, 0, 0], [0, 0, 1.5]])
    samples = Samples(Z, X1, np.ones((2, 3)))
    z = np.array([1.0, 0.0])
    each = [-extreme(samples, i, 0, z, solve)[0].value for i in range(2)]
    both = solve(np.concatenate([2 - X1.sum(0), 2 + X1.sum(0)]), None, None, np.hstack([Z, -Z]), z)
    assert sum(each) - (-both.value) == pytest.approx(0.5)


def test_a_verdict_without_a_gain_is_that_of_the_worst_plant():
    rng, seen = np.random.default_rng(5), set()
    for k in range(8):
        A = rng.uniform(0.05, 0.4, (2, 2))
        noise = (0.01, 0.3)[k % 2]
        X0 = rng.normal(size=(2, 12))
        X1 = A @ X0 + rng.uniform(-noise, noise, (2, 12))
        found = kp.data_positivity(X0, X1, noise=noise)
        samples = Samples(X0, X1, np.full(X1.shape, noise))
        least = min(-extreme(samples, i, 0, z, solve)[0].value for i in range(2) for z in np.eye(2))
        assert found.status.name == ("PROVED" if least > 0 else "REFUTED") and found.check()
        seen.add(found.status.name)
        if not found:
            w = found.witness
            assert (np.abs(X1 - w.plant.values @ X0) <= noise + 1e-15).all()
            assert w.normal @ w.plant.values @ np.eye(2)[w.ray] < 0
    assert seen == {"PROVED", "REFUTED"}


@pytest.mark.parametrize(("X", "discrete"), [(TILTED, True), (TILTED, False), (kp.PolyhedralCone(SQUARE), True)])
def test_a_verdict_on_other_cones_is_that_of_programs_over_plants(X, discrete):
    rng, n, seen = np.random.default_rng(8), X.dim, set()
    for k in range(8):
        A, _ = random_plant(rng, n, 1, discrete=discrete, X=X)
        noise, X0 = (0.01, 0.5)[k % 2], rng.normal(size=(n, 15))
        inside = np.outer(X.interior_point, X.facets.sum(axis=0))
        A = (0.1 * A if discrete else A) + inside / np.linalg.norm(inside)
        X1 = A @ X0 + rng.uniform(-noise, noise, (n, 15))
        least = np.inf
        for h, x in itertools.product(X.facets, X.rays):
            if discrete or abs(h @ x) < 1e-12:
                rows = [
                    solve(
                        a * x,
                        np.vstack([X0.T, -X0.T]),
                        np.concatenate([b + noise, noise - b]),
                        bounds=(-np.inf, np.inf),
                    )
                    for a, b in zip(h, X1, strict=True)
                ]
                least = min(least, sum(row.value for row in rows))
        found = kp.data_positivity(X0, X1, noise=noise, X=X, discrete=discrete)
        assert found.status.name == ("PROVED" if least > 0 else "REFUTED") and found.check()
        seen.add(found.status.name)
        if not found:
            w = found.witness
            assert (np.abs(X1 - w.plant.values @ X0) <= noise + 1e-12).all()
            assert w.normal @ w.plant.values @ X.rays[w.ray] < 0
    assert seen == {"PROVED", "REFUTED"}


@pytest.mark.parametrize("name", list(certified_data.CERTIFICATES))
def test_perturbed_certificates_fail(name):
    cert = certified_data.CERTIFICATES[name]()
    assert cert.status.name == ("REFUTED" if "not" in name else "PROVED") and cert.check()
    assert cert.explain().startswith(cert.status.name.capitalize())
    worse = {"noise": Matrix(50 * cert.noise.values)}
    worse |= {"X1": Matrix(-4 * cert.X1.values)}
    if cert:
        worse |= {"combinations": Matrix(1.5 * cert.combinations.values)}
        worse |= {"plant": Matrix(cert.plant.values + 1)}
        worse |= {} if cert.e is None else {"e": -cert.e}
    for field, value in worse.items():
        if cert or field == "X1":
            assert not replace(cert, **{field: value}).check(), field


def test_experiments_stand_beside_each_other():
    parts = [np.array([[1.0, 0], [0, 1]]), np.array([[1.0], [1]])]
    images = [0.5 * part for part in parts]
    apart = kp.data_positivity(parts, images, noise=0)
    joined = kp.data_positivity(np.hstack(parts), np.hstack(images), noise=[0, 0])
    assert apart and apart.certificate == joined.certificate
    assert (
        kp.data_positivity(parts, images, noise=[np.zeros((2, 2)), np.zeros((2, 1))]).certificate == apart.certificate
    )
    stacked = np.stack([parts[0]] * 2)
    assert kp.data_positivity(stacked, 0.5 * stacked, noise=0)


def test_data_that_do_not_suffice_come_with_advice():
    flat = kp.data_positivity([[1, 2], [1, 2]], [[0.5, 1], [0.5, 1]], noise=0.1)
    assert (
        flat.status.name == "UNDECIDED" and "reach only 1 of 2 dimensions, and nothing is known along" in flat.message
    )
    tied = kp.data_feedback([[1, 0], [0, 1]], [[2, 0], [0, 2]], [[1, 1]], noise=0.1)
    assert "the rank of X0 above U0 is 2, not 3" in tied.message and tied.F is None
    known = kp.data_positivity([[1, 0], [0, 1]], [["1/2", "1/10"], [0, "1/2"]], noise="1/10")
    assert known.status.name == "REFUTED" and known.plant is not None
    square = [[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]]
    states, images = np.eye(3), np.diag([0.5, 0.5, 1.2])
    noisy = kp.data_feedback(states, images, [[0, 0, 0]], noise=0.1, X=square)
    assert noisy.status.name == "UNDECIDED" and "rank of X0 above U0 is 3, not 4" in noisy.message


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        ({"X1": [[0.5, 0.2, 0.7]]}, ShapeError, "X1 has 1 rows, but X0 has 2"),
        ({"X1": [[0.5, 0.2], [0.1, 0.4]]}, ShapeError, "X1 has 2 columns, but X0 has 3"),
        ({"X1": [[0.5, np.nan, 0.7], [0.1, 0.4, 0.5]]}, DataError, r"X1\[0, 1\] is nan.*the same columns"),
        ({"U0": [[0, 1]]}, ShapeError, "U0 has 2 columns, but X0 has 3"),
        ({"noise": -0.1}, DataError, "noise is negative for state 0"),
        ({"noise": [0.1, 0.1, 0.1]}, ShapeError, "give one number, or 2"),
        ({"X": kp.orthant(3)}, ConeMismatchError, "3 dimensions, but X0 has 2"),
        ({"X1": [np.ones((2, 3)), np.ones((2, 3))]}, ShapeError, "2 experiments, but X0 has 1"),
        (
            {"X1": [[0.5, 0.2, 5], [0.1, 0.4, 0.5]]},
            DataError,
            "no plant agrees with the samples X0, X1 and U0: those of state 0",
        ),
        ({"U0": None}, DataError, "U0 is None"),
    ],
)
def test_arguments_that_do_not_fit(call, error, words):
    good = {"X0": [[1, 0, 1], [0, 1, 1]], "X1": [[0.5, 0.2, 0.7], [0.1, 0.4, 0.5]], "U0": [[0, 0, 0]], "noise": 0.01}
    if "no plant" in words:
        good["U0"] = [[1, 0, 1]]
        good = {**good, "X0": [[1, 0, 1, 0], [0, 1, 1, 1]], "U0": [[0, 0, 1, 0]]}
        call = {"X1": [[0.5, 0.2, 0.7, 5], [0.1, 0.4, 0.5, 0.4]]}
    with pytest.raises(error, match=words):
        kp.data_feedback(**good | call)
