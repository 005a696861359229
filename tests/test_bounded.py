"""Order intervals and gains with hard bounds: worked examples, random truth, constraints, forged certificates."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import scipy.optimize

import control_kpos as kp
from control_kpos.design.bounded.certificate import BoundExceeded, NoInterval
from control_kpos.design.bounded.contradiction import BoundedFunctionals
from control_kpos.errors import DataError, ShapeError
from control_kpos.exact.intake import exact_matrix
from control_kpos.exact.matrix import Matrix

SEED = kp.PolyhedralCone([[0, 1], [1, -2]])
SQUARE = kp.PolyhedralCone([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
SKEWED = kp.PolyhedralCone([[2, 1, 0], [0, 2, 1], [1, 0, 3]])
CONES = {"orthant": kp.orthant(3), "seed": SEED, "skewed": SKEWED, "square": SQUARE}


def system(A, discrete=False, X=None):
    n = len(A)
    return kp.ConeStateSpace(A, np.eye(n)[:, [0]], np.eye(n), 0, discrete, X=X)


def exact(rows):
    return np.array([[Fraction(x) for x in row] for row in rows], dtype=object)


def invariant_matrix(rng, X, discrete, size):
    """A matrix that keeps X, with a spectral abscissa near size - 1 (radius near size), in sixty-fourths."""
    weights = rng.integers(1, 5, (X.n_rays, X.n_facets))
    M = sum(
        w * np.outer(r, h) for row, r in zip(weights, X.rays, strict=True) for w, h in zip(row, X.facets, strict=True)
    )
    M = M / np.abs(np.linalg.eigvals(M)).max()
    rounded = np.round(M * 64) / 64
    return rounded * size if discrete else rounded - (2 - size) * np.eye(X.dim)


# -- intervals


def test_the_interval_of_the_paper_s_loop():
    """-A^{-1} (0, 1) = (1/22, 0), on the boundary of the cone, and x_1 <= 1/22 exactly."""
    loop = system([[0, 1], [-22, -13]], X=SEED)
    b = kp.order_interval(loop, [0, 1], constraints=([[1, 0], [0, -1]], ["1/22", "1/10"]))
    assert b and b.check() and b.certificate.gap == 0
    assert b.certificate.exact[1] == (Fraction(1, 22), 0)
    np.testing.assert_allclose(b.x_max, [1 / 22, 0])
    np.testing.assert_allclose(b.x_min, b.x_max)
    assert Fraction(1, 22) <= b.reached[0] <= Fraction(1, 22) * (1 + Fraction(1, 10**15))
    assert b.reached[1] == pytest.approx(2 / 22)  # the interval is {x : 0 <= x_1, ...}, not a point


def test_a_bound_just_below_what_is_reached_is_refuted():
    loop = system([[0, 1], [-22, -13]], X=SEED)
    b = kp.order_interval(loop, [0, 1], constraints=([[1, 0]], ["1/23"]))
    assert b.status == "REFUTED" and b.check() and isinstance(b.witness, BoundExceeded)
    assert b.x_max is None and b.witness.row == 0


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("cone", CONES)
def test_random_intervals_are_the_smallest_and_bounds_are_decided(cone, discrete):
    X, rng = CONES[cone], np.random.default_rng(7)
    drift = -np.eye(X.dim) if discrete else np.zeros((X.dim, X.dim))
    for _ in range(6):
        A = invariant_matrix(rng, X, discrete, 0.75)
        if not system(A, discrete, X).is_cone_positive():
            continue
        w = X.rays.T @ rng.integers(0, 3, X.n_rays)
        b = kp.order_interval(system(A, discrete, X), w)
        assert b and b.check() and b.certificate.gap == 0
        x = np.array(b.certificate.exact[1] if b.certificate.exact else list(map(Fraction, b.x_max)), dtype=object)
        assert (exact(A + drift) @ x == -exact([w])[0]).all()
        f = rng.integers(-3, 4, X.dim)
        most = largest(X, f, x)
        for c, status in ((most, "PROVED"), (most - Fraction(1, 10**9), "REFUTED")):
            b = kp.order_interval(system(A, discrete, X), w, constraints=([f], [c]))
            assert b.status == status and b.check()


def largest(X, f, x):
    """max f'y over y and x - y in X, at one of the vertices: exact, by all choices of dim facets."""
    from itertools import combinations

    H = exact(X.facets)
    rows, right = np.concatenate([H, -H]), np.concatenate([np.zeros(len(H), dtype=object), -(H @ x)])
    best = Fraction(0)
    for chosen in combinations(range(len(rows)), X.dim):
        y = solved(rows[list(chosen)], right[list(chosen)])
        if y is not None and (rows @ y >= right).all():
            best = max(best, f.astype(object) @ y)
    return best


def solved(M, b):
    """Gauss in fractions; None if singular."""
    M, n = np.concatenate([M, b[:, None]], axis=1) * Fraction(1), len(M)
    for k in range(n):
        pivot = next((i for i in range(k, n) if M[i, k]), None)
        if pivot is None:
            return None
        M[[k, pivot]] = M[[pivot, k]]
        M[k] /= M[k, k]
        for i in range(n):
            if i != k:
                M[i] -= M[i, k] * M[k]
    return M[:, -1]


@pytest.mark.parametrize("discrete", [False, True])
def test_trajectories_stay_inside(discrete):
    rng = np.random.default_rng(3)
    A = invariant_matrix(rng, SKEWED, discrete, 0.8)
    w = SKEWED.rays.sum(axis=0)
    b = kp.order_interval(system(A, discrete, SKEWED), w)
    step = 1 if discrete else 1e-3
    for _ in range(20):
        x = np.zeros(3)
        for _ in range(300):
            push = SKEWED.rays.T @ (
                rng.integers(0, 2, 3) * (SKEWED.facets @ w) / np.diag(SKEWED.facets @ SKEWED.rays.T)
            )
            x = A @ x + push if discrete else x + step * (A @ x + push)
            assert (SKEWED.facets @ x > -1e-9).all() and (SKEWED.facets @ (b.x_max - x) > -1e-9).all()


def test_disturbances_that_do_not_reach_what_grows():
    """diag(1, -1): w in the second state alone is kept by [0, (0, 1)]; in the first by nothing."""
    grows = system([[1, 0], [0, -1]])
    b = kp.order_interval(grows, [0, 1])
    assert b and b.x_min is None and np.isnan(b.certificate.gap)
    np.testing.assert_array_equal(b.x_max, [0, 1])
    no = kp.order_interval(grows, [1, 0])
    assert no.status == "REFUTED" and no.check() and isinstance(no.witness, NoInterval)


def test_a_field_that_leaves_the_cone_keeps_no_interval():
    no = kp.order_interval(system([[-1, -1], [0, -1]]), [1, 1])
    assert no.status == "REFUTED" and isinstance(no.witness, kp.PositivityViolation) and "does not keep X" in no.message


def test_no_disturbance_and_no_states_to_spare():
    b = kp.order_interval(system([[-1, 0], [0, -2]]), [0, 0], constraints=([[1, 1]], [0]))
    assert b and not b.x_max.any() and b.reached.tolist() == [0]


def test_many_states_have_bounds_on_both_sides():
    rng = np.random.default_rng(0)
    A = rng.random((60, 60)) - 60 * np.eye(60)
    b = kp.order_interval(system(A), rng.random(60), constraints=(rng.random((2, 60)), [9, 9]))
    assert b and b.check() and 0 < b.certificate.gap < 1e-9 and (b.x_min < b.x_max).all()
    assert "smaller by at most" in b.explain()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"x_max": np.array([0.0454, 0.0])}, "not invariant"),
        ({"x_min": np.array([0.05, 0.0])}, "not below"),
        ({"bounds": np.array([0.04])}, "not reached"),
        ({"lyapunov": np.array([-1.0, 0.0])}, "no proof of stability"),
        ({"w_max": np.array([0.0, 2.0])}, "larger disturbances"),
        ({"w_max": np.array([0.0, -1.0])}, "outside X"),
    ],
)
def test_changed_certificates_prove_nothing(change, why):
    loop = system([[0, 1], [-22, -13]], X=SEED)
    good = kp.order_interval(loop, [0, 1], constraints=([[1, 0]], ["1/22"])).certificate
    data = {k: v for k, v in good.data().items() if k != "exact"}
    widened = {"x_max": np.array([0.0455, -1e-9]), "x_min": np.array([0.0454, 0.0]), "bounds": np.array([0.05])}
    assert type(good).settle(**data | widened), "the change alone is at fault"
    assert not type(good).settle(**data | widened | change), why


def test_rows_of_another_size_are_refused():
    good = kp.order_interval(system([[-1, 0], [0, -1]]), [1, 1], constraints=([[1, 0]], [1])).certificate
    other = kp.order_interval(system([[-1]]), [1], constraints=([[1]], [1])).certificate
    for change in ({"rows": other.rows}, {"covers": other.covers}, {"bounds": np.array([1.0, 1.0])}, {"covers": None}):
        with pytest.raises(DataError):
            type(good).settle(**good.data() | change)


def test_forged_witnesses_refute_nothing():
    no = kp.order_interval(system([[1, 0], [0, -1]]), [1, 0]).certificate
    for d in ([0, 1], [-1, 0], [0, 0]):
        assert (
            type(no).settle(**no.data() | {"witness": NoInterval(np.array(d, dtype=float)), "exact": None}).status
            == "UNDECIDED"
        )
    no = kp.order_interval(system([[0, 1], [-22, -13]], X=SEED), [0, 1], constraints=([[1, 0]], ["1/23"])).certificate
    for x, row in (([0.05, 0], 0), ([0.01, 0], 0), (no.witness.x, 1)):
        forged = BoundExceeded(np.array(x, dtype=float), row)
        assert type(no).settle(**no.data() | {"witness": forged}).status == "UNDECIDED"
    with pytest.raises(DataError, match="number of a row"):
        type(no).settle(**no.data() | {"witness": BoundExceeded(no.witness.x, -1)})


def test_an_undecided_certificate_states_nothing():
    good = kp.order_interval(system([[-1]]), [1]).certificate
    assert replace(good, status=kp.Status.UNDECIDED).explain().startswith("Undecided")


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"w_max": [1]}, ShapeError, r"w_max has shape \(1,\)"),
        ({"w_max": [1, -1]}, DataError, "outside X, beyond facet 1"),
        ({"w_max": [1, np.nan]}, DataError, "w_max"),
        ({"constraints": ([[1, 0]],)}, ShapeError, "pair"),
        ({"constraints": lambda F: [F <= 1]}, ShapeError, r"a pair \(f, c\)"),
        ({"constraints": ([[1, 0, 0]], [1])}, ShapeError, "constraints f"),
        ({"constraints": ([[1, 0]], [1, 2])}, ShapeError, "constraints c"),
        ({"sys": "no"}, DataError, "sys is a str"),
    ],
)
def test_wrong_arguments_of_an_interval(kwargs, error, words):
    with pytest.raises(error, match=words):
        kp.order_interval(**{"sys": system([[-1, 0], [0, -1]]), "w_max": [1, 1]} | kwargs)


# -- gains


def planted(rng, n, m, discrete):
    """A plant, and x_max, w_max, u_max that some gain keeps on the orthant with room to spare."""
    M, x = rng.uniform(0.05, 1, (n, n)), rng.uniform(0.5, 2, n)
    M = M / (M @ x / x).max() * 0.8 if discrete else M - np.diag(M @ x / x) * 1.3
    B, F = rng.standard_normal((n, m)), rng.standard_normal((m, n))
    w = 0.5 * (x - M @ x if discrete else -M @ x)
    u = 1.01 * np.maximum(np.maximum(F, 0) @ x, np.maximum(-F, 0) @ x)
    plant = kp.ConeStateSpace(M - B @ F, B, np.eye(n), np.zeros((n, m)), discrete)
    return plant, x, w, u


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2), (6, 3)])
def test_planted_gains_are_found_and_keep_the_bounds(n, m, discrete):
    rng = np.random.default_rng(n)
    for _ in range(3):
        plant, x, w, u = planted(rng, n, m, discrete)
        d = kp.state_feedback(plant, state_bounds=x, input_bounds=u, disturbance_bounds=w)
        assert d and d.check() and kp.state_positivity(d.closed_loop.A, plant.X, discrete=discrete)
        np.testing.assert_array_equal(d.x_max, x)
        assert not d.limit > d.value
        moved = (plant.A + plant.B @ d.F - discrete * np.eye(n)) @ x + w
        assert (moved <= 1e-12).all()
        assert (np.maximum(np.maximum(d.F, 0) @ x, np.maximum(-d.F, 0) @ x) <= u).all()
        b = kp.order_interval(d.closed_loop, w, constraints=(np.concatenate([d.F, -d.F]), np.tile(u, 2)))
        assert b and (b.x_max <= x * (1 + 1e-12)).all()


def test_the_smallest_gain_of_the_paper_s_plant():
    """Invariance alone asks for |F x_k| >= 5; within a thousandth of it the bounds are kept."""
    plant = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=SEED)
    d = kp.state_feedback(plant, state_bounds=[1, -1], input_bounds=10, disturbance_bounds=[0, "1/10"], rate=1)
    assert d and 5 <= d.value <= 5.01 and d.decay_rate >= 1
    no = kp.state_feedback(plant, state_bounds=[1, -1], input_bounds=4)
    assert no.status == "REFUTED" and no.check() and "No gain within these bounds" in no.explain()


def test_a_cone_with_four_generators():
    plant = kp.ConeStateSpace([[-1, 0.2, 0], [0.1, -1, 0], [0, 0, 0.5]], [[0], [0], [1]], np.eye(3), 0, X=SQUARE)
    d = kp.state_feedback(plant, state_bounds=[0, 0, 1], input_bounds=2, disturbance_bounds=[0, 0, "1/4"])
    assert d and d.check() and -0.77 < d.F[0, 2] < -0.75


def test_an_interval_is_found_where_none_is_given():
    plant = kp.ConeStateSpace([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0, X=SEED)
    d = kp.state_feedback(plant, disturbance_bounds=[0, 1], input_bounds=2)
    assert d and d.check() and d.x_max is not None
    assert SEED.contains(d.x_max) and d.certificate.others[-1].w_max.tolist() == [0, 1]


def test_vertices_share_one_interval():
    pairs = [([[-1, 0.5], [0.5, a]], [[0], [1]]) for a in (0.2, 0.4)]
    plant = kp.ConeStateSpace(*pairs[0], np.eye(2), 0)
    d = kp.state_feedback(plant, vertices=pairs, state_bounds=[1, 1], input_bounds=3)
    kept = [part for part in d.certificate.others if hasattr(part, "x_max")]
    assert d and d.check() and len(kept) == 2
    d = kp.state_feedback(plant, vertices=pairs, disturbance_bounds=[1, 1], input_bounds=9)
    assert d and d.check()


def test_weakened_actuators_keep_the_interval():
    plant, x, w, u = planted(np.random.default_rng(5), 3, 2, discrete=False)
    d = kp.state_feedback(plant, state_bounds=x, input_bounds=2 * u, disturbance_bounds=w / 8)
    least = d.certified_fraction
    for s in np.array(np.meshgrid(*[[least, 1.0]] * 2)).T.reshape(-1, 2) if least < 1 else ():
        assert ((plant.A + plant.B @ np.diag(s) @ d.F) @ x + w / 8 <= 1e-9).all()


def test_a_plant_that_no_gain_helps_is_refused_as_without_bounds():
    plant = kp.ConeStateSpace(*kp.examples.mass_spring())
    d = kp.state_feedback(plant, state_bounds=[1, 1], input_bounds=1)
    assert d.status == "REFUTED" and d.check()


# -- no gains


def smallest_part(plant, x, w, u, discrete):
    """The smallest s for which F = P - N, P, N >= 0, P x <= s u and N x <= s u keep the orthant and [0, x]."""
    n, m, eye = plant.nstates, plant.ninputs, np.eye(plant.nstates)
    moved = np.concatenate([np.kron(plant.B, eye), -np.kron(plant.B, eye)], axis=1)  # entries of B F
    off = np.ones((n, n), dtype=bool) if discrete else ~np.eye(n, dtype=bool)
    ends, used = np.kron(plant.B, x[None]), np.kron(np.eye(2 * m), x[None])
    rows = [-moved[off.ravel()], np.concatenate([ends, -ends], axis=1), used]
    right = [plant.A[off], -(plant.A - discrete * eye) @ x - w, np.zeros(2 * m)]
    part = [np.zeros(off.sum()), np.zeros(n), -np.tile(u, 2)]
    A = np.concatenate([np.concatenate(rows), np.concatenate(part)[:, None]], axis=1)
    return scipy.optimize.linprog(np.eye(1, A.shape[1], A.shape[1] - 1)[0], A, np.concatenate(right)).fun


@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize(("n", "m"), [(2, 1), (3, 2), (5, 2)])
def test_smaller_bounds_than_the_smallest_are_refuted(n, m, discrete):
    """Against a linear program of its own, on the orthant."""
    rng = np.random.default_rng(10 * n + m)
    for _ in range(4):
        plant, x, w, u = planted(rng, n, m, discrete)
        part = smallest_part(plant, x, w, u, discrete)
        if part < 1e-6:
            continue  # no input is needed
        asked = {"state_bounds": x, "disturbance_bounds": w}
        no = kp.state_feedback(plant, **asked, input_bounds=0.999 * part * u)
        assert no.status == "REFUTED" and no.check() and isinstance(no.certificate.witness, BoundedFunctionals)
        assert kp.state_feedback(plant, **asked, input_bounds=1.001 * part * u).status != "REFUTED"


def test_refusals_without_bounds_on_inputs_with_structure_and_with_vertices():
    """x_2 is pushed harder than x_1 alone can tell the input; and two plants need inputs of two signs."""
    plant = kp.ConeStateSpace([[-1, 0], [0, 0.5]], [[0], [1]], np.eye(2), 0)
    asked = {"state_bounds": [1, 1], "disturbance_bounds": [0, "1/3"]}
    assert kp.state_feedback(plant, **asked)
    no = kp.state_feedback(plant, **asked, structure=[[1, 0]])
    assert no.status == "REFUTED" and no.check()
    pairs = [([[-1, 0], [0, 0.5]], [[0], [b]]) for b in (1, -1)]
    no = kp.state_feedback(plant, vertices=pairs, state_bounds=[1, 1])
    assert no.status == "REFUTED" and no.check()


def test_a_cone_with_four_generators_and_weak_inputs():
    """x_3' = x_3 / 2 + u + 1/4 on [0, (0, 0, 1)] takes |u| = 3/4."""
    plant = kp.ConeStateSpace([[-1, 0.2, 0], [0.1, -1, 0], [0, 0, 0.5]], [[0], [0], [1]], np.eye(3), 0, X=SQUARE)
    asked = {"state_bounds": [0, 0, 1], "disturbance_bounds": [0, 0, "1/4"]}
    no = kp.state_feedback(plant, **asked, input_bounds="0.7499")
    assert no.status == "REFUTED" and no.check() and "4 generators" in no.explain()
    assert kp.state_feedback(plant, **asked, input_bounds="0.7501")


@pytest.mark.parametrize("name", ["L", "d", "up", "up_rest", "down", "down_rest", "times"])
def test_forged_functionals_refute_nothing(name):
    plant = kp.ConeStateSpace([[-1, 0], [0, 0.5]], [[0], [1]], np.eye(2), 0)
    no = kp.state_feedback(plant, state_bounds=[1, 1], input_bounds="1/2", disturbance_bounds=[0, "1/3"]).certificate
    assert no.status == "REFUTED"
    w = no.witness
    held = w.L[0] if name == "L" else getattr(w, name)
    for change in (held.fractions() + 1, -held.fractions() - 1):
        changed = Matrix.from_fractions(change)
        forged = replace(w, **{name: (changed,) if name == "L" else changed})
        assert type(no).settle(**no.data() | {"witness": forged}).status == "UNDECIDED"
    with pytest.raises(DataError):
        type(no).settle(
            **no.data() | {"witness": replace(w, **{name: (held.T[None][0],) * 2 if name == "L" else None})}
        )


@pytest.mark.parametrize(
    ("name", "value"), [("u_max", [["3/4", 9]]), ("w_max", [[0, 0]]), ("x_max", [[1, 9]]), ("pattern", None)]
)
def test_a_refusal_is_about_its_own_bounds(name, value):
    plant = kp.ConeStateSpace([[-1, 0], [0, 0.5]], [[0], [1]], np.eye(2), 0)
    no = kp.state_feedback(plant, state_bounds=[1, 1], input_bounds="1/2", disturbance_bounds=[0, "1/3"]).certificate
    if name == "pattern":
        assert type(no).settle(**no.data() | {"pattern": np.zeros((1, 2))}).status == "REFUTED"  # fewer gains
        return
    value = exact_matrix(value if name != "u_max" else [["9/10"]], name)
    assert type(no).settle(**no.data() | {name: value}).status == "UNDECIDED"
    with pytest.raises(DataError):
        type(no).settle(**no.data() | {name: exact_matrix([[1, 2, 3]], name)})


def test_an_undecided_refusal_states_nothing():
    plant = kp.ConeStateSpace([[-1, 0], [0, 0.5]], [[0], [1]], np.eye(2), 0)
    no = kp.state_feedback(plant, state_bounds=[1, 1], input_bounds="1/4").certificate
    assert replace(no, status=kp.Status.UNDECIDED).explain().startswith("Undecided")


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"input_bounds": 1}, DataError, "input_bounds alone"),
        ({"state_bounds": [1, 0]}, DataError, "state_bounds is not inside X"),
        ({"state_bounds": [1]}, ShapeError, "state_bounds has shape"),
        ({"disturbance_bounds": [0, -1]}, DataError, "disturbance_bounds is not in X"),
        ({"state_bounds": [1, 1], "input_bounds": [1, 2]}, ShapeError, "input_bounds has 2 entries"),
        ({"state_bounds": [1, 1], "input_bounds": 0}, DataError, "must be positive"),
        ({"state_bounds": [1, 1], "rate": "max"}, DataError, "number as rate"),
        ({"state_bounds": [1, 1], "objective": lambda F: 0}, DataError, "number as rate"),
    ],
)
def test_wrong_bounds(kwargs, error, words):
    plant = kp.ConeStateSpace([[-1, 1], [1, 1]], [[0], [1]], np.eye(2), 0)
    with pytest.raises(error, match=words):
        kp.state_feedback(plant, **kwargs)


def test_no_disturbance_is_told_as_any_other():
    b = kp.order_interval(system([[-1, 0], [0, -2]]), [0, 0])
    assert b and b.certificate.gap == 0 and "contains this one" in b.explain() and b._repr_html_()


def test_constraints_beside_what_grows_are_left_open():
    grows = system([[1, 0], [0, -1]])
    assert kp.order_interval(grows, [0, 1], constraints=([[0, 1]], [1]))
    b = kp.order_interval(grows, [0, 1], constraints=([[0, 1]], ["1/2"]))
    assert b.status == "UNDECIDED" and "an invariant interval was found" in b.message
