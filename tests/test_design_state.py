"""State feedback: the paper's design, every planted gain, proofs that there is none, what engineers ask."""

import pickle

import control as ct
import cvxpy as cp
import numpy as np
import planted
import pytest

import control_kpos as kp
from control_kpos.design.contradiction import Functionals
from control_kpos.design.plant import read_plant
from control_kpos.design.polyhedral.program import GainProgram
from control_kpos.design.running import Programs

PAPER = [[0, 1], [1, -2]]


@pytest.fixture
def plant():
    return ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)


def require_certified(d, A, B, X, *, rate=0.0, discrete=False):
    """Everything that is claimed, seen with other eyes than the certificate's."""
    assert d.status is kp.Status.PROVED and d.check()
    closed = np.asarray(A) + np.asarray(B) @ d.F
    np.testing.assert_allclose(d.closed_loop.A, closed, rtol=1e-14, atol=1e-14 * np.abs(A).max())
    modes = np.linalg.eigvals(closed)
    if discrete:
        assert np.abs(modes).max() <= 1 - rate + 1e-9
    else:
        assert modes.real.max() <= -rate + 1e-9
    assert kp.state_positivity(d.closed_loop.A, X, discrete=discrete) or kp.linear_lyapunov(
        d.closed_loop.exact.A, X, discrete=discrete
    )


# -- the paper, section V.A


def test_paper_plant_on_paper_cone(plant):
    d = kp.state_feedback(plant, X=PAPER)
    F1, F2 = d.F[0]
    assert F2 < 0 and F1 < 1 and -4 - 1 + F1 - 2 * F2 >= 0  # the feasible set written in the paper
    assert d.closed_loop.is_cone_positive()
    assert (np.asarray(PAPER) @ d.certificate.v > 0).all()
    assert (np.asarray(PAPER) @ d.closed_loop.A.T @ d.certificate.v < 0).all()
    assert d.value == pytest.approx(5, rel=0.06) and d.limit == pytest.approx(5, rel=1e-4)
    np.testing.assert_array_equal(d.K, -d.F)


def test_paper_gain_sits_on_the_boundary_and_is_found_when_it_is_asked_for(plant):
    d = kp.state_feedback(plant, X=PAPER, constraints=lambda F: [np.array([[-21, -13]]) == F])
    assert d and d.F.tolist() == [[-21, -13]]
    assert d.certificate.positivity.margin == 0


def test_bound_with_no_room_at_all_is_met(plant):
    d = kp.state_feedback(plant, X=PAPER, gain_bound=5)
    assert d and d.F[0, 0] - 2 * d.F[0, 1] == 5


def test_two_steps_of_the_paper_give_the_gain_of_the_paper(plant):
    d = kp.state_feedback(plant, X=PAPER, method="two-step", gain_bound=13)
    assert d and d.F.tolist() == [[-21, -13]]
    free = kp.state_feedback(plant, X=PAPER, method="two-step")
    assert free and free.F[0, 0] - 2 * free.F[0, 1] >= 5 and free.F[0, 1] < -2


def test_two_steps_fail_where_one_program_succeeds():
    rng = np.random.default_rng(3)
    failures = 0
    for _ in range(20):
        A, B, rays, _ = planted.simplicial(rng, 4, 2)
        sys = ct.ss(A, B, np.eye(4), 0)
        two = kp.state_feedback(sys, X=rays, method="two-step")
        one = kp.state_feedback(sys, X=rays)
        assert one or not two
        failures += bool(one) and not two
    assert failures >= 10


def test_no_gain_makes_the_mass_spring_positive_on_the_orthant(plant):
    d = kp.state_feedback(plant, X=kp.orthant(2))
    assert d.status is kp.Status.REFUTED and d.check() and d.F is None and d.closed_loop is None
    assert isinstance(d.witness, Functionals)
    assert "impossible" in d.explain()


# -- planted gains


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 1), (3, 2), (4, 2), (6, 3), (10, 5)])
def test_every_planted_gain_on_a_simplicial_cone_is_found(n, m):
    rng = np.random.default_rng(100 * n + m)
    for _ in range(4 if n > 6 else 25):
        A, B, rays, F = planted.simplicial(rng, n, m)
        d = kp.state_feedback(ct.ss(A, B, np.eye(n), 0), X=rays)
        require_certified(d, A, B, kp.PolyhedralCone(rays))
        assert d.value <= 1.06 * np.abs(F @ planted.unit(rays).T).max()  # the planted gain is not smaller


@pytest.mark.parametrize(("n", "m"), [(2, 1), (6, 3), (15, 5)])
def test_first_gain_is_certified_too(n, m):
    rng = np.random.default_rng(n)
    for _ in range(3):
        A, B, rays, _ = planted.simplicial(rng, n, m)
        d = kp.state_feedback(ct.ss(A, B, np.eye(n), 0), X=rays, method="first", rate=0.1)
        require_certified(d, A, B, kp.PolyhedralCone(rays), rate=0.1)


@pytest.mark.parametrize(("n", "m"), [(2, 1), (4, 2), (6, 3)])
def test_every_planted_gain_in_discrete_time_is_found(n, m):
    rng = np.random.default_rng(n)
    for _ in range(15):
        A, B, rays, _ = planted.discrete(rng, n, m)
        d = kp.state_feedback(ct.ss(A, B, np.eye(n), 0, 0.1), X=rays)
        require_certified(d, A, B, kp.PolyhedralCone(rays), discrete=True)
        assert d.closed_loop.dt == 0.1


def test_planted_gains_on_other_cones_are_found():
    rng = np.random.default_rng(11)
    found = 0
    for _ in range(20):
        A, B, X, _ = planted.polyhedral(rng, 3, 1, 3)
        d = kp.state_feedback(ct.ss(A, B, np.eye(3), 0), X=X)
        found += bool(d)
        if d:
            require_certified(d, A, B, X)
    assert found >= 19


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_units_of_the_states_change_no_verdict(plant, scale):
    units = np.diag([scale, 1 / scale])
    inverse = np.diag([1 / scale, scale])
    scaled = ct.ss(units @ plant.A @ inverse, units @ plant.B, plant.C @ inverse, 0)
    d, e = kp.state_feedback(plant, X=PAPER, rate=1), kp.state_feedback(scaled, X=np.asarray(PAPER) @ units, rate=1)
    assert d and e and e.check()  # how large the gain is depends on the units, and with it which one is smallest
    assert kp.linear_lyapunov(plant.A + plant.B @ e.F @ units, kp.PolyhedralCone(PAPER), rate="max").decay_rate >= 1
    assert np.abs(e.F @ planted.unit(np.asarray(PAPER) @ units).T).max() == pytest.approx(e.value)


# -- demands


@pytest.mark.parametrize("rate", [0.5, 1.0, 1.5, 1.9, 1.99])
def test_decay_rate_is_reached(plant, rate):
    d = kp.state_feedback(plant, X=PAPER, rate=rate)
    require_certified(d, plant.A, plant.B, kp.PolyhedralCone(PAPER), rate=rate)
    assert d.decay_rate >= rate


def test_largest_decay_rate(plant):
    d = kp.state_feedback(plant, X=PAPER, rate="max")
    assert d.limit == pytest.approx(2, rel=1e-4) and d.decay_rate >= 0.999 * 2 - 1e-4


def test_rate_out_of_reach_is_refuted_and_the_possible_one_named(plant):
    d = kp.state_feedback(plant, X=PAPER, rate=2.5)
    assert d.status is kp.Status.REFUTED and d.check()
    assert d.nearest.decay_rate == pytest.approx(2, rel=1e-3)
    assert "decay rate" in d.explain()


def test_bound_out_of_reach_is_refuted_and_the_possible_one_named(plant):
    d = kp.state_feedback(plant, X=PAPER, gain_bound=4.9)
    assert d.status is kp.Status.REFUTED and d.check()
    assert d.nearest.gain_bound == pytest.approx(5, rel=1e-3)


def test_bound_holds_exactly_at_every_generator(plant):
    d = kp.state_feedback(plant, X=PAPER, gain_bound=7, rate=1.9)
    assert (np.abs(np.asarray(PAPER) @ d.F.T) <= 7).all()


def test_unlimited_rate_asks_for_a_bound():
    d = kp.state_feedback(ct.ss([[1.0]], [[1.0]], [[1.0]], 0), rate="max")
    assert d.status is kp.Status.UNDECIDED and "gain_bound" in d.message
    assert kp.state_feedback(ct.ss([[1.0]], [[1.0]], [[1.0]], 0), rate="max", gain_bound=3).decay_rate == pytest.approx(
        2, rel=0.01
    )


def test_plant_that_needs_nothing_gets_nothing():
    d = kp.state_feedback(ct.ss([[-2, 1], [1, -2]], [[1], [0]], [[1, 0]], 0))
    assert d and not d.F.any() and d.value == 0 and d.certified_fraction == 0


def test_structure_that_follows_the_blocks_is_exact():
    rng = np.random.default_rng(5)
    rays = np.zeros((4, 4))
    first, second = planted.simplicial(rng, 2, 1), planted.simplicial(rng, 2, 1)
    rays[:2, :2], rays[2:, 2:] = first[2], second[2]
    zero = np.zeros((2, 2))
    A = np.block([[first[0], zero], [zero, second[0]]])
    B = np.block([[first[1], np.zeros((2, 1))], [np.zeros((2, 1)), second[1]]])
    mask = np.array([[1, 1, 0, 0], [0, 0, 1, 1]], dtype=bool)
    sys = ct.ss(A, B, np.eye(4), 0)
    d = kp.state_feedback(sys, X=rays, structure=mask, method="one-shot")
    require_certified(d, A, B, kp.PolyhedralCone(rays))
    assert not d.F[~mask].any()
    blocked = kp.state_feedback(sys, X=rays, structure=np.zeros((2, 4), dtype=bool))
    assert blocked or blocked.status is kp.Status.REFUTED


def test_structure_inside_a_block_is_alternated(plant):
    d = kp.state_feedback(plant, X=PAPER, structure=[[0, 1]])
    assert d and d.F[0, 0] == 0


@pytest.mark.parametrize("method", ["one-shot", "alternation"])
def test_vertices_share_one_gain_and_one_vector(plant, method):
    vertices = [([[0, 1], [-k, 0]], [[0], [b]]) for k in (0.5, 2) for b in (0.8, 1.2)]
    d = kp.state_feedback(plant, X=PAPER, vertices=vertices, rate=0.5, method=method)
    assert d and d.check() and len(d.certificate.loops) == 4
    common = d.certificate.others[-1]
    for A, B in vertices:
        closed = np.array(A) + np.array(B) @ d.F
        assert (np.array([[2, 1], [1, 0]]) @ closed @ common.x < 0).all()
        assert np.linalg.eigvals(closed).real.max() <= -0.5 + 1e-9


def test_ports(plant):
    d = kp.state_feedback(plant, X=PAPER, ports=True)
    assert d and d.closed_loop.is_cone_positive()
    outside = kp.state_feedback(ct.ss(plant.A, -plant.B, plant.C, 0), X=PAPER, ports=True)
    assert outside.status is kp.Status.REFUTED and outside.check() and "B U" in outside.message
    pairs = [(plant.A, plant.B), (plant.A, 2 * plant.B)]
    both = kp.state_feedback(plant, X=PAPER, ports=True, vertices=pairs)
    assert both and sum(isinstance(part, kp.PositivityCertificate) for part in both.certificate.others) == 2
    second = kp.state_feedback(plant, X=PAPER, ports=True, vertices=[pairs[0], (plant.A, -plant.B)])
    assert second.status is kp.Status.REFUTED and second.check() and "B U" in second.message


def test_constraints_and_objective_of_the_user(plant):
    d = kp.state_feedback(plant, X=PAPER, constraints=lambda F: [F[0, 0] == -21, F[0, 1] >= -14], rate=1.5)
    assert d and d.F[0, 0] == -21 and d.F[0, 1] >= -14
    weights = np.array([1.0, 3.0])
    e = kp.state_feedback(plant, X=PAPER, objective=lambda F: cp.sum(cp.abs(F[0]) @ weights), rate=1)
    f = kp.state_feedback(plant, X=PAPER, rate=1)
    assert e and e.value <= np.abs(f.F[0]) @ weights
    none = kp.state_feedback(plant, X=PAPER, constraints=lambda F: [F[0, 1] >= 0])
    assert none.status is kp.Status.UNDECIDED and none.F is None


def test_weakened_gains_are_covered_down_to_the_fraction_and_not_below(plant):
    d = kp.state_feedback(plant, X=PAPER, rate=1)
    s = d.certified_fraction
    assert 0.5 < s < 1
    for weak, holds in ((s, True), ((1 + s) / 2, True), (s * 0.9, False)):
        assert bool(kp.linear_lyapunov(plant.A + weak * plant.B @ d.F, kp.PolyhedralCone(PAPER))) is holds
    assert "actuators" in d.explain()


# -- what it hands over


def test_python_control_takes_it_from_there(plant):
    d = kp.state_feedback(plant, X=PAPER, rate=1)
    _, closed = ct.create_statefbk_iosystem(ct.ss(plant.A, plant.B, np.eye(2), 0), d.K)
    reference = ct.ss(plant.A + plant.B @ d.F, plant.B, plant.C, plant.D)
    time = np.linspace(0, 3, 50)
    by_block = ct.input_output_response(closed, time, np.zeros((3, 50)), [1, 0]).states
    by_hand = ct.initial_response(reference, time, [1, 0]).states
    ours = ct.initial_response(d.closed_loop, time, [1, 0]).states
    np.testing.assert_allclose(ours, by_hand, atol=1e-8)
    np.testing.assert_allclose(by_block[:2], by_hand, atol=1e-3)


def test_certificates_survive_saving(plant, tmp_path):
    file = tmp_path / "design.json"
    kp.state_feedback(plant, X=PAPER, gain_bound=7).certificate.save(file)
    assert kp.load_certificate(file).status is kp.Status.PROVED
    kp.state_feedback(plant, X=kp.orthant(2)).certificate.save(file)
    assert kp.load_certificate(file).status is kp.Status.REFUTED


def test_gain_against_rate(plant):
    curve = kp.gain_rate_tradeoff(plant, [0.5, 1.5, 2.5], X=PAPER, certify=True)
    assert curve.gains[:2] == pytest.approx([5, 5], rel=1e-3) and np.isnan(curve.gains[2])
    assert [d.status.name for d in curve.designs] == ["PROVED", "PROVED", "REFUTED"]
    assert (np.diff(kp.gain_rate_tradeoff(plant, X=[[0, 1], [1, -1]]).gains) >= -1e-6).all()


@pytest.mark.parametrize(
    ("design", "said"),
    [
        (lambda plant, **k: kp.state_feedback(plant, X=PAPER, method="alternation", **k), "vector 2 of 6"),
        (lambda plant, **k: kp.state_feedback(plant, X=kp.orthant(2), **k), "exact arithmetic"),
        (lambda plant, **k: kp.state_feedback(plant, X=PAPER, objective=lambda F: F[0, 1] ** 2, **k), "step 1"),
        (lambda plant, **k: kp.output_feedback(ct.ss([[-3, 1], [2, 1]], [[0], [1]], [[0, 1]], 0), **k), "vector 1"),
        (lambda plant, **k: kp.observer_gain(plant, X=PAPER, **k), "linear program 1"),
        (lambda plant, **k: kp.scale_free_feedback(kp.ConeStateSpace(plant, X=PAPER), **k), "linear program 1"),
        (lambda plant, **k: kp.gain_rate_tradeoff(plant, [1.0, 1.5], X=PAPER, certify=True, **k), "design 2 of 2"),
    ],
)
def test_progress_is_told(plant, design, said):
    lines = []
    design(plant, progress=lines.append)
    assert any(said in line for line in lines)


def test_alternation_is_never_worse_than_its_start():
    rng = np.random.default_rng(2)
    for _ in range(5):
        A, B, X, _ = planted.polyhedral(rng, 3, 1, 3)
        plant = read_plant(kp.ConeStateSpace(ct.ss(A, B, np.eye(3), 0), X=X), None)
        program = GainProgram(plant, Programs(None))
        start = program.fastest(program.facet_sum(), 10.0)
        end = program.speed_up(program.facet_sum(), 10.0)
        assert end.rate >= start.rate
        slim, size = program.slim(end, end.rate / 2)
        assert size <= np.abs(end.gain @ planted.unit(X.rays).T).max() + 1e-9
        assert slim.rate >= end.rate / 2 - 1e-9


def test_closed_loop_and_notes_are_made_when_they_are_read_and_follow_no_later_change():
    plant = ct.ss([[-1.0, 1.0], [0.0, -2.0]], [[1.0], [0.0]], np.eye(2), 0, name="plant", states=["a", "b"])
    d = kp.state_feedback(plant, X=kp.orthant(2), rate=1.5)
    B, C = plant.B.copy(), plant.C.copy()
    plant.B[:], plant.C[:] = 9.0, 7.0
    again = pickle.loads(pickle.dumps(d))
    for result in (d, again):
        assert callable(vars(result)["closed_loop"]) and callable(vars(result)["notes"])
        loop = result.closed_loop
        assert result.closed_loop is loop and loop.state_labels == ["a", "b"]
        assert (loop.B == B).all() and (loop.C == C).all()
        np.testing.assert_allclose(loop.A, plant.A + B @ result.F)
        assert result.check() and any("-2" in note and "not controllable" in note for note in result.notes)
