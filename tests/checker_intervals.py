"""Tiny certificate files by hand about order intervals of networks, true and just not true."""

from checker_cases import changed, double, scalar


def circulating(high=(1, 1, 1), low=(1, 1, 1), w=1, W=1, *, bounds=(), rows=(), covers=None, witness=None, **node):
    """x' = -2 x + u + w, y = x, u = W y on half-lines, with bounds on x, u and y from above and below."""
    out = scalar("network interval", W=W, **node)
    ends = {
        f"{name}_{end}": x
        for end, vector in (("max", high), ("min", low))
        for name, x in zip("xuy", vector or [None] * 3, strict=True)
    }
    vectors = {name: None if x is None else [x] for name, x in (ends | {"w_max": w}).items()} | {
        "bounds": bounds or None
    }
    data = {k: None if x is None else {"array": [double(a) for a in x]} for k, x in vectors.items()}
    matrices = {"rows": rows, "covers": rows if covers is None else covers}
    data |= {name: {"matrix": [[a] for a in f]} if f else None for name, f in matrices.items()}
    if witness is not None:
        kind, vector, *row = witness
        fields = {"d" if kind == "NoInterval" else "x": {"array": [double(vector)]}} | ({"row": row[0]} if row else {})
        data |= {"witness": {"record": kind, "fields": fields}, "covers": None}
        data |= {"v": None} if kind == "NoInterval" else {}
    return changed(out, **data) | {"status": "PROVED" if witness is None else "REFUTED"}


def beyond(x, row=0, **more):
    return circulating(None, witness=("BoundExceeded", x, row), **{"bounds": [1], "rows": [2]} | more)


def excluded(d=1, **more):
    """x' = -2 x + 3 x + w, or another loop."""
    return circulating(None, None, **{"W": 3, "q": -3, "witness": ("NoInterval", d)} | more)


def to_a_third(w, exact):
    out = circulating((1, 1, 1), (0, 0, 0), w)
    return changed(out, w_max_exact={"fractions": [exact]})


LOOP = {"tuple": [{"array": [3]}, {"array": [2]}]}
CASES = {
    "network interval": (circulating(), "PROVED"),
    "network interval, wide": (circulating((2, 2, 2), (0, 0, 0)), "PROVED"),
    "network interval, too small": (circulating(("1/2", "1/2", "1/2")), "WRONG"),
    "network interval, input too small": (circulating((2, 1, 2)), "WRONG"),
    "network interval, output too small": (circulating((2, 2, 1)), "WRONG"),
    "network interval below 0": (circulating((-1, -1, -1), (-1, -1, -1), 0), "WRONG"),
    "network interval, none needed": (circulating((0, 0, 0), (0, 0, 0), 0), "PROVED"),
    "network interval, disturbance outside": (circulating((1, 1, 1), (-1, -1, -1), -1), "WRONG"),
    "network interval, smallest too large": (circulating((2, 2, 2), (2, 2, 2)), "WRONG"),
    "network interval, smallest input too large": (circulating((2, 2, 2), (1, 2, 1)), "WRONG"),
    "network interval, smallest output too large": (circulating((2, 2, 2), (1, 1, 2)), "WRONG"),
    "network interval, no end": (circulating(None), "UNREADABLE"),
    "network interval, no smallest": (circulating(low=None), "UNREADABLE"),
    "network interval, not stable": (circulating((0, 0, 0), (0, 0, 0), 0, A=-1), "WRONG"),
    "network interval, negative v": (circulating((0, 0, 0), (0, 0, 0), 0, v=-1), "WRONG"),
    "network interval, supply too small": (circulating(r="1/2"), "WRONG"),
    "network interval, discrete": (
        circulating((1, "1/4", 1), (1, "1/4", 1), "1/2", "1/4", A="1/4", q="-1/4", discrete=True),
        "PROVED",
    ),
    "network interval, discrete, too small": (
        circulating(A="1/4", W="1/4", q="-1/4", w="3/4", low=(0, 0, 0), discrete=True),
        "WRONG",
    ),
    "network interval, bound": (circulating(rows=[3], bounds=[3]), "PROVED"),
    "network interval, bound too low": (circulating(rows=[3], bounds=[2]), "WRONG"),
    "network interval, cover too low": (circulating(rows=[3], bounds=[2], covers=[2]), "WRONG"),
    "network interval, rows without bounds": (circulating(rows=[3]), "UNREADABLE"),
    "network interval, a third": (to_a_third("1/3", "1/3"), "PROVED"),
    "network interval, not rounded": (to_a_third("1/4", "1/3"), "UNREADABLE"),
    "network interval, covers without rows": (changed(circulating(), covers={"matrix": [[1]]}), "UNREADABLE"),
    "no network interval": (excluded(), "REFUTED"),
    "no network interval, marginal": (excluded(W=2, q=-2), "REFUTED"),
    "no network interval, but one": (excluded(W=1, q=-1), "WRONG"),
    "no network interval, nothing pushes": (excluded(w=0), "WRONG"),
    "no network interval, no vector": (excluded(d=0, q=0, r=0), "WRONG"),
    "no network interval, vector outside": (excluded(d=-1, r=-1, q=3, w=0), "WRONG"),
    "no network interval, supply too large": (excluded(r=2, q=-6), "WRONG"),
    "no network interval, coupling too weak": (excluded(W=1, q=-3), "WRONG"),
    "no network interval, discrete": (excluded(A="1/2", W="1/2", q="-1/2", discrete=True), "REFUTED"),
    "no network interval, discrete, but one": (excluded(A="1/4", W="1/2", q="-1/2", discrete=True), "WRONG"),
    "no network interval, feedthrough": (excluded(W=1, q=-2, r=2, D="1/2", loop_weights=LOOP), "REFUTED"),
    "no network interval, feedthrough too weak": (excluded(W=1, q=-2, r=2, D="1/4", loop_weights=LOOP), "WRONG"),
    "no network interval, an end": (changed(excluded(), x_max={"array": [1]}), "UNREADABLE"),
    "no network bound": (beyond(1), "REFUTED"),
    "no network bound, just": (beyond("1/2"), "WRONG"),
    "no network bound, beyond": (beyond(2), "WRONG"),
    "no network bound, outside": (beyond(-1, rows=[-2]), "WRONG"),
    "no network bound, of none": (beyond(1, 1), "WRONG"),
    "no network bound, no smallest": (beyond(0, low=None, bounds=[-1]), "UNREADABLE"),
}
