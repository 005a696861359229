"""Tiny certificate files by hand about interval observers, true and just not true."""

from checker_cases import changed, double

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


CASES = {
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
