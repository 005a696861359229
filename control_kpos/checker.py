"""Check a certificate in the format kpos-certificate/1 (docs/certificate_format.md): python checker.py FILE.

Exact arithmetic; exit status 0: PROVED, 1: REFUTED, undecided or not proven, 2: unreadable or without a proof.
"""
import hashlib, json, pathlib, re, sys, types
from fractions import Fraction
HEX = re.compile(r"(-?0x[0-9a-f]{1,20000}(?![0-9a-f]))\.?([0-9a-f]{0,30})(?:p([+-]\d{1,4})|/0x([0-9a-f]{1,20000}))?")
DECIMAL = re.compile(r"-?\d{1,4000}(\.\d{1,4000}|/\d{1,4000})?")
MAPS = {"A": ("X", "X", "P"), "B": ("U", "X", "N"), "C": ("X", "Y", "L"), "D": ("U", "Y", "K"), "W": ("Y", "U", "M")}
VECTORS = {"positive": "", "invariant-cone": "vX", "differentially-positive": "vX", "common vector": "vX",
           "stable": "vX", "dissipative": "vX qY rU", "disturbance gain": "vX qY rU", "network": "VX QY RU pY tU"}
REFUTED = {"network": {"growth": "pY tU", "motion": "qY rU", "loop": "", "weights": "qY rU"},
           "stable": {"motion": ""}, "dissipative": {"motion": "qY rU"}, "positive": {}, "differentially-positive": {}}
Wrong = type("Wrong", (Exception,), {"__doc__": "Not proven by the file.  All else that is raised: not readable."})
def need(fact, what, kind: type = Wrong):
    if not fact:
        raise kind(what)
# -- a vector is {index: number}, a matrix {column: vector}, a cone the matrix of its generators
def number(t):
    if x := HEX.fullmatch(str(t)):
        return int(x[1] + x[2], 16) * Fraction(2) ** (int(x[3] or 0) - 4 * len(x[2])) / int(x[4] or "1", 16)
    need(type(t) is int or DECIMAL.fullmatch(t), f"{str(t)[:40]} is not a number", ValueError)
    return Fraction(t)
def flat(o):  # the numbers in lists of lists, {"array": ...}, {"double": ...}, {"fractions": ...}, {"tuple": ...}
    o = [*o.values()] if isinstance(o, dict) else o
    return [x for part in o for x in flat(part)] if isinstance(o, list) else [o if type(o) is int else number(o)]
def vector(o, n):
    numbers = flat(o)
    need(len(numbers) == n, f"a vector has {len(numbers)} entries instead of {n}", ValueError)
    return {i: x for i, x in enumerate(numbers) if x}
def matrix(o, m, n):
    rows, out = o.get("matrix"), {}
    fits = o["shape"] == [m, n] if rows is None else len(rows) == m and all(len(row) == n for row in rows)
    need(fits, f"a matrix is not {m} x {n}", ValueError)
    for i, j, x in o["sparse"] if rows is None else ((i, j, x) for i, y in enumerate(rows) for j, x in enumerate(y)):
        need(type(i) is type(j) is int and 0 <= i < m and 0 <= j < n, "an entry out of range", ValueError)
        need(i not in out.setdefault(j, {}), "an entry twice", ValueError)
        out[j][i] = number(x)
    return {j: {i: a for i, a in column.items() if a} for j, column in out.items()}
def plus(*terms):  # the sum of c x over pairs (c, x) and of c M x over triples (c, M, x), without zeros
    out = {}
    for c, *M, x in terms:
        for j, b in x.items():
            for i, a in M[0].get(j, {}).items() if M else ((j, 1),):
                out[i] = out.get(i, 0) + c * a * b
    return {i: a for i, a in out.items() if a}
def on(S, *terms):  # for every generator x: the sum of c f'x over pairs (c, f) and of c f'M x over triples (c, f, M)
    rows = ([(c, f, plus((1, *M, x))) for c, f, *M in terms] for x in S.values())
    return [sum((c * f[i] * a for c, f, y in row for i, a in y.items() if i in f), Fraction(0)) for row in rows]
def cone(runs, limit):  # the product of cones, each `count` times; pointed because w'x > 0, solid because R Z = I
    product, size = {}, 0
    for count, f in runs:
        p, n = len(f["rays"]), len(f["w"])
        R, Z = matrix({"matrix": list(zip(*f["rays"], strict=True))}, n, p), matrix({"matrix": f["Z"]}, p, n)
        need(min(on(R, (1, vector(f["w"], n)))) > 0, "a pointed cone")
        need(all(plus((1, R, Z[i])) == {i: 1} for i in range(n)), "a solid cone")
        need(type(count) is int and 0 < count * n <= limit - size, "a size is absurd for this file", ValueError)
        for _ in range(count):
            product.update({len(product) + j: {size + i: a for i, a in x.items()} for j, x in R.items()})
            size += n
    return product, size
def into(R, M, S, W, what, free=False):  # M maps the cone S into R: M S = R W, W >= 0 except W[i][i] if free
    W = W and matrix(W, len(R), len(S))
    for i, x in S.items():
        y = plus((1, M, x))
        w = y if W is None else W.get(i, {})  # a vector of an orthant is its own weights
        need(all(a >= 0 or (free and k == i) for k, a in w.items()) and plus((1, R, w)) == y, f"{what} in its cone")
def system(d, A, cones):
    s = types.SimpleNamespace(**{k: R for k, (R, _) in cones.items()}, discrete={False: 0, True: 1}[d["discrete"]])
    s.n = {k: n for k, (_, n) in cones.items()}
    for k, (source, target, _) in MAPS.items():
        vars(s)[k] = matrix(A if k == "A" else d[k], s.n[target], s.n[source]) if d.get(k) else {}
    return s
def crossed(s, e):  # h in the dual cone, a generator x, h'M x < 0; for A in continuous time also h'x = 0
    k, (source, target, _) = e["matrix"], MAPS[e["matrix"]]
    h, x = matrix(e["normal"], s.n[target], 1)[0], {0: vars(s)[source][e["ray"]]}
    need(min(on(vars(s)[target], (1, h))) >= 0 > on(x, (1, h, vars(s)[k]))[0], f"{k} crosses a supporting plane")
    need(k != "A" or s.discrete or on(x, (1, h)) == [0], "the generator lies on the plane")
def moving(s, shows, e, q, r):  # x, u, y against which no storage, or no weights of the nodes, help
    x, u, y = (vector(e[k], s.n[n]) if e.get(k) else {} for k, n in ("xX", "uU", "yY"))
    z, out = plus((1, s.A, x), (1, s.B, u), (-number(e["rate"]), x)), plus((1, s.C, x), (1, s.D, u))
    spare, supply = plus((1, s.W, y), (-1, u)), sum(on({0: out}, (1, q)) + on({0: u}, (1, r or {})))
    places = {"x": (s.X, x), "u": (s.U, u), "y": (s.Y, y), "z": (s.X, z), "W": (s.U, spare),
              "C": (s.Y, plus((1, out), (-1, y)))}
    names, fact = {
        "growth": ("xzWC", x),
        "loop": ("yWC", y and not x),
        "motion": ("xuz", (x or z or supply) and supply <= 0 and (r is not None or not u)),
        "weights": ("y", shows == "weights" and not u and idle(s, e, y, spare))}[shows]
    for k in names:
        into(places[k][0], {0: places[k][1]}, {0: {0: 1}}, e.get("w" + k), f"w{k}")
    need(fact and number(e["rate"]) >= s.discrete, "the witness")
def idle(s, e, y, u):  # q'y + r'u >= 0 at every node and > 0 at one
    ys, us = (iter([x.get(i, 0) for i in range(s.n[k])]) for k, x in (("Y", y), ("U", u)))
    nodes = zip(*(e[k].get("tuple") or e[k]["array"] for k in "qr"), strict=True)
    supply = [sum(a * next(ys) for a in flat(q)) + sum(a * next(us) for a in flat(r)) for q, r in nodes]
    return min(supply) >= 0 < max(supply)
def prove(s, claim, proved, e):
    if "normal" in e:
        return need(not proved and claim in REFUTED, "the claim") or crossed(s, e)
    for k, (source, target, name) in MAPS.items():  # Theorem 1
        into(vars(s)[target], vars(s)[k], vars(s)[source], e.get(name), k, free=k == "A" and not s.discrete)
    shows, vectors = (claim, VECTORS[claim]) if proved else (e["shows"], REFUTED[claim][e["shows"]])
    given = {k.lower(): vector(e.get(k + "_exact") or e[k], s.n[n]) for k, n in vectors.split() if e[k] or k in "qQR"}
    v, q, r, p, t = map(given.get, "vqrpt")
    if shows in ("network", "growth") and any(s.D.values()):  # the algebraic loop u = W D u contracts
        loop = zip(on(s.Y, (1, t, s.W), (-1, p)), on(s.Y, (1, p)))
        need(all(z < 0 < a for z, a in loop) and max(on(s.U, (1, p, s.D), (-1, t))) <= 0, "p'D <= t' and t'W < p'")
    need(v or not proved or claim in ("positive", "invariant-cone", "differentially-positive"), "v is there")
    if not v:
        return proved or moving(s, shows, e, q or {}, r)
    rate, drift = flat(e.get("decay_rate", 0))[0], on(s.X, (1, v, s.A), (-s.discrete, v), (-1, q or {}, s.C))
    need(all(a > 0 > z and z + rate * a <= 0 <= rate for a, z in zip(on(s.X, (1, v)), drift)), "v'x decreases")
    need(q is None or all(z <= 0 for z in on(s.U, (1, v, s.B), (-1, r), (-1, q, s.D))), "the supply covers the input")
    need(claim != "network" or all(z <= 0 for z in on(s.Y, (1, q), (1, r, s.W))), "the nodes balance")
def verify(c, limit):  # what the data say counts before what the proof says
    claim, proved, d, e = c["claim"], c["status"] == "PROVED", c["data"], c["proof"] | c["data"]
    need(c["status"] in ("PROVED", "REFUTED"), f"the file itself says {c['status']}")
    need("omitted" not in e, f"it leaves out its proof: {e.get('omitted')}", ValueError)
    if claim == "feedback":
        parts = [part["certificate"] for k in ("loops", "others") for part in d[k]["tuple"]]
        need(proved and parts and all(part["status"] == "PROVED" for part in parts), "all parts")
        return [verify(part, limit // len(parts)) for part in parts]
    if claim == "gain bound":
        (X, n), b = cone(d["X"]["cone"], limit), flat(d["bound"])
        sizes = (abs(a) <= b[i] for x in X.values() for i, a in plus((1, matrix(d["F"], len(b), n), x)).items())
        return need(proved and min(b) >= 0 and all(sizes), "|F x| <= bound")
    family = list(zip(d["A"]["tuple"], e["P"], strict=True)) if d["A"].get("tuple") else [(d["A"], e.get("P"))]
    cones = {k: cone(d[k]["cone"], limit) if d.get(k) else ({}, 0) for k in "XUY"}
    for A, P in family if proved else [family[e.get("member", 0)]]:
        prove(system(d, A, cones), claim, proved, e | {"P": P})
def unique(pairs):
    need(len(dict(pairs)) == len(pairs), "a key occurs twice", ValueError)
    return dict(pairs)
def main(path):
    try:
        text = pathlib.Path(path).read_text(encoding="utf-8")
        c = json.loads(text, parse_float=int, parse_constant=int,  # int refuses points, exponents and NaN
                       parse_int=lambda t: int(t if len(t) < 21 else "too long"), object_pairs_hook=unique)
        need(c["format"] == "kpos-certificate/1", "of another format", ValueError)
        data = json.dumps(c["data"], sort_keys=True, separators=(",", ":"))
        need(c["digest"] == "sha256:" + hashlib.sha256(data.encode()).hexdigest(), "the data have the stated digest")
        verify(c, len(text) + 20_000)
    except Exception as x:  # whatever a hostile file provokes
        word, status = ("WRONG", 1) if isinstance(x, Wrong) else ("UNREADABLE", 2)
        return print(f"{word:10s} {path}: {type(x).__name__}: {str(x)[:200]}") or status
    return print(f"{c['status']:10s} {path}: {c['claim']}") or int(c["status"] != "PROVED")
if __name__ == "__main__":
    sys.exit(main(sys.argv[-1]))
