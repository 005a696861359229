"""Proofs that no gain exists are true, and certificates of designs do not survive a change of their data."""

import itertools
from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import planted
import pytest
from certified import third

import control_kpos as kp
from control_kpos import checker
from control_kpos.design.certificates import GainBoundCertificate
from control_kpos.design.contradiction import Functionals, Multipliers, NoFeedback
from control_kpos.exact.intake import exact_matrix
from control_kpos.exact.matrix import Matrix

PAPER = [[0, 1], [1, -2]]
PLANT = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2), (6, 3), (10, 5)])
@pytest.mark.parametrize("length", [1.0, 1e-3, 7.0])
def test_bounds_just_above_the_limit_are_met_and_just_below_refuted(n, m, length):
    A, B, rays, _ = planted.simplicial(np.random.default_rng(n), n, m)
    rays = length * rays
    sys = ct.ss(A, B, np.eye(n), 0)
    limit = kp.state_feedback(sys, X=rays).limit
    if limit == 0:
        pytest.skip("this plant needs no gain")
    above = kp.state_feedback(sys, X=rays, gain_bound=1.02 * limit)
    assert above and np.abs(above.F @ planted.unit(rays).T).max() <= 1.02 * limit * (1 + 1e-14)
    assert limit == pytest.approx(kp.state_feedback(sys, X=rays / length).limit, rel=1e-4)
    below = kp.state_feedback(sys, X=rays, gain_bound=0.98 * limit)
    assert below.status is kp.Status.REFUTED and below.check()


@pytest.mark.parametrize(("n", "m"), [(2, 1), (3, 1), (4, 2)])
def test_rates_just_below_the_limit_are_reached_and_just_above_refuted(n, m):
    rng = np.random.default_rng(n)
    seen = 0
    for _ in range(10):
        A, B, rays, _ = planted.simplicial(rng, n, m)
        sys = ct.ss(A, B, np.eye(n), 0)
        limit = kp.state_feedback(sys, X=rays, rate="max", gain_bound=20).limit
        below = kp.state_feedback(sys, X=rays, rate=0.99 * limit, gain_bound=20)
        above = kp.state_feedback(sys, X=rays, rate=1.01 * limit, gain_bound=20)
        assert below and below.decay_rate >= 0.99 * limit
        assert above.status is kp.Status.REFUTED and above.check()
        seen += 1
    assert seen == 10


def test_refusals_on_cones_whose_exact_facets_exceed_doubles():
    A, B, rays, _ = planted.simplicial(np.random.default_rng(0), 20, 5)
    d = kp.state_feedback(ct.ss(A, B, np.eye(20), 0), X=rays, gain_bound=1e-3)
    assert d.status is kp.Status.REFUTED and d.check()


@pytest.mark.parametrize("seed", range(30))
def test_refuted_means_that_no_gain_on_a_grid_works(seed):
    rng = np.random.default_rng(seed)
    A, B = rng.integers(-3, 4, size=(2, 2)), rng.integers(-2, 3, size=(2, 1))
    rays = [[0, 1], [1, int(rng.integers(-2, 3))]]
    d = kp.state_feedback(ct.ss(A, B, np.eye(2), 0), X=rays)
    X = kp.PolyhedralCone(rays)
    works = any(
        bool(kp.linear_lyapunov(A + B @ np.array([[f, g]]), X)) for f in range(-16, 17, 2) for g in range(-16, 17, 2)
    )
    assert d.status is not kp.Status.UNDECIDED
    assert d or not works
    assert d.check()


def refuted():
    return kp.state_feedback(PLANT, X=kp.orthant(2)).certificate


def test_perturbed_multipliers_prove_nothing():
    c = refuted()
    w = c.witness
    assert c.check()
    for name in ("L", "d"):
        for k, sign in itertools.product(range(4 if name == "L" else 2), (1, -1)):
            part = (w.L[0] if name == "L" else w.d).fractions()
            part.ravel()[k] += sign * Fraction(1, 10**9)
            part = Matrix.from_fractions(part)
            assert not replace(c, witness=replace(w, **{name: (part,) if name == "L" else part})).check()
    zero = Functionals((Matrix.zeros(2, 2),), Matrix.zeros(2, 1))
    assert not replace(c, witness=zero).check()
    for other in (Functionals(()), Functionals(w.L), Functionals(w.L, w.d, w.d), Functionals(w.L, w.L[0])):
        assert not replace(c, witness=other).check()


def test_multipliers_of_facets_combine_to_functionals():
    """As in files of version 0.1."""
    c, one = refuted(), Fraction(1)
    data = {name: value for name, value in c.data().items() if name != "witness"}
    # (A + B F) e1 has the components 0 and F_11 - 1: drift of the first facet, which nothing makes negative
    again = NoFeedback.refuted(**data, witness=Multipliers((0 * one,) * 2, (one, 0 * one), (0 * one,) * 2))
    assert again.status.name == c.status.name == "REFUTED" and isinstance(again.witness, Functionals)
    none = NoFeedback.refuted(**data, witness=Multipliers((0 * one,) * 2, (0 * one,) * 2, (one,) * 2))
    assert none.status.name == "UNDECIDED"


def test_refutation_is_about_its_own_data():
    c = refuted()
    assert not replace(c, X=kp.PolyhedralCone(PAPER)).check()
    assert not replace(c, rate=-1.0).check()
    assert not replace(c, witness=None).check()


def test_refuted_invariance_does_not_survive_perturbation():
    square = kp.PolyhedralCone([[1, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
    turn = ct.ss([[0, -5, 0], [5, 0, 0], [0, 0, -1]], [[0], [0], [1]], np.eye(3), 0)
    c = kp.state_feedback(turn, X=square, structure=[[1, 0, 0]]).certificate
    assert c.status is kp.Status.REFUTED and c.check()
    (l,) = (part.fractions() for part in c.witness.L)
    for other in (-l, 0 * l, l[:, ::-1], l[:, 1:]):
        assert not replace(c, witness=Functionals((Matrix.from_fractions(other),))).check()


def test_gain_bound_is_exact():
    X = kp.PolyhedralCone(PAPER)
    F = exact_matrix([[-21, -13]], "F")
    assert GainBoundCertificate.settle(F=F, bound=np.array([13.0]), X=X)
    assert not GainBoundCertificate.settle(F=F, bound=np.array([np.nextafter(13.0, 0)]), X=X)


def test_common_vector_and_disturbance_do_not_survive_perturbation():
    vertices = [([[0, 1], [-k, 0]], [[0], [1]]) for k in (0.5, 2)]
    c = kp.state_feedback(PLANT, X=PAPER, vertices=vertices).certificate
    common = c.others[-1]
    assert c.check() and common.check()
    assert not replace(common, x=-common.x).check()
    assert not replace(common, x=np.array([1.0, 1e6])).check()
    d = kp.state_feedback(PLANT, X=PAPER, disturbance=([[0], [1]], [[1, 0]]), gain_bound=8).certificate
    bound = d.others[-1]
    assert bound.check() and not replace(bound, gamma=0.5 * bound.gamma).check()
    assert not replace(bound, x=100 * bound.x).check()


def test_decay_rates_of_vertices_are_those_of_their_hull():
    """Each of three vertices decays at 0.92 or faster with a vector of its own, but not all their mixtures do."""
    X, B = (
        kp.PolyhedralCone([[-1, -1], [2, 1]]),
        [[[-1, -1], [2, 1]], [[-1.25, -1], [1.75, 0.75]], [[-1.25, -1.25], [1.75, 1]]],
    )
    A = [[[-0.64, -0.65], [-1.69, 0.37]], [[-0.28, -0.62], [-1.43, 0.33]], [[-0.43, -0.96], [-1.56, 0.1]]]
    plant, structure = kp.ConeStateSpace(A[0], B[0], np.eye(2), np.zeros((2, 2)), X=X), [[False, False], [True, True]]
    d = kp.state_feedback(plant, vertices=list(zip(A, B, strict=True)), structure=structure, rate="max")
    common = d.certificate.others[-1]
    assert d and d.decay_rate == d.certificate.decay_rate == common.decay_rate <= d.limit
    assert f"with a decay rate of at least {d.decay_rate:.3f}"[:-1] in d.explain()
    for weights in np.random.default_rng(0).dirichlet(np.ones(3), 50):
        mixed, inputs = np.tensordot(weights, A, 1), np.tensordot(weights, B, 1)
        assert np.linalg.eigvals(mixed + inputs @ d.F).real.max() <= -d.decay_rate + 1e-12
    assert common.check() and not replace(common, decay_rate=1.001 * common.decay_rate).check()
    assert not replace(common, decay_rate=-1.0).check()
    slower = replace(common, required_rate=Fraction(common.decay_rate))
    assert (
        slower.check() and not replace(common, required_rate=Fraction(common.decay_rate) * Fraction(1001, 1000)).check()
    )


def test_a_rate_of_vertices_is_met_with_equality():
    """A_s + B F = -1/3 and slower: x' = -x / 3 exactly."""
    plant = kp.ConeStateSpace([["-1/3"]], [[0]], [[1]], 0)
    vertices = [([["-1/3"]], [[0]]), ([[-1]], [[0]])]
    d = kp.state_feedback(plant, vertices=vertices, rate="1/3")
    assert d and d.certificate.others[-1].required_rate == Fraction(1, 3)
    assert kp.state_feedback(plant, vertices=vertices, rate="0.34").status is kp.Status.REFUTED


def test_what_is_refuted_for_vertices_is_a_common_vector():
    """F = 0 keeps every matrix between these two Metzler and Hurwitz; they share no linear Lyapunov function."""
    first, second, B = [[-1, 1.5], [0.1, -1]], [[-1, 0.1], [1.5, -1]], np.zeros((2, 1))
    plant = kp.ConeStateSpace(first, B, [[1, 0]], 0)
    both = kp.state_feedback(plant, vertices=[(first, B), (second, B)])
    assert both.status is kp.Status.REFUTED and both.check()
    assert "No gain with a common vector x inside X" in both.explain() and "any F." not in both.explain()
    alone = kp.state_feedback(kp.ConeStateSpace([[1, 0], [0, -1]], B, [[1, 0]], 0))
    assert alone.status is kp.Status.REFUTED and "common" not in alone.explain()


@pytest.mark.parametrize("factors", [(10.0, 10.0), (0.25, 3.0), (2.0**-40, 3.0), (0.1, 1e6)])
def test_lengths_of_generators_change_no_answer(factors):
    """Bounds met and refused, smallest gains, limits, what is printed, other methods and laws, margins."""
    rays = np.array(PAPER, dtype=float) * np.array(factors)[:, None]
    two = kp.ConeStateSpace(PLANT, X=rays)
    rates = {"rate": "max", "gain_bound": 20}
    for demands in ({"gain_bound": 5.5}, {"gain_bound": 4.5}, {}, rates, {"method": "first"}):
        d, e = kp.state_feedback(PLANT, X=PAPER, **demands), kp.state_feedback(two, **demands)
        assert d.status is e.status and d.message == e.message
        if d and "method" not in demands:
            assert e.limit == pytest.approx(d.limit, rel=1e-4) and e.value == pytest.approx(d.value, rel=0.06)
        if d and max(factors) <= 10:
            np.testing.assert_allclose(e.F, d.F, rtol=2e-2)
            assert e.certified_fraction == pytest.approx(d.certified_fraction, abs=2e-3)
            assert e.margin == pytest.approx(d.margin, rel=0.05)
    for design in (
        lambda X, **k: kp.state_feedback(PLANT, X=X, method="alternation", **k),
        lambda X, **k: kp.output_feedback(ct.ss(PLANT.A, PLANT.B, [[1, 2]], 0), X=X, **k),
        lambda X, **k: kp.observer_gain(ct.ss(PLANT.A, PLANT.B, [[1, 0]], 0), X=X, **k),
        lambda X, **k: kp.scale_free_feedback(kp.ConeStateSpace(PLANT, X=X), **k),
    ):
        for k in ({}, {"gain_bound": 5.5}, {"gain_bound": 0.5}):
            assert design(PAPER, **k).status is design(rays, **k).status


def test_a_leading_entry_is_not_a_small_one():
    """A first entry that is rounding does not decide how a generator is measured."""
    small = kp.state_feedback(PLANT, X=[[1e-17, 1], [1, -2]], gain_bound=5.5)
    assert small and small.value <= 5.5


def test_bounds_say_at_which_generators_they_hold(tmp_path):
    """Files of version 0.1 have bounds at generators of the lengths that stand there."""
    c = kp.state_feedback(PLANT, X=[[0, 1], [1, -9]], gain_bound=100).certificate.others[0]
    assert c.leading and c.check() and "leading entry scaled to 1" in c.explain()
    tight = np.abs(np.asarray(c.F.values) @ planted.unit(c.X.rays).T).max()
    assert c.settle(F=c.F, X=c.X, leading=True, bound=np.array([tight * (1 + 1e-12)]))
    assert not c.settle(F=c.F, X=c.X, leading=True, bound=np.array([tight * (1 - 1e-9)]))
    given = np.abs(np.asarray(c.F.values) @ c.X.rays.T).max()
    assert given > 2 * tight and not c.settle(F=c.F, X=c.X, bound=np.array([tight]))
    old = c.settle(F=c.F, X=c.X, bound=np.array([given * (1 + 1e-12)]))
    for certificate in (c, old):
        path = tmp_path / "bound.json"
        certificate.save(path)
        assert kp.load_certificate(path).leading is certificate.leading
        assert checker.main(path) == 0


@pytest.mark.parametrize(("fixed", "dt"), [("-1/3", None), ("2/3", 1)])
def test_rates_are_proven_as_they_are_written(fixed, dt):
    """One mode decays at 1/3 whatever the gain: met with equality, and no faster."""
    more = () if dt is None else (dt,)
    sys = kp.ConeStateSpace([[fixed, 0], [0, 2]], [[0], [1]], np.eye(2), np.zeros((2, 1)), *more)
    d = kp.state_feedback(sys, rate="1/3")
    assert d and d.check() and d.certificate.required_rate == Fraction(1, 3) == d.weakened_rate
    assert d.decay_rate <= Fraction(1, 3) and 0 < d.certified_fraction < 1
    double = kp.state_feedback(sys, rate=1 / 3)  # a little below
    assert double and double.decay_rate >= 1 / 3
    assert not kp.state_feedback(sys, rate="0.33333333333333333334")
    assert kp.state_feedback(sys, rate="0.34").status is kp.Status.REFUTED


@pytest.mark.parametrize("discrete", [False, True])
def test_every_search_reaches_a_rate_that_no_gain_exceeds(discrete):
    p = third(discrete)
    harder = (p.exact.A.fractions() + [[Fraction(1, 2), 0], [0, 0]]).tolist(), [[1], [0]]
    for d in (
        kp.state_feedback(p, rate="1/3", vertices=[p, harder]),
        kp.state_feedback(p, rate="1/3", method="alternation"),
        kp.output_feedback(p, rate="1/3"),
        kp.observer_gain(p, rate="1/3"),
    ):
        loops = getattr(d.certificate, "loops", (d.certificate,))
        assert d and d.check() and {loop.required_rate for loop in loops} == {Fraction(1, 3)}
        assert d.value < 2.5  # a little more than the smallest gain, not any
    beyond = "0.33333333333333333334"
    assert not kp.state_feedback(p, rate=beyond, vertices=[p, harder]) and not kp.output_feedback(p, rate=beyond)


def test_designs_along_a_curve_prove_the_rates_as_they_are_written():
    curve = kp.gain_rate_tradeoff(third(), ["1/4", "1/3"], certify=True)
    assert [d.weakened_rate for d in curve.designs] == [Fraction(1, 4), Fraction(1, 3)]
    assert curve.designs[1].certificate.required_rate == Fraction(1, 3) and (curve.rates == [1 / 4, 1 / 3]).all()


def test_the_largest_rate_is_reached_with_equality():
    d = kp.state_feedback(PLANT, X=PAPER, rate=2)
    assert d and d.check() and d.decay_rate == 2 and kp.state_feedback(PLANT, X=PAPER, rate="2.00001").F is None
    assert kp.observer_gain(kp.ConeStateSpace([["-1/3", 0], [0, 1]], [[0], [1]], [[0, 1]], [[0]]), rate="1/3")
