"""ConeStateSpace: what it accepts and refuses, what it carries, and that it is a python-control system."""

import pickle
from fractions import Fraction

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from mass_spring import RAYS, A, B, C, D, same
from numpy import array  # noqa: F401  (read by eval of a repr)

import control_kpos as kp
from control_kpos import ConeStateSpace

# -- construction


def test_cones_default_to_orthants():
    s = ConeStateSpace(np.diag([-1.0, -2.0]), np.ones((2, 3)), np.ones((1, 2)), 0)
    assert s.cones == (kp.orthant(2), kp.orthant(3), kp.orthant(1))
    assert s.D.shape == (1, 3)


@pytest.mark.parametrize("given_as", [RAYS, np.array(RAYS), kp.PolyhedralCone(RAYS), [["0", "1"], [1, Fraction(-2)]]])
def test_cones_are_given_as_cones_or_rays(given_as):
    s = ConeStateSpace(A, B, C, D, X=given_as, U=[[2]], Y=kp.orthant(1))
    assert kp.PolyhedralCone(RAYS) == s.X
    assert s.cones == (s.X, s.U, s.Y)
    assert s.is_cone_positive()


@pytest.mark.parametrize("dt", [0, None, True, 0.1, 2])
def test_timebase_by_position_and_by_name(dt):
    assert ConeStateSpace(A, B, C, D, dt).dt == dt
    assert ConeStateSpace(A, B, C, D, dt=dt).dt == dt


def test_default_timebase_of_python_control():
    ct.config.defaults["control.default_dt"] = True
    s = ConeStateSpace([[0.5]], [[1]], [[1]], 0)
    assert s.dt is True
    assert s.linear_lyapunov()
    assert "dt" not in repr(s)


def test_copy_keeps_names_timebase_and_cones(node):
    again = ConeStateSpace(node)
    assert same(node, again)
    assert again.name == "node"
    other = ConeStateSpace(node, X=kp.orthant(2), dt=0.5, name="other")
    assert (other.X, other.U, other.dt, other.name) == (kp.orthant(2), node.U, 0.5, "other")
    assert other.input_labels == ["force"]
    again.A[0, 0] = 7
    assert node.A[0, 0] == 0


def test_any_python_control_system_takes_cones(node):
    plain = ct.ss(A, B, C, D, name="P", inputs="u", outputs="y")
    assert ConeStateSpace(plain, X=RAYS).is_cone_positive()
    loop = ct.interconnect([plain, ct.ss(A, B, C, D, name="Q", inputs="y", outputs="u")], inputs="u", outputs="y")
    assert isinstance(loop, ct.LinearICSystem)
    s = ConeStateSpace(loop, X=node.X * node.X)
    assert s.state_labels == loop.state_labels
    assert s.X.dim == 4
    assert ConeStateSpace(ct.ss(ct.tf([1], [1, 2]))).is_cone_positive()


def test_sparse_matrices_are_read():
    s = ConeStateSpace(sp.csr_array(A), sp.csr_matrix(B), C, D)
    assert (s.A == A).all()
    assert (s.B == B).all()


@pytest.mark.parametrize(
    ("bad", "error", "words"),
    [
        ({"A": [[np.nan, 1], [0, 1]]}, kp.DataError, r"A\[0, 0\] is nan"),
        ({"B": [[0], [np.inf]]}, kp.DataError, r"B\[1, 0\] is inf"),
        ({"C": [[1j, 0]]}, kp.DataError, "C is complex"),
        ({"C": [[1j, 0]]}, TypeError, "C is complex"),
        ({"A": np.eye(2) * 1j}, kp.DataError, "A is complex"),
        ({"D": [["one"]]}, kp.DataError, r"D\[0, 0\] is the text 'one'"),
        ({"D": None}, kp.DataError, "D is None"),
        ({"A": [[1, 2], [3]]}, kp.ShapeError, "A is ragged"),
        ({"A": [[1, 2, 3], [4, 5, 6]]}, kp.ShapeError, "A must be a square matrix.*here A 2 x 3"),
        ({"B": [[1], [2], [3]]}, kp.ShapeError, r"B matrix; expected \(2, 1\).*B 3 x 1"),
        ({"B": [[1], [2], [3]]}, ct.ControlDimension, "B"),
        ({"C": [[1, 2, 3]]}, kp.ShapeError, "C"),
        ({"D": np.zeros((2, 2))}, kp.ShapeError, "D"),
        ({"A": np.zeros((2, 2, 2))}, kp.ShapeError, "A must be 2-dimensional"),
        ({"A": np.ma.masked_array(A, A > 0)}, kp.DataError, "A has masked entries"),
        ({"A": [[10**400, 0], [0, 0]]}, kp.DataError, "does not fit into a double"),
        ({"dt": -1}, kp.TimebaseError, "dt = -1"),
        ({"dt": np.nan}, kp.TimebaseError, "dt = nan"),
        ({"dt": np.inf}, kp.TimebaseError, "dt = inf"),
        ({"dt": "fast"}, kp.TimebaseError, "dt = 'fast'"),
        ({"X": kp.orthant(3)}, kp.ConeMismatchError, "X is a cone in 3 dimensions, but the system has 2 states"),
        ({"U": kp.orthant(2)}, kp.ConeMismatchError, "U .*1 inputs"),
        ({"Y": [[1, 0], [0, 1]]}, kp.ConeMismatchError, "Y .*1 outputs"),
        ({"X": [[1, 0]]}, kp.NotProperConeError, "X is not solid"),
        ({"X": [[1, 0], [-1, 0], [0, 1]]}, kp.NotProperConeError, "X is not pointed"),
        ({"X": [[0, 0], [1, 0]]}, kp.DataError, "zero"),
        ({"X": "orthant"}, kp.DataError, "orthant"),
        ({"nonsense": 1}, TypeError, "nonsense"),
    ],
)
def test_bad_input_is_named(bad, error, words):
    data = {"A": A, "B": B, "C": C, "D": D, **{k: v for k, v in bad.items() if k in "ABCD"}}
    rest = {k: v for k, v in bad.items() if k not in "ABCD"}
    with pytest.raises(error, match=words) as caught:
        ConeStateSpace(*data.values(), **rest)
    assert isinstance(caught.value, (kp.KposError, TypeError))


@pytest.mark.parametrize("args", [(), (A,), (A, B), (A, B, C, D, 0, 0), (3,)])
def test_wrong_arguments(args):
    with pytest.raises(TypeError, match=r"arguments|StateSpace"):
        ConeStateSpace(*args)


def test_cones_cannot_be_assigned(node):
    with pytest.raises(AttributeError):
        node.X = kp.orthant(2)


# -- exact data


def test_fractions_and_decimals_are_kept():
    third = ConeStateSpace([["-1/3"]], [[1]], [[1]], 0)
    assert third.cone_positivity().A.fractions()[0, 0] == Fraction(-1, 3)
    assert third.A[0, 0] == -1 / 3
    big = ConeStateSpace([[-(2**60) - 1]], [[1]], [[1]], 0)
    assert big.cone_positivity().A.fractions()[0, 0] == -(2**60) - 1


@pytest.mark.parametrize("second", ["-13.2", Fraction(-66, 5)])
@pytest.mark.parametrize(("nudge", "answer"), [(0, True), (Fraction(-1, 10**30), False), (Fraction(1, 10**30), True)])
def test_verdicts_are_about_the_numbers_meant(second, nudge, answer):
    # x' = A x with A = [[0, 1], [-k + F1, F2]]: on rays (0, 1), (1, -2) positive iff -k + F1 >= 2 F2 + 4
    lower = 2 * Fraction("-13.2") + 4 + nudge
    s = ConeStateSpace([[0, 1], [lower, second]], B, C, D, X=RAYS)
    assert s.is_cone_positive() is answer


def test_assigned_matrices_count_from_then_on():
    s = ConeStateSpace([[0, 1], [Fraction("-22.4") - Fraction(1, 10**30), "-13.2"]], B, C, D, X=RAYS)
    assert not s.is_cone_positive()
    s.A = np.array([[0.0, 1.0], [-22.0, -13.0]])
    assert s.is_cone_positive()
    s.A[1, 1] = -12
    assert not s.is_cone_positive()
    assert not ConeStateSpace(s).is_cone_positive()
    assert s.cone_positivity().A.values[1, 1] == -12
    s.A = np.array([[np.nan]])
    with pytest.raises(kp.KposError):
        s.is_cone_positive()


def test_changes_in_place_count(node):
    s = ConeStateSpace([["-1/3"]], [[1]], [["1/7"]], 0)
    s.A[0, 0] = -5
    assert s.cone_positivity().A.fractions()[0, 0] == -5
    assert s.cone_positivity().C.fractions()[0, 0] == Fraction(1, 7)


def test_timebase_assigned_counts():
    s = ConeStateSpace([[-0.5]], [[1]], [[1]], 0)
    assert s.is_cone_positive()
    s.dt = 1
    assert not s.is_cone_positive()


# -- verdicts are those of the theorems


@pytest.mark.parametrize("dt", [0, None, 0.1, True])
def test_methods_ask_the_theorems(dt):
    s = ConeStateSpace([[0.5, 0.25], [0, 0.25]], [[1], [0]], [[1, 1]], [[2]], dt)
    data, discrete = (s.A, s.B, s.C, s.D), bool(dt)
    assert s.cone_positivity().status is kp.cone_positivity(*data, *s.cones, discrete=discrete).status
    for rate in (None, "max"):
        mine, theirs = s.linear_lyapunov(rate=rate), kp.linear_lyapunov(s.A, s.X, discrete=discrete, rate=rate)
        assert mine.status is theirs.status
        np.testing.assert_array_equal(mine.decay_rate, theirs.decay_rate)
    assert bool(s.linear_lyapunov()) == discrete
    for norm in ("L1", "Linf"):
        assert s.gain(norm=norm) == kp.induced_gain(*data, *s.cones, norm=norm, discrete=discrete)
    found = s.dissipativity()
    assert found.status is kp.dissipativity(*data, *s.cones, discrete=discrete).status
    assert bool(s.dissipativity(q=[-1], r=[100])) == discrete
    if found:
        assert s.dissipativity(q=found.q, r=found.r)


def test_gain_of_a_stable_system_is_its_gain_at_rest(orthant_node):
    assert orthant_node.gain() == pytest.approx(float(orthant_node.dcgain()))


def test_systems_without_states():
    s = ConeStateSpace([], [], [], [[2, 1]])
    assert s.X.dim == 0
    assert s.is_cone_positive()
    assert s.linear_lyapunov()
    assert s.dissipativity(q=[-1], r=[2, 1])
    assert s.gain() == pytest.approx(2)
    assert s.gain(norm="Linf") == pytest.approx(3)
    assert not ConeStateSpace([], [], [], [[-2]]).is_cone_positive()
    assert ConeStateSpace([], [], [], [[-2]], Y=[[-1]]).is_cone_positive()
    assert ConeStateSpace(0, 0, 0, 1, remove_useless_states=True).X.dim == 0
    assert same(s, pickle.loads(pickle.dumps(s)))
    assert same(s, eval(repr(s)))


def test_systems_without_inputs_or_outputs():
    s = ConeStateSpace(np.diag([-1.0, -2.0]), np.zeros((2, 0)), np.zeros((0, 2)), np.zeros((0, 0)))
    assert s.is_cone_positive()
    assert s.linear_lyapunov()
    for question in (s.gain, s.dissipativity):
        with pytest.raises(kp.ShapeError, match="0 inputs and 0 outputs"):
            question()


@given(st.sampled_from([1e-150, 1e-30, 1.0, 1e30, 1e150]), st.sampled_from([1e-150, 1.0, 1e150]), st.booleans())
def test_units_change_no_verdict(time, signal, positive):
    lower = -22.0 if positive else -22.0 * (1 + 2**-50)
    rays = np.array(RAYS) * 1e100
    scaled = ConeStateSpace(time * np.array([[0, 1], [lower, -13]]), signal * B, signal * C, signal * D, X=rays)
    # rounding of time * lower and time * 13 moves the boundary itself: the exact numbers decide
    speed, slow, fast = (Fraction(x) for x in (scaled.A[0, 1], scaled.A[1, 0], scaled.A[1, 1]))
    assert scaled.is_cone_positive() == (slow - 2 * fast - 4 * speed >= 0)
    assert scaled.cone_positivity().status is not kp.Status.UNDECIDED
    assert scaled.linear_lyapunov().status is not kp.Status.UNDECIDED


# -- useless states


def test_removed_states_take_their_cone_with_them():
    full = [[-1, 1, 0], [0, -2, 0], [0, 0, 0]], [[1], [1], [0]], [[1, 1, 1]], 0
    s = ConeStateSpace(*full, remove_useless_states=True)
    assert s.nstates == s.X.dim == 2
    wide = kp.PolyhedralCone([[1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]])
    reduced = ConeStateSpace(*full, X=wide, remove_useless_states=True, states=["a", "b", "c"])
    assert kp.orthant(2) == reduced.X  # wide where the third state is 0
    assert reduced.state_labels == ["a", "b"]
    assert kp.orthant(2) == ConeStateSpace(*full, X=wide.transform(np.eye(3)[:2]), remove_useless_states=True).X


def test_states_that_nothing_depends_on_are_projected_away():
    A, B, C = [[-1, 0], ["1/3", 0]], [["1/7"], [1]], [[1, 0]]
    s = ConeStateSpace(A, B, C, 0, X=[[1, 1], [1, -1]], remove_useless_states=True)
    assert s.nstates == 1
    assert kp.orthant(1) == s.X
    assert s.cone_positivity().B.fractions()[0, 0] == Fraction(1, 7)


def test_useless_states_of_operands(node):
    s, idle = ConeStateSpace([[-1]], [[1]], [[1]], 0), ConeStateSpace([[0]], [[0]], [[1]], 0)
    ct.config.defaults["statesp.remove_useless_states"] = True
    for result in (s + idle, s.append(idle), -idle, idle.sample(1)):
        assert type(result) is ConeStateSpace
        assert result.X.dim == result.nstates < 2
        assert result.is_cone_positive()
    assert type(node + idle) is ct.StateSpace  # which of the two cones belongs to the state that is left?
    assert (node + idle).nstates == 2


# -- python-control


def test_python_control_takes_it_for_a_state_space(node):
    plain = ct.ss(A, B, C, D)
    assert isinstance(node, ct.StateSpace)
    np.testing.assert_array_equal(ct.poles(node), ct.poles(plain))
    np.testing.assert_array_equal(
        ct.step_response(node, np.linspace(0, 1)).y, ct.step_response(plain, np.linspace(0, 1)).y
    )
    np.testing.assert_array_equal(node(1j), plain(1j))
    assert type(ct.ss(node)) is ct.StateSpace
    np.testing.assert_array_equal(ct.ss2tf(node).den[0][0], ct.ss2tf(plain).den[0][0])
    assert type(ct.c2d(node, 0.1)) is ConeStateSpace
    K = ct.lqr(node, np.eye(2), [[1]])[0]
    np.testing.assert_array_equal(K, ct.lqr(plain, np.eye(2), [[1]])[0])


def test_names_follow_python_control(node):
    loop = ct.feedback(node, node, 1, name="loop", inputs="w", outputs="z")
    assert type(loop) is ConeStateSpace
    assert (loop.name, loop.input_labels, loop.output_labels) == ("loop", ["w"], ["z"])
    part = node["place", "force"]
    assert part.name == "node$indexed"
    assert (part.input_labels, part.output_labels) == (["force"], ["place"])
    assert node.sample(0.1).name == "node$sampled"
    assert node.sample(0.1, name="fast", inputs="v").input_labels == ["v"]
    assert node.copy().name == "node$copy"


def test_systems_of_other_kinds(node):
    tf = ct.tf([1], [1, 1])
    lag = ct.nlsys(lambda t, x, u, params: -x + u, lambda t, x, u, params: x, inputs=1, outputs=1, states=1)
    frequency = ct.frd(ct.ss(tf), [0.1, 1.0, 10.0])
    for operation in (
        lambda s: s + tf,
        lambda s: tf + s,
        lambda s: s * tf,
        lambda s: tf * s,
        lambda s: s + lag,
        lambda s: lag * s,
        lambda s: s.feedback(lag),
        lambda s: s.feedback(tf, 1),
        lambda s: s * frequency,
        lambda s: frequency + s,
        lambda s: s.append(tf),
        lambda s: s.append(1),
        lambda s: s + plain_node(),
        lambda s: plain_node() + s,
        lambda s: plain_node() * s,
        lambda s: s - plain_node(),
        lambda s: s / tf,
        lambda s: 1 / (s + 1),
    ):
        mine, theirs = operation(node), operation(ct.StateSpace(node))
        assert type(mine) is type(theirs)
        if isinstance(theirs, ct.StateSpace):
            for name in "ABCD":
                np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))


def plain_node():
    return ct.ss([[-1, 2], [3, -4]], [[1], [2]], [[3, 4]], 0)


@pytest.mark.parametrize("other", ["text", None, [1], {}, object()])
def test_operands_that_mean_nothing(node, other):
    for operation in (lambda: node + other, lambda: other + node, lambda: node * other, lambda: other * node):
        with pytest.raises(TypeError):
            operation()


def test_refusals_name_sizes_and_timebases(node):
    two = ConeStateSpace([[-1]], [[1, 1]], [[1], [1]], 0, name="two")
    three = ConeStateSpace([[-1]], [[1, 1, 1]], [[1], [1]], 0, name="three")
    with pytest.raises(kp.ShapeError, match="two has 2 inputs and 2 outputs, three has 3 inputs and 2 outputs"):
        two + three
    with pytest.raises(kp.ShapeError, match="three has 3 inputs"):
        three * two
    with pytest.raises(kp.ShapeError, match="node has 1 inputs and 1 outputs"):
        node.feedback(two)
    with pytest.raises(kp.ShapeError, match="the array is 3 x 3"):
        two * np.ones((3, 3))
    with pytest.raises(kp.ShapeError, match="singular"):
        ConeStateSpace([], [], [], [[1]]).feedback(1, 1)
    slow = node.sample(1.0)
    for operation in (
        lambda: node + slow,
        lambda: node * slow,
        lambda: node.append(slow),
        lambda: node.feedback(slow),
        lambda: node.lft(slow),
    ):
        with pytest.raises(kp.TimebaseError, match=r"node has dt = 0, node\$sampled has dt = 1.0"):
            operation()
    with pytest.raises(kp.ShapeError, match="T is 3 x 3"):
        node.similarity_transform(np.eye(3))
    for singular in (np.ones((2, 2)), [[1, "1/3"], [3, 1]]):
        with pytest.raises(kp.DataError, match="T is singular"):
            node.similarity_transform(singular)


def test_time_cannot_run_backwards(node):
    assert type(node.similarity_transform(np.eye(2), timescale=-1)) is ct.StateSpace
