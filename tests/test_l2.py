"""L2 gains, structured gains and stability margins of positive systems."""

from dataclasses import replace
from decimal import Decimal, localcontext
from fractions import Fraction

import control as ct
import numpy as np
import pytest
import scipy.sparse as sp
from gain_systems import CHAIN, EYE, PAIR, PYRAMID, SLANTED, STEPS, random_system

import control_kpos as kp
from control_kpos.errors import ConeMismatchError, DataError, KposError, ShapeError, TooLargeError
from control_kpos.theorems.blocks import Blocks

R1, R2 = kp.orthant(1), kp.orthant(2)
VECTORS = "wudrzxpacys"


def frequency_gains(data, discrete, scaled=lambda G: G):
    """Largest singular values over frequencies, the first one at 0."""
    A, B, C, D = (np.array(M) for M in data)
    steps = np.exp(1j * np.linspace(0, np.pi, 60)) if discrete else 1j * np.append(0, np.logspace(-3, 3, 60))
    return np.array([np.linalg.norm(scaled(D + C @ np.linalg.solve(z * np.eye(len(A)) - A, B)), 2) for z in steps])


def is_stable(A, discrete):
    values = np.linalg.eigvals(A)
    return bool((np.abs(values) < 1).all() if discrete else (values.real < 0).all())


def closed(data, delta):
    """The state matrix of the loop with u = delta y, or None if it is not well posed."""
    A, B, C, D = data
    inner = np.eye(len(delta)) - delta @ D
    if np.linalg.cond(inner) > 1e12:
        return None
    return A + B @ np.linalg.solve(inner, delta @ C)


def random_blocks(rng, m):
    cuts = np.sort(rng.choice(np.arange(1, m), rng.integers(0, m), replace=False))
    return [int(size) for size in np.diff([0, *cuts, m])]


def block_norms(delta, blocks):
    return np.array(
        [np.linalg.norm(delta[np.ix_(blocks.inputs == b, blocks.outputs == b)], 2) for b in range(blocks.count)]
    )


# -- the L2 gain


def test_the_gain_is_the_nearest_double():
    with localcontext() as context:
        context.prec = 60
        assert PAIR.gain(norm="L2") == float((5 + Decimal(5).sqrt()) / 10)
    third = kp.ConeStateSpace([["-1/3"]], [["1/7"]], [[1]], 0)
    assert third.gain(norm="L2") == float(Fraction(3, 7))
    assert kp.induced_gain([[-2]], [[1]], [[1]], [[0]], R1, R1, R1, norm="L2") == 0.5
    assert kp.ConeStateSpace([[-1]], [[0]], [[1]], 0).gain("L2") == 0
    assert kp.ConeStateSpace([[1]], [[1]], [[1]], 0).gain("L2") == np.inf


@pytest.mark.parametrize("seed", range(20))
def test_half_way_between_doubles_decides(seed):
    """sigma^2 lies between the squares of the middles between the gain and its neighbours: of G'G in integers."""
    rng = np.random.default_rng(seed)
    G = rng.integers(0, 50, (rng.integers(1, 4), 2))
    gain = kp.ConeStateSpace(-np.eye(2), EYE, G, 0).gain("L2")
    assert gain == pytest.approx(np.linalg.norm(G, 2), rel=1e-12)
    (a, b), (_, c) = (G.T @ G).tolist()
    for neighbour, side in ((-np.inf, -1), (np.inf, 1)):
        t = ((Fraction(gain) + Fraction(float(np.nextafter(gain, neighbour)))) / 2) ** 2
        inside = t > max(a, c) and (t - a) * (t - c) > b * b  # t is above both eigenvalues
        assert inside == (side > 0)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("discrete", [False, True])
def test_no_frequency_has_a_larger_gain(seed, discrete):
    data, G = random_system(np.random.default_rng(seed), discrete)
    s = kp.ConeStateSpace(*data, discrete)
    cert, gains = kp.structured_gain(s), frequency_gains(data, discrete)
    assert cert and cert.check()
    assert cert.lower <= gains[0] * (1 + 1e-9) and (gains <= cert.upper * (1 + 1e-9) + 1e-15).all()
    assert cert.lower * (1 - 1e-9) <= s.gain("L2") <= cert.upper * (1 + 1e-9)
    assert s.gain("L2") == pytest.approx(np.linalg.norm(G, 2), rel=1e-9, abs=1e-15)
    assert cert.upper - cert.lower <= 1e-9 * cert.upper + 1e-15


def test_above_thirty_states_the_gain_is_computed_and_the_bounds_are_proven():
    n = 60
    A = np.eye(n, k=-1) + np.eye(n, k=1) - 2.5 * np.eye(n)
    s = kp.ConeStateSpace(A, np.eye(n), np.eye(n), 0)
    cert = kp.structured_gain(s)
    assert cert and cert.lower <= s.gain("L2") * (1 + 1e-12) and s.gain("L2") <= cert.upper * (1 + 1e-12)
    assert cert.upper <= cert.lower * (1 + 1e-9)


def test_states_may_lie_in_any_cone():
    cert = kp.structured_gain(SLANTED)
    assert cert and cert.check() and cert.lower <= 3 <= cert.upper <= cert.lower * (1 + 1e-9)
    assert SLANTED.gain("L2") == 3


def test_what_is_typed_is_what_is_proven():
    """The gain 1/(1 - 2/3) = 3 of a decimal system: its double is off by 2^-53, its bounds are not."""
    cert = kp.structured_gain(kp.ConeStateSpace([["2/3"]], [[1]], [[1]], 0, True))
    assert cert and Fraction(cert.lower) <= 3 <= Fraction(cert.upper) and cert.check()


# -- other cones


def test_other_output_cones_have_larger_gains_elsewhere():
    """Y = cone{(1,0), (-1,1)}: the DC gain is 1, and the gain 1.264 at another frequency."""
    A, B, C = np.diag([-1.0, -10.0]), [[1.0], [10.0]], [[1.0, -1.0], [0.0, 1.0]]
    X = kp.PolyhedralCone([[1, 0], [0, 1]])
    Y = kp.PolyhedralCone([[1, 0], [-1, 1]])
    s = kp.ConeStateSpace(A, B, C, 0, X=X, Y=Y)
    assert s.is_cone_positive() and np.linalg.norm(s.dcgain()) == pytest.approx(1)
    gains = frequency_gains((A, B, C, np.zeros((2, 1))), False)
    assert gains[0] == pytest.approx(1) and gains.max() == pytest.approx(1.264, abs=2e-3)
    for ask in (kp.structured_gain, lambda s: s.gain("L2"), lambda s: kp.robust_margin(s, "full")):
        with pytest.raises(ConeMismatchError, match="Y is no nonnegative orthant"):
            ask(s)


@pytest.mark.parametrize("rays", [[[-1]], [[1, 0], [1, 1]], [[0, 1], [-1, 0]]])
def test_other_input_cones_are_refused(rays):
    m = len(rays)
    s = kp.ConeStateSpace(-np.eye(m), np.eye(m), np.eye(m), 0, X=rays, U=rays, Y=kp.orthant(m))
    with pytest.raises(ConeMismatchError, match="U is no nonnegative orthant"):
        kp.structured_gain(s)


def test_an_orthant_may_be_given_by_its_rays():
    s = kp.ConeStateSpace([[-2, 1], [1, -3]], EYE, EYE, 0, U=[[0, 3], ["1/3", 0]], Y=[[2, 0], [0, 5]])
    assert kp.structured_gain(s).upper == pytest.approx(PAIR.gain("L2"))


# -- blocks


@pytest.mark.parametrize("seed", range(25))
@pytest.mark.parametrize("discrete", [False, True])
def test_the_bracket_of_blocks(seed, discrete):
    rng = np.random.default_rng([seed, discrete])
    data, G = random_system(rng, discrete)
    sizes = random_blocks(rng, len(G))
    blocks = Blocks.read(sizes, *G.shape[::-1])
    cert = kp.structured_gain(kp.ConeStateSpace(*data, discrete), sizes)
    assert cert and cert.check()
    assert cert.upper - cert.lower <= 1e-4 * cert.upper + 1e-5 * G.max() + 1e-12
    if cert.upper:
        d = np.sqrt(cert.d[blocks.outputs])[:, None], np.sqrt(cert.d[blocks.inputs])
        gains = frequency_gains(data, discrete, lambda G: d[0] * G / d[1])
        assert (gains <= cert.upper * (1 + 1e-9) + 1e-15).all()
    assert np.abs(np.linalg.eigvals(G)).max() <= cert.upper * (1 + 1e-6) + 1e-15
    assert cert.lower <= np.linalg.norm(G, 2) * (1 + 1e-12)
    for _ in range(20):  # no Delta of norm 1 has a larger spectral radius
        trial = rng.normal(size=G.shape).T * (blocks.inputs[:, None] == blocks.outputs)
        trial = trial / np.maximum(block_norms(trial, blocks), 1e-300)[blocks.inputs][:, None]
        assert np.abs(np.linalg.eigvals(trial @ G)).max() <= cert.upper * (1 + 1e-9) + 1e-15


@pytest.mark.parametrize("seed", range(12))
def test_a_balanced_system_has_a_tight_bracket(seed):
    rng = np.random.default_rng(seed)
    m = int(rng.integers(2, 7))
    G = rng.random((m, m)) * np.exp(rng.normal(size=(m, 1)) * 3)
    cert = kp.structured_gain(kp.ConeStateSpace(-np.eye(m), np.eye(m), G, 0), random_blocks(rng, m))
    assert cert and 0 < cert.upper - cert.lower <= 1e-9 * cert.upper


def test_blocks_between_the_ends():
    ends = [kp.structured_gain(PAIR, structure) for structure in ("diagonal", [1, 1], [([1], [1]), ([0], [0])])]
    assert len({(c.lower, c.upper) for c in ends[:2]}) == 1 and ends[2].upper == pytest.approx(ends[0].upper, rel=1e-12)
    whole = [kp.structured_gain(PAIR, structure) for structure in ("full", [2], [([0, 1], [1, 0])])]
    assert len({(c.lower, c.upper) for c in whole}) == 1
    wide = kp.ConeStateSpace([[-1]], [[1, 2, 3]], [[1], [1]], 0)
    parts = kp.structured_gain(wide, [([0, 2], [1]), ([1], [0])])
    assert parts and parts.lower <= kp.structured_gain(wide).upper and parts.upper <= parts.lower * (1 + 1e-9)
    assert parts.upper == pytest.approx(2 + np.hypot(1, 3))  # |u_b| = |g_b| y for both, y = sum of g_b'u_b


# -- margins


@pytest.mark.parametrize("seed", range(15))
@pytest.mark.parametrize("discrete", [False, True])
@pytest.mark.parametrize("structure", [None, "full", "sizes"])
def test_the_margin_is_where_loops_become_unstable(seed, discrete, structure):
    rng = np.random.default_rng([seed, 7])
    data, G = random_system(rng, discrete)
    structure = random_blocks(rng, len(G)) if structure == "sizes" else structure
    blocks = Blocks.read(structure, *G.shape[::-1])
    found = kp.robust_margin(kp.ConeStateSpace(*data, discrete), structure)
    assert found and found.check() and 0 < found.lower <= found.upper
    for _ in range(20):
        delta = rng.normal(size=G.shape).T * (blocks.inputs[:, None] == blocks.outputs)
        sizes = np.maximum(block_norms(delta, blocks), 1e-300)
        delta = delta * (min(found.lower, 1e3) * 0.999 / sizes)[blocks.inputs][:, None]
        A = closed(data, delta)
        assert A is not None and is_stable(A, discrete)
    if found.delta is None:
        assert found.upper == np.inf
        return
    assert (found.delta >= 0).all() and (block_norms(found.delta, blocks) <= found.upper * (1 + 1e-9)).all()
    worst = closed(data, found.delta * (1 + 1e-6))
    algebraic = np.abs(np.linalg.eigvals(found.delta @ data[3])).max()
    assert worst is None or not is_stable(worst, discrete) or algebraic > 1 - 1e-9


def test_scaling_and_worst_delta_of_the_example():
    full, loops = kp.robust_margin(PAIR, "full"), kp.robust_margin(PAIR)
    golden = (5 - 5**0.5) / 2
    for found in (full, loops):
        assert found.lower <= golden * (1 + 1e-15) and golden * (1 - 1e-15) <= found.upper <= found.lower * (1 + 1e-9)
        assert (found.delta.shape, found.scaling.shape) == ((2, 2), (found.certificate.n_blocks,))
        assert Fraction(found.lower) * Fraction(found.certificate.upper) <= 1
        assert Fraction(found.upper) * Fraction(found.certificate.lower) >= 1
    assert np.allclose(loops.delta, golden * np.eye(2)) and np.linalg.matrix_rank(full.delta, 1e-9) == 1
    assert "margin at least" in full._repr_html_() and full.explain().startswith("Proved")
    assert "L2 gains below 1.38196; some Delta of gains up to 1.38197 makes" in repr(full)


def test_loops_that_do_not_come_back_have_no_bound():
    """rho(G(0)) = 0: no diagonal Delta does harm."""
    nothing = kp.ConeStateSpace([[-1]], [[1]], [[0]], 0)
    for found in (kp.robust_margin(CHAIN), kp.robust_margin(nothing, "full")):
        assert found and found.lower == found.upper == np.inf and found.delta is None and found.check()
        assert found.certificate.upper == 0 and " is 0: no " in found.explain()
        assert found.message.endswith("whose blocks have finite L2 gains.")


def test_a_system_that_is_not_stable_has_no_margin():
    found = kp.robust_margin(kp.ConeStateSpace([[1, 1], [1, -3]], EYE, EYE, 0))
    assert found.status == "REFUTED" and found.check() and found.lower == found.upper == 0
    assert isinstance(found.witness, kp.InstabilityDirection) and "not exponentially stable" in found.explain()
    with pytest.raises(KposError, match="positive systems only"):
        kp.robust_margin(kp.ConeStateSpace([[-2, -1], [1, -3]], EYE, EYE, 0))


def test_networks_have_margins():
    node = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
    net = kp.feedback_interconnect([node] * 3, 0.5 * np.ones((3, 3)) - 0.5 * np.eye(3))
    G = np.linalg.inv(2 * np.eye(3) - 0.5 * (np.ones((3, 3)) - np.eye(3)))
    assert net.gain("L2") == pytest.approx(np.linalg.norm(G, 2))
    assert kp.robust_margin(net).lower == pytest.approx(1 / np.abs(np.linalg.eigvals(G)).max())


# -- what proves nothing


@pytest.mark.parametrize("name", VECTORS)
@pytest.mark.parametrize("system", [PAIR, STEPS], ids=["continuous", "discrete"])
def test_a_changed_vector_proves_nothing(system, name):
    cert = kp.structured_gain(system, [1, 1])
    for k in range(len(getattr(cert, name))):
        failed = []
        for factor in (0.99, 1.01):
            values = getattr(cert, name).copy()
            values[k] *= factor
            failed.append(not type(cert).settle(**cert.data() | {name: values}))
        assert any(failed), f"{name}[{k}] may be anything"


def test_bounds_beyond_the_gain_prove_nothing():
    cert = kp.structured_gain(PAIR)
    for change in ({"upper": cert.lower}, {"lower": cert.upper}, {"upper": cert.upper * (1 - 1e-9)}, {"w": -cert.w}):
        forged = type(cert).settle(**cert.data() | change)
        assert forged.status == "UNDECIDED" and not replace(cert, **change).check()


@pytest.mark.parametrize(
    "change",
    [
        {"input_blocks": (0,)},
        {"output_blocks": (0, 1)},
        {"input_blocks": (1, 1), "output_blocks": (1, 1)},
        {"upper": 0.0},
        {"lower": -1.0},
        {"upper": np.inf},
        {"lower": 0.0},
        {"a": None},
        {"d": np.ones(2)},
    ],
)
def test_certificates_that_do_not_fit_together(change):
    cert = kp.structured_gain(PAIR)
    assert not replace(cert, **change).check()
    with pytest.raises(DataError):
        type(cert).settle(**cert.data() | change)


def test_a_witness_beside_a_bound_proves_nothing():
    cert = kp.structured_gain(kp.ConeStateSpace([[1, 1], [1, -3]], EYE, EYE, 0))
    assert cert.status == "REFUTED" and np.isnan(cert.upper)
    assert type(cert).settle(**cert.data() | {"upper": 1.0}).status == "UNDECIDED"
    assert type(cert).settle(**cert.data() | {"w": np.ones(2)}).status == "UNDECIDED"


# -- bad input


@pytest.mark.parametrize(
    ("structure", "error", "text"),
    [
        ("blocks", DataError, "structure is 'blocks'"),
        (7, DataError, "structure is 7"),
        ([1, 2], ShapeError, "blocks of 3 signals"),
        ([0, 2], DataError, "structure is 0"),
        ([], ShapeError, "blocks of 0 signals"),
        ([1.0, 1.0], DataError, "structure"),
        ([([0], [0])], DataError, "leaves out input 1"),
        ([([0, 1], [0])], DataError, "leaves out output 1"),
        ([([0], [0]), ([0], [1])], DataError, "input 0 in the blocks 0 and 1"),
        ([([0], [0]), ([1], [2])], DataError, "from 0 to 1"),
        ([([0], [0]), ([1], [])], DataError, "has no outputs"),
        ([([0], [0], [1])], ShapeError, "3 entries"),
    ],
)
def test_structures_that_are_none(structure, error, text):
    for ask in (kp.robust_margin, kp.structured_gain):
        with pytest.raises(error) as told:
            ask(PAIR, structure)
        assert text in str(told.value)


def test_loops_need_as_many_inputs_as_outputs():
    wide = kp.ConeStateSpace([[-1]], [[1, 1]], [[1]], 0)
    for structure in (None, "diagonal", [1]):
        with pytest.raises(ShapeError, match="2 inputs and 1 output"):
            kp.robust_margin(wide, structure)
    assert kp.robust_margin(wide, "full").lower == pytest.approx(2**-0.5)


def test_systems_without_states_have_the_gain_of_D():
    static = ct.ss([], [], [], [[2.0, 1.0], [0.0, 1.0]])
    for sys in (static, kp.ConeStateSpace(static)):
        cert = kp.structured_gain(sys)
        assert cert and cert.upper == pytest.approx(np.linalg.norm(static.D, 2)) and cert.check()
        assert kp.robust_margin(sys).lower == pytest.approx(0.5)
    with pytest.raises(DataError, match="sys is a list"):
        kp.structured_gain([[-1]])


def test_weights_have_no_place_in_an_L2_gain():
    for weight in "ef":
        with pytest.raises(DataError, match=f"{weight} weighs gains for L1 and Linf"):
            PAIR.gain("L2", **{weight: [1, 1]})
    with pytest.raises(DataError, match="L1"):
        PAIR.gain("H2")


def test_what_is_too_large_is_refused():
    n = 5001
    nodes = kp.stack(A=np.full((n, 1, 1), -1.0), B=np.ones((n, 1, 1)), C=np.ones((n, 1, 1)))
    net = kp.feedback_interconnect(nodes, sp.csr_array((n, n)))
    with pytest.raises(TooLargeError, match="5001 states"):
        kp.structured_gain(net, [2] * 2500 + [1])


def test_gains_beyond_the_range_of_doubles():
    with pytest.raises(kp.UndecidedError, match="beyond the range"):
        kp.ConeStateSpace([[-Fraction(1, 10**300)]], [[10**300]], [[1]], 0).gain("L2")
    cert = kp.structured_gain(kp.ConeStateSpace([[-Fraction(1, 10**300)]], [[10**300]], [[1]], 0))
    assert cert.status == "UNDECIDED" and cert.explain().startswith("Undecided")
    assert kp.robust_margin(kp.ConeStateSpace([[-(2.0**-60)]], [[1]], [[1]], 0), "full").upper == pytest.approx(2**-60)
    assert PYRAMID.n_rays == 4


@pytest.mark.parametrize("scale", [1e-300, 1e-200, 1e200, 1e300])
def test_worst_uncertainties_at_any_scale(scale):
    data = [[-1, 0.5], [0.5, -1]], scale * np.eye(2), np.eye(2), 0  # G(0) = scale [[4, 2], [2, 4]] / 3
    system = kp.ConeStateSpace(*data)
    for structure in ("full", "diagonal", [([0], [1]), ([1], [0])]):
        found = kp.robust_margin(system, structure)
        gain = found.delta @ (scale * np.array([[4, 2], [2, 4]]) / 3)
        assert abs(np.abs(np.linalg.eigvals(gain)).max() - 1) < 1e-6, structure
