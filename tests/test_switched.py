"""`switched`: common vectors, growth, cycles and mixtures, against linear programs, eigenvalues and products."""

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import linprog

import control_kpos as kp
from control_kpos.exact.matrix import Matrix
from control_kpos.families.candidates import no_common, worst_mixture

SEED = kp.PolyhedralCone([[0, 1], [1, -2]])
SQUARE = kp.PolyhedralCone([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]])
ONLY_E = [[[-1, 0], [3, -3]], [[-5, 4], [4, -5]]]
STEP = kp.ConeStateSpace([[0.5]], [[1]], [[1]], 0, True)
SHEARS = [[[1, 1], [0, 1]], [[1, 0], [1, 1]]]


def metzler(rng, n, discrete):
    """A random positive matrix whose margin of stability is of either sign."""
    M = rng.random((n, n)) * (rng.random((n, n)) < 0.6)
    return M * rng.uniform(0.3, 1.1) / n if discrete else M - np.diag(rng.uniform(0.5, 1.2) * n * np.ones(n) / 2)


def proof_of(s, kind, status="PROVED"):
    """The certificates of an answer of one kind."""
    return [p for p in (s.certificate, *s.others) if isinstance(p, kind) and p.status.name == status]


def test_a_common_e_without_a_common_v():
    s = kp.switched(ONLY_E)
    assert s and s.v is None and s.check()
    for A in map(np.array, ONLY_E):
        assert (A @ s.e < 0).all()
        assert (A @ s.e + s.decay_rate * s.e <= 1e-12).all()
    assert "No common v exists" in s.explain() and "one vector x inside X" in s.explain()
    assert proof_of(s, kp.CommonVectorCertificate, "REFUTED")


def test_the_transposed_family_has_a_v_and_no_e():
    s = kp.switched([np.transpose(A) for A in ONLY_E])
    assert s and s.e is None and (s.v > 0).all()
    assert all((s.v @ np.transpose(A) < 0).all() for A in ONLY_E)
    assert "No common e exists" in s.explain() and "V(x) = v'x" in s.explain()


def test_every_switching_on_the_seed_cone():
    s = kp.switched([[["-1", d], [0, -4]] for d in ("0.6", "1.4")], X=SEED)
    assert s and s.v is None and SEED.contains(s.e, strict=True) and s.check()


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("discrete", [False, True])
def test_random_families_agree_with_a_linear_program_and_with_eigenvalues(seed, discrete):
    """A common v exists iff the program is feasible iff every mixture by columns is stable: 150 families."""
    rng = np.random.default_rng(seed)
    for _ in range(5):
        n, count = int(rng.integers(2, 5)), int(rng.integers(2, 4))
        family = [metzler(rng, n, discrete) for _ in range(count)]
        M = [A - discrete * np.eye(n) for A in family]
        rows = np.concatenate([A.T for A in M])
        feasible = linprog(np.ones(n), A_ub=rows, b_ub=-np.ones(len(rows)), bounds=(1e-6, None)).status == 0
        mixed = [np.column_stack([M[s][:, k] for k, s in enumerate(word)]) for word in product(range(count), repeat=n)]
        assert feasible == (max(np.linalg.eigvals(A).real.max() for A in mixed) < 0)
        dual, matrices = kp.orthant(n).dual, [Matrix(A.T) for A in family]
        assert (worst_mixture(dual, matrices, discrete=discrete) is not None) == feasible
        assert (no_common(dual, matrices, discrete=discrete) is None) == feasible
        s = kp.switched(family, discrete=discrete)
        assert (s.v is not None) == feasible
        assert s.check() == (s.status.name != "UNDECIDED")
        if feasible:
            assert s and (s.v > 0).all() and all((s.v @ A < 0).all() for A in M)


@pytest.mark.parametrize("seed", range(10))
def test_random_families_on_a_cone_of_four_generators(seed):
    rng = np.random.default_rng(seed)
    family = []
    while len(family) < 2:
        A = rng.normal(size=(3, 3)) / 3 - np.diag([1.5, 1.5, rng.uniform(-0.2, 0.8)])
        if kp.state_positivity(A, SQUARE):
            family.append(A)
    s = kp.switched(family, X=SQUARE)
    rows = np.concatenate([SQUARE.rays @ A.T for A in family] + [-SQUARE.rays])
    feasible = linprog(np.zeros(3), A_ub=rows, b_ub=-np.ones(len(rows)), bounds=(None, None)).status == 0
    assert (s.v is not None) == feasible
    assert bool(proof_of(s, kp.CommonVectorCertificate, "REFUTED")) or (s.v is not None and s.e is not None)
    assert s.check() == (s.status.name != "UNDECIDED")


def test_the_golden_ratio():
    s = kp.switched(SHEARS, discrete=True)
    low, high = s.growth_bounds
    golden = (1 + np.sqrt(5)) / 2
    assert low <= golden * (1 + 1e-15) and golden <= high * (1 + 1e-15) and high - low < 1e-6
    assert s.growth == high and s.vs.shape == (2, 2)
    one = next(p for p in s.others if isinstance(p, kp.NextModeCertificate))
    single = one.vs[np.array([0, 0])]
    assert not kp.NextModeCertificate.settle(loops=one.loops, vs=single, growth=1.99, least=0.0)
    assert kp.NextModeCertificate.settle(loops=one.loops, vs=Matrix(np.ones((2, 2))), growth=2.0, least=0.0)


def test_growth_below_one_proves_what_no_common_vector_does():
    s = kp.switched([[["1/2", "1/2"], [0, "1/2"]], [["1/2", 0], ["1/2", "1/2"]]], discrete=True)
    assert s and s.v is None and s.e is None and s.growth < 0.81
    assert isinstance(s.certificate, kp.NextModeCertificate) and s.check()


@pytest.mark.parametrize("seed", range(20))
def test_growth_bounds_hold_for_products(seed):
    rng = np.random.default_rng(seed)
    X = SQUARE if seed % 4 == 0 else kp.orthant(3)
    family = [np.diag([*rng.uniform(-0.5, 0.5, 2), 0.6 + 0.5 * rng.random()]) for _ in range(2)]
    if X is not SQUARE:
        family = [A @ A.T + rng.random((3, 3)) * (rng.random((3, 3)) < 0.5) for A in family]
    s = kp.switched(family, X=X, discrete=True)
    low, high = s.growth_bounds
    longest = 0.0
    for word in product(range(2), repeat=8):
        P = np.eye(3)
        for k in word:
            P = family[k] @ P
        longest = max(longest, np.abs(np.linalg.eigvals(P)).max() ** (1 / 8))
    assert longest <= high * (1 + 1e-9) and 0 < low <= high * (1 + 1e-12)
    assert low >= longest * (1 - 1e-6)


def test_a_member_alone_refutes():
    s = kp.switched([[[-1, 0], [0, -1]], [["1/3", 0], [0, -1]]])
    assert s.status == "REFUTED" and s.witness.weights == (0, 1) and s.check()
    assert "member 1 alone" in s.explain()


@pytest.mark.parametrize(("shear", "status"), [("1", "PROVED"), ("1.5", "PROVED"), ("2", "REFUTED"), ("3", "REFUTED")])
def test_a_mixture_refutes_exactly_on_the_margin(shear, status):
    """Half of each has the eigenvalue -1 + shear / 2, and no common vector exists if shear^2 / 4 >= 1."""
    s = kp.switched([[[-1, shear], [0, -1]], [[-1, 0], [shear, -1]]])
    assert s.status.name in (status, "UNDECIDED") and (status == "PROVED" or s.status.name == status)


def test_mixtures_in_discrete_time():
    s = kp.switched([[[0, 3], [0, 0]], [[0, 0], [3, 0]]], discrete=True)
    assert s.status == "REFUTED" and s.check()
    M = sum(
        float(a) * np.array(A) for a, A in zip(s.witness.weights, ([[0, 3], [0, 0]], [[0, 0], [3, 0]]), strict=True)
    )
    assert (M @ s.witness.x - s.witness.x >= -1e-12).all()


def test_a_cycle_refutes_where_no_mixture_does():
    s = kp.switched([[[0, 2], [0, 0]], [[0, 0], ["1/2", 0]]], discrete=True)
    assert s.status == "REFUTED" and isinstance(s.witness, kp.CycleOfGrowth) and s.check()
    assert s.witness.factor == 1 and sorted(s.witness.modes) == [0, 1]


def test_members_that_leave_the_cone_are_named():
    s = kp.switched([[[-1, 0], [0, -1]], [[-1, -2], [0, -1]]])
    assert s.status == "REFUTED" and "Member 1 does not keep X" in s.message
    assert isinstance(s.witness, kp.PositivityViolation) and s.check()


def test_systems_networks_and_one_member():
    lag = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)
    nets = [kp.feedback_interconnect([lag] * 3, w * np.roll(np.eye(3), 1, axis=0)) for w in (0.25, 0.5)]
    s = kp.switched(nets)
    assert s and s.v.shape == (3,) and s.decay_rate > 0.49
    assert kp.switched([STEP]).growth == pytest.approx(0.5)
    assert kp.switched([np.diag([-1.0, -2.0])])


def test_two_networks_of_ten_thousand_nodes():
    rng = np.random.default_rng(0)
    nodes = 10_000
    own = sp.kron(sp.eye_array(nodes), [[-2.0, 1.0], [0.5, -2.0]])
    family = []
    for _ in range(2):
        to, of = 2 * rng.integers(nodes, size=(2, 3 * nodes))
        links = sp.csr_array((rng.random(3 * nodes) / 5, (to, of + 1)), shape=(2 * nodes, 2 * nodes))
        family.append(sp.csr_array(own + links))
    s = kp.switched(family)
    assert s and s.check()
    assert all((family[k].T @ s.v < 0).all() for k in range(2) if s.v is not None)


def test_forged_certificates_are_refused():
    s = kp.switched(ONLY_E)
    none = s.others[0]
    shrunk = replace(none.witness, vectors=-none.witness.vectors)
    assert not replace(none, witness=shrunk).check()
    assert type(none).settle(loops=none.loops, witness=shrunk).status == "UNDECIDED"
    refuted = kp.switched([[[-1, 3], [0, -1]], [[-1, 0], [3, -1]]]).certificate
    for changes in ({"x": -refuted.witness.x}, {"x": 0 * refuted.witness.x}, {"weights": (Fraction(1), Fraction(0))}):
        other = replace(refuted.witness, **changes | {"exact": None})
        assert type(refuted).settle(loops=refuted.loops, witness=other).status == "UNDECIDED"
    growth = kp.switched(SHEARS, discrete=True).others[-1]
    for changes in ({"growth": 1.6}, {"least": 1.62}, {"vs": -growth.vs}):
        assert not type(growth).settle(**growth.data() | changes)
    bigger = replace(growth.cycle, factor=growth.cycle.factor * 2)
    assert not type(growth).settle(**growth.data() | {"cycle": bigger})


def test_a_refuted_cycle_must_not_shrink():
    s = kp.switched([[[0, 2], [0, 0]], [[0, 0], ["1/2", 0]]], discrete=True).certificate
    assert type(s).settle(loops=s.loops, witness=replace(s.witness, factor=Fraction(1, 2))).status == "UNDECIDED"
    with pytest.raises(kp.DataError, match="cycle of growth"):
        type(s).settle(loops=s.loops, witness=replace(s.witness, modes=(7,)))


def test_files_say_the_same(tmp_path):
    for s in (kp.switched(ONLY_E), kp.switched(SHEARS, discrete=True)):
        for p in (s.certificate, *s.others):
            p.save(tmp_path / "file.json")
            assert kp.load_certificate(tmp_path / "file.json") == p


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([],), kp.DataError, "family is empty"),
        ((np.eye(2),), kp.DataError, r"family\[0\] is neither a matrix nor a state-space system"),
        ((sp.eye_array(2),), kp.DataError, "family is one member"),
        (([np.eye(2), np.eye(3)],), kp.ShapeError, r"family\[1\] has 3 states, but family\[0\] has 2"),
        (([[[1, 2]]],), kp.ShapeError, r"family\[0\] is 1 x 2; it must be square"),
        (([[[np.nan]]],), kp.DataError, r"family\[0\]"),
        ((["ab"],), kp.DataError, r"family\[0\] is neither"),
        (
            ([kp.ConeStateSpace([[0.5]], 1, 1, 0, True), kp.ConeStateSpace([[-1]], 1, 1, 0)],),
            kp.TimebaseError,
            "both|continuous and in discrete",
        ),
    ],
)
def test_bad_input_is_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        kp.switched(*arguments)


def test_cones_and_times_that_do_not_fit_are_refused():
    one = kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0, X=SEED)
    with pytest.raises(kp.ConeMismatchError, match=r"family\[1\] has another cone than family\[0\]"):
        kp.switched([one, kp.ConeStateSpace(-np.eye(2), np.eye(2), np.eye(2), 0)])
    with pytest.raises(kp.ConeMismatchError, match="X is a cone in 3 dimensions"):
        kp.switched([one], X=kp.orthant(3))
    with pytest.raises(kp.TimebaseError, match="discrete is True"):
        kp.switched([one], discrete=True)


def test_a_time_limit_ends_the_search():
    s = kp.switched(ONLY_E, time_limit=1e-9)
    assert s.status in ("PROVED", "UNDECIDED") and (s or "ended" in s.message)


def test_numbers_in_sentences_are_no_more_than_what_is_proven():
    s = kp.switched([[[0, "2.2"], [0, 0]], [[0, 0], ["0.77", 0]]], discrete=True)  # one cycle takes x to 1.694 x
    said = Fraction(str(s.witness).split(" than ")[1].split()[0])
    assert s.witness.factor - Fraction(1, 10**5) < said <= s.witness.factor
    (low, high), (facts,) = s.growth_bounds, [text for name, text in s.facts() if name == "growth per step"]
    assert Fraction(facts.split()[0]) <= low and Fraction(facts.split()[2]) >= high
    mixed = kp.switched([[[-1, 5], [0, -1]], [[-1, 0], [5, -1]], [[-2, 0], [0, -2]]])
    assert "of member 0 + " in str(replace(mixed.witness, weights=(Fraction(1, 3), Fraction(2, 3), Fraction(0))))
    assert "about 0.333333 of member 0" in str(replace(mixed.witness, weights=(Fraction(1, 3), Fraction(2, 3))))
