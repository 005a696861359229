# fmt: off
"""Check a certificate of the format kpos-certificate/1 in rational arithmetic: python checker.py FILE.

One file, Python's standard library, no rounding, nothing of control_kpos.  See docs/certificate_format.md.
Exit status 0: PROVED.  1: REFUTED, undecided, or not proven by the file.  2: unreadable, or without a proof.
"""
# ruff: noqa: D103, E401, I001, RET503, T201
import hashlib, json, pathlib, re, sys
from fractions import Fraction
from types import SimpleNamespace
TEXT = re.compile(r"-?(\d{1,4000}(\.\d{1,4000}|/\d{1,4000})?|0x[0-9a-f]{1,200000}(/0x[0-9a-f]{1,200000})?)")
MAPS = {"A": ("X", "X", "P"), "B": ("U", "X", "N"), "C": ("X", "Y", "L"), "D": ("U", "Y", "K"), "W": ("Y", "U", "M")}
class Wrong(Exception):  # noqa: N818
    """The file does not prove what it says.  Whatever else is raised means that it cannot be read."""
def need(fact, what, kind: type = Wrong):
    if not fact:
        raise kind(what)

# -- a vector is {index: number}, a matrix {column: vector}, a cone the matrix of its generators
def number(t):
    double = re.fullmatch(r"(-?0x[0-9a-f]{1,9})\.?([0-9a-f]{0,30})p([+-]\d{1,4})", t) if isinstance(t, str) else None
    if double:
        return int(double[1] + double[2], 16) * Fraction(2) ** (int(double[3]) - 4 * len(double[2]))
    need(type(t) is int or TEXT.fullmatch(t), f"{str(t)[:40]} is not a number", ValueError)
    top, _, bottom = str(t).partition("/")
    return Fraction(int(top, 16), int(bottom or "1", 16)) if "x" in top else Fraction(t)
def vector(o, n, exact=None):  # `exact` are the numbers that o rounds, if there are any
    numbers = list(map(number, exact["fractions"] if exact else o["array"]))
    need(len(numbers) == n, f"a vector has {len(numbers)} entries instead of {n}", ValueError)
    return {i: x for i, x in enumerate(numbers) if x}
def matrix(o, m, n):
    rows, out = o.get("matrix", []), {}
    shape = o["shape"] if "sparse" in o else [len(rows), len(rows[0]) if rows else n]
    need(shape == [m, n] and len(set(map(len, rows))) < 2, f"a matrix is not {m} x {n}", ValueError)
    for i, j, x in o["sparse"] if "sparse" in o else ((i, j, x) for i, y in enumerate(rows) for j, x in enumerate(y)):
        need(type(i) is type(j) is int and 0 <= i < m and 0 <= j < n, "an entry out of range", ValueError)
        need(i not in out.setdefault(j, {}), "an entry twice", ValueError)
        out[j][i] = number(x)
    return out
def plus(*terms):  # sum of c x over pairs (c, x), without zeros
    out = {}
    for c, x in terms:
        for i, a in x.items():
            out[i] = out.get(i, 0) + c * a
    return {i: a for i, a in out.items() if a}
def mul(M, x):
    return plus(*((c, M[j]) for j, c in x.items() if j in M))
def dot(x, y):
    return sum((x[i] * y[i] for i in min(x, y, key=len) if i in x and i in y), Fraction(0))

# -- cones
def cone(runs, limit):  # the product of cones, each `count` times; pointed because w'x > 0, solid because R Z = I
    product, size = {}, 0
    for count, f in runs:
        p, n = len(f["rays"]), len(f["w"])
        R = {j: {} for j in range(p)} | matrix({"matrix": list(zip(*f["rays"], strict=True))}, n, p)
        w, Z = vector({"array": f["w"]}, n), matrix({"matrix": f["Z"]}, p, n)
        need(all(dot(w, x) > 0 for x in R.values()) and all(mul(R, Z[i]) == {i: 1} for i in range(n)), "a proper cone")
        need(type(count) is int and 0 < count * n <= limit - size, "a size is absurd for this file", ValueError)
        for _ in range(count):
            product.update({len(product) + j: {size + i: a for i, a in x.items() if a} for j, x in R.items()})
            size += n
    return product, size
def member(R, y, w, what, free=None):  # y = R w, w >= 0 except w[free] (without w: w = y): then y is in the cone R
    w = y if w is None else w
    need(all(c >= 0 or k == free for k, c in w.items()) and mul(R, w) == y, f"{what} in its cone")

# -- Theorem 1
def system(d, limit):
    need(d["discrete"] in (True, False), "discrete is neither true nor false", ValueError)
    s = SimpleNamespace(n={}, discrete=d["discrete"])
    for k in "XUY":
        vars(s)[k], s.n[k] = cone(d[k]["cone"], limit) if d.get(k) else ({}, 0)
    for k, (source, target, _) in MAPS.items():
        vars(s)[k] = matrix(d[k], s.n[target], s.n[source]) if d.get(k) else {}
    return s
def positive(s, proof):  # every matrix maps the cone of its inputs into that of its outputs
    for k, (source, target, name) in MAPS.items():
        R, S, M = vars(s)[target], vars(s)[source], vars(s)[k]
        W = matrix(proof[name], len(R), len(S)) if proof.get(name) else None
        for i, x in S.items():
            free = i if k == "A" and not s.discrete else None
            member(R, mul(M, x), None if W is None else W.get(i, {}), f"{k} times generator {i}", free)
def violated(s, proof):  # h in the dual cone, a generator x, h'M x < 0; for A in continuous time also h'x = 0
    source, target, _ = MAPS[proof["matrix"]]
    h, x = matrix(proof["normal"], s.n[target], 1)[0], vars(s)[source][proof["ray"]]
    need(all(dot(h, y) >= 0 for y in vars(s)[target].values()), "the normal supports the cone")
    on_facet = proof["matrix"] != "A" or s.discrete or dot(h, x) == 0
    need(on_facet and dot(h, mul(vars(s)[proof["matrix"]], x)) < 0, f"{proof['matrix']} leaves the cone")

# -- Theorems 2 to 4
def decreasing(s, v, q, r, rate):  # v'x > 0, v'A x - q'C x < 0 and at most -rate v'x, v'B u <= r'u + q'D u
    for x in s.X.values():
        a, z = dot(v, x), dot(v, mul(s.A, x)) - s.discrete * dot(v, x) - dot(q, mul(s.C, x))
        need(a > 0 and z < 0 <= rate and z + rate * a <= 0, "v'x decreases at the stated rate")
    for u in s.U.values() if r is not None else ():
        need(dot(v, mul(s.B, u)) <= dot(r, u) + dot(q, mul(s.D, u)), "the supply covers the input")
def growing(s, claim, e, q, r):  # x in X with z = A x + B u - rate x in X, although the claim wants all to decay
    x, u, y = (vector(e[k], s.n[n]) if e.get(k) else {} for k, n in ("xX", "uU", "yY"))
    z, out = plus((1, mul(s.A, x)), (1, mul(s.B, u)), (-number(e["rate"]), x)), plus((1, mul(s.C, x)), (1, mul(s.D, u)))
    spare = plus((1, mul(s.W, y)), (-1, u)) if claim == "network" else u
    more = plus((1, out), (-1, y)) if y else {}
    for name, R, w in (("wx", s.X, x), ("wz", s.X, z), ("wu", s.U, spare), ("wy", s.Y, more)):
        member(R, w, matrix(e[name], len(R), 1).get(0, {}) if e.get(name) else None, name)
    supply = dot(q, out) + dot(r or {}, u)
    need(number(e["rate"]) >= s.discrete and (x or (claim == "dissipative" and (z or supply < 0))), "growth")
    need(claim == "network" or (supply <= 0 and (r is not None or not u)), "no supply for the witness")
def verify(c, limit):  # what the data say counts before what the proof says
    claim, proved, e = c["claim"], c["status"] == "PROVED", c["proof"] | c["data"]
    need(c["status"] in ("PROVED", "REFUTED"), f"the file itself says {c['status']}")
    need("omitted" not in e, f"it leaves out its proof: {e.get('omitted')}", ValueError)
    s = system(c["data"], limit)
    if "normal" in e:
        return need(not proved, "the claim") or violated(s, e)
    positive(s, e)
    keys = {"positive": "", "stable": "vX", "dissipative": "vX qY rU", "network": "VX QY RU pY tU"}[claim].split()
    given = {k.lower(): vector(e[k], s.n[n], e.get(k + "_exact")) for k, n in keys if e[k]}
    v, q, r, p, t = map(given.get, "vqrpt")
    if claim == "network" and any(any(x.values()) for x in s.D.values()):  # the algebraic loop u = W D u contracts
        need(all(dot(p, mul(s.D, u)) <= dot(t, u) for u in s.U.values()), "p'D <= t'")
        need(all(dot(t, mul(s.W, y)) < dot(p, y) > 0 for y in s.Y.values()), "t'W < p'")
    if claim == "positive" or not proved:
        return need(proved, "the claim") if claim == "positive" else growing(s, claim, e, q or {}, r)
    decreasing(s, v, q or {}, r, number(e["decay_rate"]["double"]))
    need(claim != "network" or all(dot(q, y) + dot(r, mul(s.W, y)) <= 0 for y in s.Y.values()), "the nodes balance")

# -- files
def refuse(text):
    raise ValueError(f"{text[:40]} is not allowed in a certificate")
def unique(pairs):
    return dict(pairs) if len(dict(pairs)) == len(pairs) else refuse("a key that occurs twice")
def check(text):
    c = json.loads(text, parse_float=refuse, parse_constant=refuse, object_pairs_hook=unique,
                   parse_int=lambda t: int(t) if len(t) < 21 else refuse(t))
    need(c["format"] == "kpos-certificate/1", "of another format", ValueError)
    data = json.dumps(c["data"], sort_keys=True, separators=(",", ":"))
    need(c["digest"] == "sha256:" + hashlib.sha256(data.encode()).hexdigest(), "the data have the stated digest")
    verify(c, len(text) + 10**5)
    return c["status"], c["claim"]
def main(path):
    try:
        status, claim = check(pathlib.Path(path).read_text(encoding="utf-8"))
    except Wrong as reason:
        return print(f"WRONG      {path}: not proven: {reason}") or 1
    except Exception as x:  # noqa: BLE001 - whatever a hostile file provokes
        return print(f"UNREADABLE {path}: {type(x).__name__}: {str(x)[:200]}") or 2
    return print(f"{status:10s} {path}: {claim}") or int(status != "PROVED")
if __name__ == "__main__":
    sys.exit(main(sys.argv[-1]))
