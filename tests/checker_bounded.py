"""Tiny certificate files by hand about proofs by e, true and just not true, and about ranges that change sign."""

from checker_cases import with_nodes
from checker_uncertain import against, grows, member, parted, vertex, vertices


def ends(numbers):
    return {"tuple": [{"matrix": [[x]]} for x in numbers]}


def bounded(*others, lower=None, upper=None, **more):
    """x' = -2 x + u, y = x, u = W y, or another first vertex, with e = y = u = 1: the transposed one is the same."""
    out = vertices(*others, **more)
    out["claim"] = "bounded network"
    out["data"] |= {"lower": lower and ends(lower), "upper": upper and ends(upper)}
    return out


def stepped(lower, upper):
    """x+ = x / 2 + u / 4 with W = 1, of the rate 1/4."""
    out = bounded(A="1/2", C="1/4", decay="1/4", lower=lower, upper=upper)
    out["data"] |= {"discrete": True, "dt": 1}
    return out


def pair(lower, upper, bound=1):
    """x_1' = -2 x_1 + bound x_2, x_2' = -2 x_2, without links, in the range of the entry of these ends."""
    out = with_nodes(bounded(decay=1), [2, 1, 1])
    data = out["data"]
    column, row = {"matrix": [[0], [0]]}, {"matrix": [[0, 0]]}
    other = [column, row, {"matrix": [[0]]}]
    data |= {"A": {"matrix": [[-2, bound], [0, -2]]}, "B": column, "C": row, "D": {"matrix": [[0]]}}
    data |= {"v": {"array": [1, 1]}, "q": {"array": [0]}, "r": {"array": [0]}, "W": {"matrix": [[0]]}}
    for name, x in (("lower", lower), ("upper", upper)):
        data[name] = {"tuple": [{"matrix": [[-2, x], [0, -2]]}, *other, {"matrix": [[0]]}]}
    return out


def signed(signs, low=-2, high=0, W=None, x=(1, 1), rate=1, **more):
    """x_j' = -x_j + u_j, u_1 in [low, high] y_2 and u_2 in [low, high] y_1, or one of them as it is."""
    inner = grows(rate=rate)
    inner["fields"] |= {"x": {"array": list(x)}, "u": {"array": [2, 2]}, "y": {"array": [1, 1]}}
    out = with_nodes(member([0, 0], inner), [1, 1, 1], [1, 1, 1])
    data = out["data"]
    one, none = {"matrix": [[1, 0], [0, 1]]}, {"matrix": [[0, 0], [0, 0]]}
    data |= {"A": {"matrix": [[-1, 0], [0, -1]]}, "B": one, "C": one, "D": none}
    upper, lower = [[0, high], [high, 0]], [[0, low], [low, 0]]
    if W is not None:  # links that are known
        upper[0][1] = lower[0][1] = W
    data["W"] = {"matrix": upper}
    data["lower"] = {"tuple": [data["A"], one, one, none, {"matrix": lower}]} if low is not None else None
    data["witness"]["fields"]["signs"] = signs and {"array": list(signs)}
    return out


def uneven(y=(1, 2), u=(1, 1, 0, 0), x=(3, 0), second=(2, 1), **more):
    """x' = -x + u, with y = (x, 2 x) or (2 x, x), u = W y, W = (1/3, 1/3): of gain 1."""
    out = with_nodes(against({"record": "NoCommonVectors"}), [1, 1, 2])
    data = out["data"]
    data |= {"A": {"matrix": [[-1]]}, "B": {"matrix": [[1]]}, "C": {"matrix": [[1], [2]]}, "D": {"matrix": [[0], [0]]}}
    data |= {"W": {"matrix": [["1/3", "1/3"]]}} | more
    other = {"matrix": [[second[0]], [second[1]]]}
    data["vertices"] = {"tuple": [{"tuple": [data["A"], data["B"], other, data["D"]]}]}
    fields = {"storage": parted((1, 0), (1, 0), y), "bound": parted(x, u, (3,))}
    data["witness"] = {"record": "NoCommonVectors", "fields": fields}
    return out


OPEN = (-3, -1, -1, 0, -1)
CASES = {
    "by e": (bounded(), "PROVED"),
    "by e, two vertices": (bounded(vertex(-2)), "PROVED"),
    "by e, a vertex that is slower": (bounded(vertex("-1.9")), "WRONG"),
    "by e, refuted": (bounded() | {"status": "REFUTED"}, "WRONG"),
    "by e, in ranges": (bounded(lower=(-3, 0, 0, 0, 0)), "PROVED"),
    "by e, in ranges that leave the cones": (bounded(lower=OPEN), "WRONG"),
    "by e, in ranges around 0": (bounded(lower=OPEN, upper=(-2, 1, 1, 0, 1)), "PROVED"),
    "by e, in ranges below 0": (bounded(lower=OPEN, upper=(-2, -1, -1, 0, -1)), "PROVED"),
    "by e, without lower ends": (bounded(upper=(-2, 1, 1, 0, 1)), "UNREADABLE"),
    "by e, upper ends of A beyond the bound": (bounded(lower=OPEN, upper=("-1.9", 1, 1, 0, 1)), "WRONG"),
    "by e, lower ends of A beyond the bound": (bounded(lower=(-1, -1, -1, 0, -1), upper=(-2, 1, 1, 0, 1)), "WRONG"),
    "by e, upper ends of B beyond the bound": (bounded(lower=OPEN, upper=(-2, "1.1", 1, 0, 1)), "WRONG"),
    "by e, lower ends of B beyond the bound": (bounded(lower=(-3, "-1.1", -1, 0, -1), upper=(-2, 1, 1, 0, 1)), "WRONG"),
    "by e, upper ends of W beyond the bound": (bounded(lower=OPEN, upper=(-2, 1, 1, 0, "1.1")), "WRONG"),
    "by e, lower ends of W beyond the bound": (bounded(lower=(-3, -1, -1, 0, "-1.1"), upper=(-2, 1, 1, 0, 1)), "WRONG"),
    "by e, upper ends of W below the opposite": (bounded(lower=OPEN, upper=(-2, 1, 1, 0, "-1.1")), "WRONG"),
    "by e, in steps": (stepped(("-1/2", 0, 0, 0, 0), ("1/2", 0, 0, 0, 0)), "PROVED"),
    "by e, in steps below the bound": (stepped((-1, 0, 0, 0, 0), ("1/2", 0, 0, 0, 0)), "WRONG"),
    "by e, an entry": (pair(-1, 1), "PROVED"),
    "by e, an entry below the bound": (pair("-1.1", 1), "WRONG"),
    "by e, an entry above the bound": (pair(-1, "1.1"), "WRONG"),
    "by e, an entry of a bound below 0": (pair(1, 1, -1), "WRONG"),
    "signs": (signed((1, -1)), "REFUTED"),
    "signs, of both": (signed((-1, 1)), "REFUTED"),
    "signs, growing faster": (signed((1, -1), rate=2), "WRONG"),
    "signs, all the same": (signed((1, 1)), "WRONG"),
    "signs, the same at the upper ends": (signed((-1, -1), low=0, high=2), "REFUTED"),
    "signs, of another link": (signed((1, -1), W=2), "WRONG"),
    "signs, of another link below 0": (signed((1, -1), W=-2), "REFUTED"),
    "signs without ranges": (signed((1, -1), low=None), "UNREADABLE"),
    "signs for one node": (signed((1,)), "UNREADABLE"),
    "signs that are none": (signed((2, -2)), "UNREADABLE"),
    "outputs of two vertices": (uneven(), "REFUTED"),
    "outputs of two vertices, more": (uneven(y=(2, 2)), "WRONG"),
    "outputs of two vertices, of each the larger": (uneven(u=(0, 1, 1, 0)), "REFUTED"),
    "outputs of two vertices, of each the smaller": (uneven(u=(1, 0, 0, 1)), "WRONG"),
    "outputs of two vertices, larger states": (uneven(x=(4, 0)), "WRONG"),
    "outputs of two vertices, smaller states": (uneven(x=(2, 0)), "WRONG"),
    "outputs of two vertices, other signs": (uneven(u=(3, -1, 0, 0)), "WRONG"),
}
