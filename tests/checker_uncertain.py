"""Tiny certificate files by hand about networks with vertices, true and just not true."""

from checker_cases import double, nothing, scalar, shown, with_nodes


def vertex(A=-3, B=1, C=1, D=0):
    return {"tuple": [{"matrix": [[x]]} for x in (A, B, C, D)]}


def vertices(*others, decay=1, W=1, **more):
    """x' = -2 x + u, y = x, u = W y with v = 1, q = -1, r = 1, or another first vertex, and others."""
    out = scalar("network", W=W, decay=decay, **more) | {"claim": "uncertain network"}
    out["data"].pop("sigma", None)
    out["data"]["vertices"] = {"tuple": list(others)}
    return out


def ranges(lower=(-3, 0, 0, 0, 0), *others, **more):
    """The same with lower ends of A, B, C, D and W."""
    out = vertices(*others, **more)
    out["data"]["lower"] = {"tuple": [{"matrix": [[x]]} for x in lower]}
    return out


def beneath(inner, lower, *others):
    out = against({"record": "FailingEnd", "fields": {"witness": inner}}, *others)
    out["data"]["lower"] = {"tuple": [{"matrix": [[x]]} for x in lower]} if lower else None
    return out


def against(witness, *others, **more):
    """A witness in the place of v, q, r."""
    return vertices(*others, decay=0, status="REFUTED", **{"witness": witness} | more)


def member(choice, inner, *others, **more):
    fields = {"choice": {"array": choice}, "witness": inner}
    return against({"record": "FailingMember", "fields": fields}, *others, **more)


def grows(x=1, u=1, y=1, rate=0):
    return shown("NetworkInstability", x=x, u=u, y=y, rate={"double": double(rate)})


def parted(x, u, y, kind="NoCommonStorage"):
    fields = {name: {"array": list(part)} for name, part in (("x", x), ("u", u), ("y", y))}
    return {"record": kind, "fields": fields}


def crossed(x=(1, 1, 0, 0), u=(1, 0, 0, 1), y=(1, 1), b=1, W=1, D=0, kind="NoCommonStorage", looping=False, **more):
    """p' = -p + b1 u1, q' = -q + b2 u2, u = W (q, p): (b1, b2) is (b, 0) or (0, b)."""
    bound = more.pop("bound", parted((1, 0, 0, 1) if any(x) else x, (1, 0, 0, 1), (1, 1)))
    fields = {"storage": parted(x, u, y, kind), "bound": bound}
    out = against({"record": more.pop("both", "NoCommonVectors"), "fields": fields}, **more)
    out = with_nodes(out, [2, 2, 2])
    data = out["data"]
    one = {"matrix": [[1, 0], [0, 1]]}
    data |= {"A": {"matrix": [[-1, 0], [0, -1]]}, "B": {"matrix": [[b, 0], [0, 0]]}, "C": one, "D": nothing(2, 2)}
    data |= {"W": {"matrix": [[0, W], [W, 0]]}}
    data |= {"D": {"matrix": [[D, 0], [0, 0]]}} if looping else {}
    second = {"matrix": [[0, 0], [0, b]]}, one, {"matrix": [[0 if looping else D, 0], [0, D]]}
    data["vertices"] = {"tuple": [{"tuple": [data["A"], *second]}]}
    return out


def still():
    """Nothing moves."""
    nothing = (0, 0, 0, 0), (0, 0, 0, 0), (0, 0)
    return crossed(*nothing, bound=parted(*nothing))


def stepped(b, x=2):
    """p+ = p / 2 + b1 u1 and so on."""
    out = crossed(b=b, bound=parted((x, 0, 0, x), (1, 0, 0, 1), (1, 1)))
    half = {"matrix": [["1/2", 0], [0, "1/2"]]}
    out["data"] |= {"A": half, "discrete": True, "dt": 1}
    out["data"]["vertices"]["tuple"][0]["tuple"][0] = half
    return out


def closed(out):
    out["data"]["own_links_closed"] = True
    return out


LOOP = {"tuple": [{"array": [3]}, {"array": [2]}]}
NEGATIVE = {
    "record": "NodeViolation",
    "fields": {
        "node": 0,
        "violation": {
            "record": "PositivityViolation",
            "fields": {"condition": "B U in X", "ray": 0},
        },
    },
}
LEAVING = {"record": "CouplingViolation", "fields": {"source": 0, "target": 0, "ray": 0}}
CASES = {
    "vertices, a mixture in steps": (stepped("1/2"), "REFUTED"),
    "vertices, a mixture in steps that falls": (stepped("1/4", 4), "WRONG"),
    "ranges": (ranges(), "PROVED"),
    "ranges of nothing": (ranges((-2, 1, 1, 0, 1)), "PROVED"),
    "ranges and vertices": (ranges((-3, 0, 0, 0, 0), vertex()), "PROVED"),
    "ranges turned around": (ranges((-1, 0, 0, 0, 0)), "WRONG"),
    "ranges of inputs turned around": (ranges((-3, 2, 0, 0, 0)), "WRONG"),
    "ranges of outputs turned around": (ranges((-3, 0, 2, 0, 0)), "WRONG"),
    "ranges of direct terms turned around": (ranges((-3, 0, 0, 1, 0)), "WRONG"),
    "ranges of links turned around": (ranges((-3, 0, 0, 0, 2)), "WRONG"),
    "ranges below 0": (ranges((-3, -1, 0, 0, 0)), "WRONG"),
    "ranges of outputs below 0": (ranges((-3, 0, -1, 0, 0)), "WRONG"),
    "ranges of links below 0": (ranges((-3, 0, 0, 0, -1)), "WRONG"),
    "ranges with q above 0": (ranges((-3, 0, 0, 0, 0), A=-3, B=0, C=0, W=0, q=1, r=0, decay=0), "WRONG"),
    "ranges with q of 0": (ranges((-3, 0, 0, 0, 0), A=-3, B=0, C=0, W=0, q=0, r=0, decay=0), "PROVED"),
    "ranges without links": (ranges((-3, 0, 0, 0)), "UNREADABLE"),
    "lower ends that leave the cones": (beneath(LEAVING, (-3, 0, 0, 0, -1)), "REFUTED"),
    "lower ends that do not": (beneath(LEAVING, (-3, 0, 0, 0, 1)), "WRONG"),
    "lower ends of inputs": (beneath(NEGATIVE, (-3, -1, 0, 0, 0)), "REFUTED"),
    "lower ends that are not there": (beneath(LEAVING, None), "UNREADABLE"),
    "vertices": (vertices(vertex()), "PROVED"),
    "vertices, one": (vertices(), "PROVED"),
    "vertices, as slow as the first": (vertices(vertex(-2)), "PROVED"),
    "vertices, slower than is stated": (vertices(vertex("-1.9")), "WRONG"),
    "vertices, slower": (vertices(vertex("-1.5"), decay="0.5"), "PROVED"),
    "vertices, a third one": (vertices(vertex(), vertex(-9)), "PROVED"),
    "vertices, a third one that grows": (vertices(vertex(), vertex(1)), "WRONG"),
    "vertices, more input": (vertices(vertex(B=2)), "WRONG"),
    "vertices, more output": (vertices(vertex(C="2.1")), "WRONG"),
    "vertices, as much output as can be": (vertices(vertex(C=2)), "PROVED"),
    "vertices, not positive": (vertices(vertex(B=-1)), "WRONG"),
    "vertices, output below 0": (vertices(vertex(C=-1)), "WRONG"),
    "vertices, link below 0": (vertices(vertex(), W=-1), "WRONG"),
    "vertices, direct term without weights": (vertices(vertex(B=0, D="1/2")), "UNREADABLE"),
    "vertices, direct term": (vertices(vertex(B=0, D="1/2"), loop_weights=LOOP), "PROVED"),
    "vertices, direct term of gain 1": (vertices(vertex(B=0, D=1), loop_weights=LOOP), "WRONG"),
    "vertices, three matrices": (vertices({"tuple": vertex()["tuple"][:3]}), "UNREADABLE"),
    "vertices of another size": (
        vertices({"tuple": [{"matrix": [[-3, 0], [0, -3]]}, *vertex()["tuple"][1:]]}),
        "UNREADABLE",
    ),
    "vertices with links closed": (closed(vertices(vertex())), "UNREADABLE"),
    "a member that grows": (member([1], grows(), vertex(0)), "REFUTED"),
    "a member on the margin": (member([1], grows(), vertex(-1)), "REFUTED"),
    "a member that decays": (member([1], grows(), vertex("-1.1")), "WRONG"),
    "another member": (member([0], grows(), vertex(0)), "WRONG"),
    "no such member": (member([2], grows(), vertex(0)), "UNREADABLE"),
    "half a member": (member(["0x1.0p-1"], grows(), vertex(0)), "UNREADABLE"),
    "a member too many": (member([1, 1], grows(), vertex(0)), "UNREADABLE"),
    "a member that does not move": (member([1], grows(x=0, u=0, y=0), vertex(0)), "WRONG"),
    "a member at a rate below 0": (member([1], grows(rate=-1), vertex(-2)), "WRONG"),
    "a member that is not positive": (member([1], NEGATIVE, vertex(B=-1)), "REFUTED"),
    "a member that is positive": (member([0], NEGATIVE, vertex(B=-1)), "WRONG"),
    "a member with a loop": (member([1], shown("AlgebraicLoop", u=1, y=1), vertex(D=1)), "REFUTED"),
    "a member with a loop of less gain": (member([1], shown("AlgebraicLoop", u=1, y=1), vertex(D="1/2")), "WRONG"),
    "a mixture that grows": (crossed(), "REFUTED"),
    "a mixture that grows faster": (crossed(b="1.5"), "REFUTED"),
    "a mixture that decays": (crossed(b="0.9"), "WRONG"),
    "a mixture of weaker links": (crossed(W="0.9"), "WRONG"),
    "a mixture that does not move": (still(), "WRONG"),
    "a mixture with an input below 0": (crossed(u=(2, -1, -1, 2)), "WRONG"),
    "a mixture outside of X": (crossed(x=(2, 1, -1, 0)), "WRONG"),
    "a mixture with more input than links bring": (crossed(u=(2, 0, 0, 2)), "WRONG"),
    "a mixture with more output than there is": (crossed(y=(2, 2)), "WRONG"),
    "a mixture of other lengths": (crossed(x=(1, 1, 0)), "UNREADABLE"),
    "a mixture with direct terms": (crossed(D="1/2"), "REFUTED"),
    "a mixture with a loop": (crossed((0, 0, 0, 0), D=1, looping=True), "REFUTED"),
    "a mixture with a loop of less gain": (crossed((0, 0, 0, 0), D="1/2", looping=True), "WRONG"),
    "a mixture with outputs below 0": (
        crossed((0, 0, 0, 0), (-1, 0, 0, -1), (-1, -1), D=1, looping=True),
        "WRONG",
    ),
    "a mixture of no kind": (crossed(kind="NoWeights"), "UNREADABLE"),
    "a mixture for one of two proofs": (against(parted((1, 1, 0, 0), (1, 0, 0, 1), (1, 1))), "UNREADABLE"),
}
