"""Tiny certificate files by hand about systems and networks with delays, true and just not true."""

import copy

from checker_cases import changed, double, scalar, shown, with_nodes
from checker_families import diagonal, pyramid, several
from checker_pieces import bracket


def delays(matrices, *, v=1, rate=None, most=None, factor=None, terms=None, discrete=False, **more):
    """A and the A_k, numbers, on the half-line."""
    data = {"v": {"array": [v]}, "rate": None if rate is None else {"double": double(rate)}}
    data |= {name: None if x is None else {"fraction": x} for name, x in (("max_delay", most), ("factor", factor))}
    data["terms"] = None if terms is None else {"tuple": list(terms)}
    return several(matrices, "delayed", "PROVED", discrete=discrete, **data | more)


def unstable(matrices, x=1, **more):
    return several(matrices, "delayed", witness=shown("InstabilityDirection", x=x), **more)


def failing(matrices, term, condition="A X in X", **more):
    violation = shown("PositivityViolation", condition=condition, ray=0)
    return several(matrices, "delayed", witness=shown("FailingTerm", term=term, violation=violation), **more)


def plane(matrices, term, normal):
    fields = {"condition": "A X in X", "ray": 0, "normal_exact": {"fractions": [normal]}}
    violation = {"record": "PlaneViolation", "fields": fields}
    return several(matrices, "delayed", witness=shown("FailingTerm", term=term, violation=violation))


def wedge(A, status="PROVED", **data):
    """A, and twice the identity delayed, on the cone of four generators."""
    out = pyramid(A, "delayed", status, P=diagonal(A), **data)
    eye = {"matrix": [[2 * (i == j) for j in range(3)] for i in range(3)]}
    out["data"]["A"]["tuple"].append(eye)
    out["proof"]["P"].append({"matrix": diagonal(2)})
    return out


def rooted(A, wz, P=2):
    out = wedge(A, "REFUTED", witness=shown("InstabilityDirection", x=[1, 1, 1]))
    out["proof"] |= {"wx": {"matrix": [[1], [0], [0], [0]]}, "wz": {"matrix": [[a] for a in wz]}}
    out["proof"]["P"][1] = {"matrix": diagonal(P)}
    return out


VECTORS = {"v": [1], "r": [1, 1], "q": [-1, -1]}


def inner(status="PROVED", A=-4, A_delay=1, *, witness=None, W=((1, 0), (0, 1)), **data):
    """x' = A x + u + A_delay x(t - h), u = y = x, as a network with two links of the node to itself."""
    out = scalar("network", status, A=A, W=0, witness=witness)
    out["data"] |= {"B": {"matrix": [[1, A_delay]]}, "C": {"matrix": [[1], [1]]}, "D": {"matrix": [[0, 0], [0, 0]]}}
    out["data"]["W"] = {"matrix": [list(row) for row in W]}
    vectors = {name: {"array": x} for name, x in VECTORS.items()} if status == "PROVED" else {}
    return with_nodes(changed(out, **vectors | data), [1, 2, 2])


def pair(**data):
    """Two nodes x' = -4 x + x(t - h), u and y being the delayed states alone."""
    out, two = scalar("network", W=0), {"matrix": [[1, 0], [0, 1]]}
    out["data"] |= dict.fromkeys("BCW", two) | {"A": {"matrix": [[-4, 0], [0, -4]]}, "D": {"matrix": [[0, 0], [0, 0]]}}
    out["data"] |= {"v": {"array": [1, 1]}, "r": {"array": [1, 1]}, "q": {"array": [-1, -1]}}
    return with_nodes(changed(out, **data), [1, 1, 1], [1, 1, 1])


def network(content, status="PROVED"):
    return {"claim": "delayed network", "status": status, "data": {"network": {"certificate": content}}, "proof": {}}


def wider(kind, rays):
    """The network with another cone of two dimensions in the place of U (1) or Y (2), whose generators are units."""
    out = copy.deepcopy(inner())
    other = {"cone": [[1, {"rays": rays}]]}
    out["data"]["XUY"[kind]] = other
    out["data"]["cones"]["tuple"][0]["tuple"][kind] = other
    return out


GROWING = shown("NetworkInstability", x=1, u=[1, 1], y=[1, 1], rate={"double": 0})
LEAVING = shown("NodeViolation", node=0, violation=shown("PositivityViolation", condition="B U in X", ray=1))
SHORT = shown("NoWeights", y=[1, 0])
SUPPLIES = {"r": {"array": [1, 1]}, "q": {"array": [0, 0]}}


def feedthrough(row, column):
    """D has an entry; p = (1, 1), t = D'p with a bit more for both."""
    D = [[0, 0], [0, 0]]
    D[row][column] = "0.25"
    loops = {"tuple": [{"array": [1, 1]}, {"array": [double("1/2"), double("1/2")]}]}
    return inner(D={"matrix": D}, loop_weights=loops, r={"array": [2, 2]}, q={"array": [-2, -2]}, A=-8)


CASES = {
    "delays": (delays([-3, 1, 1]), "PROVED"),
    "delays, marginal": (delays([-2, 1, 1]), "WRONG"),
    "delays, v is 0": (delays([-3, 1], v=0), "WRONG"),
    "delays, v is negative": (delays([3, 1], v=-1), "WRONG"),
    "delays, none": (delays([-3]), "UNREADABLE"),
    "delays, no family": (changed(delays([-3, 1]), A={"matrix": [[-3]]}), "UNREADABLE"),
    "delays, a negative one": (delays([-3, -1]), "WRONG"),
    "delays, discrete": (delays(["1/4", "1/2"], discrete=True), "PROVED"),
    "delays, discrete, marginal": (delays(["1/2", "1/2"], discrete=True), "WRONG"),
    "delays, discrete, A is negative": (delays(["-1/4", "1/2"], discrete=True), "WRONG"),
    "delays, no weights": (delays([-3, 1]) | {"proof": {}}, "PROVED"),
    "delays, four generators": (wedge(-3, v={"array": [0, 0, 1]}), "PROVED"),
    "delays, four generators, marginal": (wedge(-2, v={"array": [0, 0, 1]}), "WRONG"),
    # e^(1/2) = 1.64872, and e_1 + rest = 1 + 1/2 + 1/4 with one term
    "rate": (delays([-3, 1], rate="1/2", most=1, factor="7/4", terms=[1]), "PROVED"),
    "rate, factor too small": (delays([-3, 1], rate="1/2", most=1, factor="27/16", terms=[1]), "WRONG"),
    "rate, factor too small for the terms": (delays([-3, 1], rate="1/2", most=1, factor="3/2", terms=[9]), "WRONG"),
    "rate, as fast as cannot be": (delays(["-9/4", 1], rate="1/2", most=1, factor="7/4", terms=[1]), "WRONG"),
    "rate, two delayed": (delays([-5, 1, 1], rate="1/2", most=1, factor="7/4", terms=[1]), "PROVED"),
    "rate, two delayed, too fast": (delays([-4, 1, 1], rate="1/2", most=1, factor="7/4", terms=[1]), "WRONG"),
    "rate, no delay": (delays([-3, 1], rate="1/2", most=0, factor=1, terms=[0]), "PROVED"),
    "rate of 0": (delays([-3, 1], rate=0, most=1, factor=1, terms=[1]), "UNREADABLE"),
    "rate, negative delay": (delays([-3, 1], rate="1/2", most=-1, factor=1, terms=[1]), "UNREADABLE"),
    "rate, negative factor": (delays([-3, 1], rate="1/2", most=1, factor=-2, terms=[1]), "WRONG"),
    "rate, no terms": (delays([-3, 1], rate="1/2", most=1, factor="7/4"), "UNREADABLE"),
    "rate, terms twice": (delays([-3, 1], rate="1/2", most=1, factor="7/4", terms=[1, 1]), "UNREADABLE"),
    "rate, too few terms": (delays([-9, 1], rate=3, most=1, factor=100, terms=[3]), "UNREADABLE"),
    "rate, nothing beside it": (delays([-3, 1], rate="1/2"), "UNREADABLE"),
    "no rate, a delay": (delays([-3, 1], most=1), "UNREADABLE"),
    "no rate, a factor": (delays([-3, 1], factor=1), "UNREADABLE"),
    "no rate, terms": (delays([-3, 1], terms=[1]), "UNREADABLE"),
    # (1 - 1/2)^-2 = 4, and 1/32 + 4/16 < 1/2
    "rate, discrete": (delays(["1/32", "1/16"], rate="1/2", most=2, factor=4, discrete=True), "PROVED"),
    "rate, discrete, factor too small": (
        delays(["1/32", "1/16"], rate="1/2", most=2, factor="31/8", discrete=True),
        "WRONG",
    ),
    "rate, discrete, marginal": (delays(["1/4", "1/16"], rate="1/2", most=2, factor=4, discrete=True), "WRONG"),
    "rate, discrete, factor of a longer delay": (
        delays(["1/32", "1/16"], rate="1/2", most=3, factor=4, discrete=True),
        "WRONG",
    ),
    "rate, discrete, half a step": (
        delays(["1/32", "1/16"], rate="1/2", most="3/2", factor=4, discrete=True),
        "UNREADABLE",
    ),
    "rate, discrete, with terms": (
        delays(["1/32", "1/16"], rate="1/2", most=2, factor=4, terms=[9], discrete=True),
        "UNREADABLE",
    ),
    "rate of 1, discrete": (delays([0, 0], rate=1, most=0, factor=1, discrete=True), "UNREADABLE"),
    "rate beyond 1, discrete": (delays([0, 0], rate=3, most=2, factor=1, discrete=True), "UNREADABLE"),
    "rate, discrete, a thousand steps": (
        delays([0, 0], rate="1/2", most=1000, factor=2**40, discrete=True),
        "WRONG",
    ),
    "rate, discrete, more than a thousand steps": (
        delays([0, 0], rate="1/2", most=1001, factor=2**40, discrete=True),
        "UNREADABLE",
    ),
    "not with delays": (unstable([-1, 2]), "REFUTED"),
    "not with delays, marginal": (unstable([-2, 1, 1]), "REFUTED"),
    "not with delays, stable": (unstable([-3, 1, 1]), "WRONG"),
    "not with delays, no weights": (unstable([-1, 2]) | {"proof": {}}, "REFUTED"),
    "not with delays, x is 0": (unstable([-1, 2], x=0), "WRONG"),
    "not with delays, x outside": (unstable([-3, 2], x=-1), "WRONG"),
    "not with delays, a negative one": (unstable([3, -1]), "WRONG"),
    "not with delays, discrete": (unstable(["1/2", "1/2"], discrete=True), "REFUTED"),
    "not with delays, discrete, stable": (unstable(["1/2", "1/4"], discrete=True), "WRONG"),
    "not with delays, none": (unstable([1]), "UNREADABLE"),
    "not with delays, four generators": (rooted(-1, (1, 0, 0, 0)), "REFUTED"),
    "not with delays, four generators, not kept": (rooted(-1, (1, 0, 0, 0), 1), "WRONG"),
    "not with delays, four generators, no growth": (rooted(-3, (1, 0, 0, 0)), "WRONG"),
    "a delayed matrix fails": (failing([-3, 1, -1], 2), "REFUTED"),
    "a delayed matrix does not": (failing([-3, 1, -1], 1), "WRONG"),
    "a delayed matrix fails at a plane": (plane([-3, 1, -1], 2, 3), "REFUTED"),
    "a delayed matrix does not fail at a plane": (plane([-3, 1, -1], 1, 3), "WRONG"),
    "a delayed matrix fails at no plane": (plane([-3, 1, -1], 1, -3), "WRONG"),
    "A does not fail": (failing([-3, -1], 0), "WRONG"),
    "A fails, discrete": (failing([-3, 1], 0, discrete=True), "REFUTED"),
    "a matrix fails that is not there": (failing([-3, -1], 2), "UNREADABLE"),
    "a matrix fails at inputs": (failing([-3, -1], 1, "B U in X"), "UNREADABLE"),
    "delayed network": (network(inner()), "PROVED"),
    "delayed network, marginal": (network(inner(A=-2)), "WRONG"),
    "delayed network of two nodes": (network(pair()), "PROVED"),
    "delayed network, links crossed": (network(pair(W={"matrix": [[0, 1], [1, 0]]})), "UNREADABLE"),
    "delayed network, half a link": (
        network(inner(W=((1, 0), (0, "1/2")), q={"array": [-1, double("-1/2")]})),
        "UNREADABLE",
    ),
    "delayed network, more than the state": (
        network(inner(W=((1, 0), ("1/2", 1)), q={"array": [double("-3/2"), -1]})),
        "UNREADABLE",
    ),
    "delayed network, the state goes elsewhere": (
        network(inner(W=((1, "1/2"), (0, 1)), q={"array": [-1, double("-3/2")]})),
        "UNREADABLE",
    ),
    "delayed network, links not there": (network(inner(W=((1, 0), (0, 0)), q={"array": [-1, 0]})), "UNREADABLE"),
    "delayed network, half the state": (
        network(inner(C={"matrix": [[1], ["1/2"]]})),
        "UNREADABLE",
    ),
    "delayed network, no outputs": (network(scalar("network", A=-4, W=1, C=0)), "UNREADABLE"),
    "delayed network, without other ports": (network(scalar("network", A=-4, W=1)), "PROVED"),
    "delayed network, feedthrough elsewhere": (network(feedthrough(0, 0)), "PROVED"),
    "delayed network, feedthrough from the delay": (network(feedthrough(0, 1)), "UNREADABLE"),
    "delayed network, feedthrough to the delay": (network(feedthrough(1, 0)), "UNREADABLE"),
    "delayed network, another U": (network(wider(1, [[1, 0], [0, 1]])), "PROVED"),
    "delayed network, a longer U": (network(wider(1, [[1, 0], [0, 2]])), "UNREADABLE"),
    "delayed network, a mixed U": (network(wider(1, [[1, 1], [0, 1]])), "WRONG"),
    "delayed network, a mixed Y": (network(wider(2, [[1, 0], [1, 1]])), "UNREADABLE"),
    "delayed network, a longer Y": (network(wider(2, [[1, 0], [0, 2]])), "UNREADABLE"),
    "delayed network, refuted": (network(inner("REFUTED", A=-2, witness=GROWING), "REFUTED"), "REFUTED"),
    "delayed network, but stable": (network(inner("REFUTED", A=-3, witness=GROWING), "REFUTED"), "WRONG"),
    "delayed network, of another status": (network(inner("REFUTED", A=-2, witness=GROWING)), "WRONG"),
    "delayed network, of another status yet": (network(inner(), "REFUTED"), "WRONG"),
    "delayed network, not positive": (network(inner("REFUTED", A_delay=-1, witness=LEAVING), "REFUTED"), "REFUTED"),
    "delayed network, supplies": (network(inner("REFUTED", witness=SHORT, **SUPPLIES), "REFUTED"), "UNREADABLE"),
    "delayed network, of a system": (network(scalar("stable")), "UNREADABLE"),
    "delayed network, of an abscissa": (network(bracket(1, 1, A=0)), "UNREADABLE"),
    "delayed network, own links closed": (network(changed(pair(), own_links_closed=True)), "UNREADABLE"),
}
