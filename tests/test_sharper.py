"""Second derivatives, relative growth and the ends of boxes: enclosures hold, and modellers' functions are decided."""

from __future__ import annotations

import control as ct
import numpy as np
import pytest
import scipy.special
from hypothesis import given, settings
from hypothesis import strategies as st

import control_kpos as kp
from control_kpos.exact.bends import OF
from control_kpos.exact.functions import NAMED
from control_kpos.exact.jacobians import _in_second_order, jacobian_enclosure, sharper_jacobian

MORE = {
    "product": lambda x, y: x * y * (1 + x),
    "quotient": lambda x, y: (x + x * y) / (1 + x + x**2 + y),
    "lines": lambda x, y: (2 - x) / (3 + 2 * x) * y,
    "powers": lambda x, y: x**3 - y**2.5 + x**1.5 * y + (1 + x) ** -2 - (y + 0.01) ** 0.75,
    "hypot": lambda x, y: np.hypot(x - 1, y) + np.hypot(3, y),
    "logaddexp": lambda x, y: np.logaddexp(x, 2 * y) - np.logaddexp2(y, x),
    "larger": lambda x, y: np.maximum(x, 0.5) * y + abs(y - 1) * np.minimum(x, 9),
    "where": lambda x, y: np.where(x > 0.5, x * x + y, x + y - 0.25) * y,
    "exponential": lambda x, y: x**2 * np.exp(-x) * y,
    "arctan2": lambda x, y: np.arctan2(x, 1 + y),
    "bell": lambda x, y: np.exp(-((x - y) ** 2)) / (2 + np.cos(x)),
    "roots": lambda x, y: np.sqrt(x + 0.1) * np.cbrt(y + 0.1) - x ** (1 / 3 + 1),
    "negative": lambda x, y: -((1 + x * y) ** 2) / (1 + y) - np.expm1(-x),
    "absent": lambda x, y: 3.0 * y - y + 0 * x,
    "variable power": lambda x, y: (1 + x) ** (0.5 + y),
}
for _name in sorted(NAMED):
    _shift = 1.2 if _name == "arccosh" else 0.05
    _scale = 0.4 if _name in ("arcsin", "arccos", "arctanh", "tan") else 1.0
    _function = scipy.special.expit if _name == "expit" else getattr(np, _name)
    MORE[_name] = lambda x, y, f=_function, a=_shift, s=_scale: f(s * x + a) * y + f(s * (x * y) / (1 + x * y) + a)


@pytest.mark.parametrize("name", MORE)
@settings(max_examples=8)
@given(st.integers(0, 10**6), st.sampled_from([0.0, 1e-3, 0.2, 0.9]))
def test_bounds_of_first_and_second_derivatives(name, seed, width):
    """Against quotients of differences at points of the box, and against the plain enclosure."""

    def f(x):
        return [MORE[name](x[0], x[1])]

    rng = np.random.default_rng(seed)
    low = np.where(rng.random(2) < 0.3, 0.0, rng.uniform(0, 1, 2))
    box = np.column_stack([low, low + width])
    (a, b), (fall, rise) = _in_second_order(f, box, 2)
    plain = jacobian_enclosure(f, *box.T)
    assert (plain[0] - 1e-12 <= a + 1e-12 * abs(a)).all() and (b - 1e-12 * abs(b) <= plain[1] + 1e-12).all()
    centre, radius = sharper_jacobian(lambda x: [*f(x), 0.0], box, 2)
    assert (radius[0] <= (plain[1] - plain[0])[0] + 1e-12 * (1 + np.abs(centre[0]))).all()
    x = low + (0.01 + 0.98 * rng.random(2)) * width
    step = 1e-5
    if (x < 1e-3).any() or (np.abs(x - 0.5) < 1e-4).any() or (np.abs(x - 1) < 1e-4).any():
        return  # beside a kink, or an end of the domain
    at = [[float(MORE[name](*(x + step * np.array([i, j])))) for j in (-1, 0, 1)] for i in (-1, 0, 1)]
    slope = np.array([at[2][1] - at[0][1], at[1][2] - at[1][0]]) / (2 * step)
    room = 1e-5 * (1 + np.abs(slope))
    assert (a[0] <= slope + room).all() and (slope - room <= b[0]).all()
    assert (centre[0] - radius[0] <= slope + room).all() and (slope - room <= centre[0] + radius[0]).all()
    bend = np.array(
        [
            [at[2][1] - 2 * at[1][1] + at[0][1], (at[2][2] - at[2][0] - at[0][2] + at[0][0]) / 4],
            [(at[2][2] - at[2][0] - at[0][2] + at[0][0]) / 4, at[1][2] - 2 * at[1][1] + at[1][0]],
        ]
    )
    bend = bend / step**2
    room = 1e-3 * (1 + np.abs(bend))
    assert (fall[0] <= bend + room).all() and (bend - room <= rise[0]).all()


def test_every_function_has_a_second_derivative():
    assert set(OF) == set(NAMED)


# Functions that rise on a range of x >= 0 and on [0, 1] in y, and how many boxes may show it.
RISING = {
    "Michaelis and Menten": (lambda x, y: x / (1 + x), 100, 1),
    "Hill, 2": (lambda x, y: x**2 / (1 + x**2), 10, 1),
    "Hill, 4": (lambda x, y: x**4 / (2.0**4 + x**4), 20, 1),
    "Hill, 2.5": (lambda x, y: (x / 2) ** 2.5 / (1 + (x / 2) ** 2.5), 20, 1),
    "with x and x^2": (lambda x, y: x**2 / (1 + x + x**2), 10, 1),
    "with x and x^3": (lambda x, y: x**3 / (1 + x + x**3), 10, 1),
    "sum of both": (lambda x, y: (x + x**2) / (1 + x + x**2), 10, 1),
    "inhibited": (lambda x, y: x / (1 + x + (1 - y)), 10, 1),
    "competing": (lambda x, y: x / (x + 1 + (1 - y) / 2), 10, 1),
    "by substrate": (lambda x, y: x / (1 + x + x**2), 0.999, 8),
    "Beddington and DeAngelis": (lambda x, y: x * y / (1 + x + y), 3, 1),
    "two substrates": (lambda x, y: x / (1 + x) * y / (1 + y), 10, 1),
    "and": (lambda x, y: x**2 * y**2 / (1 + x**2 + y**2 + x**2 * y**2), 4, 1),
    "Ricker": (lambda x, y: x * np.exp(-x), 0.999, 2),
    "Ricker, squared": (lambda x, y: x**2 * np.exp(-x), 1.99, 1),
    "Beverton and Holt, squared": (lambda x, y: x / (1 + x) ** 2, 0.999, 8),
    "logistic growth": (lambda x, y: x * (1 - x / 10), 4.99, 1),
    "Monod, Wyman, Changeux": (
        lambda x, y: (x * (1 + x) ** 3 + x * (1 + x / 10) ** 3) / ((1 + x) ** 4 + 10 * (1 + x / 10) ** 4),
        5,
        96,
    ),
    "Adair": (lambda x, y: x * (1 + 2 * x) / (1 + 2 * x + x**2), 10, 64),
    "logarithm": (lambda x, y: np.log(1 + x) / (1 + x), 1.7, 8),
    "sine": (lambda x, y: x * np.sin(x), 2.0, 4),
    "saturated": (lambda x, y: x * np.tanh(x) + np.arctan(x) * y, 5, 1),
    "soft": (lambda x, y: np.logaddexp(0, x) * y, 5, 1),
    "swish": (lambda x, y: x / (1 + np.exp(-x)), 6, 1),
    "bell": (lambda x, y: np.exp(-((x - 5) ** 2) / 8), 4.99, 1),
    "root": (lambda x, y: np.sqrt(1 + x**2) - 1, 5, 1),
}


@pytest.mark.parametrize("name", RISING)
def test_functions_of_modellers_are_decided(name):
    f, reach, most = RISING[name]
    system = ct.nlsys(lambda t, x, u, p: [-x[0], -x[1], f(x[0], x[1]) - x[2]], inputs=0, states=3)
    region = [[0, reach], [0, 1], [0, 50]]
    cert = kp.differential_positivity(system, kp.orthant(3), region)
    assert cert and cert.source == "enclosed" and cert.centres.shape[0] <= most
    falling = ct.nlsys(lambda t, x, u, p: [-x[0], -x[1], -f(x[0], x[1]) - x[2]], inputs=0, states=3)
    assert kp.differential_positivity(falling, kp.orthant(3), region).status is kp.Status.REFUTED


def test_a_slope_that_turns_negative_is_refuted():
    for f, reach in ((lambda x: x * np.exp(-x), 1.01), (lambda x: x / (1 + x**2), 1.02), (lambda x: x**3 - x**2, 0.9)):
        system = ct.nlsys(lambda t, x, u, p, f=f: [-x[0], f(x[0]) - x[1]], inputs=0, states=2)
        cert = kp.differential_positivity(system, kp.orthant(2), [[0, reach], [0, 1]])
        assert cert.status is kp.Status.REFUTED and cert.check()


def test_nothing_follows_from_growth_where_a_variable_is_zero():
    """x f' = g f says nothing of f' where x is zero and stays so."""
    for f, slope in (
        (lambda x: (1 - x[0]) ** 2, -2.0),
        (lambda x: 1 / (2 + x[0]), -0.25),
        (lambda x: np.cos(1 + x[0]), -np.sin(1)),
    ):
        (a, b), _ = _in_second_order(lambda x, f=f: [f(x)], np.array([[0.0, 0.0], [0.0, 1.0]]), 2)
        assert a[0, 0] <= slope <= b[0, 0]
    (a, b), _ = _in_second_order(lambda x: [np.tan(x[0])], np.array([[2.0, 2.5], [0.0, 1.0]]), 2)
    assert a[0, 0] <= 1 / np.cos(2.5) ** 2 and b[0, 0] >= 1 / np.cos(2.0) ** 2
    for region in ([[-1.0, 0.0], [0, 1]], [[-1.0, 1.0], [0, 1]]):
        (a, b), _ = _in_second_order(lambda x: [x[0] * x[1] / (3 + x[0]), x[0] ** 2 * x[1]], np.array(region), 2)
        assert b[0, 1] >= 0 and a[0, 1] <= -0.5 and a[1, 0] <= -2 and a[1, 1] == 0 and b[1, 1] >= 1


def test_unbounded_slopes_name_the_states():
    unbounded = [
        (lambda x: np.cbrt(x[1] - x[0]), r"cube root .*depends on x\[0\], x\[1\]"),
        (lambda x: 1 / x[1], r"zero .*x\[1\]"),
    ]
    for f, text in unbounded:
        system = ct.nlsys(lambda t, x, u, p, f=f: [-x[0], f(x) - x[1]], inputs=0, states=2)
        with pytest.raises(kp.DataError, match=text):
            kp.differential_positivity(system, kp.orthant(2), [[-1, 1.1], [-1, 1.3]])


def test_a_region_without_an_equilibrium_is_promised_none():
    away = ct.nlsys(lambda t, x, u, p: [1 + x[1] / (1 + x[0] + x[1]), 1 + x[0] / (1 + x[0])], inputs=0, states=2)
    cert = kp.differential_positivity(away, kp.orthant(2), [[1, 2], [1, 2]])
    text = cert.explain()
    assert cert.status is not kp.Status.REFUTED and ("equilibrium" not in text or "that stays in the region" in text)
    drift = ct.nlsys(lambda t, x, u, p: [5 - x[0] + x[1] / 4, 5 - x[1] + x[0] / 4], inputs=0, states=2)
    cert = kp.differential_positivity(drift, kp.orthant(2), [[0, 1], [0, 1]])
    assert cert and "equilibrium" not in cert.explain() and "while they remain in the region" in cert.explain()
