"""Tiny certificates in shards by hand: folders of arrays, written with the standard library alone.

Each case changes one thing of a network of scalar nodes that is proven with nothing to spare.
"""

import copy
import hashlib
import json
import os
import struct

from checker_cases import HALF
from tampering import redigested

ORTHANT = HALF["cone"][0][1]
DIAMOND = [[1, {"rays": [[1, 1, 1], [-1, 1, 1], [1, -1, 1], [-1, -1, 1]], "w": [0, 0, 1], "Z": None}]]
DIAMOND[0][1]["Z"] = [["1/2", "1/2", "1/4"], ["-1/2", 0, "1/4"], [0, "-1/2", "1/4"], [0, 0, "1/4"]]


def numbers(values, *shape, kind="<f8"):
    return {"kind": kind, "shape": list(shape or (len(values),)), "values": values}


def whole(values, *shape):
    return numbers(values, *shape, kind="<i8")


def scalar(g=0, *, A=-2.0, B=1.0, C=1.0, D=0.0, count=1):
    """Matrices of scalar nodes that are alike."""
    parts = {f"{name}{g}": x for name, x in zip("ABCD", (A, B, C, D), strict=True)}
    return {name: numbers([x], 1, 1, 1) for name, x in parts.items() if x} if count else {}


def links(targets, weights=None, ends=None, halo=()):
    out = {"indptr": whole(ends or list(range(len(targets) + 1))), "targets": whole(targets), "halo": whole(list(halo))}
    return {**out, "weights": numbers(weights or [1.0] * len(targets))}


def shard(count, **arrays):
    return {"nodes": count, "stacks": [{"nodes": count, "X": 0, "U": 0, "Y": 0}], "arrays": arrays}


def ring(*, rate=1.0, v=1.0, r=1.0, q=-1.0, **node):
    """Two nodes in a ring, one in each shard; tight: v'A - q'C + rate v = 0, v'B = r, q + r'W = 0."""
    shards = [shard(1, **scalar(**node), **links([1], halo=[1 - p])) for p in range(2)]
    proof = [{"rate": rate.hex(), "arrays": {"v": numbers([v]), "r": numbers([r]), "q": numbers([q])}} for _ in shards]
    return network(shards, proof)


def network(shards, proof):
    out = {"dt": None, "cones": [[[1, ORTHANT]]], "shards": shards}
    return {**out, "status": "PROVED", "refuted": None, "reason": "", "proof": proof, "after": None}


# -- files


def save(path, array):
    """A .npy file, and what a manifest says of it."""
    kind = array["kind"]
    about = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {tuple(array['shape'])}, }}"
    data = array.get("head", b"\x93NUMPY\x01\x00v\x00" + about.ljust(117).encode() + b"\n")
    data += struct.pack(f"<{len(array['values'])}{ {'<f8': 'd', '<i4': 'i', '<i8': 'q'}[kind] }", *array["values"])
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return {"dtype": kind, "shape": array["shape"], "sha256": hashlib.sha256(data).hexdigest()} | array.get("entry", {})


def save_text(path, content):
    """Numbers that are no doubles, and what a manifest says of the file; bytes are added where it has a comment."""
    text = json.dumps(content).encode()
    path.write_bytes(text)
    return {"bytes": len(text), "sha256": hashlib.sha256(text).hexdigest()}


def saved(folder, shards):
    """The arrays of shards as files; what the manifest says of each shard."""
    out = []
    for p, part in enumerate(shards):
        entry = {key: x for key, x in part.items() if key not in ("arrays", "of", "texts")}
        if "arrays" in part:
            place = folder / f"shard-{p:05d}"
            entry["files"] = {name: save(place / f"{name}.npy", array) for name, array in part["arrays"].items()}
        if "texts" in part:
            place = folder / f"shard-{p:05d}"
            entry["exact"] = {kind: save_text(place / f"exact-{kind}.json", x) for kind, x in part["texts"].items()}
        out.append(entry | part.get("of", {}))
    return out


def manifest(folder, form, data):
    content = redigested({"format": form, "data": data})
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps(content))
    return content["digest"]


def write(folder, case):
    """The folder of the certificate, which is inside that of the network."""
    data = {"dt": case["dt"], "cones": case["cones"], "shards": saved(folder, case["shards"]), **case.get("more", {})}
    digest = manifest(folder, "kpos-shards/1", data)
    out = folder / "proof"
    shards = saved(out, case["proof"])
    about = {"folder": "..", "digest": digest, **case.get("about", {})}
    own = {name: case[name] for name in ("status", "refuted", "reason")}
    manifest(out, "kpos-shards-certificate/1", {"network": about, "shards": shards, **own, **case.get("beside", {})})
    if case["after"]:
        case["after"](folder)
    return out


# -- cases


def changed(case, change):
    out = copy.deepcopy(case)
    change(out)
    return out


def of(case, *path):
    for key in path:
        case = case[key]
    return case


def put(*path, base=ring, **more):
    """With another value at a path."""
    *inside, key, value = path
    return changed(base(**more), lambda case: of(case, *inside).__setitem__(key, value))


def without(*path, base=ring):
    *inside, key = path
    return changed(base(), lambda case: of(case, *inside).pop(key))


def array(p, name, field, value, base=ring, part="shards"):
    return put(part, p, "arrays", name, field, value, base=base)


def vector(name, value, **more):
    return array(1, name, "values", [value], part="proof", **more)


def after(change, base=ring):
    return put("after", change, base=base)


# -- nodes of several sizes, all on orthants


def tight(shards, weights, *, discrete=False, rate=1.0, spare=0.0, single=()):
    """A proven network with nothing to spare; `weights` of links from an output to an input, both among all.

    A node is (n, m, q): states, inputs and outputs.  Nodes of one size in a shard are a stack.  v = 1, r = B'v,
    q = -W'r, and A is such that v'A - q'C + rate v = 0 (`spare`: how much less).
    """
    nodes = [node for part in shards for node in part]
    first = [[sum(node[kind] for node in nodes[:j]) for j in range(len(nodes) + 1)] for kind in range(3)]
    B = [[[1.0 + (j + 2 * i + k) % 3 for k in range(m)] for i in range(n)] for j, (n, m, _) in enumerate(nodes)]
    C = [[[1.0 + (2 * j + i + k) % 2 for k in range(n)] for i in range(q)] for j, (n, _, q) in enumerate(nodes)]
    r = [sum(row[k] for row in part) for part in B for k in range(len(part[0]))]
    q = [-sum(w * r[i] for (i, k), w in weights.items() if k == y) for y in range(first[2][-1])]
    A = [part_a(node, C[j], q[first[2][j] :], j, discrete, rate, spare) for j, node in enumerate(nodes)]
    out, proof, start = [], [], 0
    for part in shards:
        own = range(start, start := start + len(part))
        files, proven = {}, {}
        sizes = sorted({nodes[j] for j in own})
        stacks = [{"nodes": sum(nodes[j] == size for j in own), **by_size(size)} for size in sizes]
        for g, size in enumerate(sizes):
            members = [j for j in own if nodes[j] == size]
            for name, M, (rows, columns) in (("A", A, (0, 0)), ("B", B, (0, 1)), ("C", C, (2, 0))):
                given = members[:1] if (name, g) in single else members
                values = [x for j in given for row in M[j] for x in row]
                files[f"{name}{g}"] = numbers(values, len(given), size[rows], size[columns])
            files |= {f"members{g}": whole([j - own.start for j in members])} if len(sizes) > 1 else {}
        if part:
            files |= links_of(own, nodes, first, weights)
            ends = [[first[kind][j] for j in (own.start, own.stop)] for kind in range(3)]
            proven = {"v": numbers([1.0] * (ends[0][1] - ends[0][0])), "r": numbers(r[ends[1][0] : ends[1][1]])}
            proven = {"rate": rate.hex(), "arrays": {**proven, "q": numbers(q[ends[2][0] : ends[2][1]])}}
        out.append({"nodes": len(part), "stacks": stacks, "arrays": files})
        proof.append(proven)
    cones = [[[n, ORTHANT]] for n in range(1, 4)]
    return {**network(out, proof), "cones": cones, "dt": "0x1.0000000000000p-1" if discrete else None}


def by_size(size):
    return {name: n - 1 for name, n in zip("XUY", size, strict=True)}


def part_a(node, C, q, j, discrete, rate, spare):
    n = node[0]
    A = [[float(i != k) * (j % 2) for k in range(n)] for i in range(n)]
    for k in range(n):
        supply = sum(q[i] * C[i][k] for i in range(node[2]))
        A[k][k] += discrete + supply - rate - spare - sum(A[i][k] for i in range(n))
    return A


def links_of(own, nodes, first, weights):
    """The links that leave the outputs of some nodes, to their own inputs and those of the halo."""
    owner = [j for j, node in enumerate(nodes) for _ in range(node[1])]
    halo = sorted({owner[i] for (i, k) in weights if first[2][own.start] <= k < first[2][own.stop]} - {*own})
    columns = [i for j in (*own, *halo) for i in range(first[1][j], first[1][j + 1])]
    targets, values, ends = [], [], [0]
    for y in range(first[2][own.start], first[2][own.stop]):
        row = sorted((columns.index(i), w) for (i, k), w in weights.items() if k == y)
        targets, values = targets + [c for c, _ in row], values + [w for _, w in row]
        ends.append(len(targets))
    return {**links(targets, values, ends, halo)}


PARTS = [[(1, 1, 2), (2, 2, 1), (1, 1, 2)], [], [(2, 2, 1), (2, 3, 1), (3, 1, 1)]]
# from outputs 0, 1 | 2 | 3, 4 || 5 | 6 | 7 to inputs 0 | 1, 2 | 3 || 4, 5 | 6, 7, 8 | 9
LINKS = {(1, 0): 2.0, (3, 1): 1.0, (5, 1): 3.0, (0, 2): 1.0, (9, 2): 0.5, (8, 3): 1.0, (4, 4): 2.0, (7, 4): 1.0}
LINKS |= {(3, 4): 0.5, (5, 5): 1.0, (2, 5): 1.0, (3, 5): 2.0, (9, 6): 1.0, (6, 7): 0.25, (0, 7): 1.0}


def wide(**more):
    return tight(PARTS, LINKS, **more)


# -- nodes one of a kind


def alone(*, A=-2.0, B=1.0, C=1.0, D=0.0, W=None, rate=2.0, v=1.0, r=1.0, q=0.0, dt=None, **loop):
    """One scalar node, with a link to itself."""
    part = shard(1, **scalar(A=A, B=B, C=C, D=D), **links([0] if W else [], [W] if W else None, [0, int(bool(W))]))
    vectors = {name: numbers([x]) for name, x in {"v": v, "r": r, "q": q, **loop}.items()}
    return {**network([part], [{"rate": rate.hex(), "arrays": vectors}]), "dt": dt}


def refuted(case, p=0, **more):
    return {**case, "status": "REFUTED", "refuted": p, "proof": [], **more}


def follower(W=-1.0, turn=1):
    """Two nodes in a shard: a link of the first to itself, and one of the second to the first; or (turn -1) the other
    way round."""
    at = [0, 1][::turn][0]
    part = shard(2, **scalar(A=-1.0), **links([at, at], [W, 1.0][::turn]))
    vectors = {"v": numbers([1.0, 2.0][::turn]), "r": numbers([1.0, 2.0][::turn]), "q": numbers([0.0, -1.0][::turn])}
    return network([part], [{"rate": (0.5).hex(), "arrays": vectors}])


def coned(rays, A, v, *, rate=1.0, **factor):
    """A node without inputs and outputs on a cone."""
    n = len(v)
    part = {"nodes": 1, "stacks": [{"nodes": 1, "X": 0, "U": 1, "Y": 1}]}
    part["arrays"] = {"A0": numbers(A, 1, n, n), **links([], None, [0])}
    vectors = {"v": numbers(v), "r": numbers([]), "q": numbers([])}
    cones = [[[1, {"rays": rays, **factor}]], []]
    return {**network([part], [{"rate": rate.hex(), "arrays": vectors}]), "cones": cones}


def many(n):
    """Nodes without inputs and outputs; their files have 656 bytes."""
    case = coned([[1]], [-1.0], [1.0])
    case["shards"][0].update(nodes=n, stacks=[{"nodes": n, "X": 0, "U": 1, "Y": 1}])
    case["proof"][0]["arrays"]["v"] = numbers([1.0] * n)
    return case


def three(A, rate=1.0, single="BC"):
    """Three nodes in a ring; of A one matrix or three."""
    arrays = {name: numbers([1.0], 1, 1, 1) for name in ("B0", "C0")}
    part = shard(3, A0=numbers(A, len(A), 1, 1), **arrays, **links([1, 2, 0]))
    vectors = {"v": numbers([1.0] * 3), "r": numbers([1.0] * 3), "q": numbers([-1.0] * 3)}
    return network([part], [{"rate": rate.hex(), "arrays": vectors}])


def thirds(name="A0", entries=((0, "-7/3"),), double=-7 / 3, *, rate=1 / 3, kind="nodes", **more):
    """Three nodes in a ring, with a number that is no double; rate and q as for A = -7/3, links of 4/3."""
    case = three([double, -3.0, -3.0])
    part, proof = case["shards"][0], case["proof"][0]
    part["arrays"]["weights"] = numbers([1.25] * 3)
    if name == "weights":
        part["arrays"] |= {"A0": numbers([-3.0] * 3, 3, 1, 1), "weights": numbers([double, 1.0, 1.25])}
    part["texts"] = {kind: {name: [list(pair) for pair in entries]}}
    proof["arrays"]["q"] = numbers([-1.25] * 3)
    proof["rate"] = float(rate).hex()
    part["of"] = more
    return case


def through(D=0.5, t=0.5, p=1.0, r=2.0, rate=2.0, count=2, **node):
    """A ring with feedthrough, nothing to spare."""
    case = ring(A=-4.0, D=D, v=1.0, r=r, q=-2.0, rate=rate, **node)
    for part in case["proof"][:count]:
        part["arrays"] |= {"p": numbers([p]), "t": numbers([t])}
    return case


def negative(case, name):
    case["shards"][1]["arrays"][name]["values"][0] *= -1


def twice(targets=(1, 1)):
    return {**scalar(), **links(list(targets), None, [0, 2], [0])}


HUGE = {"nodes": 10**15, "stacks": [{"nodes": 10**15, "X": 0, "U": 0, "Y": 0}]}
HEADLESS = (
    b"\x93NUMPY\x01\x00v\x00" + b"{'descr': '<f8', 'fortran_order': True, 'shape': (1, 1, 1), }".ljust(117) + b"\n"
)
SKEW = {"rays": [["1/2", "1/3"], [0, 1]], "A": [-1.0, 0.0, 0.0, -1.0]}
ROUND = {"rays": DIAMOND[0][1]["rays"], "w": DIAMOND[0][1]["w"], "Z": DIAMOND[0][1]["Z"], "v": [0.0, 0.0, 1.0]}
TURN = [-3.0, 1.0, 0.0, -1.0, -3.0, 0.0, 0.0, 0.0, -1.0]  # x turns towards y while both decay


def rewritten(path, change):
    def apply(folder):
        place = folder / path
        content = json.loads(place.read_text())
        place.write_text(json.dumps(change(content)))

    return after(apply)


def lacking(path, key):
    """Without an entry of a manifest, and with the digest that belongs to the rest."""

    def change(content):
        return redigested({**content, "data": {name: x for name, x in content["data"].items() if name != key}})

    return rewritten(path, change)


def stated(p, name, part="shards", base=ring, **entry):
    return put(part, p, "arrays", name, "entry", entry, base=base)


def data(name, p=1):
    return f"shard-{p:05d}/{name}.npy"


def appended(folder):
    with open(folder / data("A0"), "ab") as file:
        file.write(bytes(8))


def piped(folder):
    (folder / data("A0")).unlink()
    os.mkfifo(folder / data("A0"))


def endless(folder):
    (folder / data("A0")).unlink()
    (folder / data("A0")).symlink_to("/dev/zero")


def swapped(folder):
    one, two = (folder / data("A0", p) for p in (1, 2))
    two.parent.mkdir()
    one.rename(two)
