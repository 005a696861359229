"""Tiny certificate files by hand about interval observers, true and just not true."""

from checker_cases import changed, double, scalar, with_nodes

NAMES = ("w_lo", "w_hi", "noise", "upper", "lower", "v", "spread", "width")


def matrix(rows):
    return {"matrix": [list(row) if isinstance(row, (list, tuple)) else [row] for row in rows]}


def observer(ends, *, A=-2, gains=(3, 2, "-7/4", "1/4"), covers=1, discrete=False, ray=1, **more):
    """z' = A z + ... on a half-line, for a plant, an output, L and N."""
    data = dict(zip(("plant", "output", "gain", "shift"), (matrix([x]) for x in gains), strict=True))
    data |= {name: {"array": [double(x)]} for name, x in zip(NAMES, ends, strict=True)}
    data |= {"A": matrix([A]), "X": {"cone": [[1, {"rays": [[ray]]}]]}, "discrete": discrete, "witness": None}
    data["covers"] = covers if isinstance(covers, dict) else matrix([covers])
    return {"claim": "interval observer", "status": "PROVED", "data": data | more, "proof": {}}


def ends(upper="13/8", lower="-9/8", spread="11/8", width="13/8", *, v=1, w=(-1, 2), noise="1/2"):
    """T w - K n between these, for T = 1/2, K = 5/4."""
    return (*w, noise, upper, lower, v, spread, width)


def integrator(width=("1/2", 3), upper=(0, 2), **more):
    """The double integrator with N = (1, 2), L = (-1, 0): T = [[0, 0], [-2, 1]], K = (0, -4)."""
    vectors = ((0, -1), (0, 1), ("1/4",), upper, (0, -2), (1, 1), (0, 2), width)
    data = {name: {"array": [double(x) for x in vector]} for name, vector in zip(NAMES, vectors, strict=True)}
    data |= {"A": matrix([[-1, 0], [0, -2]]), "plant": matrix([[0, 1], [0, 0]]), "output": matrix([[1, 0]])}
    data |= {"gain": matrix([-1, 0]), "shift": matrix([1, 2]), "covers": matrix([[1, 0], [0, 1]])}
    data |= {"X": {"cone": [[2, {"rays": [[1]]}]]}, "discrete": False, "witness": None}
    return {"claim": "interval observer", "status": "PROVED", "data": data | more, "proof": {}}


NEGATIVE_K = ends("7/4", "-5/4", "3/2", "7/4"), (-8, 2, 1, "1/4")
NEGATIVE_T = ends("9/4", "-13/4", "11/4", "15/4"), (3, 2, "1/2", 1)
NEGATIVE_N = ends("39/8", "-27/8", "33/8", "35/8"), (3, 2, "-13/4", "-1/4")
DOWN = ends("-9/8", "13/8", "-11/8", "13/8", v=-1)


def steps(upper="21/16", lower="-13/16", spread="17/4", width="9/2"):
    """F = 1/2: T = 1/2, K = 5/8."""
    return observer(ends(upper, lower, spread, width), A="1/2", gains=(3, 2, "-1/2", "1/4"), discrete=True)


LOCAL = ("w_lo", "w_hi", "noise", "upper", "lower", "x_max", "u_max", "y_max", "width")


def local(values, *, gain=-3, A=1, W=1, covers=1, ray=1, **node):
    """x' = A x + u + w on a half-line with u = W y and y = x + n, seen by a copy with this gain."""
    out = scalar("network observer", A=A, W=W, **{"B": ray, "C": ray} | node)
    data = {name: {"array": [double(x)]} for name, x in zip(LOCAL, values, strict=True)}
    data |= {"gain": matrix([gain]), "covers": matrix([covers])}
    if ray < 0:
        line = {"cone": [[1, {"rays": [[ray]]}]]}
        cones = {"tuple": [{"tuple": [line, out["data"]["U"], out["data"]["Y"]]}]}
        data |= {"X": line, "cones": cones}
    return changed(out, **data)


def bounds(upper="7/2", lower="-5/2", x=6, u=6, y=6, width=6, *, w=(-1, 2), noise="1/2"):
    """For A + gain = -2, on the half-line upwards."""
    return (*w, noise, upper, lower, x, u, y, width)


def couple(gain=((-3, 0), (0, -3)), width=(6, 6)):
    """Two such nodes that feed each other."""
    out, pairs = local(bounds()), zip(LOCAL, bounds(), strict=True)
    square = {name: matrix([[x, 0], [0, x]]) for name, x in {"A": 1, "B": 1, "C": 1, "D": 0, "covers": 1}.items()}
    vectors = {name: {"array": [double(x)] * 2} for name, x in [*pairs, ("v", 1), ("q", -1), ("r", 1)]}
    vectors |= {"width": {"array": [double(x) for x in width]}}
    out = changed(out, **square, **vectors, W=matrix([[0, 1], [1, 0]]), gain=matrix(gain))
    return with_nodes(out, [1, 1, 1], [1, 1, 1])


def stepwise(upper="5/2", x=8, u=2, width=8):
    """A + gain = 1/4, with links of 1/4."""
    values = bounds(upper, "-3/2", x, u, x, width)
    return local(values, A="5/4", gain=-1, W="1/4", q="-1/4", discrete=True)


TURNED = {"gain": 3, "ray": -1, "v": -1}
LOCALLY = {
    "local observer": (local(bounds()), "PROVED"),
    "local observer, upper too small": (local(bounds(upper=3)), "WRONG"),
    "local observer, lower too large": (local(bounds(lower=-2)), "WRONG"),
    "local observer, more than needed": (local(bounds(4, -4, 9, 9, 9, 9)), "PROVED"),
    "local observer, state too small": (local(bounds(x=5)), "WRONG"),
    "local observer, input too small": (local(bounds(u=5)), "WRONG"),
    "local observer, output too small": (local(bounds(y=5)), "WRONG"),
    "local observer, width too small": (local(bounds(width=5)), "WRONG"),
    "local observer, width of a larger cover": (local(bounds(width=18), covers=2), "PROVED"),
    "local observer, width of a larger cover too small": (local(bounds(width=17), covers=2), "WRONG"),
    "local observer, cover too small": (local(bounds(width=9), covers="1/2"), "WRONG"),
    "local observer, gain too weak": (local(bounds(9, -9, 99, 99, 99, 99), gain=-2), "WRONG"),
    "local observer, another gain": (local(bounds(), gain=-4), "WRONG"),
    "local observer, v negative": (local(bounds(), v=-1), "WRONG"),
    "local observer, supply too small": (local(bounds(), r="1/2"), "WRONG"),
    "local observer, link leaves the cone": (local(bounds(9, -9, 9, 0, 9, 9), W=-1), "WRONG"),
    "local observer, negative link": (local(bounds(9, -9, 9, 0, 9, 9), W=-1, q=0, r=0), "WRONG"),
    "local observer, nothing pushes": (local(bounds(2, 2, 0, 0, 0, 0, w=(2, 2), noise=0)), "PROVED"),
    "local observer, nothing pushes, too little width": (
        local(bounds(2, 2, 0, 0, 0, -1, w=(2, 2), noise=0)),
        "WRONG",
    ),
    "local observer, downwards": (local(bounds("-5/2", "7/2", -6), covers=0, **TURNED), "PROVED"),
    "local observer, downwards, upper too small": (
        local(bounds(-2, "7/2", -6), covers=0, **TURNED),
        "WRONG",
    ),
    "local observer, downwards, lower too large": (
        local(bounds("-5/2", 3, -6), covers=0, **TURNED),
        "WRONG",
    ),
    "local observer, downwards, cover too large": (
        local(bounds("-5/2", "7/2", -6), covers="1/2", **TURNED),
        "WRONG",
    ),
    "local observer, bounds exchanged": (local(bounds(9, -9, 9, 9, 9, 9, w=(2, -1))), "UNREADABLE"),
    "local observer, negative noise": (local(bounds(noise="-1/2")), "UNREADABLE"),
    "local observer, feedthrough": (local(bounds(99, -99, 99, 99, 99, 99), D=1, q=-1), "UNREADABLE"),
    "local observer, two widths": (changed(local(bounds()), width={"array": [6, 6]}), "UNREADABLE"),
    "local observer, two covers": (changed(local(bounds()), covers=matrix([1, 1])), "UNREADABLE"),
    "local observer, in steps": (stepwise(), "PROVED"),
    "local observer, in steps, too small": (stepwise(x=7), "WRONG"),
    "local observer, in steps, upper too small": (stepwise(upper=2), "WRONG"),
    "local observer, couple": (couple(), "PROVED"),
    "local observer, couple, second width too small": (couple(width=(6, 5)), "WRONG"),
    "local observer, couple, gain of the neighbour": (couple(gain=((-3, 1), (0, -3))), "UNREADABLE"),
    "local observer, as a refutation": (changed(local(bounds())) | {"status": "REFUTED"}, "WRONG"),
}
CASES = LOCALLY | {
    "observer": (observer(ends()), "PROVED"),
    "observer, upper too small": (observer(ends(upper="3/2")), "WRONG"),
    "observer, lower too large": (observer(ends(lower=-1)), "WRONG"),
    "observer, more than needed": (observer(ends(2, -2, 2, "9/4")), "PROVED"),
    "observer, spread too small": (observer(ends(spread="5/4")), "WRONG"),
    "observer, width too small": (observer(ends(width="3/2")), "WRONG"),
    "observer, width of a larger cover": (observer(ends(width="35/8"), covers=2), "PROVED"),
    "observer, width of a larger cover too small": (observer(ends(width=4), covers=2), "WRONG"),
    "observer, cover too small": (observer(ends(width=9), covers="1/2"), "WRONG"),
    "observer, another A": (observer(ends(3, -3, 3, 9), A=-3), "WRONG"),
    "observer, another gain": (observer(ends(3, -3, 3, 9), gains=(3, 2, -2, "1/4")), "WRONG"),
    "observer, another shift": (observer(ends(9, -9, 9, 90), gains=(3, 2, "-7/4", "1/2")), "WRONG"),
    "observer, not stable": (
        observer(ends(9, -9, 0, 99), A="1/2", gains=(3, 2, "-1/2", "1/4")),
        "WRONG",
    ),
    "observer, v negative": (observer(ends(v=-1)), "WRONG"),
    "observer, negative K": (observer(NEGATIVE_K[0], gains=NEGATIVE_K[1]), "PROVED"),
    "observer, negative K, upper too small": (
        observer(ends("1/4", "-5/4", "3/2", 2), gains=NEGATIVE_K[1]),
        "WRONG",
    ),
    "observer, negative T": (observer(NEGATIVE_T[0], gains=NEGATIVE_T[1]), "PROVED"),
    "observer, negative T, upper too small": (
        observer(ends(2, "-13/4", "11/4", "15/4"), gains=NEGATIVE_T[1]),
        "WRONG",
    ),
    "observer, negative N": (observer(NEGATIVE_N[0], gains=NEGATIVE_N[1]), "PROVED"),
    "observer, negative N, width too small": (
        observer(ends("39/8", "-27/8", "33/8", 4), gains=NEGATIVE_N[1]),
        "WRONG",
    ),
    "observer, downwards": (observer(DOWN, covers=0, ray=-1), "PROVED"),
    "observer, downwards, cover too large": (
        observer(ends("-9/8", "13/8", "-11/8", 9, v=-1), covers="1/2", ray=-1),
        "WRONG",
    ),
    "observer, nothing pushes": (
        observer(ends(1, 1, 0, 0, w=(2, 2), noise=0)),
        "PROVED",
    ),
    "observer, bounds exchanged": (observer(ends(9, -9, 9, 99, w=(2, -1))), "UNREADABLE"),
    "observer, negative noise": (observer(ends(noise="-1/2")), "UNREADABLE"),
    "observer, two widths": (observer(ends(), width={"array": [2, 2]}), "UNREADABLE"),
    "observer, two covers": (observer(ends(), covers=matrix([1, 1])), "UNREADABLE"),
    "observer, no cover": (observer(ends(), covers={"matrix": []}), "UNREADABLE"),
    "observer, two disturbances": (observer(ends(), w_hi={"array": [2, 2]}), "UNREADABLE"),
    "observer, two disturbances on both sides": (
        observer(ends(), w_lo={"array": [-1, -1]}, w_hi={"array": [2, 2]}),
        "UNREADABLE",
    ),
    "observer, in steps": (steps(), "PROVED"),
    "observer, in steps, spread too small": (steps(spread=4), "WRONG"),
    "observer, in steps, upper too small": (steps(upper="5/4"), "WRONG"),
    "observer, double integrator": (integrator(), "PROVED"),
    "observer, double integrator, width too small": (integrator(width=("1/2", "5/2")), "WRONG"),
    "observer, double integrator, no noise in the width": (integrator(width=("1/4", 3)), "WRONG"),
    "observer, double integrator, upper too small": (integrator(upper=(0, 1)), "WRONG"),
    "observer, double integrator, as a refutation": (changed(integrator()) | {"status": "REFUTED"}, "WRONG"),
}
