"""What is typed is what is proven: data in fractions and text reach every certificate as they are.

1/3 is no double.  Where the rounding of a datum changes a verdict, the verdict is that of the datum.
"""

import dataclasses
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from exact_plants import LAG, THIRD, THIRDS, plant, supplied

import control_kpos as kp
from control_kpos.nonlinear import differential
from control_kpos.systems.system import System

# a double eigenvalue 0.4, which rounding turns into a complex pair
TWICE = [["0.1", "0.3"], ["-0.3", "0.7"]]
# leaves the cone of (0.1, 0.3) and (0.3, 0.1) invariant with equality, which rounding breaks
EDGE = [["-31/40", "9/40"], ["-9/40", "-1/40"]]
EDGE_CONE = [["0.1", "0.3"], ["0.3", "0.1"]]


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


@pytest.mark.parametrize(
    ("result", "expected"),
    [
        (lambda: THIRDS * THIRD, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: THIRD * THIRDS, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: THIRDS / 3, ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: THIRDS / Fraction(3), ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: THIRDS + THIRD, ([[-THIRD]], [[1]], [[1]], [[THIRD]])),
        (lambda: THIRD + THIRDS, ([[-THIRD]], [[1]], [[1]], [[THIRD]])),
        (lambda: THIRDS * np.array([[THIRD]]), ([[-THIRD]], [[THIRD]], [[1]], [[0]])),
        (lambda: np.array([[THIRD]]) * THIRDS, ([[-THIRD]], [[1]], [[THIRD]], [[0]])),
        (lambda: THIRDS.feedback([["1/3"]], sign=1), ([[0]], [[1]], [[1]], [[0]])),
        (lambda: THIRDS.feedback(1, sign="1/3"), ([[0]], [[1]], [[1]], [[0]])),
        (lambda: THIRDS.feedback(THIRDS, sign="1/3"), ([[-THIRD, THIRD], [1, -THIRD]], [[1], [0]], [[1, 0]], [[0]])),
        (lambda: THIRDS.similarity_transform([["1/3"]]), ([[-THIRD]], [[THIRD]], [[3]], [[0]])),
        (lambda: THIRDS.similarity_transform([[1]], timescale="1/3"), ([[-1]], [[3]], [[1]], [[0]])),
        (lambda: kp.ConeStateSpace(THIRDS), ([[-THIRD]], [[1]], [[1]], [[0]])),
        (lambda: THIRDS.copy(), ([[-THIRD]], [[1]], [[1]], [[0]])),
    ],
)
def test_operations_keep_what_is_given(result, expected):
    s = result()
    assert isinstance(s, kp.ConeStateSpace)
    assert [m.fractions().tolist() for m in s.exact.matrices] == [fractions(rows) for rows in expected]


def test_exact_feedback_decides_at_the_margin():
    """-1/3 + 1/3 = 0 is not stable; with the double next to 1/3 it would be."""
    assert THIRDS.feedback(1, sign="1/3").linear_lyapunov().status is kp.Status.REFUTED
    assert THIRDS.feedback(1, sign=1 / 3).linear_lyapunov().status is kp.Status.PROVED


def test_node_of_the_paper_is_exact():
    node = kp.examples.mass_spring_node(["-64/3", "-13"], k="1/3", m="7/3")
    assert node.exact.A.fractions().tolist() == [[0, 1], [Fraction(-64, 3) - Fraction(1, 7), -13]]


# -- supply rates and weights


SPRING = kp.ConeStateSpace([[0, 1], [-22, -13]], [[0], [1]], [[1, 0]], 0, X=[[0, 1], [1, -2]])  # gain 1/22


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


def test_a_region_is_covered_to_its_ends(monkeypatch):
    """The doubles next to 1/10 and 1/3 are above and below: both ends are rounded outwards."""
    seen, pieces = [], differential.jacobian_pieces

    def watched(function, whole, *more):
        seen.append(whole.ravel())
        return pieces(function, whole, *more)

    monkeypatch.setattr(differential, "jacobian_pieces", watched)
    system = ct.nlsys(lambda t, x, u, p: [-x[0] + u[0]], inputs=1, states=1)
    assert kp.differential_positivity(system, kp.orthant(1), [["1/10", "1/3"]], inputs=[["-1/3", "-1/10"]])
    ends = np.array([[Fraction(end) for end in box] for box in seen])
    low, high = ends.min(axis=0), ends.max(axis=0)
    assert (low[0] <= Fraction(1, 10), high[1] >= THIRD) == (True, True)
    assert (low[2] <= -THIRD, high[3] >= -Fraction(1, 10)) == (True, True)
