"""What objects show: numbers to the safe side, and cards in a notebook."""

import math
import random
import re
import warnings
from dataclasses import replace
from fractions import Fraction

import control as ct
import numpy as np
import pytest
from certified import CERTIFICATES, FOR_THE_PACKAGE, LINE

import control_kpos as kp
from control_kpos.cards import about, card, floored, raised, shown, shown_rows
from control_kpos.design.certificates import FeedbackCertificate

# -- numbers


def numbers(count):
    """Doubles of any size, fractions with long parts, decimals that doubles miss, and numbers next to round ones."""
    rng = random.Random(7)
    for _ in range(count):
        yield math.ldexp(rng.uniform(-1, 1), rng.randint(-1074, 1024))
        yield rng.uniform(-2, 2)
        yield Fraction(rng.randint(-(10**40), 10**40), rng.randint(1, 10 ** rng.randint(1, 400)))
        near = round(rng.uniform(-10, 10), rng.randint(0, 7))
        yield from (near, math.nextafter(near, math.inf), math.nextafter(near, -math.inf))
    yield from (0.0, -0.0, 5e-324, -5e-324, 1.7976931348623157e308, Fraction(10**400, 3), Fraction(1, 10**400), 1, -7)


@pytest.mark.parametrize("digits", [1, 3, 6, 12])
def test_numbers_are_printed_to_the_safe_side_and_close_by(digits):
    for x in numbers(500):
        low, high = Fraction(floored(x, digits)), Fraction(raised(x, digits))
        assert low <= Fraction(x) <= high, x
        assert high - low <= 10 * max(abs(low), abs(high)) / 10**digits, x
        assert len(re.sub(r"e.*|[-.]", "", floored(x, digits)).strip("0")) <= digits


@pytest.mark.parametrize("text", ["0.5", "-0.25", "100", "123456", "1e+06", "3e+20", "0", "inf", "-inf"])
def test_numbers_that_fit_are_printed_as_they_are(text):
    assert floored(float(text)) == raised(float(text)) == about(float(text)) == text


def test_rounded_numbers_say_about():
    assert about(Fraction(1, 3), digits=2) == "about 0.33"
    assert about(Fraction(1, 10)) == about(0.1) == "0.1"
    assert about(Fraction(0.1)) == "about 0.1"
    assert shown(np.array([1.0, 0.5, -2.0])) == "(1, 0.5, -2)"
    assert shown(np.arange(8) / 3) == "about (0, 0.3333, 0.6667, 1, 1.333, 1.667, ...)"


# what is promised in which words, by the attribute that holds it, and the side to which it may be rounded
NUMBER = r"(-?\d+(?:/\d+)?(?:\.\d+)?(?:e[-+]\d+)?)"
PROMISES = {
    rf"decreases at least as exp\(-{NUMBER} t\)": ("decay_rate", -1),
    rf"decreases at least as \(1 - {NUMBER}\)\^k": ("decay_rate", -1),
    rf"No rate above {NUMBER} is possible": ("decay_rate_bound", 1),
    rf"with decay rate at least {NUMBER} per": ("decay_rate", -1),
    rf"less {NUMBER} V\(x\)": ("decay_rate", -1),
    rf"lies in \[{NUMBER}, ": ("lower", -1),
    rf"lies in \[.*, {NUMBER}\]": ("upper", 1),
    rf"with a decay rate of at least {NUMBER}\.": ("decay_rate", -1),
    rf"differ by at most {NUMBER} of": ("gap", 1),
    rf"by at most {NUMBER} of it\.": ("gap", 1),
    rf"gain from w to z is below {NUMBER}:": ("gamma", 1),
    rf"stays below {NUMBER} from rest": ("gamma", 1),
    rf"is at most \[{NUMBER}\] at every": ("bound", 1),
    rf"a decay rate above {NUMBER}": ("rate", 1),
    rf"growth rate at least {NUMBER}\)": ("witness.rate", -1),
    rf"at a rate of at most {NUMBER}": ("witness.rate", 1),
    rf"decreases at rate {NUMBER} on": ("required_rate", 1),
    rf"lies to the right of {NUMBER}\b": ("witness.bound", 1),
    rf"none beyond {NUMBER}\)": ("witness.bound", 1),
    rf"stable with decay rate at least {NUMBER}\.": ("decay_rate", -1),
    rf"a node(?: \(or .* enter a node\))? is at most {NUMBER},": ("_largest_sum", -1),
    rf"<= {NUMBER} r'K y": ("weight", -1),
}
# numbers of definitions, which are exact
EXACT = r"every \|w_i\(t\)\| is at most 1,|the spectral radius is at least 1\."


def held(certificate, names):
    if names == "decay_rate" and getattr(certificate, "required_rate", None) is not None:
        return certificate.required_rate
    for name in names.split("."):
        certificate = getattr(certificate, name)
    return Fraction(certificate.item() if isinstance(certificate, np.ndarray) else certificate)


def wrong_promises(certificate):
    """Numbers on the wrong side, and promises that nobody compared."""
    parts = certificate.parts() if isinstance(certificate, FeedbackCertificate) else (certificate,)
    rest = re.sub(EXACT, "", certificate.explain())
    for pattern, (name, side) in PROMISES.items():
        rest = re.sub(pattern, "", rest)
        for part in parts:
            for found in re.finditer(pattern, part.explain()):
                if side * (Fraction(found[1]) - held(part, name)) < 0:
                    yield found[0], name
    yield from re.findall(r"(?:at least|at most|above|below|beyond|to the right of) [\[(]?-?\d.*", rest)


@pytest.mark.parametrize("name", sorted({*CERTIFICATES, *FOR_THE_PACKAGE}))
def test_certificates_promise_no_more_than_they_hold(name):
    assert not list(wrong_promises((CERTIFICATES | FOR_THE_PACKAGE)[name]()))


def long_numbers():
    """Certificates whose numbers have more digits than are printed, most of them just off a round one."""
    slow, node = 1 - 2.0**-30, kp.ConeStateSpace([[-1]], [[1]], [[1]], 0)
    ring, plant = kp.feedback_interconnect([node] * 2, [[0, 4e-5], [4e-5, 0]]), kp.examples.mass_spring()
    yield kp.linear_lyapunov([[-slow]], LINE)
    yield kp.linear_lyapunov([[1 - slow]], LINE, discrete=True)
    yield kp.linear_lyapunov([[-1 - 2.0**-30]], LINE, rate="max")
    yield kp.linear_lyapunov([["-1/3", "1/7"], ["2/9", "-1/3"]], kp.orthant(2), rate="max")
    yield kp.linear_lyapunov([["-1/3", "1/7"], ["2/9", "-1/3"]], kp.orthant(2), rate="0.2000000001")
    yield kp.linear_lyapunov([[-1]], LINE, rate="0.99999999999999999")
    yield kp.network_feedback([node], [[0]], rate="0.99999999999999999").certificate
    yield kp.scale_free_feedback(node, 0, rate="0.99999999999999999").certificate
    yield kp.state_feedback(node, vertices=[([[-slow]], [[0]]), ([[-1]], [[0]])]).certificate
    yield kp.optimal_feedback(node, [1], [0], [["1/3"]]).certificate
    yield kp.dissipativity([[-slow]], [[1]], [[1]], [[0]], LINE, LINE, LINE, q=[0], r=[2])
    yield from (ring.certificate, ring.abscissa_certificate(), CERTIFICATES["network interval"]())
    yield kp.feedback_interconnect([node] * 2, [[0, 1.0003333], [1.0003333, 0]]).certificate
    yield kp.state_feedback(kp.ConeStateSpace(*plant), rate="1/3", X=kp.orthant(2)).certificate
    for shape in ([["1/3", 1], [-1, "1/3"]], [["1/3", 1, 0], [-1, "1/3", 0], [0, 0, "1/7"]]):
        yield kp.find_cone(shape).certificate
    yield kp.find_cone([["-1/3", 0], [0, "1/7"]], discrete=True).certificate
    yield kp.scale_free_certificate(node, weight="2/3", link=[["1/7"]])
    yield kp.scale_free_certificate(kp.ConeStateSpace([[-3]], [[1, 1]], [[1], [1]], 0), weight="2/3")


def test_numbers_with_many_digits_are_promised_to_the_safe_side():
    texts = ""
    for certificate in long_numbers():
        assert not list(wrong_promises(certificate)), certificate.explain()
        texts += certificate.explain()
    unseen = {pattern for pattern in PROMISES if not re.search(pattern, texts)}
    assert {PROMISES[pattern][0] for pattern in unseen} <= {"gamma", "bound"}


def test_designs_promise_no_more_than_they_hold():
    plant = kp.ConeStateSpace(*kp.examples.mass_spring(), X=kp.examples.paper_cone())
    design = kp.state_feedback(plant, rate=1)
    for x in (2 / 3, 1 - 2.0**-40, 0.8):
        told = replace(design, certified_fraction=x, decay_rate=x, value=x)
        text = told.explain()
        assert Fraction(re.search(rf"actuators at {NUMBER} %", text)[1]) >= 100 * Fraction(x)
        rates = re.search(rf"Decay rate {NUMBER}\. ", text)[1], re.search(rf"decay rate {NUMBER}>", repr(told))[1]
        assert all(Fraction(rate) <= x for rate in (*rates, dict(told.facts())["decay rate"]))
        assert ("about" in repr(told)) == (x != 0.8)


def test_bounds_on_gains_are_raised():
    plant = kp.ConeStateSpace(*kp.examples.mass_spring(), X=kp.examples.paper_cone())
    for demands in ({}, {"disturbance": ([[0], [1]], [[1, 0]])}):
        certificate = kp.state_feedback(plant, gain_bound=[100 / 3], **demands).certificate
        assert not list(wrong_promises(certificate))


def test_values_of_impulse_responses_are_exact_or_about():
    rng = np.random.default_rng(2)
    seen = 0
    for _ in range(60):
        A, b, c = rng.integers(-9, 10, (2, 2)) / 10, rng.integers(1, 9, 2) / 7, rng.integers(1, 10, 2) / 10
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            witness = kp.find_cone(ct.ss(A, b[:, None], c[None], 0, True)).obstruction
        if not hasattr(witness, "power"):
            continue
        M, x = ([[Fraction(a) for a in row] for row in part.tolist()] for part in (A, b[:, None]))
        for _ in range(witness.power):
            x = [[sum(m * y[0] for m, y in zip(row, x, strict=True))] for row in M]
        value = sum(Fraction(k) * y[0] for k, y in zip(c.tolist(), x, strict=True))
        assert witness.value == float(value) < 0
        printed = re.search(rf"c'A\^k b is (about )?{NUMBER} < 0", str(witness))
        assert printed[1] or float(printed[2]) == float(value)
        seen += 1
    assert seen > 5


# -- cards


def test_cards_escape_what_they_are_given():
    html = card("<a>", [("x < y", "1 & 2")], text="v'x > 0")
    assert "&lt;a&gt;" in html
    assert "x &lt; y" in html
    assert "1 &amp; 2" in html
    assert "v&#x27;x &gt; 0" in html


@pytest.mark.parametrize("status", ["PROVED", "REFUTED", "UNDECIDED"])
def test_verdicts_differ_in_more_than_colour(status):
    signs = {card("", status=s).split(">")[4][0] for s in ("PROVED", "REFUTED", "UNDECIDED")}
    assert len(signs) == 3
    assert status in card("", status=status)


def test_long_lists_are_cut():
    assert shown_rows(np.ones((2, 2))) == "(1, 1), (1, 1)"
    assert shown_rows(np.ones((100, 100))).count("...") == 9


def test_cones_show_generators_and_facets():
    html = kp.examples.paper_cone()._repr_html_()
    assert "2 generators" in html
    assert "(1, -2)" in html
    assert "(2, 1)" in html


def test_large_cones_show_a_summary():
    many = kp.product([kp.examples.paper_cone()] * 1_000_000)
    assert len(many._repr_html_()) < 1000
    assert len(kp.lorentz(6, facets=40)._repr_html_()) < 2000


def test_certificates_show_their_verdict_and_reasons():
    proved = kp.linear_lyapunov([[-2, 1], [1, -2]], kp.orthant(2))
    assert "PROVED" in proved._repr_html_()
    assert "decay rate" in proved._repr_html_()
    refuted = kp.state_positivity([[-2, -1], [1, -2]], kp.orthant(2))
    assert "REFUTED" in refuted._repr_html_()
    assert "facet 0" in refuted._repr_html_()


def test_designs_show_their_gain():
    plant = kp.ConeStateSpace(*kp.examples.mass_spring(), X=kp.examples.paper_cone())
    design = kp.state_feedback(plant)
    assert shown_rows(design.F) in design._repr_html_()
    assert "REFUTED" in kp.state_feedback(plant, X=kp.orthant(2))._repr_html_()


def test_a_million_nodes_show_a_summary_and_compute_nothing():
    A, B, C, D = kp.examples.mass_spring_nodes(100_000)
    net = kp.feedback_interconnect(kp.stack(A, B, C, D, X=kp.examples.paper_cone()), kp.examples.ring(len(A)))
    html = net._repr_html_()
    assert len(html) < 2000
    assert "100000" in html
    assert "certificate" not in vars(net)


def test_networks_show_their_verdict_once_it_is_known():
    net = kp.feedback_interconnect([kp.examples.mass_spring_node()] * 3, kp.examples.ring(3))
    assert net.certificate
    assert "PROVED" in net._repr_html_()
