"""Small networks written to files in shards, for the tests of shards."""

import numpy as np
from network_examples import random_masses

import control_kpos as kp


def written(place, nodes, coupling, parts, name="network"):
    return kp.shards.write((nodes, coupling), place / name, parts, progress=False)


def certified(place, nodes, coupling, parts, name="network"):
    folder = written(place, nodes, coupling, parts, name)
    return kp.shards.certify(folder, folder / "proof", progress=False)


def masses(seed=1, n=24):
    return random_masses(np.random.default_rng(seed), n), kp.examples.random_regular(n, 3, seed=seed)
