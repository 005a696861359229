"""Tiny certificate files by hand about compartments, true and just not true."""

from checker_cases import changed, double

RATES = [[0, 0], [1, 0]]


def drained(flows=RATES, outflows=(0, 1), levels=(1, 0), **data):
    """From compartment 0 to 1, and from there to the outside."""
    data = {"flows": {"matrix": flows}, "outflows": {"matrix": [list(outflows)]}} | data
    data |= {} if levels is None else {"levels": {"array": list(levels)}}
    return {"claim": "compartmental", "status": "PROVED", "data": data, "proof": {}}


def trapped(*members, outflows=(1, 0), **data):
    """The trap is compartment 1."""
    witness = {"record": "Trap", "fields": {"members": {"array": list(members)}}}
    return drained(outflows=outflows, levels=None, witness=witness, **data) | {"status": "REFUTED"}


def sparse(entries, shape):
    return {"sparse": entries, "shape": shape}


HALF = double("1/2")
TRAP = trapped(1)["data"]["witness"]
CASES = {
    "compartments": (drained(), "PROVED"),
    "compartments, fractions": (drained([[0, "1/3"], ["2/7", 0]], ["1/9", 0], [0, 3]), "PROVED"),
    "compartments, one level": (drained(levels=(1, 1)), "WRONG"),
    "compartments, up": (drained(levels=(1, 2)), "WRONG"),
    "compartments, all leave": (drained(outflows=(1, 1), levels=(0, 0)), "PROVED"),
    "compartments, the other leaves": (drained(outflows=(1, 0)), "WRONG"),
    "compartments, a flow to itself": (drained([[1, 0], [0, 0]]), "WRONG"),
    "compartments, a negative flow": (drained([[0, -1], [1, 0]]), "WRONG"),
    "compartments, a negative outflow": (drained(outflows=(-1, 1)), "WRONG"),
    "compartments, levels too few": (drained(outflows=(1, 1), levels=(0,)), "UNREADABLE"),
    "compartments, levels too many": (drained(levels=(1, 0, 0)), "UNREADABLE"),
    "compartments, no levels": (drained(levels=None), "UNREADABLE"),
    "compartments, a level is no double": (drained(levels=("1/3", 0)), "UNREADABLE"),
    "compartments, none": (drained([], (), ()), "UNREADABLE"),
    "compartments, none, sparse": (changed(drained((), (), ()), flows=sparse([], [0, 0])), "UNREADABLE"),
    "compartments, a flow is missing": (drained([[0, 0]], (0, 1)), "UNREADABLE"),
    "compartments, an outflow is missing": (drained(outflows=(1,)), "UNREADABLE"),
    "compartments, sparse": (changed(drained(), flows=sparse([[1, 0, 1]], [2, 2])), "PROVED"),
    "compartments, sparse, no double": (changed(drained(), flows=sparse([[1, 0, "1/3"]], [2, 2])), "UNREADABLE"),
    "compartments, sparse, larger": (changed(drained(), flows=sparse([[1, 0, 1]], [3, 3])), "UNREADABLE"),
    "compartments, half": (drained(outflows=(0, HALF)), "PROVED"),
    "compartments, with a trap": (changed(drained(), witness=TRAP), "UNREADABLE"),
    "trap": (trapped(1), "REFUTED"),
    "trap, both": (trapped(0, 1, outflows=(0, 0)), "REFUTED"),
    "trap, both, one leaves": (trapped(0, 1, outflows=(0, 1)), "WRONG"),
    "trap, it leaves": (trapped(1, outflows=(0, 1)), "WRONG"),
    "trap, a flow to another": (trapped(0, outflows=(0, 0)), "WRONG"),
    "trap, a flow to another too": (trapped(1, outflows=(0, 0), flows=[[0, 1], [1, 0]]), "WRONG"),
    "trap, a flow to itself": (trapped(1, flows=[[0, 0], [1, 1]]), "REFUTED"),
    "trap, a negative rate elsewhere": (trapped(1, outflows=(-1, 0)), "WRONG"),
    "trap of nothing": (trapped(), "UNREADABLE"),
    "trap, twice": (trapped(1, 1), "UNREADABLE"),
    "trap, not in order": (trapped(1, 0, outflows=(0, 0)), "UNREADABLE"),
    "trap, not there": (trapped(2), "UNREADABLE"),
    "trap, half a number": (trapped(HALF), "UNREADABLE"),
    "trap with levels": (changed(trapped(1), levels={"array": [1, 0]}), "UNREADABLE"),
}
# contents, the limit of sizes, and what is said
PAIRS = [(drained(), 2, "PROVED"), (drained(), 1, "UNREADABLE")]
