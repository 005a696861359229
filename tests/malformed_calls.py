"""A valid call of every public function and method, argument by argument."""

import tempfile
from functools import cache
from pathlib import Path

import control as ct
import malformed_nonlinear
import numpy as np
import pyarrow
from pyarrow import parquet

import control_kpos as kp

X2, LINE, PAPER = kp.orthant(2), kp.orthant(1), kp.examples.paper_cone()
A, B, C, D = [[-2.0, 1.0], [1.0, -2.0]], [[1.0], [0.0]], [[1.0, 0.0]], [[0.0]]
MATRICES = {"A": A, "B": B, "C": C, "D": D, "X": X2, "U": LINE, "Y": LINE}
SYSTEM = kp.ConeStateSpace(A, B, C, D)
PLANT = ct.ss([[0, 1], [-1, 0]], [[0], [1]], [[1, 0]], 0)
OUTPUT_PLANT = ct.ss([[-3, 1], [2, 1]], [[0], [1]], [[0, 1]], 0)
SHRINKING = ct.nlsys(lambda t, x, u, p: [-x[0], -x[1]], None, inputs=1, outputs=2, states=2)
NODE = kp.examples.mass_spring_node()
RING = kp.examples.ring(3)
NETWORK = kp.feedback_interconnect([NODE] * 3, RING)
SIMPLE = kp.ConeStateSpace([[-2]], [[1]], [[1]], 0)
STEPS = kp.ConeStateSpace([[0.5]], [[0.5]], [[1]], 0, True)
OUT_WEIGHTS = kp.scale_free_certificate([SIMPLE])
DESIGN = kp.state_feedback(PLANT, X=PAPER)
CURVE = kp.gain_rate_tradeoff(PLANT, [0.5, 1], X=PAPER)
TIMES = np.linspace(0, 1, 5)
STEPPED = NETWORK.step_response(TIMES)
MEASURED = {"X0": [[1, 0, 1], [0, 1, 1]], "X1": [[0.5, 0.2, 0.7], [0.1, 0.4, 0.5]], "noise": 0.01}
# what the design functions share
DEMANDS = {"X": None, "rate": 0, "gain_bound": None, "solver": None, "time_limit": 2.0, "progress": None}
SEARCH = {"seed": 0, "restarts": 2, "time_limit": 1.0, "progress": None}


def build(A, B, C, D, dt, **more):
    return kp.ConeStateSpace(A, B, C, D, dt, **more)


def build_from(sys, **cones):
    return kp.ConeStateSpace(sys, **cones)


NEW = object()  # stands for a folder


def in_shards(source, folder, **more):
    return kp.shards.write(source, tempfile.mkdtemp() if folder is NEW else folder, **more)


@cache
def in_tables():
    place = Path(tempfile.mkdtemp())
    home = {"A": [[-2.0]], "B": [[1.0]], "C": [[1.0]], "kind": ["home"]}
    for name, table in (("nodes", home), ("links", {"source": [0], "target": [0], "weight": [0.5]})):
        parquet.write_table(pyarrow.table(table), place / name)
    return place


def of_tables(nodes, links, **more):
    nodes, links = (
        in_tables() / name if given is NEW else given for name, given in (("nodes", nodes), ("links", links))
    )
    return kp.shards.write(kp.shards.parquet(nodes, links, **more), Path(tempfile.mkdtemp()) / "network")


@cache
def sharded():
    return in_shards(([SIMPLE] * 3, RING), NEW, parts=2)


def of_shards(folder, out, **more):
    place = sharded() if folder is NEW else folder
    return kp.shards.certify(place, sharded() / "proof" if out is NEW else out, **more)


def shards_again(out, **more):
    kp.shards.certify(sharded(), sharded() / "proof")
    return kp.shards.check(sharded() / "proof" if out is NEW else out, **more)


def by_a_chain(**more):
    return kp.switched([A, [[-3.0, 1.0], [1.0, -2.0]]], **more)


CALLS = {  # cones and theorems
    "state_positivity": (kp.state_positivity, {"A": A, "X": X2, "discrete": False}),
    "cone_positivity": (kp.cone_positivity, {**MATRICES, "discrete": False}),
    "linear_lyapunov": (kp.linear_lyapunov, {"A": A, "X": X2, "discrete": False, "rate": "max"}),
    "dissipativity": (kp.dissipativity, {**MATRICES, "q": [-1], "r": [1], "discrete": False}),
    "induced_gain": (kp.induced_gain, {**MATRICES, "norm": "L1", "e": [1], "f": [1], "discrete": False}),
    "structured_gain": (kp.structured_gain, {"sys": SYSTEM, "structure": "full", "time_limit": 2.0}),
    "robust_margin": (kp.robust_margin, {"sys": SYSTEM, "structure": "diagonal", "time_limit": 2.0}),
    "PolyhedralCone": (kp.PolyhedralCone, {"rays": A}),
    "PolyhedralCone.from_facets": (kp.PolyhedralCone.from_facets, {"normals": A}),
    "orthant": (kp.orthant, {"n": 2}),
    "product": (kp.product, {"factors": [X2, LINE]}),
    "lorentz": (kp.lorentz, {"n": 3, "facets": 8, "kind": "inner"}),
    "Cone.contains": (PAPER.contains, {"x": [1, 0], "strict": False}),
    "Cone.transform": (PAPER.transform, {"T": np.eye(2)}),
}
CALLS |= {  # systems
    "ConeStateSpace": (
        build,
        {**MATRICES, "dt": 0, "name": "n", "inputs": ["u"], "outputs": ["y"], "states": ["a", "b"]},
    ),
    "ConeStateSpace of a system": (build_from, {"sys": PLANT, "X": PAPER}),
    "ConeStateSpace.linear_lyapunov": (SYSTEM.linear_lyapunov, {"rate": None}),
    "ConeStateSpace.dissipativity": (SYSTEM.dissipativity, {"q": [-1], "r": [1]}),
    "ConeStateSpace.gain": (SYSTEM.gain, {"norm": "L1", "e": [1], "f": [1]}),
    "ConeStateSpace.append": (SYSTEM.append, {"other": SYSTEM}),
    "ConeStateSpace.feedback": (SYSTEM.feedback, {"other": SYSTEM, "sign": 1}),
    "ConeStateSpace.lft": (SYSTEM.lft, {"other": SYSTEM, "nu": 1, "ny": 1}),
    "ConeStateSpace.sample": (SYSTEM.sample, {"Ts": 0.1, "method": "zoh"}),
    "ConeStateSpace.similarity_transform": (
        SYSTEM.similarity_transform,
        {"T": np.eye(2), "timescale": 1, "inverse": False},
    ),
}
CALLS |= {  # networks
    "feedback_interconnect": (
        kp.feedback_interconnect,
        {
            "systems": [NODE] * 3,
            "coupling": RING,
            "supply_rates": None,
            "inputs": [0],
            "outputs": [0],
            "name": "n",
            "progress": None,
            "time_limit": None,
        },
    ),
    "shards.write": (
        in_shards,
        {
            "source": ([SIMPLE] * 3, RING),
            "folder": NEW,
            "parts": 2,
            "partition": [0, 1, 0],
            "resume": False,
            "progress": None,
        },
    ),
    "shards.parquet": (
        of_tables,
        {"nodes": NEW, "links": NEW, "X": kp.orthant(1), "U": None, "Y": {"home": kp.orthant(1)}, "dt": 0},
    ),
    "shards.certify": (
        of_shards,
        {"folder": NEW, "out": NEW, "comm": None, "client": None, "time_limit": 9.0, "progress": None},
    ),
    "shards.check": (shards_again, {"out": NEW, "executor": None, "network": None, "progress": None}),
    "interval": (kp.interval, {"lower": [[0, 1]], "upper": [[1, 2]]}),
    "largest_uncertainty": (
        kp.largest_uncertainty,
        {"net": kp.feedback_interconnect([SIMPLE], [[kp.interval(0, 0.5)]]), "time_limit": 2.0},
    ),
    "UncertainNetworkCertificate.costliest": (
        kp.feedback_interconnect([SIMPLE], [[kp.interval(0, 0.5)]]).certificate.costliest,
        {"k": 1},
    ),
    "stack": (kp.stack, {**MATRICES, "dt": 0, "names": ["a"]}),
    "scale_free_certificate": (kp.scale_free_certificate, {"nodes": [SIMPLE], "weight": 1.0, "link": None}),
    "OutWeightCertificate.covers": (OUT_WEIGHTS.covers, {"coupling": [[0.5]], "types": None}),
    "OutWeightCertificate.interconnect": (
        OUT_WEIGHTS.interconnect,
        {"coupling": [[0, 0.5], [0.5, 0]], "types": [0, 0], "name": "n"},
    ),
    "ConeNetwork.linear_lyapunov": (NETWORK.linear_lyapunov, {"rate": None, "time_limit": 2.0}),
    "ConeNetwork.dissipativity": (NETWORK.dissipativity, {"q": [-1] * 3, "r": [1] * 3, "time_limit": 2.0}),
    "ConeNetwork.gain": (NETWORK.gain, {"norm": "L1", "e": [1] * 3, "f": [1] * 3, "time_limit": 2.0}),
    "ConeNetwork.append": (NETWORK.append, {"other": SYSTEM}),
    "ConeNetwork.feedback": (NETWORK.feedback, {"other": NETWORK, "sign": 1}),
    "ConeNetwork.lft": (NETWORK.lft, {"other": SYSTEM, "nu": 1, "ny": 1}),
    "ConeNetwork.sample": (NETWORK.sample, {"Ts": 0.1, "method": "zoh"}),
    "ConeNetwork.similarity_transform": (
        NETWORK.similarity_transform,
        {"T": np.eye(6), "timescale": 1, "inverse": False},
    ),
    "ConeNetwork.with_links": (NETWORK.with_links, {"coupling": RING}),
    "ConeNetwork.with_node": (NETWORK.with_node, {"system": NODE, "incoming": {0: 1.0}, "outgoing": {1: 1.0}}),
    "ConeNetwork.replace_node": (
        NETWORK.replace_node,
        {"node": 0, "system": NODE, "incoming": {1: 1.0}, "outgoing": {1: 1.0}},
    ),
    "ConeNetwork.without_node": (NETWORK.without_node, {"node": 0}),
    "ConeNetwork.room_for": (NETWORK.room_for, {"system": NODE, "sources": [0], "targets": [1]}),
    "ConeNetwork.copy": (NETWORK.copy, {"name": "n", "use_prefix_suffix": True}),
    "ConeNetwork.poles": (NETWORK.poles, {"k": 2, "time_limit": 2.0}),
    "ConeNetwork.spectral_abscissa": (NETWORK.spectral_abscissa, {"relative": 1e-6, "time_limit": 2.0}),
    "ConeNetwork.abscissa_certificate": (NETWORK.abscissa_certificate, {"relative": 1e-6, "time_limit": 2.0}),
    "ConeNetwork.cone_positivity": (NETWORK.cone_positivity, {"time_limit": 2.0}),
    "ConeNetwork.is_cone_positive": (NETWORK.is_cone_positive, {"time_limit": 2.0}),
    "ConeNetwork.initial_response": (
        NETWORK.initial_response,
        {"T": TIMES, "X0": np.ones(6), "outputs": [0], "states": False},
    ),
    "ConeNetwork.forced_response": (
        NETWORK.forced_response,
        {"T": TIMES, "U": np.ones((3, 5)), "X0": 0.0, "outputs": [0], "states": False},
    ),
    "ConeNetwork.step_response": (
        NETWORK.step_response,
        {"T": TIMES, "X0": 0.0, "inputs": [0], "outputs": [0], "states": False},
    ),
    "ConeNetwork.delayed_response": (
        NETWORK.delayed_response,
        {"T": TIMES, "X0": np.ones(6), "delays": 0.1, "outputs": [0], "refine": 4},
    ),
}
CALLS |= {  # design
    "state_feedback": (
        kp.state_feedback,
        {
            "sys": PLANT,
            **DEMANDS,
            "X": PAPER,
            "rate": 1,
            "structure": None,
            "vertices": None,
            "per_mode": False,
            "disturbance": None,
            "ports": False,
            "state_bounds": None,
            "input_bounds": None,
            "disturbance_bounds": None,
            "gap": 1e-3,
            "constraints": None,
            "objective": None,
            "method": "auto",
        },
    ),
    "output_feedback": (
        kp.output_feedback,
        {"sys": OUTPUT_PLANT, **DEMANDS, "X": X2, "structure": None, "vertices": None, "ports": False},
    ),
    "observer_gain": (kp.observer_gain, {"sys": OUTPUT_PLANT, **DEMANDS, "X": X2}),
    "optimal_feedback": (
        kp.optimal_feedback,
        {
            "sys": SIMPLE,
            "s": [2],
            "r": [1],
            "limits": [[0.5]],
            "X": None,
            "controls": [[1]],
            "groups": [[0]],
            "use_all": False,
            "disturbance": ([[1]], [[0.25]]),
            "discount": 0.5,
            "time_limit": 2.0,
            "progress": None,
        },
    ),
    "optimal_feedback over some steps": (
        kp.optimal_feedback,
        {"sys": STEPS, "s": [2], "r": [1], "limits": [[0.5]], "horizon": 2, "terminal_cost": [1], "time_limit": 2.0},
    ),
    "optimal_feedback under constraints": (
        kp.optimal_feedback,
        {"sys": STEPS, "s": [2], "r": [0], "limits": [[0.5]], "constraints": None, "objective": None, "gap": 1e-3},
    ),
    "order_interval": (
        kp.order_interval,
        {"sys": SIMPLE, "w_max": [1], "constraints": ([[1]], [9]), "X": None, "time_limit": 2.0},
    ),
    "network_feedback": (
        kp.network_feedback,
        {
            "systems": [kp.ConeStateSpace(PLANT, X=PAPER)] * 2,
            "coupling": [[0, 0.1], [0.1, 0]],
            "uniform": False,
            "gap": 1e-3,
            **{k: v for k, v in DEMANDS.items() if k != "X"},
        },
    ),
    "scale_free_feedback": (
        kp.scale_free_feedback,
        {"sys": PLANT, "weight": 1.0, **DEMANDS, "X": PAPER, "structure": None},
    ),
    "gain_rate_tradeoff": (
        kp.gain_rate_tradeoff,
        {"sys": PLANT, "rates": [1], "X": PAPER, "certify": False, "time_limit": 2.0, "progress": None},
    ),
}
CALLS |= {  # families
    "switched": (
        kp.switched,
        {"family": [A, [[-3.0, 1.0], [1.0, -2.0]]], "X": X2, "discrete": False, "rate": None, "time_limit": 2.0},
    ),
    "switched by a chain": (
        by_a_chain,
        {"chain": [[-1, 1], [2, -2]], "jumps": {(0, 1): [[1, 1], [0, 1]]}, "rate": "max"},
    ),
    "data_feedback": (
        kp.data_feedback,
        {**MEASURED, "U0": [[0, 0, 1]], "X": X2, "discrete": True, "time_limit": 2.0},
    ),
    "data_positivity": (
        kp.data_positivity,
        {**MEASURED, "U0": [[0, 0, 1]], "X": X2, "discrete": True, "time_limit": 2.0},
    ),
    "delayed": (
        kp.delayed,
        {"A": A, "A_delay": [[0.1, 0], [0, 0.1]], "X": X2, "discrete": False, "max_delay": 1.0, "time_limit": 2.0},
    ),
    "compartmental": (
        kp.compartmental,
        {"flows": [[0, 1.0], [2.0, 0]], "outflows": [0, 1.0], "B": [[1.0], [0]], "C": [[0, 1.0]]},
    ),
    "delayed of a network": (kp.delayed, {"A": NETWORK, "A_delay": 0.01 * np.eye(2), "time_limit": 2.0}),
}
OBSERVER = kp.interval_observer(ct.ss(-1, 1, 1, 0), disturbance=([-1], [1]), noise=[0.1])
MEASURED = {"T": [0, 1, 2], "y": [0.0, 0.0, 0.0], "u": [0.0, 0.0, 0.0], "x0": ([-1], [1])}
CALLS |= {  # observers
    "interval_observer": (
        kp.interval_observer,
        {"sys": SYSTEM, "disturbance": ([-1, 0], [1, 0]), "noise": [0.1], "X": X2, "time_limit": 2.0},
    ),
    "IntervalObserver.simulate": (OBSERVER.simulate, MEASURED),
    "IntervalObserver.start": (OBSERVER.start, {"x0": ([-1], [1])}),
    "interval_observer of a network": (
        kp.interval_observer,
        {
            "sys": NETWORK,
            "disturbance": ([-1] * NETWORK.nstates, [1] * NETWORK.nstates),
            "noise": 0.1,
            "time_limit": 2.0,
        },
    ),
    "plot_observer": (
        kp.plot_observer,
        {"observer": OBSERVER, **MEASURED, "states": [[0.0, 0.0, 0.0]], "which": [0], "title": None},
    ),
}
CALLS |= {  # cone finding, nonlinear systems
    "positive_realization": (
        kp.positive_realization,
        {"G": [0, 1.0, 0.5, 0.25, 0.125], "time_limit": 2.0, "progress": False},
    ),
    "find_cone": (
        kp.find_cone,
        {"A": A, "contains": [[1, 1]], "within": X2, "max_rays": 4, "discrete": False, "few": "rays", **SEARCH},
    ),
    "find_cone for a family": (
        kp.find_cone,
        {"A": [A, [[-3, 1], [1, -2]]], "max_rays": 4, "discrete": None, **SEARCH},
    ),
    "design_cone_and_feedback": (
        kp.design_cone_and_feedback,
        {
            "sys": PLANT,
            "vertices": [(PLANT.A, PLANT.B)],
            "rate": 0.1,
            "poles": None,
            "time_limit": 2.0,
            "seed": 0,
            "progress": None,
        },
    ),
    "differential_positivity": (
        kp.differential_positivity,
        {
            "jacobians": SHRINKING,
            "X": X2,
            "region": [[0, 1], [0, 1]],
            "inputs": [[0, 1]],
            "equilibrium": None,
            "discrete": None,
            "pieces": 4,
            "time_limit": 1.0,
        },
    ),
    "differential_positivity of matrices": (kp.differential_positivity, {"jacobians": [A, A], "X": X2}),
}
CALLS |= {  # pictures, files, examples
    "phase_portrait": (
        kp.phase_portrait,
        {
            "sys": SYSTEM,
            "X": X2,
            "pointdata": [-1, 1, -1, 1],
            "timedata": 1.0,
            "initial_states": [[1, 1]],
            "level_lines": True,
            "dominant_direction": True,
            "show_legend": True,
            "ax": None,
            "title": "t",
        },
    ),
    "plot_cone": (kp.plot_cone, {"X": X2, "ax": None, "title": "t", "size": 1.0, "color": "C0", "label": "x"}),
    "plot_network": (kp.plot_network, {"net": NETWORK, "ax": None, "positions": None, "title": None}),
    "plot_poles": (kp.plot_poles, {"net": NETWORK, "ax": None, "k": None, "title": None}),
    "plot_responses": (
        kp.plot_responses,
        {"response": STEPPED, "outputs": [0], "inputs": [0], "kind": None, "ax": None, "title": None},
    ),
    "plot_closed_loop": (kp.plot_closed_loop, {"sys": PLANT, "design": DESIGN, "title": None}),
    "plot_tradeoff": (kp.plot_tradeoff, {"curve": CURVE, "ax": None, "title": None}),
    "load_certificate": (kp.load_certificate, {"path": "no such file", "trusted": False}),
    "Certificate.save": (kp.linear_lyapunov(A, X2).save, {"path": "certificate.json"}),
    "examples.mass_spring": (kp.examples.mass_spring, {"k": 1.0, "m": 1.0}),
    "examples.mass_spring_node": (kp.examples.mass_spring_node, {"F": [[-30, -20]], "k": 1.0, "m": 1.0}),
    "examples.mass_spring_nodes": (kp.examples.mass_spring_nodes, {"n_nodes": 3, "seed": 0}),
    "examples.ring": (kp.examples.ring, {"n_nodes": 3}),
    "examples.random_regular": (kp.examples.random_regular, {"n_nodes": 8, "degree": 3, "seed": 0}),
}
CALLS |= malformed_nonlinear.CALLS
