"""What objects show in a notebook."""

import numpy as np
import pytest

import control_kpos as kp
from control_kpos.cards import card, shown_rows


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
