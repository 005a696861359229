"""Tiny certificate files by hand about positive realizations, true and just not true."""

from checker_cases import changed

# y'' + 3 y' + 2 y = u in companion form, which is 1/(s + 1) and then 1/(s + 2)
SYSTEM = {"A": [[0, 1], [-2, -3]], "B": [[0], [1]], "C": [[1, 0]], "D": [[0]]}
CHAIN = {"A_positive": [[-1, 1], [0, -2]], "B_positive": [[0], [1]], "C_positive": [[1, 0]]}
STATES = {"transform": [[1, 0], [-1, 1]]}


def realized(discrete=False, **matrices):
    data = {name: {"matrix": rows} for name, rows in (SYSTEM | CHAIN | STATES | matrices).items() if rows is not None}
    return {"claim": "positive realization", "status": "PROVED", "data": data | {"discrete": discrete}, "proof": {}}


def refuted(row, column, step, **matrices):
    fields = {"row": row, "column": column, "step": step}
    nothing = dict.fromkeys([*CHAIN, *STATES])
    out = realized(**nothing | matrices) | {"status": "REFUTED"}
    return changed(out, witness={"record": "NegativeResponse", "fields": fields})


def step(a, b=1, c=1, d=0, r=1):
    """Of order 1: y[k+1] = a y[k] + b c u[k]."""
    system = {"A": [[a]], "B": [[b]], "C": [[c]], "D": [[d]], "transform": [[r]]}
    return system | {"A_positive": [[a]], "B_positive": [[b // r]], "C_positive": [[c * r]]}


# two inputs and outputs, of order 1
WIDE = {"A": [[-1]], "B": [[1, 2]], "C": [[1], [3]], "D": [[0, 1], [2, 0]], "transform": [[1]]}
WIDE |= {"A_positive": [[-1]], "B_positive": [[1, 2]], "C_positive": [[1], [3]]}
# the same response, by three rays in the plane
MORE = {"transform": [[1, 0, 1], [-1, 1, 0]], "B_positive": [[0], [1], [0]], "C_positive": [[1, 0, 1]]}

CASES = {
    "realization": (realized(), "PROVED"),
    "realization, three states": (realized(**MORE | {"A_positive": [[-1, 1, 2], [0, -2, 0], [0, 0, -2]]}), "PROVED"),
    "realization, three states, another P": (
        realized(**MORE | {"A_positive": [[-1, 1, 1], [0, -2, 0], [0, 0, -1]]}),
        "WRONG",
    ),
    "realization, longer rays": (
        realized(transform=[[2, 0], [-2, 1]], A_positive=[[-1, "1/2"], [0, -2]], C_positive=[[2, 0]]),
        "PROVED",
    ),
    "realization, another P": (realized(A_positive=[[-1, 1], [0, -1]]), "WRONG"),
    "realization, another N": (realized(B_positive=[[0], [2]]), "WRONG"),
    "realization, another Q": (realized(C_positive=[[2, 0]]), "WRONG"),
    "realization, another R": (realized(transform=[[1, 0], [1, 1]]), "WRONG"),
    "realization, that of itself": (
        realized(transform=[[1, 0], [0, 1]], A_positive=SYSTEM["A"], B_positive=SYSTEM["B"], C_positive=SYSTEM["C"]),
        "WRONG",
    ),
    "realization, D is negative": (realized(D=[[-1]]), "WRONG"),
    "realization, N is negative": (realized(**step(-1, b=-1)), "WRONG"),
    "realization, Q is negative": (realized(**step(-1, c=-1)), "WRONG"),
    "realization, both are negative": (realized(**step(-1, b=-1, c=-1, r=-1)), "PROVED"),
    "realization, in steps": (realized(True, **step("1/2")), "PROVED"),
    "realization, in steps, P is negative": (realized(True, **step("-1/2")), "WRONG"),
    "realization, wide": (realized(**WIDE), "PROVED"),
    "realization, no time": (changed(realized(), discrete=None), "UNREADABLE"),
    "realization, sparse": (
        changed(realized(), transform={"sparse": [[0, 0, 1], [1, 0, -1], [1, 1, 1]], "shape": [2, 2]}),
        "PROVED",
    ),
    "realization, R is missing": (realized(transform=None), "UNREADABLE"),
    "realization, R of three rows": (realized(transform=[[1, 0], [-1, 1], [0, 0]]), "UNREADABLE"),
    "realization, A of one row": (realized(A=[[0, 1]]), "UNREADABLE"),
    "realization, a witness too": (
        changed(realized(), witness=refuted(0, 0, 0)["data"]["witness"]),
        "UNREADABLE",
    ),
    "no realization, D": (refuted(0, 0, 0, D=[[-1]]), "REFUTED"),
    "no realization, D is 0": (refuted(0, 0, 0), "WRONG"),
    "no realization, C B": (refuted(0, 0, 1, B=[[-1], [0]]), "REFUTED"),
    "no realization, C B is 0": (refuted(0, 0, 1), "WRONG"),
    "no realization, C B, but D": (refuted(0, 0, 0, B=[[-1], [0]]), "WRONG"),
    "no realization, elsewhere": (refuted(1, 0, 0, D=[[-1]]), "WRONG"),
    "no realization, second step": (refuted(0, 0, 2, B=[[-1], [0]]), "UNREADABLE"),
    "no realization, second input": (refuted(0, 1, 0, D=[[-1]]), "UNREADABLE"),
    "no realization, wide": (
        refuted(1, 0, 0, B=[[0, 0], [1, 1]], C=[[1, 0], [1, 0]], D=[[0, 0], [-2, 0]]),
        "REFUTED",
    ),
    "no realization, wide, another": (
        refuted(0, 1, 0, B=[[0, 0], [1, 1]], C=[[1, 0], [1, 0]], D=[[0, 0], [-2, 0]]),
        "WRONG",
    ),
    "no realization, with one": (refuted(0, 0, 0, D=[[-1]], **CHAIN, **STATES), "UNREADABLE"),
}
# contents, the limit of sizes, and what is said
LARGE = {"transform": [[1, 0, 0], [-1, 1, 0]], "A_positive": [[-1, 1, 0], [0, -2, 0], [0, 0, 0]]}
LARGE |= {"B_positive": [[0], [1], [0]], "C_positive": [[1, 0, 0]]}
PAIRS = [(realized(), 2, "PROVED"), (realized(), 1, "UNREADABLE"), (realized(**LARGE), 3, "PROVED")]
PAIRS += [(realized(**LARGE), 2, "UNREADABLE"), (realized(**WIDE), 2, "PROVED"), (realized(**WIDE), 1, "UNREADABLE")]
