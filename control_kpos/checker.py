"""Check a certificate in the format kpos-certificate/1 without control_kpos: exact arithmetic, standard library only.

    python -m control_kpos.checker FILE      or, with this file alone,      python checker.py FILE

Exit status 0: PROVED, 1: REFUTED, undecided or not proven, 2: unreadable or without a proof.  The page
certificate_format describes the files.  Each claim below is one function; its docstring states what is proven and by
which inequalities.  x stands for the generators of X, u for those of U, y for those of Y.  References are to Kawano
and Forni.  In discrete time A - I takes the place of A in every inequality about growth or decay.
"""

from __future__ import annotations

import hashlib
import json
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import reduce
from itertools import pairwise
from itertools import product as pairs
from math import factorial, gcd, lcm
from pathlib import Path
from typing import Any

Vector = dict[int, Fraction]  # entries that are not zero, by index
Matrix = list[Vector]  # columns
Polynomial = list[int]  # coefficients, the highest power first, up to a positive factor
Json = Any

DOUBLE = re.compile(r"(-?0x[0-9a-f]{1,30})(?:\.([0-9a-f]{0,30}))?p([+-][0-9]{1,4})")
HEXADECIMAL = re.compile(r"(-?0x[0-9a-f]{1,20000})(?:/(0x[0-9a-f]{1,20000}))?")
DECIMAL = re.compile(r"-?[0-9]{1,4000}(\.[0-9]{1,4000}|/[0-9]{1,4000})?")


class Wrong(Exception):  # noqa: N818 - it says what the file is
    """The file does not prove what it says.  Every other exception: it is not readable, or has no proof."""


def need(fact: bool, what: str) -> None:
    """Stop unless this part of the proof holds."""
    if not fact:
        raise Wrong(what)


def expect(fact: bool, what: str) -> None:
    """Stop unless the file is written as the format says."""
    if not fact:
        raise ValueError(what)


# What files say of bounds on decay rates that are none.
BOUNDLESS = "decay_rate_bound", "inf"

# -- numbers, vectors, matrices


def number(text: str | int) -> Fraction:
    """A JSON integer, a double "0x1.8p+1", a decimal "-21.3", a fraction "1/3" or "-0x1f/0x3"."""
    if type(text) is int:
        return Fraction(text)
    expect(isinstance(text, str), "something else in the place of a number")
    if double := DOUBLE.fullmatch(str(text)):
        digits = double[2] or ""
        return int(double[1] + digits, 16) * Fraction(2) ** (int(double[3]) - 4 * len(digits))
    if ratio := HEXADECIMAL.fullmatch(str(text)):
        return Fraction(int(ratio[1], 16), int(ratio[2] or "1", 16))
    expect(DECIMAL.fullmatch(str(text)) is not None, f"{str(text)[:40]} is not a number")
    return Fraction(text)


def numbers(o: Json) -> list[Fraction]:
    """The numbers in {"array": nested lists}, {"fractions": [...]}, {"double": ...} or {"tuple": [vectors]}."""
    if isinstance(o, dict):
        (o,) = o.values()
    return [x for part in o for x in numbers(part)] if isinstance(o, list) else [number(o)]


def vector(o: Json, n: int) -> Vector:
    """A vector with n entries."""
    entries = numbers(o)
    expect(len(entries) == n, f"a vector has {len(entries)} entries instead of {n}")
    return {i: x for i, x in enumerate(entries) if x}


def matrix(o: Json, m: int, n: int) -> Matrix:
    """An m x n matrix, {"matrix": rows} or {"sparse": [[row, column, number], ...], "shape": [m, n]}."""
    out: Matrix = [{} for _ in range(n)]
    if "matrix" in o:
        fits = len(o["matrix"]) == m and all(len(row) == n for row in o["matrix"])
        entries = [(i, j, x) for i, row in enumerate(o["matrix"]) for j, x in enumerate(row)]
    else:
        fits, entries = [index(side) for side in o["shape"]] == [m, n], o["sparse"]
    expect(fits, f"a matrix is not {m} x {n}")
    for i, j, x in entries:
        expect(type(i) is int and type(j) is int and 0 <= i < m and 0 <= j < n, "an entry is out of range")
        expect(i not in out[j], "an entry occurs twice")
        out[j][i] = number(x)
    return [{i: a for i, a in column.items() if a} for column in out]


def given(o: Json, m: int, n: int) -> Matrix:
    """A matrix, or zeros where there is none."""
    return matrix(o, m, n) if o else [{} for _ in range(n)]


def total(*terms: tuple[Fraction | int, Vector]) -> Vector:
    """The sum of c x over pairs (c, x)."""
    out: Vector = {}
    for c, x in terms:
        for i, a in x.items():
            out[i] = out.get(i, Fraction(0)) + c * a
    return {i: a for i, a in out.items() if a}


def dot(f: Vector, x: Vector) -> Fraction:
    """f'x."""
    short, long = (f, x) if len(f) < len(x) else (x, f)
    return sum((a * long[i] for i, a in short.items() if i in long), Fraction(0))


def image(M: Matrix, x: Vector) -> Vector:
    """M x."""
    return total(*((a, M[j]) for j, a in x.items()))


def pullback(f: Vector, M: Matrix) -> Vector:
    """f'M."""
    products = ((j, dot(f, column)) for j, column in enumerate(M))
    return {j: a for j, a in products if a}


def sizes(x: Vector) -> Vector:
    """|x|, entry by entry."""
    return {i: abs(a) for i, a in x.items()}


# -- cones


@dataclass
class Cone:
    """A proper polyhedral cone: its generators, and Z with sum_k x_k Z_kj = e_j (`inverse`, row by row)."""

    dim: int
    rays: list[Vector]
    inverse: list[Vector]


def cone(o: Json, limit: int) -> Cone:
    """A product of factors, each `count` times.  Pointed: w'x > 0.  Solid: R Z = I, the columns of R being x."""
    out = Cone(0, [], [])
    for count, factor in o["cone"] if o else ():
        n, p = len(factor["w"]), len(factor["rays"])
        rays = matrix({"matrix": list(zip(*factor["rays"], strict=True))}, n, p)
        Z, w = matrix({"matrix": factor["Z"]}, p, n), vector(factor["w"], n)
        rows: list[Vector] = [{j: Z[j][k] for j in range(n) if k in Z[j]} for k in range(p)]
        need(all(dot(w, x) > 0 for x in rays), "a cone is pointed")
        need(all(image(rays, Z[j]) == {j: 1} for j in range(n)), "a cone is solid")
        expect(type(count) is int and 0 < count * n <= limit - out.dim, "a size is absurd for this file")
        for _ in range(count):
            out.rays += [{out.dim + i: a for i, a in x.items()} for x in rays]
            out.inverse += [{out.dim + j: a for j, a in z.items()} for z in rows]
            out.dim += n
    return out


def inside(target: Cone, y: Vector, weights: Vector | None, what: str, free: int | None = None) -> None:
    """y = sum_k w_k x_k with w_k >= 0 for all k but `free`.  In an orthant, y is its own w."""
    w = y if weights is None else weights
    need(all(a >= 0 or k == free for k, a in w.items()), f"{what} (a weight is negative)")
    need(image(target.rays, w) == y, f"{what} (weights)")


def above(f: Vector, C: Cone) -> bool:
    """f is in the dual cone: f'x >= 0 on C."""
    return all(dot(f, x) >= 0 for x in C.rays)


def listed(e: Json, name: str, y: Vector, target: Cone) -> None:
    """y is in a cone by the weights w<name> in the file."""
    w = e.get("w" + name)
    inside(target, y, matrix(w, len(target.rays), 1)[0] if w else None, f"w{name} shows a vector in its cone")


# -- systems


@dataclass
class System:
    """x' = A x + B u, y = C x + D u with cones X, U, Y; for networks u = W y + external inputs."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    W: Matrix
    X: Cone
    U: Cone
    Y: Cone
    discrete: bool
    radius: Matrix  # the bounds on the entries of Jacobians around A


def system(d: Json, A: Json, radius: Json, cones: list[Cone]) -> System:
    """The system in the data of a file; what is not there is zero."""
    X, U, Y = cones
    shapes = {"B": (X.dim, U.dim), "C": (Y.dim, X.dim), "D": (Y.dim, U.dim), "W": (U.dim, Y.dim)}
    rest = {name: given(d.get(name), *shape) for name, shape in shapes.items()}
    expect(type(d["discrete"]) is bool, "discrete is neither true nor false")
    bounds = given(radius and {"matrix": radius["array"]}, X.dim, X.dim)
    need(all(a >= 0 for column in bounds for a in column.values()), "a radius is not negative")
    out = System(matrix(A, X.dim, X.dim), X=X, U=U, Y=Y, discrete=d["discrete"], radius=bounds, **rest)
    expect(d.get("own_links_closed", True) is True, "own_links_closed is true where it stands")
    return own_links_closed(out, numbers(d["sizes"])) if "own_links_closed" in d else out


def positive(s: System, e: Json) -> None:
    """X, U, Y are kept: Theorem 1 (`cone_inv`), with weights P, N, L, K, M in the place of facets.

    A x_i = sum_k P_ki x_k with P_ki >= 0 for k != i (discrete time: all k),  B u_i = sum_k N_ki x_k,
    C x_i = sum_k L_ki y_k,  D u_i = sum_k K_ki y_k,  and in networks (I): W y_i = sum_k M_ki u_k,  all >= 0.
    """
    maps(s.X, s.A, s.X, e.get("P"), "A X in X", diagonal=not s.discrete)
    maps(s.U, s.B, s.X, e.get("N"), "B U in X")
    maps(s.X, s.C, s.Y, e.get("L"), "C X in Y")
    maps(s.U, s.D, s.Y, e.get("K"), "D U in Y")
    maps(s.Y, s.W, s.U, e.get("M"), "W Y in U")


def maps(source: Cone, M: Matrix, target: Cone, weights: Json, what: str, *, diagonal: bool = False) -> None:
    """M maps the generators of a cone into another, or (`diagonal`) no generator away from its own direction."""
    W = matrix(weights, len(target.rays), len(source.rays)) if weights else None
    for i, x in enumerate(source.rays):
        inside(target, image(M, x), None if W is None else W[i], what, i if diagonal else None)


def crossed(s: System, e: Json) -> None:
    """Not positive: h'M x < 0 for a generator x and an h that is nonnegative on the cone M x should be in.

    For A in continuous time also h'x = 0: x lies on the plane that the field crosses.  For Jacobians with bounds
    h'A x + |h|'radius |x| < 0.
    """
    cones = {"A": (s.X, s.X), "B": (s.U, s.X), "C": (s.X, s.Y), "D": (s.U, s.Y), "W": (s.Y, s.U)}
    source, target = cones[e["matrix"]]
    h, x = matrix(e["normal"], target.dim, 1)[0], source.rays[index(e["ray"])]
    need(above(h, target), "h'x >= 0 on the cone")
    spread = dot(sizes(h), image(s.radius, sizes(x))) if e["matrix"] == "A" else 0
    need(dot(h, image(getattr(s, e["matrix"]), x)) + spread < 0, f"{e['matrix']} crosses the plane")
    need(e["matrix"] != "A" or s.discrete or dot(h, x) == 0, "the generator lies on the plane")


def index(k: Json) -> int:
    """A number of something in a list."""
    expect(type(k) is int and k >= 0, "an index is not a whole number")
    return k


def stated(e: Json, name: str, n: int) -> Vector:
    """A vector of doubles, or the exact one beside it, which must round to it."""
    if e.get(name + "_exact") is None:
        return vector(e[name], n)
    exact = numbers(e[name + "_exact"])
    need([float(x) for x in exact] == [float(x) for x in numbers(e[name])], f"{name} is {name}_exact rounded")
    return vector(e[name + "_exact"], n)


def supply(s: System, e: Json) -> tuple[Vector, Vector | None]:
    """q and r of the supply r'u + q'y, in networks those of all nodes; the exact ones, where there are."""
    if e.get("exact"):
        _, r, q = e["exact"]["tuple"]
        e = e | {"r_exact": r, "q_exact": q}
    return stated(e, "q", s.Y.dim), None if e["r"] is None else stated(e, "r", s.U.dim)


def required_rate(e: Json) -> Fraction:
    """The rate that was asked for, which is positive, or 0."""
    rate = numbers(e["required_rate"])[0] if e.get("required_rate") is not None else Fraction(0)
    need(rate > 0 or e.get("required_rate") is None, "a rate that is asked for is positive")
    return rate


def decreases(s: System, v: Vector, q: Vector, e: Json) -> None:
    """v'x > 0,  (v'A - q'C) x < 0,  (v'A - q'C) x + rate v'x <= 0  for the decay_rate >= 0 and the required_rate."""
    drift = total((1, pullback(v, s.A)), (-s.discrete, v), (-1, pullback(q, s.C)))
    need(all(dot(v, x) > 0 for x in s.X.rays), "v'x > 0")
    need(all(dot(drift, x) < 0 for x in s.X.rays), "(v'A - q'C) x < 0")
    for rate in (numbers(e.get("decay_rate", 0))[0], required_rate(e)):
        need(all(dot(drift, x) + rate * dot(v, x) <= 0 for x in s.X.rays), "(v'A - q'C) x + rate v'x <= 0")
        need(rate >= 0, "a decay rate is not negative")


def supplied(s: System, v: Vector, q: Vector, r: Vector) -> None:
    """v'B u <= r'u + q'D u."""
    excess = total((1, pullback(v, s.B)), (-1, r), (-1, pullback(q, s.D)))
    need(all(dot(excess, u) <= 0 for u in s.U.rays), "v'B u <= r'u + q'D u")


def stable(s: System, e: Json) -> str:
    """Exponentially stable on X, and so everywhere: Theorem 2 (`cone_s`).

    positive,  v'x > 0,  v'A x < 0,  v'A x + decay_rate v'x <= 0,  v'A x + required_rate v'x <= 0.
    No v has a rate above decay_rate_bound = b: z != 0, the slow direction, and A z + b z are in X.
    """
    positive(s, e)
    decreases(s, stated(e, "v", s.X.dim), {}, e)
    if e.get("slow_direction") is None:
        need(e.get("decay_rate_bound", {"double": "inf"}) == {"double": "inf"}, "a bound on rates has a slow direction")
        return ""
    z = stated(e, "slow_direction", s.X.dim)
    moved = total((1, image(s.A, z)), (numbers(e["decay_rate_bound"])[0] - s.discrete, z))
    need(bool(z), "the slow direction is not zero")
    if "ws" in e:
        listed(e, "s", z, s.X)
        listed(e, "b", moved, s.X)
    elif len(s.X.rays) == s.X.dim:  # then the rows of the inverse are the facets
        need(all(dot(h, z) >= 0 and dot(h, moved) >= 0 for h in s.X.inverse), "z and A z + b z are in X")
    else:
        return "decay_rate_bound is not covered: its weights are not in the file"
    return ""


def dissipative(s: System, e: Json) -> None:
    """Exponentially dissipative with storage v'x and supply r'u + q'y: Theorem 3 (`cone_d`).

    positive,  v'x > 0,  (v'A - q'C) x < 0,  (v'A - q'C) x + decay_rate v'x <= 0,  v'B u <= r'u + q'D u.
    """
    positive(s, e)
    v, (q, r) = stated(e, "v", s.X.dim), supply(s, e)
    expect(r is not None, "r is there")
    decreases(s, v, q, e)
    supplied(s, v, q, r or {})


def disturbance_gain(s: System, e: Json) -> None:
    """The L-infinity gain is below g, for the system whose transposed matrices are in the file.

    The system in the file, on the dual cone, is dissipative with q = -1 and r = g 1; U and Y are orthants.
    """
    need(all(len(x) == 1 for C in (s.U, s.Y) for x in C.rays), "U and Y are orthants")
    q, r = supply(s, e)
    bound = r.get(0, Fraction(0)) if r else Fraction(0)
    alike = r == {i: bound for i in range(s.U.dim) if bound}
    need(q == dict.fromkeys(range(s.Y.dim), -1) and alike, "the supply is g 1'u - 1'y")
    dissipative(s, {**e, "decay_rate": 0})


def common_vector(s: System, e: Json) -> None:
    """A family is stable under arbitrary switching: each A maps one point of int X into -int X.

    In the file are A' and the dual cone: positive,  v'x > 0,  v'A'x < 0,  v'A'x + decay_rate v'x <= 0  and
    v'A'x + required_rate v'x <= 0  for every generator x of the dual.
    """
    need(e["v"] is not None, "v is there")
    positive(s, e)
    decreases(s, vector(e["v"], s.X.dim), {}, e)


def invariant(s: System, e: Json) -> None:
    """X is invariant under each A of a family, holds the columns of B, and lies in the half-spaces C x >= 0.

    positive, and unless v is null v'x > 0 and v'A x < 0, a common Lyapunov vector.  With `radii`, for every J with
    |J - A| <= radius, given these bounds: if e_j = sum_k x_k Z_kj, the weights of J x_i are at least
    P_ki - sum_j |Z_kj| (radius |x_i|)_j, which is >= 0 for k != i (discrete time: all k);  v'A x + |v|'radius |x| < 0.
    """
    positive(s, e)
    v = vector(e["v"], s.X.dim) if e.get("v") else None
    if v is not None:
        decreases(s, v, {}, {})
    P = matrix(e["P"], len(s.X.rays), len(s.X.rays)) if e.get("P") else None
    for i, x in enumerate(s.X.rays if any(s.radius) else ()):
        spread, w = image(s.radius, sizes(x)), image(s.A, x) if P is None else P[i]
        least = [w.get(k, 0) - dot(sizes(z), spread) for k, z in enumerate(s.X.inverse)]
        need(all(a >= 0 or (k == i and not s.discrete) for k, a in enumerate(least)), "J X in X within the bounds")
        drift = total((1, image(s.A, x)), (-s.discrete, x))
        need(v is None or dot(v, drift) + dot(sizes(v), spread) < 0, "v'J x < 0 within the bounds")


# -- networks: one large system, with the nodes side by side


def own_links_closed(s: System, sizes: list[Fraction]) -> System:
    """W_jj as a part of node j of the given sizes (states, inputs, outputs), and W without these blocks.

    With S = (I - W_jj D_j)^-1 node j becomes A + B S W_jj C, B S, C + D S W_jj C, D S, whatever part of W is its own.
    """
    inputs, outputs = ([j // 3 for j in range(kind, len(sizes), 3) for _ in range(int(sizes[j]))] for kind in (1, 2))
    own = [{i: a for i, a in w.items() if inputs[i] == outputs[k]} for k, w in enumerate(s.W)]
    rest = [total((1, w), (-1, mine)) for w, mine in zip(s.W, own, strict=True)]
    loops = chained(own, s.D)
    S = inverse([total((1, {k: Fraction(1)}), (-1, x)) for k, x in enumerate(loops)])
    heard = chained(S, own, s.C)
    A, C = (plus(M, chained(N, heard)) for M, N in ((s.A, s.B), (s.C, s.D)))
    return replace(s, A=A, B=chained(s.B, S), C=C, D=chained(s.D, S), W=rest)


def chained(*factors: Matrix) -> Matrix:
    """The product of matrices."""
    return reduce(lambda M, N: [image(M, x) for x in N], factors)


def plus(M: Matrix, N: Matrix) -> Matrix:
    """M + N."""
    return [total((1, x), (1, y)) for x, y in zip(M, N, strict=True)]


def inverse(M: Matrix) -> Matrix:
    """The inverse, by operations on the columns of M over those of the identity."""
    rest: list[tuple[Vector, Vector]] = [(x, {k: Fraction(1)}) for k, x in enumerate(M)]
    done: list[tuple[Vector, Vector]] = []
    for i in range(len(M)):
        usable = [k for k, (x, _) in enumerate(rest) if i in x]
        need(bool(usable), "the links of nodes to themselves are well posed")
        x, z = rest.pop(usable[0])
        pivot = total((1 / x[i], x)), total((1 / x[i], z))
        rest, done = ([clear(pair, pivot, i) for pair in part] for part in (rest, done))
        done.append(pivot)
    return [z for _, z in done]


def clear(pair: tuple[Vector, Vector], pivot: tuple[Vector, Vector], i: int) -> tuple[Vector, Vector]:
    """Without entry i, by subtraction of the pivot."""
    a = pair[0].get(i, Fraction(0))
    return total((1, pair[0]), (-a, pivot[0])), total((1, pair[1]), (-a, pivot[1]))


def loop(s: System, e: Json) -> tuple[Vector, Vector]:
    """The algebraic loop u = W D u contracts, unless D = 0:  p'y > 0,  p'D u <= t'u,  t'W y < p'y."""
    if not any(s.D):
        return {}, {}
    p, t = vector(e["p"], s.Y.dim), vector(e["t"], s.U.dim)
    direct, around = total((1, pullback(p, s.D)), (-1, t)), total((1, pullback(t, s.W)), (-1, p))
    need(all(dot(p, y) > 0 and dot(around, y) < 0 for y in s.Y.rays), "t'W y < p'y")
    need(all(dot(direct, u) <= 0 for u in s.U.rays), "p'D u <= t'u")
    if e.get("loop_weights"):
        need(numbers(e["loop_weights"]) == numbers(e["p"]) + numbers(e["t"]), "p and t are those of the data")
    return p, t


def weighted(e: Json) -> None:
    """V, R, Q are the v, r, q of the nodes (the exact ones, where there are), each times its sigma."""
    if not e.get("sizes"):
        return
    owned = list(zip(*[iter(numbers(e["sizes"]))] * 3, strict=True))
    sigma = numbers(e["sigma"]) if "sigma" in e else [Fraction(1)] * len(owned)
    need(all(x > 0 for x in sigma), "sigma > 0")
    for kind, name in enumerate("vrq"):
        exact = numbers(e["exact"]["tuple"][kind]) if e.get("exact") else numbers(e[name])
        need([float(x) for x in exact] == [float(x) for x in numbers(e[name])], f"{name} is its exact vector rounded")
        expect(all(own[kind] >= 0 for own in owned), "a size is negative")
        expect(sum(own[kind] for own in owned) == len(exact), "the sizes are not those of the nodes")
        each = [x for x, own in zip(sigma, owned, strict=True) for _ in range(int(own[kind]))]
        need([a * b for a, b in zip(each, exact, strict=True)] == numbers(e[name.upper()]), "V, R, Q are sigma v, r, q")


def balanced(s: System, e: Json) -> tuple[Vector, Vector]:
    """V and Q, with the supplies of (II) and (III'):  V'B u <= R'u + Q'D u  and  Q'y + R'W y <= 0."""
    weighted(e)
    V, R, Q = vector(e["V"], s.X.dim), vector(e["R"], s.U.dim), vector(e["Q"], s.Y.dim)
    supplied(s, V, Q, R)
    need(all(dot(Q, y) + dot(pullback(R, s.W), y) <= 0 for y in s.Y.rays), "Q'y + R'W y <= 0")
    return V, Q


def network(s: System, e: Json) -> None:
    """A network is positive and exponentially stable: Theorem 4 (`cone_ic_s`), with (III') node by node.

    positive,  V'x > 0,  (V'A - Q'C) x < 0,  (V'A - Q'C) x + rate V'x <= 0 for decay_rate and required_rate,
    V'B u <= R'u + Q'D u,  Q'y + R'W y <= 0, and the algebraic loop contracts.
    """
    positive(s, e)
    loop(s, e)
    V, Q = balanced(s, e)
    decreases(s, V, Q, e)


def abscissa(s: System, e: Json) -> None:
    """The spectral abscissa (discrete time: radius) of a positive network is in [lower, upper].

    positive, the loop contracts,  V'x > 0,  (V'A - Q'C) x <= upper V'x,  the supplies as for `network`;  and for
    x in X, x != 0, with inputs and outputs u, y as for `grows`, A x + B u - lower x is in X.
    """
    positive(s, e)
    V, Q = balanced(s, e)
    drift = total((1, pullback(V, s.A)), (-numbers(e["upper"])[0], V), (-1, pullback(Q, s.C)))
    need(all(dot(V, x) > 0 for x in s.X.rays), "V'x > 0")
    need(all(dot(drift, x) <= 0 for x in s.X.rays), "(V'A - Q'C) x <= upper V'x")
    need(number(e["rate"]) == numbers(e["lower"])[0], "the motion grows at the lower rate")
    grows(s, e)


def motion(s: System, e: Json) -> tuple[Vector, Vector, Vector, Vector]:
    """x, u, y and A x + B u - rate x."""
    x, u, y = (vector(e[k], C.dim) if e.get(k) else {} for k, C in (("x", s.X), ("u", s.U), ("y", s.Y)))
    return x, u, y, total((1, image(s.A, x)), (1, image(s.B, u)), (-number(e["rate"]), x))


def grows(s: System, e: Json) -> None:
    """A network does not decay faster than the rate: its state has an eigenvalue >= rate.

    positive, the loop contracts;  x != 0,  x in X,  A x + B u - rate x in X,  W y - u in U,  C x + D u - y in Y.
    """
    loop(s, e)
    x, u, y, moved = motion(s, e)
    need(bool(x), "x is not zero")
    listed(e, "x", x, s.X)
    listed(e, "z", moved, s.X)
    listed(e, "W", total((1, image(s.W, y)), (-1, u)), s.U)
    listed(e, "C", total((1, image(s.C, x)), (1, image(s.D, u)), (-1, y)), s.Y)


def no_storage(s: System, e: Json, q: Vector, r: Vector | None) -> None:
    """No v decreases: x, A x + B u - rate x in X, u in U, without supply: q'(C x + D u) + r'u <= 0.

    One of x, the motion and the supply is not 0; u = 0 where r is free, and where stability alone is in question.
    """
    x, u, _, moved = motion(s, e)
    supply = dot(q, total((1, image(s.C, x)), (1, image(s.D, u)))) + dot(r or {}, u)
    need(supply <= 0 and bool(x or moved or supply), "a motion without supply")
    need(r is not None or not u, "the input of the motion is zero")
    listed(e, "x", x, s.X)
    listed(e, "u", u, s.U)
    listed(e, "z", moved, s.X)


def unstable(s: System, e: Json) -> None:
    """Not stable: x in X, x != 0, with A x - rate x in X, rate >= 0 (discrete time: 1).

    Or no v decreases at required_rate, which is positive: then rate > -required_rate (1 - required_rate) will do, or
    this rate itself if A x - rate x is not 0.
    """
    no_storage(s, e, {}, None)
    need(bool(motion(s, e)[0]), "x is not zero")


def not_dissipative(s: System, e: Json) -> None:
    """Not dissipative for this supply, or for this q and any r where r is null: see `no_storage`."""
    no_storage(s, e, *supply(s, e))


def closed_loop(s: System, e: Json) -> None:
    """The loop u = W D u has gain 1 or more: y in Y, y != 0, x = 0, W y - u in U, D u - y in Y."""
    x, u, y, _ = motion(s, e)
    need(bool(y) and not x, "y is not zero, and x is")
    listed(e, "y", y, s.Y)
    listed(e, "W", total((1, image(s.W, y)), (-1, u)), s.U)
    listed(e, "C", total((1, image(s.D, u)), (-1, y)), s.Y)


def no_weights(s: System, e: Json) -> None:
    """No sigma > 0 balances these supplies: y in Y, q_j'y_j + r_j'(W y)_j >= 0 at every node, > 0 at one."""
    _, u, y, _ = motion(s, e)
    listed(e, "y", y, s.Y)
    (q, r), received, rows, first = supply(s, e), image(s.W, y), [], (0, 0)
    for nodes in zip(*(e[k].get("tuple") or e[k]["array"] for k in "qr"), strict=True):
        last = first[0] + len(numbers(nodes[0])), first[1] + len(numbers(nodes[1]))
        parts = (q, y, first[0], last[0]), (r or {}, received, first[1], last[1])
        rows.append(sum(f.get(i, 0) * x.get(i, 0) for f, x, i0, i1 in parts for i in range(i0, i1)))
        first = last
    need(not u and min(rows) >= 0 and max(rows) > 0, "no weights exist")


# -- no cone


def leverrier(M: list[list[int]]) -> tuple[Polynomial, list[list[int]]]:
    """det(z I - M) and the adjugate of M, by Faddeev and LeVerrier: N_k = M N_(k-1) + c_k I, c_k = -tr(M N_(k-1)) / k.

    The adjugate is N_(n-1) up to the sign (-1)^(n-1).
    """
    n, coefficients = len(M), [1]
    N = last = [[int(i == j) for j in range(n)] for i in range(n)]
    for k in range(1, n + 1):
        last, N = N, product(M, N)
        coefficients.append(-sum(N[i][i] for i in range(n)) // k)
        N = [[a + coefficients[k] * (i == j) for j, a in enumerate(row)] for i, row in enumerate(N)]
    return coefficients, [[a if n % 2 else -a for a in row] for row in last]


def product(M: list[list[int]], N: list[list[int]]) -> list[list[int]]:
    """M N."""
    columns = list(zip(*N, strict=True))
    return [[sum(a * b for a, b in zip(row, column, strict=True)) for column in columns] for row in M]


def integers(A: Matrix, shift: Fraction | int = 0, sign: int = 1) -> tuple[list[list[int]], int]:
    """The matrix M of integers, and c > 0, with M = c (sign A + shift I)."""
    n = len(A)
    rows = [[sign * A[j].get(i, 0) + shift * (i == j) for j in range(n)] for i in range(n)]
    c = lcm(*(Fraction(a).denominator for row in rows for a in row))
    return [[int(a * c) for a in row] for row in rows], c


def primitive(p: list[Any]) -> Polynomial:
    """A polynomial with rational coefficients in coprime integers, without leading zeros."""
    p = p[next((k for k, a in enumerate(p) if a), len(p) - 1) :]
    p = [int(a * lcm(*(Fraction(b).denominator for b in p))) for a in p]
    return [a // (gcd(*p) or 1) for a in p]


def shifted(p: list[Any], b: Fraction) -> Polynomial:
    """p(z + b), without roots at 0."""
    out = [Fraction(a) for a in p]
    for last in range(len(p), 1, -1):
        for k in range(1, last):
            out[k] += b * out[k - 1]
    while out[-1] == 0:  # p is not zero
        out.pop()
    return primitive(out)


def divided(p: Polynomial, q: Polynomial) -> tuple[Polynomial, Polynomial]:
    """Quotient and remainder of p by q, up to positive factors."""
    rest, quotient = [Fraction(a) for a in p], []
    for _ in range(len(p) - len(q) + 1):
        quotient.append(rest[0] / q[0])
        padded = q + [0] * (len(rest) - len(q))
        rest = [a - quotient[-1] * b for a, b in zip(rest, padded, strict=True)][1:]
    return primitive(quotient or [Fraction(0)]), primitive(rest or [Fraction(0)])


def common(p: Polynomial, q: Polynomial) -> Polynomial:
    """The greatest common divisor."""
    while any(q):
        p, q = q, divided(p, q)[1]
    return p


def derivative(p: Polynomial) -> Polynomial:
    """The derivative, up to a positive factor."""
    return primitive([a * (len(p) - 1 - k) for k, a in enumerate(p[:-1])] or [0])


def real_roots_beyond(p: Polynomial, b: Fraction) -> int:
    """How many different real roots are larger than b: Sturm's theorem for p(z + b) between 0 and infinity."""
    chain = [shifted(p, b)]
    chain.append(derivative(chain[0]))
    while any(chain[-1]):
        chain.append([-a for a in divided(chain[-2], chain[-1])[1]])
    return changes([q[-1] for q in chain]) - changes([q[0] for q in chain])


def changes(row: list[int]) -> int:
    """Changes of sign."""
    signs = [a > 0 for a in row if a]
    return sum(a != b for a, b in pairwise(signs))


def root_ahead(p: Polynomial, z: list[Fraction], b: Fraction, discrete: bool) -> None:
    """Some root has a real part (discrete time: a modulus) above b: the disc of radius rho around z has one.

    It has one if n |p(z)| <= rho |p'(z)|, n being the degree (Laguerre).
    """
    re, im, rho = z
    value, slope = (Fraction(0), Fraction(0)), (Fraction(0), Fraction(0))
    for a in p:  # Horner, for p and its derivative
        slope = re * slope[0] - im * slope[1] + value[0], re * slope[1] + im * slope[0] + value[1]
        value = re * value[0] - im * value[1] + a, re * value[1] + im * value[0]
    reach = (len(p) - 1) ** 2 * (value[0] ** 2 + value[1] ** 2)
    need(rho >= 0 and reach <= rho**2 * (slope[0] ** 2 + slope[1] ** 2), "an eigenvalue is near z")
    need(re**2 + im**2 > (b + rho) ** 2 if discrete else re > b + rho, "z is ahead")


def root_beside(p: Polynomial, b: Fraction, discrete: bool) -> None:
    """Some root is b + i w, w != 0;  discrete time: some root of modulus b > 0 is no root of unity times b."""
    if discrete:
        p = shifted([a * b ** (len(p) - 1 - k) for k, a in enumerate(p)], Fraction(0))  # roots z / b
        p = common(p, list(reversed(p)))  # of these, the ones on the unit circle, and pairs z, 1 / z
        for order in range(1, 2 * len(p) ** 2):  # the order of a root of unity of degree n is at most 2 n^2
            while len(unity := common(p, [1] + [0] * (order - 1) + [-1])) > 1:
                p = divided(p, unity)[0]
        p = shifted(p, Fraction(-1))  # z + 1 = 2 / (1 + s) takes the unit circle to the imaginary axis of s
        p = shifted([a * 2 ** (len(p) - 1 - k) for k, a in enumerate(p)][::-1], Fraction(1))
    else:
        p = shifted(p, b)
    real = [a * (1, 0, -1, 0)[k % 4] for k, a in enumerate(p)]  # p(i w) = i^n (real - i imaginary)
    imaginary = [a * (0, 1, 0, -1)[k % 4] for k, a in enumerate(p)]
    shared = common(primitive(real), primitive(imaginary))
    need(real_roots_beyond(shared, Fraction(0)) > 0, "an eigenvalue lies beside the bound")


def resolvent(A: Matrix, s: Fraction) -> list[list[int]]:
    """A positive multiple of (s I - A)^-1 = integral of e^((A - s I) t), if no real eigenvalue of A is >= s."""
    p, adjugate = leverrier(integers(A, s, -1)[0])  # the roots of p are s - eigenvalue
    mirrored = [-a if k % 2 else a for k, a in enumerate(p)]
    need(p[-1] != 0 and real_roots_beyond(mirrored, Fraction(0)) == 0, "s is beyond the real eigenvalues")
    return adjugate  # det(s I - A) > 0: it has no zero from s to infinity


def no_cone(c: Json, limit: int) -> None:
    """No proper polyhedral cone is invariant under every A: its Perron root would have to be an eigenvalue.

    No real eigenvalue is above the bound, but one is ahead of it, or exactly beside it: of one A, or, as in discrete
    time, of a product of resolvents (s_i I - A_i)^-1 (discrete time: of powers A_i^s_i), which keep every such cone
    as well; the product divided by its largest entry.
    """
    d, e = c["data"], c["proof"]
    need(bool(d.get("witness")), "the reason why there is no cone")
    w, discrete = d["witness"]["fields"], d["discrete"]
    expect(type(discrete) is bool, "discrete is neither true nor false")
    members = [matrix({"matrix": rows}, len(rows), len(rows)) for rows in d["matrices"]["matrix"]]
    if "normal" in w:
        return no_cone_between(d, w, members[0])
    if "order" in w:
        expect(discrete, "Jordan chains exclude cones in discrete time only")
        return longer_chains(members[index(w["matrix"])], w)
    if "cycle" in w:
        steps = zip(w["cycle"]["tuple"], numbers(w["shifts"]), strict=True)
        M = reduce(product, [power_or_resolvent(members[index(i)], s, discrete) for i, s in steps])
        unit, kind, discrete = max(abs(a) for row in M for a in row), "ahead", True
    else:
        M, unit = integers(members[index(w["matrix"])])
        kind = {"ahead": "ahead", "beside": "beside"}[w["kind"]]
    p, b = leverrier(M)[0], unit * numbers(w["bound"])[0]
    need(real_roots_beyond(p, b) == 0 and (b > 0 or not discrete), "no real eigenvalue is above the bound")
    if kind == "ahead":
        return root_ahead(p, [unit * x for x in numbers(e["z"])], b, discrete)
    return root_beside(p, b, discrete)


def longer_chains(A: Matrix, w: Json) -> None:
    """In discrete time, some eigenvalue of the modulus of the largest real one, rho > b >= 0, has a larger index.

    The index (length of the longest Jordan chain) of the spectral radius is the largest on its circle (Vandergraft).
    Let r be the product of the different factors of the characteristic polynomial, V = r(A)^k, and q the denominator of
    u'(s I - A)^-1 V x.  The roots of q have an index > k; rho has not, as q(A) V = 0 and no root of q is real and > b.
    One pole of u'(s I - A^N)^-1 V x is real and > b^N: it is z^N for a root z of q, and it is rho^N, the only real
    eigenvalue of A^N above b^N.
    """
    M, unit = integers(A)
    order, b, k = index(w["order"]), unit * numbers(w["bound"])[0], index(w["index"])
    expect(order <= 100 and k < len(A), "an order or an index is out of range")
    p, V = leverrier(M)[0], integers([{} for _ in A], 1)[0]
    for _ in range(k):
        V = applied(divided(p, common(p, derivative(p)))[0], M, V)
    u, start = numbers(w["functional"]), numbers(w["start"])
    x = [sum((a * c for a, c in zip(row, start, strict=True)), Fraction(0)) for row in V]
    q, turned = poles(p, M, x, u), reduce(product, [M] * order)
    need(b >= 0 and real_roots_beyond(p, b) == 1, "one real eigenvalue is above the bound")
    need(not any(a for row in applied(q, M, V) for a in row), "the poles are all eigenvalues of larger index")
    need(real_roots_beyond(q, b) == 0, "the real eigenvalue has no larger index")
    around = leverrier(turned)[0]
    need(real_roots_beyond(around, b**order) == 1, "one real eigenvalue of the power is above that of the bound")
    need(real_roots_beyond(poles(around, turned, x, u), b**order) == 1, "it is that of an eigenvalue of larger index")


def applied(p: Polynomial, M: list[list[int]], V: list[list[int]]) -> list[list[int]]:
    """p(M) V, by Horner's rule."""
    out = [[0] * len(row) for row in V]
    for a in p:
        out = [[x + a * y for x, y in zip(*rows, strict=True)] for rows in zip(product(M, out), V, strict=True)]
    return out


def poles(p: Polynomial, M: list[list[int]], x: list[Fraction], u: list[Fraction]) -> Polynomial:
    """The denominator of u'(s I - M)^-1 x = (numerator) / p."""
    h = responses(u, M, x, len(M))
    over = [sum((a * h[k - j] for j, a in enumerate(p[: k + 1])), Fraction(0)) for k in range(len(M))]
    return divided(p, common(p, primitive(over)))[0]


def power_or_resolvent(A: Matrix, s: Fraction, discrete: bool) -> list[list[int]]:
    """A^s in discrete time, (s I - A)^-1 otherwise, up to a positive factor."""
    if not discrete:
        return resolvent(A, s)
    expect(1 <= s <= 100 and s == int(s), "a power is not a small whole number")
    return reduce(product, [integers(A)[0]] * int(s))


def no_cone_between(d: Json, w: Json, A: Matrix) -> None:
    """No invariant cone holds the vectors b in `contains` and lies in the half-spaces c'x >= 0 in `within`.

    c'(s I - A)^-k b < 0 for an s beyond the real eigenvalues (discrete time: c'A^k b < 0);  for k = 1 it may be 0,
    as the integral of e^(-st) c'e^(At) b >= 0, unless c'A^j b = 0 for all j.
    """
    b, c = numbers(w["vector"]), numbers(w["normal"])
    need(b in [numbers(row) for row in d["contains"]["matrix"]], "b is to be in the cone")
    need(c in [numbers(row) for row in d["within"]["matrix"]], "c'x is to be >= 0 on the cone")
    if "terms" in w or "rates" in w:
        expect(not d["discrete"], "an impulse response at any time is for continuous time")
        (negative_response if "terms" in w else touching_response)(A, b, c, w)
        return
    k = index(w["power"])
    expect(k < 5000, "a power is not a small whole number")
    M = integers(A)[0]
    value = responses(c, M if d["discrete"] else resolvent(A, numbers(w["shift"])[0]), b, k)[k]
    touches = value == 0 and k == 1 and not d["discrete"] and any(responses(c, M, b, len(A)))
    need(value < 0 or touches, "c'(s I - A)^-k b < 0")


def negative_response(A: Matrix, b: list[Fraction], c: list[Fraction], w: Json) -> None:
    """c'e^(At) b < 0 at some t > 0: the first m terms of its series in t, and a bound on the others.

    With the largest row sum |A| of sizes, the others are at most |c|_1 |b|_max (|A| t)^m / m! / (1 - |A| t / m).
    """
    M, unit = integers(A)
    m, t = index(w["terms"]), numbers(w["time"])[0] / unit
    need(t > 0, "the time is positive")
    reach = t * max(sum(abs(a) for a in row) for row in M)
    expect(m < 1000, "there are too many terms")
    need(reach < m, "there are terms enough for a bound")
    total = sum((h * t**k / factorial(k) for k, h in enumerate(responses(c, M, b, m)[:m])), Fraction(0))
    size = sum(abs(a) for a in c) * max(abs(a) for a in b)
    need(total + size * reach**m / factorial(m) / (1 - reach / m) < 0, "c'e^(At) b < 0")


def touching_response(A: Matrix, b: list[Fraction], c: list[Fraction], w: Json) -> None:
    """h(t) = c'e^(At) b = sum_i r_i e^(s_i t) is 0 at some t > 0, but not always.

    Then no invariant cone between b and c is polyhedral: A + a I would keep it for some a, and no term of the series of
    e^(at) h(t) in t would be negative.  The rates s_i are eigenvalues, and the sum has the first n derivatives of h at
    t = 0, so that all agree.  All s_i are top - m_i unit, and with q = e^(-unit t), sum_i r_i q^m_i is 0 for some q
    between 0 and 1.
    """
    M, unit = integers(A)
    s, r, p = numbers(w["rates"]), numbers(w["weights"]), leverrier(M)[0]
    low, high = numbers(w["low"])[0], numbers(w["high"])[0]
    need(all(at(p, unit * x) == 0 for x in s), "the rates are eigenvalues")
    sums = [sum((y * (unit * x) ** k for x, y in zip(s, r, strict=True)), Fraction(0)) for k in range(len(M))]
    need(sums == responses(c, M, b, len(M))[: len(M)], "the response is a sum of exponentials")
    steps = [max(s) - x for x in s]
    below = lcm(*(step.denominator for step in steps))
    whole = [int(step * below) for step in steps]
    powers = [step // (gcd(*whole) or 1) for step in whole]
    expect(max(powers) < 100, "the exponents are too far apart")
    q, scale = [0] * (max(powers) + 1), lcm(*(y.denominator for y in r))
    for k, y in zip(powers, r, strict=True):
        q[-1 - k] += int(y * scale)
    need(any(q) and low >= 0 and high <= 1 and at(q, high) != 0, "the response is not always zero")
    need(real_roots_beyond(q, low) > real_roots_beyond(q, high), "the response is zero at some time")


def at(p: list[Any], x: Fraction) -> Fraction:
    """p(x)."""
    return reduce(lambda value, a: value * x + a, p, Fraction(0))


def responses(c: list[Fraction], M: list[list[int]], b: list[Fraction], k: int) -> list[Fraction]:
    """c'b, c'M b, ..., c'M^k b."""
    out = []
    for _ in range(k + 1):
        out.append(sum((x * y for x, y in zip(c, b, strict=True)), Fraction(0)))
        b = [sum((x * y for x, y in zip(row, b, strict=True)), Fraction(0)) for row in M]
    return out


# -- no feedback


def functionals(o: Json, C: Cone, count: int) -> list[Vector]:
    """Vectors of the dual cone, the columns of a matrix."""
    out = matrix(o, C.dim, count)
    need(all(above(f, C) for f in out), "a functional is nonnegative on its cone")
    return out


def inwards(d: Json, e: Json, X: Cone, m: int) -> list[tuple[Matrix, Matrix, list[Vector]]]:
    """A_s, B_s and l_sk >= 0 on X for all k, with l_sk'x_k = 0 in continuous time: A_s + B_s F keeps X only if

    l_sk'(A_s + B_s F) x_k >= 0.
    """
    expect(type(d["discrete"]) is bool, "discrete is neither true nor false")
    out = []
    for A, B, L in zip(d["A"]["tuple"], d["B"]["tuple"], e["L"], strict=True):
        l = functionals(L, X, len(X.rays))
        need(d["discrete"] or all(dot(f, x) == 0 for f, x in zip(l, X.rays, strict=True)), "l_k'x_k = 0")
        out.append((matrix(A, X.dim, X.dim), matrix(B, X.dim, m), l))
    return out


def size(d: Json, x: Vector) -> Fraction:
    """What a bound on |F x| is multiplied by: the leading entry of x, or 1 for generators as they stand in the file.

    The leading entry is the first of at least an eighth of the size of the largest.
    """
    expect(type(d.get("leading", False)) is bool, "leading is neither true nor false")
    top = max(map(abs, x.values()), default=Fraction(0))
    return next((abs(x[i]) for i in sorted(x) if 8 * abs(x[i]) >= top), top) if d.get("leading") else Fraction(1)


def marks(o: Json) -> list[list[Fraction]]:
    """Rows of 0 and 1."""
    out = [numbers(row) for row in o["array"]]
    expect(all(x in (0, 1) for row in out for x in row), "a mark is neither 0 nor 1")
    return out


def no_feedback(c: Json, limit: int) -> None:
    """No F and no point z = sum_k xi_k x_k, all xi_k > 0, satisfy for every vertex (A_s, B_s):

    A_s + B_s F keeps X,  A_s + B_s F + coupling + rate I maps z into -int X,  |F x_k| <= gain_bound `size`,
    (C + D F) x_k in Y,  (F x_k)_j = 0 where `free` is 0.  By Farkas' lemma: with l_sk as in `inwards`, d_s >= 0 on X
    and g_k >= 0 on Y they would make

        sum_k xi_k (sum_s l_sk'(A_s + B_s F) x_k + g_k'(C + D F) x_k) - sum_s d_s'(A_s + B_s F + coupling + rate I) z

    at least 0, and more if some d_s is not 0.  But this is sum_k xi_k (a_k + b_k'F x_k), where
    a_k + |b_k|'gain_bound <= 0 for all k, and < 0 for one k unless some d_s is not 0 (no bound: b_k = 0).
    """
    d, e = c["data"], c["proof"]
    X, free = cone(d["X"], limit), marks(d["free"])
    ports = d["ports"]["tuple"] if d["ports"] else [None, None, None]
    Y, m = cone(ports[2], limit), len(free[0])
    C, D = given(ports[0], Y.dim, X.dim), given(ports[1], Y.dim, m)
    coupling, bound = (
        given(d["coupling"], X.dim, X.dim),
        numbers(d["gain_bound"]) if d["gain_bound"] else [Fraction(0)] * m,
    )
    rate, g = numbers(d["rate"])[0] - d["discrete"], functionals(e["G"], Y, len(X.rays))
    vertices, ds = inwards(d, e, X, m), functionals(e["d"], X, len(d["A"]["tuple"]))
    need(all(b >= 0 for b in bound) and len(free) == len(X.rays), "the bounds are not negative")
    strict = any(ds)
    for k, x in enumerate(X.rays):
        a, b = dot(g[k], image(C, x)), pullback(g[k], D)
        for (A, B, l), f in zip(vertices, ds, strict=True):
            a += dot(l[k], image(A, x)) - dot(f, total((1, image(A, x)), (1, image(coupling, x)), (rate, x)))
            b = total((1, b), (1, pullback(l[k], B)), (-1, pullback(f, B)))
        b = {j: y for j, y in b.items() if free[k][j]}
        need(not b or d["gain_bound"] is not None, "b_k = 0")
        level = a + sum(abs(y) * bound[j] for j, y in b.items()) * size(d, x)
        need(level <= 0, "a_k + |b_k|'gain_bound <= 0")
        strict = strict or level < 0
    need(strict, "one of the inequalities is strict")


def no_invariant_gain(c: Json, limit: int) -> None:
    """No G with zeros where `pattern` is 0 is such that A_s + B_s G R keeps X for every s.

    With l_sk as in `inwards`, sum_sk l_sk'(A_s + B_s G R) x_k would be >= 0 for every such G;  but
    sum_sk l_sk'A_s x_k < 0, and sum_sk (B_s'l_sk)_i (R x_k)_j = 0 wherever G_ij may differ from 0.
    """
    d, e = c["data"], c["proof"]
    X, pattern = cone(d["X"], limit), marks(d["pattern"])
    R, level, slope = matrix(d["R"], len(pattern[0]), X.dim), Fraction(0), dict[tuple[int, int], Fraction]()
    for A, B, l in inwards(d, e, X, len(pattern)):
        for f, x in zip(l, X.rays, strict=True):
            level += dot(f, image(A, x))
            for (i, a), (j, b) in pairs(pullback(f, B).items(), image(R, x).items()):
                slope[i, j] = slope.get((i, j), Fraction(0)) + a * b
    need(level < 0, "sum l'A x < 0")
    need(all(not a or not pattern[i][j] for (i, j), a in slope.items()), "sum (B'l) (R x)' = 0")


# -- claims about other claims


def gain_bound(c: Json, limit: int) -> None:
    """|F x| <= bound, entry by entry, for the generators x, see `size`."""
    d = c["data"]
    X, bound = cone(d["X"], limit), numbers(d["bound"])
    F = matrix(d["F"], len(bound), X.dim)
    need(all(b >= 0 for b in bound), "a bound is not negative")
    need(all(abs(a) <= bound[i] * size(d, x) for x in X.rays for i, a in image(F, x).items()), "|F x| <= bound")


def feedback(c: Json, limit: int) -> None:
    """One gain does all that was asked: every part is PROVED, by a proof of its own."""
    loops, others = (c["data"][k]["tuple"] for k in ("loops", "others"))
    need(len(loops) > 0, "there is a closed loop")
    for part in loops + others:
        need(part["certificate"]["status"] == "PROVED", "all parts are proved")
        verify(part["certificate"], limit // len(loops + others))


def any_size(c: Json, limit: int) -> None:
    """Networks of any number of such nodes are positive and stable under every coupling W that maps Y into U and has

    sum_j r'W_jk y <= weight r'K y  for every node k:  q'y + weight r'K y <= 0 makes (III') true, with sigma = 1.
    `local` is the network of one node of each type with W = diag(weight K), K = link.  Several types have one r > 0 in
    common.  If D is not 0, t is a multiple of r: then every such loop contracts.  REFUTED: `local` is.
    """
    local, (link,) = c["data"]["local"]["certificate"], c["data"]["link"].values()
    need(local["claim"] == "network" and local["status"] == c["status"], "the self-loops decide")
    verify(local, limit)
    weight, (m, n) = numbers(c["data"]["weight"])[0], (len(link), len(link[0]))
    count = cone(local["data"]["Y"], limit).dim // n
    K, W = matrix({"matrix": link}, m, n), matrix(local["data"]["W"], count * m, count * n)
    loops = [{j * m + i: weight * a for i, a in column.items() if weight} for j in range(count) for column in K]
    need(loops == W and weight >= 0, "W = diag(weight K)")
    if c["status"] == "PROVED":
        exact = local["data"].get("exact")
        r, t = numbers(exact["tuple"][1] if exact else local["data"]["r"]), local["proof"].get("t")
        need(count == 1 or (len(set(r)) == 1 and r[0] > 0), "the types have one r > 0 in common")
        ratio = next((a / b for a, b in zip(numbers(t), r, strict=True) if b), Fraction(0)) if t else Fraction(0)
        need(not t or (ratio >= 0 and numbers(t) == [ratio * x for x in r]), "t is a multiple of r")


# -- files

PROOFS: dict[str, Callable[[System, Json], str | None]] = {
    "positive": positive,
    "stable": stable,
    "dissipative": dissipative,
    "disturbance gain": disturbance_gain,
    "common vector": common_vector,
    "invariant-cone": invariant,
    "differentially-positive": invariant,
    "network": network,
    "network abscissa": abscissa,
}
REFUTATIONS: dict[str, dict[str, Callable[[System, Json], None]]] = {
    "positive": {},
    "differentially-positive": {},
    "stable": {"motion": unstable},
    "dissipative": {"motion": not_dissipative},
    "network": {"motion": not_dissipative, "growth": grows, "loop": closed_loop, "weights": no_weights},
}
ALONE: dict[tuple[str, str], Callable[[Json, int], None]] = {
    ("gain bound", "PROVED"): gain_bound,
    ("feedback", "PROVED"): feedback,
    ("out-weight", "PROVED"): any_size,
    ("out-weight", "REFUTED"): any_size,
    ("invariant-cone", "REFUTED"): no_cone,
    ("feedback exists", "REFUTED"): no_feedback,
    ("invariant gain exists", "REFUTED"): no_invariant_gain,
}


def verify(c: Json, limit: int) -> str:
    """Prove the claim of a file, in which no size is above the limit; what it rests on or leaves out, in words."""
    claim, status, d = c["claim"], c["status"], c["data"]
    e: Json = c["proof"] | d
    need(status in ("PROVED", "REFUTED"), f"the file itself says {status}")
    if status == "REFUTED":
        rate, bound = (d.get(name, {"double": none})["double"] for name, none in (("decay_rate", 0), BOUNDLESS))
        need(rate == "nan" or number(rate) == 0, "a refutation has no decay rate")
        need(bound == BOUNDLESS[1], "a refutation has no bound on decay rates")
    asked = required_rate(d)  # not the one of a proof, which states nothing
    expect("omitted" not in c["proof"], f"it leaves out its proof: {c['proof'].get('omitted')}")
    expect(not any(name.endswith("exact") for name in c["proof"]), "what is claimed stands in the data")
    if (claim, status) in ALONE:
        ALONE[claim, status](c, limit)
        return ""
    expect(claim in PROOFS or claim in {name for name, _ in ALONE}, f"the claim {str(claim)[:40]} is unknown")
    need(claim in (PROOFS if status == "PROVED" else REFUTATIONS), "this is not shown in such a way")
    source = d.get("source", "vertices")
    expect(source in ("vertices", "enclosed", "sampled"), f"the source {str(source)[:40]} is unknown")
    need((source, status) != ("sampled", "PROVED"), "what is known at points proves nothing between them")
    cones = [cone(d.get(name), limit) for name in "XUY"]
    if claim == "differentially-positive" and status == "REFUTED" and "member" not in e:
        at = d["witness"]["fields"]
        need(at["point"] is not None, "a Jacobian of the file, or one at a point")
        crossed(system(d, {"matrix": at["centre"]["array"]}, at["radius"], cones), e)
        return "given the bounds on the Jacobian at a point"
    single = "tuple" not in d["A"]
    family = [d["A"]] if single else d["A"]["tuple"]
    radii = d["radii"]["tuple"] if "radii" in d else [None] * len(family)
    expect(len(family) > 0, "there is no matrix")
    note = "given the bounds on the Jacobians" if "radii" in d else ""
    if status == "PROVED":
        for A, radius, P in zip(family, radii, [e.get("P")] if single else e["P"], strict=True):
            note = PROOFS[claim](system(d, A, radius, cones), e | {"P": P}) or note
        return note
    k = index(e.get("member", 0))
    s = system(d, family[k], radii[k], cones)
    if "normal" in e:
        crossed(s, e)
    else:
        positive(s, e)
        slowest = s.discrete - (asked if claim == "stable" else 0)
        decays = number(e["rate"]) < s.discrete and number(e["rate"]) <= slowest
        need(not decays or (number(e["rate"]) == slowest and bool(motion(s, e)[3])), "the motion decays too fast")
        REFUTATIONS[claim][e["shows"]](s, e)
    return note


def unique(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    """An object in which no key occurs twice."""
    expect(len(dict(pairs)) == len(pairs), "a key occurs twice")
    return dict(pairs)


def whole(text: str) -> int:
    """A JSON integer of at most 20 characters; no other number is allowed outside of text."""
    expect(len(text) < 21, "an integer is too long")
    return int(text)


def main(path: str | Path) -> int:
    """Say what a file proves, and return the exit status."""
    try:
        expect(Path(path).is_file(), "it is not a regular file, or does not exist")
        text = Path(path).read_text(encoding="utf-8")
        c = json.loads(text, parse_float=whole, parse_constant=whole, parse_int=whole, object_pairs_hook=unique)
        expect(c["format"] == "kpos-certificate/1", "of another format")
        data = json.dumps(c["data"], sort_keys=True, separators=(",", ":"))
        digest = "sha256:" + hashlib.sha256(data.encode()).hexdigest()
        need(c["digest"] == digest, "the data have the stated digest")
        note = verify(c, len(text) + 20_000)
    except Wrong as reason:
        print(f"WRONG      {path}: not proven: {str(reason)[:200]}")
        return 1
    except Exception as reason:  # noqa: BLE001 - whatever a hostile file provokes
        print(f"UNREADABLE {path}: {type(reason).__name__}: {str(reason)[:200]}")
        return 2
    print(f"{c['status']:10} {path}: {c['claim']}{note and f' ({note})'}")
    return 0 if c["status"] == "PROVED" else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]) if len(sys.argv) == 2 else 2)
