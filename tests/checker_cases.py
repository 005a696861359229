"""Tiny certificate files by hand, with nothing between right and wrong: for every claim, true and just not true."""

from fractions import Fraction

# -- scalar systems on half-lines

HALF = {"cone": [[1, {"rays": [[1]]}]]}


def scalar(claim, status="PROVED", *, A=-2, B=1, C=1, D=0, v=1, q=-1, r=1, decay=0, W=None, discrete=False, **proof):
    data = {name: {"matrix": [[x]]} for name, x in zip("ABCD", (A, B, C, D), strict=True)}
    data |= dict.fromkeys("XUY", HALF) | {"discrete": discrete, "witness": proof.pop("witness", None)}
    v = v if status == "PROVED" else None
    vectors = {name: None if x is None else {"array": [double(x)]} for name, x in (("v", v), ("q", q), ("r", r))}
    data |= {name: vectors[name] for name in HAS[claim]}
    data |= {"decay_rate": {"double": double(decay)}} if claim in ("stable", "dissipative", "network") else {}
    if W is not None:
        data |= {"W": {"matrix": [[W]]}, "loop_weights": proof.pop("loop_weights", None)}
        kept = status == "PROVED" or data["witness"]["record"] in ("NodeNotDissipative", "NoWeights")
        data |= {} if kept else dict.fromkeys("vqr")
        return with_nodes({"claim": claim, "status": status, "data": data, "proof": proof}, [1, 1, 1])
    return {"claim": claim, "status": status, "data": data, "proof": proof}


def double(x):
    """The double next to a number, as files have it."""
    return x if isinstance(x, int) or x in ("nan", "inf") or "0x" in x else float(Fraction(x)).hex()


# the vectors that belong to a claim
HAS = {
    "positive": "",
    "stable": "v",
    "lovely": "",
    "structured gain": "",
    "network": "vqr",
    "network abscissa": "vqr",
    "network interval": "vqr",
    "network observer": "vqr",
}
HAS |= dict.fromkeys(("dissipative", "disturbance gain", "common vector"), "vqr")


def with_nodes(out, *nodes):
    """The network of nodes of these sizes, on orthants."""
    data = out["data"]
    half = HALF["cone"][0][1]
    kinds = [{"tuple": [{"cone": [[n, half]] if n else []} for n in node]} for node in nodes]
    data |= {"sizes": {"array": [list(node) for node in nodes]}, "stack": {"array": list(range(len(nodes)))}}
    data |= {"cones": {"tuple": kinds}, "names": None, "dt": int(data["discrete"])}
    data |= {name: {"cone": [[sum(n), half]]} for name, n in zip("XUY", zip(*nodes, strict=True), strict=True)}
    data |= {"sigma": {"array": [1] * len(nodes)}} if data.get("v") and out["claim"] == "network" else {}
    return out


def nothing(m, n):
    """A matrix of zeros."""
    return {"sparse": [], "shape": [m, n]}


def asked(required, status="PROVED", claim="stable", **more):
    out = scalar(claim, status, **more)
    out["data"]["required_rate"] = {"fraction": required}
    return out


def limited(bound):
    out = scalar("stable", "REFUTED", A=0, **direction(1))
    out["data"]["decay_rate_bound"] = {"double": bound}
    return out


def shaped(shape):
    out = scalar("stable")
    out["data"]["A"] = {"sparse": [[0, 0, -2]], "shape": shape}
    return out


def shown(record, **fields):
    """A witness of numbers."""
    values = {name: {"array": [x] if isinstance(x, (int, str)) else x} for name, x in fields.items() if name in "xuy"}
    return {"record": record, "fields": {**values, **{k: x for k, x in fields.items() if k not in values}}}


def direction(x, rate=0, **more):
    """A state that does not decay, or (rate) no faster than this."""
    slow = {"rate": {"double": double(rate)}} if rate else {}
    return {"witness": shown("SlowDirection" if rate else "InstabilityDirection", x=x, **slow), **more}


def moved(x, u, node=None, **more):
    """A state and an input without supply, of a system or of a node."""
    found = shown("SupplyViolation", x=x, u=u)
    return {"witness": found if node is None else shown("NodeNotDissipative", node=node, violation=found), **more}


def flow(x, u, y, rate=0, **more):
    return {"witness": shown("NetworkInstability", x=x, u=u, y=y, rate={"double": double(rate)}), **more}


def circle(u, y, **more):
    return {"witness": shown("AlgebraicLoop", u=u, y=y), **more}


def surplus(y, **more):
    return {"witness": shown("NoWeights", y=y), **more}


def sized(*sizes):
    """A network that says how many states, inputs and outputs its nodes have."""
    out = scalar("network", W=1)
    out["data"]["sizes"] = {"array": [list(sizes[k : k + 3]) for k in range(0, len(sizes), 3)]}
    return out


def closed(W, D=0, **more):
    """A node with a link to itself that is closed first."""
    out = scalar("network", W=W, D=D, **more)
    out["data"]["own_links_closed"] = True
    return out


def closed_twice(decay):
    """A node of two ports, with (I - W D)^-1 = [[16, 4], [2, 16]] / 31, and as much decay and supply as there is."""
    out, one = with_nodes(closed(0), [2, 2, 2]), {"matrix": [[1, 0], [0, 1]]}
    out["data"] |= dict.fromkeys("BCD", one) | {"A": {"matrix": [[-3, 0], [0, -3]]}}
    out["data"] |= {"W": {"matrix": [[-1, "0.5"], ["0.25", -1]]}, "decay_rate": {"double": double(decay)}}
    exact = [{"fractions": [1, 1]}, {"fractions": ["18/31", "20/31"]}, {"fractions": [0, 0]}]
    rounded = {"array": [(18 / 31).hex(), (20 / 31).hex()]}
    out["data"] |= {"v": {"array": [1, 1]}, "q": {"array": [0, 0]}, "r": rounded, "exact": {"tuple": exact}}
    out["data"]["loop_weights"] = {"tuple": exact[:2]}
    return out


def changed(content, **data):
    """The file with other data."""
    return {**content, "data": {**content["data"], **data}}


TWICE = {"cone": [[1, {"rays": [[2]]}]]}


def kinds(*cones):
    return changed(scalar("network", W=1), cones={"tuple": list(cones)})


def leaving(A=-1):
    """Two nodes of one state each in discrete time, of which the first is said to leave its cone."""
    violation = shown("PositivityViolation", condition="A X in X", ray=0)
    witness = shown("NodeViolation", node=0, violation=violation)
    out, zero = scalar("network", "REFUTED", W=0, discrete=True, witness=witness), {"matrix": [[0, 0], [0, 0]]}
    out["data"] |= dict.fromkeys("BCDW", zero) | {"A": {"matrix": [[A, 0], [0, A]]}}
    return with_nodes(out, [1, 1, 1], [1, 1, 1])


def extended():
    out = scalar("stable", "REFUTED", A=0, **direction(1))
    out["data"]["witness"]["fields"]["more"] = 1
    return out


def weights(p, t):
    return {"loop_weights": {"tuple": [{"fractions": [p]}, {"fractions": [t]}]}}


def two_nodes(q, r, y):
    """Nodes that do nothing, the output of the first linked to the second."""
    out, zero = scalar("network", "REFUTED", W=0, **surplus(y)), {"matrix": [[0, 0], [0, 0]]}
    out["data"] |= dict.fromkeys("ABCD", zero) | {"W": {"matrix": [[0, 0], [1, 0]]}, "v": None}
    out["data"] |= {"q": {"array": [q[:1], q[1:]]}, "r": {"tuple": [{"array": r[:1]}, {"array": r[1:]}]}}
    return with_nodes(out, [1, 1, 1], [1, 1, 1])


def feedback(*loops, status="PROVED", others=()):
    kinds = {"loops": loops, "others": others}
    data = {name: {"tuple": [{"certificate": part} for part in parts]} for name, parts in kinds.items()}
    return {"claim": "feedback", "status": status, "data": data, "proof": {}}


def bound(F, b, status="PROVED"):
    data = {"X": HALF, "F": {"matrix": [[x] for x in F]}, "bound": {"array": b}}
    return {"claim": "gain bound", "status": status, "data": data, "proof": {}}


def leading(top, b, **more):
    """x_1 is bounded at generators (1, top) and (0, 1) with a leading entry of 1."""
    out = bound([], [b])
    out["data"] |= {
        "X": {"cone": [[1, {"rays": [[1, top], [0, 1]]}]]},
        "F": {"matrix": [[1, 0]]},
        "leading": True,
        **more,
    }
    return out


def family(matrices, claim="differentially-positive", discrete=False, status="PROVED", v=1, proofs=None, **proof):
    data = {"A": {"tuple": [{"matrix": [[a]]} for a in matrices]}, "X": HALF, "discrete": discrete}
    data |= {"v": None if v is None or status == "REFUTED" else {"array": [v]}, "witness": proof.pop("witness", None)}
    proofs = [None] * len(matrices) if proofs is None else proofs
    return {"claim": claim, "status": status, "data": data, "proof": {"P": proofs, **proof}}


def common(matrices, rate, required=None):
    out = family(matrices, "common vector")
    out["data"] |= {"decay_rate": {"double": rate}}
    out["data"] |= {} if required is None else {"required_rate": {"fraction": required}}
    return out


def jacobian(A, radius=0, point=None):
    """A Jacobian that takes the generator out of the half-line."""
    point = None if point is None else {"array": [point]}
    fields = {"centre": {"array": [[A]]}, "radius": {"array": [[radius]]}, "ray": 0, "point": point}
    return {"record": "DifferentialViolation", "fields": fields}


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
    out = scalar(claim, status, A=-1, v=r[0], q=q[0], r=r[0], **more)
    out["data"] |= {"q_exact": {"fractions": [q[1]]}, "r_exact": {"fractions": [r[1]]}}
    out["data"] |= {"v_exact": {"fractions": [r[1]]}} if status == "PROVED" else {}
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
    "at a negative rate": (scalar("stable", decay=-1), "UNREADABLE"),
    "at the rate that was asked for": (asked(2), "PROVED"),
    "a little below the rate that was asked for": (asked("2.0000001"), "WRONG"),
    "a rate that nobody asks for": (asked(-1), "UNREADABLE"),
    "no rate at all": (asked(0), "UNREADABLE"),
    "not at the rate that was asked for": (asked("2.1", "REFUTED", **direction(1, 2)), "REFUTED"),
    "only at the rate that was asked for": (asked(2, "REFUTED", **direction(1, 2)), "WRONG"),
    "at that rate with something left": (asked("2.5", "REFUTED", **direction(1, "2.5")), "REFUTED"),
    "a motion that is too fast": (asked("2.1", "REFUTED", **direction(1, "2.2")), "WRONG"),
    "not even stable, at any rate": (asked(1, "REFUTED", A=1, **direction(1)), "REFUTED"),
    "only at a rate that nobody states": (
        scalar("stable", "REFUTED", required_rate={"fraction": "2.1"}, **direction(1, 2)),
        "WRONG",
    ),
    "unstable, at a rate that nobody asks for": (asked(-1, "REFUTED", A=1, **direction(1)), "UNREADABLE"),
    "constant": (scalar("stable", A=0), "WRONG"),
    "constant in discrete time": (scalar("stable", A=1, discrete=True), "WRONG"),
    "stable in discrete time": (scalar("stable", A="1/2", discrete=True, decay="1/2"), "PROVED"),
    "neither continuous nor discrete": (scalar("stable", discrete=2), "UNREADABLE"),
    "v on the boundary": (slanted(), "WRONG"),
    "supply used up": (scalar("dissipative"), "PROVED"),
    "too little supply": (scalar("dissipative", r="0.999"), "WRONG"),
    "just enough supply": (typed("dissipative", r=ABOVE, q=MINUS_THIRD), "PROVED"),
    "too little by less than a rounding": (typed("dissipative", r=A_THIRD, q=MINUS_THIRD), "WRONG"),
    "supply that is not its own rounding": (typed("dissipative", r=("1/2", "1/3"), q=MINUS_THIRD), "UNREADABLE"),
    "too much by less than a rounding": (
        typed("dissipative", "REFUTED", r=ABOVE, q=MINUS_THIRD, **moved(1, 1)),
        "WRONG",
    ),
    "just no supply": (typed("dissipative", "REFUTED", r=A_THIRD, q=MINUS_THIRD, **moved(1, 1)), "REFUTED"),
    "exact supply beside the data": (
        scalar("dissipative", A=-1, v=A_THIRD[0], q="-0.3", r="0.3", r_exact={"fractions": ["1/3"]}),
        "WRONG",
    ),
    "no supply for a proof": (scalar("dissipative", r=None), "UNREADABLE"),
    "bound at an eighth of the largest": (leading(8, 1), "PROVED"),
    "bound at less than that entry": (leading(8, "1/4"), "WRONG"),
    "bound at the largest": (leading(16, "1/16"), "PROVED"),
    "bound at less than the largest": (leading(16, "0x1.fp-5"), "WRONG"),
    "bound at generators as they stand": (leading(9, 1, leading=False), "PROVED"),
    "bound less at generators as they stand": (leading(16, "1/16", leading=False), "WRONG"),
    "bound just above an eighth": (leading(9, "0x1.dp-4"), "PROVED"),
    "bound at who knows what": (leading(9, 1, leading="yes"), "UNREADABLE"),
    "no gain at who knows what": (leading(9, 1, leading="yes", F={"matrix": [[0, 0]]}), "UNREADABLE"),
    "no gain at leading entries": (leading(9, 0, F={"matrix": [[0, 0]]}), "PROVED"),
    "disturbance gain": (scalar("disturbance gain"), "PROVED"),
    "disturbance gain of another supply": (scalar("disturbance gain", q=-2, r=2, v=2), "UNREADABLE"),
    "disturbance gains, the same": (two_inputs(["1/3", "1/3"]), "PROVED"),
    "disturbance gains, not quite the same": (two_inputs(["1/3", "0.33333333333333333"]), "UNREADABLE"),
    "feedthrough needs supply": (scalar("dissipative", D=1), "WRONG"),
    "feedthrough has supply": (scalar("dissipative", D=1, r=2), "PROVED"),
    "zero is no witness": (scalar("stable", "REFUTED", A=1, **direction(0)), "WRONG"),
    "a refutation with a rate": (scalar("stable", "REFUTED", A=0, decay=1, **direction(1)), "WRONG"),
    "a refutation with no number as rate": (
        scalar("stable", "REFUTED", A=0, decay="nan", **direction(1)),
        "REFUTED",
    ),
    "a refutation with a bound on rates": (limited("0x1.0p+0"), "WRONG"),
    "a refutation without a bound on rates": (limited("inf"), "REFUTED"),
    "a matrix of true rows": (shaped([True, 1]), "UNREADABLE"),
    "a matrix of one row": (shaped([1, 1]), "PROVED"),
    "a witness": (scalar("stable", "REFUTED", A=0, **direction(1)), "REFUTED"),
    "an input moves the state": (scalar("dissipative", "REFUTED", r=0, **moved(0, 1)), "REFUTED"),
    "an input gives supply": (scalar("dissipative", "REFUTED", r="0.1", **moved(0, 1)), "WRONG"),
    "an input costs supply": (scalar("dissipative", "REFUTED", B=0, r=-1, **moved(0, 1)), "REFUTED"),
    "an input does nothing": (scalar("dissipative", "REFUTED", B=0, r=0, **moved(0, 1)), "WRONG"),
    "no input, no state": (scalar("dissipative", "REFUTED", **moved(0, 0)), "WRONG"),
    "input although r is free": (scalar("dissipative", "REFUTED", r=None, **moved(0, 1)), "WRONG"),
    "grows in discrete time": (scalar("stable", "REFUTED", A=1, discrete=True, **direction(1)), "REFUTED"),
    "shrinks in discrete time": (scalar("stable", "REFUTED", A="1/2", discrete=True, **direction(1, 1)), "WRONG"),
    "balanced nodes": (scalar("network", W=1), "PROVED"),
    "nodes at the rate that was asked for": (asked(1, claim="network", W=1), "PROVED"),
    "nodes a little below the rate that was asked for": (asked("1.0000001", claim="network", W=1), "WRONG"),
    "nodes at a rate that nobody asks for": (asked(-1, claim="network", W=1), "UNREADABLE"),
    "nodes that grow, at any rate": (
        asked(1, "REFUTED", "network", A=-1, W=1, **flow(1, 1, 1)),
        "REFUTED",
    ),
    "nodes that decay, but not at the rate that was asked for": (
        asked("1.1", "REFUTED", "network", W=1, **flow(1, 1, 1, -1)),
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
    "own links closed, at the decay they leave": (closed_twice("3.3548387"), "PROVED"),
    "own links closed, at more": (closed_twice("3.355"), "WRONG"),
    "nodes without a time base": (changed(scalar("network", W=1), dt=None), "PROVED"),
    "nodes in another time": (changed(scalar("network", W=1), dt=1), "UNREADABLE"),
    "nodes in backward time": (changed(scalar("network", A=0, W=0, q=0, discrete=True), dt=-1), "UNREADABLE"),
    "nodes of half a kind": (changed(scalar("network", W=1), stack={"array": ["0x1.0p-1"]}), "UNREADABLE"),
    "nodes of two kinds each": (changed(scalar("network", W=1), stack={"array": [0, 0]}), "UNREADABLE"),
    "nodes with a fourth cone": (kinds({"tuple": [{"cone": []}] * 4}), "UNREADABLE"),
    "nodes of a kind that there is not": (kinds({"tuple": [HALF] * 3}, {"tuple": [HALF] * 3}), "UNREADABLE"),
    "nodes with other cones": (kinds({"tuple": [TWICE, HALF, HALF]}), "UNREADABLE"),
    "a node that leaves": (leaving(), "REFUTED"),
    "a node that does not leave": (leaving(1), "WRONG"),
    "an entry that nobody knows": (changed(scalar("stable"), more=1), "UNREADABLE"),
    "an entry that nobody knows in a witness": (extended(), "UNREADABLE"),
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
    "loop": (scalar("network", "REFUTED", D=1, W=1, **circle(1, 1)), "REFUTED"),
    "weak loop": (scalar("network", "REFUTED", D="1/2", W=1, **circle(1, 1)), "WRONG"),
    "loop without outputs": (scalar("network", "REFUTED", D=1, W=1, **circle(0, 0)), "WRONG"),
    "node with too little supply": (scalar("network", "REFUTED", W=0, r=0, **moved(0, 1, 0)), "REFUTED"),
    "supply in excess": (scalar("network", "REFUTED", W=2, **surplus(1)), "REFUTED"),
    "supply used up exactly": (scalar("network", "REFUTED", W=1, **surplus(1)), "WRONG"),
    "outputs outside": (scalar("network", "REFUTED", W="-2", q=3, **surplus(-1)), "WRONG"),
    "one node in excess, one at rest": (two_nodes([0, -1], [1, 1], [1, 0]), "REFUTED"),
    "one node in excess, one in need": (two_nodes([-1, -1], [1, 1], [1, 0]), "WRONG"),
    "no supply rate": (scalar("dissipative", q=None), "UNREADABLE"),
    "all parts": (feedback(scalar("stable"), others=[scalar("positive")]), "PROVED"),
    "a part that is not": (feedback(scalar("stable"), scalar("stable", A=1)), "WRONG"),
    "a part refuted": (feedback(scalar("stable"), scalar("stable", "REFUTED", A=0, **direction(1))), "WRONG"),
    "all parts, refuted": (feedback(scalar("stable"), status="REFUTED"), "WRONG"),
    "no parts": (feedback(), "UNREADABLE"),
    "gain at its bound": (bound(["-3"], [3]), "PROVED"),
    "gain above its bound": (bound(["3.1"], [3]), "WRONG"),
    "gain below its bound": (bound(["-3.1"], [3]), "WRONG"),
    "no gain, negative bound": (bound([0], [-1]), "WRONG"),
    "no gain, bound zero": (bound([0], [0]), "PROVED"),
    "gain refuted": (bound([1], [3], "REFUTED"), "WRONG"),
    "family": (family([-1, -2]), "PROVED"),
    "family with one unstable": (family([-1, 0]), "WRONG"),
    "family without vector": (family([1, 2], v=None), "PROVED"),
    "common vector with its rate": (common([-1, -2], 1, "1"), "PROVED"),
    "common vector, a rate beyond": (common([-1, -2], 2), "WRONG"),
    "common vector, a required rate beyond": (common([-1, -2], 0, "3/2"), "WRONG"),
    "common vector, a rate below 0": (common([-1, -2], -1), "UNREADABLE"),
    "common vector without vector": (family([1, 2], v=None, claim="common vector"), "UNREADABLE"),
    "family with a proof missing": (family([-1, -2], proofs=[None]), "UNREADABLE"),
    "empty family": (family([]), "UNREADABLE"),
    "one of a family leaves": (family([2, -1], discrete=True, status="REFUTED", witness=jacobian(-1)), "REFUTED"),
    "another of the family leaves": (family([2, -1], discrete=True, status="REFUTED", witness=jacobian(2)), "WRONG"),
    "none of the family": (family([2, -1], discrete=True, status="REFUTED", witness=jacobian(3)), "WRONG"),
    "no cone": (family([2, -1], "invariant-cone", True, "REFUTED", witness=jacobian(-1)), "UNREADABLE"),
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
