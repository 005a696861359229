"""More files by hand, in one to three dimensions: cones, bounds on Jacobians, no cone, any size."""

from fractions import Fraction

from checker_cases import (
    changed,
    circle,
    double,
    family,
    flow,
    jacobian,
    moved,
    nothing,
    scalar,
    surplus,
    with_nodes,
)

PLANE = {"cone": [[1, {"rays": [[1, 0], [0, 1]]}]]}
WEDGE = {"cone": [[1, {"rays": [[1, 1], [1, -1]]}]]}
TOP = {"cone": [[1, {"rays": [[1, 1], [1, -1], [1, 0]], "w": [1, 0], "Z": [["1/2", "1/2"], ["1/2", "-1/2"], [0, 0]]}]]}
WHOLE_LINE = {"cone": [[1, {"rays": [[1], [-1]], "w": [0], "Z": [[1], [0]]}]]}


def plane(A, X=PLANE, claim="stable", **data):
    """A system of two states without ports; the weights are given unless X is the orthant."""
    alone = dict.fromkeys("BCDUY") | {"discrete": False, "A": {"matrix": A}, "X": X}
    alone |= {"decay_rate": {"double": 0}} if claim == "stable" else {}
    return {"claim": claim, "status": "PROVED", "data": alone | data, "proof": {}}


def slow(z, bound, decay=2, **more):
    out = scalar("stable", decay=decay, **more)
    return changed(out, slow_direction={"array": [z]}, decay_rate_bound={"double": double(bound)})


def slow_in(X, z, P, **proof):
    more = {"slow_direction": {"array": z}, "decay_rate_bound": {"double": 2}, "v": {"array": [1, 0]}}
    out = plane([[-2, 0], [0, -2]], X, **more)
    return {**out, "proof": {"P": {"matrix": P}, **proof}}


def exactly(v, exact):
    return changed(scalar("stable"), v={"array": [v]}, v_exact={"fractions": [exact]})


def bounded(A, radius, **more):
    """A family of one Jacobian with bounds on its entries."""
    return changed(family([A], **more), radii={"tuple": [{"array": [[radius]]}]})


def bounded_plane(radius):
    """Two states that move each other, with a bound on the effect of the first on the second."""
    out = plane([[-1, 1], [1, -1]], claim="differentially-positive")
    family = {"tuple": [out["data"]["A"]]}, {"tuple": [{"array": [[0, 0], [radius, 0]]}]}
    return {**changed(out, A=family[0], radii=family[1], v=None), "proof": {"P": [None]}}


def leaves(A, radius, point=0, centre=None):
    """Jacobians around A at a point, or one of a family."""
    witness = jacobian(A if centre is None else centre, radius, point)
    out = family([A], discrete=True, status="REFUTED", witness=witness)
    return out if point is None else changed(out, radii={"tuple": [{"array": [[radius]]}]})


def bracket(lower, upper, rate=None, **more):
    rate = lower if rate is None else rate
    out = scalar("network abscissa", W=1, **more)
    below = flow(1, 1, 1, rate)["witness"]
    return changed(out, lower={"double": double(lower)}, upper={"double": double(upper)}, below=below)


def static_node(sigma):
    """A node without states beside one with a state; sigma is the weight of the first."""
    out = with_nodes(scalar("network", W=0), [1, 1, 1], [0, 1, 1])
    out["data"] |= {"B": {"matrix": [[1, 0]]}, "C": {"matrix": [[1], [0]]}, "D": nothing(2, 2), "W": nothing(2, 2)}
    out["data"] |= {"sigma": {"array": [1, sigma]}}
    return changed(out, v={"array": [1]}, q={"array": [-1, -1]}, r={"array": [1, 1]})


def two_outputs(q, y):
    out = with_nodes(scalar("network", "REFUTED", W=0, **surplus(y)), [1, 1, 2])
    out["data"] |= {"C": {"matrix": [[0], [0]]}, "D": {"matrix": [[0], [0]]}, "W": {"matrix": [[0, 0]]}, "v": None}
    return changed(out, q={"array": list(q)}, r={"array": [1]})


# -- no cone


def none(matrices, discrete, proof=None, contains=None, within=None, **fields):
    kinds = {"kind": "Spectral", "cycle": "Perron", "order": "Index", "power": "Port", "terms": "Series"}
    kind = next((kind for name, kind in kinds.items() if name in fields), "Exponential")
    witness = {"record": f"{kind}Obstruction", "fields": fields}
    data = {"witness": witness, "matrices": {"matrix": matrices}, "discrete": discrete}
    data |= {"contains": contains and {"matrix": contains}, "within": within and {"matrix": within}}
    return {"claim": "invariant-cone", "status": "REFUTED", "data": data, "proof": proof or {}}


def ahead(A, z, bound, discrete=False):
    return none([A], discrete, {"z": z}, matrix=0, kind="ahead", bound={"fraction": bound})


def beside(A, bound, discrete=False):
    return none([A], discrete, matrix=0, kind="beside", bound={"fraction": bound})


def cycle(A, shifts, z, bound, discrete=True):
    steps = {"cycle": {"tuple": [0] * len(shifts)}, "shifts": {"fractions": shifts}}
    return none([A], discrete, {"z": z}, **steps, bound={"fraction": bound})


def chains(A, bound="1/2", index=1, order=2, x=None, u=None, discrete=True):
    """Longer Jordan chains on the circle than at the largest real eigenvalue."""
    ones = [list(range(1, len(A) + 1))]
    x, u = {"matrix": [x] if x else ones}, {"matrix": [u] if u else ones}
    fields = {"bound": {"fraction": bound}, "index": index, "order": order, "start": x, "functional": u}
    return none([A], discrete, matrix=0, **fields)


def port(A, b, c, power=1, shift=0, discrete=False):
    shift = None if discrete else {"fraction": shift}
    fields = {"normal": {"matrix": [c]}, "vector": {"matrix": [b]}, "power": power, "shift": shift}
    return none([A], discrete, contains=[b], within=[c], **fields)


def dip(time, terms=20, A=((-1, 0), (0, -2)), b=(1, 1), c=(-1, 2), discrete=False):
    """-e^(-t) + 2 e^(-2t), negative from ln 2 on."""
    fields = {"normal": {"matrix": [list(c)]}, "vector": {"matrix": [list(b)]}}
    fields |= {"time": {"fraction": time}, "terms": terms}
    return none([[list(row) for row in A]], discrete, contains=[list(b)], within=[list(c)], **fields)


def touch(weights, low, high, rates=(-1, -2, -3), c=None, rows=None, discrete=False):
    """sum r_i e^(s_i t), which is 0 between q = low and q = high."""
    n = len(rates)
    rows = rows or [[rates[i] if i == j else 0 for j in range(n)] for i in range(n)]
    c, b = list(c or weights), [1] * len(rows)
    fields = {
        "normal": {"matrix": [c]},
        "vector": {"matrix": [b]},
        "low": {"fraction": low},
        "high": {"fraction": high},
    }
    fields |= {"rates": {"fractions": list(rates)}, "weights": {"fractions": list(weights)}}
    return none([rows], discrete, contains=[b], within=[c], **fields)


HALVES = "0.4999997", "0.5000003"
QUARTER = [[0, 1], [-1, 0]]
FLIPPED = [[1, 0, 0], [0, -1, 1], [0, 0, -1]]  # 1, and -1 in a chain of two
BOTH = [[1, 1, 0, 0], [0, 1, 0, 0], [0, 0, -1, 1], [0, 0, 0, -1]]  # both in chains of two
THREE = [[1, 1, 0, 0, 0], [0, 1, 0, 0, 0], [0, 0, -1, 1, 0], [0, 0, 0, -1, 1], [0, 0, 0, 0, -1]]
INNER = [["1/2", 0, 0], [0, -1, 0], [0, 0, 1]]  # no chains
SHORTER = [[1, 0, 0], [0, "-3/4", 1], [0, 0, "-3/4"]]
TURNING = [[1, 0, 0, 0, 0], [0, 0, -1, 1, 0], [0, 1, 0, 0, 1], [0, 0, 0, 0, -1], [0, 0, 0, 1, 0]]  # 1, i, -i: two each
THIRD = [[0, 1], [-1, -1]]
ANGLE = [[3, -4], [4, 3]]  # 5 times a rotation by an angle that is no part of a turn
MINUS_TWO = [[-2, 0], [0, -2]]
CUBIC = [[0, 1, 0], [0, 0, 1], [-12, -4, -3]]  # roots 2i, -2i, -3
TURNED = [[0, 1, 0], [0, 0, 1], [-1, -1, -1]]  # roots i, -i, -1
DOUBLE = [["1/2", 0, 0, 0], [0, "1/2", 0, 0], [0, 0, 1, 0], [0, 0, 0, -2]]
PAIR = [[1, 0, 0], [0, 3, -4], [0, 4, 3]]
PAIRED = [[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 3, -4], [0, 0, 4, 3]]
APART = [[-1, 0], [0, -2]]
NEAR = ["1/10", "19/10"]  # a point near the root 2i of CUBIC; 3 |p| / |p'| there is between these two:
REACH = ["0.4302027", "0.4302028"]


def power(k):
    """A^k of ANGLE, with its eigenvalue divided by the largest entry."""
    re, im = 1, 0
    for _ in range(k):
        re, im = 3 * re - 4 * im, 4 * re + 3 * im
    unit = max(abs(re), abs(im))
    return cycle(ANGLE, [k], [str(Fraction(re, unit)), str(Fraction(im, unit)), 0], "1/2")


NO_CONE = {
    "root ahead": (ahead(QUARTER, [0, 1, 0], "-1/2"), "REFUTED"),
    "root not ahead": (ahead(QUARTER, [0, 1, 0], 0), "WRONG"),
    "no root there": (ahead(QUARTER, [0, 2, 0], "-1/2"), "WRONG"),
    "disc ahead": (ahead(QUARTER, ["1/10", 1, "1/5"], "-1/5"), "REFUTED"),
    "disc not ahead": (ahead(QUARTER, ["1/10", 1, "1/5"], "-1/20"), "WRONG"),
    "disc touches the bound": (ahead(QUARTER, ["1/10", 1, "1/5"], "-1/10"), "WRONG"),
    "disc large enough": (ahead(CUBIC, [*NEAR, REACH[1]], -2), "REFUTED"),
    "disc too small": (ahead(CUBIC, [*NEAR, REACH[0]], -2), "WRONG"),
    "disc on the other side": (ahead(CUBIC, [NEAR[0], "-19/10", REACH[1]], -2), "REFUTED"),
    "disc exactly large enough": (ahead(MINUS_TWO, [-3, 0, 1], 1, True), "REFUTED"),
    "disc half as large": (ahead(MINUS_TWO, [-3, 0, "1/2"], 1, True), "WRONG"),
    "disc of negative radius": (ahead(MINUS_TWO, [-3, 0, -1], 1, True), "WRONG"),
    "disc touches the circle": (ahead(MINUS_TWO, [-3, 0, 1], 2, True), "WRONG"),
    "imaginary root, discrete": (ahead([[0, 2], [-2, 0]], [0, 2, 0], 1, True), "REFUTED"),
    "bound zero, discrete": (ahead(QUARTER, [0, 1, 0], 0, True), "WRONG"),
    "real root above the bound": (ahead([[1, 0], [0, -2]], [-2, 0, 0], "1/2", True), "WRONG"),
    "real root at the bound": (ahead([[1, 0], [0, -2]], [-2, 0, 0], 1, True), "REFUTED"),
    "real root above a double one": (ahead(DOUBLE, [-2, 0, 0], "1/2", True), "WRONG"),
    "double real root at the bound": (ahead(DOUBLE, [-2, 0, 0], 1, True), "REFUTED"),
    "real root behind a pair": (ahead(PAIR, [3, 4, 0], 0), "WRONG"),
    "real root behind a pair, not above": (ahead(PAIR, [3, 4, 0], 1), "REFUTED"),
    "real roots behind a pair": (ahead(PAIRED, [3, 4, 0], "1/2"), "WRONG"),
    "root beside": (beside(QUARTER, 0), "REFUTED"),
    "root beside, three states": (beside(TURNED, 0), "REFUTED"),
    "no root beside": (beside(QUARTER, 1), "WRONG"),
    "only a real root": (beside(APART, -1), "WRONG"),
    "root on the circle": (beside(ANGLE, 5, True), "REFUTED"),
    "root outside the circle": (beside(ANGLE, 4, True), "WRONG"),
    "quarter of a turn": (beside(QUARTER, 1, True), "WRONG"),
    "third of a turn": (beside(THIRD, 1, True), "WRONG"),
    "half a turn": (beside([[-1]], 1, True), "WRONG"),
    "cycle": (cycle(QUARTER, [1], [0, 1, 0], "1/2"), "REFUTED"),
    "cycle of two": (cycle(ANGLE, [1, 1], ["-7/24", 1, 0], "1/2"), "REFUTED"),
    "cycle of resolvents": (cycle(QUARTER, [1], [1, 1, 0], "1/2", False), "REFUTED"),
    "power 24": (power(24), "REFUTED"),
    "power 25": (power(25), "WRONG"),
    "half a power": (cycle(QUARTER, ["3/2"], [0, 1, 0], "1/2"), "WRONG"),
    "power 0": (cycle(QUARTER, [0], [0, 1, 0], 1), "WRONG"),
    "longer chains": (chains(FLIPPED), "REFUTED"),
    "longer chains, in continuous time": (chains(FLIPPED, discrete=False), "WRONG"),
    "longer chains, third power": (chains(FLIPPED, order=3), "WRONG"),
    "longer chains, 60th power": (chains(FLIPPED, order=60), "REFUTED"),
    "longer chains, 62nd power": (chains(FLIPPED, order=62), "UNREADABLE"),
    "longer chains than none": (chains(FLIPPED, index=0), "UNREADABLE"),
    "longer chains, no power": (chains(FLIPPED, order=0), "UNREADABLE"),
    "longer chains, bound too large": (chains(FLIPPED, 1), "WRONG"),
    "longer chains, bound zero": (chains(FLIPPED, 0), "REFUTED"),
    "longer chains, bound negative": (chains(FLIPPED, "-1/2"), "WRONG"),
    "longer chains, bound too small": (chains([*[[*row, 0] for row in FLIPPED], [0, 0, 0, "3/4"]]), "WRONG"),
    "longer chains than two": (chains(FLIPPED, index=2), "WRONG"),
    "longer chains than three": (chains(FLIPPED, index=3), "UNREADABLE"),
    "chains of two and three": (chains(THREE, index=2), "REFUTED"),
    "chains of two and three, not one": (chains(THREE, index=1), "WRONG"),
    "chains of three states": (chains(INNER), "WRONG"),
    "chains of one length": (chains(BOTH), "WRONG"),
    "chains of one length, half of it hidden": (chains(BOTH, u=[0, 0, 1, 1]), "WRONG"),
    "chains of one length, all of it": (chains(BOTH, index=2), "WRONG"),
    "longer chains inside": (chains(SHORTER), "WRONG"),
    "longer chains inside, seen": (chains(SHORTER, "7/8"), "WRONG"),
    "longer chains of a pair": (chains(TURNING, order=4), "REFUTED"),
    "longer chains of a pair, second power": (chains(TURNING, order=2), "WRONG"),
    "dip": (dip(1), "REFUTED"),
    "dip, in thirds": (dip(1, A=[["-4/3", "1/3"], ["2/3", "-5/3"]], c=(3, "-5/2"), b=(1, 1)), "WRONG"),
    "dip, not yet": (dip("1/2"), "WRONG"),
    "dip, in discrete time": (dip(1, discrete=True), "WRONG"),
    "dip, before time": (dip(-1, c=(1, -2)), "WRONG"),
    "dip, at once": (dip(0, c=(1, -2)), "WRONG"),
    "dip, too few terms": (dip(1, 3), "WRONG"),
    "dip, a few terms more": (dip(1, 6), "WRONG"),
    "dip, terms enough": (dip(1, 9), "REFUTED"),
    "dip, as many terms as that": (dip(1, 2), "WRONG"),
    "dip, no term": (dip(1, 0), "UNREADABLE"),
    "dip, one term": (dip("2/5", 1, [[-1]], [1], [-1]), "REFUTED"),
    "dip, one term and a bound that is used up": (dip("1/2", 1, [[-1]], [1], [-1]), "WRONG"),
    "dip, one term and too large a bound": (dip("3/5", 1, [[-1]], [1], [-1]), "WRONG"),
    "dip, very many terms": (dip(1, 600, [[-1]], [1], [-1]), "REFUTED"),
    "dip, too many terms": (dip(1, 601, [[-1]], [1], [-1]), "UNREADABLE"),
    "touch": (touch(["1/4", -1, 1], *HALVES), "REFUTED"),
    "touch, in discrete time": (touch(["1/4", -1, 1], *HALVES, discrete=True), "WRONG"),
    "touch, elsewhere": (touch(["1/4", -1, 1], "0.51", "0.5100005"), "WRONG"),
    "touch, no wider": (touch(["1/4", -1, 1], "0.4999995", "0.5000005"), "REFUTED"),
    "touch, a little wider": (touch(["1/4", -1, 1], "0.4999995", "0.5000006"), "WRONG"),
    "touch, up to the root": (touch(["1/4", -1, 1], "0.4999997", "1/2"), "WRONG"),
    "touch, other weights": (touch(["1/4", -1, 1], *HALVES, c=["1/4", -1, 2]), "WRONG"),
    "touch, before time": (touch([1, 1], "-0.0000002", "0.0000003", rates=[-1, -2]), "WRONG"),
    "touch, from the end of time": (touch([-1, 10**7], 0, "0.0000005", rates=[-1, -2]), "WRONG"),
    "touch, late": (touch([-1, 10**7], "0.00000005", "0.0000005", rates=[-1, -2]), "REFUTED"),
    "touch, at once": (touch(["-0.9999999", 1], "0.9999996", 1, rates=[-1, -2]), "REFUTED"),
    "touch, after all time": (touch([-2, 1], "1.9999999", "2.0000002", rates=[-1, -2]), "WRONG"),
    "touch, always": (touch([0, 0, 0], *HALVES), "WRONG"),
    "touch, no eigenvalue": (
        touch(["1/4", -1, 1, 0], *HALVES, [-1, -2, -3, -4], ["1/4", -1, 1], [[-1, 0, 0], [0, -2, 0], [0, 0, -3]]),
        "WRONG",
    ),
    "touch, halves": (touch(["1/4", -1, 1], *HALVES, rates=["-1/2", -1, "-3/2"]), "REFUTED"),
    "touch, steps of two": (touch(["1/4", -1, 1], *HALVES, rates=[-1, -3, -5]), "REFUTED"),
    "touch, far apart": (touch([1, -3, 1], "0.333333", "0.3333336", rates=[0, -1, -80]), "REFUTED"),
    "touch, too far apart": (touch([1, -3, 1], "0.333333", "0.3333336", rates=[0, -1, -81]), "UNREADABLE"),
    "port": (port(APART, [1, 1], [-1, 2], shift="-1/2"), "REFUTED"),
    "port touches": (port(APART, [1, 1], [-1, 2]), "REFUTED"),
    "port inside": (port(APART, [1, 1], [-1, 2], shift=1), "WRONG"),
    "port, second power": (port(APART, [1, 1], [-1, 2], 2), "REFUTED"),
    "port touches at the second power": (port(APART, [1, 4], [-1, 1], 2), "WRONG"),
    "port at power zero": (port(APART, [2, 1], [-1, 1], 0), "WRONG"),
    "port that sees nothing": (port(APART, [0, 1], [1, 0]), "WRONG"),
    "port, shift among the eigenvalues": (port(APART, [1, 1], [-1, 2], shift="-3/2"), "WRONG"),
    "port, shift before the eigenvalues": (port(APART, [1, 1], [-1, 1], shift=-3), "WRONG"),
    "port, shift an eigenvalue": (port(APART, [1, 1], [-1, 2], shift=-1), "WRONG"),
    "port of one state": (port([[-1]], [1], [-1]), "REFUTED"),
    "port of three states": (port(CUBIC, [1, 0, 0], [-1, 0, 0]), "REFUTED"),
    "port, discrete": (port([[2, 0], [0, 1]], [1, 1], [-1, 2], 2, discrete=True), "REFUTED"),
    "port touches, discrete": (port([[2, 0], [0, 1]], [1, 1], [-1, 2], 1, discrete=True), "WRONG"),
    "port with a shift, discrete": (changed(port([[1]], [1], [-1]), discrete=True), "WRONG"),
    "port, power 4000": (port([[1]], [1], [-1], 4000, discrete=True), "REFUTED"),
    "port, power 4001": (port([[1]], [1], [-1], 4001, discrete=True), "WRONG"),
}

# -- any size


def any_number(local, weight, link=((1,),), status="PROVED"):
    data = {
        "local": {"certificate": local},
        "weight": {"fraction": weight},
        "link": {"array": [list(row) for row in link]},
    }
    return {"claim": "out-weight", "status": status, "data": data, "proof": {}}


def looped(**more):
    return scalar("network", W=more.pop("W", 1), **more)


def types(r, B=1):
    """Two nodes side by side, the second with R = r."""
    one, zero = [[1, 0], [0, 1]], {"matrix": [[0, 0], [0, 0]]}
    out = with_nodes(scalar("network", W=0), [1, 1, 1], [1, 1, 1])
    out["data"] |= {"A": {"matrix": [[-3, 0], [0, -3]]}, "C": {"matrix": one}}
    out["data"] |= {"B": {"matrix": [[B, 0], [0, B]]}, "D": zero, "W": zero}
    return changed(out, r={"array": r}, v={"array": [1, 1]}, q={"array": [-1, -1]})


def looping(t):
    """Two nodes with feedthrough 1/2, whose algebraic loops contract."""
    half = {"matrix": [["1/2", 0], [0, "1/2"]]}
    loops = {"tuple": [{"array": [1, 1]}, {"fractions": t}]}
    return changed(types(["0x1.8p+0"] * 2), D=half, W=half, loop_weights=loops)


def two_inputs(link=((0,), (1,)), W=((0,), (1,))):
    out = with_nodes(scalar("network", W=0), [1, 2, 1])
    out["data"] |= {"B": {"matrix": [[1, 1]]}, "D": nothing(1, 2), "W": {"matrix": [list(row) for row in W]}}
    return any_number(changed(out, r={"array": [1, 1]}), 1, link)


GROWS = scalar("network", "REFUTED", A=-1, W=1, **flow(1, 1, 1))
ANY_SIZE = {
    "any size": (any_number(looped(), 1), "PROVED"),
    "any size, refuted": (any_number(GROWS, 1, status="REFUTED"), "REFUTED"),
    "any size although one is not": (any_number(GROWS, 1), "WRONG"),
    "any size of another claim": (any_number(changed(scalar("stable"), W={"matrix": [[1]]}), 1), "UNREADABLE"),
    "another weight": (any_number(looped(), 2), "UNREADABLE"),
    "no weight": (any_number(looped(W=0), 0), "PROVED"),
    "negative weight and link": (any_number(looped(), -1, ((-1,),)), "UNREADABLE"),
    "two inputs": (two_inputs(), "PROVED"),
    "two inputs, the other": (two_inputs(W=((1,), (0,))), "UNREADABLE"),
    "two types": (any_number(types([1, 1]), 0), "PROVED"),
    "two types, different": (any_number(types([1, 2]), 0), "UNREADABLE"),
    "two types, algebraic loops": (any_number(looping([1, 1]), "1/2"), "PROVED"),
    "two types, other algebraic loops": (any_number(looping([1, "3/2"]), "1/2"), "WRONG"),
    "two types that take nothing": (any_number(types([0, 0], B=0), 0), "UNREADABLE"),
}

REST = {
    "facets with a vector": (changed(family([-1], "invariant-cone"), by_facets=True), "UNREADABLE"),
    "facets of one": (changed(family([-1], "invariant-cone", v=None), by_facets=1), "UNREADABLE"),
    "facets": (changed(family([-1], "invariant-cone", v=None), by_facets=True), "PROVED"),
    "another Jacobian": (leaves(-1, 0, point=None, centre=-2), "WRONG"),
    "a Jacobian with bounds": (leaves(-1, 0, point=None), "REFUTED"),
    "number of rows": (changed(scalar("dissipative"), D={"matrix": []}), "UNREADABLE"),
    "zero outside": (changed(scalar("stable"), A={"sparse": [[0, 0, -2], [1, 0, 0]], "shape": [1, 1]}), "UNREADABLE"),
    "row that is no number": (changed(scalar("stable"), A={"sparse": [[False, 0, -2]], "shape": [1, 1]}), "UNREADABLE"),
    "sparse": (changed(scalar("stable"), A={"sparse": [[0, 0, -2]], "shape": [1, 1]}), "PROVED"),
    "not pointed": ({**plane([[-2]], WHOLE_LINE, "positive"), "proof": {"P": {"matrix": [[-2, 0], [0, -2]]}}}, "WRONG"),
    "exact vector": (exactly("0x1.5555555555555p-2", "1/3"), "PROVED"),
    "exact vector of another": (exactly("0x1.5555555555556p-2", "1/3"), "UNREADABLE"),
    "output costs too much": (scalar("dissipative", A=-1), "WRONG"),
    "slow direction": (slow(1, 2), "PROVED"),
    "slow direction, not so slow": (slow(1, "1.999"), "WRONG"),
    "slow direction outside": (slow(-1, 2), "WRONG"),
    "slow direction outside, turned": (slow(-1, 1, decay=0), "WRONG"),
    "slow direction zero": (slow(0, 2), "WRONG"),
    "slow direction, discrete": (slow(1, "1/2", decay=0, A="1/2", discrete=True), "PROVED"),
    "slow direction, discrete, not so slow": (slow(1, "2/5", decay=0, A="1/2", discrete=True), "WRONG"),
    "slow direction in a wedge": (slow_in(WEDGE, [1, 0], [[-2, 0], [0, -2]]), "PROVED"),
    "slow direction on its boundary": (slow_in(WEDGE, [1, 1], [[-2, 0], [0, -2]]), "PROVED"),
    "slow direction, three generators": (
        slow_in(TOP, [1, 0], [[-2, 0, 0], [0, -2, 0], [0, 0, -2]]),
        "PROVED (decay_rate_bound is not covered: its weights are not in the file)",
    ),
    "slow direction with weights": (
        slow_in(
            TOP, [1, 0], [[-2, 0, 0], [0, -2, 0], [0, 0, -2]], ws={"matrix": [[0], [0], [1]]}, wb={"matrix": [[0]] * 3}
        ),
        "PROVED",
    ),
    "gain of less output": (scalar("disturbance gain", q="-1/2"), "UNREADABLE"),
    "bounds": (bounded("-2", 1), "PROVED (given the bounds on the Jacobians)"),
    "bounds as large as the decay": (bounded(-1, 1), "WRONG"),
    "bounds, no vector": (bounded(-1, 2, v=None), "PROVED (given the bounds on the Jacobians)"),
    "bounds, discrete": (bounded("1/2", "1/4", discrete=True), "PROVED (given the bounds on the Jacobians)"),
    "bounds too large, discrete": (bounded("1/2", "1/2", discrete=True), "WRONG"),
    "bounds beyond the cone, discrete": (bounded("1/2", 1, discrete=True, v=None), "WRONG"),
    "bounds at the cone": (bounded_plane(1), "PROVED (given the bounds on the Jacobians)"),
    "bounds beyond the cone": (bounded_plane(2), "WRONG"),
    "leaves within bounds": (leaves(-1, "1/2"), "REFUTED (given the bounds on the Jacobian at a point)"),
    "may stay within bounds": (leaves(-1, 1), "WRONG"),
    "node without states": (static_node(1), "PROVED"),
    "vectors of nodes that are ragged": (changed(static_node(1), q={"array": [[-1, -1], []]}), "UNREADABLE"),
    "node without weight": (static_node(0), "UNREADABLE"),
    "second output in excess": (two_outputs([-5, 1], [0, 1]), "REFUTED"),
    "second output in need": (two_outputs([1, -5], [0, 1]), "WRONG"),
    "input of the loop too large": (scalar("network", "REFUTED", D=2, W="1/4", **circle("1/2", 1)), "WRONG"),
    "bracket": (bracket(-1, -1), "PROVED"),
    "bracket too low": (bracket(-1, "-1.001"), "WRONG"),
    "bracket too high": (bracket("-0.999", 0), "WRONG"),
    "bracket of another motion": (bracket(-2, -1, -1), "UNREADABLE"),
    "bracket without storage": (bracket(-1, -100, v=0, q=0, r=0), "WRONG"),
    "motion without a direction": (scalar("network", "REFUTED", A=-1, W=0, **moved(0, 0, 0)), "WRONG"),
}

CASES = NO_CONE | ANY_SIZE | REST
