"""Tiny certificate files by hand about families whose members follow each other, true and just not true."""

from checker_cases import changed, double, family

CORNERS = [[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]]
FOURTHS = [[f"{a}/4" for a in x] for x in CORNERS]
WEDGE = {"cone": [[1, {"rays": CORNERS, "w": [0, 0, 1], "Z": FOURTHS}]]}


def several(matrices, claim, status="REFUTED", *, discrete=False, **data):
    """Members on the half-line."""
    out = family(matrices, claim, discrete, "PROVED", v=None)
    out["data"].pop("v")
    return changed(out, **data) | {"status": status}


def no_vector(matrices, *vectors, **more):
    witness = {"record": "NoCommonVector", "fields": {"vectors": {"matrix": [[x] for x in vectors]}}}
    return several(matrices, "common vector", witness=witness, **more)


def mixture(matrices, *weights, x=1, **more):
    fields = {"x": {"array": [x]}, "weights": {"fractions": list(weights)}}
    return several(matrices, "stable under switching", witness={"record": "UnstableMixture", "fields": fields}, **more)


def turning(modes, factor, x=1):
    fields = {"x": {"array": [x]}, "modes": {"tuple": list(modes)}, "factor": {"fraction": factor}}
    return {"record": "CycleOfGrowth", "fields": fields}


def cycle(matrices, modes, factor, x=1, discrete=True):
    return several(matrices, "stable under switching", discrete=discrete, witness=turning(modes, factor, x))


def growth(matrices, most, vs=(1, 1), least=0, around=None, discrete=True, **more):
    data = {"growth": {"double": double(most)}, "least": {"double": double(least)}, "cycle": around}
    data["vs"] = {"matrix": [[v] for v in vs]}
    return several(matrices, "growth under switching", "PROVED", discrete=discrete, **data | more)


def pyramid(A, claim, status="REFUTED", *, P, discrete=False, proof=(), **data):
    """One member on the cone of four generators."""
    out = several([0], claim, status, discrete=discrete, **data)
    matrix = {"matrix": [[A * (i == j) for j in range(3)] for i in range(3)]}
    return changed(out, A={"tuple": [matrix]}, X=WEDGE) | {"proof": {"P": [{"matrix": P}], **dict(proof)}}


def diagonal(a):
    return [[a * (i == j) for j in range(4)] for i in range(4)]


def standing(wx=(1, 0, 0, 0), wz=(1, 0, 0, 0), P=1):
    """x' = x on the cone of four generators grows along the first."""
    fields = {"x": {"array": [1, 1, 1]}, "weights": {"fractions": [1]}}
    proof = {name: {"matrix": [[a] for a in column]} for name, column in (("wx", wx), ("wz", wz))}
    witness = {"record": "UnstableMixture", "fields": fields}
    return pyramid(1, "stable under switching", P=diagonal(P), proof=proof, witness=witness)


def unlike(weights):
    """x' = 0 on the cone of four generators has no v."""
    witness = {"record": "NoCommonVector", "fields": {"vectors": {"matrix": [[1, 1, 1]]}}}
    column = {"matrix": [[a] for a in weights]}
    out = pyramid(
        0, "common vector", P=diagonal(0), proof={"wx": [column], "wz": {"matrix": [[0]] * 4}}, witness=witness
    )
    out["proof"].pop("P")
    return out


def pyramid_growth(ws=(1, 0, 0, 0), wb=(0, 0, 0, 0), factor=1, cycle=True):
    """x+ = x on the cone of four generators."""
    around = {"x": {"array": [1, 1, 1]}, "modes": {"tuple": [0]}, "factor": {"fraction": factor}}
    data = {"growth": {"double": 1}, "least": {"double": 1 if cycle else 0}, "vs": {"matrix": [[0, 0, 1]]}}
    data["cycle"] = {"record": "CycleOfGrowth", "fields": around} if cycle else None
    proof = {name: {"matrix": [[a] for a in column]} for name, column in (("ws", ws), ("wb", wb))} if cycle else {}
    return pyramid(1, "growth under switching", "PROVED", P=diagonal(1), discrete=True, proof=proof, **data)


def dwells(matrices, T, vs=(1, 1), shifts=(1, 2), terms=(6, 6), discrete=False):
    data = {"dwell_time": {"fraction": T}, "vs": {"matrix": [[v] for v in vs]}, "shifts": {"fractions": list(shifts)}}
    data["terms"] = {"tuple": list(terms)}
    return several(matrices, "dwell time", "PROVED", discrete=discrete, **data)


def too_short(matrices, T, modes, times, shifts, *, x=1, terms=6, discrete=False, **more):
    fields = {"x": {"array": [x]}, "modes": {"tuple": list(modes)}, "times": {"fractions": list(times)}}
    fields |= {"shifts": {"fractions": list(shifts)}, "terms": terms}
    data = {"dwell_time": {"fraction": T}, "witness": {"record": "DwellCycle", "fields": fields}}
    return several(matrices, "dwell time", discrete=discrete, **data | more)


def without_weights(content):
    return content | {"proof": {}}


ALONE = {"A": {"matrix": [[0]]}}
CASES = {
    "no common vector": (no_vector([-2, 2], 1, 1), "REFUTED"),
    "no common vector, but one": (no_vector([-2, 1], 1, 1), "WRONG"),
    "no common vector, a vector outside": (no_vector([-2, -2], -1, -1), "WRONG"),
    "no common vector, one of them outside": (no_vector([-2, 2], -1, 1), "WRONG"),
    "no common vector, nothing": (no_vector([-2, 2], 0, 0), "WRONG"),
    "no common vector, one too few": (no_vector([-2, 2], 1), "UNREADABLE"),
    "no common vector, discrete": (no_vector(["1/2", "3/2"], 1, 1, discrete=True), "REFUTED"),
    "no common vector, discrete, but one": (no_vector(["1/2", "5/4"], 1, 1, discrete=True), "WRONG"),
    "no common vector, v beside it": (changed(no_vector([-2, 2], 1, 1), v={"array": [1]}), "UNREADABLE"),
    "no common vector, no family": (changed(no_vector([0], 1), **ALONE), "UNREADABLE"),
    "no common vector, four generators": (unlike((1, 0, 0, 0)), "REFUTED"),
    "no common vector, four generators, other weights": (unlike((0, 1, 0, 0)), "WRONG"),
    "unstable mixture": (mixture([-1, 3], "3/4", "1/4"), "REFUTED"),
    "unstable mixture of other weights": (mixture([-1, 3], "4/5", "1/5"), "WRONG"),
    "unstable mixture, one alone": (mixture([-1, 1], 0, 1), "REFUTED"),
    "growth, no weights": (growth([2, 1], 2) | {"proof": {}}, "PROVED"),
    "unstable mixture of any sum": (mixture([-1, 3], 3, 1), "REFUTED"),
    "unstable mixture, negative weight": (mixture([-1, -3], 2, -1), "WRONG"),
    "unstable mixture of nothing": (mixture([-1, -3], 0, 0), "WRONG"),
    "unstable mixture, a weight too few": (mixture([3, -1], 1), "WRONG"),
    "unstable mixture, x is 0": (mixture([-1, -3], 1, 1, x=0), "WRONG"),
    "unstable mixture, x outside": (mixture([-1, -3], 1, 1, x=-1), "WRONG"),
    "unstable mixture, discrete": (mixture(["1/2", "3/2"], "1/2", "1/2", discrete=True), "REFUTED"),
    "unstable mixture, discrete, stable": (mixture(["1/2", "3/2"], "3/4", "1/4", discrete=True), "WRONG"),
    "unstable mixture, discrete, of another sum": (mixture(["1/2", "3/4"], 1, 1, discrete=True), "WRONG"),
    "unstable mixture, discrete, not kept": (mixture([-1, 3], "1/2", "1/2", discrete=True), "WRONG"),
    "unstable mixture, no family": (changed(mixture([1], 1), **ALONE), "UNREADABLE"),
    "unstable mixture, four generators": (standing(), "REFUTED"),
    "unstable mixture, four generators, x not shown": (standing((0, 1, 0, 0)), "WRONG"),
    "unstable mixture, four generators, growth not shown": (standing(wz=(0, 1, 0, 0)), "WRONG"),
    "unstable mixture, four generators, not kept": (standing(P=2), "WRONG"),
    "cycle of growth": (cycle(["1/2", 2], [0, 1], 1), "REFUTED"),
    "cycle of growth, factor too large": (cycle(["1/2", 2], [0, 1], "9/8"), "WRONG"),
    "cycle of growth, more than 1": (cycle(["1/2", 4], [1, 0], 2), "REFUTED"),
    "cycle of decay": (cycle(["1/2", 1], [0, 1], "1/2"), "WRONG"),
    "cycle of growth, x is 0": (cycle(["1/2", 1], [0, 1], 1, x=0), "WRONG"),
    "cycle of growth, x outside": (cycle(["1/2", 1], [0, 1], 1, x=-1), "WRONG"),
    "cycle of nothing": (cycle([2], [], 1), "UNREADABLE"),
    "cycle of no factor": (cycle([2], [0], 0), "UNREADABLE"),
    "cycle of others": (cycle([2], [1], 1), "UNREADABLE"),
    "cycle in continuous time": (cycle([2], [0], 1, discrete=False), "UNREADABLE"),
    "cycle of members that are not kept": (cycle([-1], [0, 0], 1), "WRONG"),
    "growth": (growth([2, 1], 2), "PROVED"),
    "growth, too small": (growth([2, 1], "3/2"), "WRONG"),
    "growth, by next modes": (growth([2, 1], 4, (2, 1)), "PROVED"),
    "growth, by next modes, too small": (growth([2, 1], 2, (1, 2)), "WRONG"),
    "growth, v is 0": (growth([0, 0], 1, (0, 1)), "WRONG"),
    "growth, a vector too few": (growth([2, 1], 2, (1,)), "UNREADABLE"),
    "growth below 0": (growth([0, 0], -1), "UNREADABLE"),
    "growth of 0": (growth([0, 0], 0), "PROVED"),
    "growth in continuous time": (growth([2, 1], 2, discrete=False), "UNREADABLE"),
    "growth of what is not kept": (growth([-1, 1], 2), "WRONG"),
    "growth of no family": (growth([1], 1, (1,), A={"matrix": [[1]]}), "UNREADABLE"),
    "growth, least": (growth([2, 1], 2, least=2, around=turning([0, 0], 4)), "PROVED"),
    "growth, least too large": (growth([2, 1], 2, least="9/4", around=turning([0, 0], 4)), "WRONG"),
    "growth, factor too large": (growth([2, 1], 2, least=2, around=turning([0, 0], 5)), "WRONG"),
    "growth, least below 0": (growth([2, 1], 2, least=-1, around=turning([0, 0], 4)), "UNREADABLE"),
    "growth, least of 0": (growth([2, 1], 2, least=0, around=turning([0, 0], 4)), "PROVED"),
    "growth, least without a cycle": (growth([2, 1], 2, least=1), "UNREADABLE"),
    "growth, cycle of 0": (growth([2, 1], 2, least=1, around=turning([0], 1, 0)), "WRONG"),
    "growth, cycle outside": (growth([1, 1], 1, least=1, around=turning([0], 1, -1)), "WRONG"),
    "growth, four generators": (pyramid_growth(), "PROVED"),
    "growth, four generators, no cycle": (pyramid_growth(cycle=False), "PROVED"),
    "growth, four generators, cycle not shown": (pyramid_growth((0, 1, 0, 0)), "WRONG"),
    "growth, four generators, cycle too large": (pyramid_growth(wb=(1, 0, 0, 0)), "WRONG"),
}
CASES |= {
    "dwell time": (dwells([-1, -2], "3/4", (1, 2)), "PROVED"),
    "dwell time, no weights": (without_weights(dwells([-1, -2], "3/4", (1, 2))), "PROVED"),
    "dwell time, too short": (dwells([-1, -2], "2/3", (1, 2)), "WRONG"),
    "dwell time, too few terms": (dwells([-1, -2], "3/4", (1, 2), terms=(1, 6)), "WRONG"),
    "dwell time, so few terms that it cannot be": (dwells([-1, -2], 1, terms=(6, 1)), "UNREADABLE"),
    "dwell time, just enough terms": (dwells([-1, -4], 2, shifts=(1, 4), terms=(2, 14)), "PROVED"),
    "dwell time, one term too few": (dwells([-1, -4], 2, shifts=(1, 4), terms=(2, 13)), "UNREADABLE"),
    "dwell time, larger shift": (dwells([-1, -2], "3/4", (1, 2), (3, 2), (16, 6)), "PROVED"),
    "dwell time, larger shift, too short": (dwells([-1, -2], "11/16", (1, 2), (3, 2), (16, 6)), "WRONG"),
    "dwell time, smaller shift": (dwells([-1, -2], "3/4", (1, 1), ("1/2", 2)), "WRONG"),
    "dwell time, negative shift": (dwells([2, -2], "3/4", (1, 1), (-1, 2)), "UNREADABLE"),
    "dwell time, no shift": (dwells([0, -2], "3/4", (1, 1), (0, 2)), "WRONG"),
    "dwell time, marginal": (dwells([0, -2], "3/4", (4, 1)), "WRONG"),
    "dwell time of 0": (dwells([-1, -2], 0), "UNREADABLE"),
    "dwell time, v is 0": (dwells([-1, -2], 9, (0, 0), terms=(40, 40)), "WRONG"),
    "dwell time, just equal": (dwells([-1, -2], 1, (1, 1), (1, 2), (1, 6)), "WRONG"),
    "dwell time, just equal, larger shift": (dwells([-1, -2], "1/2", (1, 1), (3, 2), (2, 6)), "WRONG"),
    "dwell time, a shift too few": (dwells([-1, -2], "3/4", shifts=(1,)), "UNREADABLE"),
    "dwell time, a vector too few": (dwells([-1, -2], "3/4", (1,)), "UNREADABLE"),
    "dwell time, terms too few": (dwells([-1, -2], "3/4", terms=(6,)), "UNREADABLE"),
    "dwell time, a thousand terms": (dwells([-1, -2], 1, terms=(6, 1000)), "PROVED"),
    "dwell time, more than a thousand terms": (dwells([-1, -2], 1, terms=(6, 1001)), "UNREADABLE"),
    "dwell time, discrete": (dwells(["1/2", "1/4"], 1, shifts=(0, 0), discrete=True), "UNREADABLE"),
    "dwell time, one member": (dwells([-1], 1, (1,), (1,), (6,)), "PROVED"),
    "not with this dwell time": (too_short([-1, 2], 1, [0, 1], [1, 1], [1, 0]), "REFUTED"),
    "not with this dwell time, with a shift": (too_short([-1, 2], 1, [0, 1], [1, 1], [2, 1]), "REFUTED"),
    "not with this dwell time, but with a longer one": (too_short([-1, 2], 2, [0, 1], [1, 1], [1, 0]), "WRONG"),
    "not with this dwell time, no weights": (
        without_weights(too_short([-1, 2], 1, [0, 1], [1, 1], [1, 0])),
        "REFUTED",
    ),
    "not with a dwell time, marginal": (too_short([0], 1, [0], [1], [0]), "REFUTED"),
    "not with a dwell time, longer": (too_short([0], 1, [0], [2], [0], terms=1), "REFUTED"),
    "not with a dwell time, just not shown": (too_short([0], 1, [0], [1], [1]), "WRONG"),
    "not with a dwell time, nearly": (too_short([-1, 1], 1, [0, 1], [1, 1], [1, 0]), "WRONG"),
    "not with a dwell time, the other way round": (too_short([-1, 2], 1, [0, 1], [3, 1], [1, 0]), "WRONG"),
    "not with a dwell time of 0": (too_short([0], 0, [0], [1], [0]), "UNREADABLE"),
    "not with a dwell time, x is 0": (too_short([0], 1, [0], [1], [0], x=0), "WRONG"),
    "not with a dwell time, x outside": (too_short([-1], 1, [0], [1], [1], x=-1), "WRONG"),
    "not with a dwell time, no terms": (too_short([1], 1, [0], [1], [0], terms=0), "UNREADABLE"),
    "not with a dwell time, no members": (too_short([1], 1, [], [], [0]), "UNREADABLE"),
    "not with a dwell time, a time too few": (too_short([1, 1], 1, [0, 1], [1], [0, 0]), "UNREADABLE"),
    "not with a dwell time, not kept": (too_short([-3, 2], 1, [1], [1], [1, 0]), "WRONG"),
    "not with a dwell time, discrete": (too_short([1], 1, [0], [1], [0], discrete=True), "UNREADABLE"),
}
