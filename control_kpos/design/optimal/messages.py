"""What stands in the way of an optimal feedback: which assumption fails, where, and what would do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...cards import floored
from ...errors import DataError
from ...exact.condition import Condition
from .problem import CONTROL, COSTS, DISTURBANCE, KEPT, LIMITS, LinearCost


def obstacle(problem: LinearCost, conditions: Sequence[Condition]) -> str:
    """What does not hold of the assumptions that are needed; an error for data that mean nothing."""
    found = {condition.name: condition for condition in conditions}
    at = found[LIMITS].worst_violation()
    if at is not None:
        first = int(np.count_nonzero(problem.kinds != DISTURBANCE))
        name = f"limits[{at[0]}]" if at[0] < first else f"disturbance M[{at[0] - first}]"
        raise DataError(f"{name} is negative at generator {at[1]} of X; |u| <= l'x needs l'x >= 0 on X.")
    costs = found.get(COSTS)
    at = None if costs is None else costs.worst_violation()
    if costs is not None and at is not None and float(costs.forms.values[at]) < 0:
        raise DataError(f"the cost is negative at generator {at[1]} of X {_dear(problem, at[1])}")
    if found[KEPT].verdict() is not True:
        return _leaves(problem, found[KEPT])
    if costs is not None and costs.verdict() is not True:
        where = "some state" if at is None else f"generator {at[1]} of X"
        return f"the cost of some admissible input at {where} is 0; bounds from below need s'x + r'u > 0, so raise s."
    return ""


def _dear(problem: LinearCost, generator: int) -> str:
    """Which inputs earn more than the state costs, and the limits that would do."""
    x = problem.rays[np.array([generator])].dense()
    sizes = problem.limits.values @ np.asarray(x.values)[0]
    earning = np.flatnonzero((problem.best(np.asarray(problem.r.values))[0] < 0) & (sizes > 0))
    (state,), r = problem.s.fractions() @ x.fractions()[0], problem.r.fractions()[0]
    if state <= 0 or not earning.size:
        return "for some admissible input; raise s, or lower |r|."
    free = problem.kinds[earning] == CONTROL
    most = [max(abs(v) if f else -v for v in r[problem.owner == g]) for g, f in zip(earning, free, strict=True)]
    inputs = np.flatnonzero(np.isin(problem.owner, earning) & ((r < 0) | (problem.kinds[problem.owner] == CONTROL)))
    allowed = problem.limits[earning].dense().fractions() @ x.fractions()[0]
    return (
        f"for some choice of inputs {', '.join(map(str, inputs))}. Raise s, lower |r|, or choose limits there that "
        f"are less than {floored(state / (allowed @ most), 3)} times as large."
    )


def _leaves(problem: LinearCost, kept: Condition) -> str:
    """Which facet, generator and inputs, and the limits that would do."""
    at = kept.worst_violation()
    if at is None:
        return "whether every admissible input keeps X could not be proven at this size."
    h, x, here, inputs = problem.near(at[0], at[1])
    place = f"facet {at[0]} at generator {at[1]}"
    rests, y = h @ here.A.fractions() @ x, h @ here.B.fractions()
    worst = here.worst(y[None])[0] * (here.limits.fractions() @ x)
    disturbed = here.kinds == DISTURBANCE
    left, pushed = rests + worst[disturbed].sum(), -worst[~disturbed].sum()
    if rests < 0:
        return f"x leaves X through {place} without any input; choose another cone, or a first feedback."
    if left < 0:
        return f"a disturbance may push x out of X, through {place}; choose smaller limits M, or another cone."
    acting = ((worst < 0) & ~disturbed)[here.owner] & ((y < 0) | (here.kinds[here.owner] == CONTROL))
    names = ", ".join(str(i) for i in inputs[acting])
    inwards = (y[acting] >= 0).all()  # as long as they are not negative
    way = " or give groups= if they are never negative: then they push nothing out there;" if inwards else ""
    if left == 0:
        return (
            f"inputs {names} may push x out of X, through {place}; set their limits to 0 there,{way} or choose another "
            "cone."
        )
    return (
        f"inputs {names} may push x out of X, through {place}. Limits {floored(left / pushed, 3)} times as large there "
        f"would do;{way} or choose another cone."
    )
