"""Worked nonlinear networks: epidemics, traffic, genes, a Hopfield network and the swing equations on IEEE 118."""

import numpy as np
import scipy.sparse as sp
from pypower.case118 import case118
from pypower.idx_brch import BR_X, F_BUS, T_BUS, TAP
from pypower.idx_bus import BUS_I, PD
from pypower.idx_gen import GEN_BUS, PMAX

import control_kpos as kp

FREQUENCY = 2 * np.pi * 60


def contacts(N, per_node=3, strength=0.1, seed=0):
    """Weights of a random graph: a ring, so that all are connected, and other links."""
    rng, ring = np.random.default_rng(seed), np.arange(N)
    rows, columns = (np.concatenate([end, rng.integers(0, N, (per_node - 1) * N)]) for end in (ring, (ring + 1) % N))
    weights = rng.uniform(0.5, 1.5, per_node * N) * strength
    return sp.csr_array((weights, (rows, columns)), shape=(N, N))


def sis(W, cure=1.0):
    """Infected shares: x' = -cure x + (1 - x) W x."""
    nodes = kp.nonlinear_nodes(
        lambda x, u, p: [(1 - x[0]) * u[0] - p["cure"] * x[0]], n_nodes=W.shape[0], params={"cure": cure}
    )
    return kp.nonlinear_interconnect(nodes, W)


def sir(W, susceptible=0.99, cure=1.0):
    """Infections so far: J' = infected = 1 - susceptible e^{-W J} - cure J, J being the integral of the infected."""
    nodes = kp.nonlinear_nodes(
        lambda x, u, p: [1 - p["s"] * np.exp(-u[0]) - p["cure"] * x[0]],
        n_nodes=W.shape[0],
        params={"s": susceptible, "cure": cure},
    )
    return kp.nonlinear_interconnect(nodes, W)


def traffic(cells, free=1.0, wave=0.5, jam=1.0, exits=0.1):
    """Cell transmission: each cell sends min(demand, supply of the next), and a part leaves at ramps."""

    def densities(x, u, p):
        supply = p["wave"] * (p["jam"] - x[0])
        demand = p["free"] * x[0]
        ahead = p["wave"] * (p["jam"] - u[1])
        return [np.minimum(u[0], supply) - np.minimum(demand, ahead) - p["exits"] * x[0]]

    nodes = kp.nonlinear_nodes(
        densities,
        lambda x, p: [p["free"] * x[0], x[0]],
        n_nodes=cells,
        inputs=2,
        outputs=2,
        params={"free": free, "wave": wave, "jam": jam, "exits": exits},
    )
    W = sp.lil_array((2 * cells, 2 * cells))
    for k in range(1, cells):
        W[2 * k, 2 * (k - 1)] = 1.0  # demand of the cell behind
        W[2 * (k - 1) + 1, 2 * k + 1] = 1.0  # density of the cell ahead
    return kp.nonlinear_interconnect(nodes, sp.csr_array(W))


def genes(W, decay=1.0, translation=1.0):
    """Messenger and protein, activated by others: a Hill function of exponent 2."""
    nodes = kp.nonlinear_nodes(
        lambda x, u, p: [0.1 + u[0] - p["decay"] * x[0], p["make"] * x[0] - x[1]],
        lambda x, p: [x[1] ** 2 / (1 + x[1] ** 2)],
        n_nodes=W.shape[0],
        states=2,
        params={"decay": decay, "make": translation},
    )
    return kp.nonlinear_interconnect(nodes, W)


def hopfield(W, leak=1.0):
    """x' = -leak x + W tanh(x) + w."""
    nodes = kp.nonlinear_nodes(
        lambda x, u, p: [u[0] - p["leak"] * x[0]],
        lambda x, p: [np.tanh(x[0])],
        n_nodes=W.shape[0],
        params={"leak": leak},
    )
    return kp.nonlinear_interconnect(nodes, W)


def swing(grounding=0.1):
    """Swing equations on IEEE 118, machines with angle droop first, then loads that hold no angle.

    Damping is 1.2 times what a machine needs not to swing against its neighbours held still; see notebook 08.
    """
    case = case118()
    place = {int(bus): i for i, bus in enumerate(case["bus"][:, BUS_I])}
    branch = case["branch"]
    i, j = ([place[int(bus)] for bus in branch[:, end]] for end in (F_BUS, T_BUS))
    b = 1 / (branch[:, BR_X] * np.where(branch[:, TAP] == 0, 1.0, branch[:, TAP]))
    W, rating = np.zeros((len(place),) * 2), np.zeros(len(place))
    np.add.at(W, (i, j), b)
    np.add.at(W, (j, i), b)
    load = np.maximum(case["bus"][:, PD], 5) / case["baseMVA"]
    np.add.at(rating, [place[int(bus)] for bus in case["gen"][:, GEN_BUS]], case["gen"][:, PMAX] / case["baseMVA"])
    order = np.argsort(rating == 0, kind="stable")
    W, rating, load, M = W[np.ix_(order, order)], rating[order], load[order], int((rating > 0).sum())
    mass, pull = 8.0 * rating[:M] / FREQUENCY, (1 + grounding) * W.sum(axis=1)[:M]
    edge = np.sqrt(pull / mass)
    params = {"a": edge, "g": grounding * W.sum(axis=1)[:M], "d": 2.4 * np.sqrt(mass * pull), "m": mass}
    machines = kp.nonlinear_nodes(
        lambda x, u, p: [p["a"] * x[1], (u[0] - p["g"] * x[0] - p["d"] * p["a"] * x[1]) / (p["m"] * p["a"])],
        n_nodes=M,
        states=2,
        params=params,
        X=[[0, 1], [1, -1]],
    )
    loads = kp.nonlinear_nodes(lambda x, u, p: [u[0] / p["d"]], n_nodes=len(W) - M, params={"d": load[M:] / FREQUENCY})
    rows, columns = W.nonzero()
    lines = kp.nonlinear_links(np.sin, rows, columns, weights=W[rows, columns], difference=True)
    return kp.nonlinear_interconnect([machines, loads], lines)


def angles(net, degrees):
    """The region of all angles up to these, in the order of the cones."""
    high = net.pack([np.radians(degrees), 0], [np.radians(degrees)])
    return np.column_stack([-high, high])
