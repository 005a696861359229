"""What is typed is what is proven: data in fractions and text reach every certificate as they are.

1/3 is no double.  Where the rounding of a datum changes a verdict, the verdict is that of the datum.
"""

import dataclasses
import inspect
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from test_house import METHODS, PUBLIC

import control_kpos as kp
from control_kpos.exact.matrix import Matrix
from control_kpos.systems.system import System

THIRD = Fraction(1, 3)
# a double eigenvalue 0.4, which rounding turns into a complex pair
TWICE = [["0.1", "0.3"], ["-0.3", "0.7"]]
# leaves the cone of (0.1, 0.3) and (0.3, 0.1) invariant with equality, which rounding breaks
EDGE = [["-31/40", "9/40"], ["-9/40", "-1/40"]]
EDGE_CONE = [["0.1", "0.3"], ["0.3", "0.1"]]


def plant(A, B=None, C=None, **more):
    n = len(A)
    B = [[1]] + [[0]] * (n - 1) if B is None else B
    C = [[1] + [0] * (n - 1)] if C is None else C
    return kp.ConeStateSpace(A, B, C, np.zeros((len(C), len(B[0]))), **more)


def fractions(rows):
    return [[Fraction(x) for x in row] for row in rows]


# -- the door


@pytest.mark.parametrize(
    "data",
    [
        System.read([["1/3"]]),
        plant([["1/3"]]),
        [["1/3"]],
        [[THIRD]],
        np.array([[THIRD]]),
        ([["1/3"]], [[1]]),
        ([["1/3"]], [[1]], [[1]], 0),
    ],
)
def test_the_door_keeps_what_is_given(data):
    assert System.read(data).A.fractions().tolist() == [[THIRD]]


def test_the_door_reads_doubles_of_python_control():
    read = System.read(ct.ss([[1 / 3]], [[1]], [[1]], 0, 0.5), X=[[-1]])
    assert read.A.fractions()[0, 0] == Fraction(1 / 3)
    assert read.discrete
    assert kp.PolyhedralCone([[-1]]) == read.X


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (ct.tf([1], [1, 1]), "transfer function"),
        ([[1, 2]], "1 x 2; it must be square"),
        (([[1]], [[1], [2]]), "A is 1 x 1, but B has 2 rows"),
        (([[1]], [[1]], [[1, 2]], 0), r"sys\[2\] is 1 x 2"),
        (([[1]], [[1]], [[1]], [[1, 2]]), r"sys\[3\] is 1 x 2"),
        ("fast", "no number|text"),
    ],
)
def test_the_door_says_what_does_not_fit(data, said):
    with pytest.raises(kp.KposError, match=said):
        System.read(data)


def test_a_cone_of_another_dimension_is_refused():
    with pytest.raises(kp.ConeMismatchError, match="X has dimension 2, but the system has 1 states"):
        System.read([[1]], X=kp.orthant(2))


def test_a_system_is_what_it_is_now():
    s = plant([["1/3"]])
    s.A = np.array([[0.5]])
    assert s.exact.A.fractions()[0, 0] == Fraction(1, 2)
    s = plant([["1/3"]])
    s.A[0, 0] = 0.25
    assert s.exact.A.fractions()[0, 0] == Fraction(1, 4)


# -- searches for cones


def test_cone_of_a_system_is_that_of_its_matrix():
    matrix, system = kp.find_cone(TWICE), kp.find_cone(plant(TWICE, [[0], [0]], [[0, 0]]))
    assert matrix.status is system.status is kp.Status.PROVED
    assert system.certificate.matrices.fractions()[0].tolist() == fractions(TWICE)
    # and it is the rounding that changes the verdict
    assert kp.find_cone(np.array(TWICE, dtype=float)).status is kp.Status.REFUTED


def test_cone_of_a_family_of_systems_is_that_of_its_matrices():
    A = [["-1", "1/3"], ["1/7", "-2"]]
    found = kp.find_cone([plant(A), plant(TWICE)])
    assert [m.tolist() for m in found.certificate.matrices.fractions()] == [fractions(A), fractions(TWICE)]


def test_cone_of_a_system_holds_exact_inputs_and_outputs():
    s = plant([[-1, 0], [0, -2]], [["1/3"], ["1/3"]], [["1/3", "-1/3"]], U=[["1/7"]], Y=[["1/7"]])
    found = kp.find_cone(s)
    vectors, normals = found.certificate.contains.fractions()[0], found.certificate.within.fractions()[0]
    assert vectors[0] == vectors[1]
    assert normals[0] == -normals[1]
    # the vector lies on the boundary of the half-space: their product is exactly 0, and rounding may make it negative
    assert found.certificate.status is kp.Status.PROVED


def test_contains_and_within_may_be_text():
    found = kp.find_cone([[-1, 0], [0, -2]], contains=[["1/3", "1/7"]], within=[["3", "-7"]])
    assert found.certificate.contains.fractions().tolist() == [[THIRD, Fraction(1, 7)]]
    assert found.certificate.within.fractions().tolist() == [[3, -7]]


# -- cone and feedback


def test_cone_and_feedback_are_about_the_plant():
    s = plant([["-1", "1/3"], ["1/7", "-2"]], [[1], [0]])
    design = kp.design_cone_and_feedback(s)
    F = [Fraction(x) for x in design.F[0].tolist()]
    loop = [[-1 + F[0], THIRD + F[1]], [Fraction(1, 7), Fraction(-2)]]
    assert design.certificate.A.fractions().tolist() == loop
    assert design.closed_loop.exact.A.fractions().tolist() == loop


def test_cone_and_feedback_are_about_the_vertices():
    A = [["-1", "1/3"], ["1/7", "-2"]], [["-1", "1/3"], ["1/7", "-7/3"]]
    design = kp.design_cone_and_feedback(plant(A[0]), vertices=[plant(A[0]), plant(A[1])])
    F = [Fraction(x) for x in design.F[0].tolist()]
    for a, loop in zip(A, design.certificate.loops, strict=True):
        first = [Fraction(x) for x in a[0]]
        assert loop.A.fractions().tolist() == [[first[0] + F[0], first[1] + F[1]], [Fraction(x) for x in a[1]]]


# -- differential positivity


def test_jacobian_of_a_system_is_exact():
    X = kp.PolyhedralCone(EDGE_CONE)
    assert kp.differential_positivity(EDGE, X)
    certificate = kp.differential_positivity(plant(EDGE), X)
    assert certificate
    assert certificate.centres.fractions()[0].tolist() == fractions(EDGE)
    assert not kp.differential_positivity(np.array([[-31 / 40, 9 / 40], [-9 / 40, -1 / 40]]), X)


# -- operations


S = plant([["-1/3"]])


@pytest.mark.parametrize(
    ("result", "expected"),
    [
        (lambda: S * THIRD, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: THIRD * S, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: S / 3, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: S / Fraction(3), ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: S + THIRD, ([[-THIRD]], [[1]], [[1]], [[THIRD]])),
        (lambda: THIRD + S, ([[-THIRD]], [[1]], [[1]], [[THIRD]])),
        (lambda: S * np.array([[THIRD]]), ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: np.array([[THIRD]]) * S, ([[-THIRD]], [[1]], [[THIRD]], [[0]])),
        (lambda: S.feedback([["1/3"]], sign=1), ([[0]], [[1]], [[1]], [[0]])),
        (lambda: S.feedback(1, sign="1/3"), ([[0]], [[1]], [[1]], [[0]])),
        (lambda: S.feedback(S, sign="1/3"), ([[-THIRD, THIRD], [1, -THIRD]], [[1], [0]], [[1, 0]], [[0]])),
        (lambda: S.similarity_transform([["1/3"]]), ([[-THIRD]], [[THIRD]], [[3]], [[0]])),
        (lambda: S.similarity_transform([[1]], timescale="1/3"), ([[-1]], [[3]], [[1]], [[0]])),
        (lambda: kp.ConeStateSpace(S), ([[-THIRD]], [[1]], [[1]], [[0]])),
        (lambda: S.copy(), ([[-THIRD]], [[1]], [[1]], [[0]])),
    ],
)
def test_operations_keep_what_is_given(result, expected):
    s = result()
    assert isinstance(s, kp.ConeStateSpace)
    assert [m.fractions().tolist() for m in s.exact.matrices] == [fractions(rows) for rows in expected]


def test_exact_feedback_decides_at_the_margin():
    """-1/3 + 1/3 = 0 is not stable; with the double next to 1/3 it would be."""
    assert S.feedback(1, sign="1/3").linear_lyapunov().status is kp.Status.REFUTED
    assert S.feedback(1, sign=1 / 3).linear_lyapunov().status is kp.Status.PROVED


def test_node_of_the_paper_is_exact():
    node = kp.examples.mass_spring_node(["-64/3", "-13"], k="1/3", m="7/3")
    assert node.exact.A.fractions().tolist() == [[0, 1], [Fraction(-64, 3) - Fraction(1, 7), -13]]


# -- supply rates and weights


SPRING = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])  # gain 1/22
LAG = kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)


def test_supply_rates_are_what_is_given():
    certificate = SPRING.dissipativity(q=["-1/3"], r=["1/65"])
    assert certificate
    assert (certificate.q_exact, certificate.r_exact) == ((-THIRD,), (Fraction(1, 65),))
    assert SPRING.dissipativity(q=["-1/3"]).q_exact == (-THIRD,)
    assert SPRING.dissipativity(r=["1/3"]).r_exact == (THIRD,)
    assert SPRING.dissipativity(q=[-1], r=[0.5]).r_exact is None


def test_least_supply_is_decided_by_the_fraction():
    """1/22 is just not enough, and the double next to it is larger."""
    assert SPRING.dissipativity(q=[-1], r=["1/22"]).status is kp.Status.REFUTED
    assert SPRING.dissipativity(q=[-1], r=[1 / 22]).status is kp.Status.PROVED


def test_supply_rates_outlive_a_file(tmp_path):
    for r, status in (("1/21", kp.Status.PROVED), ("1/22", kp.Status.REFUTED)):
        certificate = SPRING.dissipativity(q=[-1], r=[r])
        certificate.save(tmp_path / "supply.json")
        loaded = kp.load_certificate(tmp_path / "supply.json")
        assert loaded.status is status
        assert loaded.r_exact == (Fraction(r),)


def test_a_supply_rate_that_is_not_the_rounding_of_the_fraction_is_no_proof():
    certificate = SPRING.dissipativity(q=[-1], r=["1/21"])
    assert certificate.check()
    assert not dataclasses.replace(certificate, r=np.array([0.05])).check()
    assert not dataclasses.replace(certificate, r_exact=(Fraction(1, 22),), r=np.array([1 / 22])).check()


def supplied(W, q, r):
    return kp.feedback_interconnect([LAG, LAG], W, supply_rates=[(q, r)] * 2).certificate


def test_supply_rates_of_networks_are_exact(tmp_path):
    certificate = supplied([[0, "1/2"], ["1/2", 0]], ["-1/3"], ["2/3"])
    assert certificate
    assert certificate.exact[1:] == ((Fraction(2, 3),) * 2, (-THIRD,) * 2)
    certificate.save(tmp_path / "network.json")
    assert kp.load_certificate(tmp_path / "network.json").exact == certificate.exact


def test_supply_rates_of_networks_are_decided_by_the_fractions():
    # node by node: gain 1 leaves no room for r = -q
    refuted = supplied([[0, 0], [0, 0]], ["-1/3"], ["1/3"])
    assert refuted.status is kp.Status.REFUTED
    assert refuted.witness.r_exact == (THIRD,)
    # together: -1/10 + 3/10 * 1/3 = 0 just fits; the double next to 3/10 is below, that next to 1/10 above
    assert supplied([[0, "1/3"], ["1/3", 0]], ["-1/10"], ["3/10"])
    assert supplied([[0, "10/30"], ["1/3", 0]], ["-1/10"], ["0.3000000000000000001"]).status is kp.Status.REFUTED


def test_weights_other_than_one_are_found_for_fractions():
    certificate = supplied([[0, "2/3"], ["1/6", 0]], ["-1/3"], ["2/3"])
    assert certificate
    assert certificate.sigma.tolist() != [1, 1]
    refuted = supplied([[0, 2], ["1/2", 0]], ["-1/3"], ["2/3"])
    assert refuted.status is kp.Status.REFUTED
    assert refuted.check()


def test_a_dissipativity_certificate_hands_on_its_fractions():
    own = SPRING.dissipativity(q=["-1/3"], r=["1/65"])
    certificate = kp.feedback_interconnect([SPRING], [[1]], supply_rates=[own]).certificate
    assert certificate.exact[1:] == ((Fraction(1, 65),), (-THIRD,))


def test_weights_of_gains_may_be_text():
    cones = [kp.orthant(1)] * 3
    assert kp.induced_gain([[-1]], [[1]], [[1]], [[0]], *cones, e=["1/3"], f=["1/6"]) == pytest.approx(0.5)
    # on the boundary of the cone, which the doubles next to it are not
    X = kp.PolyhedralCone([["1/3", "1/10"], [0, 1]])
    s = kp.ConeStateSpace([[-1]], [[1, 1]], [[1]], [[0, 0]], U=X)
    with pytest.raises(kp.DataError, match="does not weigh"):
        s.gain("Linf", e=["1/3", "1/10"])


def test_gains_of_systems_next_to_singular_ones():
    """Stable by their fractions; the doubles next to these are singular."""
    slow = kp.ConeStateSpace([[Fraction(2**60 - 1, 2**60)]], [[1]], [[1]], 0, True)
    assert slow.gain() == 2.0**60
    a = Fraction(10**22 - 1, 10**22)
    assert kp.ConeStateSpace([[-1, a], [1, -1]], [[1], [0]], [[1, 0]], 0).gain() == pytest.approx(1e22)
    with pytest.raises(kp.UndecidedError, match="beyond the range of doubles"):
        kp.ConeStateSpace([[-Fraction(1, 10**300)]], [[10**300]], [[1]], 0).gain()


# -- links of any network


def test_out_weights_are_exact(tmp_path):
    certificate = kp.scale_free_certificate(LAG, weight="1/3")
    assert certificate.weight == THIRD
    assert certificate.covers([[0, "1/3"], ["1/3", 0]])
    assert certificate.local.model.coupling.fractions()[0, 0] == THIRD
    certificate.save(tmp_path / "any.json")
    assert kp.load_certificate(tmp_path / "any.json").weight == THIRD


def test_out_weights_are_decided_by_the_fraction():
    """A self-loop of weight 1/3 makes -1/3 zero; one of the double next to it does not."""
    slow = plant([["-1/3"]])
    assert kp.scale_free_certificate(slow, weight="1/3").status is kp.Status.REFUTED
    assert kp.scale_free_certificate(slow, weight=1 / 3).status is kp.Status.PROVED


@pytest.mark.parametrize("weight", [1, 3])
def test_self_loops_of_another_weight_prove_nothing(weight):
    lag = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
    certificate = kp.scale_free_certificate(lag, weight=weight)
    assert certificate.check()
    for other in (weight + Fraction(1, 10**20), Fraction(1, 2)):
        changed = dataclasses.replace(certificate, weight=other)
        try:
            proven = changed.check()
        except kp.DataError:
            proven = False
        assert not proven


def test_links_of_weight_one_are_exact(tmp_path):
    certificate = kp.scale_free_certificate(LAG, weight=1, link=[["1/3"]])
    assert certificate.link.fractions()[0, 0] == THIRD
    certificate.save(tmp_path / "any.json")
    assert kp.load_certificate(tmp_path / "any.json").link.fractions()[0, 0] == THIRD


def test_scale_free_design_is_about_the_weight():
    design = kp.scale_free_feedback(LAG, weight="1/3")
    assert design
    assert design.certificate.weight == THIRD


# -- demands on designs


def test_a_decay_rate_is_reached_as_a_fraction():
    """The double next to 1/3 is below it: a loop that decays just that fast does not do."""
    design = kp.state_feedback(plant([[-1, 1], [1, -2]]), rate="1/3")
    assert Fraction(design.decay_rate) >= THIRD
    still = plant([[-1 / 3]], [[0]])
    assert kp.state_feedback(still, rate=1 / 3)
    assert not kp.state_feedback(still, rate="1/3")
    assert kp.state_feedback(still, rate="0.3333333333333333")


def test_a_gain_bound_is_kept_as_a_fraction():
    """The double next to 1/10 is above it."""
    design = kp.state_feedback(plant([[1, 0], [0, -1]], [["1/7"], [0]]), gain_bound="71/10")
    assert design
    assert all(Fraction(b) <= Fraction(71, 10) for b in design.certificate.others[0].bound.tolist())
    network = kp.network_feedback([plant([[-1]])] * 2, [[0, "1/3"], ["1/3", 0]], gain_bound="1/10")
    assert network


def test_vertices_and_disturbances_are_exact():
    A = [["-1", "1/3"], ["1/7", "-2"]]
    design = kp.state_feedback(plant(A), vertices=[(A, [[1], [0]]), (A, [["1/3"], [0]])])
    F = [Fraction(x) for x in design.F[0].tolist()]
    for loop, b in zip(design.certificate.loops, (1, THIRD), strict=True):
        assert loop.A.fractions()[0].tolist() == [-1 + b * F[0], THIRD + b * F[1]]
    design = kp.state_feedback(plant(A), disturbance=([["1/3"], [0]], [["1/7", 0]], [[0]], [["1/9"]]), gain_bound=5)
    proof = design.certificate.others[-1].positivity
    assert proof.B.fractions()[0, 0] == THIRD
    assert proof.C.fractions()[0, 0] == Fraction(1, 7)
    assert proof.D.fractions()[0, 0] == Fraction(1, 9)


def test_refusals_of_networks_are_about_their_nodes():
    node = plant([["1/3", "1"], [0, "1/3"]])
    design = kp.network_feedback([node, node], [[0, "1/3"], ["1/3", 0]])
    assert design.status is kp.Status.REFUTED
    assert design.certificate.A[0].fractions().tolist() == fractions([["1/3", 1], [0, "1/3"]])


# -- regions


def test_a_region_is_covered_to_its_ends():
    """The doubles next to 1/10 and 1/3 are above and below: both ends are rounded outwards."""
    seen = []

    def f(t, x, u, p):
        if hasattr(x[0], "value"):  # an interval
            seen.append((*x[0].value, *u[0].value))
        return [-x[0] + u[0]]

    system = ct.nlsys(f, inputs=1, states=1)
    assert kp.differential_positivity(system, kp.orthant(1), [["1/10", "1/3"]], inputs=[["-1/3", "-1/10"]])
    ends = np.array([[Fraction(end) for end in box] for box in seen])
    low, high = ends.min(axis=0), ends.max(axis=0)
    assert (low[0] <= Fraction(1, 10), high[1] >= THIRD) == (True, True)
    assert (low[2] <= -THIRD, high[3] >= -Fraction(1, 10)) == (True, True)


# -- every public argument
#
# A row for every argument of every public function and method: what "1/3" (or a matrix of such text) becomes, and the
# fraction that it has to be; or the reason why the argument holds no data of a proof.

CONE, SAME = [["1/3", "1/7"], [0, 1]], kp.PolyhedralCone([[7, 3], [0, 1]])
SIDE, SIDES = [["1/3"]], [[THIRD]]
LINE = kp.orthant(1)
PLANE = kp.orthant(2)
MINUS, TWO = [[-1, 0], [0, -1]], [[1, 0], [0, 1]]
MIXED, MIXED_SAME = [["-1", "1/3"], ["1/7", "-2"]], [[-1, THIRD], [Fraction(1, 7), -2]]
GAINED = [["1/3", 1], [1, -3]]


def pair(**more):
    return {"A": [["-1/3"]], "B": SIDE, "C": SIDE, "D": [["1/9"]], "X": LINE, "U": LINE, "Y": LINE, **more}


def square(**more):
    return {"A": MINUS, "B": TWO, "C": TWO, "D": [[0, 0], [0, 0]], "X": PLANE, "U": PLANE, "Y": PLANE, **more}


def of_theorem(function, read=lambda certificate: certificate):
    """Rows of a function of A, B, C, D, X, U, Y; `read` finds the certificate of positivity."""
    rows = {
        name: lambda name=name, want=want: (getattr(read(function(**pair())), name), [[want]])
        for name, want in zip("ABCD", (-THIRD, THIRD, THIRD, Fraction(1, 9)), strict=True)
    }
    return rows | {
        name: lambda name=name: (getattr(read(function(**square(**{name: CONE}))), name), SAME) for name in "XUY"
    }


def gain_of(**data):
    """1/3 over 1/7 and so on: the gain is computed in doubles from exact data."""
    return kp.induced_gain(**data)


def closed(design):
    return design.certificate.loops[0] if hasattr(design.certificate, "loops") else design.certificate


def loop_of(A, B, F):
    F = [Fraction(x) for x in np.ravel(F).tolist()]
    return [
        [Fraction(a) + Fraction(b[0]) * f for a, f in zip(row, F, strict=True)] for row, b in zip(A, B, strict=True)
    ]


def loop_row(design, A=GAINED, B=((1,), (0,))):
    d = design()
    return closed(d).A, loop_of(A, B, d.F)


def design_rows(function, **more):
    p = plant(GAINED)
    return {
        "sys": lambda: loop_row(lambda: function(p, **more)),
        "X": lambda: (closed(function(plant(GAINED), X=CONE, **more)).X, SAME),
        "rate": lambda: (Fraction(function(p, rate="1/3", **more).decay_rate) >= THIRD, True),
    }


def at_most(bound, limit):
    return all(0 <= Fraction(limit) - Fraction(b) < Fraction(1, 10**14) for b in np.ravel(bound).tolist())


def network(**links):
    return kp.feedback_interconnect([LAG, LAG], [[0, "1/3"], ["1/4", 0]]).with_node(LAG, **links)


def couplings(net):
    return net.model.coupling


EXACT = {
    "cone_positivity": of_theorem(kp.cone_positivity),
    "dissipativity": of_theorem(kp.dissipativity, lambda c: c.positivity)
    | {
        "q": lambda: (kp.dissipativity(**pair(), q=["-1/3"]).q_exact, [-THIRD]),
        "r": lambda: (kp.dissipativity(**pair(), r=["1/3"]).r_exact, [THIRD]),
    },
    "state_positivity": {
        "A": lambda: (kp.state_positivity([["-1/3"]], LINE).A, [[-THIRD]]),
        "X": lambda: (kp.state_positivity(MINUS, CONE).X, SAME),
    },
    "linear_lyapunov": {
        "A": lambda: (kp.linear_lyapunov([["-1/3"]], LINE).A, [[-THIRD]]),
        "X": lambda: (kp.linear_lyapunov(MINUS, CONE).X, SAME),
    },
    "find_cone": {
        "A": lambda: (kp.find_cone(plant(MIXED)).certificate.matrices, [MIXED_SAME]),
        "contains": lambda: (kp.find_cone(MINUS, contains=[["1/3", "1/7"]]).certificate.contains, [[THIRD, "1/7"]]),
        "within": lambda: (kp.find_cone(MINUS, within=[["1/3", "1/7"]]).certificate.within, [[THIRD, "1/7"]]),
    },
    "design_cone_and_feedback": {
        "sys": lambda: loop_row(lambda: kp.design_cone_and_feedback(plant(GAINED))),
        "vertices": lambda: loop_row(
            lambda: kp.design_cone_and_feedback(plant([[0, 1], [1, -3]]), vertices=[plant(GAINED)] * 2)
        ),
    },
    "differential_positivity": {
        "jacobians": lambda: (
            kp.differential_positivity([plant(MIXED).exact.A, MIXED], PLANE).centres,
            [MIXED_SAME] * 2,
        ),
        "X": lambda: (kp.differential_positivity(MINUS, CONE).X, SAME),
    },
    "feedback_interconnect": {
        "systems": lambda: (kp.feedback_interconnect([plant([["-1/3"]])], [[0]]).model.stacks[0].A, [[[-THIRD]]]),
        "coupling": lambda: (
            couplings(kp.feedback_interconnect([LAG, LAG], [[0, "1/3"], [0, 0]])),
            [[0, THIRD], [0, 0]],
        ),
        "supply_rates": lambda: (supplied([[0, 0], [0, 0]], ["-1/3"], ["2/3"]).exact[1:], [["2/3"] * 2, ["-1/3"] * 2]),
    },
    "stack": {
        **{
            name: lambda name=name, want=want: (
                getattr(kp.stack([[["-1/3"]]], SIDE, SIDE, [["1/9"]]), name),
                [[[want]]],
            )
            for name, want in zip("ABCD", (-THIRD, THIRD, THIRD, Fraction(1, 9)), strict=True)
        },
        "X": lambda: (kp.stack([MINUS], TWO, TWO, X=CONE).X, SAME),
        "U": lambda: (kp.stack([MINUS], TWO, TWO, U=CONE).U, SAME),
        "Y": lambda: (kp.stack([MINUS], TWO, TWO, Y=CONE).Y, SAME),
    },
    "scale_free_certificate": {
        "nodes": lambda: (kp.scale_free_certificate(plant([["-1/3"]]), 0.25).local.model.stacks[0].A, [[[-THIRD]]]),
        "weight": lambda: (kp.scale_free_certificate(LAG, weight="1/3").weight, THIRD),
        "link": lambda: (kp.scale_free_certificate(LAG, weight=1, link=SIDE).link, SIDES),
    },
    "OutWeightCertificate.covers": {
        "coupling": lambda: (
            kp.scale_free_certificate(plant([["-1/3"]]), "1/4").covers([[0, "1/3"], ["1/3", 0]]),
            False,
        )
    },
    "OutWeightCertificate.interconnect": {
        "coupling": lambda: (
            couplings(kp.scale_free_certificate(LAG, 0.5).interconnect([[0, "1/3"], ["1/3", 0]])),
            [[0, THIRD], [THIRD, 0]],
        )
    },
    "ConeNetwork.with_links": {
        "coupling": lambda: (couplings(kp.feedback_interconnect([LAG], [[0]]).with_links([["1/3"]])), SIDES)
    },
    "ConeNetwork.with_node": {
        "system": lambda: (
            kp.feedback_interconnect([LAG], [[0]]).with_node(plant([["-1/3"]])).model.block_matrices is not None
            and sorted(
                x
                for s in kp.feedback_interconnect([LAG], [[0]]).with_node(plant([["-1/3"]])).model.stacks
                for x in s.A.fractions().ravel().tolist()
            ),
            [-1, -THIRD],
        ),
        "incoming": lambda: (couplings(network(incoming={0: "1/5"})), [[0, THIRD, 0], ["1/4", 0, 0], ["1/5", 0, 0]]),
        "outgoing": lambda: (couplings(network(outgoing={0: "1/5"})), [[0, THIRD, "1/5"], ["1/4", 0, 0], [0, 0, 0]]),
    },
    "ConeNetwork.replace_node": {
        "system": lambda: (
            kp.feedback_interconnect([LAG], [[0]]).replace_node(0, plant([["-1/3"]])).model.stacks[0].A,
            [[[-THIRD]]],
        ),
        "incoming": lambda: (
            couplings(network().replace_node(0, LAG, incoming={1: "1/5"})),
            [[0, "1/5", 0], ["1/4", 0, 0], [0] * 3],
        ),
        "outgoing": lambda: (
            couplings(network().replace_node(0, LAG, outgoing={1: "1/5"})),
            [[0, THIRD, 0], ["1/5", 0, 0], [0] * 3],
        ),
    },
    "network_feedback": {
        "systems": lambda: (
            kp.network_feedback([plant(GAINED)], [[0]]).certificate.model.stacks[0].A,
            [loop_of(GAINED, ((1,), (0,)), kp.network_feedback([plant(GAINED)], [[0]]).F)],
        ),
        "coupling": lambda: (
            kp.network_feedback([LAG] * 2, [[0, "1/3"], [0, 0]]).certificate.model.coupling,
            [[0, THIRD], [0, 0]],
        ),
        "rate": lambda: (Fraction(kp.network_feedback([LAG], [[0]], rate="1/3").decay_rate) >= THIRD, True),
        "gain_bound": lambda: (
            np.abs(kp.network_feedback([plant([["1/30"]])], [[0]], gain_bound="1/10").F).max() <= 0.1,
            True,
        ),
    },
    "state_feedback": design_rows(kp.state_feedback)
    | {
        "gain_bound": lambda: (
            at_most(kp.state_feedback(plant(GAINED), gain_bound="31/10").certificate.others[0].bound, "31/10"),
            True,
        ),
        "vertices": lambda: loop_row(
            lambda: kp.state_feedback(plant([[0, 1], [1, -3]]), vertices=[(GAINED, [["1/3"], [0]])] * 2),
            B=(("1/3",), (0,)),
        ),
        "disturbance": lambda: (
            kp.state_feedback(plant(MIXED), disturbance=([["1/3"], [0]], [["1/7", 0]], [[0]], [["1/9"]]), gain_bound=5)
            .certificate.others[-1]
            .positivity.B,
            [[THIRD], [0]],
        ),
    },
    "output_feedback": {
        **design_rows(kp.output_feedback),
        "sys": lambda: (
            closed(kp.output_feedback(plant(GAINED))).A.fractions()[0, 0]
            - Fraction(kp.output_feedback(plant(GAINED)).F[0, 0]),
            THIRD,
        ),
        "gain_bound": lambda: (
            at_most(kp.output_feedback(plant(GAINED), gain_bound="31/10").certificate.others[0].bound, "31/10"),
            True,
        ),
        "vertices": lambda: (
            kp.output_feedback(plant([[0, 1], [1, -3]]), vertices=[(GAINED, [[1], [0]])] * 2)
            .certificate.loops[0]
            .A.fractions()[0, 1],
            1,
        ),
    },
    "observer_gain": {
        "sys": lambda: (closed(kp.observer_gain(plant([["-1", "1/3"], [1, -3]]))).A.fractions()[1, 0], THIRD),
        "X": lambda: (closed(kp.observer_gain(plant(MINUS), X=CONE)).X, SAME.dual),
        "rate": lambda: (Fraction(kp.observer_gain(plant(GAINED), rate="1/3").decay_rate) >= THIRD, True),
        "gain_bound": lambda: (
            at_most(kp.observer_gain(plant(GAINED), gain_bound="31/10").certificate.others[0].bound, "31/10"),
            True,
        ),
    },
    "scale_free_feedback": {
        "sys": lambda: (
            (kp.scale_free_feedback(plant([["-1/3"]]), "1/4").closed_loop.exact.A.fractions()[0, 0] + THIRD).denominator
            < 10**6
            and (0, 0)
        ),
        "weight": lambda: (kp.scale_free_feedback(LAG, weight="1/3").certificate.weight, THIRD),
        "X": lambda: (
            kp.scale_free_feedback(plant(MINUS, [["1/3"], ["1/7"]], [[1, 0]]), 0.25, X=CONE)
            .certificate.local.model.stacks[0]
            .X,
            SAME,
        ),
        "rate": lambda: (Fraction(kp.scale_free_feedback(LAG, "1/4", rate="1/3").decay_rate) >= THIRD, True),
        "gain_bound": lambda: (kp.scale_free_feedback(LAG, "1/4", gain_bound="1/10").status, kp.Status.PROVED),
    },
    "PolyhedralCone": {"rays": lambda: (kp.PolyhedralCone(CONE), SAME)},
    "PolyhedralCone.from_facets": {
        "normals": lambda: (kp.PolyhedralCone.from_facets(CONE), kp.PolyhedralCone.from_facets([[7, 3], [0, 1]]))
    },
    "PolyhedralCone.contains": {
        "x": lambda: ([SAME.contains(["1/3", "1/7"]), SAME.contains(["1/3", "1/7"], strict=True)], [True, False])
    },
    "PolyhedralCone.transform": {"T": lambda: (PLANE.transform([["1/3", 0], ["1/7", 1]]), SAME)},
    "ConeStateSpace": {
        "args": lambda: (kp.ConeStateSpace([["-1/3"]], SIDE, SIDE, [["1/9"]]).exact.D, [["1/9"]]),
        "X": lambda: (plant(MINUS, X=CONE).exact.X, SAME),
        "U": lambda: (plant(MINUS, TWO, U=CONE).exact.U, SAME),
        "Y": lambda: (plant(MINUS, TWO, TWO, Y=CONE).exact.Y, SAME),
    },
    "ConeStateSpace.append": {"other": lambda: (LAG.append(S).exact.A, [[-1, 0], [0, -THIRD]])},
    "ConeStateSpace.feedback": {
        "other": lambda: (S.feedback(SIDE, sign=1).exact.A, [[0]]),
        "sign": lambda: (S.feedback(1, sign="1/3").exact.A, [[0]]),
    },
    "ConeStateSpace.lft": {"other": lambda: (S.lft(S).exact.A, [[-THIRD, 1], [1, -THIRD]])},
    "ConeStateSpace.dissipativity": {
        "q": lambda: (LAG.dissipativity(q=["-1/3"]).q_exact, [-THIRD]),
        "r": lambda: (LAG.dissipativity(r=["1/3"]).r_exact, [THIRD]),
    },
    "ConeStateSpace.similarity_transform": {
        "T": lambda: (S.similarity_transform(SIDE).exact.B, SIDES),
        "timescale": lambda: (S.similarity_transform([[1]], timescale="1/3").exact.A, [[-1]]),
    },
    "examples.mass_spring_node": {
        "F": lambda: (kp.examples.mass_spring_node(["-64/3", -13]).exact.A, [[0, 1], ["-67/3", -13]]),
        "k": lambda: (kp.examples.mass_spring_node(k="1/3").exact.A, [[0, 1], ["-64/3", -13]]),
        "m": lambda: (kp.examples.mass_spring_node(m=3).exact.A, [[0, 1], ["-64/3", -13]]),
    },
}
LOOP = kp.feedback_interconnect([S], [[0]])
EXACT |= {
    "ConeNetwork.append": {"other": lambda: (LOOP.append(S).exact.A, [[-THIRD, 0], [0, -THIRD]])},
    "ConeNetwork.feedback": {
        "other": lambda: (LOOP.feedback(SIDE, sign=1).exact.A, [[0]]),
        "sign": lambda: (LOOP.feedback(1, sign="1/3").exact.A, [[0]]),
    },
    "ConeNetwork.lft": {"other": lambda: (LOOP.lft(S).exact.A, [[-THIRD, 1], [1, -THIRD]])},
    "ConeNetwork.dissipativity": {
        "q": lambda: (LOOP.dissipativity(q=["-1/3"]).q_exact, [-THIRD]),
        "r": lambda: (LOOP.dissipativity(r=["1/3"]).r_exact, [THIRD]),
    },
    "ConeNetwork.similarity_transform": {
        "T": lambda: (LOOP.similarity_transform(SIDE).exact.B, SIDES),
        "timescale": lambda: (LOOP.similarity_transform([[1]], timescale="1/3").exact.A, [[-1]]),
    },
}
EXACT["Cone.contains"], EXACT["Cone.transform"] = EXACT["PolyhedralCone.contains"], EXACT["PolyhedralCone.transform"]

# Numbers that end as doubles, each with the reason.
_GAIN = "the gain is an infimum computed in floating point; `dissipativity` proves a bound"
_SIMULATED = "a simulation in floating point"
_EFFORT = "effort and tolerance of a search, which prove nothing"
_DRAWN = "a picture"
_WORD = 'the word "max" only: rates are found, and proven as doubles'
DOUBLES = {
    "induced_gain": dict.fromkeys(["A", "B", "C", "D", "X", "U", "Y", "e", "f"], _GAIN),
    "ConeStateSpace.gain": dict.fromkeys("ef", _GAIN),
    "differential_positivity": dict.fromkeys(
        ["region", "inputs"], "ends of boxes, rounded outwards; see test_a_region_is_covered_to_its_ends"
    ),
    "ConeNetwork.delayed_response": dict.fromkeys(["T", "X0", "delays"], _SIMULATED),
    "ConeNetwork.forced_response": dict.fromkeys(["T", "U", "X0"], _SIMULATED),
    "ConeNetwork.initial_response": dict.fromkeys(["T", "X0"], _SIMULATED),
    "ConeNetwork.horner": {"x": "a frequency response in floating point"},
    "ConeNetwork.abscissa_certificate": {"relative": _EFFORT},
    "ConeNetwork.spectral_abscissa": {"relative": _EFFORT},
    "ConeNetwork.room_for": dict.fromkeys(
        ["system", "sources", "targets"], "an estimate in floating point; `with_node` proves"
    ),
    "ConeStateSpace.sample": {"Ts": "matrix exponentials are computed in floating point"},
    "ConeStateSpace.linearize": {"x0": "the system itself is returned, wherever it is linearised"},
    "linear_lyapunov": {"rate": _WORD},
    "ConeStateSpace.linear_lyapunov": {"rate": _WORD},
    "gain_rate_tradeoff": {
        "sys": "a curve in floating point; its designs, if asked for, are those of `state_feedback`",
        "rates": "points of this curve",
        "X": "the cone of this curve",
        "demands": "as those of `state_feedback`",
    },
    "phase_portrait": dict.fromkeys(["sys", "X", "pointdata", "timedata", "initial_states", "level_lines"], _DRAWN),
    "plot_closed_loop": {"sys": _DRAWN},
    "plot_cone": dict.fromkeys(["X", "size"], _DRAWN),
    "plot_network": {"positions": _DRAWN},
    "examples.mass_spring": dict.fromkeys("km", "doubles for python-control; `mass_spring_node` is exact"),
}
for _method in ("gain", "linear_lyapunov", "linearize", "sample"):  # the same for networks
    DOUBLES[f"ConeNetwork.{_method}"] = DOUBLES[f"ConeStateSpace.{_method}"]
# Arguments that are no data: what they are.
NO_DATA = {
    "names and words": {"name", "names", "title", "label", "color", "kind", "norm", "method", "few", "path"},
    "yes or no": {"discrete", "uniform", "ports", "strict", "inverse", "trusted", "certify", "dominant_direction"}
    | {"show_legend", "warn_infinite", "use_prefix_suffix", "states"},
    "whole numbers": {"n", "nu", "ny", "k", "max_rays", "seed", "restarts", "pieces", "refine", "node", "types"}
    | {"facets", "n_nodes", "degree"},
    "seconds, and who hears of them": {"time_limit", "progress"},
    "signals by place or name": {"inputs", "outputs"},
    "a timebase, which python-control keeps in doubles": {"dt"},
    "patterns of zeros": {"structure"},
    "code of the user": {"constraints", "objective", "solver"},
    "objects that hold their own exact data": {"factors", "design", "net", "curve", "ax"},
    "passed on": {"args", "kwargs"},
}
# Data classes are made by the functions above; what they hold is checked there.
MADE_BY_OTHERS = {"Cone", "Certificate", "ConeNetwork"}


def arguments():
    """Every argument of every public function and method: (function, argument)."""
    for name, thing in {**PUBLIC, **METHODS}.items():
        owner = PUBLIC.get(name.rpartition(".")[0])
        if dataclasses.is_dataclass(thing) or name in MADE_BY_OTHERS:
            continue
        if dataclasses.is_dataclass(owner) and name not in EXACT:
            continue
        for argument in inspect.signature(thing).parameters:
            if argument not in ("self", "cls"):
                yield name, argument


def plainly(x):
    """Fractions in nested lists, or what has no fractions."""
    if isinstance(x, Matrix):
        return x.dense().fractions().tolist()
    if isinstance(x, (list, tuple, np.ndarray)):
        return [plainly(y) for y in x]
    return Fraction(x) if isinstance(x, (int, float, str, Fraction)) else x


@pytest.mark.parametrize(("name", "argument"), list(arguments()))
def test_every_argument_has_its_row(name, argument):
    if argument in EXACT.get(name, {}):
        got, want = EXACT[name][argument]()
        assert plainly(got) == plainly(want)
        assert argument not in DOUBLES.get(name, {})
        return
    known = argument in DOUBLES.get(name, {}) or any(argument in group for group in NO_DATA.values())
    assert known, (
        f"{name}({argument}) takes what? Give it a row in EXACT, or the reason why it holds no data of a proof"
    )


def test_no_row_is_left_over():
    known = set(arguments())
    rows = {(name, argument) for table in (EXACT, DOUBLES) for name, row in table.items() for argument in row}
    assert rows - known <= {("Cone.contains", "x"), ("Cone.transform", "T")}
