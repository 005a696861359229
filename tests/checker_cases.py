"""Tiny certificate files by hand, with nothing between right and wrong: for every claim, true and just not true."""

# -- scalar systems on half-lines

HALF = {"cone": [[1, {"rays": [[1]], "w": [1], "Z": [[1]]}]]}


def scalar(claim, status="PROVED", *, A=-2, B=1, C=1, D=0, v=1, q=-1, r=1, decay=0, W=None, discrete=False, **proof):
    data = {name: {"matrix": [[x]]} for name, x in zip("ABCD", (A, B, C, D), strict=True)}
    data |= dict.fromkeys("XUY", HALF) | {"discrete": discrete, "witness": None}
    vectors = {name: None if x is None else {"array": [x]} for name, x in (("v", v), ("q", q), ("r", r))}
    if W is not None:
        data["W"] = {"matrix": [[W]]}
        proof = {name.upper(): x for name, x in vectors.items()} | dict.fromkeys("pt") | proof
    data |= vectors | {"decay_rate": {"double": decay}}
    return {"claim": claim, "status": status, "data": data, "proof": proof}


def asked(required, status="PROVED", claim="stable", **more):
    out = scalar(claim, status, **more)
    out["data"]["required_rate"] = {"fraction": required}
    return out


def limited(bound):
    out = scalar("stable", "REFUTED", A=0, **direction(1, 0))
    out["data"]["decay_rate_bound"] = {"double": bound}
    return out


def shaped(shape):
    out = scalar("stable")
    out["data"]["A"] = {"sparse": [[0, 0, -2]], "shape": shape}
    return out


def direction(x, u, rate=0, shows="motion", **more):
    return {"x": {"array": [x]}, "u": {"array": [u]}, "rate": rate, "shows": shows, **more}


def flow(x, u, y, shows="growth", **more):
    return direction(x, u, shows=shows, y={"array": [y]}, **more)


def sized(*sizes):
    """A network that says how many states, inputs and outputs its nodes have."""
    out = scalar("network", W=1)
    out["data"]["sizes"] = {"array": list(sizes)}
    return out


def closed(W, D=0, **more):
    """A node with a link to itself that is closed first."""
    out = scalar("network", W=W, D=D, **more)
    out["data"] |= {"sizes": {"array": [1, 1, 1]}, "own_links_closed": True}
    return out


def closed_twice(decay):
    """A node of two ports, with (I - W D)^-1 = [[16, 4], [2, 16]] / 31, and as much decay and supply as there is."""
    out, plane, one = closed(0), {"cone": [[2, HALF["cone"][0][1]]]}, {"matrix": [[1, 0], [0, 1]]}
    out["data"] |= dict.fromkeys("XUY", plane) | dict.fromkeys("BCD", one) | {"A": {"matrix": [[-3, 0], [0, -3]]}}
    out["data"] |= {"W": {"matrix": [[-1, "0.5"], ["0.25", -1]]}, "sizes": {"array": [2, 2, 2]}}
    vectors = {"v": {"array": [1, 1]}, "q": {"array": [0, 0]}, "r": {"array": ["18/31", "20/31"]}}
    out["data"] |= vectors | {"decay_rate": {"double": decay}}
    out["proof"] |= {name.upper(): x for name, x in vectors.items()} | {"p": vectors["v"], "t": vectors["r"]}
    return out


def weights(p, t):
    return {"p": {"array": [p]}, "t": {"array": [t]}}


def two_nodes(q, r, y):
    """Nodes that do nothing, the output of the first linked to the second."""
    out, plane, zero = scalar("network", "REFUTED"), {"cone": [[2, HALF["cone"][0][1]]]}, {"matrix": [[0, 0], [0, 0]]}
    out["data"] |= dict.fromkeys("XUY", plane) | dict.fromkeys("ABCD", zero) | {"W": {"matrix": [[0, 0], [1, 0]]}}
    out["data"] |= {"q": {"array": [q[:1], q[1:]]}, "r": {"tuple": [{"array": r[:1]}, {"array": r[1:]}]}}
    return {**out, "proof": {"shows": "weights", "rate": 0, "y": {"array": y}}}


def feedback(*parts, status="PROVED"):
    loops = {"tuple": [{"certificate": part} for part in parts]}
    return {"claim": "feedback", "status": status, "data": {"loops": loops, "others": {"tuple": []}}, "proof": {}}


def bound(F, b, status="PROVED"):
    data = {"X": HALF, "F": {"matrix": [[x] for x in F]}, "bound": {"array": b}}
    return {"claim": "gain bound", "status": status, "data": data, "proof": {}}


def leading(top, b, **more):
    """x_1 is bounded at generators (1, top) and (0, 1) with a leading entry of 1."""
    rays = {"rays": [[1, top], [0, 1]], "w": [1, 1], "Z": [[1, 0], [-top, 1]]}
    out = bound([], [b])
    out["data"] |= {"X": {"cone": [[1, rays]]}, "F": {"matrix": [[1, 0]]}, "leading": True, **more}
    return out


def family(matrices, claim="differentially-positive", discrete=False, status="PROVED", v=1, proofs=None, **proof):
    data = {"A": {"tuple": [{"matrix": [[a]]} for a in matrices]}, "X": HALF, "discrete": discrete}
    data |= {"v": None if v is None else {"array": [v]}}
    proofs = [None] * len(matrices) if proofs is None else proofs
    return {"claim": claim, "status": status, "data": data, "proof": {"P": proofs, **proof}}


def common(matrices, rate, required=None):
    out = family(matrices, "common vector")
    out["data"] |= {"decay_rate": {"double": rate}}
    out["data"] |= {} if required is None else {"required_rate": {"fraction": required}}
    return out


def crossing(member):
    return {"member": member, "matrix": "A", "normal": {"matrix": [[1]]}, "ray": 0}


def slanted():
    """v'x = 0 on a generator although (v'A - q'C) x < 0 on both."""
    out = scalar("dissipative")
    plane = {"cone": [[2, HALF["cone"][0][1]]]}
    out["data"] |= {"X": plane, "A": {"matrix": [[-1, 0], [0, -1]]}, "B": {"matrix": [[0], [0]]}}
    out["data"] |= {"C": {"matrix": [[0, 1]]}, "v": {"array": [1, 0]}, "q": {"array": [1]}}
    return out


A_THIRD, MINUS_THIRD = ("0x1.5555555555555p-2", "1/3"), ("-0x1.5555555555555p-2", "-1/3")
ABOVE = ("0x1.5555555555555p-2", "0.3333333333333333334")


def typed(claim, status="PROVED", *, q, r, **more):
    """x' = -x + u, y = x with a supply of doubles and of what they round; any r above -q is enough."""
    out = scalar(claim, status, A=-1, v=r[1], q=q[0], r=r[0], **more)
    out["data"] |= {"q_exact": {"fractions": [q[1]]}, "r_exact": {"fractions": [r[1]]}}
    return out


def two_inputs(r):
    """x' = -100 x + u_1 + u_2, y = x, whose gain is far below these."""
    out, plane = scalar("disturbance gain", A=-100, v="1/4"), {"cone": [[2, HALF["cone"][0][1]]]}
    out["data"] |= {"U": plane, "B": {"matrix": [[1, 1]]}, "D": {"matrix": [[0, 0]]}}
    out["data"] |= {"r": {"array": ["0x1.5555555555555p-2"] * 2}, "r_exact": {"fractions": r}}
    return out


BY_HAND = {
    "stable": (scalar("stable", decay=2), "PROVED"),
    "at a rate it does not have": (scalar("stable", decay="2.0000001"), "WRONG"),
    "at a negative rate": (scalar("stable", decay=-1), "WRONG"),
    "at the rate that was asked for": (asked(2), "PROVED"),
    "a little below the rate that was asked for": (asked("2.0000001"), "WRONG"),
    "a rate that nobody asks for": (asked(-1), "WRONG"),
    "no rate at all": (asked(0), "WRONG"),
    "not at the rate that was asked for": (asked("2.1", "REFUTED", **direction(1, 0, -2)), "REFUTED"),
    "only at the rate that was asked for": (asked(2, "REFUTED", **direction(1, 0, -2)), "WRONG"),
    "at that rate with something left": (asked("2.1", "REFUTED", **direction(1, 0, "-2.1")), "REFUTED"),
    "a motion that is too fast": (asked("2.1", "REFUTED", **direction(1, 0, "-2.2")), "WRONG"),
    "not even stable, at any rate": (asked(1, "REFUTED", A=1, **direction(1, 0)), "REFUTED"),
    "only at a rate that nobody states": (
        scalar("stable", "REFUTED", required_rate={"fraction": "2.1"}, **direction(1, 0, -2)),
        "WRONG",
    ),
    "unstable, at a rate that nobody asks for": (asked(-1, "REFUTED", A=1, **direction(1, 0)), "WRONG"),
    "constant": (scalar("stable", A=0), "WRONG"),
    "constant in discrete time": (scalar("stable", A=1, discrete=True), "WRONG"),
    "stable in discrete time": (scalar("stable", A="1/2", discrete=True, decay="1/2"), "PROVED"),
    "neither continuous nor discrete": (scalar("stable", discrete=2), "UNREADABLE"),
    "v on the boundary": (slanted(), "WRONG"),
    "supply used up": (scalar("dissipative"), "PROVED"),
    "too little supply": (scalar("dissipative", r="0.999"), "WRONG"),
    "just enough supply": (typed("dissipative", r=ABOVE, q=MINUS_THIRD), "PROVED"),
    "too little by less than a rounding": (typed("dissipative", r=A_THIRD, q=MINUS_THIRD), "WRONG"),
    "supply that is not its own rounding": (typed("dissipative", r=("1/2", "1/3"), q=MINUS_THIRD), "WRONG"),
    "too much by less than a rounding": (
        typed("dissipative", "REFUTED", r=ABOVE, q=MINUS_THIRD, **direction(1, 1)),
        "WRONG",
    ),
    "just no supply": (typed("dissipative", "REFUTED", r=A_THIRD, q=MINUS_THIRD, **direction(1, 1)), "REFUTED"),
    "exact supply beside the data": (
        scalar("dissipative", q="-0x1.5555555555555p-2", r="0x1.5555555555555p-2", r_exact={"fractions": ["1/3"]}),
        "UNREADABLE",
    ),
    "no supply for a proof": (scalar("dissipative", r=None), "UNREADABLE"),
    "bound at an eighth of the largest": (leading(8, 1), "PROVED"),
    "bound at less than that entry": (leading(8, "1/4"), "WRONG"),
    "bound at the largest": (leading(9, "1/9"), "PROVED"),
    "bound at less than the largest": (leading(9, "1/10"), "WRONG"),
    "bound at generators as they stand": (leading(9, 1, leading=False), "PROVED"),
    "bound less at generators as they stand": (leading(9, "1/9", leading=False), "WRONG"),
    "bound at who knows what": (leading(9, 1, leading="yes"), "UNREADABLE"),
    "disturbance gain": (scalar("disturbance gain"), "PROVED"),
    "disturbance gain of another supply": (scalar("disturbance gain", q=-2, r=2, v=2), "WRONG"),
    "disturbance gains, the same": (two_inputs(["1/3", "1/3"]), "PROVED"),
    "disturbance gains, not quite the same": (two_inputs(["1/3", "0.33333333333333333"]), "WRONG"),
    "feedthrough needs supply": (scalar("dissipative", D=1), "WRONG"),
    "feedthrough has supply": (scalar("dissipative", D=1, r=2), "PROVED"),
    "zero is no witness": (scalar("stable", "REFUTED", A=1, **direction(0, 0)), "WRONG"),
    "a refutation with a rate": (scalar("stable", "REFUTED", A=0, decay=1, **direction(1, 0)), "WRONG"),
    "a refutation with no number as rate": (
        scalar("stable", "REFUTED", A=0, decay="nan", **direction(1, 0)),
        "REFUTED",
    ),
    "a refutation with a bound on rates": (limited("0x1.0p+0"), "WRONG"),
    "a refutation without a bound on rates": (limited("inf"), "REFUTED"),
    "a matrix of true rows": (shaped([True, 1]), "UNREADABLE"),
    "a matrix of one row": (shaped([1, 1]), "PROVED"),
    "a witness": (scalar("stable", "REFUTED", A=0, **direction(1, 0)), "REFUTED"),
    "a witness with input": (scalar("stable", "REFUTED", **direction(1, 2)), "WRONG"),
    "an input moves the state": (scalar("dissipative", "REFUTED", r=0, **direction(0, 1)), "REFUTED"),
    "an input gives supply": (scalar("dissipative", "REFUTED", r="0.1", **direction(0, 1)), "WRONG"),
    "an input costs supply": (scalar("dissipative", "REFUTED", B=0, r=-1, **direction(0, 1)), "REFUTED"),
    "an input does nothing": (scalar("dissipative", "REFUTED", B=0, r=0, **direction(0, 1)), "WRONG"),
    "no input, no state": (scalar("dissipative", "REFUTED", **direction(0, 0)), "WRONG"),
    "input although r is free": (scalar("dissipative", "REFUTED", r=None, **direction(0, 1)), "WRONG"),
    "grows in discrete time": (scalar("stable", "REFUTED", A=1, discrete=True, **direction(1, 0, 1)), "REFUTED"),
    "shrinks in discrete time": (scalar("stable", "REFUTED", A="1/2", discrete=True, **direction(1, 0, 0)), "WRONG"),
    "balanced nodes": (scalar("network", W=1), "PROVED"),
    "nodes at the rate that was asked for": (asked(1, claim="network", W=1), "PROVED"),
    "nodes a little below the rate that was asked for": (asked("1.0000001", claim="network", W=1), "WRONG"),
    "nodes at a rate that nobody asks for": (asked(-1, claim="network", W=1), "WRONG"),
    "nodes that grow, at any rate": (
        asked(1, "REFUTED", "network", A=-1, W=1, **flow(1, 1, 1)),
        "REFUTED",
    ),
    "nodes that decay, but not at the rate that was asked for": (
        asked("1.1", "REFUTED", "network", W=1, **{**flow(1, 1, 1), "rate": -1}),
        "WRONG",
    ),
    "nodes of their sizes": (sized(1, 1, 1), "PROVED"),
    "nodes without end": (sized(10**18, 1, 1), "UNREADABLE"),
    "nodes of sizes that cancel": (sized(1, 1, 2, -1, 0, -1), "UNREADABLE"),
    "nodes of part of a state": (sized("3/2", 1, 1), "UNREADABLE"),
    "own link closed": (closed(-1, q=0), "PROVED"),
    "own link closed, at the margin": (closed(2, q=0), "WRONG"),
    "own link closed, with feedthrough": (closed(-1, 1, q=0, **weights(1, 1)), "PROVED"),
    "own link that is singular": (closed(1, 1, q=0, **weights(1, 1)), "WRONG"),
    "own links closed, at the decay they leave": (closed_twice("104/31"), "PROVED"),
    "own links closed, at more": (closed_twice("3.355"), "WRONG"),
    "nodes out of balance": (scalar("network", W=2), "WRONG"),
    "contracting loop": (scalar("network", D="1/2", r="1.5", W="1/2", **weights(1, "1/2")), "PROVED"),
    "loop of gain one": (scalar("network", D=1, r=2, W="1/2", **weights("1/2", 1)), "WRONG"),
    "loop not examined": (scalar("network", D="1/2", r="1.5", W="1/2"), "UNREADABLE"),
    "loop without weight": (scalar("network", D="1/2", r="1.5", W="1/2", **weights(-1, "-1/2")), "WRONG"),
    "growing network": (scalar("network", "REFUTED", A=-1, W=1, **flow(1, 1, 1)), "REFUTED"),
    "more input than arrives": (scalar("network", "REFUTED", A=-2, W=1, **flow(1, 2, 1)), "WRONG"),
    "more output than there is": (scalar("network", "REFUTED", A=-2, W=1, **flow(1, 2, 2)), "WRONG"),
    "at rest": (scalar("network", "REFUTED", A=-1, W=1, **flow(0, 0, 0)), "WRONG"),
    "growing behind a loop": (
        scalar("network", "REFUTED", A=-1, D="1/2", W=1, **flow(1, 2, 2), **weights(2, 1)),
        "REFUTED",
    ),
    "behind a loop of gain one": (
        scalar("network", "REFUTED", A=-1, D=1, W=1, **flow(1, 1, 1), **weights(1, 1)),
        "WRONG",
    ),
    "weight too small for D": (scalar("network", "REFUTED", D=2, W=0, A=1, **flow(1, 0, 0), **weights(1, 1)), "WRONG"),
    "weight with room": (scalar("network", "REFUTED", D=1, W=0, A=1, **flow(1, 0, 0), **weights(1, 2)), "REFUTED"),
    "growing system": (scalar("stable", "REFUTED", A=1, **flow(1, 0, 0)), "UNREADABLE"),
    "loop": (scalar("network", "REFUTED", D=1, W=1, **flow(0, 1, 1, "loop")), "REFUTED"),
    "weak loop": (scalar("network", "REFUTED", D="1/2", W=1, **flow(0, 1, 1, "loop")), "WRONG"),
    "loop without outputs": (scalar("network", "REFUTED", D=1, W=1, **flow(0, 0, 0, "loop")), "WRONG"),
    "loop and state": (scalar("network", "REFUTED", D=1, W=1, **flow(1, 1, 1, "loop")), "WRONG"),
    "node with too little supply": (scalar("network", "REFUTED", W=0, r=0, **direction(0, 1)), "REFUTED"),
    "supply in excess": (scalar("network", "REFUTED", W=2, **flow(0, 0, 1, "weights")), "REFUTED"),
    "supply used up exactly": (scalar("network", "REFUTED", W=1, **flow(0, 0, 1, "weights")), "WRONG"),
    "outputs outside": (scalar("network", "REFUTED", W="-2", q=3, **flow(0, 0, -1, "weights")), "WRONG"),
    "outputs and inputs": (scalar("network", "REFUTED", W=2, **flow(0, 1, 1, "weights")), "WRONG"),
    "one node in excess, one at rest": (two_nodes([0, -1], [1, 1], [1, 0]), "REFUTED"),
    "one node in excess, one in need": (two_nodes([-1, -1], [1, 1], [1, 0]), "WRONG"),
    "no supply rate": (scalar("dissipative", q=None), "UNREADABLE"),
    "all parts": (feedback(scalar("stable"), scalar("positive")), "PROVED"),
    "a part that is not": (feedback(scalar("stable"), scalar("stable", A=1)), "WRONG"),
    "a part refuted": (feedback(scalar("stable"), scalar("stable", "REFUTED", A=0, **direction(1, 0))), "WRONG"),
    "all parts, refuted": (feedback(scalar("stable"), status="REFUTED"), "WRONG"),
    "no parts": (feedback(), "WRONG"),
    "gain at its bound": (bound(["-3"], [3]), "PROVED"),
    "gain above its bound": (bound(["3.1"], [3]), "WRONG"),
    "gain below its bound": (bound(["-3.1"], [3]), "WRONG"),
    "no gain, negative bound": (bound([0], [-1]), "WRONG"),
    "no gain, bound zero": (bound([0], [0]), "PROVED"),
    "gain refuted": (bound([1], [3], "REFUTED"), "WRONG"),
    "family": (family([-1, -2]), "PROVED"),
    "family with one unstable": (family([-1, 0]), "WRONG"),
    "family without vector": (family([1, 2], v=None), "PROVED"),
    "common vector with its rate": (common([-1, -2], "0x1p+0", "1"), "PROVED"),
    "common vector, a rate beyond": (common([-1, -2], "0x1p+1"), "WRONG"),
    "common vector, a required rate beyond": (common([-1, -2], "0x0p+0", "3/2"), "WRONG"),
    "common vector, a rate below 0": (common([-1, -2], "-0x1p+0"), "WRONG"),
    "common vector without vector": (family([1, 2], v=None, claim="common vector"), "WRONG"),
    "family with a proof missing": (family([-1, -2], proofs=[None]), "UNREADABLE"),
    "empty family": (family([]), "UNREADABLE"),
    "one of a family leaves": (family([2, -1], discrete=True, status="REFUTED", **crossing(1)), "REFUTED"),
    "another of the family leaves": (family([2, -1], discrete=True, status="REFUTED", **crossing(0)), "WRONG"),
    "none of the family": (family([2, -1], discrete=True, status="REFUTED", **crossing(2)), "UNREADABLE"),
    "no cone": (family([2, -1], "invariant-cone", True, "REFUTED", **crossing(1)), "WRONG"),
    "undecided": (scalar("stable", "UNDECIDED"), "WRONG"),
    "without proof": (scalar("stable", omitted="too long"), "UNREADABLE"),
    "another claim": (scalar("lovely"), "UNREADABLE"),
}


def with_cone(*counts):
    out = scalar("positive")
    n = sum(x for x in counts if isinstance(x, int))
    out["data"] |= {
        "X": {"cone": [[count, HALF["cone"][0][1]] for count in counts]},
        "A": {"sparse": [], "shape": [n, n]},
    }
    return {**out, "data": {**out["data"], "B": None, "C": None, "D": None, "U": None, "Y": None}}


SIZES = [  # cone, limit, outcome
    (with_cone(3), 3, "PROVED"),
    (with_cone(3), 2, "UNREADABLE"),
    (with_cone(2, 2), 4, "PROVED"),
    (with_cone(2, 2), 3, "UNREADABLE"),
    (with_cone(3, 1), 3, "UNREADABLE"),
    (with_cone(0), 3, "UNREADABLE"),
    (with_cone(True), 3, "UNREADABLE"),
    (with_cone(1, 0), 3, "UNREADABLE"),
]
