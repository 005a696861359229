"""Tiny certificate files by hand about structured gains, true and just not true."""

from checker_cases import HALF, double, scalar, shown

ABOVE = {"w": 1, "u": 1, "d": 1, "r": 1, "z": 1, "x": "1/2", "p": "5/8"}
BELOW = {"a": 2, "c": 1, "y": 1, "s": 1}
ONE_OF_TWO = {"a": [0, 1], "c": [0, 1], "y": [1, 0], "s": [1, 1]}
QUARTER = {"cone": [[2, {"rays": [[1]]}]]}
NEGATIVE = {"cone": [[1, {"rays": [[-1]]}]]}


def tupled(*items):
    return {"tuple": list(items)}


def listed(x):
    return {"array": [double(item) for item in (x if isinstance(x, list) else [x])]}


def gain(lower="1/2", upper="5/8", A=-2, B=1, C=1, D=0, discrete=False, more=None, **changes):
    """x' = -2 x + u, y = x, whose gain is 1/2; p'A + z'C = -5/4 + 1."""
    data = {name: {"matrix": M if isinstance(M, list) else [[M]]} for name, M in zip("ABCD", (A, B, C, D), strict=True)}
    data |= dict.fromkeys("XUY", HALF) | {"discrete": discrete, "witness": None}
    data |= {"input_blocks": tupled(0), "output_blocks": tupled(0)}
    data |= {"lower": {"double": double(lower)}, "upper": {"double": double(upper)}}
    vectors = ABOVE | ({} if lower == 0 else BELOW) | changes
    data |= {name: None if x is None else listed(x) for name, x in vectors.items()}
    return {"claim": "structured gain", "status": "PROVED", "data": data | (more or {}), "proof": {}}


def refuted(A=1, x=1, **more):
    """x' = x."""
    told = gain("nan", "nan", A=A, **dict.fromkeys(ABOVE | BELOW), more={"witness": shown("InstabilityDirection", x=x)})
    return {**told, "status": "REFUTED", "data": told["data"] | more}


def pair(inputs=(0, 0), outputs=(0, 0), **changes):
    """x' = -x + u, y = x, twice, with u2 crossing over to x1: G = [[1, 1], [0, 1]]."""
    data = {"A": [[-1, 0], [0, -1]], "B": [[1, 1], [0, 1]], "C": [[1, 0], [0, 1]], "D": [[0, 0], [0, 0]]}
    above = {"w": [1, 1], "u": [1, 1], "d": [1], "r": [1, 1], "z": [1, 1], "x": [2, 1], "p": ["9/8", "9/8"]}
    below = {"a": [1, 1], "c": [1, 1], "y": [2, 1], "s": [2, 1]}
    more = dict.fromkeys("XUY", QUARTER) | {"input_blocks": tupled(*inputs), "output_blocks": tupled(*outputs)}
    return gain(1, "9/4", **data, **above | below | changes, more=more)


LEVELLED = {"upper": 0, "lower": 0, **dict.fromkeys("wudrzx")}


def without(levels=(0, 0), own=(1,), inputs=(0, 0), outputs=(0, 0), C=((1, 0), (0, 1)), B=((0, 0), (0, 0)), **changes):
    """x' = A x, A = [[-1, 0], [1, -1]], with inputs and outputs that do not meet in their blocks."""
    data = {
        "A": [[-1, 0], [1, -1]],
        "B": [list(row) for row in B],
        "C": [list(row) for row in C],
        "D": [[0, 0], [0, 0]],
    }
    more = dict.fromkeys("XUY", QUARTER) | {"input_blocks": tupled(*inputs), "output_blocks": tupled(*outputs)}
    more |= {"levels": listed(list(levels)), "block_levels": listed(list(own))}
    return gain(**LEVELLED | {"p": [2, 1]} | data | changes, more=more)


def on_a_pyramid():
    """No gain, on a cone of four generators."""
    rays = [[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1]]
    wedge = {"cone": [[1, {"rays": rays, "w": [0, 0, 1], "Z": [[f"{a}/4" for a in x] for x in rays]}]]}
    zero = {"matrix": [[0, 0, 0]]}
    out = gain(**LEVELLED, p=[0, 0, 1], more={"levels": listed([0, 0, 0]), "block_levels": listed([1])})
    out["data"] |= {"X": wedge, "A": {"matrix": [[-1, 0, 0], [0, -1, 0], [0, 0, -1]]}, "C": zero}
    out["data"] |= {"B": {"matrix": [[0], [0], [0]]}}
    eye = {"matrix": [[-1 * (i == j) for j in range(4)] for i in range(4)]}
    return out | {"proof": {"P": eye, "N": {"sparse": [], "shape": [4, 1]}}}


APART, IN_TURN = {"inputs": (0, 1), "outputs": (0, 1)}, ((1, 0), (0, 0))
ZERO = {
    "no gain, no inputs": (without(), "PROVED"),
    "no gain, no outputs": (without((1, 1), (1,), C=((0, 0), (0, 0)), B=((1, 0), (0, 1))), "PROVED"),
    "no gain, but some": (without((1, 1), (1,), B=((1, 0), (0, 0))), "WRONG"),
    "no gain, inputs above states": (without((0, 0), (1,), C=((0, 0), (0, 0)), B=((1, 0), (0, 0))), "WRONG"),
    "no gain, input 2 above state 2": (without((1, 0), (1,), C=((0, 0), (0, 0)), B=((0, 0), (0, 1))), "WRONG"),
    "no gain, states that fall": (without((0, -1)), "WRONG"),
    "no gain, states that rise": (without((0, "1/2")), "PROVED"),
    "no gain, states as high as outputs": (without((0, 1)), "WRONG"),
    "no gain, one after the other": (without((0, 0), (0, 1), C=((0, 0), (0, 1)), B=IN_TURN, **APART), "PROVED"),
    "no gain, all on one level": (without((0, 0), (0, 0), C=((0, 0), (0, 1)), B=IN_TURN, **APART), "WRONG"),
    "no gain, one before the other": (without((1, 1), (1, 0), C=((0, 0), (0, 1)), B=IN_TURN, **APART), "WRONG"),
    "no gain, feedthrough": (without((0, 0), (1, 2), D=[[0, 0], [1, 0]], **APART), "PROVED"),
    "no gain, feedthrough on one level": (without((0, 0), (1, 1), D=[[0, 0], [1, 0]], **APART), "WRONG"),
    "no gain, feedthrough to a lower one": (without((0, 0), (1, 2), D=[[0, 1], [0, 0]], **APART), "WRONG"),
    "no gain, a level too few": (without((0,)), "UNREADABLE"),
    "no gain, a level too many": (without((0, 0, 0)), "UNREADABLE"),
    "no gain, a block too few": (without((0, 0), (1,), **APART), "UNREADABLE"),
    "no gain, a block too many": (without((0, 0), (1, 1)), "UNREADABLE"),
    "no gain, not stable": (without(A=[[0, 0], [1, -1]]), "WRONG"),
    "no gain, p is 0": (without(p=[0, 0]), "WRONG"),
    "no gain, but a bound from below": (without(lower=1), "UNREADABLE"),
    "no gain, w beside it": (without(w=[1, 1]), "UNREADABLE"),
    "no gain, four generators": (on_a_pyramid(), "UNREADABLE"),
    "gain, levels beside it": (gain(more={"levels": listed(0)}), "UNREADABLE"),
}
CASES = {
    "gain": (gain(), "PROVED"),
    "gain, upper at the value": (gain(upper="1/2", p="1/2"), "WRONG"),  # p'A + z'C is not negative then
    "gain, upper too low": (gain(upper="9/16"), "WRONG"),
    "gain, upper zero": (gain(upper=0), "UNREADABLE"),
    "gain, upper negative": (gain(upper=-1), "UNREADABLE"),
    "gain, lower too high": (gain(lower="5/8"), "WRONG"),
    "gain, lower negative": (gain(lower="-1/2"), "UNREADABLE"),
    "gain, nothing from below": (gain(lower=0), "PROVED"),
    "gain, a proof of nothing": (gain(lower=0, **BELOW), "UNREADABLE"),
    "gain, no proof from below": (gain(**dict.fromkeys(BELOW)), "UNREADABLE"),
    "gain, no inputs": (gain(a=0, c=0), "WRONG"),
    "gain, negative inputs": (gain(a=-2, c=-1), "WRONG"),
    "gain, negative outputs": (gain(y=-1), "WRONG"),
    "gain, too much output": (gain(y="9/8"), "WRONG"),
    "gain, output with feedthrough": (gain(y="9/8", upper="3/4", D="1/16"), "PROVED"),
    "gain, state too large": (gain(s="9/8", y="9/8"), "WRONG"),
    "gain, c too small": (gain(c="7/8"), "WRONG"),
    "gain, c too large": (gain(c="9/8"), "WRONG"),
    "gain, w zero": (gain(w=0, x=0, r=0), "WRONG"),
    "gain, w negative": (gain(w=-1, x="-1/2", r=-1), "WRONG"),
    "gain, u zero": (gain(u=0), "WRONG"),
    "gain, d zero": (gain(d=0, r=0), "WRONG"),
    "gain, d negative": (gain(d=-1, r=-1), "WRONG"),
    "gain, r too large": (gain(r="9/8", p="9/16"), "WRONG"),
    "gain, z too small": (gain(z="7/8"), "WRONG"),
    "gain, scaled": (gain(d=2, r=2, z=2, p="5/4"), "PROVED"),
    "gain, x too small": (gain(x="7/16"), "WRONG"),
    "gain, x too large": (gain(x="3/4"), "WRONG"),
    "gain, x with feedthrough": (gain(D="1/8"), "WRONG"),
    "gain, w with feedthrough": (gain(upper="3/4", u="13/16", z="13/16", p="1/2", D="1/8"), "WRONG"),
    "gain, w with feedthrough, larger u": (gain(upper="3/4", u="27/32", z="27/32", p="1/2", D="1/8"), "PROVED"),
    "gain, p too small": (gain(p="1/2"), "WRONG"),
    "gain, p too large": (gain(p="3/4"), "WRONG"),
    "gain, p with feedthrough": (gain(x="1/2", u="9/8", z="9/8", D="1/64"), "WRONG"),
    "gain, p negative": (gain(A=-2, p=-1), "WRONG"),
    "gain, discrete": (gain(A="1/2", B="1/4", p="17/8", x="1/2", s=1, discrete=True), "PROVED"),
    "gain, discrete, as if continuous": (gain(A=-1, x=1, s=2, y=2, p="5/4", upper=2, discrete=True), "WRONG"),
    "gain, unstable": (gain(A=1), "WRONG"),
    "gain, not positive": (gain(B=-1), "WRONG"),
    "gain, other inputs": (gain(B=-1, more={"U": NEGATIVE}), "UNREADABLE"),
    "gain, other outputs": (gain(C=-1, more={"Y": NEGATIVE}), "UNREADABLE"),
    "gain, no block": (gain(more={"input_blocks": tupled()}), "UNREADABLE"),
    "gain, a block without outputs": (gain(more={"output_blocks": tupled(1)}), "UNREADABLE"),
    "gain, a block left out": (gain(more=dict.fromkeys(("input_blocks", "output_blocks"), tupled(1))), "UNREADABLE"),
    "gain, half a block": (gain(more={"input_blocks": tupled({"double": "0x1.0p-1"})}), "UNREADABLE"),
    "gain, d for two": (gain(d=[1, 1]), "UNREADABLE"),
    "gain, w of two": (gain(w=[1, 1]), "UNREADABLE"),
    "gain, of two": (pair(), "PROVED"),
    "gain, of two, in too low a block": (pair(y=["1/4", "1/4"]), "WRONG"),
    "gain, of two, one of them large": (pair(y=[2, 0]), "PROVED"),
    "gain, of two blocks, one of them large": (pair((0, 1), (0, 1), d=[1, 1], y=[2, 0]), "WRONG"),
    "gain, of two blocks": (pair((0, 1), (0, 1), d=[1, 1]), "PROVED"),
    "gain, of two blocks, each scaled": (
        pair((0, 1), (0, 1), d=[1, 2], r=[1, 2], z=[1, 2], p=["9/8", "17/8"]),
        "PROVED",
    ),
    "gain, of two blocks, scaled wrongly": (pair((0, 1), (0, 1), d=[2, 1], r=[2, 1], z=[1, 1]), "WRONG"),
    "gain, of two blocks, the other way": (
        pair((0, 1), (1, 0), d=[1, 1], a=[0, 1], c=[0, 1], y=[1, 0], s=[1, 1]),
        "PROVED",
    ),
    "gain, of two blocks, the wrong way": (
        pair((0, 1), (0, 1), d=[1, 1], a=[0, 1], c=[0, 1], y=[1, 0], s=[1, 1]),
        "WRONG",
    ),
    "no gain": (refuted(), "REFUTED"),
    "no gain of a stable system": (refuted(A=-1), "WRONG"),
    "no gain, with a bound": (refuted(upper={"double": 1}), "WRONG"),
    "no gain, with another bound": (refuted(lower={"double": 1}), "WRONG"),
    "no gain, with a proof": (refuted(w=listed(1)), "UNREADABLE"),
    "no gain of no blocks": (refuted(input_blocks=tupled()), "UNREADABLE"),
    "gain of a system with other claims": (scalar("structured gain"), "UNREADABLE"),
}
CASES |= ZERO
