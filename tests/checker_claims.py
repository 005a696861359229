"""Tiny certificate files by hand about parts that do not belong together, and about claims that are not theirs."""

from checker_cases import moved, scalar, surplus, with_nodes
from checker_pieces import any_number


def two_ways(closed):
    """One state that hears itself through the first of two inputs, with supply that pays for the others only."""
    out = with_nodes(scalar("network", W=0), [1, 2, 1])
    out["data"] |= {"B": {"matrix": [[1, 1]]}, "D": None, "W": {"matrix": [[1], [0]]}}
    out["data"] |= {"r": {"array": [10, 1]}, "q": {"array": [0]}} | ({"own_links_closed": True} if closed else {})
    return out


def refuted(W, **more):
    return any_number(scalar("network", "REFUTED", W=W, **more), W, status="REFUTED")


CASES = {
    "a network with its own links closed": (two_ways(True), "PROVED"),
    "the same network with its links": (two_ways(False), "WRONG"),
    "any size, own links closed": (any_number(two_ways(True), 1, ((1,), (0,))), "WRONG"),
    "any size, not for these supplies": (refuted(0, r=0, **moved(0, 1, 0)), "WRONG"),
    "any size, not with any weights": (refuted(2, **surplus(1)), "WRONG"),
}
