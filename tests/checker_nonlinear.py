"""Tiny certificate files by hand about nonlinear networks, true and just not true."""

from checker_cases import double

# x' = f(x, u) with slopes -3 to -2 and 1, y = x with slopes 1/2 to 1, u = y with slopes 0 to 1.
HIGH = [[[-2]], [[1]], [[1]], [[1]], [[0]]]
LOW = [[[-3]], [[1]], [["1/2"]], [[0]], [[0]]]
BY_E = {"e": [1], "y": [1], "y_lower": ["1/2"], "u": [1]}
BY_V = {"v": [1], "r": [1], "p": [1]}
CORNERS = {"rates_at_lower": [0], "rates_at_upper": [0]}
NOTHING = dict.fromkeys(BY_E | BY_V | CORNERS)
GIVEN = "PROVED (given the bounds on the Jacobians)"
SHOWN = "REFUTED (given the bounds on the Jacobians)"


def sparse(M):
    rows = [[i, j, double(x)] for i, row in enumerate(M) for j, x in enumerate(row) if x]
    return {"sparse": rows, "shape": [len(M), len(M[0])]}


def ends(high, low, own=(0,), decay=1, status="PROVED", witness=None, **vectors):
    data = {"upper": {"tuple": [sparse(M) for M in high]}, "lower": {"tuple": [sparse(M) for M in low]}}
    data |= {"own": {"array": list(own)}, "decay_rate": {"double": double(decay)}, "witness": witness}
    data |= {name: None if x is None else {"array": [double(a) for a in x]} for name, x in vectors.items()}
    return {"claim": "differentially-positive network", "status": status, "data": data, "proof": {}}


def other(M, block, **more):
    """One matrix changed at both ends, or at one of them."""
    high, low = ([*end[:block], M, *end[block + 1 :]] for end in (HIGH, LOW))
    return lambda end: ends(high if "high" in end else HIGH, low if "low" in end else LOW, **all_of(more))


def all_of(more):
    return BY_E | BY_V | CORNERS | more


def one(**more):
    return ends(HIGH, LOW, **all_of(more))


def two(e=(1, 2), u="-1/2", decay="5/4", high=1, low="1/2", own=0, A=1, y=(2, 1), y_lower=None, B=("1/2", 1), **more):
    """Slopes high to low of x1 - x2 on x1: outputs are (x2, x1), the own one is x2."""
    A, C = [[-3, A], [1, -3]], [[0, 1], [1, 0]]
    upper = [A, [[B[1]], [0]], C, [[0, 0]], [[0, high]]]
    lower = [A, [[B[0]], [0]], C, [[0, 0]], [[0, low]]]
    vectors = {"e": e, "y": y, "y_lower": y if y_lower is None else y_lower, "u": [u]}
    return ends(upper, lower, own=(own,), decay=decay, **vectors | more)


def violated(block=1, row=0, column=0, value=-1, x=(0,), M=-1, decay=0, **more):
    """x' falls with u."""
    high = [[[-2]], [[1]], [[1]], [[1]], [[0]]]
    low = [[[-3]], [[0]], [["1/2"]], [[0]], [[0]]]
    low[block] = [[M]]
    return ends(high, low, decay=decay, status="REFUTED", witness=witness(block, row, column, value, x), **more)


def witness(block, row, column, value, x):
    fields = {"block": block, "row": row, "column": column, "value": {"double": double(value)}}
    return {"record": "OrderViolation", "fields": fields | {"x": x and {"array": list(x)}}}


def crossing(row=0, column=1, value="-1/2", A=1, B=(1, 1), high="3/2"):
    """x1' rises less with x2 than its own share takes off."""
    A, C = [[-3, A], [1, -3]], [[0, 1], [1, 0]]
    upper = [A, [[B[1]], [0]], C, [[0, 0]], [[0, high]]]
    lower = [A, [[B[0]], [0]], C, [[0, 0]], [[0, 0]]]
    return ends(upper, lower, decay=0, status="REFUTED", witness=witness(0, row, column, value, (0, 0)))


def doubled(which):
    out = one()
    out["data"][which]["tuple"].append(sparse([[1]]))
    return out


def dense():
    out = one()
    out["data"]["upper"]["tuple"][0] = {"matrix": [[-2]]}
    return out


def wide():
    """More inputs than a file of this length may have."""
    out = one(**NOTHING, decay=0)
    for end in ("upper", "lower"):
        out["data"][end]["tuple"][1] = {"sparse": [], "shape": [1, 10**6]}
    return out


CASES = {
    "slopes": (one(), GIVEN),
    "slopes, e alone": (one(**dict.fromkeys(BY_V)), GIVEN),
    "slopes, v alone": (one(**dict.fromkeys(BY_E)), GIVEN),
    "slopes, order alone": (one(decay=0, **NOTHING), GIVEN),
    "slopes, a rate of nothing": (one(**NOTHING), "UNREADABLE"),
    "slopes, no rate": (one(decay=0), "UNREADABLE"),
    "slopes, too fast": (one(decay="1.25"), "WRONG"),
    "slopes, too fast for e": (one(decay="1.25", **dict.fromkeys(BY_V)), "WRONG"),
    "slopes, too fast for v": (one(decay="1.25", **dict.fromkeys(BY_E)), "WRONG"),
    "slopes, slower": (one(decay="0.5"), GIVEN),
    "slopes, e at 0": (one(e=[0], y=[0], y_lower=[0], u=[0]), "WRONG"),
    "slopes, e below 0": (one(e=[-1], y=[0], y_lower=[-1], u=[0]), "WRONG"),
    "slopes, v at 0": (one(v=[0], r=[0], p=[0]), "WRONG"),
    "slopes, v below 0": (one(v=[-1], r=[0], p=[0]), "WRONG"),
    "slopes, too little output": (one(y=["0.75"], u=["0.75"]), "WRONG"),
    "slopes, too much output": (one(y_lower=["0.75"]), "WRONG"),
    "slopes, less output": (one(y_lower=[0]), GIVEN),
    "slopes, too little input": (one(u=["0.75"]), "WRONG"),
    "slopes, too little r": (one(r=["0.75"], p=["0.75"]), "WRONG"),
    "slopes, too little p": (one(p=["0.75"]), "WRONG"),
    "slopes, more output": (one(y=["1.5"], u=["1.5"], decay="0.5"), GIVEN),
    "slopes, more p": (one(p=["1.5"], decay="0.5"), GIVEN),
    "slopes, missing y": (one(y=None), "UNREADABLE"),
    "slopes, missing r": (one(r=None), "UNREADABLE"),
    "slopes, one corner": (one(rates_at_upper=None), "UNREADABLE"),
    "slopes, no corners": (one(**dict.fromkeys(CORNERS)), GIVEN),
    "slopes, leaving below": (one(rates_at_lower=["-0.5"]), "WRONG"),
    "slopes, leaving above": (one(rates_at_upper=["0.5"]), "WRONG"),
    "slopes, inwards": (one(rates_at_lower=[1], rates_at_upper=[-1]), GIVEN),
    "slopes, corners of another size": (one(rates_at_lower=[1, 1]), "UNREADABLE"),
    "slopes, ends turned around": (other([[-4]], 0)("high"), "WRONG"),
    "slopes, inputs below 0": (other([[-1]], 1)("low"), "WRONG"),
    "slopes, outputs below 0": (other([[-1]], 2, y_lower=[-1])("low"), "WRONG"),
    "slopes, links below 0": (other([[-1]], 3)("low"), "WRONG"),
    "slopes, differences below 0": (other([[-1]], 4)("low"), "WRONG"),
    "slopes, differences and v": (other([[1]], 4, u=["1.5"], decay="0.5")("high"), "UNREADABLE"),
    "slopes, differences with itself": (
        other([[1]], 4, u=["1.5"], decay="0.5", **dict.fromkeys(BY_V))("high"),
        GIVEN,
    ),
    "slopes, differences with itself, too little input": (
        other([[1]], 4, u=["1.25"], decay="0.5", **dict.fromkeys(BY_V))("high"),
        "WRONG",
    ),
    "slopes, a sixth matrix": (doubled("upper"), "UNREADABLE"),
    "slopes, a sixth lower end": (doubled("lower"), "UNREADABLE"),
    "slopes, a dense matrix": (dense(), "UNREADABLE"),
    "slopes, absurd": (wide(), "UNREADABLE"),
    "slopes, own in halves": (one(own=("1/2",)), "UNREADABLE"),
    "slopes, own of two inputs": (one(own=(0, 0)), "UNREADABLE"),
    "slopes, own unused": (one(own=(7,)), GIVEN),
    "differences": (two(), GIVEN),
    "differences, too fast": (two(decay="1.5"), "WRONG"),
    "differences, at the other end": (two(e=(2, 1), y=(1, 2), u=1, decay=1), GIVEN),
    "differences, at the other end, less input": (two(e=(2, 1), y=(1, 2), u="0.75", decay=1), "WRONG"),
    "differences, less input": (two(u="-0.75"), "WRONG"),
    "differences, more input": (two(u=0, decay=1), GIVEN),
    "differences, own output far": (two(own=2), "UNREADABLE"),
    "differences, own output below 0": (two(own=-1), "UNREADABLE"),
    "differences, the other output is its own": (two(own=1, u=0, decay=1), GIVEN),
    "differences, own share as large as can be": (two(high="1", low="1"), GIVEN),
    "differences, own share too large": (two(high="1.5"), "WRONG"),
    "differences, own share of a smaller input": (two(high="1.5", B=("1/2", "1/2")), GIVEN),
    "differences, own share in two": (two(high=2, low="1/2", B=("1/2", "1/2")), GIVEN),
    "differences, own share of more than there is": (two(high="2.25", B=("1/2", "1/2")), "WRONG"),
    "states below 0": (two(A=-1, high=0, low=0, u=0, decay="0.25"), "WRONG"),
    "a slope below 0": (violated(), SHOWN),
    "a slope below 0, of outputs": (violated(block=2), SHOWN),
    "a slope below 0, of links": (violated(block=3, x=None), SHOWN),
    "a slope below 0, of differences": (violated(block=4), SHOWN),
    "a slope of 0": (violated(value=0), "WRONG"),
    "a slope less far below 0": (violated(value="-0.5"), SHOWN),
    "a slope below the ends": (violated(value=-2), "WRONG"),
    "a slope of the diagonal": (violated(block=0, M=-3, value=-3), "UNREADABLE"),
    "a slope beyond the rows": (violated(row=1), "UNREADABLE"),
    "a slope beyond the columns": (violated(column=1), "UNREADABLE"),
    "a slope at a state of another size": (violated(x=(0, 0)), "UNREADABLE"),
    "a slope with a rate": (violated(decay=1), "WRONG"),
    "an own share that is too large": (crossing(), SHOWN),
    "an own share that is not so large": (crossing(value="-0.75"), "WRONG"),
    "an own share of the larger input": (crossing(value=-2, B=(1, 2)), SHOWN),
    "another entry than that of the own share": (crossing(row=1, column=0), "WRONG"),
    "a state that lowers another": (crossing(row=0, column=1, value=-1, A=-1, high=0), SHOWN),
}
_unknown = violated()
_unknown["data"]["witness"]["fields"]["block"] = 5
CASES["a slope of a sixth block"] = (_unknown, "UNREADABLE")
_silent = one(**NOTHING)
del _silent["data"]["decay_rate"]
CASES["slopes, nothing of a rate"] = (_silent, GIVEN)
PAIRS = [(one(), 1, GIVEN), (one(), 0, "UNREADABLE")]
