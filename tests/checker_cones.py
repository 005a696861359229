"""Certificate files by hand about cones: with as many generators as dimensions, with more, and what leaves them."""

from checker_cases import HALF, changed, family, jacobian, moved, scalar, shown, with_nodes
from checker_claims import hopeless
from checker_pieces import PLANE, TOP, WEDGE, ahead, plane, static_node

THREE = TOP["cone"][0][1]  # (1, 1), (1, -1) and (1, 0)
MINUS_TWO = [[-2, 0], [0, -2]]
OWN = [[-2, 0, 0], [0, -2, 0], [0, 0, -2]]


def three(P=OWN, A=MINUS_TWO, discrete=False, **cone):
    """A system of two states on a cone of three generators, with weights."""
    factor = {name: x for name, x in {**THREE, **cone}.items() if x is not None}
    out = plane(A, {"cone": [[1, factor]]}, "positive", discrete=discrete)
    return {**out, "proof": {} if P is None else {"P": {"matrix": P}}}


def two(A=MINUS_TWO, **cone):
    """The same on a cone of two generators."""
    return plane(A, {"cone": [[1, {name: x for name, x in {**WEDGE["cone"][0][1], **cone}.items() if x is not None}]]})


def stable(out):
    return changed(out, v={"array": [1, 0]})


def large(n):
    rays = [[int(i == j) for j in range(n)] for i in range(n)]
    return changed(plane([], {"cone": [[1, {"rays": rays}]]}, "positive"), A={"sparse": [], "shape": [n, n]})


def left(A, ray, normal=None, X=TOP, discrete=False):
    """A generator that is said to leave a cone in the plane."""
    witness = shown("PositivityViolation", condition="A X in X", ray=ray)
    out = plane(A, X, "positive", discrete=discrete, witness=witness)
    proof = {} if normal is None else {"normal": {"matrix": [[h] for h in normal]}}
    return {**out, "status": "REFUTED", "proof": proof}


def node_left(normal, node=0, A=((-1, -1), (-1, -1))):
    """Two nodes on cones of three generators in discrete time, one of which is said to leave its own."""
    violation = shown("PositivityViolation", condition="A X in X", ray=0)
    out = scalar(
        "network", "REFUTED", discrete=True, W=0, witness=shown("NodeViolation", node=node, violation=violation)
    )
    out = with_nodes(out, [2, 1, 1], [2, 1, 1])
    zero = {name: {"sparse": [], "shape": shape} for name, shape in (("B", [4, 2]), ("C", [2, 4]), ("D", [2, 2]))}
    out["data"] |= zero | {"W": zero["D"], "X": {"cone": [[2, THREE]]}}
    out["data"]["A"] = {"sparse": [[2 * j + i, 2 * j + i, A[j][i]] for j in (0, 1) for i in (0, 1)], "shape": [4, 4]}
    out["data"]["cones"] = {"tuple": [{"tuple": [TOP, HALF, HALF]}] * 2}
    return {**out, "proof": {"normal": {"matrix": [[h] for h in normal]}}}


def link(target, W=((0, 0), (-1, 0))):
    """Two nodes, and a link from the first to itself or to the other that is said to leave."""
    witness = shown("CouplingViolation", target=target, source=0, ray=0)
    out = with_nodes(scalar("network", "REFUTED", W=0, witness=witness), [1, 1, 1], [1, 1, 1])
    eye = {"matrix": [[1, 0], [0, 1]]}
    out["data"] |= {"A": {"matrix": [[-1, 0], [0, -1]]}, "B": eye, "C": eye, "D": {"sparse": [], "shape": [2, 2]}}
    return changed(out, W={"matrix": [list(row) for row in W]})


def other_sizes(*sizes):
    """Nodes of one state each, or what is said of them."""
    out = with_nodes(scalar("network", W=0), [1, 1, 1], [1, 1, 1])
    zero, eye = {"matrix": [[0, 0], [0, 0]]}, {"matrix": [[1, 0], [0, 1]]}
    out["data"] |= {"A": {"matrix": [[-2, 0], [0, -2]]}, "B": eye, "C": eye, "D": zero, "W": zero}
    out["data"] |= {name: {"array": [x, x]} for name, x in (("v", 1), ("q", -1), ("r", 1))}
    return changed(out, sizes={"array": [list(node) for node in sizes]})


def of_two(A, radii, centre=-1, radius=0):
    """One of two Jacobians, with bounds, is said to leave the half-line."""
    out = family(A, discrete=True, status="REFUTED", witness=jacobian(centre, radius))
    return changed(out, radii={"tuple": [{"array": [[r]]} for r in radii]})


def generators(record="GeneratorProof", **content):
    return changed(scalar("stable", **content), generator_proof={"record": record, "fields": {"pointing": None}})


CASES = {
    "three generators": (three(), "PROVED"),
    "three generators without weights": (three(None), "UNREADABLE"),
    "three generators, a weight below 0": (three([[-2, 0, 1], [0, -2, 1], [0, 0, -4]]), "PROVED"),
    "three generators, a weight below 0 beside": (three([[-2, 0, -1], [0, -2, -1], [0, 0, 0]]), "WRONG"),
    "three generators, weights of another": (three([[-2, 0, 0], [0, -2, 0], [0, 0, -3]]), "WRONG"),
    "three generators, discrete": (three(discrete=True), "WRONG"),
    "three generators that nothing shows pointed": (three(w=None), "UNREADABLE"),
    "three generators, w on the boundary": (three(w=[1, 1]), "WRONG"),
    "three generators, w outside": (three(w=[0, 1]), "WRONG"),
    "three generators that nothing shows solid": (three(Z=None), "UNREADABLE"),
    "three generators, Z of another": (three(Z=[["1/2", "1/2"], ["1/2", "-1/2"], [0, 1]]), "WRONG"),
    "three generators with more": (three(more=1), "UNREADABLE"),
    "two generators": (stable(two()), "PROVED"),
    "two generators, w and Z not read": (stable(two(w="x", Z=None)), "PROVED"),
    "two generators with more": (stable(two(more=1)), "UNREADABLE"),
    "two generators in a line": (stable(two(rays=[[1, 1], [2, 2]])), "WRONG"),
    "64 generators": (large(64), "PROVED"),
    "65 generators": (large(65), "UNREADABLE"),
    "through a plane": (left([[-1, 0], [0, 1]], 1, [1, 1]), "REFUTED"),
    "through the other": (left([[-1, 0], [0, 1]], 0, [1, -1]), "REFUTED"),
    "through no plane": (left([[-1, 0], [0, 1]], 0), "UNREADABLE"),
    "beside the plane": (left([[-1, 0], [0, 1]], 2, [1, 1]), "WRONG"),
    "along the plane": (left([[-1, 0], [0, -1]], 1, [1, 1]), "WRONG"),
    "through a plane that crosses the cone": (left([[-1, 0], [0, 1]], 1, [2, 2]), "REFUTED"),
    "through another plane that crosses the cone": (left([[-1, 0], [0, 3]], 1, [0, 1], discrete=True), "WRONG"),
    "through a plane, discrete": (left([[-1, 0], [0, -1]], 0, [1, 1], discrete=True), "REFUTED"),
    "through a facet": (left([[-1, 0], [0, 1]], 1, None, WEDGE), "REFUTED"),
    "through a facet it does not lie on": (left([[-1, 0], [0, -1]], 1, None, WEDGE), "WRONG"),
    "through a facet it does not lie on, discrete": (left([[-1, 0], [0, -1]], 1, None, WEDGE, True), "REFUTED"),
    "onto a facet, discrete": (left([[1, 0], [0, 1]], 1, None, WEDGE, True), "WRONG"),
    "through a facet of the plane": (left([[0, -1], [0, 0]], 1, None, PLANE), "REFUTED"),
    "a node through its plane": (node_left([1, 1, 0, 0]), "REFUTED"),
    "a node through a plane of both": (node_left([1, 1, 1, 1]), "WRONG"),
    "a node through that of the other": (node_left([0, 0, 1, 1]), "WRONG"),
    "the other node through its plane": (node_left([0, 0, 1, 1], 1), "REFUTED"),
    "a link to the other node": (link(1), "REFUTED"),
    "a link to the same node": (link(0), "WRONG"),
    "a link that stays": (link(1, ((0, 0), (1, 0))), "WRONG"),
    "nodes of their own sizes": (other_sizes([1, 1, 1], [1, 1, 1]), "PROVED"),
    "nodes of their own sizes, two by two": (
        changed(other_sizes(), sizes={"array": [[1, 1], [1, 1], [1, 1]]}),
        "UNREADABLE",
    ),
    "nodes of other sizes than their cones": (other_sizes([2, 1, 1], [0, 1, 1]), "UNREADABLE"),
    "one of two Jacobians": (of_two([2, -1], [1, 0]), "REFUTED (given the bounds on the Jacobians)"),
    "two Jacobians with no bounds at all": (of_two([2, -1], [0, 0]), "UNREADABLE"),
    "one of two Jacobians, without bounds": (of_two([-1, -1], [1, 0]), "REFUTED (given the bounds on the Jacobians)"),
    "one of two Jacobians, both with bounds": (of_two([-1, -1], [1, 1]), "WRONG"),
    "one of two Jacobians, with a bound of its own": (of_two([-1, -1], [1, 0], radius="1/2"), "WRONG"),
    "one of two Jacobians, none": (of_two([-1, -1], [1, 0], -2), "WRONG"),
    "an exact vector that is missing": (
        changed(scalar("network", W=1), exact={"tuple": [{"fractions": [1]}, {"fractions": [1]}, None]}),
        "UNREADABLE",
    ),
    "no own links to be closed": (changed(scalar("network", W=0), own_links_closed=True), "UNREADABLE"),
    "own links not said to be closed": (changed(scalar("network", W=1), own_links_closed=None), "PROVED"),
    "no states": (ahead([], [0, 1, 0], "-1/2"), "UNREADABLE"),
    "a vector that a witness does not need": (
        changed(scalar("network", "REFUTED", W=0, r=0, **moved(0, 1, 0)), v={"array": [[1]]}),
        "UNREADABLE",
    ),
    "a functional that is no double in a sparse matrix": (
        changed(
            hopeless(-1),
            witness=shown(
                "Functionals", L={"tuple": [{"sparse": [[0, 0, "1/3"]], "shape": [1, 1]}]}, d={"matrix": [[0]]}, G=None
            ),
        ),
        "UNREADABLE",
    ),
    "a proof from generators": (generators(), "PROVED"),
    "a proof from something else": (generators("Other"), "UNREADABLE"),
    "a network from generators": (
        changed(static_node(1), generator_proof={"record": "GeneratorProof", "fields": {}}),
        "UNREADABLE",
    ),
}
