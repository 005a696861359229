"""What is stated of nonlinear systems, on random expressions with kinks and branches, against difference quotients.

If every Jacobian on a box keeps a cone, then h'(f(x + t d) - f(x)) >= 0 for every generator d, every facet h with
h'd = 0, and every step t > 0 inside the box, and v'(f(x + t d) - f(x)) < 0 if v proves contraction.
"""

import campaigns
import control as ct
import numpy as np

import control_kpos as kp
from control_kpos.errors import KposError

LEAVES = ["x[{i}]", "x[{j}]", "0.5", "-1.25", "(x[{i}] - x[{j}])"]
SMOOTH = [
    "({a} + {b})",
    "({a} - {b})",
    "({a} * {b})",
    "({a} / (2 + np.cos({b})))",
    "np.sin({a})",
    "np.tanh({a})",
    "np.exp(0.5 * np.tanh({a}))",
    "({a}) ** 2",
    "np.sqrt(1 + ({a}) ** 2)",
]
KINKS = ["abs({a})", "np.maximum({a}, {b})", "np.minimum({a}, 0.25)", "np.clip({a}, -0.5, 1)"]
# What looks at its argument: no statement about a whole box may follow from the branch that is taken.
BRANCHES = [
    "({a} if x[{i}] > 0.3 else {b})",
    "({a} if x[{i}] == 0.5 else {b})",
    "({a} if x[{i}] in (0, 1) else {b})",
    "({a} if str(x[{i}]).startswith('-') else {b})",
    "({a} if isinstance(x[{i}], float) else {b})",
    "({a} if attempt(lambda: float(x[{i}]), 1.0) > 0 else {b})",
    "({a} if attempt(lambda: hash(x[{i}]), 2) % 2 else {b})",
    "np.where(x[{i}] > 0, {a}, {b})",
    "({a} if attempt(lambda: bool(x[{i}] < x[{j}]), False) else {b})",
    "{{True: {a}}}.get(x[{i}] >= 0, {b})",
]
# Terms that rise with their argument.
RISING = ["np.tanh({a})", "np.maximum({a}, 0)", "np.minimum({a}, 0.25)", "({a}) ** 3", "{a}", "np.clip({a}, -1, 0.5)"]


def attempt(action, otherwise):
    """A function that swallows refusals."""
    try:
        return action()
    except Exception:  # noqa: BLE001 -- on purpose
        return otherwise


def expression(rng, n, depth, kinds):
    if depth == 0 or rng.random() < 0.15:
        form = LEAVES[rng.integers(len(LEAVES))]
    else:
        form = kinds[rng.integers(len(kinds))]
    i, j = rng.integers(n, size=2)
    a, b = (expression(rng, n, depth - 1, kinds) if name in form else "" for name in ("{a}", "{b}"))
    return form.format(i=i, j=j, a=a, b=b)


def random_function(rng, n):
    """Source of a right-hand side; many are monotone in the orthant, some look at their arguments."""
    kinds = SMOOTH + KINKS * int(rng.integers(0, 3)) + BRANCHES * int(rng.random() < 0.3)
    rows = []
    for i in range(n):
        rising = [RISING[rng.integers(len(RISING))].format(a=f"x[{j}]") for j in range(n) if j != i]
        terms = [f"-{rng.integers(1, 5)} * x[{i}]", *rising, f"{rng.choice([0.05, 0.3, 1])} * "]
        terms[-1] += expression(rng, n, int(rng.integers(0, 3)), kinds)
        if rng.random() < 0.2:
            terms[-2] = BRANCHES[rng.integers(len(BRANCHES))].format(i=0, j=n - 1, a=terms[-2], b="x[0]")
        rows.append(" + ".join(terms))
    return f"lambda t, x, u, p: [{', '.join(rows)}]"


def steps(rng, box, generators, count):
    """Points x of a box, the generators d, and step sizes t for which x + t d lies inside, too."""
    for k in range(count):
        d = generators[k % len(generators)]
        x = box[:, 0] + rng.random(len(box)) * (box[:, 1] - box[:, 0])
        with np.errstate(divide="ignore"):
            room = np.where(d > 0, (box[:, 1] - x) / np.abs(d), np.where(d < 0, (x - box[:, 0]) / np.abs(d), np.inf))
        yield x, k % len(generators), min(room.min(), 10.0 ** -rng.integers(0, 5))


def worst_quotient(rng, function, box, cone, v=None, count=120):
    """The smallest h'(f(x + t d) - f(x)) / t seen, over pairs of a facet and a generator that lies in it.

    With v also the smallest -v'(f(x + t d) - f(x)) / t.
    """
    worst = np.inf
    for x, k, t in steps(rng, box, cone.rays, count):
        if t <= 1e-7:
            continue
        change = np.subtract(function(0, x + t * cone.rays[k], [], {}), function(0, x, [], {})).astype(float) / t
        facets = cone.facets[cone.incidence[:, k].astype(bool)]
        worst = min([worst, *(facets @ change), *([] if v is None else [-v @ change])])
    return worst


def false_functions(count, seed):
    """Systems called differentially positive, or not, against quotients."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        n = int(rng.integers(2, 4))
        source = random_function(rng, n)
        function = eval(source, {"np": np, "attempt": attempt})
        T = campaigns.unimodular(rng, n)[0] if rng.random() < 0.3 else np.eye(n)
        X = kp.PolyhedralCone(T.T)
        low = np.round(rng.uniform(-1, 0.5, n), 1)
        box = np.column_stack([low, low + np.round(rng.uniform(0.1, 1, n), 1)])
        try:
            c = kp.differential_positivity(ct.nlsys(function, inputs=0, states=n), X, box, pieces=32)
        except KposError:
            continue
        worst = worst_quotient(rng, function, box, X, c.v)
        if (c and worst < -1e-7) or (c.status is kp.Status.REFUTED and not is_broken_at(function, c)):
            found.append((seed, k, c.status.name, worst, source))
    return found


def is_broken_at(function, c):
    """A quotient at the point of the witness is not positive."""
    w, X = c.witness, c.X
    step, d = 1e-6, X.rays[w.ray]
    quotients = []
    for sign in (1, -1):
        change = np.subtract(function(0, w.point + sign * step * d, [], {}), function(0, w.point, [], {}))
        quotients.append(X.facets[w.facet] @ change.astype(float) / (sign * step))
    return min(quotients) < 1e-4
