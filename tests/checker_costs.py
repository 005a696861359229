"""Tiny certificate files by hand about optimal costs and order intervals, true and just not true."""

from checker_cases import HALF, changed, double


def cheapest(A=0, B=1, *, s=2, r=1, limits=1, kinds=0, discrete=True, discount=1, status="PROVED", **answer):
    """x+ = A x + B mu on the half-line with one block; p = (s - |r + B p| l) + A p."""
    columns = B if isinstance(B, list) else [B]
    costs = r if isinstance(r, list) else [r]
    data = {name: {"matrix": [row]} for name, row in (("A", [A]), ("B", columns), ("s", [s]), ("r", costs))}
    data |= {"limits": {"matrix": [[limits]]}, "X": HALF, "discrete": discrete, "discount": {"fraction": discount}}
    data |= {"owner": {"tuple": [0] * len(columns)}, "kinds": {"tuple": [kinds]}, "witness": None}
    if status == "PROVED":
        policy, low, high = answer["policy"], answer["low"], answer["high"]
        data |= {"policy": {"tuple": policy}} | {
            k: {"array": [double(x)]} for k, x in (("lower", low), ("upper", high))
        }
    else:
        fields = {"d": {"array": [double(answer["d"])]}}
        data |= {"witness": {"record": "GrowingCost", "fields": fields}} | dict.fromkeys(("policy", "lower", "upper"))
    return {"claim": "optimal cost", "status": status, "data": data | answer.get("more", {}), "proof": {}}


def two_states(A, low=0, high=4, owner=(0, 1), *, discrete=True):
    """Two controlled states, with limits of a quarter of the first and of the second."""
    plane = {"cone": [[2, HALF["cone"][0][1]]]}
    data = {"A": {"matrix": A}, "B": {"matrix": [[1, 0], [0, 1]]}, "s": {"matrix": [[1, 1]]}, "r": {"matrix": [[0, 0]]}}
    data |= {"limits": {"matrix": [["1/4", 0], [0, "1/4"]]}, "X": plane, "witness": None, "discrete": discrete}
    data |= {"owner": {"tuple": list(owner)}, "kinds": {"tuple": [0, 0]}, "policy": {"tuple": [-1, -1]}}
    data |= {"discount": {"fraction": int(discrete)}}
    data |= {name: {"array": [double(x), double(x)]} for name, x in (("lower", low), ("upper", high))}
    return {"claim": "optimal cost", "status": "PROVED", "data": data, "proof": {}}


def over(points, *more):
    """The cone over points, with opposite ones beside each other and 1 as the last coordinate; more generators last."""
    n, p = len(points[0]), len(points)
    square = sum(x[0] ** 2 for x in points)
    Z = [[f"{a}/{square}" for a in x] + [f"1/{p}"] for x in points] + [[0] * (n + 1) for _ in more]
    return {"rays": [[*x, 1] for x in points] + [list(x) for x in more], "w": [0] * n + [1], "Z": Z}


def tapered(factor, pushes, *, discrete=True, count=1, low=2, high=2, beside=()):
    """x+ = diag(1/4, ..., 1/4, 1/2) x + mu (pushes, 0) with |mu| <= x_n at the cost x_n, which is 2 x_n in all."""
    n, size = len(factor["w"]), len(factor["w"]) * count + len(beside)
    last = [j for j in range(size) if j % n == n - 1 or j >= n * count]
    A = [[0] * j + ["1/2" if j in last else "1/4"] + [0] * (size - j - 1) for j in range(size)]
    if not discrete:
        A = [[{"1/2": "-1/2", "1/4": "-3/4"}.get(a, a) for a in row] for row in A]
    B = [[b] for b in [0] * (n * (count - 1)) + [*pushes, 0] + [0] * len(beside)]
    ends, data = (
        [int(j in last) for j in range(size)],
        {"X": {"cone": [[count, factor], *beside]}, "discrete": discrete},
    )
    data |= {"A": {"matrix": A}, "B": {"matrix": B}, "s": {"matrix": [ends]}, "r": {"matrix": [[0]]}}
    data |= {"limits": {"matrix": [[int(j == n * count - 1) for j in range(size)]]}, "witness": None}
    data |= {"owner": {"tuple": [0]}, "kinds": {"tuple": [0]}, "policy": {"tuple": [1]}}
    data |= {"discount": {"fraction": int(discrete)}}
    data |= {name: {"array": [double(x * a) for a in ends]} for name, x in (("lower", low), ("upper", high))}
    return {"claim": "optimal cost", "status": "PROVED", "data": data, "proof": {}}


SQUARE = over([(1, 1), (-1, -1), (1, -1), (-1, 1)])
WIDER = over([(1, 1), (-1, -1), (1, -1), (-1, 1)], (0, 0, 1), (2, 1, 2), (1, 0, 1))  # with generators that add nothing
OCTAHEDRON = over([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
CUBE = over([(a, b, c) for a in (1, -1) for b in (1, -1) for c in (1, -1)])
FACETS = {
    "facets of a square": (tapered(SQUARE, ["1/4", 0]), "PROVED"),
    "facets of a square, the other way": (tapered(SQUARE, [0, "-1/4"]), "PROVED"),
    "facets of a square, both": (tapered(SQUARE, ["1/4", "-1/4"]), "PROVED"),
    "facets of a square, pushed out": (tapered(SQUARE, ["5/16", 0]), "WRONG"),
    "facets of a square, pushed out the other way": (tapered(SQUARE, [0, "5/16"]), "WRONG"),
    "facets of a square, in continuous time": (tapered(SQUARE, ["1/4", 0], discrete=False), "PROVED"),
    "facets of a square, pushed out in continuous time": (tapered(SQUARE, ["5/16", 0], discrete=False), "WRONG"),
    "facets of a square, cost too low": (tapered(SQUARE, ["1/4", 0], high=1), "WRONG"),
    "facets of a square with more": (tapered(WIDER, ["1/4", 0]), "PROVED"),
    "facets of a square with more, pushed out": (tapered(WIDER, ["5/16", 0]), "WRONG"),
    "facets of an octahedron": (tapered(OCTAHEDRON, ["1/4", 0, 0]), "PROVED"),
    "facets of an octahedron, askew": (tapered(OCTAHEDRON, ["1/12", "-1/12", "1/12"]), "PROVED"),
    "facets of an octahedron, pushed out": (tapered(OCTAHEDRON, ["1/12", "-1/12", "1/11"]), "WRONG"),
    "facets of an octahedron, pushed out on the other side": (tapered(OCTAHEDRON, ["1/12", "1/12", "1/11"]), "WRONG"),
    "facets of a cube": (tapered(CUBE, ["1/4", "1/4", "1/4"]), "PROVED"),
    "facets of a cube, pushed out": (tapered(CUBE, ["1/4", "1/4", "5/16"]), "WRONG"),
    "facets of a cube, pushed out in front": (tapered(CUBE, ["5/16", 0, 0]), "WRONG"),
    "facets of a cube, pushed out beside": (tapered(CUBE, [0, "5/16", 0]), "WRONG"),
    "facets of two squares": (tapered(SQUARE, ["1/4", 0], count=2, beside=HALF["cone"]), "PROVED"),
    "facets of two squares, pushed out": (tapered(SQUARE, ["5/16", 0], count=2, beside=HALF["cone"]), "WRONG"),
}

LARGER = tapered(over([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], (2, 2, 1, 1)), [0, 0, 0])
PAIRS = [(LARGER, 8, "PROVED"), (LARGER, 7, "UNREADABLE")]  # of facets on either side of the last generator


def steered(gain, *arguments, low=2, high, **data):
    """The same with a gain in the place of a policy."""
    content = cheapest(*arguments, **data, policy=[], low=low, high=high)
    return changed(content, policy=None, gain={"matrix": [[a] for a in gain]})


GAINS = {
    "optimal cost, gain": (steered(["-1/2"], 1, "1/2", high=6), "PROVED"),
    "optimal cost, gain, too cheap": (steered(["-1/2"], 1, "1/2", high=5), "WRONG"),
    "optimal cost, gain, lower too high": (steered(["-1/2"], 1, "1/2", low=3, high=6), "WRONG"),
    "optimal cost, gain with a factor": (steered([-1], 1, "1/2", s="5/2", discount="1/2", high=2), "PROVED"),
    "optimal cost, gain with a factor, too cheap": (
        steered([-1], 1, "1/2", s="5/2", discount="1/2", low=1, high="15/8"),
        "WRONG",
    ),
    "optimal cost, gain at a rate": (
        steered([-1], -1, 1, s=4, discrete=False, discount=1, low=1, high=1),
        "PROVED",
    ),
    "optimal cost, gain above its limit": (steered([2], "1/2", "-1/4", low=0, high=8), "WRONG"),
    "optimal cost, gain below its limit": (steered([-2], "1/2", "1/4", low=0, high=8), "WRONG"),
    "optimal cost, gain with upper below 0": (
        steered([1], 1, "1/2", low=-6, high=-6),
        "WRONG",
    ),
    "optimal cost, gain of a group": (steered(["1/2"], 1, "-1/2", kinds=1, low=6, high=10), "PROVED"),
    "optimal cost, gain of a group above": (steered(["3/2"], 1, "-1/2", kinds=1, low=0, high=64), "WRONG"),
    "optimal cost, gain of a group below 0": (steered(["-1/4"], "1/2", "-1/4", kinds=1, low=0, high=64), "WRONG"),
    "optimal cost, gain of a group of two": (
        steered(["1/2", "1/2"], 1, ["-1/4", "-1/4"], r=[1, 1], kinds=1, low=0, high=12),
        "PROVED",
    ),
    "optimal cost, gain of a group of two above": (
        steered(["1/2", "3/4"], 1, ["-1/4", "-1/4"], r=[1, 1], kinds=1, low=0, high=64),
        "WRONG",
    ),
    "optimal cost, gain of a group all used": (steered([1], "1/2", "-1/4", kinds=2, low=4, high=4), "PROVED"),
    "optimal cost, gain of a group not all used": (
        steered(["1/2"], "1/2", "-1/4", kinds=2, low=0, high=64),
        "WRONG",
    ),
    "optimal cost, gain against a disturbance": (
        steered([0], "1/2", "1/4", r=0, kinds=3, low=0, high=64),
        "UNREADABLE",
    ),
    "optimal cost, gain and policy": (
        changed(steered(["-1/2"], 1, "1/2", high=6), policy={"tuple": [-1]}),
        "UNREADABLE",
    ),
    "optimal cost, gains of two": (steered(["-1/2", 0], 1, "1/2", high=6), "UNREADABLE"),
    "no finite cost, with a gain": (
        changed(cheapest(2, "1/2", status="REFUTED", d=1), gain={"matrix": [[0]]}),
        "UNREADABLE",
    ),
}

COSTS = {
    "optimal cost": (cheapest(1, "1/2", policy=[-1], low=2, high=2), "PROVED"),
    "optimal cost, wide": (cheapest(1, "1/2", policy=[-1], low=1, high=3), "PROVED"),
    "optimal cost, lower too high": (cheapest(1, "1/2", policy=[-1], low=3, high=3), "WRONG"),
    "optimal cost, upper too low": (cheapest(1, "1/2", policy=[-1], low=1, high=1), "WRONG"),
    "optimal cost, dear policy": (cheapest(1, "1/2", policy=[1], low=2, high=2), "WRONG"),
    "optimal cost, policy beyond its limit": (cheapest(1, "1/2", policy=[-2], low=1, high=2), "UNREADABLE"),
    "optimal cost, half a policy": (cheapest(1, "1/2", policy=["-1/2"], low=1, high=8), "UNREADABLE"),
    "optimal cost, policy of two": (cheapest(1, "1/2", policy=[-1, 0], low=2, high=2), "UNREADABLE"),
    "optimal cost, negative limit": (cheapest(1, "1/2", limits=-1, policy=[-1], low=0, high=8), "WRONG"),
    "optimal cost, just inside": (cheapest("1/2", "1/2", policy=[-1], low=1, high=1), "PROVED"),
    "optimal cost, out of the cone": (cheapest("1/4", "1/2", policy=[-1], low=0, high=1), "WRONG"),
    "optimal cost, a stage for nothing": (cheapest(1, "1/2", s=1, policy=[-1], low=0, high=0), "WRONG"),
    "optimal cost, upper below 0": (cheapest(1, "1/2", policy=[1], low=-6, high=-6), "WRONG"),
    "optimal cost, upper 0": (cheapest(1, 0, s=2, r=2, limits=1, policy=[-1], low=0, high=0), "WRONG"),
    "optimal cost, continuous": (
        cheapest(-1, policy=[-1], low="1/2", high="1/2", discrete=False, discount=0),
        "PROVED",
    ),
    "optimal cost, rate": (cheapest(-1, s=4, policy=[-1], low=1, high=1, discrete=False, discount=1), "PROVED"),
    "optimal cost, rate below 0": (
        cheapest(-3, s=4, policy=[-1], low=1, high=1, discrete=False, discount=-1),
        "UNREADABLE",
    ),
    "optimal cost, factor": (cheapest(1, "1/2", s="5/2", discount="1/2", policy=[-1], low=2, high=2), "PROVED"),
    "optimal cost, factor 0": (cheapest(1, "1/2", discount=0, policy=[-1], low=0, high=8), "UNREADABLE"),
    "optimal cost, factor above 1": (cheapest(1, "1/2", s=8, discount=2, policy=[-1], low=0, high=64), "UNREADABLE"),
    "optimal cost, factor above 1, cheap": (
        cheapest("1/4", "1/4", discount=2, policy=[-1], low=0, high=8),
        "UNREADABLE",
    ),
    "optimal cost, time unknown": (cheapest(1, "1/2", policy=[-1], low=2, high=2, discrete=1), "UNREADABLE"),
    "optimal cost, group": (cheapest(1, "-1/2", kinds=1, policy=[1], low=6, high=6), "PROVED"),
    "optimal cost, group idle": (cheapest("1/2", "-1/4", kinds=1, policy=[0], low=4, high=4), "PROVED"),
    "optimal cost, group below 0": (cheapest(1, "-1/2", r=3, kinds=1, policy=[-1], low=0, high=0), "UNREADABLE"),
    "optimal cost, group of two": (
        cheapest(1, ["-1/4", "-1/4"], r=[1, 1], kinds=1, policy=[0, 1], low=12, high=12),
        "PROVED",
    ),
    "optimal cost, group twice": (
        cheapest(1, ["-1/4", "-1/4"], r=[1, 1], kinds=1, policy=[1, 1], low=0, high=8),
        "UNREADABLE",
    ),
    "optimal cost, group all used": (cheapest("1/2", "-1/4", kinds=2, policy=[1], low=4, high=4), "PROVED"),
    "optimal cost, a dear group used": (
        cheapest("1/2", "-1/4", s=3, r=3, kinds=2, policy=[1], low=8, high=8),
        "PROVED",
    ),
    "optimal cost, group not all used": (cheapest("1/2", "-1/4", kinds=2, policy=[0], low=4, high=4), "UNREADABLE"),
    "optimal cost, disturbance": (cheapest("1/2", "1/4", r=0, kinds=3, policy=[0], low=8, high=8), "PROVED"),
    "optimal cost, disturbance ignored": (cheapest("1/2", "1/4", r=0, kinds=3, policy=[-1], low=4, high=4), "WRONG"),
    "optimal cost, disturbance with a price": (
        cheapest("1/2", "1/4", kinds=3, policy=[0], low=0, high=64),
        "UNREADABLE",
    ),
    "optimal cost, disturbed out": (cheapest("1/8", "1/4", r=0, kinds=3, policy=[0], low=0, high=4), "WRONG"),
    "optimal cost, unknown kind": (cheapest(1, "1/2", kinds=4, policy=[-1], low=2, high=2), "UNREADABLE"),
    "optimal cost, a block too far": (
        cheapest(1, "1/2", policy=[-1], low=2, high=2, more={"owner": {"tuple": [1]}}),
        "UNREADABLE",
    ),
    "optimal cost, two controls in a block": (
        cheapest(1, ["1/4", "1/4"], r=[0, 0], policy=[-1, -1], low=0, high=8),
        "UNREADABLE",
    ),
    "no finite cost, a group without columns": (
        changed(cheapest(2, "1/2", status="REFUTED", d=1), kinds={"tuple": [0, 1]}, limits={"matrix": [[1], [1]]}),
        "UNREADABLE",
    ),
    "optimal cost, a block without columns": (
        cheapest(
            1,
            "1/2",
            policy=[-1],
            low=2,
            high=2,
            more={"kinds": {"tuple": [0, 1]}, "limits": {"matrix": [[1], [0]]}},
        ),
        "UNREADABLE",
    ),
    "optimal cost, two states": (two_states([["1/2", "1/4"], ["1/4", "1/2"]], 2, 2), "PROVED"),
    "optimal cost, two limits": (two_states([["1/2", "1/8"], ["1/4", "1/2"]]), "PROVED"),
    "optimal cost, limits of the other": (two_states([["1/2", "1/8"], ["1/4", "1/2"]], owner=(1, 0)), "WRONG"),
    "optimal cost, two states in continuous time": (
        two_states([[-2, "1/4"], ["1/4", -2]], owner=(1, 0), discrete=False),
        "PROVED",
    ),
    "optimal cost, pushed out in continuous time": (
        two_states([[-2, "1/8"], ["1/4", -2]], owner=(1, 0), discrete=False),
        "WRONG",
    ),
    "no finite cost": (cheapest(2, "1/2", status="REFUTED", d=1), "REFUTED"),
    "no finite cost, just": (cheapest("3/2", "1/2", status="REFUTED", d=1), "REFUTED"),
    "a finite cost": (cheapest("5/4", "1/2", status="REFUTED", d=1), "WRONG"),
    "no finite cost, no vector": (cheapest(2, "1/2", status="REFUTED", d=0), "WRONG"),
    "no finite cost, vector outside": (cheapest(0, 0, status="REFUTED", d=-1), "WRONG"),
}


def stepwise(low, high=None, policies=(-1, -1), *, A=1, B="1/2", last=0, more=None, **data):
    """The same in two steps from a terminal cost; x+ = x + mu / 2, s = 2, r = 1: p = (2 - |1 + p / 2|) + p."""
    content = cheapest(A, B, **{"policy": [0], "low": 0, "high": 0} | data)
    own = {"lower": low, "upper": low if high is None else high, "policies": policies, "terminal": [last]}
    data = {k: x for k, x in content["data"].items() if k != "policy"} | {"witness": None}
    data |= {name: {"matrix": [x if isinstance(x, list) else [x] for x in rows]} for name, rows in own.items()}
    return {**content, "claim": "finite-horizon cost", "data": data | (more or {})}


HORIZONS = {
    "finite cost": (stepwise(["3/2", 1]), "PROVED"),
    "finite cost, wide": (stepwise([1, "1/2"], [2, "3/2"]), "PROVED"),
    "finite cost, lower too high": (stepwise(["13/8", 1], [2, 1]), "WRONG"),
    "finite cost, lower too high at the end": (stepwise([1, "9/8"], [2, 2]), "WRONG"),
    "finite cost, upper too low": (stepwise([1, 1], ["11/8", 1]), "WRONG"),
    "finite cost, upper too low at the end": (stepwise([0, 0], [2, "7/8"]), "WRONG"),
    "finite cost, dear policy": (stepwise(["3/2", 1], policies=(1, -1)), "WRONG"),
    "finite cost, with a terminal cost": (stepwise([2, 2], last=2), "PROVED"),
    "finite cost, with a lower terminal cost": (stepwise([2, 2], last="7/4"), "WRONG"),
    "finite cost, negative": (stepwise(["-9/2", -3], s=0, r=0, last=-2, policies=(1, 1)), "PROVED"),
    "finite cost, of a stage for nothing": (stepwise(["1/4", "1/2"], s=1, last=1, policies=(-1, -1)), "PROVED"),
    "finite cost, with a factor": (stepwise(["5/4", 1], discount="1/2"), "PROVED"),
    "finite cost, of an unstable system": (stepwise([10, 2], A=4, B=0, s=3), "PROVED"),
    "finite cost, out of the cone": (stepwise([0, 0], [9, 9], A="1/4"), "WRONG"),
    "finite cost, policy beyond its limit": (stepwise([0, 0], [9, 9], policies=(-2, -1)), "UNREADABLE"),
    "finite cost, half a policy": (stepwise([0, 0], [9, 9], policies=("-1/2", -1)), "UNREADABLE"),
    "finite cost, policy of two": (stepwise([0, 0], [9, 9], policies=([-1, 0], [-1, 0])), "UNREADABLE"),
    "finite cost, a policy missing": (stepwise(["3/2", 1], policies=(-1,)), "UNREADABLE"),
    "finite cost, a bound too many": (stepwise(["3/2", 1], [9, "3/2", 1]), "UNREADABLE"),
    "finite cost, a low bound too many": (stepwise([9, "3/2", 1], ["3/2", 1]), "UNREADABLE"),
    "finite cost, no step": (stepwise([], policies=()), "UNREADABLE"),
    "finite cost, continuous": (stepwise([0, 0], [9, 9], A=-1, discrete=False, discount=0), "UNREADABLE"),
    "finite cost, group": (stepwise([4, 2], A=1, B="-1/4", r=1, kinds=1, policies=(0, 0)), "PROVED"),
    "finite cost, group below 0": (stepwise([0, 0], [9, 9], kinds=1, B="1/4", policies=(-1, 0)), "UNREADABLE"),
    "finite cost, two ends": (
        stepwise(["3/2", 1], more={"terminal": {"matrix": [[0], [0]]}}),
        "UNREADABLE",
    ),
    "finite cost, refuted": (stepwise(["3/2", 1]) | {"status": "REFUTED"}, "WRONG"),
}


def kept(A=-2, w=1, x="1/2", *, least=None, v=None, bounds=(), rows=(), covers=None, discrete=False, witness=None):
    """x' = A x + w on the half-line with [0, x]; a witness (kind, vector, row) refutes it."""
    vectors = {"w_max": [w], "x_max": x if x is None else [x], "lyapunov": v and [v], "x_min": least and [least]}
    vectors["bounds"] = list(bounds) or None
    data = {k: None if y is None else {"array": [double(a) for a in y]} for k, y in vectors.items()}
    data |= {"A": {"matrix": [[A]]}, "X": HALF, "discrete": discrete, "witness": None}
    matrices = {"rows": rows, "covers": rows if covers is None else covers}
    data |= {name: {"matrix": [[a] for a in f]} if f else None for name, f in matrices.items()}
    if witness is None:
        return {"claim": "order interval", "status": "PROVED", "data": data, "proof": {}}
    kind, vector, *row = witness
    name = "d" if kind == "NoInterval" else "x"
    fields = {name: {"array": [double(vector)]}} | ({"row": row[0]} if row else {})
    data |= {"witness": {"record": kind, "fields": fields}, "x_max": None, "covers": None}
    return {"claim": "order interval", "status": "REFUTED", "data": data, "proof": {}}


def ending(number):
    """[0, number] as it stands in the file."""
    out = kept()
    out["data"]["x_max"] = {"array": [number]}
    return out


SMALLEST = {"least": "1/2", "v": 1}
BOUNDED = {"rows": [3], "bounds": ["3/2"]}
INTERVALS = {
    "interval": (kept(), "PROVED"),
    "interval, too small": (kept(x="1/4"), "WRONG"),
    "interval below 0": (kept(1, 0, -1), "WRONG"),
    "interval, no end": (kept(x=None), "UNREADABLE"),
    "interval, disturbance outside": (kept(w=-1), "WRONG"),
    "interval, none needed": (kept(1, 0, 0), "PROVED"),
    "interval, discrete": (kept("1/2", 1, 2, discrete=True), "PROVED"),
    "interval, discrete, too small": (kept("1/2", 1, 1, discrete=True), "WRONG"),
    "interval, not positive": (kept("-1/2", 1, 2, discrete=True), "WRONG"),
    "interval to a third": (ending("2/3"), "UNREADABLE"),
    "interval to a large number": (ending(2**53), "PROVED"),
    "interval to a number that is no double": (ending(2**53 + 1), "UNREADABLE"),
    "interval to a larger number": (ending(2**60), "PROVED"),
    "interval, smallest": (kept(**SMALLEST), "PROVED"),
    "interval, smallest by far": (kept(least="1/4", v=1), "PROVED"),
    "interval, smallest too large": (kept(x=1, least="3/4", v=1), "WRONG"),
    "interval, smallest without v": (kept(least="1/2"), "UNREADABLE"),
    "interval, v without smallest": (kept(v=1), "UNREADABLE"),
    "interval, smallest of an unstable system": (kept(1, 0, 0, least=1, v=1), "WRONG"),
    "interval, smallest by a negative v": (kept(1, 0, 0, least=1, v=-1), "WRONG"),
    "interval, bound": (kept(**BOUNDED), "PROVED"),
    "interval, bound too low": (kept(rows=[3], bounds=[1]), "WRONG"),
    "interval, no bound is needed": (kept(rows=[-3], bounds=[0], covers=[0]), "PROVED"),
    "interval, negative cover": (kept(rows=[-3], bounds=[-1], covers=[-3]), "WRONG"),
    "interval, cover too low": (kept(rows=[3], bounds=[1], covers=[2]), "WRONG"),
    "interval, bound without cover": (kept(rows=[3], bounds=["3/2"], covers=[]), "UNREADABLE"),
    "interval, rows without bounds": (kept(rows=[3]), "UNREADABLE"),
    "interval, bounds without rows": (kept(bounds=[3]), "UNREADABLE"),
    "no interval": (kept(1, 1, witness=("NoInterval", 1)), "REFUTED"),
    "no interval, marginal": (kept(0, 1, witness=("NoInterval", 1)), "REFUTED"),
    "no interval, but one": (kept(-1, 1, witness=("NoInterval", 1)), "WRONG"),
    "no interval, nothing pushes": (kept(1, 0, witness=("NoInterval", 1)), "WRONG"),
    "no interval, no vector": (kept(1, 1, witness=("NoInterval", 0)), "WRONG"),
    "no interval, vector outside": (kept(-1, 0, witness=("NoInterval", -1)), "WRONG"),
    "no interval, discrete": (kept(1, 1, discrete=True, witness=("NoInterval", 1)), "REFUTED"),
    "no interval, discrete, but one": (kept("1/2", 1, discrete=True, witness=("NoInterval", 1)), "WRONG"),
    "no bound": (kept(**SMALLEST, rows=[3], bounds=[1], witness=("BoundExceeded", "1/2", 0)), "REFUTED"),
    "no bound, just": (kept(**SMALLEST, **BOUNDED, witness=("BoundExceeded", "1/2", 0)), "WRONG"),
    "no bound, beyond": (kept(**SMALLEST, **BOUNDED, witness=("BoundExceeded", 1, 0)), "WRONG"),
    "no bound, outside": (kept(**SMALLEST, rows=[-3], bounds=[1], witness=("BoundExceeded", -1, 0)), "WRONG"),
    "no bound, of none": (kept(**SMALLEST, rows=[3], bounds=[1], witness=("BoundExceeded", "1/2", 1)), "WRONG"),
    "no bound, before all": (
        kept(**SMALLEST, rows=[3], bounds=[1], witness=("BoundExceeded", "1/2", -1)),
        "UNREADABLE",
    ),
    "no bound, no smallest": (kept(rows=[3], bounds=[-1], witness=("BoundExceeded", 0, 0)), "UNREADABLE"),
}
COSTS |= INTERVALS | HORIZONS | FACETS | GAINS
