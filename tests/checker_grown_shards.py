"""Certificates in shards by hand, of states that grow and in one piece: the case, a shard or None, the verdict."""

import copy
import hashlib
import json

from checker_cases import closed, flow, moved, surplus, with_nodes
from checker_cases import scalar as one_node
from shards_by_hand import (
    LINKS,
    PARTS,
    SKEW,
    alone,
    changed,
    coned,
    links,
    network,
    numbers,
    put,
    ring,
    scalar,
    shard,
    thirds,
    tight,
    wide,
)
from tampering import redigested

SPARE = 2.0**-20

# -- states that grow


def growing(case, proof, rate):
    proof = [{"arrays": {name: numbers(list(x)) for name, x in part.items()}} if part else {} for part in proof]
    return {**case, "status": "REFUTED", "proof": proof, "beside": {"growth": float(rate).hex()}}


def nodes_of(case, shards):
    """A, B and C of every node as lists of rows, and where these are in the arrays."""
    for part, entry in zip(shards, case["shards"], strict=True):
        for j, (n, m, q) in enumerate(part):
            g = sorted(set(part)).index((n, m, q))
            members = entry["arrays"].get(f"members{g}", {"values": range(len(part))})["values"]
            i = list(members).index(j)
            yield {
                name: (entry["arrays"][f"{name}{g}"]["values"], i * rows * columns, rows, columns)
                for name, rows, columns in (("A", n, n), ("B", n, m), ("C", q, n))
            }


def rows_of(values, first, rows, columns):
    return [values[first + k * columns : first + (k + 1) * columns] for k in range(rows)]


def grown(shards, weights, rate=1.0):
    """Nodes of several sizes that grow along x = 1 with nothing to spare: y = C x, u = W y, A x + B u = rate x."""
    case, nodes = tight(shards, weights), [node for part in shards for node in part]
    first = [[sum(node[kind] for node in nodes[:j]) for j in range(len(nodes) + 1)] for kind in range(3)]
    blocks = list(nodes_of(case, shards))
    y = [sum(row) for block in blocks for row in rows_of(*block["C"])]
    u = [sum(w * y[k] for (i, k), w in weights.items() if i == at) for at in range(first[1][-1])]
    for j, block in enumerate(blocks):
        values, start, n, _ = block["A"]
        for k, (row, inputs) in enumerate(zip(rows_of(*block["A"]), rows_of(*block["B"]), strict=True)):
            received = sum(b * a for b, a in zip(inputs, u[first[1][j] :], strict=False))
            values[start + k * n + k] = rate - received - sum(row) + row[k]
    owner, proof, start = [j for j, node in enumerate(nodes) for _ in range(node[1])], [], 0
    for part, entry in zip(shards, case["shards"], strict=True):
        own = range(start, start := start + len(part))
        halo = entry["arrays"]["halo"]["values"] if part else []
        sent = [
            sum(w * y[k] for (i, k), w in weights.items() if i == at and first[2][own.start] <= k < first[2][own.stop])
            for j in halo
            for at, of in enumerate(owner)
            if of == j
        ]
        ends = [slice(starts[own.start], starts[own.stop]) for starts in first]
        vectors = {"x": [1.0] * (ends[0].stop - ends[0].start), "u": u[ends[1]], "y": y[ends[2]], "z": sent}
        proof.append(vectors if part else {})
    return growing(case, proof, rate)


def spread(**more):
    return grown(PARTS, LINKS, **more)


def less(p, name, by, place=-1, base=spread):
    return changed(
        base(), lambda c: c["proof"][p]["arrays"][name]["values"].__setitem__(place, by(entry(c, p, name)[place]))
    )


def entry(case, p, name):
    return case["proof"][p]["arrays"][name]["values"]


def pair(*, A=-1.0, W=1.5, x=1.0, u=1.5, y=1.0, z=1.5, rate=0.5, dt=None, **node):
    """Two nodes in a ring, one in each shard, that grow with nothing to spare."""
    shards = [shard(1, **scalar(A=A, **node), **links([1], [W], halo=[1 - p])) for p in range(2)]
    vectors = {"x": [x], "u": [u], "y": [y], "z": [z]}
    return {**growing(network(shards, []), [vectors] * 2, rate), "dt": dt}


def direct(p=1.0, t=0.5, count=2, **more):
    """The same with feedthrough: y = x + u / 2, u = y."""
    case = pair(**{"W": 1.0, "u": 2.0, "y": 2.0, "z": 2.0, "rate": 1.0, "D": 0.5, **more})
    for part in case["proof"][:count]:
        part["arrays"] |= {"p": numbers([p]), "t": numbers([t])}
    return case


def by_itself(A=2.0, W=-1.0, rate=1.0):
    """A node with a link to itself, which is closed."""
    return growing(alone(A=A, W=W), [{"x": [1.0], "u": [0.0], "y": [1.0], "z": []}], rate)


def skew(x):
    return growing(coned(v=[1.0, 1.0], **{**SKEW, "A": [1.0, 0.0, 0.0, 1.0]}), [{"x": x, "u": [], "y": [], "z": []}], 1)


def third(u, rate=0.25):
    """A link of 10/3 to the second node, which receives no double above that."""
    case = thirds("weights", [[0, "10/3"]], 10 / 3, kind="links")
    case["shards"][0]["arrays"]["weights"] = numbers([10 / 3, 4.0, 4.0])
    return growing(case, [{"x": [1.0] * 3, "u": [4.0, u, 4.0], "y": [1.0] * 3, "z": []}], rate)


def stilled(case):
    for part in case["proof"]:
        for vector in part.get("arrays", {}).values():
            vector["values"] = [0.0] * len(vector["values"])
    return case


def exchanged(folder):
    one, two = (folder / f"proof/shard-{p:05d}/z.npy" for p in (0, 2))
    text = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(text)


GROWING = {
    "it grows": (spread(), None, "REFUTED"),
    "its first shard": (spread(), 0, "REFUTED"),
    "its empty shard": (spread(), 1, "REFUTED"),
    "its last shard": (spread(), 2, "REFUTED"),
    "a shard that is not there": (spread(), 3, "UNREADABLE"),
    "it grows faster": (put("beside", {"growth": (1.0 + 2**-52).hex()}, base=spread), None, "WRONG"),
    "it grows slower": (put("beside", {"growth": (0.5).hex()}, base=spread), None, "REFUTED"),
    "it stands still": (put("beside", {"growth": (0.0).hex()}, base=spread), None, "REFUTED"),
    "it decays": (put("beside", {"growth": (-0.5).hex()}, base=spread), None, "UNREADABLE"),
    "it grows by no number": (put("beside", {"growth": "nan"}, base=spread), None, "UNREADABLE"),
    "it grows in short": (put("beside", {"growth": "0x1p-1"}, base=spread), None, "UNREADABLE"),
    "z exchanged": (put("after", exchanged, base=spread), None, "UNREADABLE"),
    "z of a node less": (less(0, "z", lambda a: a - SPARE), 0, "REFUTED"),
    "z of a node less, heard": (less(0, "z", lambda a: a - SPARE), 2, "WRONG"),
    "z of a node more": (less(0, "z", lambda a: a + SPARE), 0, "WRONG"),
    "z of a node more, not seen": (less(0, "z", lambda a: a + SPARE), 2, "REFUTED"),
    "z without bound": (less(2, "z", lambda a: float("inf")), None, "WRONG"),
    "z without bound, heard": (less(2, "z", lambda a: float("inf")), 0, "WRONG"),
    "no z": (changed(spread(), lambda c: c["proof"][0]["arrays"].pop("z")), None, "UNREADABLE"),
    "z too short": (changed(spread(), lambda c: c["proof"][0]["arrays"].update(z=numbers([0.0]))), None, "UNREADABLE"),
    "a rate of a shard": (changed(spread(), lambda c: c["proof"][0].update(rate="0x0.0p+0")), None, "UNREADABLE"),
    "v beside x": (changed(spread(), lambda c: c["proof"][0]["arrays"].update(v=numbers([1.0]))), None, "UNREADABLE"),
    "something of nothing": (changed(spread(), lambda c: c["proof"][1].update(rate="0x0.0p+0")), None, "UNREADABLE"),
    "a shard less": (changed(spread(), lambda c: c["proof"].pop()), None, "UNREADABLE"),
    "growth that proves": (put("status", "PROVED", base=spread), None, "UNREADABLE"),
    "growth that says nothing": (put("status", "UNDECIDED", base=spread), None, "UNREADABLE"),
    "growth beside a proof": ({**ring(), "beside": {"growth": (0.0).hex()}}, None, "UNREADABLE"),
    "growth and a shard": (put("refuted", 0, base=spread), None, "UNREADABLE"),
    "growth and one piece": (
        changed(spread(), lambda c: c["beside"].update(whole={"sha256": "0"})),
        None,
        "UNREADABLE",
    ),
    "nothing grows": (stilled(spread()), None, "WRONG"),
    "nothing grows, a part": (stilled(spread()), 0, "REFUTED"),
    "only one part grows": (
        growing(pair(W=0.0, A=1.0), [{"x": [a], "u": [0.0], "y": [0.0], "z": [0.0]} for a in (1.0, 0.0)], 1.0),
        None,
        "REFUTED",
    ),
    "two in a ring": (pair(), None, "REFUTED"),
    "backwards": (pair(A=-2.0, W=0.0, x=-1.0, u=0.0, y=-1.0, z=0.0), None, "WRONG"),
    "not positive": (pair(A=0.5, W=-1.0, u=0.0, y=0.0, z=0.0), None, "WRONG"),
    "steps that stay": (pair(A=0.25, W=0.75, u=0.75, z=0.75, rate=1.0, dt=True), None, "REFUTED"),
    "steps that decay": (pair(A=0.25, W=0.75, u=0.75, z=0.75, rate=1.0 - 2**-53, dt=True), None, "UNREADABLE"),
    "through at once": (direct(), None, "REFUTED"),
    "through at once, y more": (direct(y=2.0 + 2**-51), None, "WRONG"),
    "through at once, t less": (direct(t=0.5 - 2**-54), None, "WRONG"),
    "through at once, no weights": (direct(count=0), None, "WRONG"),
    "through at once, weights of one": (direct(count=1), None, "UNREADABLE"),
    "by itself": (by_itself(), None, "REFUTED"),
    "by itself, faster": (by_itself(rate=1.0 + 2**-52), None, "WRONG"),
    "in a skew cone": (skew([1.0, 2.0]), None, "REFUTED"),
    "beside a skew cone": (skew([1.0, 0.5]), None, "WRONG"),
    "ten thirds": (third(10 / 3 - 2**-51), None, "REFUTED"),
    "more than ten thirds": (third(10 / 3), None, "WRONG"),
}
GROWING |= {
    f"{name} of {p} {'more' if sign > 0 else 'less'}": (less(p, name, lambda a, s=sign: a + s * SPARE), None, "WRONG")
    for name in "xuyz"
    for p in (0, 2)
    for sign in (1, -1)
}

# -- networks in one piece


def whole(case, content, **entry):
    """The certificate of a network in one file."""
    text = json.dumps(redigested({"format": "kpos-certificate/1", **content})).encode()
    entry = {"sha256": hashlib.sha256(text).hexdigest(), **entry}
    out = {**case, "status": content["status"], "refuted": None, "proof": [], "beside": {"whole": entry}}
    return {**out, "dt": out["dt"] or False, "after": lambda folder: (folder / "proof/whole.json").write_bytes(text)}


def sparse(M, m, n):
    """The matrix with these entries."""
    entries = [[i, k, x if isinstance(x, str) else float(x).hex()] for (i, k), x in M.items() if x]
    return {"sparse": entries, "shape": [m, n]}


def in_a_file(case, shards, weights, rate=1.0):
    """The proof of a network of several sizes in one file."""
    nodes, firsts = [node for part in shards for node in part], [0, 0, 0]
    entries = {name: {} for name in "ABC"}
    for node, block in zip(nodes, nodes_of(case, shards), strict=True):
        for name, (to, of) in {"A": (0, 0), "B": (0, 1), "C": (2, 0)}.items():
            for i, row in enumerate(rows_of(*block[name])):
                entries[name] |= {(firsts[to] + i, firsts[of] + k): x for k, x in enumerate(row)}
        firsts = [first + n for first, n in zip(firsts, node, strict=True)]
    n, m, q = firsts
    out = one_node("network", W=0, decay=rate.hex())
    shapes = {"A": (n, n), "B": (n, m), "C": (q, n)}
    out["data"] |= {name: sparse(entries[name], *shape) for name, shape in shapes.items()}
    out["data"] |= {"W": sparse(weights, m, q), "D": {"sparse": [], "shape": [q, m]}}
    for name in "vrq":
        parts = [part["arrays"][name]["values"] for part in case["proof"] if part]
        out["data"][name] = {"array": [float(x).hex() for part in parts for x in part]}
    return with_nodes(out, *nodes)


def altered(change, **more):
    """A file that is true about another network."""
    content = in_a_file(wide(), PARTS, LINKS)
    change(content["data"])
    return whole({**wide(), **more}, content)


def smaller(name):
    """One entry of a matrix is smaller; nothing that is proven needs it."""
    return altered(lambda d: d[name]["sparse"][-1].__setitem__(2, (number(d, name) - SPARE).hex()))


def number(d, name):
    return float.fromhex(d[name]["sparse"][-1][2])


STILL = one_node("network", "REFUTED", A=-1, W=1, **flow([1], [1], [1]))
SELF = alone(A=-1.0, W=1.0)
SUPPLY = one_node("network", "REFUTED", W=1, q=1, r=1, **surplus([1]))
OF_A_NODE = one_node("network", "REFUTED", A=-2, W=1, q=-3, r=1, **moved([1], [2], node=0))


def piece(content=STILL, case=SELF, **entry):
    return whole(copy.deepcopy(case), content, **entry)


def stepping(dt):
    """The same in discrete time, where it stays."""
    content = one_node("network", "REFUTED", A=0, W=1, discrete=True, **flow([1], [1], [1], 1))
    content["data"]["dt"] = dt
    return content


def steps(dt, of_file):
    return {**piece(stepping(of_file), alone(A=0.0, W=1.0)), "dt": dt}


def own_links():
    """A node with a link to itself, which is closed in the file only."""
    return piece(closed(-1, A=-1, q=0, r=1), alone(A=-1.0, W=-1.0))


def exact(case, name="weights"):
    """A link that is no double, in shards and in the file."""
    case["shards"][0]["texts"] = {"links": {name: [[0, "4/3"]]}}
    case["shards"][0]["arrays"][name]["values"][0] = 4 / 3
    return case


def with_a_third(W="4/3"):
    content = one_node("network", "REFUTED", A=-1, W=W, **flow([1], [1], [1]))
    return whole(exact(alone(A=-1.0, W=1.0)), content)


def too_many():
    content = in_a_file(tight(SEVEN, FED), SEVEN, FED)
    return whole(tight(SEVEN, FED), content)


SEVEN, FED = [[(1, 1, 1)] * 4, [(1, 1, 1)] * 3], {(1, 0): 1.0}
PIECE = in_a_file(wide(), PARTS, LINKS)
WHOLE = {
    "in one piece": (piece(), None, "REFUTED"),
    "in one piece, a shard": (piece(), 0, "UNREADABLE"),
    "many in one piece": (whole(wide(), PIECE), None, "PROVED"),
    "many, faster": (whole(wide(), in_a_file(wide(), PARTS, LINKS, 1.0 + 2**-52)), None, "WRONG"),
    "too many in one piece": (too_many(), None, "UNREADABLE"),
    "too many thirds": (whole(thirds("weights", [[0, "4/3"]], 4 / 3, kind="links"), STILL), None, "UNREADABLE"),
    "another status": ({**piece(), "status": "PROVED"}, None, "WRONG"),
    "undecided in one piece": ({**piece(), "status": "UNDECIDED"}, None, "WRONG"),
    "one piece and a shard": ({**piece(), "refuted": 0}, None, "UNREADABLE"),
    "one piece and vectors": (changed(piece(), lambda c: c["proof"].append({})), None, "UNREADABLE"),
    "another digest of one piece": (piece(sha256="0"), None, "UNREADABLE"),
    "more about one piece": (piece(more=1), None, "UNREADABLE"),
    "no file in one piece": ({**piece(), "after": None}, None, "UNREADABLE"),
    "another claim": (piece(one_node("stable")), None, "WRONG"),
    "supplies in one piece": (piece(SUPPLY, alone(W=1.0)), None, "WRONG"),
    "a supply of a node": (piece(OF_A_NODE, alone(W=1.0)), None, "WRONG"),
    "another A": (smaller("A"), None, "WRONG"),
    "another B": (smaller("B"), None, "WRONG"),
    "another C": (smaller("C"), None, "WRONG"),
    "another W": (smaller("W"), None, "WRONG"),
    "closed in the file": (own_links(), None, "PROVED"),
    "steps in one piece": (steps(True, 1), None, "REFUTED"),
    "steps of one": (steps((1.0).hex(), 1), None, "REFUTED"),
    "steps of a half": (steps((0.5).hex(), {"double": (0.5).hex()}), None, "REFUTED"),
    "steps of two": (steps((0.5).hex(), 1), None, "WRONG"),
    "time without a word": ({**piece(), "dt": None}, None, "WRONG"),
    "a link of four thirds": (with_a_third(), None, "REFUTED"),
    "a link next to four thirds": (with_a_third((4 / 3).hex()), None, "WRONG"),
    "another cone": ({**piece(), "cones": [[[1, {"rays": [[2]]}]]]}, None, "WRONG"),
}
CASES = GROWING | WHOLE
