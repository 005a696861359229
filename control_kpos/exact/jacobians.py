"""Jacobians of a function on boxes: enclosed by intervals on boxes that are cut, or seen by differences."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DataError, ShapeError
from .branches import require_no_jumps
from .growth import Growth
from .intervals import IntervalDual, Quantities, Rows, is_finite_number, known_of
from .quantities import Known, Variable, constant
from .sharper import FACES, Bounds, sharper
from .unreadable import Surface, UnboundedError, UnsupportedError, Watch, watched

Array = NDArray[np.float64]

# An unbounded enclosure is cut in two this often before it is given up.
_DEEPEST = 10
# Boxes in a row, more or less, on which second derivatives decide nothing, after which they are not asked for.
_PATIENCE = 6


def values_on_box(
    function: Callable[[Any], Any], lower: Any, upper: Any, n: int, more: str = ""
) -> tuple[list[Known], Watch]:
    """The function's values, their derivatives by the first n quantities, and what was noted.

    With `more`, "growth" or "growth and bends", relative growth is known too, and second derivatives are.
    """
    values, watch = _called(function, Quantities, _arguments(lower, upper, n, more), lower, upper)
    return [_known(y, n) for y in values], watch


def _called(
    function: Callable[[Any], Any],
    kind: type[Quantities] | type[Rows],
    items: list[IntervalDual],
    lower: Any,
    upper: Any,
) -> tuple[list[Any], Watch]:
    """What a function returns, once it is proven not to jump."""
    values, watch = watched(function, kind.of(items))

    def on_surface(surface: Surface) -> tuple[Any, Watch]:
        i, place = surface.variable, surface.place
        boxes = surface.boxes & (lower[i] <= place) & (place <= upper[i])
        low, high = list(lower), list(upper)
        low[i], high[i] = np.where(boxes, place, lower[i]), np.where(boxes, place, upper[i])
        return boxes, watched(function, kind.of(_arguments(low, high, 0)))[1] if boxes.any() else watch

    require_no_jumps(watch, on_surface)
    return values, watch


def _arguments(lower: Any, upper: Any, n: int, more: str = "") -> list[IntervalDual]:
    """Quantities between bounds, one or many of each, with the derivatives by the first n of them."""
    out: list[IntervalDual] = []
    flat = np.zeros((n, n))
    least, most = (np.moveaxis(np.asarray(side, dtype=float)[:n], 0, -1) for side in (lower, upper))
    for i, (a, b) in enumerate(zip(lower, upper, strict=True)):
        unit = np.zeros(n)
        unit[i:][:1] = 1.0
        value = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
        known = Known(value, (unit, unit), Variable(i))
        if "growth" in more:
            known = known._replace(growth=Growth((least, most), (unit, unit)))
        if "bends" in more:
            known = known._replace(bend=(flat, flat))
        out.append(IntervalDual(known, i))
    return out


def _known(y: Any, n: int) -> Known:
    if type(y) is IntervalDual:
        return known_of(y)
    if is_finite_number(y):
        return constant(y, n)
    raise UnsupportedError("the function returns something that is not a finite number")


def jacobian_blocks(
    function: Callable[[Any], Any], lower: Array, upper: Array, n: int, more: str = "growth"
) -> tuple[Array, Array]:
    """Bounds of the Jacobians of one function at many nodes, each on a box of its own.

    Costs one call of the function, and for each of its operations a few passes over arrays of N (1 + n) numbers.

    Parameters
    ----------
    function : callable
        Takes m quantities, of which it may take rows only (`x[0]`, `for row in x`), each for all nodes; returns a
        quantity, or several, a list or an array of rows.  Made of arithmetic, of functions that numpy applies entry by
        entry, and of numbers or arrays of shape (N,), one for each node.
    lower, upper : ndarray, shape (m, N)
        Bounds of the m quantities at each of N nodes.
    n : int
        Derivatives are by the first n quantities.
    more : {"growth", ""}
        Relative growth sharpens the bounds, and takes three times as long.

    Returns
    -------
    low, high : ndarray, shape (N, k, n)
        Proven: every Jacobian of the k values at a node, for quantities between its bounds, lies between them.

    Raises
    ------
    UnboundedError, UnsupportedError

    Examples
    --------
    >>> low, high = jacobian_blocks(lambda x: [x[1] / (1 + x[1]) - x[0]], np.zeros((2, 3)), np.ones((2, 3)), 2)
    >>> low.shape, low[0].tolist(), high[0].tolist()
    ((3, 1, 2), [[-1.0, 0.25]], [[-1.0, 1.0]])
    """
    return values_and_blocks(function, lower, upper, n, more)[2:]


def values_and_blocks(
    function: Callable[[Any], Any], lower: Array, upper: Array, n: int, more: str = ""
) -> tuple[Array, Array, Array, Array]:
    """Bounds of the values, shape (N, k) each, and then those of `jacobian_blocks`."""
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    values = [_known(y, n) for y in _called(function, Rows, _arguments(lower, upper, n, more), lower, upper)[0]]
    count = lower.shape[1]
    ends = ([np.broadcast_to(y.value[side], count) for y in values] for side in (0, 1))
    slopes = ([np.broadcast_to(y.gradient[side], (count, n)) for y in values] for side in (0, 1))
    below, above = (np.stack(end, axis=-1) for end in ends)
    low, high = (np.stack(slope, axis=1) for slope in slopes)
    return below, above, low, high


def on_pieces(
    function: Callable[[Any], Any],
    lower: Array,
    upper: Array,
    n: int,
    pieces: int = 1,
    turned: Callable[..., tuple[Array, Array, Array, Array]] = lambda *found: found,
    more: str = "",
) -> tuple[Array, Array, Array, Array]:
    """What `turned` makes of what `values_and_blocks` returns, with the box of every node cut into at most `pieces`
    boxes: the smallest bounds that hold those of all pieces.  Only quantities on which slopes depend are cut, all into
    as many parts.
    """
    whole = values_and_blocks(function, lower, upper, n, more if pieces == 1 else "")
    sides = [i for i in range(len(lower)) if pieces > 1 and _bends(function, lower, upper, n, i, whole)]
    parts = int(pieces ** (1 / len(sides)) + 1e-9) if sides else 1
    if parts < 2:
        return turned(*(whole if pieces == 1 or not more else values_and_blocks(function, lower, upper, n, more)))
    edges = np.clip(np.linspace(lower, upper, parts + 1), lower, upper)
    edges[0], edges[-1] = lower, upper
    ends: list[Array] = []
    for cell in np.ndindex(*[parts] * len(sides)):
        low, high = lower.copy(), upper.copy()
        for i, k in zip(sides, cell, strict=True):
            low[i], high[i] = edges[k][i], edges[k + 1][i]
        found = turned(*values_and_blocks(function, low, high, n, more))
        joined = zip(ends, found, (np.minimum, np.maximum) * 2, strict=True)
        ends = [join(a, b) for a, b, join in joined] if ends else list(found)
    return ends[0], ends[1], ends[2], ends[3]


def _bends(function: Callable[[Any], Any], lower: Array, upper: Array, n: int, side: int, whole: Any) -> bool:
    """Whether slopes depend on a quantity, as seen in the middle of its bounds."""
    low, high = lower.copy(), upper.copy()
    low[side] = high[side] = 0.5 * lower[side] + 0.5 * upper[side]
    found = values_and_blocks(function, low, high, n)
    return any((a != b).any() for a, b in zip(found[2:], whole[2:], strict=True))


def jacobian_enclosure(
    function: Callable[[Any], Any], lower: Sequence[float] | Array, upper: Sequence[float] | Array
) -> tuple[Array, Array]:
    """Bounds of the Jacobian of a function on a box.

    Parameters
    ----------
    function : callable
        Takes an object array of n quantities, returns n quantities; made of arithmetic and elementary
        functions.
    lower, upper : array_like, shape (n,)

    Returns
    -------
    low, high : ndarray, shape (n, n)
        Proven: every Jacobian on the box lies between them.

    Raises
    ------
    UnboundedError, UnsupportedError

    Examples
    --------
    >>> low, high = jacobian_enclosure(lambda x: [x[1], -np.sin(x[0])], [-1, 0], [1, 0])
    >>> bool(low[1, 0] <= -1 and high[1, 0] >= -np.cos(1)), low[0].round(3), high[0].round(3)
    (True, array([0., 1.]), array([0., 1.]))
    """
    return _ends(values_on_box(function, lower, upper, len(lower), "growth")[0])


def _ends(values: list[Known]) -> tuple[Array, Array]:
    return np.array([y.gradient[0] for y in values]), np.array([y.gradient[1] for y in values])


def enclosed_jacobian(function: Callable[[Any], Any], box: Array, n: int, *, kinks: bool = True) -> tuple[Array, Array]:
    """Midpoint and radius of the Jacobian with respect to the first n quantities."""
    return _around(*_bounds(function, box, n, kinks=kinks))


def _bounds(function: Callable[[Any], Any], box: Array, n: int, *, kinks: bool = True) -> tuple[Array, Array]:
    values, watch = values_on_box(function, box[:, 0], box[:, 1], n)
    if watch.met_kink and (box[:, 0] == box[:, 1]).all() and not kinks:
        raise UnboundedError("the derivative may not exist at this point")
    low, high = _ends(values)
    if low.shape[0] != n:
        raise ShapeError(f"the system's update function returned {low.shape[0]} values for {n} states.")
    return low, high


def _in_second_order(function: Callable[[Any], Any], box: Array, n: int) -> tuple[Bounds, Bounds]:
    """The Jacobian with respect to the first n quantities, by relative growth too, and its derivatives by all."""
    m = len(box)
    values, _ = values_on_box(function, box[:, 0], box[:, 1], m, "growth and bends")
    none = np.zeros((m, m)), np.zeros((m, m))
    first, second = _ends(values), tuple(np.array([(y.bend or none)[side][:n] for y in values]) for side in (0, 1))
    return (first[0][:, :n], first[1][:, :n]), (second[0], second[1])


def sharper_jacobian(function: Callable[[Any], Any], box: Array, n: int) -> tuple[Array, Array]:
    """Midpoint and radius of the Jacobian, by second derivatives and the ends of the box."""
    return _around(
        *sharper(
            lambda face: _bounds(function, face, n),
            lambda whole: _in_second_order(function, whole, n),
            box,
            _bounds(function, box, n),
        )
    )


def _around(low: Array, high: Array) -> tuple[Array, Array]:
    """Midpoint and radius."""
    centre = 0.5 * low + 0.5 * high
    exact = low == high
    radius = np.nextafter(np.maximum(np.nextafter(centre - low, np.inf), np.nextafter(high - centre, np.inf)), np.inf)
    # An end that is exactly zero stays exactly zero: h'J x >= 0 may hold with equality there.
    at_zero = ((low == 0) | (high == 0)) & ~exact
    centre = np.where(exact, low, np.where(at_zero, 0.5 * (low + high), centre))
    return centre, np.where(exact, 0.0, np.where(at_zero, np.abs(centre), radius))


def jacobian_pieces(
    function: Callable[[Any], Any],
    whole: Array,
    n: int,
    decided: Callable[[Array, Array], bool],
    most: int,
    late: Callable[[int], bool] = lambda _: False,
) -> Iterator[tuple[Array, Array]]:
    """Enclosures on at most `most` boxes that cover `whole`, cut in two where `decided` says no, until it is late.

    `late` is called with the number of boxes that wait.
    """
    waiting, produced = [(whole, 0)], 0
    sides = np.flatnonzero(whole[:, 1] > whole[:, 0])
    patience = _PATIENCE
    while waiting:
        box, depth = waiting.pop()
        final = produced + len(waiting) + 1 >= most or not sides.size or late(len(waiting) + 1)
        try:
            centre, radius = enclosed_jacobian(function, box, n)
        except UnboundedError as error:
            if final or depth >= _DEEPEST:
                corner = ", ".join(f"[{a}, {b}]" for a, b in box)
                raise DataError(
                    f"the enclosed Jacobian is unbounded on region {corner}: {error}; choose a smaller region."
                ) from None
            waiting += _halves(box, sides, depth)
            continue
        is_decided = decided(centre, radius)
        if not is_decided and patience > 0 and not late(len(waiting) + 1 + FACES):
            centre, radius = sharper_jacobian(function, box, n)
            is_decided = decided(centre, radius)
            patience += _PATIENCE if is_decided else -1
        if final or is_decided:
            produced += 1
            yield centre, radius
            continue
        if depth == 0 and not late(1 + 3 * len(sides)):
            sides = _that_matter(function, box, n, sides)
        waiting += _halves(box, sides, depth)


def _that_matter(function: Callable[[Any], Any], box: Array, n: int, sides: NDArray[np.intp]) -> NDArray[np.intp]:
    """The sides that the enclosed Jacobian depends on, as seen at both ends and the middle; all, if none does."""
    whole = enclosed_jacobian(function, box, n)

    def matters(side: int) -> bool:
        for place in (box[side, 0], 0.5 * box[side, 0] + 0.5 * box[side, 1], box[side, 1]):
            flat = box.copy()
            flat[side] = place
            try:
                if any((a != b).any() for a, b in zip(whole, enclosed_jacobian(function, flat, n), strict=True)):
                    return True
            except UnboundedError:
                return True
        return False

    chosen = [side for side in sides if matters(side)]
    return np.array(chosen) if chosen else sides


def _halves(box: Array, sides: NDArray[np.intp], depth: int) -> list[tuple[Array, int]]:
    """Cut the sides in turns, so that no direction is favoured by its units."""
    side = int(sides[depth % len(sides)])
    middle = 0.5 * box[side, 0] + 0.5 * box[side, 1]
    first, second = box.copy(), box.copy()
    first[side, 1] = second[side, 0] = middle
    return [(second, depth + 1), (first, depth + 1)]


def jacobian_by_differences(function: Callable[[Array], Array], point: Array, box: Array) -> Array:
    """Jacobian with respect to the first len(box) quantities, by differences inside the box: no enclosure.

    Beside the box only where a side has no length: nothing can be seen inside it.
    """
    columns = []
    with np.errstate(all="ignore"):
        for i, (low, high) in enumerate(box):
            step = 1e-6 * max(1.0, abs(low), abs(high))
            ahead, behind = point.copy(), point.copy()
            ahead[i], behind[i] = point[i] + step, point[i] - step
            if high > low:
                ahead[i], behind[i] = min(ahead[i], high), max(behind[i], low)
            columns.append((function(ahead) - function(behind)) / (ahead[i] - behind[i]))
    return np.column_stack(columns)


def box_points(box: Array, count: int) -> Iterator[Array]:
    """The centre, corners and random points of a box."""
    yield 0.5 * box[:, 0] + 0.5 * box[:, 1]
    rng = np.random.default_rng(0)
    corners = min(2 ** len(box), count // 2)
    for k in range(corners):
        pick = [(k >> i) & 1 for i in range(len(box))] if corners == 2 ** len(box) else rng.integers(0, 2, len(box))
        yield box[np.arange(len(box)), pick]
    for _ in range(count - corners):
        weight = rng.random(len(box))
        yield np.clip((1 - weight) * box[:, 0] + weight * box[:, 1], box[:, 0], box[:, 1])
