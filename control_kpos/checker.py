"""Check a certificate in the format kpos-certificate/1 without control_kpos: exact arithmetic, standard library only.

    python -m control_kpos.checker FILE      or, with this file alone,      python checker.py FILE
    python checker.py FOLDER [--shard N] [--network FOLDER]      a certificate in shards, all of them or the N-th only

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
from array import array as packed
from bisect import bisect
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial, reduce
from itertools import accumulate, groupby, pairwise, repeat
from itertools import product as pairs
from math import factorial, gcd, isfinite, lcm, prod
from pathlib import Path
from typing import Any

Vector = dict[int, Fraction]  # entries that are not zero, by index
Matrix = list[Vector]  # columns
Node = tuple[range, range, range]  # its states, inputs and outputs
Polynomial = list[int]  # coefficients, the highest power first, up to a positive factor
Json = Any

NONE: Any = 0  # integers stay integers in sums
DOUBLE = re.compile(r"(-?0x[0-9a-f]{1,30})(?:\.([0-9a-f]{0,30}))?p([+-][0-9]{1,4})")
HEXADECIMAL = re.compile(r"(-?0x[0-9a-f]{1,20000})(?:/(0x[0-9a-f]{1,20000}))?")
DECIMAL = re.compile(r"-?[0-9]{1,4000}(\.[0-9]{1,4000}|/[0-9]{1,4000})?")


class Wrong(Exception):  # noqa: N818 - it says what the file is
    """The file does not prove what it says.  Every other exception: it is not readable, or has no proof."""


class Omitted(ValueError):  # noqa: N818
    """The file has no proof that can be read without control_kpos."""


def need(fact: bool, what: str) -> None:
    """Stop unless this part of the proof holds: an inequality that is false makes a file wrong."""
    if not fact:
        raise Wrong(what)


def expect(fact: bool, what: str) -> None:
    """Stop unless the file is written as the format says, and its data fit together: else it is unreadable."""
    if not fact:
        raise ValueError(what)


# Entries that may say anything: titles, and what control_kpos proves the same from instead of `proof`, in floating
# point and by its own count of facets and inequalities.
UNREAD = {"multipliers", "pointing", "right_inverse", "shares"}
# And in witnesses, where those of version 0.1 also have what follows from the rest.
UNREAD_IN_WITNESSES = (
    UNREAD
    | {"weights", "facet"}
    | {
        *("value", "normal", "generator", "real", "imag", "discrete", "radius", "time", "zero", "nodes"),
        *("q", "r", "q_exact", "r_exact"),
    }
)


class Said(dict[str, Json]):
    """Entries of a file; a missing one is null.  All have to be looked at, but for those that are null, and UNREAD."""

    def __init__(self, entries: Json) -> None:
        super().__init__(entries)
        self.seen: set[str] = set()
        self.inner: list[Said] = []

    def __getitem__(self, key: str) -> Json:
        return self.get(key)

    def get(self, key: str, default: Json = None) -> Json:
        """The entry, or what stands for a missing one."""
        self.seen.add(key)
        return super().get(key, default)


def record(e: Said, key: str, *kinds: str) -> tuple[str, Said]:
    """The kind of a record, one of these, and its fields."""
    expect(e[key].keys() == {"record", "fields"}, f"{key} is no record")
    kind, fields = e[key]["record"], Said(e[key]["fields"])
    expect(kind in kinds, f"{key} is {str(kind)[:40]}, which is not shown in such a way")
    e.inner.append(fields)
    return kind, fields


def unread(e: Said, free: set[str]) -> list[str]:
    """The names of what nobody looked at, here and in the witness."""
    own = [name for name, x in e.items() if x is not None and name not in e.seen | free]
    return own + [name for fields in e.inner for name in unread(fields, UNREAD_IN_WITNESSES)]


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


def binary(text: Json) -> Fraction:
    """A number that is a double."""
    x = number(text)
    short = x.denominator == 1 and abs(x.numerator) < 2**53
    expect(short or float(x).as_integer_ratio() == x.as_integer_ratio(), "a number is no double")
    return x


def content(o: Json, *kinds: str) -> Json:
    """What stands in an object with one entry, of one of these kinds."""
    ((kind, inner),) = o.items()
    expect(kind in kinds, f"{str(kind)[:40]} in the place of {' or '.join(kinds)}")
    return inner


def listing(o: Json) -> list[Json]:
    """A list."""
    expect(isinstance(o, list), "something else in the place of a list")
    return o


def double(o: Json) -> Fraction:
    """{"double": number}."""
    return binary(content(o, "double"))


def fraction(o: Json) -> Fraction:
    """{"fraction": number}."""
    return number(content(o, "fraction"))


def fractions(o: Json) -> list[Fraction]:
    """{"fractions": [number, ...]}, {"tuple": []} if there is none."""
    if o == {"tuple": []}:
        return []
    numbers = [number(x) for x in listing(content(o, "fractions"))]
    expect(bool(numbers), "no fractions are an empty tuple")
    return numbers


def array(o: Json, depth: int = 1) -> list[Fraction]:
    """The doubles in {"array": ...}, lists of this depth, those beside each other of one length."""
    items = listing(content(o, "array"))
    for _ in range(depth - 1):
        expect(len({len(listing(part)) for part in items}) < 2, "lists of numbers are ragged")
        items = [x for part in items for x in part]
    return [binary(x) for x in items]


def either(o: Json) -> Fraction:
    """{"double": ...} or {"fraction": ...}."""
    return double(o) if "double" in o else fraction(o)


def sequence(o: Json) -> list[Json]:
    """{"tuple": [...]}."""
    return listing(content(o, "tuple"))


def nodewise(o: Json) -> list[Fraction]:
    """Vectors of all nodes, one after another: one array, an array of them, or a tuple of arrays."""
    if "tuple" in o:
        return [x for part in sequence(o) for x in array(part)]
    return array(o, 2 if any(isinstance(part, list) for part in content(o, "array")) else 1)


def exactly(o: Json, *names: str, read: Callable[[Json], list[Fraction]] = array) -> list[list[Fraction]]:
    """Vectors of doubles, or what rounds to them: `name`_exact, or all of `exact`; [] for null."""
    beside, out = o.get("exact"), []
    if beside is None:
        given = [o.get(name + "_exact") for name in names]
    else:  # then nobody looks at the others
        given = [beside] if len(names) == 1 else sequence(beside)
        expect(None not in given, "an exact vector is missing")
    for name, exact in zip(names, given, strict=True):
        rounded = [] if o[name] is None else read(o[name])
        out.append(rounded if exact is None else fractions(exact))
        expect(exact is None or [float(x) for x in out[-1]] == rounded, f"{name} is not its exact vector rounded")
    return out


def entries(numbers: list[Fraction], n: int) -> Vector:
    """The vector of these numbers, of which there are n."""
    expect(len(numbers) == n, f"a vector has {len(numbers)} entries instead of {n}")
    return {i: x for i, x in enumerate(numbers) if x}


def matrix(o: Json, m: int, n: int) -> Matrix:
    """An m x n matrix, {"matrix": rows} or {"sparse": [[row, column, number], ...], "shape": [m, n]}."""
    out: Matrix = [{} for _ in range(n)]
    if "matrix" in o:
        rows = [listing(row) for row in listing(content(o, "matrix"))]
        fits = len(rows) == m and all(len(row) == n for row in rows)
        entries = [(i, j, x) for i, row in enumerate(rows) for j, x in enumerate(row)]
    else:
        expect(o.keys() == {"sparse", "shape"}, "something else in the place of a matrix")
        fits, entries = [index(side) for side in o["shape"]] == [m, n], o["sparse"]
    expect(fits, f"a matrix is not {m} x {n}")
    for i, j, x in entries:
        expect(type(i) is int and type(j) is int and 0 <= i < m and 0 <= j < n, "an entry is out of range")
        expect(i not in out[j], "an entry occurs twice")
        out[j][i] = number(x)
    return [{i: a for i, a in column.items() if a} for column in out]


def given(o: Json, m: int, n: int) -> Matrix:
    """A matrix of the data; in a sparse one all numbers are doubles."""
    for _, _, x in o.get("sparse", ()):
        binary(x)
    return matrix(o, m, n)


def optional(o: Json, m: int, n: int) -> Matrix:
    """A matrix of the data, or zeros where there is none."""
    return [{} for _ in range(n)] if o is None else given(o, m, n)


def rows(o: Json, n: int) -> list[list[Fraction]]:
    """The rows of a matrix with n columns."""
    m = index(o["shape"][0]) if "sparse" in o else len(content(o, "matrix"))
    columns = given(o, m, n)
    return [[column.get(i, Fraction(0)) for column in columns] for i in range(m)]


def total(*terms: tuple[Fraction | int, Vector]) -> Vector:
    """The sum of c x over pairs (c, x)."""
    out: Vector = {}
    for c, x in terms:
        for i, a in x.items():
            out[i] = out.get(i, 0) + c * a
    return {i: a for i, a in out.items() if a}


def dot(f: Vector, x: Vector) -> Fraction:
    """f'x."""
    short, long = (f, x) if len(f) < len(x) else (x, f)
    return sum((a * long[i] for i, a in short.items() if i in long), NONE)


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
    """A proper polyhedral cone in R^dim: its generators x_k, and vectors z_j of weights, sum_k z_jk x_k = e_j.

    It is the product of `factors`, of which the coordinates and the numbers of the generators are here.
    """

    dim: int
    rays: list[Vector]
    Z: Matrix
    factors: list[tuple[range, range]]


def is_simplicial(C: Cone) -> bool:
    """There are as many generators as dimensions, and one z_j only, for each j."""
    return len(C.rays) == C.dim


def by_generator(C: Cone) -> list[Vector]:
    """h_k with h_kj = z_jk, for every generator; those of a simplicial cone are its facets."""
    out: list[Vector] = [{} for _ in C.rays]
    for j, z in enumerate(C.Z):
        for k, a in z.items():
            out[k][j] = a
    return out


def cone(o: Json, limit: int) -> Cone:
    """A product of factors, each `count` times.  Pointed: w'x > 0.  Solid: R Z = I, the columns of R being x.

    Of a simplicial factor nobody reads w and Z, as R has an inverse or is wrong.
    """
    out = Cone(0, [], [], [])
    for count, factor in () if o is None else content(o, "cone"):
        expect(factor.keys() <= {"rays", "w", "Z"}, "a cone has something else")
        n, p = len(listing(factor["rays"][0])), len(factor["rays"])
        expect(type(count) is int and 0 < count * n <= limit - out.dim, "a size is absurd for this file")
        rays = matrix({"matrix": [list(row) for row in zip(*factor["rays"], strict=True)]}, n, p)
        if p == n:
            expect(n <= 64, "the inverse of a cone is too long")
            Z = inverse(rays)
        else:
            Z, w = matrix({"matrix": factor["Z"]}, p, n), entries([number(x) for x in factor["w"]], n)
            need(all(dot(w, x) > 0 for x in rays), "a cone is pointed")
            need(all(image(rays, z) == {j: 1} for j, z in enumerate(Z)), "a cone is solid")
        for _ in range(count):
            first = len(out.rays)
            out.factors.append((range(out.dim, out.dim + n), range(first, first + p)))
            out.rays += [{out.dim + i: a for i, a in x.items()} for x in rays]
            out.Z += [{first + k: a for k, a in z.items()} for z in Z]
            out.dim += n
    return out


def weights(C: Cone, ys: list[Vector], o: Json) -> list[Vector]:
    """w with y = sum_k w_k x_k for vectors y: those of the file, one a column; in a simplicial cone there is one w."""
    return matrix(o, len(C.rays), len(ys)) if ys and not is_simplicial(C) else [image(C.Z, y) for y in ys]


def inside(target: Cone, y: Vector, w: Vector, what: str, free: int | None = None) -> None:
    """y = sum_k w_k x_k with w_k >= 0 for all k but `free`."""
    need(all(a >= 0 or k == free for k, a in w.items()), f"{what} (a weight is negative)")
    need(image(target.rays, w) == y, f"{what} (weights)")


def above(f: Vector, C: Cone) -> bool:
    """f is in the dual cone: f'x >= 0 on C."""
    return all(dot(f, x) >= 0 for x in C.rays)


def facets(C: Cone, limit: int) -> list[Vector]:
    """Vectors h whose combinations with weights >= 0 are the dual cone: C is where h'x >= 0 for all of them.

    Of a simplicial factor the rows of the inverse.
    """
    out, inverses = list[Vector](), by_generator(C)
    for places, numbers in C.factors:
        simplicial = len(places) == len(numbers)
        rays, inverse = ([part[k] for k in numbers] for part in (C.rays, inverses))
        out += inverse if simplicial else dual(places, rays, limit)
    return out


Facet = tuple[Vector, frozenset[int]]  # h, and the numbers of the x with h'x = 0


def dual(places: range, rays: list[Vector], limit: int) -> list[Vector]:
    """The same for generators x with these coordinates, one x after another (Motzkin's double description).

    Before x, {h : h'x >= 0 for all x so far} are the combinations of `lines`, of either sign, and of `found`, with
    weights >= 0.  If l'x != 0 for a line, all else moves along it to h'x = 0, and l or -l stays, as a facet.  If not,
    those with h'x < 0 give way to their combinations, with h'x = 0, with those of h'x > 0.
    """
    lines, found = [{i: Fraction(1)} for i in places], list[Facet]()
    for k, x in enumerate(rays):
        across = [line for line in lines if dot(line, x)]
        if across:
            bent = total((1 / dot(across[0], x), across[0]))
            lines = [moved(line, bent, x) for line in lines if line is not across[0]]
            found = [(moved(h, bent, x), zeros | {k}) for h, zeros in found] + [(bent, frozenset(range(k)))]
        else:
            found = extreme(cut(found, x, k, limit))
    return [h for h, _ in found]


def moved(h: Vector, line: Vector, x: Vector) -> Vector:
    """h - (h'x) line, which is 0 at x if line'x = 1."""
    return total((1, h), (-dot(h, x), line))


def cut(found: list[Facet], x: Vector, k: int, limit: int) -> list[Facet]:
    """What generates the part of the cone of `found` with h'x >= 0; x has the number k."""
    at = [(h, zeros, dot(h, x)) for h, zeros in found]
    ahead, behind = ([entry for entry in at if sign * entry[2] > 0] for sign in (1, -1))
    expect(len(ahead) * len(behind) <= limit, "a cone has too many facets")
    kept = [(h, zeros) for h, zeros, _ in ahead] + [(h, zeros | {k}) for h, zeros, a in at if a == 0]
    for h, here, a in ahead:
        for g, there, b in behind:
            both = total((a, g), (-b, h))
            kept.append((total((1 / max(sizes(both).values()), both)), (here & there) | {k}))
    return kept


def extreme(found: list[Facet]) -> list[Facet]:
    """Without those that are combinations of others: some other vanishes on more, or an earlier one on the same."""
    first = {zeros: h for h, zeros in reversed(found)}
    return [(h, zeros) for zeros, h in first.items() if not any(zeros < others for others in first)]


def listed(e: Said, name: str, y: Vector, target: Cone) -> None:
    """y is in a cone by its weights, w<name> in the file."""
    inside(target, y, weights(target, [y], e.get("w" + name))[0], f"w{name} shows a vector in its cone")


# -- systems

# The signals that a matrix maps to, and those that it maps from: states 0, inputs 1, outputs 2.
SIGNALS = {"A": (0, 0), "B": (0, 1), "C": (2, 0), "D": (2, 1), "W": (1, 2)}


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
    nodes: list[Node]
    unit: Any = 1  # the matrices, and rates, are multiplied by this

    def cones(self) -> tuple[Cone, Cone, Cone]:
        """X, U and Y."""
        return self.X, self.U, self.Y

    def owners(self) -> list[list[int]]:
        """The node of every state, of every input, and of every output."""
        return [[j for j, node in enumerate(self.nodes) for _ in node[kind]] for kind in range(3)]


def system(d: Said, A: Json, radius: Json, cones: list[Cone], free: str) -> System:
    """The system in the data of a file; zero are W, D as far as they are free to be missing, and what has no size."""
    X, U, Y = cones
    nodes = side_by_side(d, cones)
    shapes = {"B": (X.dim, U.dim), "C": (Y.dim, X.dim), "D": (Y.dim, U.dim), "W": (U.dim, Y.dim)}
    rest = {name: optional(d.get(name), *shape) for name, shape in shapes.items()}
    missing = [name for name, shape in shapes.items() if d.get(name) is None and name not in free and 0 not in shape]
    expect(not missing, f"{', '.join(missing)} is not there")
    expect(type(d["discrete"]) is bool, "discrete is neither true nor false")
    bounds = [{} for _ in range(X.dim)] if radius is None else entrywise(radius, X.dim)
    expect(all(a >= 0 for column in bounds for a in column.values()), "a radius is negative")
    closed = d.get("own_links_closed")
    expect(closed is None or closed is True, "own_links_closed is true where it stands")
    out = System(given(A, X.dim, X.dim), X=X, U=U, Y=Y, discrete=d["discrete"], radius=bounds, nodes=nodes, **rest)
    owners = out.owners()
    for name, (to, of) in SIGNALS.items():
        apart = any(owners[to][i] != owners[of][k] for k, column in enumerate(getattr(out, name)) for i in column)
        expect(name == "W" or not apart, f"{name} has entries outside the blocks of the nodes")
    return own_links_closed(out) if closed else out


def entrywise(o: Json, n: int) -> Matrix:
    """Doubles for the entries of an n x n matrix, in an array."""
    expect(len(array(o, 2)) == n * n, "there is a number for every entry")
    return matrix({"matrix": content(o, "array")}, n, n)


def side_by_side(d: Said, cones: list[Cone]) -> list[Node]:
    """The nodes of a network, of the `sizes` that it states; of another system all of it."""
    ends, out = [0, 0, 0], list[Node]()
    if "sizes" not in d:
        return [(range(cones[0].dim), range(cones[1].dim), range(cones[2].dim))]
    expect(all(len(node) == 3 for node in content(d["sizes"], "array")), "a node has three sizes")
    for node in zip(*[iter(array(d["sizes"], 2))] * 3, strict=True):
        expect(all(n >= 0 and n == int(n) for n in node), "a size is negative or no whole number")
        starts, ends = ends, [first + int(n) for first, n in zip(ends, node, strict=True)]
        out.append((range(starts[0], ends[0]), range(starts[1], ends[1]), range(starts[2], ends[2])))
    expect(ends == [C.dim for C in cones], "the sizes are not those of the nodes")
    return out


def repeated(d: Said, cones: list[Cone], limit: int) -> None:
    """What a network says twice: its time, and the cones of its nodes, whose numbers among `cones` are in `stack`.

    Nodes have names, or have none.
    """
    dt = d["dt"] or 0  # null in continuous time
    step = dt if isinstance(dt, int) else double(dt)
    expect(step >= 0 and bool(step) == d["discrete"], "dt is 0 in continuous time only")
    expect(d["sizes"] is not None, "the nodes have no sizes")
    stack, kinds = [int(x) for x in array(d["stack"])], [sequence(kind) for kind in sequence(d["cones"])]
    names = stack if d.get("names") is None else sequence(d["names"])
    expect(names is stack or all(type(name) is str for name in names), "names are text")
    expect(stack == array(d["stack"]), "numbers of cones are whole")
    expect(len(stack) == len(names) == len(side_by_side(d, cones)), "a number, and a name, for every node")
    expect(set(stack) == set(range(len(kinds))) and all(len(kind) == 3 for kind in kinds), "all cones are there")
    dims = [[cone(C, limit).dim for C in kind] for kind in kinds]
    fits = all(list(map(len, node)) == dims[j] for j, node in zip(stack, side_by_side(d, cones), strict=True))
    expect(fits, "the sizes of the nodes are those of their cones")
    for kind, whole in enumerate(cones):
        runs = [run for j in stack for run in content(kinds[j][kind], "cone")]
        expect(cone({"cone": runs}, limit).rays == whole.rays, "X, U and Y are products of the cones of the nodes")


def positive(s: System, e: Said) -> None:
    """X, U, Y are kept: Theorem 1 (`cone_inv`), with weights P, N, L, K, M in the place of facets.

    A x_i = sum_k P_ki x_k with P_ki >= 0 for k != i (discrete time: all k),  B u_i = sum_k N_ki x_k,
    C x_i = sum_k L_ki y_k,  D u_i = sum_k K_ki y_k,  and in networks (I): W y_i = sum_k M_ki u_k,  all >= 0.
    """
    maps(s.X, s.A, s.X, e.get("P"), "A X in X", diagonal=not s.discrete)
    maps(s.U, s.B, s.X, e.get("N"), "B U in X")
    maps(s.X, s.C, s.Y, e.get("L"), "C X in Y")
    maps(s.U, s.D, s.Y, e.get("K"), "D U in Y")
    maps(s.Y, s.W, s.U, e.get("M"), "W Y in U")


def maps(source: Cone, M: Matrix, target: Cone, o: Json, what: str, *, diagonal: bool = False) -> None:
    """M maps the generators of a cone into another, or (`diagonal`) no generator away from its own direction."""
    ys = [image(M, x) for x in source.rays]
    for i, (y, w) in enumerate(zip(ys, weights(target, ys, o), strict=True)):
        inside(target, y, w, what, i if diagonal else None)


def crossed(s: System, e: Said, kind: str, w: Said) -> None:
    """Not positive: h'M x < 0 for a generator x and an h that is nonnegative on the cone M x should be in.

    h is a facet if this cone is simplicial, else in the file.  For A in continuous time also h'x = 0: x lies on the
    plane that the field crosses.  For Jacobians with bounds h'A x + |h|'radius |x| < 0.  The witness names the matrix
    and the generator, in networks those of nodes.
    """
    target = source = index(w["node"]) if kind == "NodeViolation" else 0
    if kind == "CouplingViolation":
        target, source, name = index(w["target"]), index(w["source"]), "W"
    elif kind == "DifferentialViolation":
        name = "A"
    else:
        w = record(w, "violation", "PositivityViolation")[1] if kind == "NodeViolation" else w
        name = {"A X in X": "A", "B U in X": "B", "C X in Y": "C", "D U in Y": "D"}[w["condition"]]
    to, of = SIGNALS[name]
    cone, places = s.cones()[to], s.nodes[source][of]
    x = [x for x in s.cones()[of].rays if all(i in places for i in x)][index(w["ray"])]
    if kind == "PlaneViolation":
        planes = [entries(fractions(w["normal_exact"]), cone.dim)]
    else:
        planes = by_generator(cone) if is_simplicial(cone) else matrix(e["normal"], cone.dim, 1)
    planes = [h for h in planes if all(i in s.nodes[target][to] for i in h) and above(h, cone)]
    moved, spread = image(getattr(s, name), x), image(s.radius, sizes(x)) if name == "A" else {}
    on = [h for h in planes if name != "A" or s.discrete or dot(h, x) == 0]
    need(any(dot(h, moved) + dot(sizes(h), spread) < 0 for h in on), f"{name} crosses a plane that x lies on")


def index(k: Json) -> int:
    """A number of something in a list."""
    expect(type(k) is int and k >= 0, "an index is not a whole number")
    return k


def supply(s: System, e: Said) -> tuple[Vector, Vector | None]:
    """q and r of the supply r'u + q'y, in networks those of all nodes; r is null where any will do."""
    *v, r, q = exactly(e, *"vrq", read=nodewise) if "sizes" in e else exactly(e, *"rq")
    expect(not any(v), "a witness has no use for v")
    return entries(q, s.Y.dim), None if e["r"] is None else entries(r, s.U.dim)


def required_rate(e: Said) -> Fraction:
    """The rate that was asked for, which is positive, or 0."""
    rate = fraction(e["required_rate"]) if e.get("required_rate") is not None else Fraction(0)
    expect(rate > 0 or e.get("required_rate") is None, "a rate that is asked for is positive")
    return rate


def absent(e: Said, name: str, sign: str) -> None:
    """A number that nothing shows is not there, or only the sign that stands for none."""
    inner = content(e.get(name, {"double": sign}), "double")
    zero = inner not in ("inf", "-inf", "nan") and binary(inner) == 0
    need(inner == sign or (zero and sign == "nan"), f"nothing shows a {name}")


def decay_rate(e: Said) -> Fraction:
    """The rate that is proven, which is not negative."""
    rate = double(e["decay_rate"])
    expect(rate >= 0, "a decay rate is negative")
    return rate


def decay_rate_or_none(e: Said) -> Fraction:
    """The rate that is proven; 0 where none is stated."""
    return decay_rate(e) if "decay_rate" in e else Fraction(0)


def decreases(s: System, v: Vector, q: Vector, *rates: Fraction) -> None:
    """v'x > 0,  (v'A - q'C) x < 0,  (v'A - q'C) x + rate v'x <= 0."""
    drift = total((1, pullback(v, s.A)), (-s.discrete * s.unit, v), (-1, pullback(q, s.C)))
    need(all(dot(v, x) > 0 for x in s.X.rays), "v'x > 0")
    need(all(dot(drift, x) < 0 for x in s.X.rays), "(v'A - q'C) x < 0")
    for rate in rates:
        need(all(dot(drift, x) + rate * dot(v, x) <= 0 for x in s.X.rays), "(v'A - q'C) x + rate v'x <= 0")


def supplied(s: System, v: Vector, q: Vector, r: Vector) -> None:
    """v'B u <= r'u + q'D u."""
    excess = total((1, pullback(v, s.B)), (-s.unit, r), (-1, pullback(q, s.D)))
    need(all(dot(excess, u) <= 0 for u in s.U.rays), "v'B u <= r'u + q'D u")


def balance(s: System, q: Vector, r: Vector) -> None:
    """q'y + r'W y <= 0."""
    received = total((s.unit, q), (1, pullback(r, s.W)))
    need(all(dot(received, y) <= 0 for y in s.Y.rays), "q'y + r'W y <= 0")


def stable(s: System, e: Said) -> str:
    """Exponentially stable on X, and so everywhere: Theorem 2 (`cone_s`).

    positive,  v'x > 0,  v'A x < 0,  v'A x + decay_rate v'x <= 0,  v'A x + required_rate v'x <= 0.
    No v has a rate above decay_rate_bound = b: z != 0, the slow direction, and A z + b z are in X.
    """
    positive(s, e)
    decreases(s, entries(exactly(e, "v")[0], s.X.dim), {}, decay_rate(e), required_rate(e))
    if e.get("slow_direction") is None:
        absent(e, "decay_rate_bound", "inf")
        return ""
    z = entries(exactly(e, "slow_direction")[0], s.X.dim)
    moved = total((1, image(s.A, z)), (double(e["decay_rate_bound"]) - s.discrete, z))
    need(bool(z), "the slow direction is not zero")
    if "ws" not in e and not is_simplicial(s.X):
        return "decay_rate_bound is not covered: its weights are not in the file"
    listed(e, "s", z, s.X)
    listed(e, "b", moved, s.X)
    return ""


def dissipative(s: System, e: Said) -> None:
    """Exponentially dissipative with storage v'x and supply r'u + q'y: Theorem 3 (`cone_d`).

    positive,  v'x > 0,  (v'A - q'C) x < 0,  (v'A - q'C) x + decay_rate v'x <= 0,  v'B u <= r'u + q'D u.
    """
    positive(s, e)
    decreases(s, *storage(s, e), decay_rate(e))


def storage(s: System, e: Said) -> tuple[Vector, Vector]:
    """v and q, with  v'B u <= r'u + q'D u."""
    v, (q, r) = entries(exactly(e, "v")[0], s.X.dim), supply(s, e)
    expect(r is not None, "r is there")
    supplied(s, v, q, r or {})
    return v, q


def disturbance_gain(s: System, e: Said) -> None:
    """The L-infinity gain is below g, for the system whose transposed matrices are in the file.

    The system in the file, on the dual cone, is dissipative with q = -1 and r = g 1; U and Y are orthants.
    """
    expect(all(len(x) == 1 for C in (s.U, s.Y) for x in C.rays), "U and Y are orthants")
    q, r = supply(s, e)
    bound = r.get(0, Fraction(0)) if r else Fraction(0)
    alike = r == {i: bound for i in range(s.U.dim) if bound}
    expect(q == dict.fromkeys(range(s.Y.dim), -1) and alike, "the supply is g 1'u - 1'y")
    positive(s, e)
    decreases(s, *storage(s, e))


def structured_gain(s: System, e: Said) -> None:
    """With blocks b of inputs and outputs, G(0) (discrete time: G(1)) has its structured gain in [lower, upper].

    positive,  U and Y are orthants.  From above, by a Schur test:  w, u, d > 0,  d w >= r  and  z >= d u  by block,
    -(A x + B w) in X,  C x + D w <= upper u,  p'x > 0,  (p'A + z'C) x < 0,  p'B + z'D <= upper r'.
    From below, unless lower is 0:  a, y >= 0,  a != 0,  A s + B a in X,  y <= C s + D a,  c >= lower a,
    |y_b| >= |c_b|  for every block.  If upper is 0 see `without_gain`.
    """
    positive(s, e)
    expect(all(len(x) == 1 and min(x.values()) > 0 for C in (s.U, s.Y) for x in C.rays), "U and Y are orthants")
    ins, outs = blocks(s, e)
    n, m, q, count = s.X.dim, len(ins), len(outs), len(set(ins))
    lower, upper = double(e["lower"]), double(e["upper"])
    if upper == 0:
        expect(lower == 0, "lower is not above upper")
        without_gain(s, e, ins, outs)
        return
    expect(min(lower, upper) >= 0, "a bound is negative")
    lengths = dict(zip("wudrzxp", (m, q, count, m, q, n, n), strict=True))
    w, u, d, r, z, x, p = (entries(array(e[name]), length) for name, length in lengths.items())
    need(
        all(all(y.get(i, 0) > 0 for i in range(lengths[name])) for name, y in zip("wud", (w, u, d), strict=True)), "> 0"
    )
    need(nonnegative(total((1, {i: d[b] * w[i] for i, b in enumerate(ins)}), (-1, r))), "d w >= r")
    need(nonnegative(total((1, z), (-1, {j: d[b] * u[j] for j, b in enumerate(outs)}))), "z >= d u")
    listed(e, "z", total((-1, drift(s, x)), (-1, image(s.B, w))), s.X)
    need(nonnegative(total((upper, u), (-1, image(s.C, x)), (-1, image(s.D, w)))), "C x + D w <= upper u")
    decreases(s, p, total((-1, z)))
    need(nonnegative(total((upper, r), (-1, pullback(p, s.B)), (-1, pullback(z, s.D)))), "p'B + z'D <= upper r'")
    if lower > 0:
        reached(s, e, lower, ins, outs)


def without_gain(s: System, e: Said, ins: list[int], outs: list[int]) -> None:
    """No input comes back to its block, so that the structured gain is 0, on simplicial cones:  p'x > 0 > p'A x.

    Levels of the generators and of the blocks do not fall from j to i if A x_j has a weight at x_i, nor from the block
    of an input k to i if B e_k has;  they rise from j to the blocks of the outputs in C x_j, and from the block of an
    input k to those of the outputs in D e_k.
    """
    expect(is_simplicial(s.X), "the weights of vectors are known")
    decreases(s, entries(array(e["p"]), s.X.dim), {})
    levels, own = array(e["levels"]), array(e["block_levels"])
    expect((len(levels), len(own)) == (s.X.dim, len(set(ins))), "a level for every generator and every block")
    for j, x in enumerate(s.X.rays):
        need(all(levels[i] >= levels[j] for i in image(s.X.Z, image(s.A, x))), "levels do not fall along A")
        need(all(own[outs[q]] > levels[j] for q in image(s.C, x)), "levels rise along C")
    for k, b in enumerate(ins):
        need(all(levels[i] >= own[b] for i in image(s.X.Z, s.B[k])), "levels do not fall along B")
        need(all(own[outs[q]] > own[b] for q in s.D[k]), "levels rise along D")


def reached(s: System, e: Said, lower: Fraction, ins: list[int], outs: list[int]) -> None:
    """The bound from below of `structured_gain`."""
    sizes = zip("acys", (len(ins), len(ins), len(outs), s.X.dim), strict=True)
    a, c, y, x = (entries(array(e[name]), length) for name, length in sizes)
    need(nonnegative(a) and nonnegative(y) and bool(a), "a, y >= 0, and a is not zero")
    listed(e, "y", total((1, drift(s, x)), (1, image(s.B, a))), s.X)
    need(nonnegative(total((1, image(s.C, x)), (1, image(s.D, a)), (-1, y))), "y <= C s + D a")
    need(nonnegative(total((1, c), (-lower, a))), "c >= lower a")
    left, right = (total(*((v[i] ** 2, {of[i]: Fraction(1)}) for i in v)) for v, of in ((y, outs), (c, ins)))
    need(nonnegative(total((1, left), (-1, right))), "|y| >= |c| in every block")


def blocks(s: System, e: Said) -> tuple[list[int], list[int]]:
    """The block of every input and of every output; every block has both."""
    ins, outs = ([index(k) for k in sequence(e[name])] for name in ("input_blocks", "output_blocks"))
    expect((len(ins), len(outs)) == (s.U.dim, s.Y.dim), "a block for every input and every output")
    expect(set(ins) == set(outs) == set(range(max(ins) + 1)), "every block has inputs and outputs")
    return ins, outs


def nonnegative(x: Vector) -> bool:
    """x >= 0, entry by entry."""
    return all(a >= 0 for a in x.values())


def common_vector(s: System, e: Said) -> None:
    """A family is stable under arbitrary switching: each A maps one point of int X into -int X.

    In the file are A' and the dual cone: positive,  v'x > 0,  v'A'x < 0,  v'A'x + decay_rate v'x <= 0  and
    v'A'x + required_rate v'x <= 0  for every generator x of the dual.
    """
    positive(s, e)
    rate = decay_rate_or_none(e)
    decreases(s, entries(array(e["v"]), s.X.dim), {}, rate, required_rate(e))


def invariant(s: System, e: Said) -> None:
    """X is invariant under each A of a family, holds the columns of B, and lies in the half-spaces C x >= 0.

    positive, and unless v is null v'x > 0 and v'A x < 0, a common Lyapunov vector.  With `radii`, for every J with
    |J - A| <= radius, given these bounds: if e_j = sum_k x_k Z_kj, the weights of J x_i are at least
    P_ki - sum_j |Z_kj| (radius |x_i|)_j, which is >= 0 for k != i (discrete time: all k);  v'A x + |v|'radius |x| < 0.
    """
    positive(s, e)
    v = None if e.get("v") is None else entries(array(e["v"]), s.X.dim)
    by_facets = e.get("by_facets", False)
    expect(type(by_facets) is bool and not (by_facets and v), "by_facets is true only without v")
    if v is not None:
        decreases(s, v, {})
    bounded = s.X.rays if any(s.radius) else []
    P, h = weights(s.X, [image(s.A, x) for x in s.X.rays], e.get("P")) if bounded else [], by_generator(s.X)
    for i, x in enumerate(bounded):
        spread = image(s.radius, sizes(x))
        least = [P[i].get(k, 0) - dot(sizes(h_k), spread) for k, h_k in enumerate(h)]
        need(all(a >= 0 or (k == i and not s.discrete) for k, a in enumerate(least)), "J X in X within the bounds")
        drift = total((1, image(s.A, x)), (-s.discrete, x))
        need(v is None or dot(v, drift) + dot(sizes(v), spread) < 0, "v'J x < 0 within the bounds")


# -- networks: one large system, with the nodes side by side


def own_links_closed(s: System) -> System:
    """W_jj as a part of node j, and W without these blocks.

    With S = (I - W_jj D_j)^-1 node j becomes A + B S W_jj C, B S, C + D S W_jj C, D S, whatever part of W is its own.
    """
    _, inputs, outputs = s.owners()
    own = [{i: a for i, a in w.items() if inputs[i] == outputs[k]} for k, w in enumerate(s.W)]
    expect(any(own), "no node has a link to itself")
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
        need(bool(usable), "generators span the space, and links of nodes to themselves are well posed")
        x, z = rest.pop(usable[0])
        pivot = total((1 / x[i], x)), total((1 / x[i], z))
        rest, done = ([clear(pair, pivot, i) for pair in part] for part in (rest, done))
        done.append(pivot)
    return [z for _, z in done]


def clear(pair: tuple[Vector, Vector], pivot: tuple[Vector, Vector], i: int) -> tuple[Vector, Vector]:
    """Without entry i, by subtraction of the pivot."""
    a = pair[0].get(i, Fraction(0))
    return total((1, pair[0]), (-a, pivot[0])), total((1, pair[1]), (-a, pivot[1]))


def loop(s: System, e: Said) -> tuple[Vector, Vector]:
    """The algebraic loop u = W D u contracts, unless D = 0:  p'y > 0,  p'D u <= t'u,  t'W y < p'y."""
    if not any(s.D):
        return {}, {}
    parts = [array(x) if "array" in x else fractions(x) for x in sequence(e["loop_weights"])]
    p, t = (entries(x, C.dim) for x, C in zip(parts, (s.Y, s.U), strict=True))
    contracts(s, p, t)
    return p, t


def contracts(s: System, p: Vector, t: Vector) -> None:
    """p'y > 0,  p'D u <= t'u,  t'W y < p'y."""
    direct, around = total((1, pullback(p, s.D)), (-s.unit, t)), total((1, pullback(t, s.W)), (-s.unit, p))
    need(all(dot(p, y) > 0 and dot(around, y) < 0 for y in s.Y.rays), "t'W y < p'y")
    need(all(dot(direct, u) <= 0 for u in s.U.rays), "p'D u <= t'u")


def balanced(s: System, e: Said, sigma: list[Fraction]) -> tuple[Vector, Vector]:
    """V and Q, with the supplies of (II) and (III'):  V'B u <= R'u + Q'D u  and  Q'y + R'W y <= 0.

    V, R, Q are the v, r, q of the nodes, each times its sigma > 0.
    """
    expect(all(x > 0 for x in sigma), "sigma is not positive")
    scaled = []
    for kind, part in enumerate(exactly(e, *"vrq", read=nodewise)):
        places = zip(sigma, s.nodes, strict=True)
        expect(len(part) == len(s.owners()[kind]), "the vectors are those of the nodes")
        scaled.append({i: c * part[i] for c, node in places for i in node[kind] if part[i]})
    V, R, Q = scaled
    supplied(s, V, Q, R)
    balance(s, Q, R)
    return V, Q


def network(s: System, e: Said) -> None:
    """A network is positive and exponentially stable: Theorem 4 (`cone_ic_s`), with (III') node by node.

    positive,  V'x > 0,  (V'A - Q'C) x < 0,  (V'A - Q'C) x + rate V'x <= 0 for decay_rate and required_rate,
    V'B u <= R'u + Q'D u,  Q'y + R'W y <= 0, and the algebraic loop contracts.
    """
    positive(s, e)
    loop(s, e)
    V, Q = balanced(s, e, array(e["sigma"]))
    decreases(s, V, Q, decay_rate_or_none(e), required_rate(e))


def abscissa(s: System, e: Said) -> None:
    """The spectral abscissa (discrete time: radius) of a positive network is in [lower, upper].

    positive, the loop contracts,  V'x > 0,  (V'A - Q'C) x <= upper V'x,  the supplies as for `network`;  and for
    x in X, x != 0, with inputs and outputs u, y as for `grows`, A x + B u - lower x is in X.
    """
    positive(s, e)
    V, Q = balanced(s, e, [Fraction(1)] * len(s.nodes))
    drift = total((1, pullback(V, s.A)), (-double(e["upper"]), V), (-1, pullback(Q, s.C)))
    need(all(dot(V, x) > 0 for x in s.X.rays), "V'x > 0")
    need(all(dot(drift, x) <= 0 for x in s.X.rays), "(V'A - Q'C) x <= upper V'x")
    m = motion(s, *record(e, "below", "NetworkInstability"))
    expect(m.rate == double(e["lower"]), "the motion grows at the lower rate")
    grows(s, e, m)


@dataclass
class Motion:
    """What a witness shows: a state, an input and an output, a rate, and A x + B u - rate x."""

    x: Vector
    u: Vector
    y: Vector
    rate: Fraction
    moved: Vector


# The vectors that a witness has.
VECTORS = {
    "InstabilityDirection": "x",
    "SlowDirection": "x",
    "InstabilityCombination": "x",
    "SupplyViolation": "xu",
    "NodeNotDissipative": "xu",
    "NetworkInstability": "xuy",
    "AlgebraicLoop": "yu",
    "NoWeights": "y",
}


def motion(s: System, kind: str, w: Said) -> Motion:
    """The motion of a witness; a rate that is not stated is 0 (discrete time: 1)."""
    node, rate = s.nodes[index(w["node"])] if kind == "NodeNotDissipative" else None, Fraction(s.discrete)
    if kind in ("NetworkInstability", "SlowDirection"):
        rate = double(w["rate"]) if kind == "NetworkInstability" else s.discrete - either(w["rate"])
    fields = record(w, "violation", "SupplyViolation")[1] if node else w
    own = dict(zip(VECTORS[kind], exactly(fields, *VECTORS[kind]), strict=True))
    x, u, y = (
        total((1, dict(zip(places, own[name], strict=True)))) if name in own else {}
        for name, places in zip("xuy", node or map(range, (C.dim for C in s.cones())), strict=True)
    )
    return Motion(x, u, y, rate, total((1, image(s.A, x)), (1, image(s.B, u)), (-rate, x)))


def grows(s: System, e: Said, m: Motion) -> None:
    """A network does not decay faster than the rate: its state has an eigenvalue >= rate.

    positive, the loop contracts;  x != 0,  x in X,  A x + B u - rate x in X,  W y - u in U,  C x + D u - y in Y.
    """
    loop(s, e)
    need(bool(m.x), "x is not zero")
    listed(e, "x", m.x, s.X)
    listed(e, "z", m.moved, s.X)
    listed(e, "W", total((1, image(s.W, m.y)), (-1, m.u)), s.U)
    listed(e, "C", total((1, image(s.C, m.x)), (1, image(s.D, m.u)), (-1, m.y)), s.Y)


def unstable(s: System, e: Said, m: Motion) -> None:
    """Not stable: x in X, x != 0, with A x - rate x in X, rate >= 0 (discrete time: 1).

    Or no v decreases at required_rate, which is positive: then rate > -required_rate (1 - required_rate) will do, or
    this rate itself if A x - rate x is not 0.
    """
    need(bool(m.x), "x is not zero")
    listed(e, "x", m.x, s.X)
    listed(e, "z", m.moved, s.X)


def not_dissipative(s: System, e: Said, m: Motion) -> None:
    """Not dissipative for this supply: x, A x + B u - x in X (discrete time), u in U, and q'(C x + D u) + r'u <= 0.

    In continuous time A x + B u.  One of x, the motion and the supply is not 0.  For any r if that is null: then u = 0.
    """
    q, r = supply(s, e)
    given = dot(q, total((1, image(s.C, m.x)), (1, image(s.D, m.u)))) + dot(r or {}, m.u)
    need(given <= 0 and bool(m.x or m.moved or given), "a motion without supply")
    need(r is not None or not m.u, "the input of the motion is zero")
    listed(e, "x", m.x, s.X)
    listed(e, "u", m.u, s.U)
    listed(e, "z", m.moved, s.X)


def closed_loop(s: System, e: Said, m: Motion) -> None:
    """The loop u = W D u has gain 1 or more: y in Y, y != 0, W y - u in U, D u - y in Y."""
    need(bool(m.y), "y is not zero")
    listed(e, "y", m.y, s.Y)
    listed(e, "W", total((1, image(s.W, m.y)), (-1, m.u)), s.U)
    listed(e, "C", total((1, image(s.D, m.u)), (-1, m.y)), s.Y)


def no_weights(s: System, e: Said, m: Motion) -> None:
    """No sigma > 0 balances these supplies: y in Y, q_j'y_j + r_j'(W y)_j >= 0 at every node, > 0 at one."""
    (q, r), received = supply(s, e), image(s.W, m.y)
    listed(e, "y", m.y, s.Y)
    parts = ((q, m.y, 2), (r or {}, received, 1))
    rows = [sum(f.get(i, 0) * x.get(i, 0) for f, x, kind in parts for i in node[kind]) for node in s.nodes]
    need(min(rows) >= 0 and max(rows) > 0, "no weights exist")


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


def no_cone(e: Said, limit: int) -> None:
    """No proper polyhedral cone is invariant under every A, for the reason in the witness."""
    kind, w = record(e, "witness", *NO_CONE)
    expect(type(e["discrete"]) is bool, "discrete is neither true nor false")
    expect(type(e.get("by_facets", False)) is bool, "by_facets is neither true nor false")
    members = listing(content(e["matrices"], "matrix"))
    n = len(members[0])
    expect(n > 0, "there are no states")
    for name in ("contains", "within"):
        rows(e[name], n) if e.get(name) is not None else []
    NO_CONE[kind](e, w, [matrix({"matrix": A}, n, n) for A in members])


def eigenvalue(e: Said, w: Said, members: list[Matrix]) -> None:
    """The Perron root of one A would have to be an eigenvalue.

    No real eigenvalue is above the bound, but one is ahead of it, or exactly beside it.
    """
    M, unit = integers(members[index(w["matrix"])])
    excluded(M, unit, {"ahead": True, "beside": False}[w["kind"]], e, w, e["discrete"])


def cycle(e: Said, w: Said, members: list[Matrix]) -> None:
    """The Perron root of a product of resolvents (s_i I - A_i)^-1 (discrete time: of powers A_i^s_i), which keep every

    such cone as well.  No real eigenvalue of the product, divided by its largest entry, is above the bound, but one
    is ahead of it.
    """
    steps = zip(sequence(w["cycle"]), fractions(w["shifts"]), strict=True)
    M = reduce(product, [power_or_resolvent(members[index(i)], s, e["discrete"]) for i, s in steps])
    excluded(M, max(abs(a) for row in M for a in row), True, e, w, True)


def excluded(M: list[list[int]], unit: int, ahead: bool, e: Said, w: Said, discrete: bool) -> None:
    """No real eigenvalue of M / unit is above the bound b; one is ahead of it (discrete time: outside) or beside it."""
    p, b = leverrier(M)[0], unit * fraction(w["bound"])
    need(real_roots_beyond(p, b) == 0 and (b > 0 or not discrete), "no real eigenvalue is above the bound")
    if ahead:
        return root_ahead(p, [unit * number(x) for x in listing(e["z"])], b, discrete)
    return root_beside(p, b, discrete)


def longer_chains(e: Said, w: Said, members: list[Matrix]) -> None:
    """In discrete time, some eigenvalue of the modulus of the largest real one, rho > b >= 0, has a larger index.

    The index (length of the longest Jordan chain) of the spectral radius is the largest on its circle (Vandergraft).
    Let r be the product of the different factors of the characteristic polynomial, V = r(A)^k, and q the denominator of
    u'(s I - A)^-1 V x.  The roots of q have an index > k; rho has not, as q(A) V = 0 and no root of q is real and > b.
    One pole of u'(s I - A^N)^-1 V x is real and > b^N: it is z^N for a root z of q, and it is rho^N, the only real
    eigenvalue of A^N above b^N.
    """
    need(e["discrete"], "Jordan chains exclude cones in discrete time only")
    M, unit = integers(members[index(w["matrix"])])
    order, b, k = index(w["order"]), unit * fraction(w["bound"]), index(w["index"])
    expect(order <= 60 and 0 < k < len(M), "an order or an index is out of range")
    p, V = leverrier(M)[0], integers([{} for _ in M], 1)[0]
    for _ in range(k):
        V = applied(divided(p, common(p, derivative(p)))[0], M, V)
    (u,), (start,) = rows(w["functional"], len(M)), rows(w["start"], len(M))
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
    need(1 <= s <= 24 and s == int(s), "a power is a small whole number")
    return reduce(product, [integers(A)[0]] * int(s))


def between(e: Said, w: Said, n: int) -> tuple[list[Fraction], list[Fraction]]:
    """b among the vectors in `contains` and c among the half-spaces c'x >= 0 in `within`, of which a cone is asked.

    It would make c'(s I - A)^-k b, an integral of e^((A - s I) t), c'e^(At) b and c'A^k b nonnegative.
    """
    (b,), (c,) = rows(w["vector"], n), rows(w["normal"], n)
    expect(b in rows(e["contains"], n), "b is not among what is to be in the cone")
    expect(c in rows(e["within"], n), "c'x >= 0 is not asked of the cone")
    return b, c


def negative_product(e: Said, w: Said, members: list[Matrix]) -> None:
    """c'(s I - A)^-k b < 0 for an s beyond the real eigenvalues (discrete time: c'A^k b < 0).

    For k = 1 it may be 0, as the integral of e^(-st) c'e^(At) b >= 0, unless c'A^j b = 0 for all j.
    """
    A, k = members[0], index(w["power"])
    b, c = between(e, w, len(A))
    need(k <= 4000 and (k > 0 or e["discrete"]), "a power is a small whole number")
    need(not e["discrete"] or w.get("shift") is None, "a power of A has no shift")
    M = integers(A)[0]
    value = responses(c, M if e["discrete"] else resolvent(A, fraction(w["shift"])), b, k)[k]
    touches = value == 0 and k == 1 and not e["discrete"] and any(responses(c, M, b, len(A)))
    need(value < 0 or touches, "c'(s I - A)^-k b < 0")


def negative_response(e: Said, w: Said, members: list[Matrix]) -> None:
    """c'e^(At) b < 0 at some t > 0: the first m terms of its series in t, and a bound on the others.

    With the largest row sum |A| of sizes, the others are at most |c|_1 |b|_max (|A| t)^m / m! / (1 - |A| t / m).
    """
    need(not e["discrete"], "an impulse response at any time is for continuous time")
    (b, c), (M, unit) = between(e, w, len(members[0])), integers(members[0])
    m, t = index(w["terms"]), fraction(w["time"]) / unit
    need(t > 0, "the time is positive")
    reach = t * max(sum(abs(a) for a in row) for row in M)
    expect(0 < m <= 600, "there are too many terms")
    need(reach < m, "there are terms enough for a bound")
    total = sum((h * t**k / factorial(k) for k, h in enumerate(responses(c, M, b, m)[:m])), Fraction(0))
    size = sum(abs(a) for a in c) * max(abs(a) for a in b)
    need(total + size * reach**m / factorial(m) / (1 - reach / m) < 0, "c'e^(At) b < 0")


def touching_response(e: Said, w: Said, members: list[Matrix]) -> None:
    """h(t) = c'e^(At) b = sum_i r_i e^(s_i t) is 0 at some t > 0, but not always.

    Then no invariant cone between b and c is polyhedral: A + a I would keep it for some a, and no term of the series of
    e^(at) h(t) in t would be negative.  The rates s_i are eigenvalues, and the sum has the first n derivatives of h at
    t = 0, so that all agree.  All s_i are top - m_i unit, and with q = e^(-unit t), sum_i r_i q^m_i is 0 for some q
    between two numbers in [0, 1], which are so close that they tell the time.
    """
    need(not e["discrete"], "an impulse response at any time is for continuous time")
    (b, c), (M, unit) = between(e, w, len(members[0])), integers(members[0])
    s, r, p = fractions(w["rates"]), fractions(w["weights"]), leverrier(M)[0]
    low, high = fraction(w["low"]), fraction(w["high"])
    need(all(at(p, unit * x) == 0 for x in s), "the rates are eigenvalues")
    sums = [sum((y * (unit * x) ** k for x, y in zip(s, r, strict=True)), Fraction(0)) for k in range(len(M))]
    need(sums == responses(c, M, b, len(M))[: len(M)], "the response is a sum of exponentials")
    steps = [max(s) - x for x in s]
    below = lcm(*(step.denominator for step in steps))
    whole = [int(step * below) for step in steps]
    powers = [step // (gcd(*whole) or 1) for step in whole]
    expect(max(powers) <= 80, "the exponents are too far apart")
    q, scale = [0] * (max(powers) + 1), lcm(*(y.denominator for y in r))
    for k, y in zip(powers, r, strict=True):
        q[-1 - k] += int(y * scale)
    need(0 < low < high <= 1 and high - low <= Fraction(1, 10**6), "the time is between two that are close")
    need(any(q) and at(q, high) != 0, "the response is not always zero")
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
    out = given(o, C.dim, count) if C.dim else optional(o, 0, count)
    need(all(above(f, C) for f in out), "a functional is nonnegative on its cone")
    return out


def inwards(e: Said, w: Said, X: Cone, m: int) -> list[tuple[Matrix, Matrix, list[Vector]]]:
    """A_s, B_s and l_sk >= 0 on X for all k, with l_sk'x_k = 0 in continuous time: A_s + B_s F keeps X only if

    l_sk'(A_s + B_s F) x_k >= 0.
    """
    expect(type(e["discrete"]) is bool, "discrete is neither true nor false")
    lines = {tuple(sorted((i, a / abs(x[min(x)])) for i, a in x.items())) for x in X.rays}
    expect(len(lines) == len(X.rays), "two generators are in a line")
    out = []
    for A, B, L in zip(sequence(e["A"]), sequence(e["B"]), sequence(w["L"]), strict=True):
        l = functionals(L, X, len(X.rays))
        need(e["discrete"] or all(dot(f, x) == 0 for f, x in zip(l, X.rays, strict=True)), "l_k'x_k = 0")
        out.append((given(A, X.dim, X.dim), given(B, X.dim, m), l))
    return out


def size(e: Said, x: Vector) -> Fraction:
    """What a bound on |F x| is multiplied by: the leading entry of x, or 1 for generators as they stand in the file.

    The leading entry is the first of at least an eighth of the size of the largest.
    """
    leading = e.get("leading", False)
    expect(type(leading) is bool, "leading is neither true nor false")
    top = max(map(abs, x.values()), default=Fraction(0))
    return next((abs(x[i]) for i in sorted(x) if 8 * abs(x[i]) >= top), top) if leading else Fraction(1)


def marks(o: Json) -> list[list[Fraction]]:
    """Rows of 0 and 1, of one length."""
    expect(all(x in (0, 1) for x in array(o, 2)), "a mark is neither 0 nor 1")
    return [[number(x) for x in row] for row in content(o, "array")]


def no_feedback(e: Said, limit: int) -> None:
    """No F and no point z = sum_k xi_k x_k, all xi_k > 0, satisfy for every vertex (A_s, B_s):

    A_s + B_s F keeps X,  A_s + B_s F + coupling + rate I maps z into -int X,  |F x_k| <= gain_bound `size`,
    (C + D F) x_k in Y,  (F x_k)_j = 0 where `free` is 0.  By Farkas' lemma: with l_sk as in `inwards`, d_s >= 0 on X
    and g_k >= 0 on Y they would make

        sum_k xi_k (sum_s l_sk'(A_s + B_s F) x_k + g_k'(C + D F) x_k) - sum_s d_s'(A_s + B_s F + coupling + rate I) z

    at least 0, and more if some d_s is not 0.  But this is sum_k xi_k (a_k + b_k'F x_k), where
    a_k + |b_k|'gain_bound <= 0 for all k, and < 0 for one k unless some d_s is not 0 (no bound: b_k = 0).
    """
    X, free = cone(e["X"], limit), marks(e["free"])
    C, D, outputs = (None, None, None) if e.get("ports") is None else sequence(e["ports"])
    Y, m = cone(outputs, limit), len(free[0])
    C, D = (optional(None, Y.dim, n) if e.get("ports") is None else given(M, Y.dim, n) for M, n in ((C, X.dim), (D, m)))
    coupling = optional(e.get("coupling"), X.dim, X.dim)
    bound = [Fraction(0)] * m if e["gain_bound"] is None else array(e["gain_bound"])
    expect(len(bound) == m, "there is a bound for every input")
    _, w = record(e, "witness", "Functionals")
    rate, g = double(e["rate"]) - e["discrete"], functionals(w.get("G"), Y, len(X.rays))
    vertices, ds = inwards(e, w, X, m), functionals(w["d"], X, len(sequence(e["A"])))
    lengths = [size(e, x) for x in X.rays]
    expect(all(b >= 0 for b in bound) and len(free) == len(X.rays), "the bounds are not negative")
    strict = any(ds)
    for k, x in enumerate(X.rays):
        a, b = dot(g[k], image(C, x)), pullback(g[k], D)
        for (A, B, l), f in zip(vertices, ds, strict=True):
            a += dot(l[k], image(A, x)) - dot(f, total((1, image(A, x)), (1, image(coupling, x)), (rate, x)))
            b = total((1, b), (1, pullback(l[k], B)), (-1, pullback(f, B)))
        b = {j: y for j, y in b.items() if free[k][j]}
        need(not b or e["gain_bound"] is not None, "b_k = 0")
        level = a + sum(abs(y) * bound[j] for j, y in b.items()) * lengths[k]
        need(level <= 0, "a_k + |b_k|'gain_bound <= 0")
        strict = strict or level < 0
    need(strict, "one of the inequalities is strict")


def no_invariant_gain(e: Said, limit: int) -> None:
    """No G with zeros where `pattern` is 0 is such that A_s + B_s G R keeps X for every s.

    With l_sk as in `inwards`, sum_sk l_sk'(A_s + B_s G R) x_k would be >= 0 for every such G;  but
    sum_sk l_sk'A_s x_k < 0, and sum_sk (B_s'l_sk)_i (R x_k)_j = 0 wherever G_ij may differ from 0.
    """
    X, pattern = cone(e["X"], limit), marks(e["pattern"])
    R, level, slope = given(e["R"], len(pattern[0]), X.dim), Fraction(0), dict[tuple[int, int], Fraction]()
    _, w = record(e, "witness", "Functionals")
    for A, B, l in inwards(e, w, X, len(pattern)):
        for f, x in zip(l, X.rays, strict=True):
            level += dot(f, image(A, x))
            for (i, a), (j, b) in pairs(pullback(f, B).items(), image(R, x).items()):
                slope[i, j] = slope.get((i, j), Fraction(0)) + a * b
    need(level < 0, "sum l'A x < 0")
    need(all(not a or not pattern[i][j] for (i, j), a in slope.items()), "sum (B'l) (R x)' = 0")


def no_bounded_feedback(e: Said, limit: int) -> None:
    """No F with zeros where `pattern` is 0 is such that for every s A_s + B_s F keeps X, and x' = (A_s + B_s F) x + w

    stays in [0, x_max] for all w(t) in [0, w_max], with |F_i x| <= u_i for the x of [0, x_max] (no bounds: u_max null).
    With l_sk as in `inwards`, d_s >= 0 on X, and p_i in [0, t_i x_max], q_i in [0, t'_i x_max], every such F would make

        sum_sk l_sk'(A_s + B_s F) x_k - sum_s d_s'((A_s + B_s F) x_max + w_max) - sum_i F_i (p_i - q_i)

    at least -sum_i (t_i + t'_i) u_i:  but it is less, and the same for all F.  p, q and the rests t x_max - p,
    t' x_max - q are the generators times the weights `up`, `down` and `up_rest`, `down_rest`; `times` has t and t'.
    """
    X, pattern = cone(e["X"], limit), marks(e["pattern"])
    x, w, m = row_vector(e, "x_max", X.dim), row_vector(e, "w_max", X.dim), len(pattern)
    expect(len(pattern[0]) == X.dim, "there is a mark for every state")
    _, f = record(e, "witness", "BoundedFunctionals")
    level, slope = Fraction(0), [Vector() for _ in pattern]
    vertices = inwards(e, f, X, m)
    for (A, B, l), d in zip(vertices, functionals(f["d"], X, len(vertices)), strict=True):
        for g, y in zip(l, X.rays, strict=True):
            level += dot(g, image(A, y))
            slope = [total((1, row), (pullback(g, B).get(i, 0), y)) for i, row in enumerate(slope)]
        level -= dot(d, total((1, image(A, x)), (-e["discrete"], x), (1, w)))
        slope = [total((1, row), (-pullback(d, B).get(i, 0), x)) for i, row in enumerate(slope)]
    if e["u_max"] is not None:
        u, times = row_vector(e, "u_max", m), given(f["times"], 2, m)
        for k, (name, sign) in enumerate((("up", 1), ("down", -1))):
            weights, rest = (given(f[key], len(X.rays), m) for key in (name, f"{name}_rest"))
            need(all(a >= 0 for part in (*weights, *rest, *times) for a in part.values()), "weights are not negative")
            for i, (p, q) in enumerate(zip(weights, rest, strict=True)):
                t, state = times[i].get(k, Fraction(0)), image(X.rays, p)
                need(total((1, state), (1, image(X.rays, q))) == total((t, x)), "p and the rest are t x_max")
                slope[i] = total((1, slope[i]), (-sign, state))
                level += t * u.get(i, Fraction(0))
    need(level < 0, "the sum is below the bounds of the inputs")
    need(all(not pattern[i][j] for i, row in enumerate(slope) for j in row), "the sum is the same for every F")


def row_vector(e: Said, name: str, n: int) -> Vector:
    """A vector of the data that stands there as a matrix with one row."""
    return {i: x[0] for i, x in enumerate(given(e[name], 1, n)) if x}


# -- claims about other claims


def gain_bound(e: Said, limit: int) -> None:
    """|F x| <= bound, entry by entry, for the generators x, see `size`."""
    X, bound = cone(e["X"], limit), array(e["bound"])
    F = given(e["F"], len(bound), X.dim)
    need(all(b >= 0 for b in bound), "a bound is not negative")
    for x in X.rays:
        most = size(e, x)
        need(all(abs(a) <= bound[i] * most for i, a in image(F, x).items()), "|F x| <= bound")


def certificate(o: Json) -> Json:
    """A file as it stands inside another."""
    c = content(o, "certificate")
    expect(c.keys() == {"claim", "status", "data", "proof"}, "a certificate has something else")
    return c


def feedback(e: Said, limit: int) -> None:
    """One gain does all that was asked: every part is PROVED, by a proof of its own, see `together`."""
    loops, others = (
        [certificate(part) for part in sequence({"tuple": []} if e[k] is None else e[k])] for k in ("loops", "others")
    )
    for part in loops:
        expect(part["claim"] == "stable", "closed loops are stable")
    for part in loops + others:
        need(part["status"] == "PROVED", "all parts are proved")
        verify(part, limit // len(loops + others))
    X = cone(loops[0]["data"]["X"], limit)
    closed = [given(loop["data"]["A"], X.dim, X.dim) for loop in loops]
    for part in loops + others:
        together(part, X, closed, loops[0]["data"]["discrete"], limit)


def together(part: Json, X: Cone, closed: list[Matrix], discrete: bool, limit: int) -> None:
    """A part is about X and the time of the closed loops, or a bound on the gain at the generators of X.

    What is `positive` is one of them with ports, and an `order interval` that of one.  In a `common vector` are all of
    them, or the transposed of all, and in a `disturbance gain` those of one, on the dual cone: nonnegative on X, and if
    X has n generators, each of them on one.
    """
    claim, data = part["claim"], part["data"]
    own_cone, closed_loop = ("stable", "gain bound", "positive", "order interval"), ("positive", "order interval")
    expect(claim in (*own_cone, "common vector", "disturbance gain"), "it is about a gain")
    own = cone(data["X"], limit)
    expect(claim == "gain bound" or data["discrete"] == discrete, "all parts are about one time")
    if claim in own_cone:
        expect(directions(own) == directions(X), "all parts are about one cone")
        expect(claim not in closed_loop or given(data["A"], X.dim, X.dim) in closed, "it is about a closed loop")
        return
    matrices = [given(A, own.dim, own.dim) for A in (sequence(data["A"]) if claim == "common vector" else [data["A"]])]
    if claim == "common vector" and directions(own) == directions(X) and matrices == closed:
        return
    expect(own.dim == X.dim and all(above(f, X) for f in own.rays), "the dual cone is nonnegative on the cone")
    edges = len(X.rays) > X.dim or all(len(pullback(f, X.rays)) == 1 for f in own.rays)
    expect(edges, "the dual cone is the whole of it")
    turned = [transposed(A, len(A)) for A in closed]
    turned = [transposed(A, X.dim) for A in closed]
    if claim == "common vector":
        expect(matrices == turned, "all closed loops have the vector")
    else:
        expect(matrices[0] in turned, "the gain is that of a closed loop")


def directions(C: Cone) -> list[list[tuple[int, Fraction]]]:
    """The generators, whatever their lengths and their order."""
    return sorted(sorted(total((1 / sum(sizes(x).values(), Fraction(0)), x)).items()) for x in C.rays)


def transposed(M: Matrix, m: int) -> Matrix:
    """M' of a matrix with m rows."""
    out: Matrix = [{} for _ in range(m)]
    for j, column in enumerate(M):
        for i, a in column.items():
            out[i][j] = a
    return out


def any_size(e: Said, limit: int) -> None:
    """Networks of any number of such nodes are positive and stable under every coupling W that maps Y into U and has

    sum_j r'W_jk y <= weight r'K y  for every node k:  q'y + weight r'K y <= 0 makes (III') true, with sigma = 1.
    `local` is the network of one node of each type with W = diag(weight K), K = link.  Several types have one r > 0 in
    common.  If D is not 0, t is a multiple of r: then every such loop contracts.
    """
    data, count = self_loops(e, limit, "PROVED")
    r, weights = exactly(data, *"vrq", read=nodewise)[1], data.get("loop_weights")
    expect(count == 1 or (len(set(r)) == 1 and r[0] > 0), "the types have one r > 0 in common")
    if weights is not None:
        _, t = (array(x) if "array" in x else fractions(x) for x in sequence(weights))
        ratio = next((a / b for a, b in zip(t, r, strict=True) if b), Fraction(0))
        need(ratio >= 0 and t == [ratio * x for x in r], "t is a multiple of r")


def not_any_size(e: Said, limit: int) -> None:
    """`local`, the network of one node of each type with W = diag(weight K), is refuted, by the same witness.

    It is not positive or not stable: that it is not dissipative for some supplies says nothing about others.
    """
    data, _ = self_loops(e, limit, "REFUTED")
    need(data["witness"]["record"] not in ("NodeNotDissipative", "NoWeights"), "whatever the supplies")
    expect(e.get("witness") in (None, data["witness"]), "the witness is that of the self-loops")


def self_loops(e: Said, limit: int, status: str) -> tuple[Json, int]:
    """The data of a network of this status with W = diag(weight K), and the number of its nodes."""
    local, link = certificate(e["local"]), content(e["link"], "array", "matrix")
    expect(local["claim"] == "network", "the self-loops are a network")
    need(local["status"] == status, "the self-loops decide")
    verify(local, limit)
    if "array" in e["link"]:
        array(e["link"], 2)  # of doubles
    data, weight, (m, n) = local["data"], either(e["weight"]), (len(link), len(link[0]))
    expect(data.get("own_links_closed") is None, "W are links of the network")
    count = cone(data["Y"], limit).dim // n
    K, W = matrix({"matrix": link}, m, n), matrix(data["W"], count * m, count * n)
    loops = [{j * m + i: weight * a for i, a in column.items() if weight} for j in range(count) for column in K]
    expect(loops == W and weight >= 0, "W = diag(weight K)")
    return data, count


# -- order intervals


def interval(e: Said, limit: int) -> tuple[System, Vector, Vector]:
    """The system, w_max, and x_min or 0, with  positive  and  w_max in X.

    With x_min, every [0, x] that x' = A x + w does not leave, whatever w does in [0, w_max], has x - x_min in X:
    v'x > 0,  v'A x < 0,  so that A has an inverse, and -A^-1 maps X into X;  A x_min + w_max in X.
    """
    (s,) = family("order interval", e, limit)
    positive(s, e)
    w = entries(interval_vector(e, "w_max"), s.X.dim)
    listed(e, "u", w, s.X)
    if e["x_min"] is None and e["lyapunov"] is None:
        return s, w, {}
    v, least = (entries(interval_vector(e, name), s.X.dim) for name in ("lyapunov", "x_min"))
    decreases(s, v, {})
    listed(e, "y", total((1, drift(s, least)), (1, w)), s.X)
    return s, w, least


def interval_vector(e: Said, name: str) -> list[Fraction]:
    """One of the vectors, which round to what stands there."""
    names = ("w_max", "x_max", "lyapunov", "x_min", "bounds")
    return exactly(e, *names)[names.index(name)]


def drift(s: System, x: Vector) -> Vector:
    """A x, or A x - x."""
    return total((1, image(s.A, x)), (-s.discrete, x))


def limits(e: Said, s: System, b: list[Fraction]) -> list[tuple[Vector, Fraction]]:
    """The rows f and the numbers b of the bounds f'x <= b."""
    expect((e["rows"] is None) == (e["bounds"] is None), "rows have bounds")
    return list(zip(row_vectors(e, "rows", s), b, strict=True))


def row_vectors(e: Said, name: str, s: System) -> list[Vector]:
    """The rows of a matrix of the data; none for null."""
    return [] if e[name] is None else [entries(row, s.X.dim) for row in rows(e[name], s.X.dim)]


def order_interval(e: Said, limit: int) -> None:
    """x' = A x + w stays in [0, x_max], the x in X with x_max - x in X, for all w(t) in [0, w_max].

    See `interval`;  x_max and -(A x_max + w_max) in X.  On it f'x <= b:  g and g - f are in X*,  g'x_max <= b.
    """
    s, w, _ = interval(e, limit)
    x = entries(interval_vector(e, "x_max"), s.X.dim)
    listed(e, "x", x, s.X)
    listed(e, "z", total((-1, drift(s, x)), (-1, w)), s.X)
    covered(e, s, x, limits(e, s, interval_vector(e, "bounds")))


def covered(e: Said, s: System, x: Vector, bounds: list[tuple[Vector, Fraction]]) -> None:
    """f'y <= b for all bounds and 0 <= y <= x, by the g in `covers`."""
    expect((e["covers"] is None) == (e["rows"] is None), "bounds have covers")
    for (f, b), g in zip(bounds, row_vectors(e, "covers", s), strict=True):
        need(above(g, s.X), "g is in X*")
        need(above(total((1, g), (-1, f)), s.X), "g - f is in X*")
        need(dot(g, x) <= b, "g'x_max <= b")


def exceeded(e: Said, s: System, least: Vector, w: Said, bounds: list[tuple[Vector, Fraction]]) -> None:
    """x and x_min - x are in X, and f'x > b for the `row` of the bounds."""
    x, row = entries(exactly(w, "x")[0], s.X.dim), index(w["row"])
    listed(e, "s", x, s.X)
    listed(e, "b", total((1, least), (-1, x)), s.X)
    need(row < len(bounds) and dot(bounds[row][0], x) > bounds[row][1], "f'x > b")


def no_order_interval(e: Said, limit: int) -> None:
    """No x_max is such that [0, x_max] is kept: some d in X* has A'd in X* and d'w_max > 0.

    Or none on which f'x <= b for the `row` of the bounds: x and x_min - x are in X, and f'x > b.
    """
    (s, w, least), (kind, fields) = interval(e, limit), record(e, "witness", "NoInterval", "BoundExceeded")
    bounds = limits(e, s, interval_vector(e, "bounds"))
    expect(e["x_max"] is None, "there is no x_max")
    if kind == "NoInterval":
        d = entries(exactly(fields, "d")[0], s.X.dim)
        need(above(d, s.X), "d is in X*")
        need(above(total((1, pullback(d, s.A)), (-s.discrete, d)), s.X), "A'd is in X*")
        need(dot(d, w) > 0, "d'w_max > 0")
        return
    expect(e["x_min"] is not None, "x_min is there")
    exceeded(e, s, least, fields, bounds)


# -- interval observers


def interval_observer(e: Said, limit: int) -> None:
    """Two copies of an observer enclose z = T x for all time, and tend to be no further apart than stated.

    The plant is x' = plant x + w, y = output x + n with w_lo <= w <= w_hi and |n| <= noise;  T = I - shift output,
    A = T plant + gain output,  K = A shift - gain,  so that z' = A z + K y + T w - K n.  positive,  v'x > 0 > v'A x;
    h'lower <= h'(T w - K n) <= h'upper  for all w and n, and all facets h;  -(A spread + upper - lower) in X.
    For the rows a_i of covers:  a_i and a_i - e_i are in X*,  (2 a_i - e_i)'spread + 2 |shift_i|'noise <= width_i.
    """
    (s,) = family("interval observer", e, limit)
    positive(s, e)
    names = ("w_lo", "w_hi", "noise", "upper", "lower", "v", "spread", "width")
    lo, hi, around, upper, lower, v, spread, width = exactly(e, *names)
    n, q = s.X.dim, len(around)
    decreases(s, entries(v, n), {})
    N, T, K = observer(e, s, q)
    up, down, x = (entries(y, n) for y in (upper, lower, spread))
    expect(len(lo) == len(hi) == n and all(a <= b for a, b in zip(lo, hi, strict=True)), "w_lo is at most w_hi")
    expect(all(a >= 0 for a in around), "noise is not negative")
    for h in facets(s.X, limit):
        g, noisy = pullback(h, T), dot(sizes(pullback(h, K)), entries(around, q))
        ends = [[a * g.get(j, 0) for a in end] for j, end in enumerate(zip(lo, hi, strict=True))]
        need(dot(h, up) >= sum(map(max, ends)) + noisy, "h'upper is at least h'(T w - K n)")
        need(dot(h, down) <= sum(map(min, ends)) - noisy, "h'lower is at most h'(T w - K n)")
    listed(e, "z", total((-1, drift(s, x)), (-1, up), (1, down)), s.X)
    shifts = transposed(N, n)
    for i, a in enumerate(row_vectors(e, "covers", s)):
        need(above(a, s.X), "a is in X*")
        need(above(total((1, a), (-1, {i: Fraction(1)})), s.X), "a - e is in X*")
        last = 2 * dot(a, x) - x.get(i, 0) + 2 * dot(sizes(shifts[i]), entries(around, q))
        need(last <= width[i], "the final width is at most the one stated")
    expect(len(width) == n == len(rows(e["covers"], n)), "every state has a width and a row of covers")


def observer(e: Said, s: System, q: int) -> tuple[Matrix, Matrix, Matrix]:
    """N, T = I - N C and K = A N - L, of a plant and gains that give A = T plant + L C."""
    n = s.X.dim
    plant, C, L, N = (given(e[k], *shape) for k, shape in zip(OBSERVER, ((n, n), (q, n), (n, q), (n, q)), strict=True))
    T = [total((1, {j: Fraction(1)}), (-1, image(N, column))) for j, column in enumerate(C)]
    need(plus(chained(T, plant), chained(L, C)) == s.A, "A = T plant + L C")
    return N, T, [total((1, image(s.A, shift)), (-1, gain)) for shift, gain in zip(N, L, strict=True)]


OBSERVER = ("plant", "output", "gain", "shift")


def network_observer(e: Said, limit: int) -> None:
    """Two copies of each node of a network enclose its states for all time, and tend to be as close as stated.

    x' = A x + B u + w, u = W C x, y = C x + n with w_lo <= w <= w_hi and |n| <= noise;  with A + gain C for A:
    positive,  V'x > 0,  (V'A - Q'C) x < 0  and the supplies as for `network`, with all sigma = 1;
    h'lower <= h'(w + gain n) <= h'upper  for all w and n, and all facets h;  -(A x_max + B u_max + upper - lower) in X,
    y_max - C x_max in Y,  u_max - W y_max in U.  For the rows a_i of covers:  a_i and a_i - e_i are in X*,
    (2 a_i - e_i)'x_max <= width_i.
    """
    (s,) = family("network observer", e, limit)
    n, q = s.X.dim, s.Y.dim
    L, (states, _, outputs) = given(e["gain"], n, q), s.owners()
    local = all(states[i] == outputs[k] for k, column in enumerate(L) for i in column)
    expect(local and not any(s.D), "gains are local, and D = 0")
    s = replace(s, A=plus(s.A, chained(L, s.C)))
    positive(s, e)
    V, Q = balanced(s, e, [Fraction(1)] * len(s.nodes))
    decreases(s, V, Q)
    lo, hi, noise = (beside(e, name) for name in ("w_lo", "w_hi", "noise"))
    up, down = (entries(array(e[name]), n) for name in ("upper", "lower"))
    pushes(s, L, (lo, hi, noise), (up, down), limit)
    x, ahead, sent, heard = port_bounds(s, e, "max", total((1, up), (-1, down)))
    listed(e, "z", total((-1, ahead)), s.X)
    listed(e, "C", total((-1, sent)), s.Y)
    listed(e, "W", total((-1, heard)), s.U)
    width = entries(array(e["width"]), n)
    for i, a in enumerate(transposed(given(e["covers"], n, n), n)):
        need(above(a, s.X), "a is in X*")
        need(above(total((1, a), (-1, {i: Fraction(1)})), s.X), "a - e is in X*")
        need(2 * dot(a, x) - x.get(i, 0) <= width.get(i, 0), "the final width is at most the one stated")


def pushes(s: System, L: Matrix, box: tuple[list[Fraction], ...], ends: tuple[Vector, Vector], limit: int) -> None:
    """h'down <= h'(w + L n) <= h'up for all w and n within their bounds, and all facets h."""
    lo, hi, noise = (entries(part, C.dim) for part, C in zip(box, (s.X, s.X, s.Y), strict=True))
    expect(all(a <= b for a, b in zip(*box[:2], strict=True)), "w_lo is at most w_hi")
    expect(all(a >= 0 for a in box[2]), "noise is not negative")
    for h in facets(s.X, limit):
        g = [{j: end(a, Fraction(0)) for j, a in h.items()} for end in (max, min)]
        noisy = dot(sizes(pullback(h, L)), noise)
        need(dot(h, ends[0]) >= dot(g[0], hi) + dot(g[1], lo) + noisy, "h'upper is at least h'(w + L n)")
        need(dot(h, ends[1]) <= dot(g[0], lo) + dot(g[1], hi) - noisy, "h'lower is at most h'(w + L n)")


# -- order intervals of networks


def network_interval(e: Said, limit: int) -> None:
    """A network stays in [0, x_max] for all w(t) in [0, w_max], and on it f'x <= b.

    See `network_end`;  x_max in X, and with u_max, y_max  -(A x + B u + w_max) in X,  y - C x - D u in Y,
    u - W y in U:  because loops contract, u and y are at least the inputs and outputs that belong to x_max.
    On it f'x <= b:  g and g - f are in X*,  g'x_max <= b.
    """
    s, w, _ = network_end(e, limit)
    x, ahead, sent, heard = port_bounds(s, e, "max", w)
    listed(e, "x", x, s.X)
    listed(e, "z", total((-1, ahead)), s.X)
    listed(e, "C", total((-1, sent)), s.Y)
    listed(e, "W", total((-1, heard)), s.U)
    covered(e, s, x, limits(e, s, beside(e, "bounds")))


def no_network_interval(e: Said, limit: int) -> None:
    """No x_max is such that a network never leaves [0, x_max]: some d in X* has d'w_max > 0, and with r and q

    (d'A - q'C) x >= 0,  (d'B - r' - q'D) u >= 0,  q'y + r'W y >= 0:  then d'(A x + w_max) > 0 on X.
    Or none on which f'x <= b for the `row` of the bounds: x and x_min - x are in X, and f'x > b.
    """
    kind, fields = record(e, "witness", "NoInterval", "BoundExceeded")
    if kind == "BoundExceeded":
        s, _, least = network_end(e, limit)
        exceeded(e, s, least, fields, limits(e, s, beside(e, "bounds")))
        return
    s, w = pushed_network(e, limit)
    d, (_, r, q) = entries(exactly(fields, "d")[0], s.X.dim), exactly(e, *"vrq", read=nodewise)
    R, Q = entries(r, s.U.dim), entries(q, s.Y.dim)
    need(above(d, s.X), "d is in X*")
    rest = total((1, pullback(d, s.A)), (-s.discrete, d), (-1, pullback(Q, s.C)))
    need(above(rest, s.X), "(d'A - q'C) x >= 0")
    need(above(total((1, pullback(d, s.B)), (-1, R), (-1, pullback(Q, s.D))), s.U), "(d'B - r' - q'D) u >= 0")
    need(above(total((1, Q), (1, pullback(R, s.W))), s.Y), "q'y + r'W y >= 0")
    need(dot(d, w) > 0, "d'w_max > 0")


def pushed_network(e: Said, limit: int) -> tuple[System, Vector]:
    """The network and w_max, with  positive,  loops that contract,  and  w_max in X."""
    (s,) = family("network interval", e, limit)
    positive(s, e)
    loop(s, e)
    w = entries(beside(e, "w_max"), s.X.dim)
    listed(e, "u", w, s.X)
    return s, w


def network_end(e: Said, limit: int) -> tuple[System, Vector, Vector]:
    """The network, w_max, and x_min: every [0, x] that is not left has x - x_min in X.

    V'x > 0,  (V'A - Q'C) x < 0,  and the supplies as for `network`, so that the network is stable;  with u_min, y_min
    A x_min + B u + w_max in X,  C x_min + D u - y in Y,  W y - u in U.
    """
    s, w = pushed_network(e, limit)
    V, Q = balanced(s, e, [Fraction(1)] * len(s.nodes))
    decreases(s, V, Q)
    least, ahead, sent, heard = port_bounds(s, e, "min", w)
    listed(e, "y", ahead, s.X)
    listed(e, "c", sent, s.Y)
    listed(e, "m", heard, s.U)
    return s, w, least


def port_bounds(s: System, e: Said, end: str, w: Vector) -> tuple[Vector, Vector, Vector, Vector]:
    """x, A x + B u + w, C x + D u - y and W y - u for the vectors of an end; in discrete time A - I for A."""
    x, u, y = (entries(array(e[f"{name}_{end}"]), C.dim) for name, C in zip("xuy", s.cones(), strict=True))
    ahead = total((1, drift(s, x)), (1, image(s.B, u)), (1, w))
    return x, ahead, total((1, image(s.C, x)), (1, image(s.D, u)), (-1, y)), total((1, image(s.W, y)), (-1, u))


def beside(e: Said, name: str) -> list[Fraction]:
    """A vector of doubles, or what rounds to it: `name`_exact."""
    alone = Said({key: e.get(key) for key in (name, f"{name}_exact")})
    return exactly(alone, name)[0]


# -- networks known within sets


def vertex_systems(e: Said, limit: int) -> list[tuple[System, Said]]:
    """The networks of all vertices, each with the entries that are about it; they share cones and links."""
    (first,) = family("uncertain network", e, limit)
    cones, own = [first.X, first.U, first.Y], {name: e.get(name) for name in "PNLK"}
    others = [sequence(vertex) for vertex in sequence(e["vertices"])]
    expect(all(len(vertex) == 4 for vertex in others), "a vertex has A, B, C and D")
    each = [dict(zip("ABCD", vertex, strict=True)) for vertex in others]
    systems = [first, *(system(Said(e | vertex), vertex["A"], None, cones, "") for vertex in each)]
    proofs = [{name: x and x[k] for name, x in own.items()} for k in range(len(systems))]
    return [(s, Said(e | proof)) for s, proof in zip(systems, proofs, strict=True)]


def end_system(e: Said, end: str, s: System) -> System | None:
    """The network at the `lower` or `upper` ends of its ranges; s has the upper ends, or bounds of both."""
    if e[end] is None:
        return None
    ends = dict(zip("ABCDW", sequence(e[end]), strict=True))
    return system(Said(e | ends), ends["A"], None, [s.X, s.U, s.Y], "")


def within(s: System, low: System, q: Vector) -> None:
    """Positive at the lower ends, which are below the upper ones, and q'y <= 0:  so the upper ends are the worst."""
    positive(low, Said({}))
    apart(s, low, -1)
    need(all(dot(q, y) <= 0 for y in s.Y.rays), "q'y <= 0")


def apart(s: System, end: System, sign: int) -> None:
    """M - L, or M + L, of all matrices of two networks map cones into cones; A + L as for positivity."""
    cones = s.cones()
    for name, (to, of) in SIGNALS.items():
        columns = zip(getattr(s, name), getattr(end, name), strict=True)
        flow = name == "A" and sign == 1 and not s.discrete
        maps(cones[of], [total((1, x), (sign, y)) for x, y in columns], cones[to], None, "ranges", diagonal=flow)


def uncertain_network(e: Said, limit: int) -> None:
    """A network is positive and exponentially stable whatever mixture of its vertices each node is, at any time.

    With the `lower` ends of ranges, also for what is between them and the first vertices, see `within`.
    """
    s, Q = proven_at_vertices(e, limit)
    low = end_system(e, "lower", s)
    if low is not None:
        within(s, low, Q)


def bounded_network(e: Said, limit: int) -> None:
    """|x|_e of the network whose transposed matrices are in the file, on the dual cones, decays for every choice.

    e, y and -u are V, R, Q of `uncertain_network` for the transposed one.  With `upper` ends of ranges beside `lower`
    ones only the network M of the first vertices is positive:  for both ends L of all matrices  M - L, M + L  map cones
    into cones (continuous time: M + L of A up to the generator itself), so that M bounds what is in between.
    """
    s, Q = proven_at_vertices(e, limit)
    low, high = end_system(e, "lower", s), end_system(e, "upper", s)
    if high is None and low is not None:
        within(s, low, Q)
    if high is not None:
        expect(low is not None, "there are no lower ends")
        for end in (low or high, high):
            apart(s, end, -1)
            apart(s, end, 1)


def proven_at_vertices(e: Said, limit: int) -> tuple[System, Vector]:
    """The network of the first vertices, and Q, with the conditions of `network` at every vertex.

    One V, R, Q and one p, t:  all of it is linear in (A, B, C, D) of a node.
    """
    rate = decay_rate_or_none(e)
    systems, Q = vertex_systems(e, limit), Vector()
    for s, own in systems:
        positive(s, own)
        loop(s, own)
        V, Q = balanced(s, own, [Fraction(1)] * len(s.nodes))
        decreases(s, V, Q, rate)
        e.seen |= own.seen
    return systems[0][0], Q


def no_uncertain_network(e: Said, limit: int) -> None:
    """A link leaves the cones; or the network of a choice of vertices is not positive, or grows, see `grows`.

    Or a node or link at the lower ends of ranges leaves the cones.  Or common V, R, Q, p, t of Theorem 4 exist neither
    for the network nor for the transposed one, on simplicial cones:  all vertices are positive, and see `mixed`.
    """
    kind, w = record(e, "witness", "FailingMember", "FailingEnd", "CouplingViolation", "NoCommonVectors")
    absent(e, "decay_rate", "nan")
    if kind == "NoCommonVectors":
        systems = vertex_systems(e, limit)
        for s, own in systems:
            positive(s, own)
            e.seen |= own.seen
        end_system(e, "lower", systems[0][0])
        mixed(e, [s for s, _ in systems], record(w, "storage", "NoCommonStorage")[1])
        mixed(e, [turned(s) for s, _ in systems], record(w, "bound", "NoCommonStorage")[1])
        return
    single = {name: e.get(name) for name in "PNLK"}
    bare = Said({name: x for name, x in e.items() if name not in single})
    systems = [s for s, _ in vertex_systems(bare, limit)]
    s, low = systems[0], end_system(bare, "lower", systems[0])
    e.seen |= bare.seen
    if kind == "FailingEnd":
        expect(low is not None, "there are no lower ends")
        kind, w = record(w, "witness", "NodeViolation", "CouplingViolation")
        s = low or s
    if kind == "FailingMember":
        s = chosen(systems, array(w["choice"]))
        if w["signs"] is not None:
            expect(low is not None, "there are no lower ends")
            s = with_signs(s, low or s, array(w["signs"]))
        kind, w = record(w, "witness", "NodeViolation", "NetworkInstability", "AlgebraicLoop")
    shows = REFUTATIONS["network"][kind]
    if shows is crossed:
        crossed(s, e, kind, w)
        return
    positive(s, e)
    m = motion(s, kind, w)
    need(m.rate >= s.discrete, "the motion decays too fast")
    shows(s, e, m)


def with_signs(s: System, low: System, signs: list[Fraction]) -> System:
    """Links between nodes of one sign at their upper ends, others at the lower ones; all nodes times their signs."""
    expect(len(signs) == len(s.nodes) and all(abs(x) == 1 for x in signs), "1 or -1 for every node")
    _, to, of = s.owners()
    W = list[Vector]()
    for k, (high, below) in enumerate(zip(s.W, low.W, strict=True)):
        alike = {i: a for i, a in high.items() if signs[to[i]] == signs[of[k]]}
        W.append(alike | {i: -a for i, a in below.items() if signs[to[i]] != signs[of[k]]})
    return replace(s, W=W)


def turned(s: System) -> System:
    """The network with A', C', B', D' and W' on the dual cones, of which the generators are the facets."""
    expect(all(map(is_simplicial, s.cones())), "the cones are not simplicial")
    A, B, C, D, W = (transposed(M, C.dim) for M, C in ((s.A, s.X), (s.B, s.X), (s.C, s.Y), (s.D, s.Y), (s.W, s.U)))
    X, U, Y = (replace(K, rays=by_generator(K), Z=transposed(K.rays, K.dim)) for K in s.cones())
    nodes = [(x, y, u) for x, u, y in s.nodes]
    return replace(s, A=A, B=C, C=B, D=D, W=W, X=X, U=Y, Y=U, nodes=nodes)


def chosen(systems: list[System], choice: list[Fraction]) -> System:
    """The network with one vertex for every node."""
    first = systems[0]
    expect(len(choice) == len(first.nodes), "a vertex for every node")
    expect(all(k in range(len(systems)) for k in choice), "the vertices are there")
    owners = first.owners()
    columns = {
        name: [getattr(systems[int(choice[j])], name)[k] for k, j in enumerate(owners[of])]
        for name, (_, of) in SIGNALS.items()
        if name != "W"
    }
    return replace(first, **columns)


def mixed(e: Said, systems: list[System], w: Said) -> None:
    """No common V, R, Q, p, t of Theorem 4 for positive networks:  x^s in X,  u^s in U,  x^s not all 0,

    sum (A^s x^s + B^s u^s) in X,  sum (C^s x^s + D^s u^s) - y in Y,  W y - sum u^s in U.  Or no p, t:  the same with
    x^s = 0 and y in Y, y != 0.
    """
    s = systems[0]
    xs, us, (y,) = (
        [entries(part, C.dim) for part in split(array(w[name]), count)]
        for name, C, count in (("x", s.X, len(systems)), ("u", s.U, len(systems)), ("y", s.Y, 1))
    )
    if not any(xs):
        need(bool(y), "x or y is not zero")
        listed(e, "y", y, s.Y)
    for x, u in zip(xs, us, strict=True):
        listed(e, "x", x, s.X)
        listed(e, "u", u, s.U)
    parts = list(zip(systems, xs, us, strict=True))
    ahead = total(
        *((1, z) for k, x, u in parts for z in (image(k.A, x), image(k.B, u))), *((-s.discrete, x) for x in xs)
    )
    sent = total(*((1, z) for k, x, u in parts for z in (image(k.C, x), image(k.D, u))), (-1, y))
    listed(e, "z", ahead, s.X)
    listed(e, "C", sent, s.Y)
    listed(e, "W", total((1, image(s.W, y)), *((-1, u) for u in us)), s.U)


def split(numbers: list[Fraction], count: int) -> list[list[Fraction]]:
    """Parts of one length, after each other."""
    size, rest = divmod(len(numbers), count)
    expect(rest == 0, "the vertices have vectors of one length")
    return [numbers[k * size : (k + 1) * size] for k in range(count)]


# -- linear cost

CONTROL, GROUP, SHARED, DISTURBANCE = range(4)


@dataclass
class LinearCost:
    """x' = A x + B mu with the cost s'x + r'mu; the columns i of B in columns[g] are a block g with a row l_g.

    Kinds of blocks: a CONTROL |mu_i| <= l'x; a GROUP mu >= 0, 1'mu <= l'x; the same with equality, SHARED; a
    DISTURBANCE |w_j| <= l'x that maximises.  m_g(y) is the best of sum_i y_i mu_i over the block for l_g'x = 1.  With
    the discount beta, or rho in continuous time, A' p - rho p and B'p stand for beta A'p - p and beta B'p below.
    """

    A: Matrix
    B: Matrix
    limits: Matrix
    X: Cone
    s: Vector
    r: Vector
    kinds: list[int]
    columns: list[list[int]]
    beta: Fraction
    rho: Fraction


def best(c: LinearCost, g: int, y: Vector) -> Fraction:
    """m_g(y)."""
    mine = [y.get(i, Fraction(0)) for i in c.columns[g]]
    if c.kinds[g] in (CONTROL, DISTURBANCE):
        return abs(mine[0]) if c.kinds[g] == DISTURBANCE else -abs(mine[0])
    return min(mine) if c.kinds[g] == SHARED else min(Fraction(0), *mine)


def pushed(c: LinearCost, y: Vector, policy: list[Fraction] | None = None) -> Vector:
    """sum_g m_g(y) l_g; with a policy, what it makes of the controls in the place of the best."""
    out = {g: best(c, g, y) for g in range(len(c.kinds))}
    if policy is not None:
        out = {g: a for g, a in out.items() if c.kinds[g] == DISTURBANCE}
        for g, block in enumerate(c.columns):
            if c.kinds[g] != DISTURBANCE:
                out[g] = sum((policy[i] * y.get(i, Fraction(0)) for i in block), Fraction(0))
    return pullback({g: a for g, a in out.items() if a}, c.limits)


def residual(c: LinearCost, p: Vector, policy: list[Fraction] | None = None, *, costs: int = 1) -> Vector:
    """D(p) = s + A'p - rho p + sum_g m_g(r + B'p) l_g; without costs s = 0 and r = 0."""
    y = total((costs, c.r), (c.beta, pullback(p, c.B)))
    moved = total((c.beta, pullback(p, c.A)), (-c.rho, p))
    return total((costs, c.s), (1, moved), (1, pushed(c, y, policy)))


def linear_cost(e: Said, limit: int) -> LinearCost:
    """The data, with  l_g'x >= 0,  and A x + B mu in X, for all admissible mu and x in X.

    On the facets h of X: h'A x + sum_g m_g(B'h) l_g'x >= 0, disturbances counted as controls; in continuous time if
    h'x = 0.
    """
    X, discrete = cone(e["X"], limit), e["discrete"]
    kinds, owner = ([index(k) for k in sequence(e[name])] for name in ("kinds", "owner"))
    alone = {CONTROL, DISTURBANCE}
    expect(set(owner) == set(range(len(kinds))), "every block has a column")
    expect(max(kinds, default=0) <= DISTURBANCE, "blocks are of one of four kinds")
    columns = [list[int]() for _ in kinds]
    for i, g in enumerate(owner):
        columns[g].append(i)
    expect(all(len(columns[g]) == 1 for g, kind in enumerate(kinds) if kind in alone), "blocks of one column")
    expect(type(discrete) is bool, "discrete is neither true nor false")
    discount = fraction(e["discount"])
    expect(0 < discount <= 1 if discrete else discount >= 0, "a discount")
    A, B, L = given(e["A"], X.dim, X.dim), given(e["B"], X.dim, len(owner)), given(e["limits"], len(kinds), X.dim)
    s, r = (
        {i: x[0] for i, x in enumerate(given(e[name], 1, size)) if x}
        for name, size in (("s", X.dim), ("r", len(owner)))
    )
    expect(all(kinds[owner[i]] != DISTURBANCE for i in r), "a disturbance costs nothing")
    out = LinearCost(
        A, B, L, X, s, r, kinds, columns, *((discount, Fraction(1)) if discrete else (Fraction(1), discount))
    )
    need(all(above(pullback({g: Fraction(1)}, L), X) for g in range(len(kinds))), "l'x >= 0")
    tamed = replace(out, kinds=[CONTROL if kind == DISTURBANCE else kind for kind in kinds])
    for h in facets(X, limit):
        kept = total((1, pullback(h, A)), (1, pushed(tamed, pullback(h, B))))
        need(all(dot(kept, x) >= 0 for x in X.rays if discrete or dot(h, x) == 0), "A x + B mu in X")
    return out


def costly(c: LinearCost) -> None:
    """Every stage costs something, but at x = 0:  s'x + r'mu > 0  for all admissible mu."""
    need(all(dot(total((1, c.s), (1, pushed(c, c.r))), x) > 0 for x in c.X.rays), "s'x + r'mu > 0")


def admissible(c: LinearCost, policy: list[Fraction]) -> None:
    """mu_i = policy_i l_g'x keeps to the limits of the controls."""
    expect(len(policy) == sum(map(len, c.columns)) and all(a in (-1, 0, 1) for a in policy), "a policy")
    for g, kind in enumerate(c.kinds):
        mine = [policy[i] for i in c.columns[g]]
        expect(kind in (CONTROL, DISTURBANCE) or min(mine) >= 0, "mu >= 0 in a group")
        expect(kind in (CONTROL, DISTURBANCE) or sum(mine) <= 1, "1'mu <= l'x")
        expect(kind != SHARED or sum(mine) == 1, "1'mu = l'x")


def optimal_cost(e: Said, limit: int) -> None:
    """lower'x <= the optimal cost from x <= the cost of the policy, or of mu = gain x, <= upper'x on X.

    upper'x >= 0,  D(upper)'x <= 0 for the policy or gain,  D(lower)'x >= 0.
    """
    c = linear_cost(e, limit)
    costly(c)
    lower, upper = (entries(array(e[name]), c.X.dim) for name in ("lower", "upper"))
    if e.get("gain") is None:
        policy = sequence(e["policy"])
        expect(all(type(a) is int for a in policy), "a policy")
        admissible(c, policy)
        spent = residual(c, upper, policy)
    else:
        spent = of_gain(c, given(e["gain"], sum(map(len, c.columns)), c.X.dim), upper)
    need(above(upper, c.X), "upper'x >= 0")
    need(above(total((-1, spent)), c.X), "D(upper)'x <= 0")
    need(above(residual(c, lower), c.X), "D(lower)'x >= 0")


def of_gain(c: LinearCost, F: Matrix, p: Vector) -> Vector:
    """s + A'p - rho p + F'(r + B'p) for mu = F x, which keeps to the limits on X.

    l'x - F_i x >= 0 and l'x + F_i x >= 0 for a control;  F_i x >= 0 and l'x - sum_i F_i x >= 0 for a group, = 0 for one
    that is SHARED.
    """
    for g, kind in enumerate(c.kinds):
        limit, mine = pullback({g: Fraction(1)}, c.limits), [pullback({i: Fraction(1)}, F) for i in c.columns[g]]
        left = total((1, limit), *((-1, f) for f in mine))
        expect(kind != DISTURBANCE, "a gain is not against disturbances")
        need(above(left, c.X), "inputs are at most l'x")
        least = [total((1, f), (1, limit)) for f in mine] if kind == CONTROL else mine
        need(all(above(f, c.X) for f in least), "inputs are at least -l'x, in groups 0")
        need(kind != SHARED or above(total((-1, left)), c.X), "1'mu = l'x")
    y = total((1, c.r), (c.beta, pullback(p, c.B)))
    return total((1, c.s), (c.beta, pullback(p, c.A)), (-c.rho, p), (1, pullback(y, F)))


def finite_cost(e: Said, limit: int) -> None:
    """lower_k'x <= the optimal cost of the steps from k on, from x, <= the cost of their policies <= upper_k'x on X.

    With T(p) = D(p) + p and lower_N = upper_N = terminal, in discrete time:  (T(lower_k+1) - lower_k)'x >= 0,  and
    (upper_k - T(upper_k+1))'x >= 0 for policy k.
    """
    c = linear_cost(e, limit)
    expect(e["discrete"], "steps are of discrete time")
    policies, (last,) = rows(e["policies"], sum(map(len, c.columns))), rows(e["terminal"], c.X.dim)
    bounds = [[entries(p, c.X.dim) for p in [*rows(e[name], c.X.dim), last]] for name in ("lower", "upper")]
    expect(all(len(p) == len(policies) + 1 > 1 for p in bounds), "two bounds for every step")
    steps = zip(policies, pairwise(bounds[0]), pairwise(bounds[1]), strict=True)
    for policy, (lower, after), (upper, rest) in steps:
        admissible(c, policy)
        need(above(total((1, residual(c, after)), (1, after), (-1, lower)), c.X), "(T(lower+) - lower)'x >= 0")
        need(above(total((1, upper), (-1, residual(c, rest, policy)), (-1, rest)), c.X), "(upper - T(upper+))'x >= 0")


def infinite_cost(e: Said, limit: int) -> None:
    """No policy has a finite cost from inside X: d'x >= 0, not always 0, and D(d)'x >= 0 without costs."""
    c, (_, w) = linear_cost(e, limit), record(e, "witness", "GrowingCost")
    costly(c)
    d = entries(array(w["d"]), c.X.dim)
    need(above(d, c.X) and bool(d), "d'x >= 0")
    need(above(residual(c, d, costs=0), c.X), "d'x does not fall")


# -- families whose members follow each other in any order


def members(e: Said, claim: str, limit: int) -> list[System]:
    """The members of a family."""
    expect("tuple" in e["A"], "the members are in a tuple")
    return family(claim, e, limit)


def kept(e: Said, systems: list[System]) -> None:
    """X is kept by every member."""
    for s, P in zip(systems, e.get("P") or [None] * len(systems), strict=True):
        e["P"] = P
        positive(s, e)


def no_common_vector(e: Said, limit: int) -> None:
    """No v has v'x > 0 > v'A x for all A and x:  x_s in X, not all 0,  sum A_s x_s in X (discrete: A_s x_s - x_s).

    Then  0 <= v'sum A_s x_s < 0.  In the file are A' and the dual cone if the claim is about a vector inside the cone.
    """
    systems, (_, w) = members(e, "common vector", limit), record(e, "witness", "NoCommonVector")
    X = systems[0].X
    xs = [entries(x, X.dim) for x in rows(w["vectors"], X.dim)]
    expect(len(xs) == len(systems), "there is one vector for every member")
    for x, o in zip(xs, e.get("wx") or [None] * len(xs), strict=True):
        inside(X, x, weights(X, [x], o)[0], "the vectors are in X")
    need(any(xs), "one of the vectors is not 0")
    listed(e, "z", total(*((1, drift(s, x)) for s, x in zip(systems, xs, strict=True))), X)


def not_stable_under_switching(e: Said, limit: int) -> None:
    """Some order of the members does not let x go to 0:  kept, x != 0 and z are in X, where

    `CycleOfGrowth`:  z = P x - factor x for the product P of the members in a cycle, factor >= 1; or
    `UnstableMixture`:  z = sum lam_s A_s x,  lam >= 0 not 0 (discrete: sum lam_s = 1,  z = sum lam_s A_s x - x).
    """
    systems = members(e, "stable under switching", limit)
    kind, w = record(e, "witness", "CycleOfGrowth", "UnstableMixture")
    kept(e, systems)
    x = entries(exactly(w, "x")[0], systems[0].X.dim)
    if kind == "CycleOfGrowth":
        z, factor, _ = after_a_cycle(systems, w, x)
        need(factor >= 1, "the cycle does not shrink x")
    else:
        lam, discrete = fractions(w["weights"]), systems[0].discrete
        need(len(lam) == len(systems) and min(lam) >= 0, "there is a weight for every member")
        need(sum(lam) == 1 if discrete else sum(lam) > 0, "the weights are those of a mixture")
        z = total(*((a, image(s.A, x)) for a, s in zip(lam, systems, strict=True)), (-discrete, x))
    need(bool(x), "x is not 0")
    listed(e, "x", x, systems[0].X)
    listed(e, "z", z, systems[0].X)


def after_a_cycle(systems: list[System], w: Said, x: Vector) -> tuple[Vector, Fraction, int]:
    """P x - factor x, the factor, and how many members follow each other in the cycle; in discrete time."""
    modes, factor, out = [index(k) for k in sequence(w["modes"])], fraction(w["factor"]), x
    expect(systems[0].discrete and len(modes) > 0 and factor > 0, "a cycle has members, and a factor above 0")
    for k in modes:
        out = image(systems[k].A, out)
    return total((1, out), (-factor, x)), factor, len(modes)


def growth_under_switching(e: Said, limit: int) -> None:
    """x[k] grows at most like growth^k, whatever the order:  kept,  v_s'x > 0,  growth v_s'x - v_t'A_s x >= 0.

    Some order grows like least^k:  least^length <= factor of a `CycleOfGrowth`, with weights ws and wb.
    """
    systems = members(e, "growth under switching", limit)
    X, growth, least = systems[0].X, double(e["growth"]), double(e["least"])
    expect(systems[0].discrete and growth >= 0 and least >= 0, "growth is that of discrete time")
    vs = [entries(v, X.dim) for v in rows(e["vs"], X.dim)]
    expect(len(vs) == len(systems), "there is one vector for every member")
    kept(e, systems)
    need(all(dot(v, x) > 0 for v in vs for x in X.rays), "v_s'x > 0")
    for s, v in zip(systems, vs, strict=True):
        need(all(above(total((growth, v), (-1, pullback(t, s.A))), X) for t in vs), "growth v_s'x >= v_t'A_s x")
    if e["cycle"] is None:
        expect(least == 0, "nothing shows the least growth")
        return
    _, w = record(e, "cycle", "CycleOfGrowth")
    x = entries(exactly(w, "x")[0], X.dim)
    z, factor, length = after_a_cycle(systems, w, x)
    need(bool(x) and least**length <= factor, "the cycle shows the least growth")
    listed(e, "s", x, X)
    listed(e, "b", z, X)


def delayed_members(e: Said, limit: int) -> list[System]:
    """A, and the delayed matrices A_k, which have to map X into X as in discrete time."""
    first, *others = members(e, "delayed", limit)
    expect(len(others) > 0, "some matrix is delayed")
    return [first, *(replace(s, discrete=True) for s in others)]


def undelayed(e: Said, systems: list[System]) -> System:
    """X is kept by A and each A_k; the system of the sum S of all, without delays."""
    for s, P in zip(systems, e.get("P") or [None] * len(systems), strict=True):
        maps(s.X, s.A, s.X, P, "A X in X", diagonal=not s.discrete)
    return replace(systems[0], A=reduce(plus, (s.A for s in systems)))


def stable_with_delays(e: Said, limit: int) -> None:
    """x' = A x + sum A_k x(t - h_k) is positive and exponentially stable for all bounded delays, constant or not.

    `undelayed`,  v'x > 0,  v'S x < 0.  For delays of at most h = max_delay it decays at the `rate` c if one is there:
    v'(A + b sum A_k) x + c v'x < 0,  b = factor >= e^(c h)  by a series (discrete time: b >= (1 - c)^-h).
    """
    systems = delayed_members(e, limit)
    S, v = undelayed(e, systems), entries(exactly(e, "v")[0], systems[0].X.dim)
    decreases(S, v, {})
    beside = [e[name] for name in ("max_delay", "factor", "terms")]
    if e["rate"] is None:
        expect(beside == [None] * 3, "nothing is said about delays without a rate")
        return
    c, h, b = double(e["rate"]), fraction(beside[0]), fraction(beside[1])
    expect(c > 0 and h >= 0, "a rate is positive, and no delay is negative")
    if S.discrete:
        expect(c < 1 and h == int(h) and h <= 1000 and beside[2] is None, "so many steps, and a rate below 1")
        need(b * (1 - c) ** int(h) >= 1, "b >= (1 - c)^-h")
    else:
        (terms,) = map(index, sequence(beside[2]))
        need(b >= sum(exponential(c * h, terms)), "b >= e^(c h)")
    parts = [(b if k else 1, pullback(v, s.A)) for k, s in enumerate(systems)]
    fall = total(*parts, (c - S.discrete, v))
    need(all(dot(fall, x) < 0 for x in S.X.rays), "v'(A + b sum A_k) x + c v'x < 0")


def not_stable_with_delays(e: Said, limit: int) -> None:
    """A, or an A_k, does not keep X; or `undelayed`, and no delays make it stable:  x != 0 and S x (S x - x) in X."""
    kind, w = record(e, "witness", "FailingTerm", "InstabilityDirection")
    systems = delayed_members(e, limit)
    if kind == "FailingTerm":
        crossed(systems[index(w["term"])], e, *record(w, "violation", "PositivityViolation", "PlaneViolation"))
        return
    S = undelayed(e, systems)
    unstable(S, e, motion(S, kind, w))


def delayed_network(e: Said, limit: int) -> None:
    """A network is positive and stable for all bounded delays of the last inputs of its nodes, which are their states.

    `network` is proved, and the delayed states are links in it: the last outputs y = x, of the cone X, go to the last
    inputs of the same node, of the same cone, and nothing else does.
    """
    delays_are_links(e, limit, "PROVED")


def not_delayed_network(e: Said, limit: int) -> None:
    """The same `network` is refuted: it is not positive, or no delays make it stable."""
    data = delays_are_links(e, limit, "REFUTED")
    expect(data["witness"]["record"] not in ("NodeNotDissipative", "NoWeights"), "whatever the supplies")


def delays_are_links(e: Said, limit: int, status: str) -> Json:
    """The data of `network`, of this status, whose last inputs and outputs are the states of its nodes."""
    inner = certificate(e["network"])
    expect(inner["claim"] == "network", "it is a network")
    need(inner["status"] == status, "the network decides")
    verify(inner, limit)
    (s,) = family("network", Said(inner["data"]), limit)
    expect(all(len(node[0]) <= min(map(len, node[1:])) for node in s.nodes), "every state is delayed")
    inputs, outputs = (
        {i: x for node in s.nodes for i, x in zip(reversed(node[kind]), reversed(node[0]), strict=False)}
        for kind in (1, 2)
    )
    of_state = {x: k for k, x in outputs.items()}
    fits = all({k: a for k, a in s.C[x].items() if k in outputs} == {of_state[x]: 1} for x in range(s.X.dim))
    expect(fits, "the last outputs are the states")
    for j, column in enumerate(s.D):
        expect(not column or (j not in inputs and not outputs.keys() & column.keys()), "delays have no feedthrough")
    for k, column in enumerate(s.W):
        own = {inputs[i]: a for i, a in column.items() if i in inputs}
        alike = own == {outputs[k]: 1} and len(column) == 1 if k in outputs else not own
        expect(alike, "the last outputs go to the last inputs of their node, and nothing else does")
    for places, C in ((inputs, s.U), (outputs, s.Y)):
        rays = [{places.get(i): a for i, a in x.items()} for x in C.rays if places.keys() & x.keys()]
        expect(rays == s.X.rays, "the cones of delayed states are those of the states")
    return inner["data"]


def compartments(e: Said, limit: int) -> tuple[Matrix, Vector]:
    """Rates f_ij >= 0 from compartment j to i, those from j in one column, and o_i >= 0 to the outside."""
    n = shape(e["flows"])[0]
    expect(0 < n <= limit, "a size is absurd for this file")
    F, leaving = given(e["flows"], n, n), given(e["outflows"], 1, n)
    out = {i: a for i, column in enumerate(leaving) for a in column.values()}
    need(all(a == abs(a) for column in [*F, out] for a in column.values()), "rates are nonnegative")
    return F, out


def drains(e: Said, limit: int) -> None:
    """x' = (F - diag(F'1 + o)) x is positive and exponentially stable: every compartment reaches an outflow.

    With the numbers l_i in `levels`:  o_i > 0,  or f_ji > 0 for some j with l_j < l_i.
    """
    F, out = compartments(e, limit)
    levels = array(e["levels"])
    expect(len(levels) == len(F), "every compartment has a level")
    down = (i in out or any(levels[j] < levels[i] for j in column) for i, column in enumerate(F))
    need(all(down), "material leaves every compartment, or goes to a lower level")


def never_drains(e: Said, limit: int) -> None:
    """It is positive and not stable: the members of a trap have no outflow and no flow to others."""
    F, out = compartments(e, limit)
    _, w = record(e, "witness", "Trap")
    members = array(w["members"])
    expect(bool(members) and all(a < b for a, b in pairwise(members)), "members are in order, and there is one")
    expect(set(members) <= set(range(len(F))), "members are compartments")
    inside = set(map(int, members))
    need(not inside & out.keys() and all(F[i].keys() <= inside for i in inside), "nothing leaves the trap")


def shape(o: Json) -> tuple[int, int]:
    """The numbers of rows and columns of a matrix."""
    if "sparse" in o:
        m, n = map(index, o["shape"])
        return m, n
    listed = listing(content(o, "matrix"))
    return len(listed), len(listing(listed[0])) if listed else 0


def responding(e: Said, limit: int) -> tuple[list[Matrix], tuple[int, int, int]]:
    """A, B, C, D of the system, and how many states, inputs and outputs it has."""
    (n, m), (q, _) = shape(e["B"]), shape(e["C"])
    expect(max(n, m, q) <= limit, "a size is absurd for this file")
    expect(e["discrete"] in (True, False), "the time is unknown")
    places = zip("ABCD", ((n, n), (n, m), (q, n), (q, m)), strict=True)
    return [given(e[name], *size) for name, size in places], (n, m, q)


def positive_realization(e: Said, limit: int) -> None:
    """P, N, Q and D are nonnegative (P off the diagonal in continuous time) and have the response of A, B, C and D.

    With `transform` R:  A R = R P,  B = R N,  C R = Q.
    """
    (A, B, C, D), (n, m, q) = responding(e, limit)
    p = shape(e["transform"])[1]
    expect(p <= limit, "a size is absurd for this file")
    R, P, N = given(e["transform"], n, p), given(e["A_positive"], p, p), given(e["B_positive"], p, m)
    Q = given(e["C_positive"], q, p)
    need([image(A, r) for r in R] == [image(R, x) for x in P], "A R = R P")
    need([image(R, x) for x in N] == B, "B = R N")
    need([image(C, r) for r in R] == Q, "C R = Q")
    rates = [{i: a for i, a in x.items() if e["discrete"] or i != j} for j, x in enumerate(P)]
    need(all(a == abs(a) for x in [*rates, *N, *Q, *D] for a in x.values()), "the matrices are nonnegative")


def no_positive_realization(e: Said, limit: int) -> None:
    """The response to an impulse begins with the wrong sign: an entry of D (`step` 0) or of C B (1) is negative."""
    (_, B, C, D), _ = responding(e, limit)
    _, w = record(e, "witness", "NegativeResponse")
    i, j, step = (index(w[name]) for name in ("row", "column", "step"))
    expect(step < 2, "there is no such step")
    need((image(C, B[j]) if step else D[j]).get(i, 0) < 0, "the response is negative")


def dwells_long_enough(e: Said, limit: int) -> None:
    """Stable for every order in which each member stays active for T = dwell_time > 0 or longer.

    M_s = A_s + a_s I maps X into X (weights P),  v_s'x > 0 > v_s'A_s x,  and v_t'e^{A_s T} x < v_s'x for t != s, as
    sum_{k<=N} v_t'(M_s T)^k x / k! + c rest v_s'x < e_N v_s'x,  where v_t <= c v_s, e_N + rest >= e^{a_s T} >= e_N.
    In discrete time T is a whole number,  kept,  v_t'A_s^T x < v_s'x.
    """
    systems, shifts = shifted_members(e, limit, {"tuple": []} if e["shifts"] is None else e["shifts"])
    X, T, whole = systems[0].X, fraction(e["dwell_time"]), systems[0].discrete
    expect(e["terms"] is None or not whole, "powers need no terms")
    terms = [0] * len(systems) if whole else [index(n) for n in sequence(e["terms"])]
    vs = [entries(v, X.dim) for v in rows(e["vs"], X.dim)]
    expect(len(vs) == len(terms) == len(systems) and T > 0, "every member has a vector and a number of terms")
    need(all(dot(v, x) > 0 for v in vs for x in X.rays), "v_s'x > 0")
    need(all(dot(v, drift(s, x)) < 0 for s, v in zip(systems, vs, strict=True) for x in X.rays), "v_s'A_s x < 0")
    for s, a, v, count in zip(systems, shifts, vs, terms, strict=True):
        done, rest = (Fraction(1), Fraction(0)) if whole else exponential(a * T, count)
        for f in (f for f in vs if f is not v):
            most = max(dot(f, x) / dot(v, x) for x in X.rays)
            for x in X.rays:
                low = dot(f, power(s, T, x) if whole else series(s, a, T, count, x))
                need(low + most * rest * dot(v, x) < done * dot(v, x), "v_t'e^{A_s T} x < v_s'x")


def too_short(e: Said, limit: int) -> None:
    """Some order in which each member stays active for dwell_time or longer does not let x go to 0.

    M_s = A_s + a_s I maps X into X (weights P),  x != 0 and z are in X:  z = P x - x from below, where e^{A_s t} x is
    at least  sum_{k<=N} (M_s t)^k x / k! / (e_N + rest)  in the order of X.  In discrete time kept, and A_s^t x itself.
    """
    _, w = record(e, "witness", "DwellCycle")
    systems, shifts = shifted_members(e, limit, w["shifts"])
    modes, times, count = [index(k) for k in sequence(w["modes"])], fractions(w["times"]), index(w["terms"])
    expect(len(modes) == len(times) and count > 0, "every member of a cycle has a time")
    expect(fraction(e["dwell_time"]) > 0, "a dwell time is positive")
    need(min(times) >= fraction(e["dwell_time"]), "the times are long enough")
    x = z = entries(exactly(w, "x")[0], systems[0].X.dim)
    for k, t in zip(modes, times, strict=True):
        if systems[0].discrete:
            z = power(systems[k], t, z)
            continue
        size = sum(exponential(shifts[k] * t, count), Fraction(0))
        z = total((1 / size, series(systems[k], shifts[k], t, count, z)))
    need(bool(x), "x is not 0")
    listed(e, "x", x, systems[0].X)
    listed(e, "z", total((1, z), (-1, x)), systems[0].X)


def shifted_members(e: Said, limit: int, o: Json) -> tuple[list[System], list[Fraction]]:
    """The members, and in continuous time shifts a_s >= 0 for which A_s + a_s I maps X into X; in discrete time 0."""
    systems, shifts = members(e, "dwell time", limit), fractions(o)
    if systems[0].discrete:
        expect(not shifts, "exponentials are those of continuous time")
        in_steps(fraction(e["dwell_time"]))
        kept(e, systems)
        return systems, [Fraction(0)] * len(systems)
    expect(len(shifts) == len(systems) and min(shifts) >= 0, "every member has a shift that is not negative")
    for s, a, P in zip(systems, shifts, e.get("P") or [None] * len(systems), strict=True):
        maps(s.X, [total((1, column), (a, {j: Fraction(1)})) for j, column in enumerate(s.A)], s.X, P, "X is kept")
    return systems, shifts


def exponential(z: Fraction, terms: int) -> tuple[Fraction, Fraction]:
    """sum_{k<=N} z^k / k!, and a bound of what is left of e^z,  2 z^(N+1) / (N+1)!,  for 0 <= 2 z <= N + 2."""
    expect(terms <= 1000 and 0 <= 2 * z <= terms + 2, "so many terms do not show an exponential")
    parts = [Fraction(1)]
    for k in range(1, terms + 2):
        parts.append(parts[-1] * z / k)
    return sum(parts[:-1], Fraction(0)), 2 * parts[-1]


def series(s: System, a: Fraction, t: Fraction, terms: int, x: Vector) -> Vector:
    """sum_{k<=N} (M t)^k x / k!  for M = A + a I."""
    out = term = x
    for k in range(1, terms + 1):
        term = total((t / k, image(s.A, term)), (a * t / k, term))
        out = total((1, out), (1, term))
    return out


def power(s: System, t: Fraction, x: Vector) -> Vector:
    """A^t x."""
    return reduce(lambda y, _: image(s.A, y), range(in_steps(t)), x)


def in_steps(t: Fraction) -> int:
    """A time as a whole number, of at most a thousand steps."""
    expect(t.denominator == 1 and t <= 1000, "in discrete time a time is a number of steps")
    return int(t)


def mean_stable(e: Said, limit: int) -> None:
    """The mean of x goes to 0 exponentially if the members follow each other by a Markov chain, see `jumping`.

    v_i'x > 0,  f_i'x < 0  and  f_i'x + rate v_i'x <= 0  for decay_rate and required_rate, where
    f_i = A_i'v_i + q_ii v_i + sum_j q_ij J_ij'v_j  (discrete time: f_i = sum_j p_ij A_i'J_ij'v_j - v_i).
    """
    systems, q, jumps = jumping(e, limit)
    X, rates = systems[0].X, (decay_rate_or_none(e), required_rate(e))
    vs = [entries(v, X.dim) for v in rows(e["vs"], X.dim)]
    expect(len(vs) == len(systems), "there is one vector for every member")
    need(all(dot(v, x) > 0 for v in vs for x in X.rays), "v_i'x > 0")
    for i, (s, v) in enumerate(zip(systems, vs, strict=True)):
        ahead = total(*((q[i][j], pullback(w, jumps[i, j]) if (i, j) in jumps else w) for j, w in enumerate(vs)))
        parts = (pullback(ahead, s.A), total((-1, v))) if s.discrete else (pullback(v, s.A), ahead)
        f = total((1, parts[0]), (1, parts[1]))
        need(all(dot(f, x) < 0 for x in X.rays), "(L'v)_i'x < 0")
        need(all(dot(f, x) + rate * dot(v, x) <= 0 for rate in rates for x in X.rays), "(L'v)_i'x + rate v_i'x <= 0")


def not_mean_stable(e: Said, limit: int) -> None:
    """The mean of x does not go to 0, or not at required_rate:  x_i in X (weights wx), not all 0,  z_j in X (wz), where

    z_j = A_j x_j + q_jj x_j + sum_i q_ij J_ij x_i + rate x_j  (discrete: sum_i p_ij J_ij A_i x_i + (rate - 1) x_j),
    and the rate of the witness is 0, or between 0 and required_rate.
    """
    (systems, q, jumps), (_, w) = jumping(e, limit), record(e, "witness", "MeanDirection")
    X, rate, asked = systems[0].X, either(w["rate"]), required_rate(e)
    expect(rate >= 0, "a rate is not negative")
    need(not rate or rate < asked, "the rate is less than the one that was asked for")
    xs = [entries(x, X.dim) for x in rows(w["vectors"], X.dim)]
    expect(len(xs) == len(systems), "there is one vector for every member")
    own = [image(s.A, x) for s, x in zip(systems, xs, strict=True)]
    leaving = own if systems[0].discrete else xs
    shown = [e.get(name) or [None] * len(xs) for name in ("wx", "wz")]
    need(any(xs), "one of the vectors is not 0")
    for j, x in enumerate(xs):
        came = ((q[i][j], image(jumps[i, j], y) if (i, j) in jumps else y) for i, y in enumerate(leaving))
        z = total(*came, (rate, x), *([(-1, x)] if systems[0].discrete else [(1, own[j])]))
        inside(X, x, weights(X, [x], shown[0][j])[0], "the vectors are in X")
        inside(X, z, weights(X, [z], shown[1][j])[0], "the vectors are mapped into X")


def jumping(e: Said, limit: int) -> tuple[list[System], list[list[Fraction]], dict[tuple[int, int], Matrix]]:
    """The members, kept;  rates q_ij >= 0 for i != j, with rows of sum 0, in discrete time probabilities, of sum 1;

    and the jumps, which map X into X (weights N): the k-th one from member between[2 k] to another, between[2 k + 1].
    """
    systems = members(e, "mean stable", limit)
    kept(e, systems)
    X, discrete, q = systems[0].X, systems[0].discrete, rows(e["chain"], len(systems))
    expect(len(q) == len(systems) and all(sum(row) == discrete for row in q), "rows of a chain have a sum")
    allowed = (a >= 0 or (i == j and not discrete) for i, row in enumerate(q) for j, a in enumerate(row))
    expect(all(allowed), "a rate is not negative")
    given_jumps, ends = ([] if e[name] is None else sequence(e[name]) for name in ("jumps", "between"))
    pairs_of = list(zip(ends[::2], ends[1::2], strict=True))
    expect(len(set(pairs_of)) == len(pairs_of) == len(given_jumps), "every jump has a pair of its own")
    expect(all(index(k) < len(systems) for k in ends) and all(i != j for i, j in pairs_of), "a jump is between two")
    jumps = {pair: given(J, X.dim, X.dim) for pair, J in zip(pairs_of, given_jumps, strict=True)}
    for J, o in zip(jumps.values(), e.get("N") or [None] * len(jumps), strict=True):
        maps(X, J, X, o, "J X in X")
    return systems, q, jumps


def stabilising_switching(e: Said, limit: int) -> None:
    """The rule s(x) = argmin_s v'A_s x makes v'x fall on X:  kept,  v'x > 0,  and for weights >= 0 of sum 1

    f'x < 0,  f'x + decay_rate v'x <= 0  for f = sum_s weight_s A_s'v (discrete time: - v).
    """
    systems = members(e, "stabilising switching", limit)
    kept(e, systems)
    X, lam, rate = systems[0].X, fractions(e["weights"]), decay_rate_or_none(e)
    v = entries(exactly(e, "v")[0], X.dim)
    expect(len(lam) == len(systems) and min(lam) >= 0 and sum(lam) == 1, "the weights are those of a mixture")
    need(all(dot(v, x) > 0 for x in X.rays), "v'x > 0")
    f = total(*((a, pullback(v, s.A)) for a, s in zip(lam, systems, strict=True)), (-systems[0].discrete, v))
    need(all(dot(f, x) < 0 for x in X.rays), "v'(sum w A) x < 0")
    need(all(dot(f, x) + rate * dot(v, x) <= 0 for x in X.rays), "v'(sum w A) x + rate v'x <= 0")


# -- nonlinear networks, from ends of their Jacobians


@dataclass
class Slopes:
    """Ends of the Jacobians A, B, C of all nodes and of the slopes W and S of links; own outputs of inputs with S."""

    sizes: tuple[int, int, int]
    upper: list[Matrix]
    lower: list[Matrix]
    own: list[Fraction]


def slopes(e: Said, limit: int) -> Slopes:
    """Lower ends below upper ends, entry by entry."""
    high, low, own = sequence(e["upper"]), sequence(e["lower"]), array(e["own"])
    expect(len(high) == len(low) == 5, "there are five matrices at both ends")
    expect(all("sparse" in M for M in high + low), "the matrices at the ends are sparse")
    n, m, q = (index(M["shape"][side]) for M, side in ((high[0], 0), (high[1], 1), (high[2], 0)))
    expect(max(n, m, q) <= limit, "a size is absurd for this file")
    shapes = (n, n), (n, m), (q, n), (m, q), (m, q)
    upper, lower = ([given(M, *shape) for M, shape in zip(end, shapes, strict=True)] for end in (high, low))
    expect(len(own) == m and all(k.denominator == 1 for k in own), "own has a whole number for every input")
    expect(all(0 <= own[i] < q for x in upper[4] for i in x), "own names an output that does not exist")
    pairs = [columns for M, N in zip(upper, lower, strict=True) for columns in zip(M, N, strict=True)]
    need(all(nonnegative(total((1, x), (-1, y))) for x, y in pairs), "lower ends are below upper ends")
    return Slopes((n, m, q), upper, lower, own)


def own_part(s: Slopes) -> Matrix:
    """A- - B+ s+ C+, with the sum s_i of the slopes of differences at input i, and its own output."""
    n, m, q = s.sizes
    to = transposed(s.upper[2], q)
    sums = total(*((1, x) for x in s.upper[4]))
    share = [{} if i not in sums else total((sums[i], to[int(s.own[i])])) for i in range(m)]
    lost = chained(s.upper[1], transposed(share, n))
    return [total((1, x), (-1, y)) for x, y in zip(s.lower[0], lost, strict=True)]


def differentially_positive_network(e: Said, limit: int) -> None:
    """A nonlinear network keeps the order of nonnegative orthants, and contracts with e or v, given these ends.

    B-, C-, W-, S- >= 0 and A- - B+ s+ C+ >= 0 off the diagonal.  Any two solutions differ by d with d' = J(t) d, J(t)
    between the ends.  max |d_i| / e_i falls at the decay_rate c if e > 0 and, with y >= C+ e, y_lower <= C- e,

        u >= W+ y + sum max over s in [s-, s+] of s (y_l - y_lower_own),
        A+ e + B+ max(u, 0) + B- min(u, 0) + c e <= 0,

    and sum v_i |d_i| if v > 0, r >= B+'v, p >= W+'r, A+'v + C+'p + c v <= 0 and there are no differences.
    The region is invariant if rates are >= 0 at its lower corner, and <= 0 at the upper one, given these bounds.
    """
    s = slopes(e, limit)
    need(all(nonnegative(x) for M in s.lower[1:] for x in M), "lower ends are not negative")
    kept_off = ((i, j, a) for j, x in enumerate(own_part(s)) for i, a in x.items())
    need(all(a >= 0 for i, j, a in kept_off if i != j), "A- - B+ s+ C+ >= 0 off the diagonal")
    rate = decay_rate_or_none(e)
    contracts = e["e"] is not None or e["v"] is not None
    expect((rate > 0) == contracts, "a decay rate is positive with vectors that prove it, and else 0")
    all_or_none(e, ("e", "y", "y_lower", "u"), by_e, s, rate)
    all_or_none(e, ("v", "r", "p"), by_v, s, rate)
    all_or_none(e, ("rates_at_lower", "rates_at_upper"), inwards_at_corners, s, rate)


def all_or_none(e: Said, names: tuple[str, ...], proof: Callable[..., None], s: Slopes, rate: Fraction) -> None:
    """All of these vectors are there, and prove something, or none."""
    there = {e[name] is not None for name in names}
    expect(len(there) == 1, f"some of {', '.join(names)} are missing")
    if True in there:
        n, m, q = s.sizes
        length = {"y": q, "y_lower": q, "u": m, "r": m, "p": q}
        proof(s, rate, *(entries(array(e[name]), length.get(name, n)) for name in names))


def by_e(s: Slopes, c: Fraction, x: Vector, y: Vector, least: Vector, u: Vector) -> None:
    """The inequalities on e, y, y_lower and u."""
    A, B, C, W, S = s.upper
    need(len(x) == s.sizes[0] and nonnegative(x), "e > 0")
    need(nonnegative(total((1, y), (-1, image(C, x)))), "y >= C e")
    need(nonnegative(total((1, image(s.lower[2], x)), (-1, least))), "y_lower <= C e")
    pushed: Vector = {}
    for k, column in enumerate(S):
        for i, high in column.items():
            d = y.get(k, 0) - least.get(int(s.own[i]), Fraction(0))
            pushed[i] = pushed.get(i, Fraction(0)) + max(high * d, s.lower[4][k].get(i, Fraction(0)) * d)
    need(nonnegative(total((1, u), (-1, image(W, y)), (-1, pushed))), "u >= W y + S d")
    more, less = ({i: a for i, a in u.items() if (a > 0) == side} for side in (True, False))
    drift = total((1, image(A, x)), (1, image(B, more)), (1, image(s.lower[1], less)), (c, x))
    need(nonnegative(total((-1, drift))), "A e + B u + c e <= 0")


def by_v(s: Slopes, c: Fraction, v: Vector, r: Vector, p: Vector) -> None:
    """The inequalities on v, r and p."""
    A, B, C, W, S = s.upper
    expect(not any(S), "v is for networks without links of differences")
    need(len(v) == s.sizes[0] and nonnegative(v), "v > 0")
    need(nonnegative(total((1, r), (-1, pullback(v, B)))), "r >= B'v")
    need(nonnegative(total((1, p), (-1, pullback(r, W)))), "p >= W'r")
    drift = total((1, pullback(v, A)), (1, pullback(p, C)), (c, v))
    need(nonnegative(total((-1, drift))), "A'v + C'p + c v <= 0")


def inwards_at_corners(s: Slopes, c: Fraction, lower: Vector, upper: Vector) -> None:
    """Rates at the corners of the region point into it."""
    need(nonnegative(lower), "rates at the lower corner are not negative")
    need(nonnegative(total((-1, upper))), "rates at the upper corner are not positive")


def order_violated(e: Said, limit: int) -> None:
    """An entry of the Jacobian at a state, at most `value` < 0, where the order asks for a nonnegative one.

    It is one of A with the own share (block 0, off the diagonal), B, C, W or S, and not below what the ends allow.
    """
    s, (_, w) = slopes(e, limit), record(e, "witness", "OrderViolation")
    block, i, j, value = index(w["block"]), index(w["row"]), index(w["column"]), double(w["value"])
    n, m, q = s.sizes
    expect(i < (n, n, q, m, m)[block] and (block > 0 or i != j), "there is no such entry")
    if w["x"] is not None:
        entries(array(w["x"]), n)
    least = (s.lower[block] if block else own_part(s))[j]
    need(value < 0, "the slope is negative")
    need(value >= least.get(i, Fraction(0)), "the slope is within the ends")
    absent(e, "decay_rate", "nan")


# -- measurements


@dataclass
class Measured:
    """Plants [A B] with |X1 - [A B] Z| <= noise, entry by entry, and the gain F of u = F x; one column a sample."""

    X: Cone
    discrete: bool
    Z: Matrix
    X1: Matrix
    noise: Matrix
    F: Matrix
    signals: int


def with_input(d: Measured, x: Vector) -> Vector:
    """(x; F x)."""
    return x | {d.X.dim + i: a for i, a in image(d.F, x).items()}


def agrees(d: Measured, plant: Matrix) -> None:
    """A plant that is one of them."""
    for z, x, v in zip(d.Z, d.X1, d.noise, strict=True):
        off = sizes(total((1, x), (-1, image(plant, z))))
        need(all(off.get(i, 0) <= v.get(i, 0) for i in off | v), "a plant agrees with the samples")


def bound_of_row(d: Measured, l: Vector, i: int, side: int) -> Fraction:
    """What row i of all plants does at Z l at least (side 0) or at most (1)."""
    terms = [(a, d.X1[t].get(i, Fraction(0)), d.noise[t].get(i, Fraction(0))) for t, a in l.items()]
    return sum((a * x + (abs(a) if side else -abs(a)) * v for a, x, v in terms), Fraction(0))


def measured(e: Said, limit: int) -> Measured:
    """X0, X1, noise with a column for each sample; with inputs U0 and F as well, Z being X0 above U0."""
    X, discrete = cone(e["X"], limit), e["discrete"]
    n, T = X.dim, len(listing(listing(content(e["X0"], "matrix"))[0]))
    expect(isinstance(discrete, bool), "discrete is neither true nor false")
    Z, X1, noise = (given(e[name], n, T) for name in ("X0", "X1", "noise"))
    if e["U0"] is None:
        return Measured(X, discrete, Z, X1, noise, [{} for _ in range(n)], n)
    m = len(listing(content(e["U0"], "matrix")))
    U0, F = given(e["U0"], m, T), optional(e["F"], m, n)
    Z = [x | {n + i: a for i, a in u.items()} for x, u in zip(Z, U0, strict=True)]
    return Measured(X, discrete, Z, X1, noise, F, n + m)


def from_data(e: Said, limit: int) -> None:
    """Every plant of `measured` keeps X, and one plant agrees; with `e` all are stable, in continuous or discrete time.

    h'(A + BF) x >= 0 for all h in the facets of X (continuous time: with h'x = 0), as the sum of h_i times the lower
    bound of row i where h_i > 0, the upper one where h_i < 0: Z l = (x; F x) for the next row l of `combinations`.  And
    h'(A + BF) e < 0 (discrete time: < h'e) by the bounds of the other sides, for all h, h'e > 0.
    """
    d, vector = measured(e, limit), exactly(e, "e")[0]
    expect((e["U0"] is None) == (e["F"] is None), "inputs and a gain come together")
    agrees(d, given(e["plant"], d.X.dim, d.signals))
    hs, left = facets(d.X, limit), rows(e["combinations"], len(d.Z))
    asked = [(x, [h for h in hs if d.discrete or dot(h, x) == 0], False) for x in d.X.rays]
    if vector:
        asked.append((entries(vector, d.X.dim), hs, True))
    for x, counted, falls in asked:
        found = dict[tuple[int, int], Fraction]()
        for i, side in pairs(range(d.X.dim), (0, 1)):
            if any(i in h and (h[i] < 0) ^ falls == side for h in counted):
                expect(bool(left), "a combination is missing")
                l = entries(left.pop(0), len(d.Z))
                need(image(d.Z, l) == with_input(d, x), "Z l = (x; F x)")
                found[i, side] = bound_of_row(d, l, i, side)
        for h in counted:
            worst = sum((a * found[i, (a < 0) ^ falls] for i, a in h.items()), Fraction(0))
            need(worst < d.discrete * dot(h, x) if falls else worst >= 0, "h'(A + BF) x at the worst plant")
            need(not falls or dot(h, x) > 0, "h'e > 0")
    expect(not left, "there are more combinations than bounds")


def not_from_data(e: Said, limit: int) -> None:
    """A plant of `measured` leaves X: h in X*, h'(A + BF) x < 0 at a generator x (continuous time: with h'x = 0).

    Or, without F, some plants of `measured` exclude all gains F together: with functionals `d` as vertices in
    `no_feedback`, else as in `no_invariant_gain`.
    """
    d, (kind, w) = measured(e, limit), record(e, "witness", "LeavingPlant", "ExcludingPlants")
    n, m = d.X.dim, d.signals - d.X.dim
    if kind == "LeavingPlant":
        expect((e["U0"] is None) == (e["F"] is None), "inputs and a gain come together")
        plant, h = given(w["plant"], n, d.signals), entries(exactly(w, "normal")[0], n)
        x = d.X.rays[index(w["ray"])]
        agrees(d, plant)
        need(above(h, d.X), "h'x >= 0 on X")
        need(d.discrete or dot(h, x) == 0, "h'x = 0")
        need(dot(h, image(plant, with_input(d, x))) < 0, "the plant leaves X")
        return
    expect(e["U0"] is not None and e["F"] is None, "there are inputs and no gain")
    for A, B in zip(sequence(w["A"]), sequence(w["B"]), strict=True):
        agrees(d, [*given(A, n, n), *given(B, n, m)])
    vertices = {"A": w["A"], "B": w["B"], "X": e["X"], "discrete": d.discrete, "witness": w["functionals"]}
    _, f = record(w, "functionals", "Functionals")
    expect(f["L"] is not None, "there are no functionals")
    if f["d"] is None:
        eye = [[int(i == j) for j in range(n)] for i in range(n)]
        no_invariant_gain(Said(vertices | {"R": {"matrix": eye}, "pattern": {"array": [[1] * n] * m}}), limit)
    else:
        free = {"array": [[1] * m] * len(d.X.rays)}
        no_feedback(Said(vertices | {"rate": {"double": 0}, "gain_bound": None, "free": free}), limit)


# -- networks in shards: folders of arrays, of which one shard with its halo is read at a time

Numbers = Any  # an array of them
KINDS = {"<f8": "d", "<i4": "i", "<i8": "q"}
# Bytes before the numbers.
HEAD = 128
# Nodes, states, inputs and outputs of a shard that need not have a byte in its files.
FREE_SIZES = 10_000_000
# Nodes, states with inputs and outputs, and entries of W with numbers that are no doubles, of a network in one piece.
ONE_PIECE = 5_000, 20_000, 1_000_000


@dataclass
class Faced(Cone):
    """A cone with its facets; facets and generators are vectors of integers."""

    faces: list[Vector]


@dataclass
class Shards:
    """A network in shards: what its manifest states, the cones, and how much precedes every shard.

    `starts` are the nodes, states, inputs and outputs before each, and those of all.
    """

    folder: Path
    data: Json
    cones: list[Faced]
    starts: list[list[int]]
    discrete: bool

    def nodes(self) -> int:
        """How many there are in all."""
        *_, total = self.starts[0]
        return total

    def files(self, p: int) -> Json:
        """What the manifest states of the files of a shard."""
        return self.data["shards"][p]["files"]

    def stacks(self, p: int) -> list[tuple[int, list[Faced]]]:
        """The stacks of a shard: how many nodes, and X, U and Y."""
        return [(t["nodes"], [self.cones[t[name]] for name in "XUY"]) for t in self.data["shards"][p]["stacks"]]

    def read(self, p: int, name: str, kinds: str, *shapes: list[int]) -> Numbers:
        """An array of a shard."""
        return numbers(place_of(self.folder, p, name), self.files(p)[name], kinds, *shapes)


def count(net: Shards, p: int, kind: int) -> int:
    """How many nodes (kind 0), states, inputs or outputs a shard has."""
    return net.starts[kind][p + 1] - net.starts[kind][p]


def place_of(folder: Path, p: int, name: str) -> Path:
    """The file of an array."""
    return folder / f"shard-{p:05d}" / f"{name}.npy"


def manifest(folder: Path, form: str, keys: set[str], more: set[str] | None = None) -> tuple[Json, int]:
    """The data of a manifest, which have these entries and may have more, and its length."""
    c, length = parsed(folder / "manifest.json")
    expect(c.keys() == {"format", "digest", "data"} and c["format"] == form, f"{folder} is not in the format {form}")
    expect(c["digest"] == digest(c["data"]), f"the data of {folder} have not the stated digest")
    expect(c["data"].keys() - (more or set()) == keys, f"the manifest of {folder} has other entries")
    return c["data"], length


def numbers(path: Path, entry: Json, kinds: str, *shapes: list[int]) -> Numbers:
    """The numbers in a .npy file of one of these types and shapes, once its size and its digest are as stated."""
    expect(entry.keys() == {"dtype", "shape", "sha256"}, f"{path} is not described")
    kind, shape = KINDS[entry["dtype"]], [index(n) for n in entry["shape"]]
    expect(kind in kinds and shape in shapes, f"{path} has not the type and the size of its shard")
    out = packed(kind)
    expect(path.is_file(), f"{path} is missing, or no regular file")
    expect(path.stat().st_size == HEAD + prod(shape) * out.itemsize, f"{path} has not the size that is stated")
    data = path.read_bytes()
    expect(hashlib.sha256(data).hexdigest() == entry["sha256"], f"{path} is not the file that its manifest is about")
    about = f"{{'descr': '{entry['dtype']}', 'fortran_order': False, 'shape': {tuple(shape)}, }}"
    expect(data[:HEAD] == b"\x93NUMPY\x01\x00v\x00%-117s\n" % about.encode(), f"{path} says something else of itself")
    out.frombytes(memoryview(data)[HEAD:])
    if sys.byteorder == "big":
        out.byteswap()
    return out


def beside_doubles(path: Path, entry: Json, arrays: dict[str, Numbers]) -> None:
    """Numbers in these arrays that are no doubles, from a file of text: the array holds the doubles next to them."""
    expect(entry.keys() == {"bytes", "sha256"}, f"{path} is not described")
    expect(path.is_file(), f"{path} is missing, or no regular file")
    expect(path.stat().st_size == entry["bytes"], f"{path} has not the size that is stated")
    expect(hashlib.sha256(path.read_bytes()).hexdigest() == entry["sha256"], f"{path} is another file")
    exact, _ = parsed(path)
    expect(exact != {}, f"{path} says nothing")
    for name, given in exact.items():
        arrays[name] = list(arrays[name])
        expect(bool(given) and all(a < b for (a, _), (b, _) in pairwise(given)), f"{path} is not in order")
        for place, text in given:
            x, rounded = number(text), arrays[name][index(place)]
            expect(float(x) == rounded != x, f"{path} has numbers that are no others than the doubles")
            arrays[name][place] = x


def stated_double(text: Json) -> float:
    """A double that is finite and not negative, as float.hex writes it."""
    x = float.fromhex(text)
    expect(x.hex() == text and 0 <= x < float("inf"), f"{text} is no rate, and no step of time")
    return x


def in_integers(x: Vector) -> Any:
    """A positive multiple."""
    unit = lcm(*(a.denominator for a in x.values()))
    return {i: int(a * unit) for i, a in x.items()}


def shards_in(folder: Path) -> Shards:
    """The network in a folder, as far as its manifest says; nothing else is opened."""
    d, limit = manifest(folder, "kpos-shards/1", {"dt", "cones", "shards"})
    discrete = d["dt"] if d["dt"] is None or type(d["dt"]) is bool else stated_double(d["dt"])
    cones, limit = list[Faced](), limit + 20_000
    for o in d["cones"]:
        C = cone({"cone": listing(o)}, limit)
        rays, faces = ([in_integers(x) for x in part] for part in (C.rays, facets(C, limit)))
        cones.append(Faced(C.dim, rays, [], [], faces))
        limit -= C.dim
    out = Shards(folder, d, cones, [], bool(discrete))
    totals = list[list[int]]()
    for p, s in enumerate(d["shards"]):
        expect(s.keys() - {"exact"} == {"nodes", "stacks", "files"}, f"shard {p} has other entries")
        expect(
            s.get("exact", {}).keys() <= ({"nodes", "links"} if s["stacks"] else set()), f"shard {p} has other numbers"
        )
        stacks = [(t.keys(), [index(t[name]) for name in ("nodes", *"XUY")]) for t in s["stacks"]]
        expect(all(keys == {"nodes", *"XUY"} and t[0] > 0 for keys, t in stacks), f"shard {p} has other stacks")
        expect(sum(t[0] for _, t in stacks) == index(s["nodes"]), f"shard {p} has not the nodes of its stacks")
        needed = {f"members{g}" for g in range(len(stacks))} if len(stacks) > 1 else set[str]()
        needed |= {"weights", "targets", "indptr", "halo"} if stacks else set()
        free = {f"{name}{g}" for name in "ABCD" for g in range(len(stacks))} | (
            {"numbers", "names"} if stacks else set()
        )
        expect(needed <= s["files"].keys() <= needed | free, f"shard {p} has other files")
        sizes = [sum(n * C[kind].dim for n, C in out.stacks(p)) for kind in range(3)]
        totals.append([s["nodes"], *sizes])
    out.starts = [list(accumulate(part, initial=0)) for part in zip(*totals, strict=True)]
    expect(out.nodes() > 0, "there is no node")
    return out


@dataclass
class Layout:
    """For every node of a shard: its stack, its place there, and where its states, inputs and outputs begin."""

    stacks: Numbers
    places: Numbers
    starts: list[Numbers]


def layout(net: Shards, p: int) -> Layout:
    """Where the nodes of a shard are, whose sizes are bounded by the bytes of its files."""
    n, stacks = count(net, p, 0), net.stacks(p)
    arrays = net.files(p).keys() - {"names"}
    room = sum((place_of(net.folder, p, name).stat().st_size for name in arrays), FREE_SIZES)
    expect(sum(count(net, p, kind) for kind in range(4)) <= room, f"the sizes of shard {p} are absurd for its files")
    of, places = packed("q", repeat(0, n)), packed("q", range(n))
    if len(stacks) != 1:
        members = [net.read(p, f"members{g}", "iq", [size]) for g, (size, _) in enumerate(stacks)]
        nodes = sorted((j, g, i) for g, part in enumerate(members) for i, j in enumerate(part))
        expect([j for j, _, _ in nodes] == list(range(n)), f"the stacks of shard {p} do not share out its nodes")
        of, places = (packed("q", (node[k] for node in nodes)) for k in (1, 2))
    starts = [packed("q", accumulate((stacks[g][1][kind].dim for g in of), initial=0)) for kind in range(3)]
    return Layout(of, places, starts)


@dataclass
class Shard:
    """A shard with its halo.

    Column c of its links is an input of node `owners[c]`: those of the shard, then those of the halo.  `firsts` is the
    first column of each of these nodes, `heard` its cone.  `away`: the inputs of the halo by shard and place.
    """

    net: Shards
    p: int
    layout: Layout
    blocks: dict[str, Numbers]
    links: tuple[Numbers, Numbers, Numbers]
    owners: Numbers
    firsts: Numbers
    heard: list[Faced]
    away: dict[int, Numbers]


def away_from(net: Shards, p: int, only: int | None = None) -> Iterator[tuple[int, Layout, list[tuple[int, range]]]]:
    """The halo of a shard, by shard, or in one: its layout, and the place of every node with those of its inputs."""
    halo = net.read(p, "halo", "iq", [index(*net.files(p)["halo"]["shape"])])
    expect(all(a < b for a, b in pairwise(halo)), f"the halo of shard {p} is not in order")
    expect(all(0 <= j < net.nodes() for j in halo), f"the halo of shard {p} has nodes that are not there")
    for k, nodes in groupby(halo, lambda j: bisect(net.starts[0], j) - 1):
        expect(k != p, f"the halo of shard {p} has nodes of its own")
        if only in (None, k):
            there, places = layout(net, k), (node - net.starts[0][k] for node in nodes)
            yield k, there, [(j, range(*there.starts[1][j : j + 2])) for j in places]


def shard_with_halo(net: Shards, p: int) -> Shard:
    """A shard from its files, and from those that say where the inputs of the halo are."""
    own, stacks, blocks = layout(net, p), net.stacks(p), dict[str, Numbers]()
    for g, (size, cones) in enumerate(stacks):
        for name in [name for name in "ABCD" if f"{name}{g}" in net.files(p)]:
            shape = [cones[kind].dim for kind in SIGNALS[name]]
            blocks[f"{name}{g}"] = net.read(p, f"{name}{g}", "d", [size, *shape], [1, *shape])
    owners = packed("q", (j for j, (a, b) in enumerate(pairwise(own.starts[1])) for _ in range(a, b)))
    firsts, away = own.starts[1][:], dict[int, Numbers]()
    firsts.pop()
    heard = [stacks[g][1][1] for g in own.stacks]
    for k, there, nodes in away_from(net, p):
        stacks, away[k] = net.stacks(k), packed("q")
        for j, places in nodes:
            firsts.append(len(owners))
            owners.extend([len(heard)] * len(places))
            heard.append(stacks[there.stacks[j]][1][1])
            away[k].extend(places)
    ends = net.read(p, "indptr", "iq", [count(net, p, 3) + 1])
    expect(ends[0] == 0 and all(a <= b for a, b in pairwise(ends)), f"the links of shard {p} are not in order")
    targets, values = net.read(p, "targets", "iq", [max(ends)]), {"weights": net.read(p, "weights", "d", [max(ends)])}
    expect(all(0 <= c < len(owners) for c in targets), f"links of shard {p} lead nowhere")
    rows = (targets[a:b] for a, b in pairwise(ends))
    expect(all(c < d for row in rows for c, d in pairwise(row)), f"links of shard {p} are not in order")
    for kind, entry in net.data["shards"][p].get("exact", {}).items():
        path = net.folder / f"shard-{p:05d}" / f"exact-{kind}.json"
        beside_doubles(path, entry, {"nodes": blocks, "links": values}[kind])
    return Shard(net, p, own, blocks, (ends, targets, values["weights"]), owners, firsts, heard, away)


def unit_of(*arrays: Numbers) -> int:
    """The least power of two that makes integers of doubles."""
    return max((x.as_integer_ratio()[1] for part in arrays for x in part), default=1)


def multiplied(unit: int, x: float) -> Any:
    """A double times such a number."""
    a, b = x.as_integer_ratio()
    return a * (unit // b)


def at_places(x: Numbers, places: range, convert: Callable[[float], Any]) -> Vector:
    """The vector of these entries."""
    return {i: convert(x[k]) for i, k in enumerate(places) if x[k]}


Heard = dict[int, tuple[int, int]]  # for an input: its column among the links, and its place in the cone of its node


def node_systems(s: Shard, closed: bool, rate: float = 0.0) -> Iterator[tuple[System, Heard]]:
    """The nodes of a shard with their links, each as a network: a node and its halo.  The inputs of the halo follow.

    In integers, as multiples of a unit; with numbers that are no doubles, or own links `closed`, in fractions.
    """
    net, (ends, targets, weights), (_, inputs, outputs) = s.net, s.links, s.layout.starts
    in_fractions = closed or "exact" in net.data["shards"][s.p]
    unit = 1 if in_fractions else unit_of([rate], weights, *s.blocks.values())
    convert: Callable[[float], Any] = Fraction if in_fractions else partial(multiplied, unit)
    stacks = net.stacks(s.p)
    for j, (g, i) in enumerate(zip(s.layout.stacks, s.layout.places, strict=True)):
        size, cones = stacks[g]
        X, U, Y = cones
        parts = dict[str, Matrix]()
        for name in "ABCD":
            m, n = (cones[kind].dim for kind in SIGNALS[name])
            M, first = s.blocks.get(f"{name}{g}"), i * m * n
            if M is not None:
                first = first if len(M) == size * m * n else 0
            parts[name] = [
                {} if M is None else at_places(M, range(first + k, first + m * n, n), convert) for k in range(n)
            ]
        W, heard, known = Matrix(), Heard(), dict[int, int]()
        for a, b in pairwise(ends[outputs[j] : outputs[j + 1] + 1]):
            W.append({})
            for c, w in zip(targets[a:b], weights[a:b], strict=True):
                own = s.owners[c] == j
                k = c - inputs[j] if own else known.setdefault(c, U.dim + len(known))
                heard[k] = c, c - s.firsts[s.owners[c]]
                if w:
                    W[-1][k] = convert(w)
        node = range(X.dim), range(U.dim), range(Y.dim)
        nodes = [node, (range(0), range(U.dim, U.dim + len(known)), range(0))]
        out = System(**parts, W=W, X=X, U=U, Y=Y, discrete=net.discrete, radius=[], nodes=nodes, unit=unit)
        yield own_links_closed(out) if closed and any(k < U.dim for w in W for k in w) else out, heard


def kept_inside(s: System, heard: Heard, shard: Shard) -> None:
    """A node is positive, and (I): its links map Y into the U of the nodes that they lead to; by facets h.

    h'B u, h'C x, h'D u, h'W y >= 0;  h'A x >= 0 where h'x = 0, in discrete time everywhere.
    """
    for name, (to, of) in SIGNALS.items():
        for x in s.cones()[of].rays:
            parts = dict[int, Vector]()
            for i, a in image(getattr(s, name), x).items():
                where = (shard.owners[heard[i][0]], heard[i][1]) if name == "W" else (0, i)
                parts.setdefault(where[0], {})[where[1]] = a
            for k, y in parts.items():
                target: Any = shard.heard[k] if name == "W" else s.cones()[to]
                faces = (h for h in target.faces if name != "A" or s.discrete or dot(h, x) == 0)
                need(all(dot(h, y) >= 0 for h in faces), f"{name} maps a cone into the other")


@dataclass
class InShards:
    """A certificate in shards: its folder, what its manifest states, and the network."""

    folder: Path
    data: Json
    net: Shards

    def vector(self, p: int, name: str, size: int = 0) -> Numbers:
        """v, r, q, p, t, x, u or y of a shard, in the order of its nodes; z of this size."""
        kinds = {key: kind for kind, keys in enumerate(("", "vx", "rtu", "qpy")) for key in keys}
        sizes = {"z": size, **{key: count(self.net, p, kind) for key, kind in kinds.items()}}
        out = numbers(place_of(self.folder, p, name), self.data["shards"][p]["files"][name], "d", [sizes[name]])
        need(all(map(isfinite, out)), f"{name} of shard {p} is finite")
        return out

    def at_inputs(self, s: Shard, name: str) -> Numbers:
        """r or t at the inputs of a shard and of its halo."""
        out = self.vector(s.p, name)
        for k, places in s.away.items():
            there = self.vector(k, name)
            out.extend([there[i] for i in places])
        return out


def has_weights(c: InShards) -> bool:
    """Whether p and t are there: then algebraic loops are proven to contract, at every node."""
    return any("p" in s.get("files", ()) for s in c.data["shards"])


def certificate_in_shards(folder: Path, network: Path | None) -> InShards:
    """The certificate in a folder, and the network that it is about, which may have been moved."""
    entries = {"network", "status", "refuted", "reason", "shards"}
    d, _ = manifest(folder, "kpos-shards-certificate/1", entries, {"growth", "whole"})
    grows, parts = "growth" in d, "growth" in d or (d["status"] == "PROVED" and "whole" not in d)
    expect(not grows or ("whole" not in d and d["status"] == "REFUTED"), "a state that grows refutes, and nothing else")
    alone = d["status"] == "REFUTED" and not grows and "whole" not in d
    expect(d["refuted"] is None or alone, "a shard is refuted where none is to be")
    expect(d["network"].keys() == {"folder", "digest"}, f"the manifest of {folder} names no network")
    net = shards_in(folder / d["network"]["folder"] if network is None else network)
    expect(digest(net.data) == d["network"]["digest"], f"{net.folder} is not the network of this certificate")
    expect(type(d["reason"]) is str, "the reason is no text")
    expect(len(listing(d["shards"])) == (len(net.data["shards"]) if parts else 0), "there are other shards")
    out = InShards(folder, d, net)
    names = {*("xuyz" if grows else "vrq"), *("pt" if has_weights(out) else "")}
    for p, s in enumerate(d["shards"]):
        filled = count(net, p, 0) > 0
        entries = {"files"} if grows else {"rate", "files"}
        expect(s.keys() == (entries if filled else set()), f"shard {p} has other entries")
        expect(not filled or s["files"].keys() == names, f"shard {p} has other vectors")
    return out


def proven_shard(c: InShards, p: int) -> float:
    """Theorem 4 for the nodes of a shard, with r and t at its halo; the rate that is proven for them.

    Positive nodes, (I) for the links that leave them, (II), (III') and the loops, as for `network` with sigma = 1.
    No sum in these is divided between shards, so that a network is proven if all of its shards are, with the least of
    their rates.  Links of nodes to themselves may be closed: that changes neither the closed loop nor other nodes.
    """
    rate = stated_double(c.data["shards"][p]["rate"])
    s, v, q = shard_with_halo(c.net, p), c.vector(p, "v"), c.vector(p, "q")
    vectors = {"v": v, "q": q, "r": c.at_inputs(s, "r")}
    if has_weights(c):
        vectors |= {"p": c.vector(p, "p"), "t": c.at_inputs(s, "t")}
    try:
        proven_nodes(s, vectors, rate, closed=False)
    except Wrong:
        proven_nodes(s, vectors, rate, closed=True)
    return rate


def proven_nodes(s: Shard, vectors: dict[str, Numbers], rate: float, *, closed: bool) -> None:
    """Every node, with its own part of the vectors, and that of the inputs that it feeds."""
    unit = unit_of(*vectors.values())
    convert = partial(multiplied, unit)
    for j, (node, heard) in enumerate(node_systems(s, closed, rate)):
        kept_inside(node, heard, s)
        states, inputs, outputs = (range(*ends[j : j + 2]) for ends in s.layout.starts)
        v, q = at_places(vectors["v"], states, convert), at_places(vectors["q"], outputs, convert)
        r = at_inputs(vectors["r"], inputs, heard, convert)
        loops_contract(node, vectors, (inputs, outputs), heard, convert)
        supplied(node, v, q, r)
        balance(node, q, r)
        decreases(node, v, q, Fraction(rate) if node.unit == 1 else multiplied(node.unit, rate))


def loops_contract(
    node: System, vectors: dict[str, Numbers], own: tuple[range, range], heard: Heard, convert: Callable[[float], Any]
) -> None:
    """The share of a node, with these inputs and outputs, in the proof that algebraic loops contract; or D = 0."""
    if "p" in vectors:
        t = at_inputs(vectors["t"], own[0], heard, convert)
        contracts(node, at_places(vectors["p"], own[1], convert), t)
    need("p" in vectors or not any(node.D), "there are weights for the algebraic loops")


def at_inputs(x: Numbers, own: range, heard: Heard, convert: Callable[[float], Any]) -> Vector:
    """The entries at the inputs of a node, and at those that it feeds."""
    return at_places(x, own, convert) | {k: convert(x[c]) for k, (c, _) in heard.items()}


def leaving(s: Shard, *, closed: bool) -> bool:
    """Some node is not positive, or some link leaves the cones."""
    try:
        for node, heard in node_systems(s, closed):
            kept_inside(node, heard, s)
    except Wrong:
        return True
    return False


def refuted_shards(c: InShards) -> str:
    """A node that is not positive or a link that leaves the cones, in the shard that is named, also if own links of
    nodes are closed; what is shown, in words.
    """
    p = index(c.data["refuted"])
    s = shard_with_halo(c.net, p)
    need(leaving(s, closed=False), f"no node or link of shard {p} leaves its cones")
    need(leaving(s, closed=True), f"shard {p} is positive once links of nodes to themselves are closed")
    return f"a node or a link of shard {p} leaves its cones"


def senders(net: Shards) -> tuple[list[int], list[list[tuple[int, range]]]]:
    """How long the z of every shard is; and for every shard those that feed it, with the entries of their z for it."""
    lengths, feeding = [], [list[tuple[int, range]]() for _ in net.data["shards"]]
    for s in range(len(feeding)):
        end = 0
        for k, _, nodes in away_from(net, s) if count(net, s, 0) else ():
            first, end = end, end + sum(len(places) for _, places in nodes)
            feeding[k].append((s, range(first, end)))
        lengths.append(end)
    return lengths, feeding


def growing_shard(c: InShards, p: int, lengths: list[int], feeding: list[tuple[int, range]]) -> bool:
    """A part of a network grows with the whole, as in `grows`; whether x is not zero in it.

    What an input receives comes from several shards.  Each shows z <= W y at the inputs that it feeds elsewhere, in the
    order of U, and of its own inputs that u <= W y + the sum of the z of all that feed it.
    """
    s, z = shard_with_halo(c.net, p), list[tuple[int, float]]()
    for k, entries in feeding:
        at = [i for _, _, nodes in away_from(c.net, k, only=p) for _, places in nodes for i in places]
        sent = c.vector(k, "z", lengths[k])
        z += zip(at, (sent[i] for i in entries), strict=True)
    vectors = {name: c.vector(p, name) for name in "xuy"}
    vectors["u"].extend(c.vector(p, "z", lengths[p]))
    if has_weights(c):
        vectors |= {"p": c.vector(p, "p"), "t": c.at_inputs(s, "t")}
    try:
        growing_nodes(s, vectors, z, growth_rate(c), closed=False)
    except Wrong:
        growing_nodes(s, vectors, z, growth_rate(c), closed=True)
    return any(vectors["x"])


def growth_rate(c: InShards) -> float:
    """The rate that is stated, at which nothing decays."""
    rate = stated_double(c.data["growth"])
    expect(rate >= c.net.discrete, "what grows by less than 1 a step decays")
    return rate


def growing_nodes(
    s: Shard, vectors: dict[str, Numbers], z: list[tuple[int, float]], rate: float, *, closed: bool
) -> None:
    """x and A x + B u - rate x in X, C x + D u - y in Y;  W y + z - u in U, where u goes on with the z of the shard."""
    unit, asked, unit_of_nodes = unit_of(*vectors.values(), [a for _, a in z]), vectors["u"], 1
    convert = partial(multiplied, unit)
    received: list[Any] = [0] * len(asked)
    for j, (node, heard) in enumerate(node_systems(s, closed, rate)):
        kept_inside(node, heard, s)
        states, inputs, outputs = (range(*ends[j : j + 2]) for ends in s.layout.starts)
        loops_contract(node, vectors, (inputs, outputs), heard, convert)
        x, y = at_places(vectors["x"], states, convert), at_places(vectors["y"], outputs, convert)
        u, unit_of_nodes = at_places(asked, inputs, convert), node.unit
        faces_pass(node.X, x, "x in X")
        factor = Fraction(rate) if node.unit == 1 else multiplied(node.unit, rate)
        moved = total((1, image(node.A, x)), (1, image(node.B, u)), (-factor, x))
        faces_pass(node.X, moved, "A x + B u - rate x in X")
        faces_pass(node.Y, total((1, image(node.C, x)), (1, image(node.D, u)), (-node.unit, y)), "C x + D u - y in Y")
        for i, a in image(node.W, y).items():
            received[heard[i][0]] += a
    for column, a in z:
        received[column] += unit_of_nodes * convert(a)
    for first, target in zip(s.firsts, s.heard, strict=True):
        spare = {i: received[first + i] - unit_of_nodes * convert(asked[first + i]) for i in range(target.dim)}
        faces_pass(target, spare, "W y + z - u in U")


def faces_pass(target: Any, x: Vector, what: str) -> None:
    """x is in a cone, by its facets."""
    need(all(dot(h, x) >= 0 for h in target.faces), what)


def growing_shards(c: InShards, shard: int | None, chosen: list[int]) -> str:
    """A state that grows in the chosen shards; what is shown, in words."""
    lengths, feeding = senders(c.net)
    alive = [growing_shard(c, p, lengths, feeding[p]) for p in chosen]
    rate = growth_rate(c)
    if shard is None:
        need(any(alive), "the state that is to grow is not zero")
        return f"a state of the network of {c.net.nodes()} nodes grows, rate {rate}"
    one = f"shard {shard} of {len(feeding)}, growth rate {rate}"
    return f"{one}; the network grows if all shards show it, and x is not zero in one of them"


def in_one_piece(c: InShards) -> str:
    """A network that is small enough, by a file about all of it, which is not about supply rates that were chosen."""
    net, path, entry = c.net, c.folder / "whole.json", c.data["whole"]
    nodes, *sizes = (starts[-1] for starts in net.starts)
    fractions = any("links" in s.get("exact", ()) for s in net.data["shards"])
    fits = nodes <= ONE_PIECE[0] and sum(sizes) <= ONE_PIECE[1]
    expect(fits and sizes[1] * sizes[2] * fractions <= ONE_PIECE[2], "the network is too large for one piece")
    expect(entry.keys() == {"sha256"} and path.is_file(), f"{path} is not described, or missing")
    expect(hashlib.sha256(path.read_bytes()).hexdigest() == entry["sha256"], f"{path} is another file")
    need(in_file(path) == (c.data["status"], "network"), "the file in one piece proves something else")
    f, length = parsed(path)
    witness = f["data"].get("witness")
    need(
        witness is None or witness["record"] not in ("NodeNotDissipative", "NoWeights"),
        "it is about supply rates that were chosen",
    )
    e = Said({**f["data"], "own_links_closed": None})
    dt = e["dt"] if e["dt"] is None or isinstance(e["dt"], int) else double(e["dt"])
    need(
        dt == (number(net.data["dt"]) if type(net.data["dt"]) is str else net.data["dt"]),
        "the file has the time of the network",
    )
    same_network(family("network", e, length + 20_000)[0], net, length + 20_000)
    return f"network of {nodes} nodes in one piece"


def same_network(whole: System, net: Shards, limit: int) -> None:
    """A network with the numbers, sizes and cones of the shards, node by node and link by link."""
    parts = [p for p in range(len(net.data["shards"])) if count(net, p, 0)]
    need(len(whole.nodes) == net.nodes(), "the file has the nodes of the network")
    for name, cone_of_all in zip("XUY", whole.cones(), strict=True):
        stacks = ((net.data["shards"][p]["stacks"], layout(net, p)) for p in parts)
        runs = [run for stack, at in stacks for g in at.stacks for run in net.data["cones"][stack[g][name]]]
        need(cone({"cone": runs}, limit).rays == cone_of_all.rays, "the file has the cones of the network")
    for p in parts:
        s, starts = shard_with_halo(net, p), [part[p] for part in net.starts]
        columns = [*range(starts[2], net.starts[2][p + 1])]
        columns += [net.starts[2][k] + i for k, places in s.away.items() for i in places]
        for j, (node, heard) in enumerate(node_systems(s, closed=False)):
            ends = zip(starts[1:], s.layout.starts, strict=True)
            own = tuple(range(first + at[j], first + at[j + 1]) for first, at in ends)
            need(whole.nodes[starts[0] + j] == own, "the file has the sizes of the nodes")
            for name, (to, of) in SIGNALS.items():
                at = {i: columns[k] for i, (k, _) in heard.items()} if name == "W" else own[to]
                for k, column in zip(own[of], getattr(node, name), strict=True):
                    stated = {at[i]: Fraction(a) / node.unit for i, a in column.items()}
                    need(getattr(whole, name)[k] == stated, f"the file has the {name} of the network")


def in_shards(folder: Path, shard: int | None, network: str | Path | None) -> tuple[str, str]:
    """The status that a certificate in shards proves, of all or of one of them, and what it says, in words."""
    c = certificate_in_shards(folder, None if network is None else Path(network))
    status, parts = c.data["status"], range(len(c.net.data["shards"]))
    expect(shard is None or shard in parts, f"there is no shard {shard}")
    expect(status in ("PROVED", "REFUTED", "UNDECIDED"), "the status is none")
    need(status != "UNDECIDED", "the certificate itself says UNDECIDED")
    chosen = [p for p in parts if shard in (None, p) and count(c.net, p, 0)]
    if "whole" in c.data:
        expect(shard is None, "what is proven in one piece has no parts")
        return status, in_one_piece(c)
    if status == "REFUTED":
        return status, growing_shards(c, shard, chosen) if "growth" in c.data else refuted_shards(c)
    rate = min((proven_shard(c, p) for p in chosen), default=float("inf"))
    texts: dict[int | None, str] = {None: f"network of {c.net.nodes()} nodes in {len(parts)} shards, decay rate {rate}"}
    one = f"shard {shard} of {len(parts)}, decay rate {rate}; the network is proven if all shards are"
    return status, texts.get(shard, one)


# -- files

PROOFS: dict[str, Callable[[System, Said], str | None]] = {
    "positive": positive,
    "stable": stable,
    "dissipative": dissipative,
    "disturbance gain": disturbance_gain,
    "structured gain": structured_gain,
    "common vector": common_vector,
    "invariant-cone": invariant,
    "differentially-positive": invariant,
    "network": network,
    "network abscissa": abscissa,
}
Refutations = dict[str, Callable[..., None]]
DIRECTIONS: Refutations = dict.fromkeys(["InstabilityDirection", "SlowDirection", "InstabilityCombination"], unstable)
PLANES: Refutations = dict.fromkeys(["PositivityViolation", "PlaneViolation"], crossed)
REFUTATIONS: dict[str, Refutations] = {
    "positive": PLANES,
    "differentially-positive": {"DifferentialViolation": crossed},
    "stable": PLANES | DIRECTIONS,
    "dissipative": PLANES | {"SupplyViolation": not_dissipative},
    "structured gain": PLANES | DIRECTIONS,
    "network": {
        "CouplingViolation": crossed,
        "NodeViolation": crossed,
        "NodeNotDissipative": not_dissipative,
        "NetworkInstability": grows,
        "AlgebraicLoop": closed_loop,
        "NoWeights": no_weights,
    },
}
NO_CONE: dict[str, Callable[[Said, Said, list[Matrix]], None]] = {
    "SpectralObstruction": eigenvalue,
    "PerronObstruction": cycle,
    "IndexObstruction": longer_chains,
    "PortObstruction": negative_product,
    "SeriesObstruction": negative_response,
    "ExponentialObstruction": touching_response,
}
ALONE: dict[tuple[str, str], Callable[[Said, int], None]] = {
    ("gain bound", "PROVED"): gain_bound,
    ("feedback", "PROVED"): feedback,
    ("out-weight", "PROVED"): any_size,
    ("out-weight", "REFUTED"): not_any_size,
    ("invariant-cone", "REFUTED"): no_cone,
    ("feedback exists", "REFUTED"): no_feedback,
    ("invariant gain exists", "REFUTED"): no_invariant_gain,
    ("bounded feedback exists", "REFUTED"): no_bounded_feedback,
    ("order interval", "PROVED"): order_interval,
    ("order interval", "REFUTED"): no_order_interval,
    ("interval observer", "PROVED"): interval_observer,
    ("network observer", "PROVED"): network_observer,
    ("network interval", "PROVED"): network_interval,
    ("network interval", "REFUTED"): no_network_interval,
    ("uncertain network", "PROVED"): uncertain_network,
    ("uncertain network", "REFUTED"): no_uncertain_network,
    ("differentially-positive network", "PROVED"): differentially_positive_network,
    ("differentially-positive network", "REFUTED"): order_violated,
    ("bounded network", "PROVED"): bounded_network,
    ("optimal cost", "PROVED"): optimal_cost,
    ("optimal cost", "REFUTED"): infinite_cost,
    ("finite-horizon cost", "PROVED"): finite_cost,
    ("common vector", "REFUTED"): no_common_vector,
    ("stable under switching", "REFUTED"): not_stable_under_switching,
    ("growth under switching", "PROVED"): growth_under_switching,
    ("mean stable", "PROVED"): mean_stable,
    ("mean stable", "REFUTED"): not_mean_stable,
    ("stabilising switching", "PROVED"): stabilising_switching,
    ("delayed", "PROVED"): stable_with_delays,
    ("delayed", "REFUTED"): not_stable_with_delays,
    ("delayed network", "PROVED"): delayed_network,
    ("delayed network", "REFUTED"): not_delayed_network,
    ("from data", "PROVED"): from_data,
    ("from data", "REFUTED"): not_from_data,
    ("compartmental", "PROVED"): drains,
    ("compartmental", "REFUTED"): never_drains,
    ("positive realization", "PROVED"): positive_realization,
    ("positive realization", "REFUTED"): no_positive_realization,
    ("dwell time", "PROVED"): dwells_long_enough,
    ("dwell time", "REFUTED"): too_short,
}


NETWORKS = (
    *("network", "network abscissa", "network interval", "network observer"),
    *("uncertain network", "bounded network"),
)
# Matrices that may be missing although the cones have sizes.
FREE = {"invariant-cone": "DW"} | dict.fromkeys(NETWORKS, "")
# Entries that mean something in some claims only.
BELONGS: dict[str, tuple[str, ...]] = dict.fromkeys(("W", "sizes", "own_links_closed"), NETWORKS)
BELONGS["own_links_closed"] = NETWORKS[:4]
BELONGS |= dict.fromkeys(("radii", "source"), ("differentially-positive",))
BELONGS["generator_proof"] = (
    *("positive", "stable", "dissipative", "structured gain"),
    *("order interval", "interval observer"),
)
PROOF = {*"PNLKM", *("normal", "z"), *(f"w{name}" for name in "xuyzsbWCmc")}
KEYS = {"format", "producer", "semantics", "digest", "claim", "status", "data", "proof"}


def verify(c: Json, limit: int) -> str:
    """Prove the claim of a file, in which no size is above the limit; what it rests on or leaves out, in words."""
    claim, status, proof = c["claim"], c["status"], c["proof"]
    need(status in ("PROVED", "REFUTED"), f"the file itself says {status}")
    if "omitted" in proof:
        raise Omitted(f"it leaves out its proof: {proof['omitted']}")
    expect(claim in PROOFS or claim in {name for name, _ in ALONE}, f"the claim {str(claim)[:40]} is unknown")
    need((claim, status) in ALONE or claim in (PROOFS if status == "PROVED" else REFUTATIONS), "nothing shows this")
    e = Said({name: proof[name] for name in PROOF & proof.keys()} | c["data"])
    e.seen |= PROOF - c["data"].keys()
    strange = [name for name, claims in BELONGS.items() if e.get(name) is not None and claim not in claims]
    expect(not strange, f"{', '.join(strange)} can say nothing here")
    if e["generator_proof"] is not None:  # then control_kpos had no facets either
        record(e, "generator_proof", "GeneratorProof")
    note = None
    if (claim, status) in ALONE:
        ALONE[claim, status](e, limit)
        note = "given the bounds on the Jacobians" if claim == "differentially-positive network" else None
    else:
        note = proved(claim, e, limit) if status == "PROVED" else refuted(claim, e, limit)
    left = unread(e, UNREAD)
    expect(not left, f"{', '.join(left)[:60]} can say nothing here")
    return note or ""


def proved(claim: str, e: Said, limit: int) -> str | None:
    """Every system of a family has the property."""
    note, single = None, "tuple" not in e["A"]
    systems = family(claim, e, limit)
    need(e.get("source") != "sampled", "what is known at points proves nothing between them")
    proofs = [e.get("P")] if single else e.get("P") or [None] * len(systems)
    for s, P in zip(systems, proofs, strict=True):
        e["P"] = P
        note = PROOFS[claim](s, e) or note
    return "given the bounds on the Jacobians" if "radii" in e else note


def refuted(claim: str, e: Said, limit: int) -> str:
    """The witness shows that one system of a family has not."""
    kind, w = record(e, "witness", *REFUTATIONS[claim])
    note = "given the bounds on the Jacobians" if "radii" in e else ""
    systems = family(claim, e, limit)
    s = systems[0]
    absent(e, "decay_rate", "nan")
    absent(e, "decay_rate_bound", "inf")
    asked = required_rate(e) if claim in ("stable", "network") else 0
    if e["q"] is not None:
        supply(s, e)
    if claim == "structured gain":
        blocks(s, e)
        absent(e, "lower", "nan")
        absent(e, "upper", "nan")
    if kind == "DifferentialViolation":
        s, note = jacobian(systems, w, note)
    if REFUTATIONS[claim][kind] is crossed:
        crossed(s, e, kind, w)
        return note
    positive(s, e)
    m, slowest = motion(s, kind, w), s.discrete - (asked if claim == "stable" else 0)
    slow = m.rate >= s.discrete or m.rate > slowest or (m.rate == slowest and bool(m.moved))
    need(slow, "the motion decays too fast")
    REFUTATIONS[claim][kind](s, e, m)
    return note


def jacobian(systems: list[System], w: Said, note: str) -> tuple[System, str]:
    """The Jacobians that a witness is about: one of the family, which rounds to `centre`, or those at a point."""
    n = systems[0].X.dim
    centre, radius = (entrywise(w[name], n) for name in ("centre", "radius"))
    if w["point"] is not None:
        expect(all(a >= 0 for column in radius for a in column.values()), "a radius is negative")
        entries(array(w["point"]), n)
        return replace(systems[0], A=centre, radius=radius), "given the bounds on the Jacobian at a point"
    places = list(pairs(range(n), range(n)))
    alike = [s for s in systems if all(float(s.A[j].get(i, 0)) == centre[j].get(i, 0) for i, j in places)]
    alike = [s for s in alike if not any(s.radius) and not any(radius)]
    need(bool(alike), "the Jacobian is one of the family")
    return alike[0], note


def family(claim: str, e: Said, limit: int) -> list[System]:
    """The systems that the data are about: one, or those of a family."""
    expect(e.get("source", "vertices") in ("vertices", "enclosed", "sampled"), "the source is unknown")
    cones = [cone(e.get(name), limit) for name in "XUY"]
    if claim in NETWORKS:
        repeated(e, cones, limit)
    members = sequence(e["A"]) if "tuple" in e["A"] else [e["A"]]
    radii = sequence(e["radii"]) if "radii" in e else [None] * len(members)
    expect(len(members) > 0 and ("radii" not in e or None not in radii), "there is no matrix, or no radius")
    free = FREE.get(claim, "W")
    out = [system(e, A, radius, cones, free) for A, radius in zip(members, radii, strict=True)]
    expect("radii" not in e or any(any(s.radius) for s in out), "no radius says anything")
    return out


def unique(pairs: list[tuple[str, Json]]) -> dict[str, Json]:
    """An object in which no key occurs twice."""
    expect(len(dict(pairs)) == len(pairs), "a key occurs twice")
    return dict(pairs)


def whole(text: str) -> int:
    """A JSON integer of at most 20 characters; no other number is allowed outside of text."""
    expect(len(text) < 21, "an integer is too long")
    return int(text)


def parsed(path: Path) -> tuple[Json, int]:
    """The JSON data in a file, and how long they are."""
    expect(path.is_file(), f"{path.name} is not a regular file, or does not exist")
    text = path.read_text(encoding="utf-8")
    c = json.loads(text, parse_float=whole, parse_constant=whole, parse_int=whole, object_pairs_hook=unique)
    json.dumps(c, ensure_ascii=False).encode()  # refuses halves of pairs of characters, which nobody could print
    return c, len(text)


def digest(data: Json) -> str:
    """SHA-256 of the data as JSON with sorted keys and without blanks."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return "sha256:" + hashlib.sha256(text.encode()).hexdigest()


def in_file(path: Path) -> tuple[str, str]:
    """The status that a file proves, and of what, in words."""
    expect(path.is_file(), "it is not a regular file, or does not exist")
    with path.open("rb") as file:
        zipped = file.read(2) == b"PK"
    expect(not zipped, "an archive (.npz); python -m control_kpos check reads it, or save the certificate as .json")
    c, length = parsed(path)
    expect(c["format"] == "kpos-certificate/1" and c.keys() <= KEYS, "of another format")
    expect(c["digest"] == digest(c["data"]), "the data have not the stated digest")
    note = verify(c, length + 20_000)
    return c["status"], c["claim"] + (note and f" ({note})")


def main(path: str | Path, shard: int | None = None, network: str | Path | None = None) -> int:
    """Say what a file or a folder proves, and return the exit status."""
    path = Path(path)
    try:
        status, claim = in_shards(path, shard, network) if path.is_dir() else in_file(path)
    except Wrong as reason:
        print(f"WRONG      {path}: not proven: {str(reason)[:200]}")
        return 1
    except Exception as reason:  # noqa: BLE001 - whatever a hostile file provokes
        print(f"UNREADABLE {path}: {type(reason).__name__}: {str(reason)[:200]}")
        return 2
    print(f"{status:10} {path}: {claim}")
    return 0 if status == "PROVED" else 1


if __name__ == "__main__":
    words = sys.argv[2:]
    said = dict(zip(words[::2], words[1::2], strict=False))
    shard = said.get("--shard", "0")
    if sys.argv[1:2] in ([], ["-h"], ["--help"]) or not (2 * len(said) == len(words) and shard.isdecimal()):
        words = ["?"]
    if {*words[::2]} - {"--shard", "--network"}:
        print(__doc__)
        sys.exit(2)
    sys.exit(main(sys.argv[1], int(shard) if "--shard" in said else None, said.get("--network")))
