"""Certificate files by hand about parts that do not belong together, claims that are not theirs, and no feedback."""

from checker_cases import HALF, bound, changed, common, family, feedback, moved, nothing, scalar, surplus, with_nodes
from checker_pieces import PLANE, TOP, WEDGE, any_number, plane


def two_ways(closed):
    """One state that hears itself through the first of two inputs, with supply that pays for the others only."""
    out = with_nodes(scalar("network", W=0), [1, 2, 1])
    out["data"] |= {"B": {"matrix": [[1, 1]]}, "D": nothing(1, 2), "W": {"matrix": [[1], [0]]}}
    out["data"] |= {"r": {"array": [10, 1]}, "q": {"array": [0]}} | ({"own_links_closed": True} if closed else {})
    return out


def refuted(W, **more):
    return any_number(scalar("network", "REFUTED", W=W, **more), W, status="REFUTED")


def loop(X=PLANE, claim="stable", **data):
    """x' = -2 x in the plane, on a cone."""
    out = plane([[-2, 0], [0, -2]], X, claim, **({"v": {"array": [1, 0]}} if claim == "stable" else {}) | data)
    count = len(X["cone"][0][1]["rays"])
    return out | {"proof": {"P": {"matrix": [[-2 * (i == j) for j in range(count)] for i in range(count)]}}}


def vector(X=WEDGE, A=-2, count=1, **data):
    """The common vector (1, 0) of x' = A x on the dual of a cone."""
    out = loop(X, "common vector", v={"array": [1, 0]}, **data)
    P = {"matrix": [[A * (i == j) for j in range(len(out["proof"]["P"]["matrix"]))] for i in range(2)]}
    return changed(out, A={"tuple": [{"matrix": [[A, 0], [0, A]]}] * count}) | {"proof": {"P": [P] * count}}


def beside(*others, loops=None):
    return feedback(*([loop(WEDGE)] if loops is None else loops), others=others)


def wedge_bound(a, b):
    """No gain on the wedge between (a, -b) and (a, b)."""
    out = bound([0], [0])
    return changed(out, X={"cone": [[1, {"rays": [[a, -b], [a, b]]}]]}, F={"matrix": [[0, 0]]})


STEP = scalar("stable", A="1/2", discrete=True)
BOUND = {"radii": {"tuple": [{"array": [[1]]}]}}
SHEAR = {"matrix": [[-2, 1], [0, -2]]}
TURNED = {"matrix": [[-2, 0], [1, -2]]}
HALVED = {"matrix": [[-2, "1/2"], [0, -2]]}
NARROW = {"cone": [[1, {"rays": [[2, 1], [2, -1]]}]]}
WIDE = {"cone": [[1, {"rays": [[1, 2], [1, -2]]}]]}
LINE = scalar("stable")

# A' is in the file of the vector
SHEARED = changed(loop(), A=TURNED, v={"array": [2, 1]}) | {"proof": {"P": None}}
COVERED = (("stable", None), ("positive", None), ("dissipative", None), ("network", 1))

CASES = {
    "a network with its own links closed": (two_ways(True), "PROVED"),
    "the same network with its links": (two_ways(False), "WRONG"),
    "any size, own links closed": (any_number(two_ways(True), 1, ((1,), (0,))), "UNREADABLE"),
    "any size, not for these supplies": (refuted(0, r=0, **moved(0, 1, 0)), "WRONG"),
    "any size, not with any weights": (refuted(2, **surplus(1)), "WRONG"),
    "a vector on the dual cone": (beside(vector()), "PROVED"),
    "a vector on the dual of a cone of three": (beside(vector(), loops=[loop(TOP)]), "PROVED"),
    "a vector on a part of the dual cone": (beside(vector(NARROW)), "UNREADABLE"),
    "a vector on more than the dual cone": (beside(vector(WIDE)), "UNREADABLE"),
    "a vector on more than the dual of a cone of three": (beside(vector(WIDE), loops=[loop(TOP)]), "UNREADABLE"),
    "a vector of another matrix": (beside(vector(A=-1000)), "UNREADABLE"),
    "a vector of more matrices": (beside(vector(count=2)), "UNREADABLE"),
    "a vector on another line": (beside(family([-2], "common vector")), "UNREADABLE"),
    "a gain from disturbances": (feedback(LINE, others=[scalar("disturbance gain")]), "PROVED"),
    "a gain from disturbances of another": (feedback(LINE, others=[scalar("disturbance gain", A=-3)]), "UNREADABLE"),
    "ports of another": (feedback(LINE, others=[scalar("positive", A=-3)]), "UNREADABLE"),
    "ports of one of two": (feedback(LINE, scalar("stable", A=-1), others=[scalar("positive", A=-1)]), "PROVED"),
    "another loop": (feedback(LINE, others=[scalar("stable", A=-1)]), "PROVED"),
    "another loop on another cone": (feedback(LINE, others=[loop()]), "WRONG"),
    "loops on two cones": (feedback(loop(), loop(WEDGE)), "WRONG"),
    "loops in two times": (feedback(LINE, STEP), "UNREADABLE"),
    "a loop in discrete time": (feedback(STEP, STEP), "PROVED"),
    "a loop that is positive": (feedback(scalar("positive")), "UNREADABLE"),
    "a feedback as a loop": (feedback(feedback(LINE)), "UNREADABLE"),
    "a feedback beside a loop": (feedback(LINE, others=[feedback(LINE)]), "UNREADABLE"),
    "a bound beside a loop": (feedback(LINE, others=[bound([1], [1])]), "PROVED"),
    "a bound on another cone": (beside(bound([1], [1])), "UNREADABLE"),
    "turned loops": (
        beside(
            changed(vector(PLANE), v={"array": [1, 1]}, A={"tuple": [SHEAR]}) | {"proof": {"P": [None]}},
            loops=[SHEARED],
        ),
        "PROVED",
    ),
    "a vector in the dual cone, loops not turned": (
        beside(
            changed(vector(PLANE), v={"array": [2, 1]}, A={"tuple": [TURNED]}) | {"proof": {"P": [None]}},
            loops=[SHEARED],
        ),
        "PROVED",
    ),
    "loops neither turned nor not": (
        beside(
            changed(vector(PLANE), v={"array": [1, 1]}, A={"tuple": [HALVED]}) | {"proof": {"P": [None]}},
            loops=[SHEARED],
        ),
        "UNREADABLE",
    ),
    "loops not turned, on another cone": (beside(vector(NARROW, -2), loops=[loop(WEDGE)]), "UNREADABLE"),
    **{
        f"bounds that nothing covers, {claim}": (changed(scalar(claim, W=W), **BOUND), "UNREADABLE")
        for claim, W in COVERED
    },
    "bounds that nothing covers, common vector": (changed(common([-2], 0), **BOUND), "UNREADABLE"),
    "own links that are not closed": (changed(scalar("network", W=1), own_links_closed=False), "UNREADABLE"),
    "a bound on the same cone": (beside(wedge_bound(2, 2)), "PROVED"),
    "a bound on a narrower cone": (beside(wedge_bound(2, 1)), "UNREADABLE"),
    "enclosed": (changed(family([-2]), source="enclosed"), "PROVED"),
    "enclosed, but no Jacobian": (changed(scalar("stable"), source="enclosed"), "UNREADABLE"),
    "names that are no text": (changed(scalar("network", W=1), names={"tuple": [1]}), "UNREADABLE"),
    "nodes with names": (changed(scalar("network", W=1), names={"tuple": ["one"]}), "PROVED"),
    "a family of none that says nothing": (changed(family([]), discrete=None, v=None, decay_rate=None), "UNREADABLE"),
    "a link of no network": (scalar("dissipative", W=1), "UNREADABLE"),
}

# -- no feedback, in discrete time unless said


def hopeless(A, B=0, l=1, d=0, rate=0, gain=None, free=((1,),), discrete=True):
    data = {"A": {"tuple": [{"matrix": [[A]]}]}, "B": {"tuple": [{"matrix": [[B]]}]}, "X": HALF, "discrete": discrete}
    data |= {
        "rate": {"double": rate},
        "gain_bound": gain and {"array": [gain]},
        "free": {"array": [list(row) for row in free]},
    }
    combined = {"L": {"tuple": [{"matrix": [[l]]}]}, "G": None, "d": {"matrix": [[d]]}}
    data |= {"coupling": None, "ports": None, "witness": {"record": "Functionals", "fields": combined}}
    return {"claim": "feedback exists", "status": "REFUTED", "data": data, "proof": {}}


def rigid(A, B, R=1, pattern=1, discrete=True):
    """Vertices of one state each, and an output."""
    data = {k: {"tuple": [{"matrix": [[x]]} for x in rows]} for k, rows in (("A", A), ("B", B))}
    data |= {"R": {"matrix": [[R]]}, "pattern": {"array": [[pattern]]}, "X": HALF, "discrete": discrete}
    data["witness"] = {"record": "Functionals", "fields": {"L": {"tuple": [{"matrix": [[1]]} for _ in A]}}}
    return {"claim": "invariant gain exists", "status": "REFUTED", "data": data, "proof": {}}


def rigid_plane(*rays):
    """x[k+1] = -x[k] in the plane, on a cone of generators."""
    factor = {"rays": [list(x) for x in rays], "w": [1, 1], "Z": [[1, 0], [0, 1]] + [[0, 0]] * (len(rays) - 2)}
    factor = factor if len(rays) > 2 else {"rays": factor["rays"]}
    data = {"A": {"tuple": [{"matrix": [[-1, 0], [0, -1]]}]}, "B": {"tuple": [{"matrix": [[0], [0]]}]}}
    data |= {"R": {"matrix": [[1, 0]]}, "pattern": {"array": [[1]]}, "X": {"cone": [[1, factor]]}, "discrete": True}
    functionals = {"L": {"tuple": [{"matrix": [[1] * len(rays)] * 2}]}}
    data["witness"] = {"record": "Functionals", "fields": functionals}
    return {"claim": "invariant gain exists", "status": "REFUTED", "data": data, "proof": {}}


PORTS = [{"matrix": [[1]]}, {"matrix": [[0]]}, HALF]
NO_FEEDBACK = {
    "no input": (hopeless(-1), "REFUTED"),
    "ports of four": (changed(hopeless(-1), ports={"tuple": [*PORTS, None]}), "UNREADABLE"),
    "ports without a cone": (changed(hopeless(-1), ports={"tuple": [None, *PORTS[1:]]}), "UNREADABLE"),
    "marked by two": (hopeless(-1, free=((2,),)), "UNREADABLE"),
    "marked by two in the pattern": (rigid([-1], [0], pattern=2), "UNREADABLE"),
    "no input, on the boundary": (hopeless(0), "WRONG"),
    "not in continuous time": (hopeless(-1, discrete=False), "WRONG"),
    "functional outside": (hopeless(1, l=-1), "WRONG"),
    "does not shrink": (hopeless(2, l=0, d=1), "REFUTED"),
    "does not shrink by a little": (hopeless(1, l=0, d=1), "REFUTED"),
    "shrinks": (hopeless("1/2", l=0, d=1), "WRONG"),
    "shrinks, but not at the rate": (hopeless("1/2", l=0, d=1, rate="1/2"), "REFUTED"),
    "weak input": (hopeless(-1, B=1, gain="1/2"), "REFUTED"),
    "input as strong as needed": (hopeless(-1, B=1, gain=1), "WRONG"),
    "input strong enough": (hopeless(-1, B=1, gain=2), "WRONG"),
    "input without bound": (hopeless(-1, B=1), "WRONG"),
    "input not to be used": (hopeless(-1, B=1, free=((0,),)), "REFUTED"),
    "negative gain": (hopeless(-1, B=1, gain=-1), "UNREADABLE"),
    "pattern of another size": (hopeless(-1, free=((1,), (1,))), "UNREADABLE"),
    "no input at all": (changed(hopeless(-1), B={"tuple": [None]}), "UNREADABLE"),
    "nothing to gain": (rigid([-1], [0]), "REFUTED"),
    "nothing to gain in the plane": (rigid_plane((1, 0), (0, 1)), "REFUTED"),
    "nothing to gain, a generator that adds nothing": (rigid_plane((1, 0), (0, 1), (1, 2)), "REFUTED"),
    "nothing to gain, generators of one sum": (rigid_plane((1, 0), (0, 1), (2, 1), (1, 2)), "REFUTED"),
    "nothing to gain, two generators in a line": (rigid_plane((1, 0), (0, 1), (0, 2)), "UNREADABLE"),
    "nothing to gain, two generators in a line, long and short": (
        rigid_plane((1, 0), (0, 1), (2, 4), (1, 2)),
        "UNREADABLE",
    ),
    "nothing to gain on the boundary": (rigid([0], [0]), "WRONG"),
    "a gain that helps": (rigid([-1], [1]), "WRONG"),
    "a gain that helps, negative": (rigid([-1], [1], R=-1), "WRONG"),
    "a gain that may not": (rigid([-1], [1], pattern=0), "REFUTED"),
    "a gain that helps one": (rigid([-1, -1], [1, -1]), "REFUTED"),
    "a gain that helps both": (rigid([-1, -1], [1, 1]), "WRONG"),
}


def confined(A, B=1, x=1, w=0, u=None, *, l=0, d=1, up=None, down=None, discrete=False, pattern=1):
    """x' = A x + B F x + w on [0, x]: d (A x + w) and the bound of t |F x|, for `up` and `down` (weight, rest, t)."""
    row = {name: None if a is None else {"matrix": [[a]]} for name, a in (("x_max", x), ("w_max", w), ("u_max", u))}
    data = {"A": {"tuple": [{"matrix": [[A]]}]}, "B": {"tuple": [{"matrix": [[B]]}]}, "X": HALF, "discrete": discrete}
    fields = {"L": {"tuple": [{"matrix": [[l]]}]}, "d": {"matrix": [[d]]}}
    if up is not None:
        named = (("up", up), ("down", down or (0, 0, 0)))
        fields |= {
            f"{name}{end}": {"matrix": [[a]]} for name, part in named for end, a in (("", part[0]), ("_rest", part[1]))
        }
        fields |= {"times": {"matrix": [[part[2]] for _, part in named]}}
    witness = {"record": "BoundedFunctionals", "fields": fields}
    data |= row | {"pattern": {"array": [[pattern]]}, "witness": witness}
    return {"claim": "bounded feedback exists", "status": "REFUTED", "data": data, "proof": {}}


NONE = (0, 0, 0)
BOUNDED = {
    "within bounds, no input": (confined(1, 0), "REFUTED"),
    "within bounds, no input, just": (confined(0, 0), "WRONG"),
    "within bounds, pushed": (confined(-1, 0, w=2), "REFUTED"),
    "within bounds, pushed to the end": (confined(-1, 0, w=1), "WRONG"),
    "within bounds, an input": (confined(1), "WRONG"),
    "within bounds, not to be used": (confined(1, pattern=0), "REFUTED"),
    "within bounds, weak": (confined(1, u="1/2", up=NONE, down=(1, 0, 1)), "REFUTED"),
    "within bounds, of the other sign": (confined(1, B=-1, u="1/2", up=(1, 0, 1)), "REFUTED"),
    "within bounds, as strong as needed": (confined(1, u=1, up=NONE, down=(1, 0, 1)), "WRONG"),
    "within bounds, both signs": (confined(1, u="1/4", up=(1, 0, 1), down=(2, 0, 2)), "REFUTED"),
    "within bounds, both signs, as strong": (confined(1, u="1/3", up=(1, 0, 1), down=(2, 0, 2)), "WRONG"),
    "within bounds, the wrong sign": (confined(1, u="1/2", up=(1, 0, 1)), "WRONG"),
    "within bounds, part of the interval": (confined(1, u="1/4", up=NONE, down=(1, 1, 2)), "REFUTED"),
    "within bounds, beyond the interval": (confined(1, u="1/2", up=NONE, down=(1, 0, 0)), "WRONG"),
    "within bounds, a negative rest": (confined(1, u="1/2", up=NONE, down=(1, -1, 0)), "WRONG"),
    "within bounds, negative weights": (confined(1, B=-1, u="1/2", up=NONE, down=(-1, 1, 0)), "WRONG"),
    "within bounds, times below 0": (confined(1, 0, u=1, x=-1, w=3, up=(0, 1, -1), down=NONE), "WRONG"),
    "within bounds, a longer interval": (confined(1, x=2, u=1, up=NONE, down=(2, 0, 1)), "REFUTED"),
    "within bounds, no bound": (confined(1, up=NONE, down=(1, 0, 1)), "WRONG"),
    "within bounds, weights of no input": (confined(1, 0, up=NONE), "UNREADABLE"),
    "within bounds, no weights": (confined(1, u="1/2"), "UNREADABLE"),
    "within bounds, functional outside": (confined(-1, 0, d=-1), "WRONG"),
    "within bounds, discrete": (confined(2, 0, discrete=True), "REFUTED"),
    "within bounds, discrete, just": (confined(1, 0, discrete=True), "WRONG"),
    "within bounds, not positive": (confined(-1, 0, l=1, d=0, discrete=True), "REFUTED"),
    "within bounds, not positive, an input": (confined(-1, 1, l=1, d=0, discrete=True), "WRONG"),
    "within bounds, not positive, weak": (
        confined(-1, l=1, d=0, discrete=True, u="1/2", up=(1, 0, 1)),
        "REFUTED",
    ),
    "within bounds, in both ways": (confined("1/2", l=1, d=1, w=2, discrete=True), "REFUTED"),
}
CASES |= NO_FEEDBACK | BOUNDED
