"""Tiny certificate files by hand about plants that agree with measurements, true and just not true."""

from checker_cases import HALF, TWICE, changed
from checker_families import CORNERS, WEDGE

EYE = [[1, 0], [0, 1]]
PLANE = {"cone": [[2, {"rays": [[1]]}]]}
# its facets are (0, 1) and (1, -1)
TILTED = {"cone": [[1, {"rays": [[1, 0], [1, 1]]}]]}


def table(rows):
    return {"matrix": [list(row) for row in rows]}


def measured(X1, noise, l=((1,),), plant=None, *, X0=((1,),), X=HALF, e=None, discrete=True, **more):
    """x+ = a x, |X1 - a X0| <= noise, a proof that a x >= 0 (and with e that a e < e)."""
    data = {"X0": table(X0), "X1": table(X1), "noise": table(noise), "X": X, "discrete": discrete, "e": None}
    data |= {"combinations": table(l), "plant": table(X1 if plant is None else plant)}
    data |= {"e": None if e is None else {"array": list(e)}}
    out = {"claim": "from data", "status": "PROVED", "data": data, "proof": {}}
    return changed(out, **{name: x if x is None else table(x) for name, x in more.items()})


def one(a, noise, l=((1,),), plant=None, **more):
    return measured([[a]], [[noise]], l, None if plant is None else [[plant]], **more)


TURNING = {"X1": [[-1, -1], [0, -1]], "noise": [[0, 0]] * 2, "X0": EYE, "X": PLANE, "discrete": False}


def leaving(plant, normal, X1, noise, *, ray=0, **more):
    out = measured(X1, noise, plant=plant, **more)
    fields = {"plant": table(plant), "ray": ray, "normal": {"array": list(normal)}}
    left = {"combinations": None, "plant": None, "witness": {"record": "LeavingPlant", "fields": fields}}
    return changed(out, **left) | {"status": "REFUTED"}


def out_of_half(a, plant, noise, normal=1, **more):
    return leaving([[plant]], [normal], [[a]], [[noise]], **more)


def driven(F=-1, u=1, b="1/4", **more):
    """x+ = a x + b u at (x, u) = (1, 0) and (0, u)."""
    data = {"X0": [[1, 0]], "U0": [[0, u]], "F": [[F]], "plant": [["1/2", b]]}
    return measured([["1/2", "1/4"]], [["1/8", "1/8"]], **{"l": [[1, -1]]} | data | more)


def two_inputs(l=((1, -1, 2),)):
    """x+ = a x + b u + c w at unit vectors, u = -x, w = 2 x: 1 - 1/4 + 2/8, with the noise of four samples."""
    data = {"X0": [[1, 0, 0]], "U0": [[0, 1, 0], [0, 0, 1]], "F": [[-1], [2]], "plant": [[1, "1/4", "1/8"]]}
    return measured([[1, "1/4", "1/8"]], [["1/8"] * 3], l=l, **data)


def tilted(A, noise, *, discrete=True, l=None, e=None):
    """On the cone of (1, 0) and (1, 1), samples at unit vectors: l is the vector itself."""
    x, y = [1, 0], [1, 1]
    # h = (0, 1): row 1 from below; h = (1, -1): row 0 from below, row 1 from above
    rows = [x, x, x, y, y, y] if discrete else [x, y, y]
    at_e = [] if e is None else [e, e, e]
    return measured(A, [[noise] * 2] * 2, rows + at_e if l is None else l, X0=EYE, X=TILTED, discrete=discrete, e=e)


def wedge(A, noise=0, *, discrete=True):
    """On the cone of four generators, samples at unit vectors."""
    eye = [[int(i == j) for j in range(3)] for i in range(3)]
    # rows 0 and 1 from below and above, row 2 from below
    X1 = A if isinstance(A, list) else [[A if x else 0 for x in row] for row in eye]
    rows = [x for x in CORNERS for _ in range(5 if discrete else 3)]
    return measured(X1, [[noise] * 3] * 3, rows, X0=eye, X=WEDGE, discrete=discrete)


def excluding(*plants, L=(1,), d=None, G=None, discrete=True, **more):
    """Plants x+ = a x + b u that agree with samples at (1, 0) and (0, 1), and weights of their demands."""
    A, B, L = ({"tuple": [table([[x]]) for x in part]} for part in (*zip(*plants, strict=True), L))
    weights = {"L": L, "d": None if d is None else table([d]), "G": G}
    fields = {"A": A, "B": B, "functionals": {"record": "Functionals", "fields": weights}}
    data = {"X0": [[1, 0]], "U0": [[0, 1]], "F": None, "plant": None, "l": None} | more
    out = measured([["1/4", "1/4"]], [["1/2", "1/2"]], plant=[[0, 0]], discrete=discrete)
    out = changed(out, combinations=None, witness={"record": "ExcludingPlants", "fields": fields})
    tables = {name: None if x is None else table(x) for name, x in data.items() if name != "l"}
    return changed(out, **tables) | {"status": "REFUTED"}


def without_inputs():
    out = excluding(("-1/4", 0), U0=None)
    return changed(out, witness=changed_plants(out, B={"tuple": [table([[]])]}))


def changed_plants(out, **more):
    witness = out["data"]["witness"]
    return {**witness, "fields": {**witness["fields"], **more}}


def pushed(F=((0,),)):
    """A plant with an input that leaves for this gain."""
    out = out_of_half("1/4", 0, "1/2")
    fields = {**out["data"]["witness"]["fields"], "plant": table([["-1/4", "1/4"]])}
    out = changed(out, X0=table([[1, 0]]), U0=table([[0, 1]]), F=None if F is None else table(F))
    out = changed(out, X1=table([["1/4", "1/4"]]), noise=table([["1/2", "1/2"]]))
    return changed(out, witness={"record": "LeavingPlant", "fields": fields})


BOTH = (("-1/4", "1/4"), ("-1/4", "-1/4"))
NO_GAIN = {
    "no data, an input": (pushed(), "REFUTED"),
    "no data, an input against it": (pushed([[1]]), "WRONG"),
    "no data, an input without a gain": (pushed(None), "UNREADABLE"),
    "no gain for data": (excluding(("-1/4", 0)), "REFUTED"),
    "no gain for data, not against a strong input": (excluding(("-1/4", "1/4")), "WRONG"),
    "no gain for data, just": (excluding((0, 0)), "WRONG"),
    "no gain for data, another plant": (excluding(("-3/8", 0)), "WRONG"),
    "no gain for data, another input": (excluding(("-1/4", "-3/8")), "WRONG"),
    "no gain for data, two plants": (excluding(*BOTH, L=(1, 1)), "REFUTED"),
    "no gain for data, two unequal weights": (excluding(*BOTH, L=(1, 2)), "WRONG"),
    "no gain for data, the second does not agree": (excluding(BOTH[0], ("-1/4", -1), L=(4, 1)), "WRONG"),
    "no gain for data, not in continuous time": (excluding(("-1/4", 0), discrete=False), "WRONG"),
    "no stable gain for data": (excluding((1, 0), L=(0,), d=(1,), X1=[[1, 0]]), "REFUTED"),
    "no stable gain for data, just": (excluding(("3/4", 0), L=(0,), d=(1,)), "WRONG"),
    "no stable gain for data, an input": (excluding((1, "1/4"), L=(0,), d=(1,), X1=[[1, 0]]), "WRONG"),
    "no stable gain for data, no decay is used": (excluding(("-1/4", 0), d=(0,)), "REFUTED"),
    "no stable gain for data, derivatives": (
        excluding((0, 0), L=(0,), d=(1,), discrete=False),
        "REFUTED",
    ),
    "no gain for data, but a gain": (excluding(("-1/4", 0), F=[[0]]), "UNREADABLE"),
    "no gain for data, no inputs": (without_inputs(), "UNREADABLE"),
    "no gain for data, outputs": (excluding(("-1/4", 0), G=table([])), "UNREADABLE"),
    "no stable gain for data, outputs": (excluding(("-1/4", 0), d=(0,), G=table([])), "UNREADABLE"),
}

CASES = NO_GAIN | {
    "data": (one("1/2", "1/4"), "PROVED"),
    "data, at the edge": (one("1/2", "1/2"), "PROVED"),
    "data, beyond the edge": (one("1/2", "5/8"), "WRONG"),
    "data, negative noise": (one("1/2", "-1/4"), "WRONG"),
    "data, another generator": (one("1/2", "1/4", [[2]], X=TWICE), "PROVED"),
    "data, another combination": (one("1/2", "1/4", [[2]]), "WRONG"),
    "data, no combination": (one("1/2", "1/4", []), "UNREADABLE"),
    "data, two combinations": (one("1/2", "1/4", [[1], [1]]), "UNREADABLE"),
    "data, a plant at the edge": (one("1/2", "1/4", plant="3/4"), "PROVED"),
    "data, a plant above": (one("1/2", "1/4", plant="7/8"), "WRONG"),
    "data, a plant below": (one("1/2", "1/4", plant="1/8"), "WRONG"),
    "data, no plant": (changed(one("1/2", "1/4"), plant=None), "UNREADABLE"),
    "data, time is a number": (changed(one("1/2", "1/4"), discrete=1), "UNREADABLE"),
    "data, stable": (one("1/2", "1/4", [[1], [1]], e=[1]), "PROVED"),
    "data, stable, at the edge": (one("1/2", "1/2", [[1], [1]], e=[1]), "WRONG"),
    "data, growing, e is negative": (one(2, "1/4", [[1], [-1]], e=[-1]), "WRONG"),
    "data, e is 0": (one("1/2", "1/4", [[1], [0]], e=[0]), "WRONG"),
    "data, derivatives": (one(-1, "1/2", [[1]], e=[1], discrete=False), "PROVED"),
    "data, derivatives, at the edge": (one(-1, 1, [[1]], e=[1], discrete=False), "WRONG"),
    "data, derivatives, e is negative": (one(1, "1/2", [[-1]], e=[-1], discrete=False), "WRONG"),
    # a x + b F x at l = (1, F): 1/2 - 1/4 - 2/8
    "data, inputs": (driven(), "PROVED"),
    "data, two inputs": (two_inputs(), "PROVED"),
    "data, two inputs, another combination": (two_inputs(l=[[1, 1, -1]]), "WRONG"),
    "data, inputs, too large": (driven(F="-9/8", l=[[1, "-9/8"]]), "WRONG"),
    "data, inputs, another gain": (driven(F=-2), "WRONG"),
    "data, inputs, another plant": (driven(b="1/2"), "WRONG"),
    "data, inputs of a half": (driven(u="1/2", l=[[1, -2]], b="1/2"), "WRONG"),
    "data, inputs without a gain": (changed(driven(), F=None), "UNREADABLE"),
    "data, a gain without inputs": (changed(driven(), U0=None), "UNREADABLE"),
    # A (1, 0) = (1/2, 1/4) with the noise of a sample, A (1, 1) = (1, 3/8) with that of two
    "data, tilted": (tilted([["1/2", "1/2"], ["1/4", "1/8"]], "1/8"), "PROVED"),
    "data, tilted, at the edge": (tilted([["1/2", "1/2"], ["1/4", "1/4"]], "1/8"), "PROVED"),
    "data, tilted, too noisy": (tilted([["1/2", "1/2"], ["1/4", "1/4"]], "9/64"), "WRONG"),
    "data, tilted, stable": (tilted([["1/4", "1/4"], ["1/8", "1/8"]], "1/32", e=[3, 1]), "PROVED"),
    "data, tilted, not stable": (tilted([["3/4", "1/4"], ["1/8", "1/8"]], "1/8", e=[3, 1]), "WRONG"),
    "data, tilted, derivatives": (tilted([[-1, 1], [0, -1]], 0, discrete=False, l=[[1, 0], [1, 1], [1, 1]]), "PROVED"),
    "data, tilted, leaving": (tilted([[-1, 0], [0, "1/2"]], 0, discrete=False, l=[[1, 0], [1, 1], [1, 1]]), "WRONG"),
    "data, four generators": (wedge("1/2"), "PROVED"),
    "data, four generators, turned": (wedge([[0, "-1/2", 0], ["1/2", 0, 0], [0, 0, "1/2"]]), "PROVED"),
    "data, four generators, flat": (wedge([["1/2", 0, 0], [0, "1/2", 0], [0, 0, "1/4"]]), "WRONG"),
    "no data": (out_of_half("1/4", "-1/4", "1/2"), "REFUTED"),
    "no data, at the edge": (out_of_half("1/4", 0, "1/2"), "WRONG"),
    "no data, another plant": (out_of_half("1/4", "-1/2", "1/2"), "WRONG"),
    "no data, another normal": (out_of_half("1/4", "1/4", "1/2", -1), "WRONG"),
    "no data, no generator": (out_of_half("1/4", "-1/4", "1/2", ray=1), "UNREADABLE"),
    "no data, beside a proof": (
        changed(out_of_half("1/4", "-1/4", "1/2"), combinations=table([[1]])),
        "UNREADABLE",
    ),
    "no data, derivatives": (
        leaving([[-1, -1], [0, -1]], [1, 0], **TURNING, ray=1),
        "REFUTED",
    ),
    "no data, derivatives inside": (
        leaving([[-1, -1], [0, -1]], [1, 0], **TURNING, ray=0),
        "WRONG",
    ),
}
