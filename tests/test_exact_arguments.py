"""Every public argument that takes numbers keeps "1/3"."""

import dataclasses
import inspect
from fractions import Fraction

import exact_nonlinear
import exact_shards
import exact_systems
import numpy as np
import pytest
from exact_families import SWITCHED
from exact_plants import LAG, THIRD, THIRDS, after_one_step, plant, supplied
from test_house import METHODS, PUBLIC

import control_kpos as kp
from control_kpos.exact.matrix import Matrix

# -- every public argument
#
# A row for every argument of every public function and method: what "1/3" (or a matrix of such text) becomes, and the
# fraction that it has to be; or the reason why the argument holds no data of a proof.

CONE, SAME = [["1/3", "1/7"], [0, 1]], kp.PolyhedralCone([[7, 3], [0, 1]])
SIDE, SIDES, LINE, PLANE = [["1/3"]], [[THIRD]], kp.orthant(1), kp.orthant(2)
MINUS, TWO = [[-1, 0], [0, -1]], [[1, 0], [0, 1]]
MIXED, MIXED_SAME = [["-1", "1/3"], ["1/7", "-2"]], [[-1, THIRD], [Fraction(1, 7), -2]]
GAINED, LOSSY = [["1/3", 1], [1, -3]], kp.ConeStateSpace([["-1/3"]], SIDE, SIDE, 0)


def pair(**more):
    return {"A": [["-1/3"]], "B": SIDE, "C": SIDE, "D": [["1/9"]], "X": LINE, "U": LINE, "Y": LINE, **more}


def square(**more):
    return {"A": MINUS, "B": TWO, "C": TWO, "D": [[0, 0], [0, 0]], "X": PLANE, "U": PLANE, "Y": PLANE, **more}


def of_theorem(function, read=lambda certificate: certificate):
    """Rows of a function of A, B, C, D, X, U, Y; `read` finds the certificate of positivity."""
    rows = {
        name: lambda name=name, want=want: (getattr(read(function(**pair())), name), [[want]])
        for name, want in zip("ABCD", (-THIRD, THIRD, THIRD, Fraction(1, 9)), strict=True)
    }
    return rows | {
        name: lambda name=name: (getattr(read(function(**square(**{name: CONE}))), name), SAME) for name in "XUY"
    }


def gain_of(**data):
    """1/3 over 1/7 and so on: the gain is computed in doubles from exact data."""
    return kp.induced_gain(**data)


def in_range(weight):
    return kp.feedback_interconnect([LAG], [[weight]])


def best(**changes):
    given = {"sys": plant([[-1]]), "s": [1], "r": [0], "limits": [[0.125]]} | changes
    return kp.optimal_feedback(**given).certificate.problem


def kept(**changes):
    return kp.order_interval(**{"sys": plant([[-1]]), "w_max": ["1/7"]} | changes).certificate


def bounded(**bounds):
    return kp.state_feedback(plant([[-1, 0], [0, -1]]), **{"state_bounds": [1, 1]} | bounds).certificate.others[0]


def closed(design):
    return design.certificate.loops[0] if hasattr(design.certificate, "loops") else design.certificate


def loop_of(A, B, F):
    F = [Fraction(x) for x in np.ravel(F).tolist()]
    return [
        [Fraction(a) + Fraction(b[0]) * f for a, f in zip(row, F, strict=True)] for row, b in zip(A, B, strict=True)
    ]


def loop_row(design, A=GAINED, B=((1,), (0,))):
    d = design()
    return closed(d).A, loop_of(A, B, d.F)


def vertex_row(d, A=GAINED, B=((1,), (0,))):
    """The loop of the only vertex, which follows that of the system."""
    return d.certificate.loops[1].A, loop_of(A, B, d.F)


def design_rows(function, **more):
    p = plant(GAINED)
    return {
        "sys": lambda: loop_row(lambda: function(p, **more)),
        "X": lambda: (closed(function(plant(GAINED), X=CONE, **more)).X, SAME),
        "rate": lambda: (function(p, rate="1/3", **more).weakened_rate, THIRD),
    }


def at_most(bound, limit):
    return all(0 <= Fraction(limit) - Fraction(b) < Fraction(1, 10**14) for b in np.ravel(bound).tolist())


def network(**links):
    return kp.feedback_interconnect([LAG, LAG], [[0, "1/3"], ["1/4", 0]]).with_node(LAG, **links)


def couplings(net):
    return net.model.coupling


BOUNDS = {
    "state_bounds": lambda: (bounded(state_bounds=["1/3", 1]).exact[1], [THIRD, 1]),
    "input_bounds": lambda: (bounded(input_bounds="1/3").exact[-1], [THIRD] * 2),
    "disturbance_bounds": lambda: (bounded(disturbance_bounds=["1/3", 0]).exact[0], [THIRD, 0]),
}
EXACT = {
    "cone_positivity": of_theorem(kp.cone_positivity),
    "dissipativity": of_theorem(kp.dissipativity, lambda c: c.positivity)
    | {
        "q": lambda: (kp.dissipativity(**pair(), q=["-1/3"]).q_exact, [-THIRD]),
        "r": lambda: (kp.dissipativity(**pair(), r=["1/3"]).r_exact, [THIRD]),
    },
    "state_positivity": {
        "A": lambda: (kp.state_positivity([["-1/3"]], LINE).A, [[-THIRD]]),
        "X": lambda: (kp.state_positivity(MINUS, CONE).X, SAME),
    },
    "linear_lyapunov": {
        "A": lambda: (kp.linear_lyapunov([["-1/3"]], LINE).A, [[-THIRD]]),
        "X": lambda: (kp.linear_lyapunov(MINUS, CONE).X, SAME),
        "rate": lambda: (kp.linear_lyapunov([["-1/3"]], LINE, rate="1/3").required_rate, THIRD),
    },
    "find_cone": {
        "A": lambda: (kp.find_cone(plant(MIXED)).certificate.matrices, [MIXED_SAME]),
        "contains": lambda: (kp.find_cone(MINUS, contains=[["1/3", "1/7"]]).certificate.contains, [[THIRD, "1/7"]]),
        "within": lambda: (kp.find_cone(MINUS, within=[["1/3", "1/7"]]).certificate.within, [[THIRD, "1/7"]]),
    },
    "design_cone_and_feedback": {
        "sys": lambda: loop_row(lambda: kp.design_cone_and_feedback(plant(GAINED))),
        "vertices": lambda: vertex_row(kp.design_cone_and_feedback(plant([[0, 1], [1, -3]]), vertices=[plant(GAINED)])),
        "rate": lambda: (float(kp.design_cone_and_feedback(THIRDS, rate="1/3").certificate.decay_rate) >= 1 / 3, True),
    },
    "differential_positivity": {
        "jacobians": lambda: (
            kp.differential_positivity([plant(MIXED).exact.A, MIXED], PLANE).centres,
            [MIXED_SAME] * 2,
        ),
        "X": lambda: (kp.differential_positivity(MINUS, CONE).X, SAME),
    },
    "feedback_interconnect": {
        "systems": lambda: (kp.feedback_interconnect([plant([["-1/3"]])], [[0]]).model.stacks[0].A, [[[-THIRD]]]),
        "coupling": lambda: (
            couplings(kp.feedback_interconnect([LAG, LAG], [[0, "1/3"], [0, 0]])),
            [[0, THIRD], [0, 0]],
        ),
        "supply_rates": lambda: (supplied([[0, 0], [0, 0]], ["-1/3"], ["2/3"]).exact[1:], [["2/3"] * 2, ["-1/3"] * 2]),
    },
    "stack": {
        **{
            name: lambda name=name, want=want: (
                getattr(kp.stack([[["-1/3"]]], SIDE, SIDE, [["1/9"]]), name),
                [[[want]]],
            )
            for name, want in zip("ABCD", (-THIRD, THIRD, THIRD, Fraction(1, 9)), strict=True)
        },
        "X": lambda: (kp.stack([MINUS], TWO, TWO, X=CONE).X, SAME),
        "U": lambda: (kp.stack([MINUS], TWO, TWO, U=CONE).U, SAME),
        "Y": lambda: (kp.stack([MINUS], TWO, TWO, Y=CONE).Y, SAME),
    },
    "interval": {
        "lower": lambda: (in_range(kp.interval("1/3", 1)).lower.coupling, [[THIRD]]),
        "upper": lambda: (in_range(kp.interval(0, "1/3")).model.coupling, [[THIRD]]),
    },
    "scale_free_certificate": {
        "nodes": lambda: (kp.scale_free_certificate(plant([["-1/3"]]), 0.25).local.model.stacks[0].A, [[[-THIRD]]]),
        "weight": lambda: (kp.scale_free_certificate(LAG, weight="1/3").weight, THIRD),
        "link": lambda: (kp.scale_free_certificate(LAG, weight=1, link=SIDE).link, SIDES),
    },
    "OutWeightCertificate.covers": {
        "coupling": lambda: (
            kp.scale_free_certificate(plant([["-1/3"]]), "1/4").covers([[0, "1/3"], ["1/3", 0]]),
            False,
        )
    },
    "OutWeightCertificate.interconnect": {
        "coupling": lambda: (
            couplings(kp.scale_free_certificate(LAG, 0.5).interconnect([[0, "1/3"], ["1/3", 0]])),
            [[0, THIRD], [THIRD, 0]],
        )
    },
    "ConeNetwork.with_links": {
        "coupling": lambda: (couplings(kp.feedback_interconnect([LAG], [[0]]).with_links([["1/3"]])), SIDES)
    },
    "ConeNetwork.with_node": {
        "system": lambda: (
            kp.feedback_interconnect([LAG], [[0]]).with_node(plant([["-1/3"]])).model.block_matrices is not None
            and sorted(
                x
                for s in kp.feedback_interconnect([LAG], [[0]]).with_node(plant([["-1/3"]])).model.stacks
                for x in s.A.fractions().ravel().tolist()
            ),
            [-1, -THIRD],
        ),
        "incoming": lambda: (couplings(network(incoming={0: "1/5"})), [[0, THIRD, 0], ["1/4", 0, 0], ["1/5", 0, 0]]),
        "outgoing": lambda: (couplings(network(outgoing={0: "1/5"})), [[0, THIRD, "1/5"], ["1/4", 0, 0], [0, 0, 0]]),
    },
    "ConeNetwork.replace_node": {
        "system": lambda: (
            kp.feedback_interconnect([LAG], [[0]]).replace_node(0, plant([["-1/3"]])).model.stacks[0].A,
            [[[-THIRD]]],
        ),
        "incoming": lambda: (
            couplings(network().replace_node(0, LAG, incoming={1: "1/5"})),
            [[0, "1/5", 0], ["1/4", 0, 0], [0] * 3],
        ),
        "outgoing": lambda: (
            couplings(network().replace_node(0, LAG, outgoing={1: "1/5"})),
            [[0, THIRD, 0], ["1/5", 0, 0], [0] * 3],
        ),
    },
    "network_feedback": {
        "systems": lambda: (
            kp.network_feedback([plant(GAINED)], [[0]]).certificate.model.stacks[0].A,
            [loop_of(GAINED, ((1,), (0,)), kp.network_feedback([plant(GAINED)], [[0]]).F)],
        ),
        "coupling": lambda: (
            kp.network_feedback([LAG] * 2, [[0, "1/3"], [0, 0]]).certificate.model.coupling,
            [[0, THIRD], [0, 0]],
        ),
        "rate": lambda: (
            kp.network_feedback([plant([["-1/3"]], [[0]])], [[0]], rate="1/3").certificate.required_rate,
            THIRD,
        ),
        "gain_bound": lambda: (
            np.abs(kp.network_feedback([plant([["1/30"]])], [[0]], gain_bound="1/10").F).max() <= 0.1,
            True,
        ),
    },
    "optimal_feedback": {
        "sys": lambda: (best(sys=plant([["-1/3"]])).A, [[-THIRD]]),
        "s": lambda: (best(s=["1/3"]).s, SIDES),
        "r": lambda: (best(r=["1/3"]).r, SIDES),
        "limits": lambda: (best(limits=[["1/3"]]).limits, SIDES),
        "X": lambda: (
            best(sys=kp.ConeStateSpace(MINUS, TWO, TWO, 0), s=[1, 1], r=[0, 0], limits=[[0, 0]] * 2, X=CONE).X,
            SAME,
        ),
        "disturbance": lambda: (best(disturbance=([["1/9"]], SIDE)).limits, [[Fraction(1, 8)], [THIRD]]),
        "discount": lambda: (best(discount="1/3").discount, THIRD),
        "controls": lambda: (best(controls=SIDE).B, SIDES),
        "terminal_cost": lambda: (after_one_step(["1/3"]), SIDES),
    },
    "order_interval": {
        "sys": lambda: (kept(sys=plant([["-1/3"]])).positivity.A, [[-THIRD]]),
        "w_max": lambda: (kept(w_max=["1/3"]).exact[0], [THIRD]),
        "constraints": lambda: (kept(constraints=(SIDE, ["1/7"])).rows, SIDES),
        "X": lambda: (kept(sys=plant(MINUS), w_max=[1, 1], X=CONE).X, SAME),
    },
    "structured_gain": {"sys": lambda: (kp.structured_gain(LOSSY).positivity.A, [[-THIRD]])},
    "robust_margin": {"sys": lambda: (kp.robust_margin(LOSSY).certificate.positivity.A, [[-THIRD]])},
    "switched": SWITCHED,
    "gain_rate_tradeoff": {
        "rates": lambda: (kp.gain_rate_tradeoff(THIRDS, ["1/3"], certify=True).designs[0].weakened_rate, THIRD)
    },
    "state_feedback": design_rows(kp.state_feedback)
    | {
        "gain_bound": lambda: (
            at_most(kp.state_feedback(plant(GAINED), gain_bound="31/10").certificate.others[0].bound, "31/10"),
            True,
        ),
        "vertices": lambda: loop_row(
            lambda: kp.state_feedback(plant([[0, 1], [1, -3]]), vertices=[(GAINED, [["1/3"], [0]])] * 2),
            B=(("1/3",), (0,)),
        ),
        "disturbance": lambda: (
            kp.state_feedback(plant(MIXED), disturbance=([["1/3"], [0]], [["1/7", 0]], [[0]], [["1/9"]]), gain_bound=5)
            .certificate.others[-1]
            .positivity.B,
            [[THIRD], [0]],
        ),
    },
    "output_feedback": {
        **design_rows(kp.output_feedback),
        "sys": lambda: (
            closed(kp.output_feedback(plant(GAINED))).A.fractions()[0, 0]
            - Fraction(kp.output_feedback(plant(GAINED)).F[0, 0]),
            THIRD,
        ),
        "gain_bound": lambda: (
            at_most(kp.output_feedback(plant(GAINED), gain_bound="31/10").certificate.others[0].bound, "31/10"),
            True,
        ),
        "vertices": lambda: (
            kp.output_feedback(plant([[0, 1], [1, -3]]), vertices=[(GAINED, [[1], [0]])] * 2)
            .certificate.loops[0]
            .A.fractions()[0, 1],
            1,
        ),
    },
    "observer_gain": {
        "sys": lambda: (closed(kp.observer_gain(plant([["-1", "1/3"], [1, -3]]))).A.fractions()[1, 0], THIRD),
        "X": lambda: (closed(kp.observer_gain(plant(MINUS), X=CONE)).X, SAME.dual),
        "rate": lambda: (kp.observer_gain(plant(GAINED), rate="1/3").weakened_rate, THIRD),
        "gain_bound": lambda: (
            at_most(kp.observer_gain(plant(GAINED), gain_bound="31/10").certificate.others[0].bound, "31/10"),
            True,
        ),
    },
    "scale_free_feedback": {
        "sys": lambda: (
            (kp.scale_free_feedback(plant([["-1/3"]]), "1/4").closed_loop.exact.A.fractions()[0, 0] + THIRD).denominator
            < 10**6
            and (0, 0)
        ),
        "weight": lambda: (kp.scale_free_feedback(LAG, weight="1/3").certificate.weight, THIRD),
        "X": lambda: (
            kp.scale_free_feedback(plant(MINUS, [["1/3"], ["1/7"]], [[1, 0]]), 0.25, X=CONE)
            .certificate.local.model.stacks[0]
            .X,
            SAME,
        ),
        "rate": lambda: (kp.scale_free_feedback(THIRDS, 0, rate="1/3").certificate.required_rate, THIRD),
        "gain_bound": lambda: (kp.scale_free_feedback(LAG, "1/4", gain_bound="1/10").status, kp.Status.PROVED),
    },
    "PolyhedralCone": {"rays": lambda: (kp.PolyhedralCone(CONE), SAME)},
    "PolyhedralCone.from_facets": {
        "normals": lambda: (kp.PolyhedralCone.from_facets(CONE), kp.PolyhedralCone.from_facets([[7, 3], [0, 1]]))
    },
    "PolyhedralCone.contains": {
        "x": lambda: ([SAME.contains(["1/3", "1/7"]), SAME.contains(["1/3", "1/7"], strict=True)], [True, False])
    },
    "PolyhedralCone.transform": {"T": lambda: (PLANE.transform([["1/3", 0], ["1/7", 1]]), SAME)},
    "examples.mass_spring_node": {
        "F": lambda: (kp.examples.mass_spring_node(["-64/3", -13]).exact.A, [[0, 1], ["-67/3", -13]]),
        "k": lambda: (kp.examples.mass_spring_node(k="1/3").exact.A, [[0, 1], ["-64/3", -13]]),
        "m": lambda: (kp.examples.mass_spring_node(m=3).exact.A, [[0, 1], ["-64/3", -13]]),
    },
}
EXACT |= exact_systems.ROWS | exact_nonlinear.ROWS | exact_shards.ROWS
EXACT["state_feedback"] |= BOUNDS
EXACT["Cone.contains"], EXACT["Cone.transform"] = EXACT["PolyhedralCone.contains"], EXACT["PolyhedralCone.transform"]

# Numbers that end as doubles, each with the reason.
_GAIN = "the answer is one double, correctly rounded: see test_gains_are_correctly_rounded"
_SIMULATED = "a simulation in floating point"
_EFFORT = "effort and tolerance of a search, which prove nothing"
_DRAWN = "a picture"
DOUBLES = (
    exact_nonlinear.DOUBLES
    | exact_shards.DOUBLES
    | {
        "induced_gain": dict.fromkeys(["A", "B", "C", "D", "X", "U", "Y", "e", "f"], _GAIN),
        "ConeStateSpace.gain": dict.fromkeys("ef", _GAIN),
        "differential_positivity": dict.fromkeys(
            ["region", "inputs", "equilibrium"],
            "ends of boxes, rounded outwards; see test_a_region_is_covered_to_its_ends",
        ),
        "ConeNetwork.delayed_response": dict.fromkeys(["T", "X0", "delays"], _SIMULATED),
        "ConeNetwork.forced_response": dict.fromkeys(["T", "U", "X0"], _SIMULATED),
        "ConeNetwork.initial_response": dict.fromkeys(["T", "X0"], _SIMULATED),
        "ConeNetwork.step_response": dict.fromkeys(["T", "X0"], _SIMULATED),
        "ConeNetwork.horner": {"x": "a frequency response in floating point"},
        "ConeNetwork.abscissa_certificate": {"relative": _EFFORT},
        "ConeNetwork.spectral_abscissa": {"relative": _EFFORT},
        **{name: {"gap": _EFFORT} for name in ("state_feedback", "network_feedback", "optimal_feedback")},
        "design_cone_and_feedback": {"poles": "where gains are sought; what they do is proven"},
        "ConeNetwork.room_for": dict.fromkeys(
            ["system", "sources", "targets"], "an estimate in floating point; `with_node` proves"
        ),
        "ConeStateSpace.sample": {"Ts": "matrix exponentials are computed in floating point"},
        "ConeStateSpace.linearize": {"x0": "the system itself is returned, wherever it is linearised"},
        "gain_rate_tradeoff": {
            "sys": "a curve in floating point; its designs, if asked for, are those of `state_feedback`",
            "X": "the cone of this curve",
            "demands": "as those of `state_feedback`",
        },
        "plot_observer": dict.fromkeys(["T", "y", "u", "x0", "states", "which"], _DRAWN),
        "phase_portrait": dict.fromkeys(["sys", "X", "pointdata", "timedata", "initial_states", "level_lines"], _DRAWN),
        "plot_closed_loop": {"sys": _DRAWN},
        "plot_cone": dict.fromkeys(["X", "size"], _DRAWN),
        "plot_network": {"positions": _DRAWN},
        "plot_responses": {"response": _DRAWN},
        "examples.mass_spring": dict.fromkeys("km", "doubles for python-control; `mass_spring_node` is exact"),
    }
)
for _method in ("gain", "linearize", "sample"):  # the same for networks
    DOUBLES[f"ConeNetwork.{_method}"] = DOUBLES[f"ConeStateSpace.{_method}"]
# Arguments that are no data: what they are.
NO_DATA = {
    "names and words": {"name", "names", "title", "label", "color", "kind", "norm", "method", "few", "path"}
    | {"folder", "out", "network"},
    "yes or no": {"discrete", "uniform", "ports", "per_mode", "strict", "inverse", "trusted", "certify", "use_all"}
    | {"dominant_direction", "show_legend", "warn_infinite", "use_prefix_suffix", "states", "difference"},
    "whole numbers": {"n", "nu", "ny", "k", "max_rays", "seed", "restarts", "pieces", "refine", "node", "types"}
    | {"facets", "n_nodes", "degree", "groups", "horizon", "parts"},
    "seconds, and who hears of them": {"time_limit", "progress"},
    "signals by place or name": {"inputs", "outputs"},
    "a timebase, which python-control keeps in doubles": {"dt"},
    "patterns of zeros": {"structure"},
    "code of the user": {"constraints", "objective", "solver", "f", "g", "function", "executor", "client", "comm"},
    "objects that hold their own exact data": {"factors", "design", "net", "curve", "ax", "nodes", "observer"},
    "passed on": {"args", "kwargs"},
}
# Data classes are made by the functions above; what they hold is checked there.
MADE_BY_OTHERS = {"Cone", "Certificate", "ConeNetwork", "NonlinearNetwork", "NonlinearNetwork.outputs"}


def arguments():
    """Every argument of every public function and method: (function, argument)."""
    for name, thing in {**PUBLIC, **METHODS}.items():
        owner = PUBLIC.get(name.rpartition(".")[0])
        if dataclasses.is_dataclass(thing) or name in MADE_BY_OTHERS:
            continue
        if dataclasses.is_dataclass(owner) and name not in EXACT:
            continue
        for argument in inspect.signature(thing).parameters:
            if argument not in ("self", "cls"):
                yield name, argument


def plainly(x):
    """Fractions in nested lists, or what has no fractions."""
    if isinstance(x, Matrix):
        return x.dense().fractions().tolist()
    if isinstance(x, (list, tuple, np.ndarray)):
        return [plainly(y) for y in x]
    return Fraction(x) if isinstance(x, (int, float, str, Fraction)) else x


@pytest.mark.parametrize(("name", "argument"), list(arguments()))
def test_every_argument_has_its_row(name, argument):
    if argument in EXACT.get(name, {}):
        got, want = EXACT[name][argument]()
        assert plainly(got) == plainly(want)
        assert argument not in DOUBLES.get(name, {})
        return
    known = argument in DOUBLES.get(name, {}) or any(argument in group for group in NO_DATA.values())
    assert known, (
        f"{name}({argument}) takes what? Give it a row in EXACT, or the reason why it holds no data of a proof"
    )


def test_no_row_is_left_over():
    known = set(arguments())
    rows = {(name, argument) for table in (EXACT, DOUBLES) for name, row in table.items() for argument in row}
    assert rows - known <= {("Cone.contains", "x"), ("Cone.transform", "T")}
