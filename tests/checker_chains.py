"""Tiny certificate files by hand about families that a Markov chain, or a rule, switches, true and just not true."""

from checker_cases import double
from checker_families import ALONE, diagonal, dwells, pyramid, several, too_short, without_weights

EVEN = [[-1, 1], [1, -1]]
COIN = [["1/2", "1/2"], ["1/2", "1/2"]]
TURN = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
TURNED = [[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0]]


def chained(chain, jumps):
    """The chain, and jumps by pairs of members."""
    data = {"chain": {"matrix": chain}}
    if jumps:
        data["between"] = {"tuple": [k for pair in jumps for k in pair]}
        data["jumps"] = {"tuple": [{"matrix": [[J]]} for J in jumps.values()]}
    return data


def mean(matrices, chain=EVEN, vs=(1, 1), rate=0, jumps=None, discrete=False, **more):
    data = chained(chain, jumps) | {"vs": {"matrix": [[v] for v in vs]}, "decay_rate": {"double": double(rate)}}
    return several(matrices, "mean stable", "PROVED", discrete=discrete, **data | more)


def not_mean(matrices, chain=EVEN, xs=(1, 1), rate=0, jumps=None, discrete=False, asked=None, **more):
    fields = {"vectors": {"matrix": [[x] for x in xs]}, "rate": {"fraction": rate}}
    data = chained(chain, jumps) | {"witness": {"record": "MeanDirection", "fields": fields}}
    data |= {} if asked is None else {"required_rate": {"fraction": asked}}
    return several(matrices, "mean stable", discrete=discrete, **data | more)


def asked(rate):
    return {"required_rate": {"fraction": rate}}


def ruled(matrices, lam, v=1, rate=0, discrete=False, **more):
    data = {"v": {"array": [v]}, "weights": {"fractions": list(lam)}, "decay_rate": {"double": double(rate)}}
    return several(matrices, "stabilising switching", "PROVED", discrete=discrete, **data | more)


def without_rate(content):
    del content["data"]["decay_rate"]
    return content


def four(A, status="PROVED", *, N=TURNED, wx=(1, 0, 0, 0), wz=(1, 0, 0, 0), P=None):
    """Two alike members on the cone of four generators, with a quarter of a turn from the first to the second."""
    kind = {"chain": {"matrix": EVEN}, "between": {"tuple": [0, 1]}, "jumps": {"tuple": [{"matrix": TURN}]}}
    kind |= {"vs": {"matrix": [[0, 0, 1]] * 2}, "decay_rate": {"double": 0}} if status == "PROVED" else {}
    proof = {"N": [{"matrix": N}]}
    if status == "REFUTED":
        fields = {"vectors": {"matrix": [[1, 1, 1], [1, -1, 1]]}, "rate": {"double": 0}}
        kind["witness"] = {"record": "MeanDirection", "fields": fields}
        second = {"wx": (0, 1, 0, 0), "wz": (0, 0, 0, 1)}
        for name, column in (("wx", wx), ("wz", wz)):
            proof[name] = [{"matrix": [[a] for a in w]} for w in (column, second[name])]
    out = pyramid(A, "mean stable", status, P=diagonal(A if P is None else P), proof=proof, **kind)
    out["data"]["A"]["tuple"] *= 2
    out["proof"]["P"] *= 2
    return out


def alone(content):
    content["data"] |= ALONE
    return content


CASES = {
    "mean stable": (mean([-3, "1/4"], vs=(1, 2)), "PROVED"),
    "mean stable, by other vectors": (mean([-3, "1/4"]), "WRONG"),
    "mean stable, at a rate": (mean([-3, "1/4"], vs=(1, 2), rate="1/4"), "PROVED"),
    "mean stable, at no rate": (without_rate(mean([-3, "1/4"], vs=(1, 2))), "PROVED"),
    "mean stable, rate too large": (mean([-3, "1/4"], vs=(1, 2), rate="5/16"), "WRONG"),
    "mean stable, at a rate asked for": (mean([-3, "1/4"], vs=(1, 2), **asked("1/4")), "PROVED"),
    "mean stable, rate asked for too large": (mean([-3, "1/4"], vs=(1, 2), **asked("1/3")), "WRONG"),
    "mean stable, rate asked for of 0": (mean([-3, "1/4"], vs=(1, 2), **asked(0)), "UNREADABLE"),
    "mean stable, rate below 0": (mean([-3, "1/4"], vs=(1, 2), rate=-1), "UNREADABLE"),
    "mean stable, marginal": (mean([-3, "1/2"], vs=(1, 2)), "WRONG"),
    "mean stable, v of 0": (mean([-1, -1], vs=(0, 0)), "WRONG"),
    "mean stable, one v of 0": (mean([-1, -1], [[0, 0], [0, 0]], vs=(0, 1)), "WRONG"),
    "mean stable, v below 0": (mean([2, -1], [[0, 0], [0, 0]], vs=(-1, 1)), "WRONG"),
    "mean stable, a vector too few": (mean([-3, -1], vs=(1,)), "UNREADABLE"),
    "mean stable, of a row": (mean([-1], [[0]], vs=(1,)), "PROVED"),
    "mean stable, no family": (alone(mean([-1], [[0]], vs=(1,))), "UNREADABLE"),
    "mean stable, other rates": (mean([-3, "1/4"], [[-1, 1], ["1/4", "-1/4"]], vs=(1, 2)), "WRONG"),
    "mean stable, rates from the first": (mean(["3/4", -2], [[-1, 1], [0, 0]], vs=(8, 1)), "PROVED"),
    "mean stable, rates from the second": (mean(["3/4", -2], [[0, 0], [1, -1]], vs=(8, 1)), "WRONG"),
    "mean stable, a chain of another sum": (mean([-9, -9], [[-1, 1], [1, -2]]), "UNREADABLE"),
    "mean stable, a negative rate": (mean([-9, -9], [[1, -1], [1, -1]]), "UNREADABLE"),
    "mean stable, a small chain": (mean([-9, -9], [[0, 0]]), "UNREADABLE"),
    "mean stable, a row too many": (mean([-9, -9], [[-1, 1], [1, -1], [0, 0]]), "UNREADABLE"),
    "mean stable, with a jump": (mean([-1, -1], jumps={(0, 1): "3/2"}), "PROVED"),
    "mean stable, with a jump, marginal": (mean([-1, -1], jumps={(0, 1): 2}), "WRONG"),
    "mean stable, with a jump from the first": (mean([-3, -1], vs=(1, 1), jumps={(0, 1): 3}), "PROVED"),
    "mean stable, with a jump from the second": (mean([-3, -1], vs=(1, 1), jumps={(1, 0): 3}), "WRONG"),
    "mean stable, with two jumps": (mean([-1, -3], jumps={(0, 1): "1/2", (1, 0): 3}), "PROVED"),
    "mean stable, with a jump that leaves": (mean([-1, -1], jumps={(0, 1): -1}), "WRONG"),
    "mean stable, with a jump to itself": (mean([-1, -1], jumps={(0, 0): 1}), "UNREADABLE"),
    "mean stable, with a jump to nobody": (mean([-1, -1], jumps={(0, 2): 1}), "UNREADABLE"),
    "mean stable, with a jump from nobody": (mean([-1, -1], jumps={(2, 1): 1}), "UNREADABLE"),
    "mean stable, with a jump of no pair": (
        mean([-1, -1], jumps={(0, 1): 1}, between={"tuple": [0]}),
        "UNREADABLE",
    ),
    "mean stable, a jump too few": (
        mean([-1, -1], jumps={(0, 1): 1}, between={"tuple": [0, 1, 1, 0]}),
        "UNREADABLE",
    ),
    "mean stable, a jump twice": (
        mean([-1, -1], jumps={(0, 1): 1, (1, 0): 1}, between={"tuple": [0, 1, 0, 1]}),
        "UNREADABLE",
    ),
    "mean stable, members not kept": (mean([-1, "-1/4"], COIN, discrete=True), "WRONG"),
    "mean stable, discrete": (mean(["1/2", "5/4"], COIN, discrete=True, vs=(4, 9)), "PROVED"),
    "mean stable, discrete, marginal": (mean(["1/2", "3/2"], COIN, discrete=True, vs=(1, 3)), "WRONG"),
    "mean stable, discrete, at a rate": (mean(["1/2", "1/4"], COIN, discrete=True, rate="1/2"), "PROVED"),
    "mean stable, discrete, rate too large": (mean(["1/2", "1/4"], COIN, discrete=True, rate="5/8"), "WRONG"),
    "mean stable, discrete, with a jump": (
        mean(["1/2", "1/2"], COIN, discrete=True, jumps={(0, 1): "5/2"}),
        "PROVED",
    ),
    "mean stable, discrete, with a jump, marginal": (
        mean(["1/2", "1/2"], COIN, discrete=True, jumps={(0, 1): 3}),
        "WRONG",
    ),
    "mean stable, discrete, a chain of another sum": (mean([0, 0], EVEN, discrete=True), "UNREADABLE"),
    "mean stable, discrete, a negative probability": (
        mean([0, 0], [["-1/2", "3/2"], [1, 0]], discrete=True),
        "UNREADABLE",
    ),
    "mean stable, four generators": (four(-1), "PROVED"),
    "mean stable, four generators, other weights": (four(-1, N=diagonal(1)), "WRONG"),
    "mean stable, four generators, not kept": (four(-1, P=1), "WRONG"),
}
CASES |= {
    "not mean stable, but stable": (not_mean([-3, "1/2"], xs=(1, 4)), "WRONG"),
    "not mean stable": (not_mean([-1, "1/2"], xs=(1, 2)), "REFUTED"),
    "not mean stable, other means": (not_mean([-1, "1/2"], xs=(1, 1)), "WRONG"),
    "not mean stable, means of 0": (not_mean([-1, "1/2"], xs=(0, 0)), "WRONG"),
    "not mean stable, means outside": (not_mean([-1, "-3/2"], xs=(-1, -1)), "WRONG"),
    "not mean stable, one outside": (not_mean([1, 1], [[0, 0], [0, 0]], xs=(1, -1)), "WRONG"),
    "not mean stable, no growth of one": (not_mean([1, -1], [[0, 0], [0, 0]], xs=(1, 1)), "WRONG"),
    "not mean stable, only one": (not_mean([1, -1], [[0, 0], [0, 0]], xs=(1, 0)), "REFUTED"),
    "not mean stable, a vector too few": (not_mean([1, 1], xs=(1,)), "UNREADABLE"),
    "not mean stable, rates from the first": (not_mean([1, -1], [[-1, 1], [0, 0]], xs=(1, 1)), "REFUTED"),
    "not mean stable, rates from the second": (not_mean([1, -1], [[0, 0], [1, -1]], xs=(1, 1)), "WRONG"),
    "not mean stable, members not kept": (not_mean([-1, 3], COIN, xs=(0, 1), discrete=True), "WRONG"),
    "not mean stable, with a jump": (not_mean([1, -3], xs=(1, 1), jumps={(0, 1): 4}), "REFUTED"),
    "not mean stable, with a jump the other way": (not_mean([1, -3], xs=(1, 1), jumps={(1, 0): 4}), "WRONG"),
    "not mean stable, at a rate": (not_mean([-2, -1], rate=2, asked=3), "REFUTED"),
    "not mean stable, at a rate that is not shown": (not_mean([-2, -1], rate="3/2", asked=3), "WRONG"),
    "not mean stable, at a rate as large": (not_mean([-2, -2], xs=(1, 1), rate=2, asked=2), "WRONG"),
    "not mean stable, at a rate not asked for": (not_mean([-2, -2], xs=(1, 1), rate=2), "WRONG"),
    "not mean stable, at a rate below 0": (not_mean([2, 2], xs=(1, 1), rate=-1, asked=2), "UNREADABLE"),
    "not mean stable, whatever was asked for": (not_mean([0, 0], xs=(1, 1), asked=2), "REFUTED"),
    "not mean stable, discrete": (not_mean(["1/2", "3/2"], COIN, xs=(1, 1), discrete=True), "REFUTED"),
    "not mean stable, discrete, stable": (not_mean(["1/2", "5/4"], COIN, xs=(1, 1), discrete=True), "WRONG"),
    "not mean stable, discrete, with a jump": (
        not_mean(["1/2", "1/2"], COIN, xs=(1, 2), discrete=True, jumps={(0, 1): 6, (1, 0): "3/2"}),
        "REFUTED",
    ),
    "not mean stable, discrete, at a rate": (
        not_mean(["1/2", "1/2"], COIN, xs=(1, 1), discrete=True, rate="1/2", asked="3/4"),
        "REFUTED",
    ),
    "not mean stable, discrete, at a smaller rate": (
        not_mean(["1/2", "1/2"], COIN, xs=(1, 1), discrete=True, rate="1/4", asked="3/4"),
        "WRONG",
    ),
    "not mean stable, four generators": (four(1, "REFUTED", wz=(0, 1, 0, 0)), "REFUTED"),
    "not mean stable, four generators, x not shown": (four(1, "REFUTED", wx=(0, 1, 0, 0), wz=(0, 1, 0, 0)), "WRONG"),
    "not mean stable, four generators, growth not shown": (four(1, "REFUTED"), "WRONG"),
    "not mean stable, four generators, jump not shown": (
        four(1, "REFUTED", wz=(0, 1, 0, 0), N=diagonal(1)),
        "WRONG",
    ),
}
CASES |= {
    "a rule": (ruled([1, -3], ["1/2", "1/2"]), "PROVED"),
    "a rule, marginal": (ruled([1, -1], ["1/2", "1/2"]), "WRONG"),
    "a rule of other weights": (ruled([1, -3], ["3/4", "1/4"]), "WRONG"),
    "a rule at a rate": (ruled([1, -3], ["1/2", "1/2"], rate=1), "PROVED"),
    "a rule at no rate": (without_rate(ruled([1, -3], ["1/2", "1/2"])), "PROVED"),
    "a rule, rate too large": (ruled([1, -3], ["1/2", "1/2"], rate="3/2"), "WRONG"),
    "a rule, rate below 0": (ruled([1, -3], ["1/2", "1/2"], rate=-1), "UNREADABLE"),
    "a rule, negative weight": (ruled([1, 3], [2, -1]), "UNREADABLE"),
    "a rule of one": (ruled([1, -3], [0, 1]), "PROVED"),
    "a rule of another sum": (ruled([1, -3], [1, 1]), "UNREADABLE"),
    "a rule, a weight too few": (ruled([-1, -3], [1]), "UNREADABLE"),
    "a rule, v of 0": (ruled([1, -3], ["1/2", "1/2"], v=0), "WRONG"),
    "a rule, v below 0": (ruled([3, -1], ["1/2", "1/2"], v=-1), "WRONG"),
    "a rule, discrete": (ruled([2, "1/2"], ["1/4", "3/4"], discrete=True, rate="1/8"), "PROVED"),
    "a rule, discrete, rate too large": (ruled([2, "1/2"], ["1/4", "3/4"], discrete=True, rate="1/4"), "WRONG"),
    "a rule, discrete, marginal": (ruled([2, 0], ["1/2", "1/2"], discrete=True), "WRONG"),
    "a rule, discrete, not kept": (ruled([-1, 0], ["1/2", "1/2"], discrete=True), "WRONG"),
    "a rule, no family": (alone(ruled([-1], [1])), "UNREADABLE"),
}


def steps(matrices, T, vs=(1, 1), **more):
    out = dwells(matrices, T, vs, discrete=True)
    for name in ("shifts", "terms"):
        del out["data"][name]
    out["data"] |= more
    return out


def short(matrices, T, modes, times, x=1):
    out = too_short(matrices, T, modes, times, [], x=x, terms=1, discrete=True)
    out["data"]["witness"]["fields"]["shifts"] = {"tuple": []}
    return out


CASES |= {
    "dwell time in steps": (steps(["1/2", "1/2"], 2, (1, 3)), "PROVED"),
    "dwell time in steps, no weights": (without_weights(steps(["1/2", "1/2"], 2, (1, 3))), "PROVED"),
    "dwell time in steps, just equal": (steps(["1/2", "1/2"], 2, (1, 4)), "WRONG"),
    "dwell time in steps, too short": (steps(["1/2", "1/2"], 1, (1, 3)), "WRONG"),
    "dwell time in steps, marginal": (steps([1, "1/2"], 2, (2, 1)), "WRONG"),
    "dwell time in steps, not whole": (steps(["1/2", "1/2"], "3/2", (1, 1)), "UNREADABLE"),
    "dwell time in steps, terms": (steps(["1/2", "1/2"], 2, terms={"tuple": [1, 1]}), "UNREADABLE"),
    "dwell time in steps, shifts": (steps(["1/2", "1/2"], 2, shifts={"fractions": [0, 0]}), "UNREADABLE"),
    "dwell time in steps, not kept": (steps(["-1/2", "1/2"], 2), "WRONG"),
    "dwell time in a thousand steps": (steps(["1/2", "1/2"], 1000), "PROVED"),
    "dwell time in more steps": (steps(["1/2", "1/2"], 1001), "UNREADABLE"),
    "dwell time in steps, one member": (steps(["1/2"], 1, (1,)), "PROVED"),
    "not with a dwell time in steps": (short(["1/2", 2], 2, [0, 1], [2, 2]), "REFUTED"),
    "not with a dwell time in steps, shorter": (short(["1/2", 2], 3, [0, 1], [2, 2]), "WRONG"),
    "not with a dwell time in steps, decay": (short(["1/4", 2], 2, [0, 1], [2, 3]), "WRONG"),
    "not with a dwell time in steps, the other way round": (short(["1/4", 2], 2, [1, 0], [3, 2]), "WRONG"),
    "not with a dwell time in steps, x outside": (short([2], 1, [0], [1], x=-1), "WRONG"),
    "not with a dwell time in steps, x is 0": (short([2], 1, [0], [1], x=0), "WRONG"),
    "not with a dwell time in steps, not whole": (short([2], 1, [0], ["3/2"]), "UNREADABLE"),
    "not with a dwell time in steps, itself not whole": (short([2], "1/2", [0], [1]), "UNREADABLE"),
    "not with a dwell time in steps, not kept": (short([-1], 1, [0], [2]), "WRONG"),
}
